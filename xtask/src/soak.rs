//! `cargo xtask soak`: the node for a day of virtual time, into `target/soak.md`; `cargo xtask soak-image`: the
//! released image on the emulated chip for an hour, into `target/soak-image.md`. Arguments go to the program
//! (`--hours H`, `--seed S`).

use crate::shell::{Outcome, capture, cargo, programs, root, run, stamp, timed};
use crate::{node_build, setup};

/// Builds and runs the program `soak` of the tests.
pub fn run_task(args: &[String]) -> Outcome {
    let [program] = programs(["soak"])?;
    let page = timed("soak", || capture(std::process::Command::new(program).args(args)))?;
    write("target/soak.md", &page)
}

/// Builds the image and runs the emulator's example `soak`.
pub fn run_image(args: &[String]) -> Outcome {
    setup::run()?;
    node_build::build()?;
    let example = ["--quiet", "--release", "--package", "meshband-emulator", "--example", "soak"];
    timed("the program", || run(cargo(&["build"]).args(example)))?;
    let page = timed("soak of the image", || {
        capture(cargo(&["run"]).args(example).arg("--").arg(node_build::image("stm32f405")).args(args))
    })?;
    write("target/soak-image.md", &page)
}

fn write(name: &str, page: &str) -> Outcome {
    let (page, path) = (format!("{page}\nOf {}.\n", stamp()?), root().join(name));
    print!("{page}");
    std::fs::write(&path, page).map_err(|e| format!("{}: {e}", path.display()))
}
