//! `cargo xtask pace`: with which sampling rates the emulated STM32F405 keeps up, by cycles per instruction, into
//! `target/pace.md`.

use crate::setup::{self, TARGET};
use crate::shell::{Outcome, capture, cargo, root, timed};

/// Beside the released images: this one accepts rates that they refuse.
const FOLDER: &str = "target/rate-sweep";

const HEAD: &str = "\
# Rates that the STM32F405 image keeps up with

Written by `cargo xtask pace`. The image of this commit, built to accept every rate that the converter follows, runs \
on the emulated chip; a
constant number of cycles is charged for each instruction (the core's manual gives 1 to 2.5 with wait states; \
`book/src/howto/first-hour.md` says how to
see the real load). Every run lasts 4 s and asks for waveforms four times a second beside mesh records, synchronous \
averages and timed
edges. A rate is kept up with where not one block is lost at any of the three speeds, and the next two rates below \
it hold, too. The second
table is of nodes that keep waveforms (`[capture]`), at two cycles per instruction: blocks that are lost are counted \
by the node and said. The third one, at two
cycles, is of one sensor and of two: of 27 block buffers two are being filled, the rest may wait for the main loop; \
what waited at most is the board's own count.

";

const TAIL: &str = "
The highest rate that a configuration may ask for (`Timing::STM32F405`) is 420 kHz: below what two cycles per \
instruction allow, and room for the
octave plan's overlap of 5 % above twice 200 kHz. Where waveforms lose blocks, a lower `limits.highest_adc` ends \
that. `emulator/tests/flashed/pace.rs` holds the released image to it. A stored
configuration that asks for more is lowered to it.
";

/// Takes no arguments.
pub fn run_task(args: &[String]) -> Outcome {
    if !args.is_empty() {
        return Err("pace takes no arguments".into());
    }
    setup::run()?;
    timed("the image and its run", || {
        let image = ["--package", "meshband-node", "--bin", "loader", "--bin", "stm32f405"];
        let features = ["--features", "board-stm32f405,rate-sweep"];
        let place = ["--target", TARGET, "--profile", "firmware", "--target-dir", FOLDER];
        crate::shell::run(cargo(&["build", "--quiet"]).args(image).args(features).args(place))?;
        let example = ["build", "--quiet", "--release", "--package", "meshband-emulator", "--example", "pace"];
        crate::shell::run(&mut cargo(&example))
    })?;
    let image = root().join(FOLDER).join(TARGET).join("firmware/stm32f405");
    let example = ["run", "--quiet", "--release", "--package", "meshband-emulator", "--example", "pace", "--"];
    let table = timed("the sweep", || capture(cargo(&example).arg(image)))?;
    let page = root().join("target/pace.md");
    print!("{table}");
    std::fs::write(&page, format!("{HEAD}{table}{TAIL}")).map_err(|error| format!("{}: {error}", page.display()))
}
