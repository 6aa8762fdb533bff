//! Gears of a train that one record cannot tell apart are named together, and no others.

use meshband_host::analysis::search::Level;
use meshband_host::signal_based::candidate::{Candidate, Field, Kind, Taken, TakenOf, score};
use meshband_host::signal_based::families::{Context, train};
use meshband_host::signal_based::gearing::Gearing;
use meshband_host::signal_based::scene::Scene;
use meshband_host::signal_based::spectra::Spectra;
use meshband_host::spectral::Spectrum;
use meshband_host::train::families::What;
use meshband_host::train::{Declaration, Train};

/// Turns of the input in the record, and the highest order held.
const TURNS: f64 = 1000.0;
const HIGHEST_ORDER: f64 = 110.0;
/// Power of a line over the floor.
const LINE_POWER: f64 = 40.0;

fn scene(stages: &str) -> Scene {
    let train = Train::of(Declaration::parse(stages, "train").expect("a declaration")).expect("a train");
    Scene {
        title: "train".into(),
        unit: "m/s2".into(),
        teeth: Gearing::leading_teeth(&train),
        gear_order: 0.05,
        gearing: Some(Gearing::of(&train, HIGHEST_ORDER, 0.05)),
        channels: Vec::new(),
        searched: 1,
        runs: Vec::new(),
        highest_order: HIGHEST_ORDER,
        notes: Vec::new(),
    }
}

/// One channel of half the floor everywhere but at the lines.
fn spectra(lines: &[f64]) -> Spectra {
    let mut values = vec![0.5; (HIGHEST_ORDER * TURNS) as usize + 8];
    lines.iter().for_each(|order| values[(order * TURNS).round() as usize] = LINE_POWER);
    let floor = vec![1.0; values.len()];
    let density = Spectrum { values, bin: 1.0 / TURNS };
    let level = Level { density, averages: 1, floor, floor_error: 0.0 };
    Spectra { levels: vec![vec![vec![level]]], lowest: 0.02, highest: HIGHEST_ORDER }
}

/// Seats named beside the strongest family of a kind at a seat, in a record of these lines.
fn named_beside(stages: &str, lines: &[f64], seat: &str, what: What) -> Vec<String> {
    let (scene, spectra) = (scene(stages), spectra(lines));
    let taken = TakenOf::default();
    let context = Context {
        scene: &scene,
        orders: &spectra,
        frequency: &spectra,
        folded: &spectra,
        strength: &spectra,
        taken: &taken,
        feet: &[],
    };
    let none = Taken::default();
    let field = Field { spectra: &spectra, taken: &none, channels: 0..1 };
    let gearing = scene.gearing.as_ref().expect("a train");
    let is_it = |candidate: &Candidate| {
        let Kind::Train(own) = candidate.kind else { return false };
        gearing.seat_words(own) == seat && gearing.family(own).what == what
    };
    let scored = |candidate: Candidate| (score(&candidate, &field, 0.0), candidate);
    let of_kind = train::candidates(&context).into_iter().filter(is_it).map(scored);
    let (score, found) = of_kind.max_by(|a, b| a.0.ln_bayes.total_cmp(&b.0.ln_bayes)).expect("a family");
    let rivals = train::rivals(&found, &score.of_places, &context, &field);
    rivals.into_iter().map(|other| gearing.seat_words(other)).collect()
}

fn pairs(teeth: &[[u32; 2]]) -> String {
    teeth.iter().map(|[a, b]| format!("[[stage]]\nkind = \"pair\"\nteeth = [{a}, {b}]\n")).collect()
}

#[test]
fn regress_sun_and_planet_with_rates_in_a_small_whole_ratio_are_named_together() {
    let set = "[[stage]]\nkind = \"planetary\"\nsun = 33\nplanet = 22\nring = 77\nplanets = 5\nfixed = \
        \"ring\"\ninput = \"sun\"\n";
    // Of a planet's tooth: multiples of 1.05, twice per turn against its carrier, beside them the carrier's 0.3.
    let lines = [4.2, 4.5, 6.0, 6.3, 16.8];
    assert_eq!(named_beside(set, &lines, "sun of stage 1", What::Local), ["planet of stage 1"]);
    // A runout of the sun, once per turn at 0.7 about every mesh harmonic: no ratio.
    let lines: Vec<f64> = (1..=4).flat_map(|k| [-0.7, 0.7].map(|side| f64::from(k) * 23.1 + side)).collect();
    assert_eq!(named_beside(set, &lines, "sun of stage 1", What::Modulation), [""; 0]);
}

#[test]
fn regress_a_bad_tooth_heard_about_the_mesh_of_its_neighbour_is_named_beside_it() {
    let three = pairs(&[[25, 81], [23, 58], [19, 33]]);
    let rate = 25.0 / 81.0;
    // Orders of the shaft about the first and the third mesh of stage 2, which its pinion alone does not explain.
    let lines: Vec<f64> = [19, 20, 21, 22, 24, 25, 26, 27, 67, 70, 71].map(|n| f64::from(n) * rate).to_vec();
    let beside = named_beside(&three, &lines, "pinion of stage 2", What::Modulation);
    assert_eq!(beside, ["gear of stage 1"]);
}

#[test]
fn claim_a_runout_that_stands_about_every_harmonic_of_its_mesh_is_named_alone() {
    let three = pairs(&[[25, 81], [23, 58], [19, 33]]);
    let (mesh, rate) = (23.0 * 25.0 / 81.0, 25.0 / 81.0);
    let lines: Vec<f64> = (1..=10).flat_map(|k| [-rate, rate].map(|side| f64::from(k) * mesh + side)).collect();
    assert_eq!(named_beside(&three, &lines, "pinion of stage 2", What::Modulation), [""; 0]);
}
