//! The node's tabulated law against the host's, its transport and its refusals.

use meshband::config::Configuration;
use meshband::law::{Law, LawError, LawForm, LawKnot, LawTable, MAX_KNOTS};
use meshband::units::Hertz;
use meshband_host::law::table;

/// A bandwidth with a knee near 8 Hz and a dip, as the timed edges of a simulated pair give.
fn knots(count: usize) -> Vec<LawKnot> {
    (0..count)
        .map(|k| {
            let speed = 0.5 * 50f64.powf(k as f64 / (count - 1) as f64);
            let bandwidth =
                (9_000f64.powi(2) + (2_900.0 * speed).powi(2)).sqrt() * (1.0 + 0.15 * (2.1 * speed.ln()).sin());
            LawKnot { speed: Hertz(speed as f32), bandwidth: Hertz(bandwidth as f32) }
        })
        .collect()
}

fn law(knots: &[LawKnot]) -> Law {
    let table = LawTable::new(knots).expect("sound knots");
    Law { form: LawForm::Tabulated(table), lowest: Hertz(0.2), highest: Hertz(60.0), ..Law::PROVISIONAL }
}

#[test]
fn ref_the_table_agrees_with_the_host_to_single_precision() {
    let mut worst = 0.0f64;
    for count in [2, 3, 7, MAX_KNOTS] {
        let knots = knots(count);
        let exact: Vec<(f64, f64)> = knots.iter().map(|k| (f64::from(k.speed.0), f64::from(k.bandwidth.0))).collect();
        let law = law(&knots);
        assert_eq!(law.validate(), Ok(()));
        for step in 0..=4_000 {
            let speed = (0.2 * 300f64.powf(f64::from(step) / 4_000.0)) as f32;
            let expected = table::bandwidth_hz(&exact, f64::from(speed));
            worst = worst.max((f64::from(law.bandwidth(Hertz(speed)).bandwidth.0) / expected - 1.0).abs());
        }
    }
    println!("largest relative difference {worst:.1e}");
    assert!(worst < 1.0e-5, "{worst}");
}

#[test]
fn theory_the_table_passes_its_knots_and_continues_the_physics_outside() {
    let knots = knots(12);
    let law = law(&knots);
    for knot in &knots {
        assert!((law.bandwidth(knot.speed).bandwidth.0 / knot.bandwidth.0 - 1.0).abs() < 1.0e-6);
    }
    let (first, last) = (knots[0], knots[11]);
    assert_eq!(law.bandwidth(Hertz(0.3)).bandwidth, first.bandwidth);
    let beyond = law.bandwidth(Hertz(2.0 * last.speed.0)).bandwidth.0;
    assert!((beyond / (2.0 * last.bandwidth.0) - 1.0).abs() < 1.0e-6);
}

#[test]
fn theory_the_largest_table_travels_inside_a_configuration() {
    let config = Configuration { law: law(&knots(MAX_KNOTS)), ..Configuration::default() };
    assert_eq!(config.validate(meshband::board::Timing::STM32F405), Ok(()));
    let mut buffer = [0; Configuration::MAX_SERIALISED];
    let bytes = postcard::to_slice(&config, &mut buffer).expect("fits");
    assert_eq!(postcard::from_bytes::<Configuration>(bytes).expect("reads back"), config);
}

#[test]
fn fault_tables_that_are_no_function_are_refused() {
    let good = knots(4);
    assert_eq!(LawTable::new(&good[..1]), Err(LawError::Table));
    assert_eq!(LawTable::new(&knots(MAX_KNOTS + 1)), Err(LawError::Table));
    for spoil in [
        |knots: &mut [LawKnot]| knots.swap(1, 2),
        |knots: &mut [LawKnot]| knots[2].speed = knots[1].speed,
        |knots: &mut [LawKnot]| knots[0].bandwidth = Hertz(0.0),
        |knots: &mut [LawKnot]| knots[3].bandwidth = Hertz(f32::NAN),
    ] {
        let mut bad = good.clone();
        spoil(&mut bad);
        assert_eq!(LawTable::new(&bad), Err(LawError::Table), "{bad:?}");
        // What came over the link was not made by `new`.
        let received: heapless::Vec<LawKnot, MAX_KNOTS> = bad.iter().copied().collect();
        let form = LawForm::Tabulated(received.into());
        assert_eq!(Law { form, ..Law::PROVISIONAL }.validate(), Err(LawError::Table));
    }
}
