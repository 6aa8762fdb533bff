//! x
use meshband_host::law::derive::*;
use meshband_host::law::operating::*;
use meshband_host::law::{estimator::*, paper, sampling::*, study::*};
use meshband_host::machine::*;
use std::time::Instant;
fn main() {
    let m0 = Machine::read(std::path::Path::new(&std::env::args().nth(1).unwrap())).unwrap();
    let t = Instant::now();
    let c = calibrate(&m0).unwrap();
    println!("{:?} {c:?}", t.elapsed());
    let m =
        with_engagement(&m0, Engagement { width_rad: Some(c.width_rad), ..engagement(EngagementKind::Paper) }).unwrap();
    let show = |s: &Sweep| {
        println!("{} spread {:.4}", s.name, s.spread());
        for r in &s.rows {
            println!(
                "  {} exit {:?} entry {:?} alone {:?} occ {}",
                r.label, r.exit_hz, r.entry_hz, r.alone_hz, r.occupied_hz
            );
        }
    };
    show(&module_sweep(&m, 14.5).unwrap());
    show(&teeth_sweep(&m, 14.5).unwrap());
    let b = Bench::new(&m).unwrap();
    show(&speed_sweep(&m, &b).unwrap());
    show(&torque_sweep(&m, 14.5).unwrap());
    println!("{:?}", t.elapsed());
    for c in crack_study(&m, 14.5).unwrap() {
        println!("{c:#?}");
    }
    println!("{:?}", t.elapsed());
    let p = b.healthy(14.5, 12.0).unwrap();
    let c = convergence(&p).unwrap();
    println!("{:?}", t.elapsed());
    for r in &c.sampled {
        println!("  n {:.2} {:?} {:?}", r.samples_per_edge, r.error, r.scatter);
    }
    for r in &c.cut_off {
        println!("  k {:.2} {:?}", r.multiple, r.error);
    }
    println!("{} {} {}", c.samples_needed, c.cut_off_multiple, c.waveform_multiple);
    let law = derive(&m, &b, &|| ()).unwrap();
    for s in sampling_study(&m, &|f| law.fits[3].law.bandwidth_hz(f)).unwrap() {
        println!("{} {:?}", s.mesh_hz, s.unknown);
        for r in &s.rates {
            println!(
                " {} crit {:.2} folded {:?} scatter {:.3} findable {} {:?}",
                r.rate_hz,
                r.critical_share,
                r.strongest_folded_db,
                r.peak_scatter,
                r.sidebands_findable,
                r.sideband_margins_db
            );
            for l in &r.lines {
                println!("    {l:?}");
            }
        }
    }
    println!("{:?}", t.elapsed());
    for r in ramp_study(&m, &|| ()).unwrap() {
        println!(
            "{} {:.3} table {:.5} quad {:.4} ring {:.4} hidden {} B: {:?}",
            r.name,
            r.width_mrad,
            r.table_worst,
            r.quadratic_worst,
            r.ring_rms,
            r.hidden,
            r.sweep
                .rows
                .iter()
                .step_by(6)
                .map(|r| (r.alone_hz.map(|x| x.round()), r.exit_hz.map(|x| x.round())))
                .collect::<Vec<_>>()
        );
    }
    println!("{:?}", t.elapsed());
    for l in paper::UNKNOWN_LINES {
        println!("{:?}", l.implied());
    }
}
