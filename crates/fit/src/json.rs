//! Reports for programs, as JSON: the structures of reports serialise themselves, and what a report tells otherwise than it is kept has a structure of its own here. A number
//! that is none is `null`.

pub(crate) mod narx;
mod parameters;
pub(crate) mod sindy;
mod sparse;
