//! Proof of signal-based inference: generated records of the kind that owners of machines have, each with one effect
//! that nobody declares, or none.
//!
//! 1. [`mod@bench`]: a machine, its operation and its measuring chain, drawn at random.
//! 2. [`hidden`]: the effects that are hidden, and which answers are right for each.
//! 3. [`make`]: the record, through the files of an acquisition system and `import`, at a strength in multiples of
//!    the record's own floor.
//! 4. [`score`]: found, named, wrong, added; held-out errors over the noise that was put in. [`campaign`]: all
//!    records of a plan, resumable. [`edges`]: the same records with sharp and with smooth tachometer edges.
//!
//! Nothing of the loop is known to the generator. Every record follows from the seed and its number alone.

pub mod bench;
pub mod campaign;
pub mod edges;
pub mod hidden;
pub mod make;
pub mod score;
