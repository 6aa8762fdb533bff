//! One request answered from the map: functions 2 (discrete inputs), 4 (input registers) and 3, which reads the same
//! registers for masters that know holding registers only. Everything else is refused with the exceptions of the
//! standard.
//!
//! | refused with | what |
//! | --- | --- |
//! | 1, illegal function | every other function, writing above all |
//! | 2, illegal address | a range with an address that has no meaning |
//! | 3, illegal value | no item, or more than an answer holds: 125 registers, 2000 bits |
//!
//! Not answered at all: a function code of 0 or above 127, which is no request but an answer to somebody (an
//! exception), and a read of another length than a read has. On a line that gives back what is sent, two nodes would
//! otherwise talk for ever.

use super::line::Request;
use super::map::{self, View};
use super::{CRC16, MAX_FRAME};
use heapless::Vec;

/// An answer, checksum included.
pub type Answer = Vec<u8, MAX_FRAME>;

const READ_DISCRETE_INPUTS: u8 = 2;
const READ_HOLDING_REGISTERS: u8 = 3;
const READ_INPUT_REGISTERS: u8 = 4;
/// Set in the function code of an exception.
const EXCEPTION: u8 = 0x80;
const MOST_REGISTERS: u16 = 125;
const MOST_BITS: u16 = 2000;
/// Bytes behind the function code of a read: first address, quantity.
const READ_LENGTH: usize = 4;

/// Why a request is refused, by its number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Exception {
    /// No such function.
    IllegalFunction = 1,
    /// No such address.
    IllegalAddress = 2,
    /// No such quantity.
    IllegalValue = 3,
}

/// The answer to a request, and whether it is a refusal; `None` where there is to be none.
pub fn answer(address: u8, request: &Request, view: &View<'_>) -> Option<(Answer, Option<Exception>)> {
    if !(1..EXCEPTION).contains(&request.function) {
        return None;
    }
    let reads = (READ_DISCRETE_INPUTS..=READ_INPUT_REGISTERS).contains(&request.function);
    if reads && request.length != READ_LENGTH {
        return None;
    }
    let mut answer = Answer::new();
    let _ = answer.extend_from_slice(&[address, request.function]);
    let [first, count] = request.words;
    let outcome = match request.function {
        READ_DISCRETE_INPUTS => bits(first, count, view, &mut answer),
        READ_HOLDING_REGISTERS | READ_INPUT_REGISTERS => registers(first, count, view, &mut answer),
        _ => Err(Exception::IllegalFunction),
    };
    if let Err(exception) = outcome {
        answer.clear();
        let _ = answer.extend_from_slice(&[address, request.function | EXCEPTION, exception as u8]);
    }
    let checksum = CRC16.checksum(&answer);
    let _ = answer.extend_from_slice(&checksum.to_le_bytes());
    Some((answer, outcome.err()))
}

fn registers(first: u16, count: u16, view: &View<'_>, answer: &mut Answer) -> Result<(), Exception> {
    if !(1..=MOST_REGISTERS).contains(&count) {
        return Err(Exception::IllegalValue);
    }
    let _ = answer.push((2 * count) as u8);
    let mut put = |word: u16| {
        let _ = answer.extend_from_slice(&word.to_be_bytes());
    };
    map::read(first, count, view, &mut put).ok_or(Exception::IllegalAddress)
}

fn bits(first: u16, count: u16, view: &View<'_>, answer: &mut Answer) -> Result<(), Exception> {
    if !(1..=MOST_BITS).contains(&count) {
        return Err(Exception::IllegalValue);
    }
    if u32::from(first) + u32::from(count) > map::BITS {
        return Err(Exception::IllegalAddress);
    }
    let (first, count) = (u32::from(first), u32::from(count));
    let of_count = u64::MAX.checked_shr(u64::BITS - count).unwrap_or(0);
    let wanted = map::bits(view).checked_shr(first).unwrap_or(0) & of_count;
    let bytes = count.div_ceil(8) as usize;
    let _ = answer.push(bytes as u8);
    let _ = answer.extend_from_slice(wanted.to_le_bytes().get(..bytes).unwrap_or_default());
    Ok(())
}
