//! `meshband modbus`: the register map as a table to import, and an example in bytes.

use clap::Args as ClapArgs;
use meshband_host::link::limit::Limit;
use meshband_host::link::modbus::{Row, example, groups, rows};
use meshband_host::link::settings::Settings;
use meshband_host::link::{Client, modbus};
use meshband_host::output::show;
use meshband_host::results::Force;
use meshband_host::terminal::table;
use meshband_host::virtual_node::stations::ADDRESS;
use meshband_host::{Error, Result, say};
use std::path::PathBuf;

/// Value of the example, m/s2.
const EXAMPLE_M_S2: f32 = 32.157;
/// Register of the example.
const SHOWN_NAME: &str = "rms";

/// Arguments of `meshband modbus`.
#[derive(ClapArgs)]
pub struct Args {
    /// A node whose alarms name the alarm bits: serial port, pseudo-terminal or tcp:HOST:PORT.
    port: Option<String>,
    /// Settings file whose alarms name the alarm bits, without a node.
    #[arg(long, conflicts_with = "port")]
    settings: Option<PathBuf>,
    /// Writes the map here: comma-separated, one row per value, addresses from 0.
    #[arg(short, long, value_name = "FILE.csv")]
    output: Option<PathBuf>,
    /// Station address of the example.
    #[arg(long, default_value_t = ADDRESS, value_parser = clap::value_parser!(u8).range(1..=247))]
    address: u8,
    #[command(flatten)]
    permission: Force,
}

/// Writes the map, and says how a PLC reads it.
pub fn run(args: Args) -> Result<()> {
    let mut file = args.permission.outputs(args.settings.as_deref()).optional(args.output.as_deref())?;
    let rows = rows(alarms(&args)?.as_deref());
    if let Some(file) = &mut file {
        file.write(csv_of(&rows)?)?;
    }
    say!(
        "one request per line; addresses from 0, high word first, float32 is IEEE 754, what does not exist is not a \
         number\n"
    )?;
    let line = |(function, group, first, count): (u8, String, u16, u16)| {
        vec![function.to_string(), first.to_string(), count.to_string(), group]
    };
    let lines: Vec<Vec<String>> = groups(&rows).into_iter().map(line).collect();
    show(&table(&["function", "first address", "count", "group"], &lines))?;
    let Some(row) = rows.iter().find(|row| row.name == SHOWN_NAME) else { return Ok(()) };
    let [request, answer] = example(args.address, row, EXAMPLE_M_S2).map(|bytes| hex(&bytes));
    say!(
        "\n{} of station {} on the serial line\nrequest {request}\nanswer  {answer}   = {EXAMPLE_M_S2} {}",
        row.name,
        args.address,
        row.unit
    )?;
    say!("over TCP the same without the last two bytes, the checksum, behind a header of 6 bytes")
}

fn alarms(args: &Args) -> Result<Option<Vec<Limit>>> {
    if let Some(path) = &args.settings {
        let mut config = meshband::config::Configuration::default();
        Settings::read(path)?.apply(&mut config)?;
        return Ok(Some(Limit::all(&config)));
    }
    let Some(port) = &args.port else { return Ok(None) };
    Ok(Some(Limit::all(&Client::open(port)?.configuration()?)))
}

fn csv_of(rows: &[modbus::Row]) -> Result<String> {
    let failed = |error: &dyn std::fmt::Display| Error::impossible("csv", error.to_string());
    let mut writer = csv::Writer::from_writer(Vec::new());
    let head = ["function", "address", "count", "type", "name", "unit", "group", "meaning"];
    writer.write_record(head).map_err(|error| failed(&error))?;
    for Row { function, address, count, kind, name, unit, group, meaning } in rows {
        let numbers = [u16::from(*function), *address, *count].map(|number| number.to_string());
        let words = [*kind, name, unit, group, meaning].map(str::to_owned);
        writer.write_record(numbers.iter().chain(&words)).map_err(|error| failed(&error))?;
    }
    let bytes = writer.into_inner().map_err(|error| failed(&error))?;
    String::from_utf8(bytes).map_err(|error| failed(&error))
}

fn hex(bytes: &[u8]) -> String {
    let words: Vec<String> = bytes.iter().map(|byte| format!("{byte:02X}")).collect();
    words.join(" ")
}
