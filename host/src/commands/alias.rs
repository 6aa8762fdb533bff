//! `meshband alias`: folded mesh harmonics at a sampling rate.

use clap::Args as ClapArgs;
use meshband_host::{Error, Result};

/// Arguments of `meshband alias`.
#[derive(ClapArgs)]
pub struct Args {
    /// Mesh frequency, Hz.
    #[arg(long)]
    mesh: f64,
    /// Sampling rate, Hz.
    #[arg(long)]
    rate: f64,
    /// Highest harmonic listed.
    #[arg(long, default_value_t = 60)]
    harmonics: u32,
}

/// Prints every harmonic above the Nyquist frequency with the line it folds to.
pub fn run(args: Args) -> Result<()> {
    for (name, value) in [("--mesh", args.mesh), ("--rate", args.rate)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(Error::invalid(name, format!("{value} is not a positive frequency in Hz")));
        }
    }
    println!("harmonic  true Hz      appears at Hz");
    for harmonic in 1..=args.harmonics {
        let true_hz = args.mesh * f64::from(harmonic);
        if true_hz > 0.5 * args.rate {
            let folded = (true_hz - args.rate * (true_hz / args.rate).round()).abs();
            println!("{harmonic:8}  {true_hz:11.3}  {folded:11.3}");
        }
    }
    Ok(())
}
