//! The bandwidth watch where a shaft hardly turns.

use meshband::bandwidth_watch::BandwidthWatch;

#[test]
fn regress_a_tooth_pitch_without_end_is_not_over_at_once() {
    let mut watch = BandwidthWatch::default();
    // A shaft at rest: the pitch is infinite in samples.
    watch.begin(50_000.0, 2_000.0, 0.0, 1.0);
    assert!(!watch.push(&[0.0; 64]), "the measurement ends although no tooth has passed");
    assert_eq!(watch.result(), None);
}
