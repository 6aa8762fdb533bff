//! The frame of a command-line program: arguments, interrupts, one line for an error, the exit code.

use crate::output::{CLOSED_EXIT_CODE, interrupt, show};
use crate::{Error, Result, remark};
use clap::Parser;
use std::process::ExitCode;

/// Parses the command line, runs it, and says how it ended: 0, 2 with one line on standard error, or the code of an
/// interrupt.
pub fn execute<Cli: Parser>(run: impl FnOnce(Cli) -> Result<()>) -> ExitCode {
    let result = interrupt::install().and_then(|()| match Cli::try_parse() {
        Ok(cli) => run(cli),
        Err(error) => usage(&error),
    });
    interrupt::wait_if_ending();
    match result {
        Err(error) if error.is_closed_output() => ExitCode::from(CLOSED_EXIT_CODE),
        Err(error) => {
            remark!("{}: {error}", Cli::command().get_name());
            ExitCode::from(2)
        }
        Ok(()) if interrupt::requested() => ExitCode::from(interrupt::EXIT_CODE),
        Ok(()) => ExitCode::SUCCESS,
    }
}

/// Help and version as they are; of a wrong command line the one line that says what is wrong.
fn usage(error: &clap::Error) -> Result<()> {
    let text = error.render().to_string();
    if !error.use_stderr() || error.kind() == clap::error::ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand {
        return show(&text);
    }
    let is_advice = |line: &&str| line.starts_with("Usage:") || line.starts_with("For more information");
    let parts: Vec<&str> =
        text.lines().map(str::trim).filter(|l| !l.is_empty()).take_while(|l| !is_advice(l)).collect();
    let what = parts.join(" ");
    let what = what.strip_prefix("error: ").unwrap_or(&what);
    Err(Error::invalid("command line", format!("{what}; --help lists the options")))
}
