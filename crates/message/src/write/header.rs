//! Header of stamped messages.

use super::cdr::Cdr;

const NANOSECONDS: i64 = 1_000_000_000;

/// `builtin_interfaces/msg/Time`: a time since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Time {
    /// Whole seconds, rounded down.
    pub sec: i32,
    /// Nanoseconds on top of them, below 1e9.
    pub nanosec: u32,
}

impl Time {
    /// From nanoseconds since 1970; `None` where the seconds need more than 32 bits: before December 1901 and after January 2038.
    pub fn from_nanoseconds(stamp: i64) -> Option<Self> {
        let sec = i32::try_from(stamp.div_euclid(NANOSECONDS)).ok()?;
        Some(Self { sec, nanosec: stamp.rem_euclid(NANOSECONDS) as u32 })
    }
}

/// `std_msgs/msg/Header`: when, and in which frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Header<'a> {
    /// When it was measured.
    pub stamp: Time,
    /// The coordinate frame of what follows.
    pub frame_id: &'a str,
}

impl Header<'_> {
    pub(super) fn put(&self, cdr: &mut Cdr<'_>) {
        cdr.i32(self.stamp.sec);
        cdr.u32(self.stamp.nanosec);
        cdr.text(self.frame_id);
    }
}
