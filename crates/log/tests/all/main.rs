//! Recordings in and out of files.

#[path = "../../../../tests/outside.rs"]
mod outside;

mod channels;
mod corpus;
mod csv;
mod damage;
mod fixtures;
mod mcap_writer;
mod parquet;
mod peers;
mod same_table;
mod stamps;
mod ulog;
mod ulog_writer;
