//! Talking to a node: commands with answers, the stream beside them, and what the link lost.
//!
//! [`transport`] opens a serial port, a TCP connection (QEMU's serial line) or a captured file; [`client`] speaks the
//! messages of `meshband::message` over it; [`stream`] counts what the link lost; [`capture`] fetches the waveform
//! that a node holds; [`health`] is the node as a device; [`setup`] makes a node's configuration from a declared
//! machine, a law file and [`settings`] of the installation, [`train`] what it follows of a gear train; [`modbus`] is
//! the register map for a PLC; [`view`] is the one state of a link that every picture, text and file is made of,
//! [`alarms`] its alarms in words, [`text`] all of it in words, [`report`] the same for keeping.

pub mod alarms;
pub mod capture;
pub mod client;
pub mod health;
pub mod letter;
pub mod limit;
pub mod machine_class;
pub mod modbus;
pub mod report;
pub mod settings;
pub mod setup;
pub mod stream;
pub mod text;
pub mod train;
pub mod transport;
pub mod update;
pub mod view;
pub mod words;

pub use client::Client;
pub use stream::Losses;
