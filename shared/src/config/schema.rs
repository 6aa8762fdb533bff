//! Postcard of another version: how a reader takes what an older or a newer writer wrote.
//!
//! Postcard encodes fields and variants by position and nothing else. So whatever is written is only ever extended at
//! its end, each extension raises a schema number, and the number travels with the bytes:
//!
//! * from an older writer: fields that it did not know read as zero bytes, which postcard takes for 0, `false`, the
//!   first variant, an empty list. An appended field's neutral value must therefore be that one.
//! * from a writer of the same schema: every byte must be used.
//! * from a newer writer: bytes behind the fields known here are left alone.
//!
//! A field in the middle cannot be added this way; that asks for a schema that older readers are told not to read
//! ([`crate::frame`]). Own flavour of postcard's reader, because its own ends where the bytes end.

use core::cmp::Ordering;
use postcard::de_flavors::Flavor;
use postcard::{Deserializer, Error, Result};
use serde::Deserialize;

/// What a reader finds behind the end of an older writer's bytes; the longest fixed field is a `u64` or `f64`.
static ABSENT_BYTES: [u8; 8] = [0; 8];

struct Lenient<'de> {
    rest: &'de [u8],
    /// Zeros follow the end.
    extended: bool,
}

impl<'de> Flavor<'de> for Lenient<'de> {
    type Remainder = &'de [u8];
    type Source = &'de [u8];

    fn pop(&mut self) -> Result<u8> {
        match self.rest.split_first() {
            Some((&first, rest)) => {
                self.rest = rest;
                Ok(first)
            }
            None if self.extended => Ok(0),
            None => Err(Error::DeserializeUnexpectedEnd),
        }
    }

    fn try_take_n(&mut self, count: usize) -> Result<&'de [u8]> {
        match self.rest.split_at_checked(count) {
            Some((taken, rest)) => {
                self.rest = rest;
                Ok(taken)
            }
            // A field is there as a whole or not at all.
            None if self.extended && self.rest.is_empty() => {
                ABSENT_BYTES.get(..count).ok_or(Error::DeserializeUnexpectedEnd)
            }
            None => Err(Error::DeserializeUnexpectedEnd),
        }
    }

    fn finalize(self) -> Result<&'de [u8]> {
        Ok(self.rest)
    }
}

/// Reads a value; `writer` is the writer's schema compared with the reader's. `None` if the bytes hold no such value.
pub fn read<'de, T: Deserialize<'de>>(bytes: &'de [u8], writer: Ordering) -> Option<T> {
    let source = Lenient { rest: bytes, extended: writer == Ordering::Less };
    let mut deserializer = Deserializer::from_flavor(source);
    let value = T::deserialize(&mut deserializer).ok()?;
    let rest = deserializer.finalize().ok()?;
    (rest.is_empty() || writer == Ordering::Greater).then_some(value)
}
