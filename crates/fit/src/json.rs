//! Reports for programs, as JSON. The structures of reports serialise themselves; a report whose JSON differs from its
//! fields has a separate structure here. A number that is not finite is `null`.

pub(crate) mod narx;
mod parameters;
pub(crate) mod sindy;
mod sparse;
