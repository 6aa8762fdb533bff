//! Options that every writing command shares: where results go, and whether they may replace others.

use crate::Result;
use crate::output::{OutputFile, Outputs};
use clap::Args as ClapArgs;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Permission to replace.
#[derive(ClapArgs)]
pub struct Force {
    /// Replaces results that exist; never what the command reads, never a folder with other files in it.
    #[arg(long)]
    pub force: bool,
}

/// The two result files of a command.
#[derive(ClapArgs)]
pub struct Results {
    /// Writes the result as JSON; `-` is standard output.
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
    /// Writes a report: one self-contained HTML page.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
    #[command(flatten)]
    permission: Force,
}

impl Results {
    /// The command's outputs, with what it reads named; nothing is announced yet.
    pub fn outputs<'a>(&self, inputs: impl IntoIterator<Item = &'a Path>) -> Outputs {
        self.permission.outputs(inputs)
    }

    /// Announces the files asked for.
    pub fn announce(&self, outputs: &mut Outputs) -> Result<Announced> {
        let json = outputs.optional(self.json.as_deref())?;
        Ok(Announced { json, report: outputs.optional(self.report.as_deref())? })
    }
}

impl Force {
    /// As [`Results::outputs`].
    pub fn outputs<'a>(&self, inputs: impl IntoIterator<Item = &'a Path>) -> Outputs {
        let mut outputs = Outputs::new(self.force);
        inputs.into_iter().for_each(|path| outputs.reads(path));
        outputs
    }
}

/// Result files that may be written.
pub struct Announced {
    json: Option<OutputFile>,
    report: Option<OutputFile>,
}

impl Announced {
    /// Whether a report is wanted.
    pub fn wants_report(&self) -> bool {
        self.report.is_some()
    }

    /// Writes the files asked for: JSON first, which needs no pictures.
    pub fn write<P: Into<String>>(&mut self, value: &impl Serialize, report: impl FnOnce() -> Result<P>) -> Result<()> {
        if let Some(json) = &mut self.json {
            json.write_json(value)?;
        }
        match &mut self.report {
            Some(file) => file.write(report()?.into()),
            None => Ok(()),
        }
    }

    /// The same of a state that may still be replaced: what goes to a stream waits for the last one.
    pub fn write_early<P: Into<String>>(
        &mut self,
        value: &impl Serialize,
        report: impl FnOnce() -> Result<P>,
    ) -> Result<()> {
        if let Some(json) = self.json.as_mut().filter(|json| json.can_be_rewritten()) {
            json.write_json(value)?;
        }
        match self.report.as_mut().filter(|file| file.can_be_rewritten()) {
            Some(file) => file.write(report()?.into()),
            None => Ok(()),
        }
    }
}
