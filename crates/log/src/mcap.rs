//! The MCAP container: from a path to the bytes of messages, in parallel, in bounded memory, even if the file is
//! damaged.
//!
//! A [`McapContainer`] is one file or the files of a rosbag2 folder. Opening maps the files and hops over their records: chunks become pieces,
//! known by their place and, from the indexes behind them, by their channels. A piece is then decompressed, checked and read as a whole, by
//! whichever thread takes it; pieces without a wanted topic are not touched.
//!
//! All data of a file are checked before use: lengths against the available bytes, indexes against the summary, chunks
//! against their checksums. Unreadable parts are skipped up to the next sound place and counted
//! ([`crate::container::Damage`]).

mod channels;
mod chunk;
mod container;
mod file;
mod index;
mod layout;
mod metadata;
mod record;
mod summary;
#[cfg(test)]
mod tests;

pub(crate) use container::McapContainer;

use crate::container::Kind;

/// First bytes of MCAP files.
const KIND: Kind = Kind { name: "MCAP", magic: mcap::MAGIC };
