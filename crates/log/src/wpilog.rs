//! The logs of WPILib (WPILOG): from a path to the bytes of values.
//!
//! Format: <https://github.com/wpilibsuite/allwpilib/blob/main/wpiutil/doc/datalog.adoc>. A record is a value of an entry, or one of the entry 0
//! that starts an entry (its name and type), ends it or sets its metadata. There is no index: opening hops once over all records. An entry with
//! values is a topic, whose name begins with a slash; the schemas of structs are entries themselves (`/.schema/struct:Pose2d`).
//!
//! There are no checksums: a record is believed when its entry was started and its length fits its type. What does not fit is skipped up to the
//! next place where several records follow each other.

mod container;
mod entries;
mod record;
mod scan;
#[cfg(test)]
mod tests;

pub(crate) use container::WpilogContainer;

use crate::container::Kind;

/// First bytes of the files; the version follows.
const KIND: Kind = Kind { name: "WPILOG", magic: b"WPILOG" };
