//! Quality marks.

/// Quality mark. A sign and a word show it, never a colour alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Light {
    /// As it should be.
    Good,
    /// Doubtful.
    Doubtful,
    /// Not as it should be.
    Bad,
    /// A fact that is neither.
    Plain,
}

impl Light {
    /// The word for those who see no colours.
    pub fn word(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Doubtful => "doubtful",
            Self::Bad => "bad",
            Self::Plain => "fact",
        }
    }

    /// The sign.
    pub fn sign(self) -> &'static str {
        match self {
            Self::Good => "\u{25cf}",
            Self::Doubtful => "\u{25b2}",
            Self::Bad => "\u{25a0}",
            Self::Plain => "\u{2013}",
        }
    }
}
