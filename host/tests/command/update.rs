//! `meshband update` as a user runs it: against the released loader and image in the emulated chip, over TCP as over
//! a serial line that loses bytes, and with everything that is no update for this node.

use crate::emulated_line::Line;
use meshband::frame::CRC32;
use meshband::message::{Identification, Reply, Request};
use meshband::update::header::{HEADER_BYTES, Header, describe, seal};
use meshband::update::{ImageStanding, Slot, StartCause};
use meshband_host::link::Client;
use meshband_host::virtual_node::emulated::run::Emulated;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// First address of the upper slot, which is free on a new board.
const UPPER_SLOT: u32 = 0x0806_0000;
/// Build of the second image, as long as that of the first.
const OTHER_BUILD: &[u8] = b"0123456789";

fn meshband(arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_meshband")).args(arguments).output().expect("the command starts")
}

/// Exit code 2, and the last line of the errors holds `expected`.
fn refused(arguments: &[&str], expected: &str) {
    let output = meshband(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {stderr}");
    assert_eq!(stderr.lines().count(), 1, "one line for {arguments:?}: {stderr}");
    assert!(stderr.contains(expected), "{arguments:?} should say `{expected}`: {stderr}");
}

fn identify(port: &str) -> Identification {
    let mut client = Client::open(port).expect("connects");
    let Ok(Reply::Identity(identity)) = client.request(&Request::Identify) else { panic!("no identity") };
    identity
}

/// Board and update file, or `None` after saying why the test is skipped.
fn built(test: &str) -> Option<(Emulated, Vec<u8>)> {
    let board = Emulated::of_board();
    let file = board.as_ref().and_then(|board| std::fs::read(board.firmware.with_extension("update")).ok());
    if file.is_none() {
        println!("skipped {test}: Unicorn or the firmware image is absent (cargo xtask setup, cargo xtask node-build)");
    }
    board.zip(file)
}

/// The image for the upper slot alone, of another build.
fn other_build(file: &[u8], board: &str) -> Vec<u8> {
    let mut rest = file;
    loop {
        let header = Header::read(rest.first_chunk().expect("a header")).expect("a header");
        let image = &rest[HEADER_BYTES..HEADER_BYTES + header.length as usize];
        if header.base == UPPER_SLOT {
            let (own, mut image) = (header.build.split(|byte| *byte == 0).next().expect("a build"), image.to_vec());
            let other = &OTHER_BUILD[..own.len().min(OTHER_BUILD.len())];
            for at in 0..image.len() - own.len() {
                if image[at..].starts_with(own) {
                    image[at..at + other.len()].copy_from_slice(other);
                }
            }
            let build = std::str::from_utf8(other).expect("letters");
            return [&seal(&describe(board, build), UPPER_SLOT, &image)[..], &image].concat();
        }
        rest = &rest[HEADER_BYTES + image.len()..];
    }
}

fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&folder);
    std::fs::create_dir_all(&folder).expect("a folder for the test");
    folder
}

fn written(folder: &Path, name: &str, bytes: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("writable");
    path.display().to_string()
}

fn updated_over(test: &str, loss: u32) {
    let Some((emulated, file)) = built(test) else { return };
    let path = written(&folder(test), "node.update", &other_build(&file, "stm32f405"));
    let line = Line::open(emulated.power_up(None).expect("powers up"), loss);
    let before = identify(&line.port);
    assert_eq!((before.image.slot, before.image.standing), (Slot::A, ImageStanding::Confirmed));
    let output = meshband(&["update", &path, "--port", &line.port]);
    let (stdout, stderr) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert!(output.status.success(), "{stdout}{stderr}");
    for part in ["erasing the free slot", "100 % of", "the node restarts", "slot B, confirmed"] {
        assert!(stdout.contains(part), "`{part}` in {stdout}");
    }
    let after = identify(&line.port);
    assert_eq!((after.image.slot, after.image.standing), (Slot::B, ImageStanding::Confirmed));
    assert_eq!((after.image.started, after.image.given_up), (StartCause::Software, None));
    assert!(OTHER_BUILD.starts_with(after.build.as_bytes()), "{} runs", after.build);
    assert_ne!(after.build, before.build);
}

#[test]
fn loop_the_command_brings_the_emulated_board_to_another_build() {
    updated_over("update", 0);
}

#[test]
fn fault_a_line_that_damages_a_byte_in_ten_thousand_costs_time_and_nothing_else() {
    updated_over("update-lossy", 100);
}

#[test]
fn fault_an_update_for_another_board_is_refused_before_anything_is_erased() {
    let Some((emulated, file)) = built("another board") else { return };
    let folder = folder("update-other-board");
    let line = Line::open(emulated.power_up(None).expect("powers up"), 0);
    let path = written(&folder, "other.update", &other_build(&file, "stm32f407"));
    refused(&["update", &path, "--port", &line.port], "is for board stm32f407, the node is stm32f405");
    assert_eq!(identify(&line.port).image.slot, Slot::A);
}

#[test]
fn fault_files_that_are_no_update_are_refused_without_a_node() {
    let folder = folder("update-files");
    let image = vec![0x5a; 4096];
    let whole = [&seal(&describe("stm32f405", "abc"), UPPER_SLOT, &image)[..], &image].concat();
    let (mut in_header, mut in_image) = (whole.clone(), whole.clone());
    in_header[21] ^= 1;
    in_image[3000] ^= 1;
    let cases: [(&str, &[u8], &str); 5] = [
        ("empty", &[], "empty"),
        (
            "text",
            b"this is no update at all, however long it may be; it is a text of more than 64 bytes",
            "no update file",
        ),
        ("header", &in_header, "no update file"),
        ("image", &in_image, "damaged"),
        ("short", &whole[..3000], "cut short"),
    ];
    for (name, bytes, expected) in cases {
        let path = written(&folder, name, bytes);
        refused(&["update", &path, "--port", "tcp:127.0.0.1:9"], expected);
    }
    let absent = folder.join("absent").display().to_string();
    refused(&["update", &absent, "--port", "tcp:127.0.0.1:9"], "absent");
    assert_eq!(
        CRC32.checksum(&image),
        Header::read(whole.first_chunk().expect("64 bytes")).expect("a header").checksum
    );
}

/// What is built says the same as the node's own code makes of the images.
#[test]
fn claim_the_update_file_that_is_built_holds_an_image_for_each_slot() {
    let Some((_, file)) = built("update file") else { return };
    let (mut rest, mut bases) = (&file[..], Vec::new());
    while !rest.is_empty() {
        let bytes = rest.first_chunk().expect("a header");
        let header = Header::read(bytes).expect("a header");
        let image = &rest[HEADER_BYTES..HEADER_BYTES + header.length as usize];
        assert_eq!(seal(bytes, header.base, image), *bytes, "sealed anew it is the same");
        let vector = |n: usize| u32::from_le_bytes(image[4 * n..4 * n + 4].try_into().expect("a word"));
        assert!(header.fits_vectors(vector(0), vector(1)));
        assert_eq!(header.check(header.base, 0x4_0000, bytes), Ok(()));
        bases.push(header.base);
        rest = &rest[HEADER_BYTES + image.len()..];
    }
    assert_eq!(bases, [0x0802_0000, UPPER_SLOT]);
}
