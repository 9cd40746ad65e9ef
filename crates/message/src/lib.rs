//! What a robot's message is: schemas, fields by name, decoders and encoders.
//!
//! A [`Codec`] is made once for a channel from its schema. It decodes a whole message into a [`Value`], for people and for finding the fields
//! that a log has ([`FieldTree`]), or is compiled for a few wanted fields into an [`Extract`], which walks a message's bytes once
//! and writes numbers into a [`Row`].
//!
//! Field names are paths ([`FieldPath`]): `twist.twist.linear.x`, `orientation_covariance[4]`, and, where an array stands beside an array of
//! names or its elements carry a name, `position[left_crank]`, `transforms[base_link].transform.translation.x`.

mod codec;
mod error;
mod extract;
mod fields;
mod json;
mod keys;
mod lookup;
mod path;
mod protobuf;
mod ros;
mod schema;
mod tally;
mod value;
pub mod write;

pub use codec::codec;
pub use error::{DecodeError, SchemaError};
pub use extract::{Codec, Extract, Group, MISSING, Row, Texts};
pub use fields::{FieldInfo, FieldTree};
pub use path::{FieldPath, PathError, Step};
pub use schema::{Extensibility, Field, Length, Scalar, Schema, StructType, Type};
pub use tally::FieldKind;
pub use value::Value;
