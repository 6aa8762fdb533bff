//! Families of attacks: each is one function that prepares one attack from its number and random stream.

mod arguments;
mod imports;
mod interrupts;
mod machines;
mod outputs;
mod overwrites;
mod records;

use super::attack::{Attack, Scene};

/// A family of attacks.
pub struct Family {
    /// Name in tables and in `--only`.
    pub name: &'static str,
    /// What is attacked, for the summary.
    pub meaning: &'static str,
    /// Its share of a campaign, in attacks of [`CAMPAIGN_ATTACKS`].
    pub share: usize,
    /// Prepares an attack; `None` where this machine lacks what it needs.
    pub prepare: fn(&mut Scene) -> Option<Attack>,
}

/// Attacks of a whole campaign.
pub const CAMPAIGN_ATTACKS: usize = 6600;

/// Every family.
pub const FAMILIES: &[Family] = &[
    Family {
        name: "record-keys",
        meaning: "every key of `record.toml` removed, of another size, sign or type",
        share: 2200,
        prepare: records::keys,
    },
    Family {
        name: "record-files",
        meaning: "signals, tach edges and stiffness tables damaged, truncated, oversized",
        share: 700,
        prepare: records::files,
    },
    Family {
        name: "record-paths",
        meaning: "paths out of the record, links, fifos, devices in place of its files",
        share: 200,
        prepare: records::paths,
    },
    Family {
        name: "machine-keys",
        meaning: "every key of a machine and of an effects file damaged",
        share: 1500,
        prepare: machines::keys,
    },
    Family {
        name: "imports",
        meaning: "csv, gz, wav, npy, mat and uff58 files mutated; bombs; special files",
        share: 800,
        prepare: imports::files,
    },
    Family {
        name: "arguments",
        meaning: "values, combinations and bytes of the command line",
        share: 500,
        prepare: arguments::fuzzed,
    },
    Family {
        name: "overwrites",
        meaning: "outputs over inputs, over each other and over what exists, with and without `--force`",
        share: 200,
        prepare: overwrites::over,
    },
    Family {
        name: "interrupts",
        meaning: "SIGINT, SIGTERM and SIGKILL at random times",
        share: 200,
        prepare: interrupts::signals,
    },
    Family {
        name: "writers",
        meaning: "two commands that write one target at once",
        share: 60,
        prepare: interrupts::writers,
    },
    Family {
        name: "file-limit",
        meaning: "writing fails beyond a random file size",
        share: 100,
        prepare: interrupts::file_limit,
    },
    Family {
        name: "small-disk",
        meaning: "a file system that fills at a random size",
        share: 60,
        prepare: interrupts::small_disk,
    },
    Family {
        name: "outputs",
        meaning: "standard output and error closed, full, or left by their reader",
        share: 80,
        prepare: outputs::sinks,
    },
];

/// A family by its name.
pub fn named(name: &str) -> Option<&'static Family> {
    FAMILIES.iter().find(|family| family.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn theory_the_shares_make_a_whole_campaign() {
        assert_eq!(FAMILIES.iter().map(|family| family.share).sum::<usize>(), CAMPAIGN_ATTACKS);
    }
}
