//! Writes the bytes that the postcard crate writes, in a fraction of its code.
//!
//! postcard's serialiser is generic down to the single byte, so every field of every message becomes 80 bytes of code
//! that checks the room, and the messages of a node took more flash than its filters. Here a field is a call: what is
//! written comes down to five functions, and what does not fit is remembered and told once, at the end. The format is
//! postcard's own description of version 1 of its wire format (<https://postcard.jamesmunns.com/wire-format>);
//! `tests/tests/node/compact.rs` holds the bytes against the crate.
//!
//! Reading stays the crate's. Not to be had, because no message has them: 128-bit integers and sequences of unknown
//! length count as not fitting.

use postcard::Error;
use serde::Serialize;
use serde::ser::{self, Serializer};

/// Writes a value to the beginning of `room`: how many bytes, or `None` where they do not fit.
pub fn write(value: &impl Serialize, room: &mut [u8]) -> Option<usize> {
    let mut writer = Writer { room, used: 0, fits: true };
    let written = value.serialize(&mut writer).is_ok();
    (written && writer.fits).then_some(writer.used)
}

/// The bytes so far.
struct Writer<'a> {
    room: &'a mut [u8],
    used: usize,
    fits: bool,
}

type Written = Result<(), Error>;

impl Writer<'_> {
    #[inline(never)]
    fn byte(&mut self, byte: u8) {
        match self.room.get_mut(self.used) {
            Some(place) => *place = byte,
            None => self.fits = false,
        }
        self.used += 1;
    }

    #[inline(never)]
    fn number(&mut self, mut rest: u32) {
        while rest >= 0x80 {
            self.byte(rest as u8 | 0x80);
            rest >>= 7;
        }
        self.byte(rest as u8);
    }

    #[inline(never)]
    fn long_number(&mut self, mut rest: u64) {
        while rest >= 0x80 {
            self.byte(rest as u8 | 0x80);
            rest >>= 7;
        }
        self.byte(rest as u8);
    }

    #[inline(never)]
    fn word(&mut self, word: u32) {
        self.bytes(&word.to_le_bytes());
    }

    #[inline(never)]
    fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.byte(byte);
        }
    }

    fn does_not_fit(&mut self) -> Written {
        self.fits = false;
        Ok(())
    }
}

/// Numbers of either sign, small ones short.
fn zigzag(value: i32) -> u32 {
    (value << 1 ^ value >> 31) as u32
}

impl Serializer for &mut Writer<'_> {
    type Ok = ();
    type Error = Error;
    type SerializeSeq = Self;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = Self;
    type SerializeMap = Self;
    type SerializeStruct = Self;
    type SerializeStructVariant = Self;

    fn is_human_readable(&self) -> bool {
        false
    }
    fn serialize_bool(self, value: bool) -> Written {
        self.byte(u8::from(value));
        Ok(())
    }
    fn serialize_i8(self, value: i8) -> Written {
        self.byte(value as u8);
        Ok(())
    }
    fn serialize_i16(self, value: i16) -> Written {
        self.number(zigzag(value.into()));
        Ok(())
    }
    fn serialize_i32(self, value: i32) -> Written {
        self.number(zigzag(value));
        Ok(())
    }
    fn serialize_i64(self, value: i64) -> Written {
        self.long_number((value << 1 ^ value >> 63) as u64);
        Ok(())
    }
    fn serialize_u8(self, value: u8) -> Written {
        self.byte(value);
        Ok(())
    }
    fn serialize_u16(self, value: u16) -> Written {
        self.number(value.into());
        Ok(())
    }
    fn serialize_u32(self, value: u32) -> Written {
        self.number(value);
        Ok(())
    }
    fn serialize_u64(self, value: u64) -> Written {
        self.long_number(value);
        Ok(())
    }
    fn serialize_f32(self, value: f32) -> Written {
        self.word(value.to_bits());
        Ok(())
    }
    fn serialize_f64(self, value: f64) -> Written {
        self.bytes(&value.to_le_bytes());
        Ok(())
    }
    fn serialize_char(self, value: char) -> Written {
        self.serialize_str(value.encode_utf8(&mut [0; 4]))
    }
    fn serialize_str(self, value: &str) -> Written {
        self.serialize_bytes(value.as_bytes())
    }
    fn serialize_bytes(self, value: &[u8]) -> Written {
        self.number(value.len() as u32);
        self.bytes(value);
        Ok(())
    }
    fn serialize_none(self) -> Written {
        self.byte(0);
        Ok(())
    }
    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Written {
        self.byte(1);
        value.serialize(self)
    }
    fn serialize_unit(self) -> Written {
        Ok(())
    }
    fn serialize_unit_struct(self, _name: &'static str) -> Written {
        Ok(())
    }
    fn serialize_unit_variant(self, _name: &'static str, index: u32, _variant: &'static str) -> Written {
        self.number(index);
        Ok(())
    }
    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _name: &'static str, value: &T) -> Written {
        value.serialize(self)
    }
    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _name: &'static str,
        index: u32,
        _variant: &'static str,
        value: &T,
    ) -> Written {
        self.number(index);
        value.serialize(self)
    }
    fn serialize_seq(self, length: Option<usize>) -> Result<Self, Error> {
        match length {
            Some(length) => self.number(length as u32),
            None => self.fits = false,
        }
        Ok(self)
    }
    fn serialize_tuple(self, _length: usize) -> Result<Self, Error> {
        Ok(self)
    }
    fn serialize_tuple_struct(self, _name: &'static str, _length: usize) -> Result<Self, Error> {
        Ok(self)
    }
    fn serialize_tuple_variant(
        self,
        _name: &'static str,
        index: u32,
        _variant: &'static str,
        _length: usize,
    ) -> Result<Self, Error> {
        self.number(index);
        Ok(self)
    }
    fn serialize_map(self, length: Option<usize>) -> Result<Self, Error> {
        self.serialize_seq(length)
    }
    fn serialize_struct(self, _name: &'static str, _length: usize) -> Result<Self, Error> {
        Ok(self)
    }
    fn serialize_struct_variant(
        self,
        _name: &'static str,
        index: u32,
        _variant: &'static str,
        _length: usize,
    ) -> Result<Self, Error> {
        self.number(index);
        Ok(self)
    }
    fn collect_str<T: core::fmt::Display + ?Sized>(self, _value: &T) -> Written {
        self.does_not_fit()
    }
}

/// The parts of something compound: one behind the other, with nothing between them.
macro_rules! parts {
    ($($compound:ident $part:ident),*) => { $(
        impl ser::$compound for &mut Writer<'_> {
            type Ok = ();
            type Error = Error;
            fn $part<T: Serialize + ?Sized>(&mut self, value: &T) -> Written {
                value.serialize(&mut **self)
            }
            fn end(self) -> Written {
                Ok(())
            }
        }
    )* };
}

/// The same where parts have names, which are not written.
macro_rules! named_parts {
    ($($compound:ident),*) => { $(
        impl ser::$compound for &mut Writer<'_> {
            type Ok = ();
            type Error = Error;
            fn serialize_field<T: Serialize + ?Sized>(&mut self, _name: &'static str, value: &T) -> Written {
                value.serialize(&mut **self)
            }
            fn end(self) -> Written {
                Ok(())
            }
        }
    )* };
}

parts!(SerializeSeq serialize_element, SerializeTuple serialize_element, SerializeTupleStruct serialize_field,
    SerializeTupleVariant serialize_field);
named_parts!(SerializeStruct, SerializeStructVariant);

impl ser::SerializeMap for &mut Writer<'_> {
    type Ok = ();
    type Error = Error;
    fn serialize_key<T: Serialize + ?Sized>(&mut self, key: &T) -> Written {
        key.serialize(&mut **self)
    }
    fn serialize_value<T: Serialize + ?Sized>(&mut self, value: &T) -> Written {
        value.serialize(&mut **self)
    }
    fn end(self) -> Written {
        Ok(())
    }
}
