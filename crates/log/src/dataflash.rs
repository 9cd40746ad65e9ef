//! The logs of ArduPilot (DataFlash), binary (`.bin`) and as text (`.log`): from a path to the bytes of messages.
//!
//! Format: <https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html> and ArduPilot's `LogStructure.h`. A message begins with two
//! bytes of a mark and its type; messages of the type `FMT` define the others: length, name, letters of the fields' types, names of the fields.
//! `FMTU`, `UNIT` and `MULT` give units and factors, `PARM` the parameters. As text a message is a line: its name and its values.
//!
//! There is no index: opening hops over all messages twice, first for what they define, then for topics, counts and times. Messages of a type
//! with instances (the field of the unit `#`) are topics by instance: `/IMU`, `/IMU.1`. A message's time is its `TimeUS`, from boot; without one
//! it is that of the message before.
//!
//! There are no checksums: a message is believed when another one follows it. What does not fit is skipped up to the next place where several
//! messages follow each other.

mod container;
mod definitions;
mod format;
mod record;
mod scan;
#[cfg(test)]
mod tests;

pub(crate) use container::DataflashContainer;

use crate::{container::Kind, format::DATAFLASH};

/// First bytes of a binary log, and of one as text.
const BINARY: &[u8] = DATAFLASH[0];
const TEXT: &[u8] = DATAFLASH[1];

/// Name of the format in messages about other files.
const KIND: Kind = Kind { name: "ArduPilot DataFlash", magic: BINARY };
