//! Updates over the line of the flashed node: a second image end to end ([`course`]), what is refused ([`refusals`]),
//! images that do not prove themselves ([`trials`]), power cuts at every moment ([`cuts`]).

mod course;
mod cuts;
mod refusals;
mod trials;

use super::image::{self, SLOTS};
use super::spoken::Node;
use meshband::message::{Identification, Reply, Request};
use meshband::update::header::{HEADER_BYTES, Header, seal};
use meshband::update::vocabulary::MAX_CHUNK;
use meshband::update::{RunningImage, Stage, UpdateRequest, UpdateStatus};
use meshband_emulator::elf::Image;

/// An image for a slot, as an update has it.
#[derive(Clone)]
pub struct Update {
    header: [u8; HEADER_BYTES],
    bytes: Vec<u8>,
}

impl Update {
    /// What is built for the upper slot (1) or the lower one (0).
    fn built(slot: usize) -> Self {
        let (header, bytes) = image::for_slot(slot);
        Self { header, bytes }
    }

    /// The image for the upper slot with other bytes at some places, sealed anew.
    fn changed(change: impl FnOnce(&mut [u8])) -> Self {
        let mut update = Self::built(1);
        change(&mut update.bytes);
        update.header = seal(&update.header, SLOTS[1], &update.bytes);
        update
    }

    fn version(&self) -> [u8; 3] {
        Header::read(&self.header).expect("a header").version
    }

    /// Place in the image of the first instruction.
    fn entry(&self) -> usize {
        let vector = u32::from_le_bytes(self.bytes[4..8].try_into().expect("a word"));
        (vector & !1).wrapping_sub(SLOTS[1] + meshband::update::header::IMAGE_OFFSET) as usize
    }
}

/// A node at its first start.
fn started(image: &Image) -> Node {
    let mut node = Node::new(image);
    node.start();
    node
}

fn step(node: &mut Node, request: UpdateRequest) -> UpdateStatus {
    match node.ask(&Request::Update(request)) {
        Reply::Update(status) => status,
        other => panic!("{other:?}"),
    }
}

fn begin(node: &mut Node, header: &[u8]) -> UpdateStatus {
    step(node, UpdateRequest::Begin { header: header.try_into().expect("fits") })
}

fn chunk(node: &mut Node, update: &Update, offset: u32) -> UpdateStatus {
    let rest = &update.bytes[offset as usize..];
    let bytes = rest[..rest.len().min(MAX_CHUNK)].try_into().expect("fits");
    step(node, UpdateRequest::Chunk { offset, bytes })
}

/// Begins and waits until the slot is erased.
fn erase(node: &mut Node, update: &Update) -> UpdateStatus {
    let mut status = begin(node, &update.header);
    assert_eq!((status.stage, status.refusal), (Stage::Erasing, None), "{status:?}");
    while status.stage == Stage::Erasing {
        node.run(0.1);
        status = step(node, UpdateRequest::Status);
    }
    assert_eq!((status.stage, status.next), (Stage::Receiving, 0));
    status
}

/// Sends what is missing, up to a place.
fn send_until(node: &mut Node, update: &Update, end: u32) {
    let mut status = step(node, UpdateRequest::Status);
    while status.next < end {
        status = chunk(node, update, status.next);
        assert_eq!((status.stage, status.refusal), (Stage::Receiving, None), "{status:?}");
    }
}

/// Erases and sends everything; the node waits for the activation.
fn transfer(node: &mut Node, update: &Update) {
    erase(node, update);
    send_until(node, update, update.bytes.len() as u32);
}

/// Asks for the activation and runs until the node has restarted and listens.
fn activate(node: &mut Node) {
    let status = step(node, UpdateRequest::Activate);
    assert_eq!((status.stage, status.refusal), (Stage::Restarting, None), "{status:?}");
    wait_for_reset(node);
    node.start();
}

/// Runs until the next reset; what was heard before it is forgotten.
fn wait_for_reset(node: &mut Node) {
    node.board.seen().resets.clear();
    let end = node.board.seconds() + 10.0;
    while node.board.seen().resets.is_empty() {
        assert!(node.board.seconds() < end, "no reset");
        node.run(0.01);
    }
    node.forget();
}

/// Runs until the new image is well, and confirms it.
fn confirm(node: &mut Node) {
    node.run(5.5);
    let status = step(node, UpdateRequest::Confirm);
    assert_eq!(status.refusal, None, "{status:?}");
}

fn identity(node: &mut Node) -> Identification {
    match node.ask(&Request::Identify) {
        Reply::Identity(identity) => identity,
        other => panic!("{other:?}"),
    }
}

fn running(node: &mut Node) -> RunningImage {
    identity(node).image
}
