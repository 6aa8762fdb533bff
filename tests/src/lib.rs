//! Helpers shared by the tests: vectors, temporary records, tolerances.

pub mod mock_flash;
