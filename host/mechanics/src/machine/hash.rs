//! A stable fingerprint of a declaration, carried by every bandwidth law fitted to it.
//!
//! FNV-1a (64 bit) over the canonical content: the checked machine written back as JSON with every
//! default filled in, in declaration order. Comments, key order and number formatting of the source file
//! do not change it; any value does that differs in its first nine digits (a default that is computed may differ in
//! the last ones from version to version). The title is left out: renaming a machine does not void its law.

use super::Machine;
use serde::Serialize;
use serde_json::Serializer;
use serde_json::ser::Formatter;
use std::io::Write;

impl Machine {
    /// Fingerprint of everything that influences the machine's response.
    ///
    /// A stiffness table counts by its content, not its name; an unreadable one counts as empty.
    pub fn hash(&self) -> u64 {
        let mut canonical = self.clone();
        canonical.title.clear();
        let mut content = Vec::new();
        canonical.serialize(&mut Serializer::with_formatter(&mut content, NineDigits)).expect("plain data");
        let mut hash = fnv1a(0xcbf2_9ce4_8422_2325, &content);
        for table in [&self.pair.pair_stiffness, &self.pair.total_stiffness].into_iter().flatten() {
            hash = fnv1a(hash, &crate::budget::read(&self.folder.join(table)).unwrap_or_default());
        }
        hash
    }
}

/// JSON with nine digits of every number that has a fraction.
struct NineDigits;

impl Formatter for NineDigits {
    fn write_f64<W: ?Sized + Write>(&mut self, writer: &mut W, value: f64) -> std::io::Result<()> {
        write!(writer, "{value:.8e}")
    }
}

fn fnv1a(start: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(start, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    #[test]
    fn claim_rounding_of_a_computed_default_is_no_other_machine_but_a_changed_value_is() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../machines/paper-rig.toml");
        let machine = Machine::read(&path).expect("a sound machine");
        let with_mass = |factor: f64| {
            let mut other = machine.clone();
            other.shafts.mass_kg[0] *= factor;
            other.hash()
        };
        assert_eq!(machine.hash(), with_mass(1.0 + 1e-14));
        assert_ne!(machine.hash(), with_mass(1.0 + 1e-6));
    }
}
