//! `[prepare]`: from measured channels to smooth states and derivatives. `[channels.NAME]` says otherwise of one state or input.

use serde::{Deserialize, Serialize};

use super::{
    bounds::whole,
    settings::{Tunable, settings},
};

/// How a channel becomes a smooth value and its derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum PrepareMethod {
    /// The cubic or the quintic smoothing spline, whichever the state is more like: value and rate, with standard deviations.
    Auto,
    /// The cubic smoothing spline: value and rate, with standard deviations.
    Cubic,
    /// The quintic smoothing spline: value, rate and acceleration, with standard deviations.
    Quintic,
    /// Few polynomials, joined where the data say: value, rate and, from degree 2 on, acceleration.
    TrendFilter,
    /// The cubic spline through every measurement: value, rate and acceleration.
    NotAKnot,
    /// The curve through every measurement that rises and falls where they do: value and rate.
    Pchip,
    /// Polynomials through windows of rows.
    SavitzkyGolay,
    /// A low-pass filter run both ways, then central differences.
    Butterworth,
    /// As it was measured.
    None,
}

/// A least and a greatest value: `[-1.0, 1.0]` in a recipe, `-1:1` on a command line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Limits(pub [f64; 2]);

impl std::str::FromStr for Limits {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number =
            |text: &str| text.trim().parse::<f64>().map_err(|_| format!("`{text}` is no number; write LOW:HIGH"));
        let (low, high) = text.split_once(':').ok_or("write LOW:HIGH")?;
        Ok(Self([number(low)?, number(high)?]))
    }
}

settings! {
    prepare, |_, _| {};
    /// How channels are prepared. Every entry is the flag of `prepare` of the same name.
    pub struct PrepareSection {
        /// How states become smooth (default: auto; quintic with --second-order). Inputs stay as they are unless `[channels.NAME]` says how.
        #[arg(long, value_enum, value_name = "METHOD")]
        pub method: PrepareMethod,
        /// A state's rate is a state too, and its acceleration is what is fitted: for positions whose rates nobody measured (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub second_order: bool,
        /// The penalty of a spline, in s^3 (cubic) or s^5 (quintic), or of trend-filter, in units of the state times s^degree, or what it is chosen by: likelihood or gcv
        /// (default: likelihood). A number without a method is of the cubic spline.
        #[arg(long, value_name = "VALUE|RULE", allow_negative_numbers = true)]
        pub lambda: Tunable,
        /// Values further off the curve than so many standard deviations are left out, again and again until there are none; 0 for none (default: 4 for smoothing
        /// splines, 0 for the others).
        #[arg(long, value_name = "SIGMAS", allow_negative_numbers = true)]
        pub reject: f64,
        /// Values further off the median of so many rows on either side than six robust standard deviations are left out first; 0 for none (default: 0).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=10_000))]
        pub hampel: usize,
        /// A value that is repeated over more rows than this is a sensor that hangs, and left out; 0 for never (default: 0).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=1_000_000_000))]
        pub stuck: usize,
        /// What a sensor can measure: values at or beyond these ends are left out (default: any value).
        #[arg(long, value_name = "LOW:HIGH", allow_hyphen_values = true)]
        pub range: Limits,
        /// Where a channel may be: a row beyond these ends an episode (default: anywhere).
        #[arg(long, value_name = "LOW:HIGH", allow_hyphen_values = true)]
        pub bounds: Limits,
        /// Rows of a window of savitzky-golay, an odd number (default: 11).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=100_001))]
        pub window: usize,
        /// Degree of the polynomials of savitzky-golay (default: 3), or of trend-filter, 1 to 3 (default: 2).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=100))]
        pub degree: usize,
        /// Frequency at which butterworth has halved the power, run one way (default: none, it must be given).
        #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
        pub cutoff: f64,
        /// Order of butterworth, run one way (default: 4).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=100))]
        pub order: usize,
        /// Seconds by which a sensor's stamps are late (default: 0).
        #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
        pub delay: f64,
        /// Seconds before its stamp of which a sensor reports the mean: the mean is late by half of them (default: 0).
        #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
        pub average: f64,
        /// Seconds that are cut off at both ends of every episode, before anything else (default: 0).
        #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
        pub clip: f64,
        /// Replace stamps by their regression on the sample count: for a sensor that samples evenly and a computer that stamps late (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub dejitter: bool,
        /// Write every n-th row; what savitzky-golay and butterworth made goes through an anti-alias filter first, as it does where a state's own topic is faster than the rows (default: 1).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub decimate: usize,
        /// Pieces of fewer rows are not written (default: 50).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=1_000_000_000_000))]
        pub min_rows: usize,
    }
}
