//! The history: Parquet files, partitioned `machine=NAME/day=YYYY-MM-DD/`, and what stays of it for years.
//!
//! [`schema`] are the columns, [`rows`] makes them from entries, [`files`] puts whole files into place and knows
//! which of them count, [`store`] changes a partition under its readers, [`writer`] is the thread that takes from the
//! journal, [`compact`] merges what is small, and [`export`] makes files of what [`capture`] reads from a recorded
//! link. [`rollup`] folds days that are over into [`buckets`], which [`levels`] writes and [`ledger`] lists, and has
//! [`thin`] remove raw rows by rule.

pub mod buckets;
mod capture;
pub mod compact;
mod cut;
pub mod day;
pub mod export;
pub mod files;
pub mod ledger;
pub mod levels;
pub mod rollup;
pub mod rows;
pub mod schema;
pub mod store;
mod thin;
pub mod writer;
