//! The workbench below the loop: stiffness, dynamics, effects, laws, records, reports.

mod dynamics;
mod effects;
mod golden_pair;
mod import;
mod law_edges;
mod law_fit;
mod law_learn;
mod law_study;
mod law_table;
mod measured;
mod models;
mod records;
mod reports;
mod rise_time_study;
mod stiffness;
