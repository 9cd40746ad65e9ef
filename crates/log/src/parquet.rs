//! Parquet files, read in place.

mod buffers;
mod chunk;
mod clock;
mod cursors;
mod file;
mod footer;
mod leaf;
mod open;
mod rows;

pub(crate) use cursors::Cursors;
pub(crate) use open::{clock, describe, key_value, metadata, open};
