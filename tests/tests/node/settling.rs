//! From the first pulse to complete products: a node measures only once its filters have settled.

use meshband::node::State;
use meshband_tests::plant::{Fault, Plant, configuration};

#[test]
fn claim_a_node_that_is_locked_settles_before_it_measures() {
    let mut plant = Plant::new(configuration(), 3);
    let mut states = vec![plant.session.node().state()];
    let mut blocks = vec![0];
    // A block at a time, until it has measured for a while.
    while states.last() != Some(&State::Measuring) || blocks.last() != Some(&20) {
        plant.run(1e-6, |_| 10.0, Fault::None);
        let state = plant.session.node().state();
        if states.last() != Some(&state) {
            states.push(state);
            blocks.push(0);
        }
        *blocks.last_mut().expect("never empty") += 1;
        assert!(blocks.iter().sum::<u32>() < 20_000, "measures at last: {states:?}");
    }
    assert_eq!(states, [State::WaitingForTach, State::Settling, State::Measuring]);
}
