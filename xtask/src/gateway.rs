//! `cargo xtask gateway` and `cargo xtask fleet-spark`: the gateway against a real broker, and verdicts by a real
//! engine.
//!
//! The gateway is a workspace of its own, so that neither demo nor tests build MQTT or Parquet. Broker, Python and
//! Java are asked for here and nowhere else.

use crate::shell::{Outcome, command, on_path, root, run, say, timed};
use std::path::{Path, PathBuf};
use std::process::Command;

const HELP: &str = "\
cargo xtask gateway [--full] [--faults] [--readers] [--year]
  Builds the gateway, checks it (rustfmt, clippy, unit tests, those of its Python part), then looks at the faults \
  and at the
  proof against mosquitto: virtual nodes, broker and gateway killed.
  --full    50 nodes for ten minutes, into docs/evidence/gateway-proof.json, then subscribers for two minutes behind \
  mosquitto's own
            limits, into gateway-subscribers.json; without it 8 nodes for 45 s and 20 s
  --faults  the faults alone
  --readers the same folders by Spark (with Java), DuckDB, polars, pyarrow and pandas, also while a gateway writes
  --year    a year of 100 nodes, rolled up and thinned day by day, into docs/evidence/gateway-year.json; 20 minutes";

/// Build, checks, faults, proof.
pub fn proof(args: &[String]) -> Outcome {
    let (mut full, mut faults, mut readers, mut year) = (false, false, false, false);
    for argument in args {
        match argument.as_str() {
            "--full" => full = true,
            "--faults" => faults = true,
            "--readers" => readers = true,
            "--year" => year = true,
            _ => return Err(HELP.into()),
        }
    }
    let program = build()?;
    let python = python(&["duckdb", "pandas<3", "polars", "pyarrow", "pytz", "pysparkplug==0.6.1"])?;
    if readers {
        return five_readers(&python, &program);
    }
    if year {
        return a_year(&python, &program);
    }
    if !faults {
        checks(&python)?;
    }
    if !has_broker() {
        say("mosquitto is not to be had here: faults and proof against a broker are SKIPPED");
        return Ok(());
    }
    let folder = root().join("gateway/proof");
    if !full {
        timed("faults", || {
            let mut tests = Command::new(&python);
            tests.args(["-m", "unittest", "-q", "faults"]).current_dir(&folder).env("MESHBAND_GATEWAY", &program);
            run(&mut tests)
        })?;
    }
    if faults {
        return Ok(());
    }
    timed("proof", || {
        let mut proof = Command::new(&python);
        proof.arg("prove.py").arg(&program).current_dir(&folder);
        if full {
            proof.arg("--json").arg(evidence()?.join("gateway-proof.json"));
        } else {
            proof.args(["--nodes", "8", "--seconds", "45", "--broker-kills", "2", "--gateway-kills", "2"]);
        }
        run(&mut proof)
    })?;
    timed("subscribers behind mosquitto's own limits", || {
        let mut subscribers = script(&python, &program, "subscribers.py");
        if full {
            subscribers.arg("--json").arg(evidence()?.join("gateway-subscribers.json"));
        } else {
            subscribers.args(["--nodes", "8", "--seconds", "20"]);
        }
        run(&mut subscribers)
    })
}

/// Programs of others on the folders of exports, history and rollups; Spark where Java is.
fn five_readers(python: &Path, program: &Path) -> Outcome {
    if on_path("java").is_some() {
        run(Command::new(python).args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "pyspark"]))?;
    } else {
        say("java is not installed (Debian: default-jre-headless): Spark is SKIPPED");
    }
    timed("one folder, many readers", || run(&mut script(python, program, "readers.py")))
}

/// Sizes, extremes and times of a year.
fn a_year(python: &Path, program: &Path) -> Outcome {
    let page = evidence()?.join("gateway-year.json");
    timed("a year of 100 nodes", || run(script(python, program, "year.py").arg("--json").arg(page)))
}

/// A script of the proof with the package beside it.
fn script(python: &Path, program: &Path, name: &str) -> Command {
    let mut script = Command::new(python);
    script.arg(name).arg(program).current_dir(root().join("gateway/proof"));
    script.env("PYTHONPATH", root().join("gateway/python"));
    script
}

fn evidence() -> Outcome<PathBuf> {
    let folder = root().join("docs/evidence");
    std::fs::create_dir_all(&folder).map_err(|reason| format!("{}: {reason}", folder.display()))?;
    Ok(folder)
}

/// What needs neither broker nor nodes.
fn checks(python: &Path) -> Outcome {
    timed("form and clippy of the gateway", || {
        run(cargo_there().args(["fmt", "--check"]))?;
        run(cargo_there().args(["clippy", "--quiet", "--release", "--all-targets", "--", "-D", "warnings"]))
    })?;
    timed("unit tests of the gateway", || run(cargo_there().args(["test", "--quiet", "--release"])))?;
    timed("unit tests of its Python part", || {
        let folder = root().join("gateway/python");
        run(Command::new(python).args(["-m", "unittest", "discover", "-q", "tests"]).current_dir(folder))
    })
}

/// PySpark in local mode over generated records, against the command row by row.
pub fn spark(args: &[String]) -> Outcome {
    let records = match args {
        [] => "200",
        [option, count] if option == "--records" => count,
        _ => return Err("cargo xtask fleet-spark [--records N]".into()),
    };
    if on_path("java").is_none() {
        return Err("java is not installed (Debian: default-jre-headless)".into());
    }
    run(&mut crate::shell::cargo(&["build", "--quiet", "--release", "--bin", "meshband"]))?;
    let python = python(&["duckdb", "pyarrow", "pytz", "pandas<3", "pyspark"])?;
    let page = evidence()?;
    let mut job = Command::new(python);
    job.arg(root().join("gateway/proof/spark_proof.py"))
        .arg(root().join("target/release/meshband"))
        .args(["--records", records, "--json"])
        .arg(page.join("spark-proof.json"))
        .env("PYTHONPATH", root().join("gateway/python"));
    timed("verdicts by the command, by a pool and by Spark", || run(&mut job))
}

fn build() -> Outcome<PathBuf> {
    timed("build of the gateway", || run(cargo_there().args(["build", "--quiet", "--release"])))?;
    Ok(root().join("gateway/target/release/meshband-gateway"))
}

fn cargo_there() -> Command {
    let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    cargo.current_dir(root().join("gateway"));
    cargo
}

/// Whether mosquitto is there, or can be installed.
fn has_broker() -> bool {
    let there = || on_path("mosquitto").is_some() || Path::new("/usr/sbin/mosquitto").is_file();
    if !there() && on_path("apt-get").is_some() {
        say("mosquitto is missing: apt-get install mosquitto");
        let installed = run(&mut command(&["apt-get", "install", "-y", "-qq", "--no-install-recommends", "mosquitto"]));
        if let Err(reason) = installed {
            say(reason);
        }
    }
    there()
}

/// A Python environment of the gateway's own with these packages.
fn python(packages: &[&str]) -> Outcome<PathBuf> {
    let folder = root().join("gateway/target/python");
    let python = folder.join("bin/python");
    if !python.is_file() {
        run(command(&["python3", "-m", "venv"]).arg(&folder))?;
    }
    timed("Python packages of the proof", || {
        run(Command::new(&python)
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"])
            .args(packages))
    })?;
    Ok(python)
}
