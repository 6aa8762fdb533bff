//! What tests need of the node beyond the product: runs on every target that the node runs on, and is in no released
//! image.
#![no_std]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod golden;
