//! Messages of robots: schemas, fields by name, decoders and encoders.
//!
//! A [`Codec`] is made once for a channel from its schema. It decodes a whole message into a [`Value`], for people and
//! for the list of a log's fields ([`FieldTree`]). It can also be compiled for a few wanted fields into an [`Extract`],
//! which walks a message's bytes once and writes numbers into a [`Row`].
//!
//! Field names are paths ([`FieldPath`]): `twist.twist.linear.x`, `orientation_covariance[4]`, and, where an array stands beside an array of
//! names or its elements carry a name, `position[left_crank]`, `transforms[base_link].transform.translation.x`.
//!
//! ```
//! use fleetfoot_message::codec;
//!
//! // A ROS 2 message of two numbers, as its schema and its bytes (CDR, little-endian) stand in an MCAP file.
//! let codec = codec("cdr", Some(("robot/msg/Wheels", "ros2msg", b"float64 left\nfloat64 right\n")))?;
//! let mut bytes = vec![0, 1, 0, 0];
//! bytes.extend(1.5f64.to_le_bytes());
//! bytes.extend((-0.5f64).to_le_bytes());
//! let wheels = codec.value(&bytes)?;
//! assert_eq!(wheels.field("right").and_then(|value| value.number()), Some(-0.5));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod codec;
mod error;
mod extract;
mod fields;
mod json;
mod keys;
mod lookup;
mod packed;
mod path;
mod protobuf;
mod ros;
mod schema;
mod standard;
mod tally;
mod value;
pub mod write;

pub use codec::codec;
pub use error::{DecodeError, SchemaError};
pub use extract::{Codec, Extract, Group, MISSING, Row, Texts};
pub use fields::{FieldInfo, FieldTree};
pub use packed::{dataflash::dataflash_letter, wpilog::wpilog_uses};
pub use path::{FieldPath, PathError, Step};
pub use ros::ulog::{UlogLayout, ulog_layout};
pub use schema::{Extensibility, Field, Length, Scalar, Schema, StructType, Type};
pub use standard::{complete_definition, standard_definition};
pub use tally::FieldKind;
pub use value::Value;
