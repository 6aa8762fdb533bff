//! Nodes that say nothing, and nodes that never stop answering.

use crate::common::{folder, meshband_within, refused, text};
use meshband::config::SCHEMA;
use meshband::frame::{MAX_FRAME, encode};
use meshband::identity::VERSION;
use meshband::message::{Identification, Reply, SelfTest, WIRE_SCHEMA};
use std::io::{Read, Write};
use std::net::TcpListener;

/// Far more than a capture's reader needs, far less than five million answers take.
const MEMORY_KIB: u32 = 1 << 20;

fn frame(reply: &Reply, sequence: u16) -> Vec<u8> {
    let mut buffer = [0; MAX_FRAME];
    encode(reply, sequence, &mut buffer).expect("fits").to_vec()
}

#[test]
fn regress_monitor_of_a_node_without_messages_ends_with_a_line_and_exit_code_2() {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    let port = format!("tcp:{}", listener.local_addr().expect("an address"));
    let node = std::thread::spawn(move || {
        let (mut stream, _) = listener.accept().expect("a caller");
        let identity = Identification {
            wire_schema: WIRE_SCHEMA,
            configuration_schema: SCHEMA,
            version: VERSION,
            build: Default::default(),
            board: Default::default(),
            unique_id: [0; 3],
            ticks_per_second: 1_000_000,
            self_test: SelfTest::default(),
            image: Default::default(),
        };
        let mut asked = [0; 64];
        let mut sequence = 0;
        while stream.read(&mut asked).is_ok_and(|count| count > 0) {
            let _ = stream.write_all(&frame(&Reply::Identity(identity.clone()), sequence));
            sequence += 1;
        }
    });
    refused(&["monitor", &port, "--patience", "0.5"], &[&port, "no message within 0.5 s"]);
    node.join().expect("ended");
}

#[test]
fn fault_answers_that_nobody_asked_for_do_not_fill_memory() {
    let folder = folder("flood");
    let capture = folder.join("flood.bin");
    let block: Vec<u8> = (0..=u16::MAX).flat_map(|sequence| frame(&Reply::Done, sequence)).collect();
    let mut file = std::fs::File::create(&capture).expect("a file");
    (0..80).for_each(|_| file.write_all(&block).expect("written"));
    drop(file);
    let output = meshband_within(MEMORY_KIB, &["monitor", "--replay", &text(&capture)]);
    std::fs::remove_file(&capture).expect("removed");
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{stderr}");
    assert!(stderr.contains("flood.bin"), "{stderr}");
}
