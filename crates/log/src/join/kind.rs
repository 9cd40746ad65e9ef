//! Interpolation of a column's values between its samples.

/// Interpolation of a column's values between its samples.
///
/// At the stamp of a sample every kind gives that sample, bit by bit, except as stated below.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub enum JoinKind {
    /// On the straight line between the two neighbours; for measured floats.
    #[default]
    Linear,
    /// The last sample at or before; for inputs, whole numbers, truth values and texts.
    Hold,
    /// Radians, on the shorter arc between the two neighbours; always wrapped to (-pi, pi].
    Angle,
    /// A quaternion (x, y, z, w), on the great arc between the two neighbours (Shoemake 1985). As q and -q are one
    /// rotation, each row takes the sign nearer to the row before; the first has w >= 0. The neighbours need not be of
    /// unit length; the values between them are.
    Slerp,
}

impl JoinKind {
    /// `linear`, `hold`, `angle` or `slerp`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Hold => "hold",
            Self::Angle => "angle",
            Self::Slerp => "slerp",
        }
    }

    /// Reads what [`JoinKind::name`] writes, in any case.
    pub fn parse(text: &str) -> Option<Self> {
        let text = text.trim().to_lowercase();
        [Self::Linear, Self::Hold, Self::Angle, Self::Slerp].into_iter().find(|kind| kind.name() == text)
    }
}
