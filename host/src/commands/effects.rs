//! `meshband effects`: the library of effects, and the page of the documentation that shows them.

use clap::Args as ClapArgs;
use meshband_host::dynamics::Rig;
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::effects::catalogue::{example, markdown, picture};
use meshband_host::effects::{Entry, REGISTRY};
use meshband_host::machine::Machine;
use meshband_host::output::{OutputFile, Outputs, show};
use meshband_host::report::Report;
use meshband_host::results::Results;
use meshband_host::{Error, Result, terminal};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Arguments of `meshband effects`.
#[derive(ClapArgs)]
pub struct Args {
    /// Machine of the pictures.
    #[arg(long, default_value = "machines/19-48.toml")]
    machine: PathBuf,
    /// Write the documentation page here and its pictures into the folder `effects` beside it.
    #[arg(long)]
    docs: Option<PathBuf>,
    #[command(flatten)]
    results: Results,
}

/// Writes the files asked for and lists the effects.
pub fn run(args: Args) -> Result<()> {
    let mut outputs = args.results.outputs([args.machine.as_path()]);
    let mut files = args.results.announce(&mut outputs)?;
    let mut page = args.docs.as_deref().map(|path| Page::announce(path, &mut outputs)).transpose()?;
    let drawn = page.is_some() || files.wants_report();
    let pictures = if drawn { pictures(&args.machine)? } else { Vec::new() };
    if let Some(page) = &mut page {
        page.write(&pictures)?;
    }
    let list: Vec<_> = REGISTRY.iter().map(|e| described(e)).collect();
    files.write(&list, || Ok(report(&pictures)))?;
    let rows: Vec<Vec<String>> = REGISTRY.iter().map(|e| vec![e.name.into(), keys(e), e.meaning.into()]).collect();
    show(&terminal::table(&["effect", "keys", "meaning"], &rows))
}

/// The documentation page and its pictures.
struct Page {
    text: OutputFile,
    pictures: Vec<OutputFile>,
}

impl Page {
    fn announce(path: &Path, outputs: &mut Outputs) -> Result<Self> {
        let text = outputs.file(path)?;
        let folder = path.parent().unwrap_or(Path::new("")).join("effects");
        std::fs::create_dir_all(&folder).map_err(Error::file(&folder))?;
        let picture = |entry: &&Entry| outputs.file(&folder.join(format!("{}.svg", entry.name)));
        Ok(Self { text, pictures: REGISTRY.iter().map(picture).collect::<Result<_>>()? })
    }

    fn write(&mut self, pictures: &[(&'static Entry, String)]) -> Result<()> {
        for (file, (_, svg)) in self.pictures.iter_mut().zip(pictures) {
            // On its own, outside a page, the picture needs the name of its language.
            let language = "<svg xmlns=\"http://www.w3.org/2000/svg\" ";
            file.write(svg.replacen("<svg ", language, usize::from(!svg.contains("xmlns="))))?;
        }
        self.text.write(markdown())
    }
}

fn report(pictures: &[(&'static Entry, String)]) -> Report {
    let report = Report::new("Effects", "What real gears add to the ideal model").figure("Effects", REGISTRY.len());
    pictures.iter().fold(report, |report, (entry, svg)| {
        report.section(entry.name).text(entry.meaning).picture(svg, entry.signature)
    })
}

fn pictures(machine: &Path) -> Result<Vec<(&'static Entry, String)>> {
    let rig = Rig::new(&Machine::read(machine)?, Model::BendingTorsional, Damping::Declared)?;
    let plain = example(&rig, None)?;
    let progress = terminal::Progress::new("effects", REGISTRY.len() as u64);
    REGISTRY
        .par_iter()
        .map(|entry| {
            let svg = picture(&rig, &plain, entry)?;
            progress.step();
            Ok((*entry, svg))
        })
        .collect()
}

fn keys(entry: &Entry) -> String {
    entry.parameters.iter().map(|p| p.name).collect::<Vec<_>>().join(" ")
}

fn described(entry: &Entry) -> serde_json::Value {
    let parameters: Vec<_> = entry
        .parameters
        .iter()
        .map(|p| {
            serde_json::json!({
                "name": p.name, "unit": p.unit, "default": p.default, "range": p.range, "meaning": p.meaning,
            })
        })
        .collect();
    serde_json::json!({
        "name": entry.name, "meaning": entry.meaning, "signature": entry.signature, "parameters": parameters,
    })
}
