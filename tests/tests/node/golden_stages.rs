//! The same bits on every target: committed hashes of every stage of the signal chain.

use meshband_kit::golden::{EXPECTED_HASHES, hashes, self_test};

#[test]
fn golden_every_stage_gives_the_committed_bits() {
    let found = hashes();
    for stage in &found {
        println!("    StageHash {{ stage: \"{}\", hash: {:#010x} }},", stage.stage, stage.hash);
    }
    assert_eq!(found, EXPECTED_HASHES);
    assert_eq!(self_test(), Ok(()));
}

#[test]
fn golden_hashes_are_of_real_work() {
    let found = hashes();
    for (i, stage) in found.iter().enumerate() {
        // 0 marks a refused stage, the offset basis an empty one.
        assert!(stage.hash != 0 && stage.hash != 0x811c_9dc5, "{}", stage.stage);
        assert!(found[..i].iter().all(|other| other.hash != stage.hash), "{}", stage.stage);
    }
}
