//! Those who listen to a served node: every one hears everything, each is answered alone.
//!
//! A node has one link and numbers its frames once; here each peer has its own numbers, from its first frame on, so
//! nobody takes the others' answers for losses. Commands reach the node frame by frame: two peers that write at once do
//! not mix. Whatever a peer does not take in time is lost for it, as on a wire, and counted at its end.

use crate::{Error, Result};
use meshband::frame::{Decoder, MAX_FRAME, Packet, encode};
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};

/// The address that `tcp:PORT` or `tcp:HOST:PORT` means; without a host only this machine can connect.
///
/// # Errors
/// Any other text.
pub fn address(option: &str, text: &str) -> Result<String> {
    let rest = text.strip_prefix("tcp:").ok_or_else(|| Error::invalid(option, format!("'{text}' is not tcp:PORT")))?;
    Ok(if rest.contains(':') { rest.to_owned() } else { format!("127.0.0.1:{rest}") })
}

/// Most peers at once; one more is closed at once.
pub const MAX_PEERS: usize = 16;
/// Bytes of a command that has not ended yet.
const MAX_PENDING_BYTES: usize = 2 * MAX_FRAME;

/// All peers of a listener.
pub struct Peers {
    listener: TcpListener,
    peers: Vec<Peer>,
}

struct Peer {
    stream: TcpStream,
    sequence: u16,
    /// Bytes since the last delimiter.
    pending: Vec<u8>,
    gone: bool,
}

impl Peers {
    /// Whoever comes to this address.
    ///
    /// # Errors
    /// An address that cannot be had.
    pub fn at(address: &str) -> std::io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        Ok(Self { listener, peers: Vec::new() })
    }

    /// The address.
    ///
    /// # Errors
    /// Of the system.
    pub fn address(&self) -> std::io::Result<String> {
        Ok(self.listener.local_addr()?.to_string())
    }

    /// Takes in who has come, lets go who has gone.
    pub fn admit(&mut self) {
        self.peers.retain(|peer| !peer.gone);
        while let Ok((stream, _)) = self.listener.accept() {
            let usable = stream.set_nonblocking(true).and_then(|()| stream.set_nodelay(true)).is_ok();
            if usable && self.peers.len() < MAX_PEERS {
                self.peers.push(Peer { stream, sequence: 0, pending: Vec::new(), gone: false });
            }
        }
    }

    /// Hands each whole piece that a peer has sent to `answer`, and what that says back to this peer alone.
    pub fn serve(&mut self, mut answer: impl FnMut(&[u8]) -> Vec<Packet>) {
        for peer in &mut self.peers {
            for piece in peer.pieces() {
                answer(&piece).iter().for_each(|packet| peer.send(packet));
            }
        }
    }

    /// Tells everybody.
    pub fn tell(&mut self, packets: &[Packet]) {
        for peer in &mut self.peers {
            packets.iter().for_each(|packet| peer.send(packet));
        }
    }
}

impl Peer {
    /// Whole pieces between delimiters that have come, delimiters at both ends.
    fn pieces(&mut self) -> Vec<Vec<u8>> {
        let mut buffer = [0; 4096];
        match self.stream.read(&mut buffer) {
            Ok(0) => self.gone = true,
            Ok(count) => self.pending.extend_from_slice(&buffer[..count]),
            Err(error) => self.gone |= !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted),
        }
        let mut pieces = Vec::new();
        while let Some(end) = self.pending.iter().position(|&byte| byte == 0) {
            let mut piece: Vec<u8> = self.pending.drain(..=end).collect();
            if piece.len() > 1 {
                piece.insert(0, 0);
                pieces.push(piece);
            }
        }
        // What never ends is no command; its beginning makes it a refused one at its end.
        self.pending.truncate(MAX_PENDING_BYTES);
        pieces
    }

    fn send(&mut self, packet: &Packet) {
        let mut buffer = [0; MAX_FRAME];
        let Ok(frame) = encode(packet, self.sequence, &mut buffer) else { return };
        self.sequence = self.sequence.wrapping_add(1);
        if let Err(error) = self.stream.write_all(frame) {
            self.gone |= error.kind() != ErrorKind::WouldBlock;
        }
    }
}

/// The packets in whole frames of a node.
pub fn packets(bytes: &[u8]) -> Vec<Packet> {
    let mut decoder: Decoder = Decoder::new();
    bytes.iter().filter_map(|&byte| decoder.push(byte)?.ok()).map(|frame| frame.packet).collect()
}
