//! What an image writes against the postcard crate, byte for byte.

use meshband::config::Configuration;
use meshband::frame::PacketRef;
use meshband::link::compact;
use meshband::message::{Message, Reply, Request};
use proptest::prelude::*;
use serde::Serialize;

/// Every form that serde knows and postcard writes.
#[derive(Debug, Clone, Serialize)]
struct Forms {
    truth: bool,
    small: (i8, u8),
    numbers: (i16, u16, i32, u32, i64, u64),
    fractions: (f32, f64),
    letter: char,
    text: String,
    perhaps: Option<Box<Forms>>,
    nothing: (),
    wrapped: Wrapped,
    list: Vec<Choice>,
    map: std::collections::BTreeMap<u16, i32>,
    fixed: [i16; 3],
}

#[derive(Debug, Clone, Copy, Serialize)]
struct Wrapped(u32);

#[derive(Debug, Clone, Copy, Serialize)]
struct Empty;

#[derive(Debug, Clone, Serialize)]
enum Choice {
    Unit,
    One(u16),
    Two(i32, Empty),
    Named { first: u8, second: Option<i64> },
}

fn choice() -> impl Strategy<Value = Choice> {
    prop_oneof![
        Just(Choice::Unit),
        any::<u16>().prop_map(Choice::One),
        any::<i32>().prop_map(|value| Choice::Two(value, Empty)),
        any::<(u8, Option<i64>)>().prop_map(|(first, second)| Choice::Named { first, second }),
    ]
}

fn forms(inner: Option<Box<Forms>>) -> impl Strategy<Value = Forms> {
    let plain = (any::<(bool, i8, u8)>(), any::<(i16, u16, i32, u32, i64, u64)>(), any::<(f32, f64, char, String)>());
    let compound = (
        any::<u32>(),
        prop::collection::vec(choice(), 0..200),
        prop::collection::btree_map(any::<u16>(), any::<i32>(), 0..4),
        any::<[i16; 3]>(),
    );
    (plain, compound).prop_map(move |((first, numbers, (short, long, letter, text)), (word, list, map, fixed))| Forms {
        truth: first.0,
        small: (first.1, first.2),
        numbers,
        fractions: (short, long),
        letter,
        text,
        perhaps: inner.clone(),
        nothing: (),
        wrapped: Wrapped(word),
        list,
        map,
        fixed,
    })
}

/// The same bytes, and `None` in a room that is a byte too small.
fn compare(value: &impl Serialize) {
    let mut expected = vec![0; 1 << 16];
    let length = postcard::to_slice(value, &mut expected).expect("postcard writes it").len();
    expected.truncate(length);
    let mut room = vec![0xa5; expected.len() + 3];
    assert_eq!(compact::write(value, &mut room), Some(expected.len()));
    assert_eq!(room[..expected.len()], expected);
    assert_eq!(room[expected.len()..], [0xa5; 3], "nothing behind the end");
    if let Some(less) = expected.len().checked_sub(1) {
        assert_eq!(compact::write(value, &mut room[..less]), None);
    }
}

proptest! {
    #[test]
    fn ref_every_form_is_written_as_the_postcard_crate_writes_it(
        outer in forms(None).prop_flat_map(|inner| forms(Some(Box::new(inner))))
    ) {
        compare(&outer);
    }
}

#[test]
fn ref_what_goes_over_the_link_is_written_as_the_postcard_crate_writes_it() {
    let config = Configuration::default();
    compare(&config);
    for request in [
        Request::Identify,
        Request::SetConfiguration(config.clone()),
        Request::ReadCapture { number: 300, offset: 70_000 },
    ] {
        compare(&PacketRef::Request(&request));
    }
    for reply in [Reply::Done, Reply::Law(config.law), Reply::Configuration(config), Reply::Capture(Default::default())]
    {
        compare(&PacketRef::Reply(&reply));
    }
    compare(&PacketRef::Message(&Message::Statistics(Default::default())));
}
