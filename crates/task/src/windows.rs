//! The weak form: windows in the place of rows, as users ask for them, and as they are.

use fleetfoot_data::setting::{SINDY, WEAK};
use fleetfoot_recipe::{Error, SindySection, Tunable};
use fleetfoot_sums::system::{LEAST_REACH, Weak};

/// Setting of the windows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WeakForm {
    /// Windows if noise is more than a fifth of the variance of differences.
    ByNoise,
    /// Never.
    Off,
    /// Windows of a length by the signals.
    Auto,
    /// Windows of so many rows.
    Rows(usize),
}

/// The windows of a weak form.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Windows {
    /// Rows from the middle of a window to either end.
    pub reach: usize,
    /// Error of the integrals, relative to a rate.
    pub accuracy: f64,
    /// The left side whose differences are noisiest, and the share of noise in their variance; `None` if the noise was
    /// not estimated.
    pub noise: Option<(String, f64)>,
}

/// Share of the variance of differences that noise may have before windows take the place of rows.
pub(super) const NOISE: f64 = 0.2;

impl Windows {
    /// Returns true if noise is more than the allowed share of some state's differences.
    pub fn noisy(&self) -> bool {
        self.noise.as_ref().is_some_and(|(_, share)| *share > NOISE)
    }
}

impl WeakForm {
    /// Reads `weak` of `[sindy]`.
    ///
    /// # Errors
    /// A word or number that is not allowed, with those that are.
    pub fn new(section: &SindySection) -> Result<Self, Error> {
        let least = 2 * LEAST_REACH + 1;
        let refused = |value: String| {
            Err(Error::value(format!(
                "{entry}: write auto, off, or a number of rows from {least} on",
                entry = SINDY.entry("weak").is(value)
            )))
        };
        match &section.weak {
            None => Ok(Self::ByNoise),
            Some(Tunable::Word(word)) if word == "auto" => Ok(Self::Auto),
            Some(Tunable::Word(word)) if word == "off" => Ok(Self::Off),
            Some(Tunable::Word(word)) => refused(word.clone()),
            Some(Tunable::Number(rows)) if *rows >= least as f64 && rows.fract() == 0.0 && *rows < 1e9 => {
                Ok(Self::Rows(*rows as usize))
            }
            Some(Tunable::Number(rows)) => refused(rows.to_string()),
        }
    }

    /// Refuses a statistic whose windows differ from the request.
    pub fn check_statistic(self, held: Option<&Weak>) -> Result<(), Error> {
        let fits = match (self, held) {
            (Self::ByNoise, _) | (Self::Off, None) | (Self::Auto, Some(_)) => true,
            (Self::Rows(rows), Some(weak)) => weak.reach == rows / 2,
            (Self::Off, Some(_)) | (Self::Auto | Self::Rows(_), None) => false,
        };
        if fits {
            return Ok(());
        }
        let wanted = match self {
            Self::Rows(rows) => format!("windows of {rows} rows"),
            Self::Auto => "windows".into(),
            Self::ByNoise | Self::Off => "rows".into(),
        };
        let has = held.map_or("rows".into(), |weak| format!("windows of {} rows", weak.rows()));
        Err(Error::other_statistic(format!(
            "{WEAK} asks for {wanted}, and the statistic has sums of {has}: remove {WEAK}, scan again with it in the recipe ({entry}), or give the logs",
            entry = SINDY.entry("weak")
        )))
    }

    /// The windows that a scan would have whose windows, where these are left open, are those that a statistic has.
    pub fn like(self, held: Option<&Weak>) -> Option<Windows> {
        let of = |weak: &Weak| Windows { reach: weak.reach, accuracy: weak.accuracy, noise: None };
        match self {
            Self::Off => None,
            Self::Rows(rows) => {
                Some(Windows { reach: rows / 2, ..held.map_or(Windows { reach: 0, accuracy: 0.0, noise: None }, of) })
            }
            Self::ByNoise | Self::Auto => held.map(of),
        }
    }
}
