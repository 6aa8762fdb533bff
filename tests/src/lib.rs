//! Helpers shared by the tests: vectors, temporary records, tolerances.
