//! One program for all targets: `MESHBAND_FUZZ_TARGET` names the one that runs, so that the host is linked once;
//! `list` prints them.
//!
//! The target's sound inputs are written into the folder `MESHBAND_FUZZ_SEEDS` first. Every second mutation is the
//! target's own damage (checksums made right again, keys of a document), the others are libFuzzer's.

#![no_main]

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};
use meshband_tests::fuzz::{TARGETS, Target, target};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use std::path::Path;
use std::sync::OnceLock;

fn chosen() -> &'static Target {
    static CHOSEN: OnceLock<&Target> = OnceLock::new();
    CHOSEN.get_or_init(|| {
        let name = std::env::var("MESHBAND_FUZZ_TARGET").expect("MESHBAND_FUZZ_TARGET names a target");
        target(&name).unwrap_or_else(|| panic!("no target is called {name}"))
    })
}

fuzz_target!(
    init: {
        if std::env::var_os("MESHBAND_FUZZ_TARGET").is_some_and(|name| name == "list") {
            TARGETS.iter().for_each(|target| println!("{}\t{}", target.name, target.reads));
            std::process::exit(0);
        }
        if let Some(folder) = std::env::var_os("MESHBAND_FUZZ_SEEDS") {
            for (number, seed) in (chosen().seeds)().iter().enumerate() {
                std::fs::write(Path::new(&folder).join(format!("seed-{number}")), seed).expect("a folder for sound \
                    inputs");
            }
        }
    },
    |bytes: &[u8]| {
        let _ = (chosen().run)(bytes);
    }
);

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    if seed % 2 == 0 {
        return fuzzer_mutate(data, size, max_size);
    }
    let mut bytes = data[..size].to_vec();
    (chosen().change)(&mut bytes, &mut ChaCha8Rng::seed_from_u64(u64::from(seed)));
    let length = bytes.len().min(max_size);
    data[..length].copy_from_slice(&bytes[..length]);
    length
});
