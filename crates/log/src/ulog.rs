//! The ULog container of PX4: from a path to the bytes of messages.
//!
//! Format: <https://docs.px4.io/main/en/dev_log/ulog_file_format.html>. There is no index: opening hops once over the heads of all messages, and keeps
//! which topics each megabyte has, with their counts and times. Values are not looked at. A megabyte is then read by whichever thread takes it,
//! in place.
//!
//! A topic is a subscription that has messages: `/vehicle_attitude`, and further instances `/sensor_accel.1`, `/sensor_accel.2`. Logged texts are
//! `/logged_messages` and `/logged_messages_tagged`. The time of a message is its `timestamp`, from the boot of its writer.
//!
//! There are no checksums either. A message is believed when its length fits the format that its subscription names; what does not is skipped
//! up to the next place where several messages follow each other.

mod about;
mod container;
mod definitions;
mod message;
mod scan;
#[cfg(test)]
mod tests;

pub(crate) use container::UlogContainer;

use crate::container::{Kind, ULOG};

/// First bytes of ULog files.
const KIND: Kind = Kind { name: "ULog", magic: ULOG };
