//! What a law is fitted to.

/// One observation: shaft speed, Hz, and bandwidth, Hz.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Point {
    /// Shaft speed, Hz.
    pub shaft_hz: f64,
    /// Bandwidth, Hz.
    pub bandwidth_hz: f64,
}
