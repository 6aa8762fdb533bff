//! Natural frequencies of a train machine with every mesh at its mean, as JSON: `cargo run --release -p
//! meshband-train-dynamics --example natural_frequencies -- MACHINE.toml`.
//!
//! Beside the frequencies stand what the script that compares them takes over: mean stiffness of each mesh, mass and
//! moment of inertia of each gear in the order of the train, moments of inertia of drive and load.

use meshband_train_dynamics::TrainMachine;
use meshband_train_dynamics::assembly::System;
use meshband_train_dynamics::modes::modes;
use std::path::Path;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("natural_frequencies takes one machine file")?;
    let machine = TrainMachine::read(Path::new(&path))?;
    let system = System::assemble(&machine)?;
    let frequencies: Vec<f64> = modes(&system).iter().map(|mode| mode.frequency_hz).collect();
    let meshes: Vec<f64> = system.meshes.iter().map(|mesh| system.stiffnesses[mesh.stiffness].mean_n_per_m()).collect();
    let masses: Vec<f64> = system.bodies.iter().map(|body| body.inertia.mass_kg).collect();
    let inertias: Vec<f64> = system.bodies.iter().map(|body| body.inertia.inertia_kg_m2).collect();
    let ends = [machine.drive.inertia_kg_m2, machine.load.inertia_kg_m2];
    // A list of numbers looks the same in Rust's debug form and in JSON.
    println!("{{\"frequencies_hz\": {frequencies:?},");
    println!(" \"mesh_stiffness_n_per_m\": {meshes:?},");
    println!(" \"mass_kg\": {masses:?},");
    println!(" \"inertia_kg_m2\": {inertias:?},");
    println!(" \"end_inertia_kg_m2\": {ends:?}}}");
    Ok(())
}
