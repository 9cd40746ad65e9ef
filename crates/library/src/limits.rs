//! Size limits of texts, expressions and libraries.

/// Parentheses, signs and exponents inside each other.
pub(crate) const MAX_DEPTH: usize = 200;
/// Bytes of text.
pub(crate) const MAX_TEXT: usize = 1 << 20;
/// Nodes of the tree, aliases written out.
pub(crate) const MAX_SIZE: u64 = 1_000_000;
/// Rows of a lag.
pub(crate) const MAX_LAG: f64 = 1e6;
/// Functions beyond which a library is refused: its Gram matrix would not fit any memory.
pub const MAX_FUNCTIONS: usize = 100_000;
