//! The QEMU runner calls only a run that the firmware itself finished a success.

use meshband::replay::{CodeDigest, Drill, Header, Replay, SamplingMode, image_bytes, write};
use meshband_host::virtual_node::qemu::{Finished, Qemu, built_firmware};
use meshband_tests::qemu_node::machine;
use std::time::Duration;

const TICKS_PER_SECOND: u32 = 25_000_000;

/// 0.2 s of a 700 Hz tone at 1 MHz with a tachometer at 40 pulses per second.
fn image(header: Header) -> Vec<u8> {
    let samples: Vec<i16> = (0..200_000)
        .map(|n| (20_000.0 * (2.0 * std::f64::consts::PI * 700.0 * f64::from(n) / 1e6).sin()) as i16)
        .collect();
    let edges: Vec<u32> = (0..8).map(|n| 1_000 + n * 625_000).collect();
    let mut bytes = vec![0; image_bytes(0, edges.len(), samples.len())];
    let length = write(&header, &[], &edges, &samples, &mut bytes).expect("a sound image");
    assert_eq!(length, bytes.len());
    bytes
}

fn header() -> Header {
    Header { forced_period_ticks: Some(250), ..Header::new(TICKS_PER_SECOND, 25, 100.0) }
}

fn drill(machine: Qemu, drill: Drill) -> String {
    machine.run(&image(Header { drill, ..header() })).expect_err("a staged failure is noticed").to_string()
}

#[test]
fn fault_a_panic_is_an_error_that_quotes_the_panic() {
    let Some(machine) = machine("panic") else { return };
    let message = drill(machine, Drill::Panic);
    assert!(message.contains("exit code") && message.contains("staged by the record"), "{message}");
}

#[test]
fn fault_a_hang_is_an_error_after_the_time_limit() {
    let Some(machine) = machine("hang") else { return };
    let message = drill(Qemu { time_limit: Duration::from_secs(2), ..machine }, Drill::Hang);
    assert!(message.contains("no end after 2 s"), "{message}");
}

#[test]
fn fault_a_locked_up_core_is_an_error() {
    let Some(machine) = machine("lock-up") else { return };
    let message = drill(machine, Drill::LockUp);
    assert!(message.contains("died") || message.contains("exit code"), "{message}");
}

#[test]
fn fault_a_stack_overflow_is_found_and_named() {
    let Some(machine) = machine("stack overflow") else { return };
    // Neither corrupted nor locked up: the fault's entry finds its way without a stack.
    let message = drill(machine, Drill::StackOverflow);
    assert!(message.contains("exit code 3") && message.contains("stack overflow"), "{message}");
}

#[test]
fn fault_panic_stack_overflow_fault_and_hang_restart_the_node_which_then_knows_why() {
    let Some(machine) = machine("restarts") else { return };
    let drill = Qemu { firmware: built_firmware("restart"), time_limit: Duration::from_secs(30), ..machine };
    let run = drill.run(&[0; 64]).expect("four restarts, then the end");
    let said = |stage: u32| {
        let start = format!("node: stage={stage} ");
        run.console.lines().find_map(|line| line.strip_prefix(&start)).unwrap_or_else(|| panic!("{}", run.console))
    };
    assert_eq!(said(0), "crashes=0");
    assert!(said(1).starts_with("crashes=1 place=") && said(1).ends_with("firmware/src/bin/restart.rs"), "{}", said(1));
    assert!(said(2).starts_with("crashes=2 place=4 "), "the stack overflow: {}", said(2));
    // The fault's own address; the hang leaves no record, so the same one still stands after the watchdog's reset.
    assert!(said(3).starts_with("crashes=3 place=") && !said(3).contains("place=0 "), "{}", said(3));
    assert_eq!(said(4), said(3));
}

#[test]
fn fault_memory_without_a_record_is_an_error() {
    let Some(machine) = machine("empty memory") else { return };
    let message = machine.run(&[0; 256]).expect_err("no record, no run").to_string();
    assert!(message.contains("NotAnImage"), "{message}");
}

#[test]
fn fault_a_damaged_record_is_an_error() {
    let Some(machine) = machine("damaged record") else { return };
    let mut bytes = image(header());
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    let message = machine.run(&bytes).expect_err("one bit is wrong").to_string();
    assert!(message.contains("Checksum"), "{message}");
}

/// The digest of what the host reads from the same image at the same instants.
fn digest_on_host(bytes: &[u8], period: u32, block: u32) -> (u32, u32) {
    let record = Replay::parse(bytes).expect("a sound image");
    let (mut digest, mut border, mut blocks) = (CodeDigest::new(), 0, 0);
    let mut codes = vec![0; block as usize];
    while border + period * block < record.end_tick() {
        assert!(record.sample(border + period, period, &mut codes));
        digest.update(&codes);
        border += period * block;
        blocks += 1;
    }
    (blocks, digest.value())
}

fn number(run: &Finished, key: &str) -> u32 {
    run.statistic(key).and_then(|v| v.parse().ok()).unwrap_or_else(|| panic!("no {key} in {}", run.console))
}

#[test]
fn golden_both_forms_of_sampling_and_the_host_give_the_same_codes() {
    for period in [250, 997, 2500] {
        let Some(machine) = machine("sampling forms") else { return };
        let by_block = machine.run(&image(Header { forced_period_ticks: Some(period), ..header() })).expect("runs");
        let by_sample = machine
            .run(&image(Header { forced_period_ticks: Some(period), sampling: SamplingMode::PerSample, ..header() }))
            .expect("runs");
        let (blocks, digest) = digest_on_host(&image(header()), period, 512);
        for run in [by_block, by_sample] {
            assert_eq!(number(&run, "blocks"), blocks, "{period}: {}", run.console);
            assert_eq!((number(&run, "lost"), number(&run, "missed")), (0, 0));
            // The edges at 0.04 ms and every 25 ms after it that lie before the last block's end.
            let sampled = blocks * period * 512;
            assert_eq!(number(&run, "edges"), (sampled - 1_000).div_ceil(625_000));
            assert_eq!(run.statistic("codes_crc"), Some(format!("{digest:08x}").as_str()));
        }
    }
}
