//! `meshband effects`: the library of effects, and the page of the documentation that shows them.

use clap::Args as ClapArgs;
use meshband_host::dynamics::Rig;
use meshband_host::dynamics::assembly::{Damping, Model};
use meshband_host::effects::catalogue::{example, markdown, picture};
use meshband_host::effects::{Entry, REGISTRY};
use meshband_host::machine::Machine;
use meshband_host::report::{Report, write_json};
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
    /// Write the library as JSON.
    #[arg(long)]
    json: Option<PathBuf>,
    /// Write a report with one picture per effect.
    #[arg(long)]
    report: Option<PathBuf>,
}

/// Lists the effects, and writes the files asked for.
pub fn run(args: Args) -> Result<()> {
    let rows: Vec<Vec<String>> = REGISTRY.iter().map(|e| vec![e.name.into(), keys(e), e.meaning.into()]).collect();
    print!("{}", terminal::table(&["effect", "keys", "meaning"], &rows));
    if let Some(path) = &args.json {
        let list: Vec<_> = REGISTRY.iter().map(|e| described(e)).collect();
        write_json(path, &list)?;
    }
    if args.docs.is_none() && args.report.is_none() {
        return Ok(());
    }
    let pictures = pictures(&args.machine)?;
    if let Some(path) = &args.docs {
        let folder = path.parent().unwrap_or(Path::new("")).join("effects");
        std::fs::create_dir_all(&folder).map_err(Error::file(&folder))?;
        std::fs::write(path, markdown()).map_err(Error::file(path))?;
        for (entry, svg) in &pictures {
            let file = folder.join(format!("{}.svg", entry.name));
            // On its own, outside a page, the picture needs the name of its language.
            let svg = svg.replacen(
                "<svg ",
                "<svg xmlns=\"http://www.w3.org/2000/svg\" ",
                usize::from(!svg.contains("xmlns=")),
            );
            std::fs::write(&file, svg).map_err(Error::file(&file))?;
        }
    }
    if let Some(path) = &args.report {
        let mut report =
            Report::new("Effects", "What real gears add to the ideal model").figure("Effects", REGISTRY.len());
        for (entry, svg) in &pictures {
            report = report.section(entry.name).text(entry.meaning).picture(svg, entry.signature);
        }
        report.write(path)?;
    }
    Ok(())
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
