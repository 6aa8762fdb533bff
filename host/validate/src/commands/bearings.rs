//! `meshband-validate bearings`: labelled records, measured or generated, undeclared and declared, beside a textbook
//! peer.

use clap::Args as ClapArgs;
use meshband_host::output::show;
use meshband_host::results::Force;
use meshband_host::terminal::Progress;
use meshband_host::{Error, Result};
use meshband_validate::bearings::{Damage, Labelled, Score, generated, look, measured, peer};
use rayon::prelude::*;
use std::path::PathBuf;

/// Arguments of `meshband-validate bearings`.
#[derive(ClapArgs)]
pub struct Args {
    /// Folder that holds `cwru/` and `paderborn/`.
    #[arg(long, required_unless_present = "generated")]
    data: Option<PathBuf>,
    /// Generates so many records of each damage, and as many sound ones, instead.
    #[arg(long, conflicts_with = "data")]
    generated: Option<usize>,
    /// Strength of generated damage, multiples of the floor.
    #[arg(long, default_value_t = 4.0)]
    level: f64,
    /// Seed of generated records.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Leaves the bearing undeclared only.
    #[arg(long)]
    undeclared: bool,
    /// Writes the page here instead of printing it.
    #[arg(short, long)]
    output: Option<PathBuf>,
    #[command(flatten)]
    permission: Force,
}

/// A record's name, label and scores: undeclared, declared, peer.
type Row = (String, Damage, Vec<Score>);

/// Looks at every record and prints the table.
pub fn run(args: Args) -> Result<()> {
    if !(args.level.is_finite() && args.level > 0.0) {
        return Err(Error::invalid("--level", format!("{} is no positive number", args.level)));
    }
    let output = args.permission.outputs(args.data.as_deref()).optional(args.output.as_deref())?;
    let row = |own: &Labelled| -> Result<Row> {
        let mut scores = vec![look(own, false)?];
        if !args.undeclared {
            scores.extend([look(own, true)?, peer::look(own)?]);
        }
        Ok((own.name.clone(), own.damage, scores))
    };
    let rows: Vec<Row> = match (&args.data, args.generated) {
        (Some(data), _) => {
            let all = measured::all(data)?;
            let progress = Progress::new("records", all.len() as u64);
            all.par_iter().map(|own| row(own).inspect(|_| progress.step())).collect::<Result<_>>()?
        }
        (None, count) => {
            let kinds = [Damage::Sound, Damage::Outer, Damage::Inner, Damage::Element];
            let all: Vec<(Damage, usize)> =
                kinds.into_iter().flat_map(|kind| (0..count.unwrap_or(1)).map(move |i| (kind, i))).collect();
            let progress = Progress::new("records", all.len() as u64);
            let folder = std::env::temp_dir();
            let of = |&(damage, i): &(Damage, usize)| {
                let seed = args.seed.wrapping_mul(1_000_003).wrapping_add((4 * i + damage as usize) as u64);
                let scored = row(&generated::record(damage, args.level, seed, &folder)?);
                progress.step();
                scored
            };
            all.par_iter().map(of).collect::<Result<_>>()?
        }
    };
    let page = page(&rows);
    match output {
        Some(mut file) => file.write(page),
        None => show(&page),
    }
}

fn page(rows: &[Row]) -> String {
    let columns = ["undeclared", "declared", "textbook peer"];
    let count = rows.first().map_or(0, |row| row.2.len());
    let mut out = format!("| record | damage | {} |\n|{}\n", columns[..count].join(" | "), " --- |".repeat(count + 2));
    for (name, damage, scores) in rows {
        let cells: Vec<String> = scores.iter().map(cell).collect();
        out += &format!("| {name} | {} | {} |\n", damage.word().unwrap_or("none"), cells.join(" | "));
    }
    out += "\n";
    for (i, column) in columns[..count].iter().enumerate() {
        let of = |is: fn(&Score) -> bool| rows.iter().filter(|row| is(&row.2[i])).count();
        let damaged = rows.iter().filter(|row| row.1 != Damage::Sound).count();
        let sound = rows.iter().filter(|row| row.1 == Damage::Sound && row.2[i].wrong).count();
        out += &format!(
            "{column}: of {damaged} damaged found {}, part right {}; wrong names {} of {}, {sound} of them on the {} \
             sound ones\n",
            of(|s| s.right),
            of(|s| s.ring),
            of(|s| s.wrong),
            rows.len(),
            rows.len() - damaged
        );
    }
    out
}

fn cell(score: &Score) -> String {
    let marks = [(score.right, "found"), (score.ring, "part right"), (score.wrong, "WRONG")];
    let marks: Vec<&str> = marks.into_iter().filter(|(is, _)| *is).map(|(_, word)| word).collect();
    let said = if score.said.is_empty() { "nothing" } else { &score.said };
    format!("{}: {said}", if marks.is_empty() { "-".into() } else { marks.join(", ") })
}
