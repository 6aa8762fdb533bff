//! The broker's side: a Sparkplug B edge node whose devices are the vibration nodes.
//!
//! [`payload`] is the published schema, [`metrics`] a node as a device, [`session`] one connection with its births,
//! data, deaths and sequence, [`commands`] what comes back, [`primary`] the host that it waits for, [`publisher`] the
//! thread that keeps a session going.

pub mod commands;
pub mod metrics;
pub mod payload;
pub mod primary;
pub mod publisher;
pub mod session;

#[cfg(test)]
mod conformance;
#[cfg(test)]
mod conformance_host;
#[cfg(test)]
mod test_broker;
