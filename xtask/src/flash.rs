//! `cargo xtask flash`: the STM32F405's loader and image onto a connected board.
//!
//! One file from the first address on, so that one command makes a blank chip a node. The header of the upper slot is
//! made void: an image that came there over the link would be newer than the one that is flashed now. The
//! configuration's sectors are left alone.

use crate::node_build;
use crate::release;
use crate::setup;
use crate::shell::{Outcome, TemporaryFolder, command, on_path};

/// By debug probe, or with `--dfu` through the chip's USB boot loader.
pub fn run(args: &[String]) -> Outcome {
    let by_dfu = match args {
        [] => false,
        [option] if option == "--dfu" => true,
        other => return Err(format!("flash takes only --dfu, not `{}`", other.join(" "))),
    };
    setup::run()?;
    node_build::build()?;
    let flash = release::first_flash()?;
    let folder = TemporaryFolder::new("flash")?;
    let write = |name: &str, bytes: &[u8]| {
        let path = folder.0.join(name);
        std::fs::write(&path, bytes).map(|()| path.clone()).map_err(|e| format!("{}: {e}", path.display()))
    };
    if by_dfu {
        need("dfu-util", "it is a package of most distributions")?;
        let raw = write("node.bin", &flash)?;
        return run_tool(command(&["dfu-util", "-a", "0", "-s", "0x08000000:leave", "-D"]).arg(&raw));
    }
    need("probe-rs", "install it from probe.rs, or use `cargo xtask flash --dfu`")?;
    let hex = write("node.hex", release::intel_hex(&flash).as_bytes())?;
    let download = ["probe-rs", "download", "--chip", "STM32F405RGTx", "--binary-format", "hex", "--verify"];
    run_tool(command(&download).arg(&hex))?;
    run_tool(&mut command(&["probe-rs", "reset", "--chip", "STM32F405RGTx"]))
}

fn need(tool: &str, advice: &str) -> Outcome {
    on_path(tool).map(drop).ok_or_else(|| format!("{tool} is not installed: {advice}"))
}

fn run_tool(command: &mut std::process::Command) -> Outcome {
    crate::shell::run(command)
}
