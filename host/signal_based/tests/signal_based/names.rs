//! What each family is called, and when it is not.

use meshband_host::signal_based::accept::{Surrogates, Verdict};
use meshband_host::signal_based::candidate::{Candidate, Domain, Kind, Place, Score, Shaft};
use meshband_host::signal_based::families::bearing::{Bearing, Part};
use meshband_host::signal_based::holdout_test::{HoldoutResult, passes};
use meshband_host::signal_based::naming::{Naming, name, without_gears};
use meshband_host::signal_based::scene::Scene;
use meshband_host::signal_based::search::{Adopted, Slip};

/// A pair of 20 and 50 teeth without a run: names ask for nothing else.
fn scene() -> Scene {
    Scene {
        title: "pair".into(),
        unit: "m/s2".into(),
        teeth: [20, 50],
        gear_order: 0.4,
        gearing: None,
        channels: Vec::new(),
        searched: 0,
        runs: Vec::new(),
        highest_order: 100.0,
        notes: Vec::new(),
    }
}

/// A family whose places stand where their evidence is above zero.
fn family(kind: Kind, base: f64, places: &[(f64, f64)]) -> Adopted {
    let place = |(order, _): &(f64, f64)| Place { order: *order, spacing: 1.0, label: String::new() };
    Adopted {
        candidate: Candidate {
            kind,
            base,
            domain: Domain::Orders,
            places: places.iter().map(place).collect(),
            locked: true,
            alternatives: 1.0,
        },
        verdict: Verdict {
            score: Score { ln_bayes: 399.0, of_places: places.iter().map(|p| p.1).collect(), ..Score::default() },
            ln_bayes: 399.0,
            surrogates: Surrogates::of(vec![0.0; 48], 399.0),
            refused: None,
            is_close: false,
        },
        pulse: None,
        carries: Vec::new(),
        either_hz: None,
        slip: Slip::default(),
        or_else: Vec::new(),
    }
}

fn of(kind: Kind, base: f64) -> Naming {
    name(&family(kind, base, &[]), None, &[], &scene())
}

fn assert_called(naming: &Naming, verdict: &str, words: &str, family: &str, shaft: &str) {
    assert_eq!((naming.verdict, naming.name.as_str(), naming.family, naming.shaft), (verdict, words, family, shaft));
}

#[test]
fn golden_families_of_a_shaft_carry_its_name_and_every_name_with_the_same_lines() {
    for shaft in Shaft::PAIR_SHAFTS {
        let word = shaft.word();
        let cases = [
            (Kind::Modulation(shaft), format!("{word}-eccentricity or {word}-pitch-error"), "sideband"),
            (
                Kind::ShaftOrders(shaft),
                format!("{word}-imbalance or coupling-misalignment or {word}-eccentricity"),
                "shaft-order",
            ),
            (Kind::SingleTooth(shaft), format!("{word}-tooth-crack or {word}-pitch-error"), "impulsive"),
            (Kind::Pattern(shaft), format!("{word}-pitch-error or {word}-profile-error"), "shaft-order"),
        ];
        for (kind, words, family) in cases {
            let naming = of(kind, 1.0);
            assert_called(&naming, "ambiguous", &words, family, word);
            assert!(naming.remark.is_some(), "{words}");
        }
    }
    assert_called(
        &of(Kind::Swing, 1.0),
        "ambiguous",
        "load-fluctuation or speed-fluctuation",
        "non-stationary",
        "none",
    );
    assert_called(&of(Kind::Alias, 1.0), "named", "aliasing", "mesh-order", "pinion");
    assert_called(&of(Kind::Clipping, 1.0), "named", "clipping", "other", "none");
    assert_called(&of(Kind::FixedFrequency, 777.0), "named", "fixed-tone", "fixed-frequency", "none");
    for hz in [50.0, 99.9, 150.1, 60.1, 300.0] {
        assert_called(&of(Kind::FixedFrequency, hz), "named", "mains-hum", "fixed-frequency", "none");
    }
}

#[test]
fn golden_multiples_of_one_number_of_teeth_may_be_another_stage() {
    let pattern = |shaft, places: &[(f64, f64)]| {
        name(&family(Kind::Pattern(shaft), 1.0, places), None, &[], &scene()).name.contains("another stage")
    };
    assert!(pattern(Shaft::Pinion, &[(17.0, 9.0), (34.0, 3.0), (51.0, 1.0), (52.0, -1.0)]));
    assert!(pattern(Shaft::Pinion, &[(10.0, 9.0), (20.0, 3.0)]), "ten teeth are a gear");
    assert!(!pattern(Shaft::Pinion, &[(9.0, 9.0), (18.0, 3.0)]), "nine are none");
    assert!(!pattern(Shaft::Pinion, &[(17.0, 9.0), (34.0, 0.0)]), "one line is no pattern");
    assert!(!pattern(Shaft::Pinion, &[(17.0, 9.0), (35.0, 3.0)]));
    // Orders of the gear count in its own turns: 17 and 34 of them.
    assert!(pattern(Shaft::Gear, &[(6.8, 9.0), (13.6, 3.0)]));
}

#[test]
fn golden_a_ghost_is_named_where_it_is_strong_and_the_only_one_of_its_shaft() {
    let ghost = |base: f64, ln_bayes: f64, ghosts: &[f64]| {
        let mut own = family(Kind::Ghost, base, &[(base, ln_bayes)]);
        own.verdict.score.ln_bayes = ln_bayes;
        name(&own, None, ghosts, &scene())
    };
    assert_called(&ghost(37.0, 400.0, &[37.0]), "named", "pinion-ghost-order", "shaft-order", "pinion");
    assert_called(&ghost(14.8, 400.0, &[14.8]), "named", "gear-ghost-order", "shaft-order", "gear");
    let weak = ghost(37.0, 399.0, &[37.0]);
    assert_called(&weak, "ambiguous", "pinion-ghost-order or pinion-pitch-error", "shaft-order", "pinion");
    let stage = "pinion-ghost-order or mesh of another stage on the pinion's shaft";
    for other in [74.0, 111.0, 148.0, 55.5, 37.0 * 4.0 / 3.0, 18.5] {
        assert_called(&ghost(37.0, 500.0, &[37.0, other]), "ambiguous", stage, "shaft-order", "pinion");
    }
    for other in [38.0, 185.0] {
        let two = ghost(37.0, 500.0, &[37.0, other]);
        assert_called(&two, "ambiguous", "pinion-ghost-order or pinion-pitch-error", "shaft-order", "pinion");
    }
    assert_eq!(ghost(37.0, 500.0, &[37.0, 74.1]).verdict, "named", "the other is the gear's");
}

#[test]
fn golden_lines_of_neither_shaft_are_an_order_and_no_bearing() {
    let standing = [(1.0, 2.0), (2.0, 2.0), (3.0, 2.0)];
    let called = |kind, base| name(&family(kind, base, &standing), None, &[], &scene());
    for kind in [Kind::Passage, Kind::ModulatedPassage(Shaft::Pinion), Kind::ModulatedPassage(Shaft::Gear)] {
        let own = called(kind, 3.583);
        assert_called(&own, "generic", "unexplained order 3.5830", "non-integer-order", "none");
        assert!(own.remark.is_some_and(|r| r.starts_with("one base fits")));
    }
    // Below every passage of both shafts, and above.
    for base in [0.9, 51.0] {
        let none = called(Kind::Passage, base);
        assert_called(&none, "generic", &format!("unexplained order {base:.4}"), "non-integer-order", "none");
        assert!(none.remark.is_some_and(|r| r.starts_with("no ordinary bearing")));
        assert_eq!(called(Kind::AboutMesh, base).verdict, "generic");
    }
    let words = "bearing-stiffness-modulation or unexplained order 3.5830";
    assert_called(&called(Kind::AboutMesh, 3.583), "ambiguous", words, "non-integer-order", "none");
}

#[test]
fn golden_a_rig_without_gears_has_no_words_of_gears() {
    for text in ["pinion-imbalance or coupling-misalignment", "2 mesh - 1 pinion", "one bearing on the pinion's shaft"]
    {
        let own = without_gears(text);
        assert!(!["pinion", "mesh", "gear"].iter().any(|word| own.contains(word)), "{own}");
    }
}

#[test]
fn fault_a_ghost_at_a_whole_order_of_both_shafts_is_neither_shafts_alone() {
    // Order 18 of the pinion is order 45 of the gear.
    let mut own = family(Kind::Ghost, 18.0, &[(18.0, 427.0)]);
    own.verdict.score.ln_bayes = 427.0;
    let both = "pinion-ghost-order or gear-ghost-order";
    assert_called(&name(&own, None, &[18.0], &scene()), "ambiguous", both, "shaft-order", "none");
    own.verdict.score.ln_bayes = 100.0;
    let weak = format!("{both} or pinion-pitch-error or gear-pitch-error");
    assert_called(&name(&own, None, &[18.0], &scene()), "ambiguous", &weak, "shaft-order", "none");
}

/// What the held-out turns say of an order of neither shaft that was predicted too loud for them.
#[test]
fn theory_an_order_of_a_run_up_that_stands_again_by_itself_is_not_vetoed_and_one_that_does_not_is() {
    let mut own = family(Kind::Passage, 2.389, &[(2.389, 2.0), (4.778, 2.0)]);
    own.candidate.locked = false;
    let worth = HoldoutResult { ln_bayes: -30.0, runs_up: true, ..HoldoutResult::default() };
    assert!(!passes(&own, &worth));
    assert!(passes(&own, &HoldoutResult { passes_independently: true, ..worth }));
}

#[test]
fn theory_a_locked_family_that_a_moved_copy_came_close_to_must_lower_the_error_besides() {
    let gains = HoldoutResult { gain: 1e-3, ln_bayes: 90.0, robust_ln_ratio: 90.0, ..HoldoutResult::default() };
    let loses = HoldoutResult { gain: -1e-3, passes_independently: true, ..gains };
    let mut own = family(Kind::Modulation(Shaft::Gear), 0.4, &[(20.4, 90.0)]);
    assert!(passes(&own, &gains) && passes(&own, &loses));
    own.verdict.is_close = true;
    assert!(passes(&own, &gains) && !passes(&own, &loses));
}

#[test]
fn golden_a_part_of_a_bearing_that_is_read_is_named() {
    let bearing = Bearing { shaft: Shaft::Gear, elements: 9, ratio: 0.2, parts: Vec::new(), worst: 0.0, others: 0 };
    let own = family(Kind::Passage, 3.6, &[]);
    let naming = name(&own, Some((&bearing, Part::Inner)), &[], &scene());
    let words = format!("bearing of the gear's shaft: {}", Part::Inner.word());
    assert_called(&naming, "named", &words, "non-integer-order", "gear");
}
