//! The register of quality over Modbus: one bit for each reason not to believe the values, and the discrete input
//! that sums them up.

use meshband::config::Configuration;
use meshband::message::{Indicators, Message, Quality, Tag};
use meshband::modbus::bank::Bank;
use meshband::modbus::map::{REGISTERS, Traffic, View, bits, read};
use meshband::node::Node;
use meshband::tach::Validity;
use meshband::units::TicksPerSecond;

#[test]
fn theory_every_reason_for_bad_values_has_its_bit_and_only_a_missing_speed_leaves_them_good() {
    let node = Box::new(Node::new(Configuration::default(), TicksPerSecond(84_000_000)).expect("sound"));
    let address = REGISTERS.iter().find(|register| register.name == "quality").expect("in the table").address;
    let good = 1 << 28;
    let says = |quality: Quality, validity: Validity| {
        let tag = Tag { validity, ..Tag::default() };
        let mut bank = Bank::default();
        bank.take(&Message::Indicators(Indicators { tag, quality, ..Indicators::default() }), 0);
        let view = View::of(&*node, &bank, Traffic::default());
        let mut words = Vec::new();
        read(address, 1, &view, &mut |word| words.push(word)).expect("a register");
        (words, bits(&view) & good != 0)
    };
    let none = Quality::default();
    assert_eq!(says(none, Validity::Locked), (vec![0], true));
    assert_eq!(says(none, Validity::None), (vec![16], true));
    assert_eq!(says(Quality { overload: true, ..none }, Validity::Locked), (vec![1], false));
    assert_eq!(says(Quality { gap: true, ..none }, Validity::Locked), (vec![2], false));
    assert_eq!(says(Quality { settling: true, ..none }, Validity::Locked), (vec![4], false));
    assert_eq!(says(Quality { stuck: true, ..none }, Validity::None), (vec![24], false));
}
