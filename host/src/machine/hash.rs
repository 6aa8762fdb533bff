//! A stable fingerprint of a declaration, carried by every bandwidth law fitted to it.
//!
//! FNV-1a (64 bit) over the canonical content: the checked machine written back as JSON with every
//! default filled in, in declaration order. Comments, key order and number formatting of the source file
//! do not change it; any value does. The title is left out: renaming a machine does not void its law.

use super::Machine;

impl Machine {
    /// Fingerprint of everything that influences the machine's response.
    ///
    /// A stiffness table counts by its content, not its name; an unreadable one counts as empty.
    pub fn hash(&self) -> u64 {
        let mut canonical = self.clone();
        canonical.title.clear();
        let mut hash = fnv1a(0xcbf2_9ce4_8422_2325, &serde_json::to_vec(&canonical).expect("plain data"));
        for table in [&self.pair.pair_stiffness, &self.pair.total_stiffness].into_iter().flatten() {
            hash = fnv1a(hash, &crate::budget::read(&self.folder.join(table)).unwrap_or_default());
        }
        hash
    }
}

fn fnv1a(start: u64, bytes: &[u8]) -> u64 {
    bytes.iter().fold(start, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0000_0100_0000_01b3))
}
