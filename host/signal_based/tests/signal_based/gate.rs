//! The gate and its evidence against the formulas that they state, worked out here once more; each reason for a
//! refusal alone.

use meshband_host::analysis::search::Level;
use meshband_host::signal_based::accept::{self, COPIES, FALSE_ALARM, FAMILIES, LEAST_CHANCE, Surrogates, Verdict};
use meshband_host::signal_based::candidate::{Candidate, Domain, Field, Kind, Place, Taken};
use meshband_host::signal_based::evidence::{Reading, Shares, ln_sum, of_family};
use meshband_host::signal_based::plausibility::says_too_little;
use meshband_host::signal_based::spectra::Spectra;
use meshband_host::spectral::Spectrum;

/// Signal-to-noise ratios of the prior: 13 from 0.3, half a decade each.
fn ratios() -> impl Iterator<Item = f64> {
    (0..13).map(|i| 0.3 * 10.0_f64.powf(0.5 * f64::from(i)))
}

/// Likelihood of a mean of `k` spectra at one ratio over that of none.
fn likelihood(y: f64, k: f64, s: f64) -> f64 {
    (k * y * s / (1.0 + s)).exp() / (1.0 + s).powf(k)
}

fn bayes(y: f64, k: f64) -> f64 {
    ratios().map(|s| likelihood(y, k, s)).sum::<f64>() / 13.0
}

fn line_share(y: f64, k: f64) -> f64 {
    let of = |s: f64| likelihood(y, k, s) * k * s / (1.0 + k * s);
    ratios().map(of).sum::<f64>() / ratios().map(|s| likelihood(y, k, s)).sum::<f64>()
}

/// Halved shares of places, 1 to 1/64.
fn halved() -> impl Iterator<Item = f64> {
    (0..7).map(|i| 0.5_f64.powi(i))
}

fn product(places: &[f64], q: f64) -> f64 {
    places.iter().map(|b| 1.0 - q + q * b).product()
}

fn assert_near(ours: f64, reference: f64, what: &str) {
    assert!((ours - reference).abs() <= 1e-10 * reference.abs().max(1.0), "{what}: {ours} for {reference}");
}

#[test]
fn ref_evidence_is_the_sum_over_its_prior() {
    for (y, k) in [(0.2, 1.0), (1.0, 3.0), (6.0, 1.0), (2.5, 8.0), (30.0, 2.0)] {
        let reading = Reading { ratio: y, averages: k };
        assert_near(reading.ln_bayes(), bayes(y, k).ln(), "a line");
        assert_near(reading.line_share(), line_share(y, k), "share of the line");
    }
    let places = [0.02, 40.0, 0.5, 3.0, 0.1];
    let ln: Vec<f64> = places.iter().map(|b: &f64| b.ln()).collect();
    let all: f64 = halved().map(|q| product(&places, q)).sum();
    assert_near(of_family(&ln), (all / 7.0).ln(), "a family");
    assert_near(of_family(&[]), 0.0, "a family without places");
    assert_near(ln_sum([1.0_f64, 2.0, 3.5].map(f64::ln).into_iter()), 6.5_f64.ln(), "a sum");
    assert_eq!(ln_sum([f64::NEG_INFINITY; 3].into_iter()), f64::NEG_INFINITY);
    assert_near(ln_sum([-2000.0, -2000.0].into_iter()), 2.0_f64.ln() - 2000.0, "a sum far below");
}

#[test]
fn ref_trust_is_the_chance_of_a_line_times_its_share_of_the_estimate() {
    let readings = [0.4, 9.0, 1.1, 14.0, 0.6, 2.0].map(|ratio| Reading { ratio, averages: 2.0 });
    let places = readings.map(|r| bayes(r.ratio, r.averages));
    let shares = Shares::of(&readings.map(Reading::ln_bayes));
    let all: f64 = halved().map(|q| product(&places, q)).sum();
    for (reading, own) in readings.into_iter().zip(places) {
        let chance: f64 = halved().map(|q| product(&places, q) / all * q * own / (1.0 - q + q * own)).sum();
        assert_near(shares.trust(reading), chance * line_share(reading.ratio, reading.averages), "trust");
    }
}

#[test]
fn ref_moved_copies_say_their_median_their_slope_and_their_tail() {
    let mut scores: Vec<f64> = (0..47).map(|i| f64::from((i * 20) % 47)).collect();
    scores.push(f64::NEG_INFINITY);
    let own = Surrogates::of(scores.clone(), 100.0);
    // 0 to 46: the upper half begins with the median, 23.
    let slope = (0..24).map(f64::from).sum::<f64>() / 24.0;
    assert_eq!((own.copies, own.as_high, own.highest, own.median, own.slope), (47, 0, 46.0, 23.0, slope));
    assert_near(own.false_alarm, FAMILIES * 0.5 * (-77.0 / slope).exp(), "tail");
    let needed = 23.0 + slope * (0.5 * FAMILIES / FALSE_ALARM).ln();
    assert_near(own.needed(), needed.max(3.0 * 46.0), "needed");
    assert_near(Surrogates { highest: 1.0, ..own.clone() }.needed(), needed, "needed of the tail");
    assert_near(accept::needed(&own, 1.0), own.needed(), "needed with one alternative");
    assert_near(accept::needed(&own, 1e90), 5.0 + 90.0 * 10.0_f64.ln(), "needed with many");
    let within = Surrogates::of(scores, 44.0);
    assert_eq!((within.as_high, within.false_alarm), (3, 1.0), "44, 45 and 46: a probability");
    let beside = Surrogates::of([vec![0.0; 1000], vec![400.0; 2]].concat(), 300.0);
    assert_near(beside.false_alarm, FAMILIES * 2.0 / 1002.0, "counted");
    let alike = Surrogates::of(vec![2.0; 48], 3.0);
    assert_eq!((alike.slope, alike.median), (1.0, 2.0));
    assert_eq!(Surrogates::of(vec![0.0; 48], 1e6).false_alarm, LEAST_CHANCE);
    let none = Surrogates::of(vec![f64::NAN], 3.0);
    assert_eq!((none.copies, none.highest, none.median), (0, f64::NEG_INFINITY, 0.0));
}

#[test]
fn ref_copies_are_moved_both_ways_from_one_to_six_per_cent() {
    let moved: Vec<f64> = accept::displacements().collect();
    assert_eq!(moved.len(), COPIES);
    for (i, share) in moved.iter().enumerate() {
        let away = 0.01 + 0.05 * (i / 2) as f64 / 23.0;
        assert_near(*share, if i % 2 == 0 { away } else { -away }, "displacement");
    }
}

/// Order, power over floor.
type Lines<'a> = &'a [(f64, f64)];

const BIN: f64 = 0.01;
const AVERAGES: usize = 4;

/// One channel up to `highest`, everywhere at `level` times its floor except at the lines.
fn spectra(lines: Lines, level: f64, highest: f64) -> Spectra {
    let mut values = vec![level; 5000];
    lines.iter().for_each(|(order, ratio)| values[(order / BIN).round() as usize] = *ratio);
    let density = Spectrum { bin: BIN, values };
    let level = Level { density, averages: AVERAGES, floor: vec![1.0; 5000], floor_error: 0.0 };
    Spectra { levels: vec![vec![vec![level]]], lowest: 0.1, highest }
}

fn family(orders: &[f64], alternatives: f64) -> Candidate {
    let place = |&order: &f64| Place { order, spacing: 1.0, label: "one".into() };
    Candidate {
        kind: Kind::ShaftOrders(meshband_host::signal_based::candidate::Shaft::Pinion),
        base: 1.0,
        domain: Domain::Orders,
        places: orders.iter().map(place).collect(),
        locked: true,
        alternatives,
    }
}

fn judged(spectra: &Spectra, candidate: &Candidate) -> Verdict {
    let taken = Taken::default();
    accept::judge(candidate, &Field { spectra, taken: &taken, channels: 0..1 })
}

fn at(ratio: f64) -> f64 {
    Reading { ratio, averages: AVERAGES as f64 }.ln_bayes()
}

#[test]
fn claim_lines_that_stand_alone_pass_and_pay_for_the_alternatives() {
    let orders = [1.0, 2.0, 3.0];
    let verdict = judged(&spectra(&orders.map(|o| (o, 60.0)), 1.0, 45.0), &family(&orders, 1000.0));
    assert_eq!(verdict.refused, None);
    let own = of_family(&[at(60.0); 3]);
    assert_near(verdict.score.ln_bayes, own, "score");
    assert_near(verdict.ln_bayes, own - 1000.0_f64.ln(), "after the choice");
    assert_near(verdict.surrogates.highest, of_family(&[at(1.0); 3]), "copies");
    assert_eq!(verdict.surrogates.copies, COPIES);
    let single = judged(&spectra(&orders.map(|o| (o, 60.0)), 1.0, 45.0), &family(&orders, 0.0));
    assert_near(single.ln_bayes, own, "less than one alternative is one");
}

#[test]
fn claim_an_order_of_neither_shaft_is_compared_farther_away_where_the_nearest_places_are_taken() {
    // Where copies stand that are moved by 1 to 6 % of the spacing everything is taken.
    let mut taken = Taken::default();
    taken.extend((6..15).flat_map(|d| [-d, d].map(|d| 20.0 + f64::from(d) * BIN)));
    let spectra = spectra(&[(20.0, 60.0)], 1.0, 45.0);
    let field = Field { spectra: &spectra, taken: &taken, channels: 0..1 };
    let kind = |kind: Kind| accept::judge(&Candidate { kind, ..family(&[20.0], 1.0) }, &field);
    let passage = kind(Kind::Passage);
    assert_eq!((passage.surrogates.copies, &passage.refused), (COPIES, &None));
    refusal(kind(family(&[20.0], 1.0).kind), "surrogates find a place");
}

fn refusal(verdict: Verdict, part: &str) {
    let refused = verdict.refused.unwrap_or_else(|| panic!("passed, not: {part}"));
    assert!(refused.contains(part), "{refused} lacks {part}");
}

#[test]
fn fault_each_reason_for_a_refusal_is_said() {
    let lone = [20.0];
    refusal(judged(&spectra(&[], 1.0, 45.0), &family(&lone, 7.0)), "nats of 5 after 7 alternatives");
    let strong = spectra(&[(20.0, 60.0)], 1.0, 45.0);
    refusal(judged(&strong, &family(&lone, 1e300)), "evidence -");
    // Copies beyond the highest order find no place.
    refusal(judged(&spectra(&[(20.0, 60.0)], 1.0, 20.0), &family(&lone, 1.0)), "only 24 surrogates");
    refusal(judged(&spectra(&[], 60.0, 45.0), &family(&lone, 1.0)), "48 of 48 surrogates are as strong");
    refusal(judged(&spectra(&[(20.0, 60.0)], 30.0, 45.0), &family(&lone, 1.0)), "are not 3 times the best surrogate's");
}

#[test]
fn fault_a_tail_of_copies_that_comes_near_is_a_refusal_although_none_is_as_strong() {
    // The six nearest copies on either side stand at a third of it or less: few, but they make the tail long.
    let copies: Vec<(f64, f64)> = (7..=9).flat_map(|d| [-d, d].map(|d| (20.0 + f64::from(d) * BIN, 8.0))).collect();
    let third = of_family(&[at(8.0)]);
    let mut own = 8.0;
    while of_family(&[at(own)]) < 3.05 * third {
        own += 0.01;
    }
    let lines = [copies, vec![(20.0, own)]].concat();
    let verdict = judged(&spectra(&lines, 0.4, 45.0), &family(&[20.0], 1.0));
    assert!(verdict.surrogates.false_alarm > FALSE_ALARM && verdict.surrogates.as_high == 0, "{verdict:?}");
    assert!(verdict.is_close, "the held-out turns may still let it pass");
    refusal(verdict, "surrogates come near it: false-alarm rate");
}

#[test]
fn theory_close_is_only_what_stands_out_of_every_copy_and_not_thrice() {
    let close = |lines: Lines, level: f64, highest: f64, alternatives: f64| {
        judged(&spectra(lines, level, highest), &family(&[20.0], alternatives)).is_close
    };
    let line: Lines = &[(20.0, 60.0)];
    assert!(close(line, 30.0, 45.0, 1.0), "twice the copies");
    assert!(!close(line, 1.0, 45.0, 1.0), "it passes");
    assert!(!close(line, 30.0, 45.0, 1e300), "no evidence");
    assert!(!close(line, 30.0, 20.0, 1.0), "too few copies");
    assert!(!close(&[], 60.0, 45.0, 1.0), "copies are as strong");
}

#[test]
fn theory_what_is_close_passes_by_other_turns_and_nothing_else_does() {
    let there = |ratio: f64| judged(&spectra(&[(20.0, ratio)], 1.0, 45.0), &family(&[20.0], 1.0));
    let close = judged(&spectra(&[(20.0, 60.0)], 30.0, 45.0), &family(&[20.0], 1.0));
    let of = |mut verdict: Verdict, alone: &Verdict| {
        verdict.passed_by(alone);
        verdict
    };
    let passed = of(close.clone(), &there(60.0));
    assert_eq!(passed.refused, None);
    let both = close.surrogates.false_alarm * there(60.0).surrogates.false_alarm;
    assert_near(passed.surrogates.false_alarm, both.max(LEAST_CHANCE), "chance of both");
    assert!(of(close.clone(), &there(1.0)).refused.is_some(), "nothing there");
    let copies_as_high = judged(&spectra(&[], 60.0, 45.0), &family(&[20.0], 1.0));
    assert!(of(copies_as_high, &there(60.0)).refused.is_some(), "not the highest");
}

/// Power over the floor of one line that says enough for a family, not alone.
const WEAK_LINE_RATIO: f64 = 6.0;

#[test]
fn theory_one_line_alone_is_asked_for_more_than_a_family_and_a_supply_is_not() {
    let lone = |kind: Kind, base: f64, ratio: f64| {
        let mut candidate = family(&[20.0], 1.0);
        (candidate.kind, candidate.base) = (kind, base);
        candidate.places[0].spacing = 20.0;
        let verdict = judged(&spectra(&[(20.0, ratio)], 1.0, 45.0), &candidate);
        assert_eq!(verdict.refused, None);
        says_too_little(&candidate, &verdict).is_some()
    };
    assert!((8.0..18.0).contains(&at(WEAK_LINE_RATIO)) && at(60.0) > 25.0, "{} {}", at(WEAK_LINE_RATIO), at(60.0));
    assert!(lone(Kind::FixedFrequency, 20.0, WEAK_LINE_RATIO) && !lone(Kind::FixedFrequency, 20.0, 60.0));
    assert!(lone(Kind::Passage, 20.0, WEAK_LINE_RATIO) && !lone(Kind::Passage, 20.0, 60.0));
    assert!(!lone(Kind::FixedFrequency, 50.0, WEAK_LINE_RATIO), "a supply's");
    assert!(!lone(Kind::Ghost, 20.0, WEAK_LINE_RATIO), "a whole order");
}

#[test]
fn theory_one_line_alone_agrees_where_it_is_faint_and_the_highest_of_its_copies() {
    let agrees = |ratio: f64, level: f64| {
        let spectra = spectra(&[(20.0, ratio)], level, 45.0);
        let taken = Taken::default();
        let field = Field { spectra: &spectra, taken: &taken, channels: 0..1 };
        accept::agrees_alone(&family(&[20.0], 70.0), &field).refused.is_none()
    };
    let nats = |ratio: f64| of_family(&[at(ratio)]);
    let mut faint = 1.0;
    while nats(faint) < 1.1 {
        faint += 0.01;
    }
    assert!(agrees(faint, 0.2), "{} nats", nats(faint));
    assert!(!agrees(faint - 0.2, 0.2), "{} nats", nats(faint - 0.2));
    assert!(!agrees(faint, faint + 0.1), "copies as high");
}
