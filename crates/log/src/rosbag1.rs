//! ROS 1 bags, format 2.0: from a path to the bytes of messages.
//!
//! Format: <http://wiki.ros.org/Bags/Format/2.0>. Opening hops over the records of the file: a chunk becomes a piece, and the index records
//! behind it give its messages by connection. The section at the end (connections, and the counts of each chunk) is a second witness; a bag that
//! its recorder did not close lacks it, and then the chunks themselves are looked into for connections. A chunk that was being written is a run
//! of bare records.
//!
//! There are no checksums: lengths are held against the bytes that are there, counts of indexes against those of the section at the end.

mod container;
mod record;
mod scan;
#[cfg(test)]
mod tests;

pub(crate) use container::BagContainer;

use crate::container::Kind;

/// First bytes of a bag; the version follows.
const KIND: Kind = Kind { name: "ROS 1 bag", magic: b"#ROSBAG V" };

/// First line of the one version that is read.
const FIRST_LINE: &[u8] = b"#ROSBAG V2.0\n";
