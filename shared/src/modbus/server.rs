//! One request answered from the map: functions 2 (discrete inputs), 4 (input registers) and 3, which reads the same
//! registers for masters that know holding registers only; 6 and 16 write the command register, where the
//! configuration permits it. Everything else is refused with the exceptions of the standard.
//!
//! | refused with | what |
//! | --- | --- |
//! | 1, illegal function | every other function, and writing without permission |
//! | 2, illegal address | a range with an address that has no meaning, a write of another register |
//! | 3, illegal value | no item, more than an answer holds (125 registers, 2000 bits), no such command |
//!
//! Not answered at all: a function code of 0 or above 127, which is no request but an answer to somebody (an
//! exception), and a read or a permitted write of another length than it has. On a line that gives back what is sent,
//! two nodes would otherwise talk for ever.

use super::line::Request;
use super::map::{self, View};
use super::{CRC16, Command, MAX_FRAME};
use heapless::Vec;

/// An answer, checksum included.
pub type Answer = Vec<u8, MAX_FRAME>;

const READ_DISCRETE_INPUTS: u8 = 2;
const READ_HOLDING_REGISTERS: u8 = 3;
const READ_INPUT_REGISTERS: u8 = 4;
const WRITE_REGISTER: u8 = 6;
const WRITE_REGISTERS: u8 = 16;
/// Set in the function code of an exception.
const EXCEPTION: u8 = 0x80;
const MOST_REGISTERS: u16 = 125;
const MOST_BITS: u16 = 2000;
/// Bytes behind the function code of a read: first address, quantity.
const READ_LENGTH: usize = 4;
/// Bytes behind the function code of a write of one register by function 16: address, quantity, length, value.
const WRITE_LENGTH: usize = 7;

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

/// An answer with what it means for the node: a command to carry out, or that it is a refusal.
pub type Outcome = (Answer, Result<Option<Command>, Exception>);

/// The answer to a request; `None` where there is to be none. `sample` is the waveform held ([`map::SAMPLES`]).
pub fn answer(address: u8, request: &Request, view: &View<'_>, sample: &impl Fn(u32) -> f32) -> Option<Outcome> {
    if !(1..EXCEPTION).contains(&request.function) || has_another_length(request, view.options().commands) {
        return None;
    }
    let mut answer = Answer::new();
    let _ = answer.extend_from_slice(&[address, request.function]);
    let [first, count] = request.words;
    let outcome = match request.function {
        READ_DISCRETE_INPUTS => bits(first, count, view, &mut answer).map(|()| None),
        READ_HOLDING_REGISTERS | READ_INPUT_REGISTERS => {
            registers(first, count, view, sample, &mut answer).map(|()| None)
        }
        WRITE_REGISTER | WRITE_REGISTERS if view.options().commands => command(request, &mut answer).map(Some),
        _ => Err(Exception::IllegalFunction),
    };
    if let Err(exception) = outcome {
        answer.clear();
        let _ = answer.extend_from_slice(&[address, request.function | EXCEPTION, exception as u8]);
    }
    let checksum = CRC16.checksum(&answer);
    let _ = answer.extend_from_slice(&checksum.to_le_bytes());
    Some((answer, outcome))
}

/// Whether a request is no request: a read, or a write where writing is permitted, with too few or too many bytes.
fn has_another_length(request: &Request, commands: bool) -> bool {
    let reads = (READ_DISCRETE_INPUTS..=READ_INPUT_REGISTERS).contains(&request.function);
    if reads || (commands && request.function == WRITE_REGISTER) {
        return request.length != READ_LENGTH;
    }
    let (announced, _) = request.written;
    commands && request.function == WRITE_REGISTERS && request.length != WRITE_LENGTH - 2 + usize::from(announced)
}

/// The command that a write of the one register asks for; both functions answer with the first two words.
fn command(request: &Request, answer: &mut Answer) -> Result<Command, Exception> {
    let [first, second] = request.words;
    let value = match (request.function, second, request.written) {
        (WRITE_REGISTER, value, _) | (_, 1, (2, value)) => value,
        // More registers than the one there is, or a quantity that its length contradicts.
        (_, 2.., _) => return Err(Exception::IllegalAddress),
        _ => return Err(Exception::IllegalValue),
    };
    if first != map::COMMAND {
        return Err(Exception::IllegalAddress);
    }
    let command = Command::of(value).ok_or(Exception::IllegalValue)?;
    for word in request.words {
        let _ = answer.extend_from_slice(&word.to_be_bytes());
    }
    Ok(command)
}

fn registers(
    first: u16,
    count: u16,
    view: &View<'_>,
    sample: &impl Fn(u32) -> f32,
    answer: &mut Answer,
) -> Result<(), Exception> {
    if !(1..=MOST_REGISTERS).contains(&count) {
        return Err(Exception::IllegalValue);
    }
    let _ = answer.push((2 * count) as u8);
    let mut put = |word: u16| {
        let _ = answer.extend_from_slice(&word.to_be_bytes());
    };
    let read = if first < map::SAMPLES {
        map::read(first, count, view, &mut put)
    } else {
        map::read_samples(first, count, view.options(), sample, &mut put)
    };
    read.ok_or(Exception::IllegalAddress)
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
