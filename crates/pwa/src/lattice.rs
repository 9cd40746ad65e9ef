//! Many small cells, and the regions that they are joined to.

mod tree;

pub(crate) use tree::{Cell, Tree};
