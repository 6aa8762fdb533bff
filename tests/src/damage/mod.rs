//! A scripted campaign of attacks on the real command `meshband`: damaged records, machines, imports and arguments,
//! interrupts, full disks, closed outputs, several writers at once.
//!
//! Every attack is made from the campaign's seed, its family and its number in the family, so that one attack can be
//! made again alone (`cargo xtask damage --seed S --only FAMILY:NUMBER`); only the instants of signals and the turns of
//! concurrent writers are the operating system's. Each attack has a folder of its own, limits of memory and time, and
//! is judged by [`oracle`] from what was in that folder before and after, from the exit codes and from what was said.
//!
//! Limits: Unix only (limits are set through `sh`); no attack needs a network, a board or QEMU.

pub mod attack;
pub mod byte_damage;
pub mod campaign;
mod families;
pub mod oracle;
pub mod originals;
pub mod process;
pub mod report;
pub mod snapshot;
pub mod special;
pub mod toml_damage;

pub use campaign::{Campaign, run};
pub use families::{CAMPAIGN_ATTACKS, FAMILIES};
