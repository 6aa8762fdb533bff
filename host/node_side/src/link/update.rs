//! Another image for a node, over its link: the update file, and the steps from the first question to the confirmation.
//!
//! The node says which byte it wants next and refuses what does not fit it; here is what a person is told, what is
//! worth trying again, and what is known before a byte is sent. A transfer that was cut off goes on where it stood
//! while the node has not restarted.

use super::client::Client;
use super::words::words;
use crate::{Error, Result, budget};
use meshband::frame::CRC32;
use meshband::message::Identification;
use meshband::update::header::{HEADER_BYTES, Header};
use meshband::update::vocabulary::MAX_CHUNK;
use meshband::update::{ImageStanding, Slot, Stage, UpdateRefused, UpdateRequest, UpdateStatus};
use std::io::Read;
use std::path::Path;
use std::time::{Duration, Instant};

/// First link schema whose nodes take updates.
const FIRST_SCHEMA: u8 = 7;
/// Longest update file: both slots of the largest node and then some.
const LONGEST_FILE: u64 = 1 << 20;
/// How long erasing may take: two sectors of 2 s, and what a busy node is late by.
const ERASE_PATIENCE: Duration = Duration::from_secs(30);
/// How long a new image may need to be spoken to: three starts that each end in the watchdog, 15 s at its slowest.
const RESTART: Duration = Duration::from_secs(60);
/// How long a new image may need to be well: five seconds of samples, and a second for each item of the self-test.
const RECOVERY: Duration = Duration::from_secs(60);
/// Between two questions to a node that is busy with itself.
const PAUSE: Duration = Duration::from_millis(200);

/// An image with its header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UpdateImage {
    /// What it says of itself.
    pub header: Header,
    header_bytes: [u8; HEADER_BYTES],
    bytes: Vec<u8>,
}

/// Images of one build, one for each slot.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UpdateFile {
    images: Vec<UpdateImage>,
}

/// What happens, for whoever waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// The free slot is being erased.
    Erasing,
    /// So many bytes of all have arrived.
    Sent(u32, u32),
    /// The image is complete and sound; the node restarts into it.
    Restarting,
    /// The new image answers; what it lacks to be confirmed, as [`UpdateStatus::missing`].
    Waiting(u8),
}

impl UpdateFile {
    /// Reads a file that `cargo xtask node-build` made.
    ///
    /// # Errors
    /// [`Error::File`] where it cannot be read, [`Error::Invalid`] where it is none or is damaged.
    pub fn read(path: &Path) -> Result<Self> {
        let mut bytes = Vec::new();
        let file = budget::open(path)?;
        file.take(LONGEST_FILE + 1).read_to_end(&mut bytes).map_err(Error::file(path))?;
        Self::parse(&bytes).map_err(|what| Error::invalid(format!("update {}", path.display()), what))
    }

    /// Takes a file apart; says what is wrong with one that is none.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub fn parse(bytes: &[u8]) -> std::result::Result<Self, String> {
        if bytes.len() as u64 > LONGEST_FILE {
            return Err(format!("longer than {LONGEST_FILE} bytes: no update file"));
        }
        let (mut images, mut rest) = (Vec::new(), bytes);
        while !rest.is_empty() {
            let at = bytes.len() - rest.len();
            let header = rest.first_chunk::<HEADER_BYTES>().and_then(|bytes| Some((*bytes, Header::read(bytes)?)));
            let Some((header_bytes, header)) = header else {
                return Err(if at == 0 { "no update file".into() } else { format!("damaged at byte {at}") });
            };
            let image = rest.get(HEADER_BYTES..HEADER_BYTES + header.length as usize);
            let image =
                image.ok_or_else(|| format!("cut short: the image at byte {at} has {} bytes", header.length))?;
            if CRC32.checksum(image) != header.checksum {
                return Err(format!("the image at byte {at} is damaged: its checksum differs"));
            }
            images.push(UpdateImage { header, header_bytes, bytes: image.to_vec() });
            rest = &rest[HEADER_BYTES + image.len()..];
        }
        if images.is_empty() { Err("empty".into()) } else { Ok(Self { images }) }
    }

    /// The image for a slot.
    fn for_slot(&self, base: u32) -> Option<&UpdateImage> {
        self.images.iter().find(|image| image.header.base == base)
    }

    /// Version and build, in words.
    pub fn describe(&self) -> String {
        self.images.first().map_or_else(String::new, |image| describe(image.header.version, &text(&image.header.build)))
    }
}

/// Version and build, in words.
fn describe([major, minor, patch]: [u8; 3], build: &str) -> String {
    format!("{major}.{minor}.{patch} ({build})")
}

fn text(padded: &[u8]) -> String {
    let end = padded.iter().position(|byte| *byte == 0).unwrap_or(padded.len());
    String::from_utf8_lossy(&padded[..end]).into_owned()
}

/// Version and build of a node, in words.
pub fn running(node: &Identification) -> String {
    describe(node.version, &node.build)
}

/// Brings a node to the file's image and has it confirmed; gives what the node then says of itself.
///
/// # Errors
/// [`Error::Invalid`] for a file that is not for this node, [`Error::Tool`] where the node refuses, falls silent, or
/// goes back to the image before.
pub fn run(
    client: &mut Client,
    file: &UpdateFile,
    mut tell: impl FnMut(Progress) -> Result<()>,
) -> Result<Identification> {
    let before = client.identify()?;
    check(file, &before)?;
    let status = client.update(&UpdateRequest::Status)?;
    if status.standing == ImageStanding::OnTrial {
        if !file.images.iter().any(|image| is_image_of(image, &before)) {
            let what = format!("its image {} is on trial and no other is taken until that ends", running(&before));
            return Err(Error::tool("node", what));
        }
        return confirm(client, &mut tell);
    }
    let image = file.for_slot(status.free).ok_or_else(|| {
        let what = format!("has no image for the node's free slot at {:#010x}", status.free);
        Error::invalid("update", what)
    })?;
    transfer(client, image, &mut tell)?;
    accepted(client.update(&UpdateRequest::Activate)?)?;
    tell(Progress::Restarting)?;
    wait_for_restart(client, before.image.slot)?;
    confirm(client, &mut tell)
}

fn is_image_of(image: &UpdateImage, node: &Identification) -> bool {
    image.header.version == node.version && text(&image.header.build) == node.build.as_str()
}

/// What is known before a byte is sent.
fn check(file: &UpdateFile, node: &Identification) -> Result<()> {
    if node.wire_schema < FIRST_SCHEMA {
        let what = format!(
            "its firmware speaks schema {} of the link and takes no updates (from {FIRST_SCHEMA} on): flash it by a \
             probe",
            node.wire_schema
        );
        return Err(Error::tool("node", what));
    }
    if node.image.slot == Slot::None {
        return Err(Error::tool("node", format!("board {} has no slots for updates", node.board)));
    }
    for UpdateImage { header, .. } in &file.images {
        let board = text(&header.board);
        if board != node.board.as_str() {
            return Err(Error::invalid("update", format!("is for board {board}, the node is {}", node.board)));
        }
        if header.configuration_schema < node.configuration_schema {
            let what = format!(
                "stores configurations of schema {}, older than the node's {}: it could not read the stored one",
                header.configuration_schema, node.configuration_schema
            );
            return Err(Error::invalid("update", what));
        }
    }
    Ok(())
}

fn transfer(client: &mut Client, image: &UpdateImage, tell: &mut impl FnMut(Progress) -> Result<()>) -> Result<()> {
    let header = image.header_bytes.into_iter().collect();
    let mut status = accepted(client.update(&UpdateRequest::Begin { header })?)?;
    let deadline = Instant::now() + ERASE_PATIENCE;
    if status.stage == Stage::Erasing {
        tell(Progress::Erasing)?;
    }
    while status.stage == Stage::Erasing {
        if Instant::now() > deadline {
            return Err(Error::tool(
                "node",
                format!("has not erased its free slot within {} s", ERASE_PATIENCE.as_secs()),
            ));
        }
        std::thread::sleep(PAUSE);
        status = accepted(client.update(&UpdateRequest::Status)?)?;
    }
    while status.next < image.header.length {
        if status.stage != Stage::Receiving {
            let what = format!(
                "has given up the transfer at byte {} ({}): restarted meanwhile?",
                status.next,
                words(&status.stage)
            );
            return Err(Error::tool("node", what));
        }
        tell(Progress::Sent(status.next, image.header.length))?;
        let rest = image.bytes.get(status.next as usize..).unwrap_or_default();
        let bytes = rest.iter().take(MAX_CHUNK).copied().collect();
        status = accepted(client.update(&UpdateRequest::Chunk { offset: status.next, bytes })?)?;
    }
    tell(Progress::Sent(image.header.length, image.header.length))
}

/// The new image's first words; a node that goes on with the former one has refused the new one.
fn wait_for_restart(client: &mut Client, former: Slot) -> Result<()> {
    let deadline = Instant::now() + RESTART;
    while Instant::now() < deadline && !client.has_ended() {
        match client.call(PAUSE * 10) {
            Ok(node) if node.image.slot != former => return Ok(()),
            Ok(node) if node.image.given_up.is_some() => {
                return Err(Error::tool(
                    "node",
                    "has started the new image three times in vain and runs the former one again",
                ));
            }
            // The former image's last words, or nobody yet.
            Ok(_) => std::thread::sleep(PAUSE),
            Err(_) => {}
        }
    }
    let what =
        format!("did not come back with the new image within {} s: look at it with `monitor`", RESTART.as_secs());
    Err(Error::tool("node", what))
}

fn confirm(client: &mut Client, tell: &mut impl FnMut(Progress) -> Result<()>) -> Result<Identification> {
    let deadline = Instant::now() + RECOVERY;
    loop {
        let status = client.update(&UpdateRequest::Confirm)?;
        match status.refusal {
            None => return client.identify(),
            Some(UpdateRefused::Unwell) if Instant::now() < deadline => {
                tell(Progress::Waiting(status.missing))?;
                std::thread::sleep(PAUSE);
            }
            Some(UpdateRefused::Unwell) => {
                let what = format!(
                    "the new image is not well after {} s ({}); it is given up if nothing changes",
                    RECOVERY.as_secs(),
                    lacking(status.missing)
                );
                return Err(Error::tool("node", what));
            }
            Some(_) => {
                accepted(status)?;
            }
        }
    }
}

/// What a new image lacks, in words.
pub fn lacking(missing: u8) -> String {
    const ITEMS: [&str; 3] =
        ["the stored configuration was not taken", "the self-test has not passed", "five seconds of samples"];
    let set = (0..ITEMS.len()).filter(|n| missing >> n & 1 != 0).map(|n| ITEMS[n]);
    set.collect::<Vec<_>>().join(", ")
}

/// A status without a refusal, or the refusal in words.
fn accepted(status: UpdateStatus) -> Result<UpdateStatus> {
    let Some(refusal) = status.refusal else { return Ok(status) };
    let what = match refusal {
        UpdateRefused::NotSupported => "takes no updates: it was not started by a loader",
        UpdateRefused::Header => "refuses the update: its header is damaged",
        UpdateRefused::Board => "refuses the update: it is for another board",
        UpdateRefused::Place => "refuses the update: it is linked for another slot",
        UpdateRefused::Length => "refuses the update: its length does not fit the slot",
        UpdateRefused::OlderSchema => "refuses the update: it could not read the stored configuration",
        UpdateRefused::OnTrial => "takes no update while its own image is on trial",
        UpdateRefused::NotReady => "has forgotten the update: it restarted meanwhile; begin again",
        UpdateRefused::Range => "refuses a part of the update: bytes behind its end",
        UpdateRefused::Incomplete => "misses bytes of the update",
        UpdateRefused::Damaged => "refuses the update: its checksum differs from what arrived",
        UpdateRefused::Vectors => "refuses the update: it begins with no vector table",
        UpdateRefused::Flash => "could not erase or write its flash: supply below 2.7 V, or worn out",
        UpdateRefused::Unwell => "is not well",
    };
    Err(Error::tool("node", what))
}
