//! The closed loop on records with known contents, right and wrong.

mod campaign;
mod closed_loop;
mod loop_apply;
mod loop_faults;
mod loop_limits;
mod loop_report;
mod loop_start;
mod loop_statistics;
mod loop_wrong_records;
