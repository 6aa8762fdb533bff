//! `cargo xtask flash`: the STM32F405 image onto a connected board.

use crate::node_build;
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
    let image = node_build::image("stm32f405");
    if by_dfu {
        for tool in ["dfu-util", "rust-objcopy"] {
            need(
                tool,
                "dfu-util is a package of most distributions, rust-objcopy comes with `cargo install cargo-binutils`",
            )?;
        }
        let folder = TemporaryFolder::new("dfu")?;
        let raw = folder.0.join("node.bin");
        run_tool(command(&["rust-objcopy", "-O", "binary"]).arg(&image).arg(&raw))?;
        return run_tool(command(&["dfu-util", "-a", "0", "-s", "0x08000000:leave", "-D"]).arg(&raw));
    }
    need("probe-rs", "install it from probe.rs, or use `cargo xtask flash --dfu`")?;
    run_tool(command(&["probe-rs", "download", "--chip", "STM32F405RGTx", "--verify"]).arg(&image))?;
    run_tool(&mut command(&["probe-rs", "reset", "--chip", "STM32F405RGTx"]))
}

fn need(tool: &str, advice: &str) -> Outcome {
    on_path(tool).map(drop).ok_or_else(|| format!("{tool} is not installed: {advice}"))
}

fn run_tool(command: &mut std::process::Command) -> Outcome {
    crate::shell::run(command)
}
