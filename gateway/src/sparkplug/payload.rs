//! Sparkplug B's payload: the published schema (Eclipse Tahu, `sparkplug_b.proto`; Sparkplug 3.0, chapter 6), written
//! down as far as an edge node of plain metrics needs it, so that the build needs no protobuf compiler.

use prost::{Message, Oneof};

/// Data types, by their numbers.
pub mod datatype {
    /// 32 bit, signed.
    pub const INT32: u32 = 3;
    /// 64 bit, signed.
    pub const INT64: u32 = 4;
    /// 64 bit.
    pub const UINT64: u32 = 8;
    /// 32 bit, binary fraction.
    pub const FLOAT: u32 = 9;
    /// Truth value.
    pub const BOOLEAN: u32 = 11;
    /// Text.
    pub const STRING: u32 = 12;
    /// Bytes.
    pub const BYTES: u32 = 17;
}

/// A message's content.
#[derive(Clone, PartialEq, Message)]
pub struct Payload {
    /// Milliseconds since 1970.
    #[prost(uint64, optional, tag = "1")]
    pub timestamp: Option<u64>,
    /// Metrics.
    #[prost(message, repeated, tag = "2")]
    pub metrics: Vec<Metric>,
    /// Sequence number, 0 to 255.
    #[prost(uint64, optional, tag = "3")]
    pub seq: Option<u64>,
}

/// One metric.
#[derive(Clone, PartialEq, Message)]
pub struct Metric {
    /// Name; in births always, in data where there is no alias.
    #[prost(string, optional, tag = "1")]
    pub name: Option<String>,
    /// Number that stands for the name.
    #[prost(uint64, optional, tag = "2")]
    pub alias: Option<u64>,
    /// Milliseconds since 1970.
    #[prost(uint64, optional, tag = "3")]
    pub timestamp: Option<u64>,
    /// [`datatype`].
    #[prost(uint32, optional, tag = "4")]
    pub datatype: Option<u32>,
    /// Kept back while the broker was away.
    #[prost(bool, optional, tag = "5")]
    pub is_historical: Option<bool>,
    /// No value yet.
    #[prost(bool, optional, tag = "7")]
    pub is_null: Option<bool>,
    /// Unit and quality.
    #[prost(message, optional, tag = "9")]
    pub properties: Option<PropertySet>,
    /// Value.
    #[prost(oneof = "Value", tags = "10, 11, 12, 13, 14, 15, 16")]
    pub value: Option<Value>,
}

/// A value.
#[derive(Clone, PartialEq, Oneof)]
pub enum Value {
    /// 32 bit and shorter.
    #[prost(uint32, tag = "10")]
    Int(u32),
    /// 64 bit.
    #[prost(uint64, tag = "11")]
    Long(u64),
    /// 32-bit fraction.
    #[prost(float, tag = "12")]
    Float(f32),
    /// 64-bit fraction.
    #[prost(double, tag = "13")]
    Double(f64),
    /// Truth value.
    #[prost(bool, tag = "14")]
    Boolean(bool),
    /// Text.
    #[prost(string, tag = "15")]
    Text(String),
    /// Bytes.
    #[prost(bytes = "vec", tag = "16")]
    Bytes(Vec<u8>),
}

/// Properties of a metric, by position.
#[derive(Clone, PartialEq, Message)]
pub struct PropertySet {
    /// Names.
    #[prost(string, repeated, tag = "1")]
    pub keys: Vec<String>,
    /// Values.
    #[prost(message, repeated, tag = "2")]
    pub values: Vec<PropertyValue>,
}

/// Value of a property.
#[derive(Clone, PartialEq, Message)]
pub struct PropertyValue {
    /// [`datatype`].
    #[prost(uint32, optional, tag = "1")]
    pub kind: Option<u32>,
    /// Whole number.
    #[prost(uint32, optional, tag = "3")]
    pub int: Option<u32>,
    /// Text.
    #[prost(string, optional, tag = "8")]
    pub text: Option<String>,
}

/// Quality codes of the property `Quality`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quality {
    /// Not to be believed.
    Bad = 0,
    /// As measured.
    Good = 192,
    /// Not renewed.
    Stale = 500,
}

/// The properties `engUnit` and `Quality`.
pub fn properties(unit: &str, quality: Quality) -> PropertySet {
    let mut set = PropertySet::default();
    if !unit.is_empty() {
        set.keys.push("engUnit".to_owned());
        set.values.push(PropertyValue { kind: Some(datatype::STRING), int: None, text: Some(unit.to_owned()) });
    }
    set.keys.push("Quality".to_owned());
    set.values.push(PropertyValue { kind: Some(datatype::INT32), int: Some(quality as u32), text: None });
    set
}
