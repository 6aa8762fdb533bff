//! Writes the bill of materials (CycloneDX 1.5, JSON) to standard output: `cargo xtask supply-chain` runs it.

use meshband_tests::supply;

fn main() -> Result<(), String> {
    let bill = supply::bill_of_materials(&supply::metadata()?, &supply::checksums()?)?;
    println!("{bill:#}");
    Ok(())
}
