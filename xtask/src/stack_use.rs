//! Deepest stack an image can need, from its machine code alone.
//!
//! Each function's frame is what its instructions take off the stack pointer; calls and tail calls make the graph; an
//! indirect call may reach every function whose address is stored anywhere but in the vector table. The deepest path
//! from `main`, one interrupt on top (all share a priority), and a fault or the non-maskable interrupt on top of that,
//! each with the 108 bytes that the core itself pushes (PM0214, section 2.3.7), is an upper bound. QEMU's painted stack
//! measures the same path from below (`tests/src/qemu_node.rs`).
//!
//! Recursion has no bound: it is cut where it closes, and reported. Only the QEMU board's image has any (text
//! formatting, which the released one leaves to the host, and a staged overflow). Encodings: ARM DDI 0403E, chapter
//! A7.

use crate::elf::{Function, Image};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// What the core pushes on an exception: 26 words with the floating-point registers, and a word to align.
const EXCEPTION_FRAME: u32 = 108;

/// Deepest use of the stack, bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StackUse {
    /// Of `main`.
    pub main: u32,
    /// Of the deepest interrupt, with the core's frame.
    pub interrupt: u32,
    /// Of the deepest fault handler, with the core's frame.
    pub fault: u32,
    /// Room there is.
    pub size: u32,
    /// A function may come to call itself: the depths are then no bound.
    pub recursive: bool,
}

impl StackUse {
    /// All three on top of each other.
    pub fn sum(self) -> u32 {
        self.main + self.interrupt + self.fault
    }
}

/// Deepest use of an image's stack.
///
/// # Errors
/// A file that is no image of ours.
pub fn of(path: &Path) -> Result<StackUse, String> {
    let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
    Image::parse(&bytes)
        .and_then(|image| analyse(&image))
        .ok_or_else(|| format!("{}: no image of ours", path.display()))
}

fn analyse(image: &Image<'_>) -> Option<StackUse> {
    let frames: BTreeMap<u32, Frame> = image.functions.iter().map(|f| (f.address, Frame::of(image, f))).collect();
    let by_pointer = image.pointers().filter(|address| frames.contains_key(address)).collect();
    let mut graph = Graph { frames, depths: BTreeMap::new(), open: BTreeSet::new(), by_pointer, recursive: false };
    // Initial stack pointer, reset, non-maskable interrupt, hard fault, then the rest.
    let vectors: Vec<u32> = image.vectors().map(|vector| vector & !1).collect();
    let mut deepest = |handlers: &[u32]| handlers.iter().map(|&at| graph.depth(at)).max();
    let (fault, interrupt) = (deepest(vectors.get(2..4)?)?, deepest(vectors.get(4..)?)?);
    let size = image.symbol("_stack_start")? - image.symbol("_stack_end")?;
    let main = graph.depth(image.symbol("main")? & !1);
    let [interrupt, fault] = [interrupt, fault].map(|bytes| bytes + EXCEPTION_FRAME);
    Some(StackUse { main, interrupt, fault, size, recursive: graph.recursive })
}

struct Graph {
    frames: BTreeMap<u32, Frame>,
    depths: BTreeMap<u32, u32>,
    /// Functions on the path under way.
    open: BTreeSet<u32>,
    /// Functions that an indirect call may reach.
    by_pointer: BTreeSet<u32>,
    recursive: bool,
}

impl Graph {
    fn depth(&mut self, function: u32) -> u32 {
        if let Some(&depth) = self.depths.get(&function) {
            return depth;
        }
        let Some(frame) = self.frames.get(&function).cloned() else { return 0 };
        if !self.open.insert(function) {
            self.recursive = true;
            return 0;
        }
        let mut called = frame.calls;
        if frame.calls_by_pointer {
            called.extend(&self.by_pointer);
        }
        let below = called.into_iter().map(|callee| self.depth(callee)).max().unwrap_or(0);
        self.open.remove(&function);
        self.depths.insert(function, frame.bytes + below);
        frame.bytes + below
    }
}

/// One function's own need and whom it calls.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
struct Frame {
    bytes: u32,
    calls: BTreeSet<u32>,
    calls_by_pointer: bool,
}

impl Frame {
    fn of(image: &Image<'_>, function: &Function) -> Self {
        let mut frame = Self::default();
        // Constants in low registers and in r12, for frames too large for an immediate.
        let mut constants = BTreeMap::new();
        let mut at = function.address;
        while at < function.address + function.size {
            if let Some(code) = image.data_end(at) {
                at = code;
                continue;
            }
            let Some(first) = image.half(at) else { break };
            if first >> 11 < 0b11101 {
                frame.short(at, first, &mut constants);
                at += 2;
            } else {
                let Some(second) = image.half(at + 2) else { break };
                frame.long(at, first, second, &mut constants);
                at += 4;
            }
        }
        // A branch inside the function is no call.
        let own = function.address + 1..function.address + function.size;
        frame.calls.retain(|target| !own.contains(target) && *target != function.address);
        frame
    }

    fn short(&mut self, at: u32, code: u32, constants: &mut BTreeMap<u32, u32>) {
        let branch = |offset: i32| at.wrapping_add(4).wrapping_add_signed(offset);
        match code {
            // push
            _ if code & 0xfe00 == 0xb400 => self.bytes += 4 * (code & 0x1ff).count_ones(),
            // sub sp, #
            _ if code & 0xff80 == 0xb080 => self.bytes += 4 * (code & 0x7f),
            // movs r, #
            _ if code & 0xf800 == 0x2000 => drop(constants.insert(code >> 8 & 7, code & 0xff)),
            // blx r; bx r other than lr
            _ if code & 0xff87 == 0x4780 => self.calls_by_pointer = true,
            _ if code & 0xff87 == 0x4700 && code >> 3 & 15 != 14 => self.calls_by_pointer = true,
            // b
            _ if code & 0xf800 == 0xe000 => drop(self.calls.insert(branch(signed(code & 0x7ff, 11) * 2))),
            _ if code & 0xf000 == 0xd000 && code >> 8 & 15 < 14 => {
                self.calls.insert(branch(signed(code & 0xff, 8) * 2));
            }
            _ => {}
        }
    }

    fn long(&mut self, at: u32, first: u32, second: u32, constants: &mut BTreeMap<u32, u32>) {
        let target = second >> 8 & 15;
        let immediate = (first >> 10 & 1) << 11 | (second >> 12 & 7) << 8 | second & 0xff;
        match (first, second) {
            // stmdb sp!
            (0xe92d, _) => self.bytes += 4 * second.count_ones(),
            // str [sp, #-n]!
            (0xf84d, _) if second & 0x0f00 == 0x0d00 => self.bytes += second & 0xff,
            // strd [sp, #-n]!
            (0xe96d, _) => self.bytes += 4 * (second & 0xff),
            // vpush
            (_, _) if first & 0xffbf == 0xed2d && second & 0x0e00 == 0x0a00 => self.bytes += 4 * (second & 0xff),
            // sub sp, sp, #: modified constant, or plain
            (_, _) if first & 0xfbef == 0xf1ad && target == 13 => self.bytes += expanded(immediate),
            (_, _) if first & 0xfbff == 0xf2ad && target == 13 => self.bytes += immediate,
            // sub sp, sp, r
            (_, _) if first & 0xffef == 0xebad && target == 13 => {
                self.bytes += constants.get(&(second & 15)).copied().unwrap_or(0);
            }
            // movw; mov.w r, #
            (_, _) if first & 0xfbf0 == 0xf240 => {
                constants.insert(target, (first & 15) << 12 | immediate);
            }
            (_, _) if first & 0xfbef == 0xf04f => {
                constants.insert(target, expanded(immediate));
            }
            // bl, b.w
            (_, _) if first & 0xf800 == 0xf000 && second & 0x9000 == 0x9000 => {
                let (sign, j1, j2) = (first >> 10 & 1, second >> 13 & 1, second >> 11 & 1);
                let high = sign << 23 | (1 ^ j1 ^ sign) << 22 | (1 ^ j2 ^ sign) << 21;
                let offset = signed(high | (first & 0x3ff) << 11 | second & 0x7ff, 24) * 2;
                self.calls.insert(at.wrapping_add(4).wrapping_add_signed(offset));
            }
            // b<condition>.w
            (_, _) if first & 0xf800 == 0xf000 && second & 0xd000 == 0x8000 && first >> 7 & 7 != 7 => {
                let (sign, j1, j2) = (first >> 10 & 1, second >> 13 & 1, second >> 11 & 1);
                let offset = signed(sign << 19 | j2 << 18 | j1 << 17 | (first & 0x3f) << 11 | second & 0x7ff, 20) * 2;
                self.calls.insert(at.wrapping_add(4).wrapping_add_signed(offset));
            }
            _ => {}
        }
    }
}

/// The value of a field of so many bits with its sign.
fn signed(value: u32, bits: u32) -> i32 {
    (value << (32 - bits)) as i32 >> (32 - bits)
}

/// `ThumbExpandImm`: a modified constant of 12 bits.
fn expanded(immediate: u32) -> u32 {
    let byte = immediate & 0xff;
    match immediate >> 8 {
        0 => byte,
        1 => byte << 16 | byte,
        2 => byte << 24 | byte << 8,
        3 => byte << 24 | byte << 16 | byte << 8 | byte,
        _ => (0x80 | byte & 0x7f).rotate_right(immediate >> 7),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn frame(halves: &[u16]) -> Frame {
        let bytes: Vec<u8> = halves.iter().flat_map(|half| half.to_le_bytes()).collect();
        let size = bytes.len() as u32;
        let image = Image { loaded: vec![(0x1000, &bytes)], ..Image::default() };
        Frame::of(&image, &Function { address: 0x1000, size })
    }

    #[test]
    fn theory_frames_are_what_the_instructions_take() {
        // push {r4-r7, lr}; sub sp, #16
        assert_eq!(frame(&[0xb5f0, 0xb084]).bytes, 20 + 16);
        // push.w {r8-r11}; vpush {d8-d11}; sub.w sp, sp, #6720; str r4, [sp, #-8]!
        assert_eq!(frame(&[0xe92d, 0x0f00, 0xed2d, 0x8b08, 0xf5ad, 0x5dd2, 0xf84d, 0x4d08]).bytes, 16 + 32 + 6720 + 8);
        // movw r12, #39044; sub.w sp, sp, r12
        assert_eq!(frame(&[0xf649, 0x0c84, 0xebad, 0x0d0c]).bytes, 0x9884);
        // subw sp, sp, #2049
        assert_eq!(frame(&[0xf6ad, 0x0d01]).bytes, 2049);
    }

    #[test]
    fn theory_calls_are_found_and_branches_inside_are_none() {
        // bl +0x100; b.w -0x200; blx r3
        let calls = frame(&[0xf000, 0xf880, 0xf7ff, 0xbf00, 0x4798]);
        assert_eq!(calls.calls, BTreeSet::from([0x1104, 0x0e08]));
        assert!(calls.calls_by_pointer);
        // b .; bx lr
        assert_eq!(frame(&[0xe7fe, 0x4770]), Frame::default());
    }
}
