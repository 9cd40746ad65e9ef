//! `[prepare]`: smooth states and derivatives from measured channels. `[channels.NAME]` overrides it for one state or input.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{
    bounds::whole,
    settings::{Tunable, settings},
};

/// Method that smooths a channel and takes its derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum PrepareMethod {
    /// Cubic or quintic smoothing spline, by likelihood.
    Auto,
    /// Cubic smoothing spline: value, rate and their deviations.
    Cubic,
    /// Quintic smoothing spline: also acceleration.
    Quintic,
    /// Few polynomials, joined where the data choose.
    TrendFilter,
    /// Cubic spline through every value.
    NotAKnot,
    /// Shape-preserving curve through every value.
    Pchip,
    /// Polynomials through windows of rows.
    SavitzkyGolay,
    /// Low-pass filter run both ways, then central differences.
    Butterworth,
    /// No smoothing.
    None,
}

/// A least and a greatest value: `[-1.0, 1.0]` in a recipe, `-1:1` on a command line.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(transparent)]
pub struct Limits(pub [f64; 2]);

impl std::str::FromStr for Limits {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number =
            |text: &str| text.trim().parse::<f64>().map_err(|_| format!("`{text}` is not a number; write LOW:HIGH"));
        let (low, high) = text.split_once(':').ok_or("write LOW:HIGH")?;
        Ok(Self([number(low)?, number(high)?]))
    }
}

settings! {
    prepare, |_, _| {};
    /// Settings of the preparation of channels. Every entry is the flag of `prepare` of the same name.
    pub struct PrepareSection {
        /// Smoothing method of the states; `[channels.NAME]` sets it for inputs (default: auto; quintic with
        /// --second-order).
        #[arg(long, value_enum, value_name = "METHOD")]
        pub method: PrepareMethod,
        /// Rates as further states and accelerations as targets, for positions without measured rates (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub second_order: bool,
        /// Penalty of a spline, in s^3 (cubic) or s^5 (quintic), or of trend-filter, in units of the state times
        /// s^degree; or its rule, likelihood or gcv (default: likelihood).
        #[arg(long, value_name = "VALUE|RULE", allow_negative_numbers = true)]
        pub lambda: Tunable,
        /// Standard deviations from the curve beyond which values are outliers; 0 for none (default: 4 for smoothing
        /// splines, 0 for the others).
        #[arg(long, value_name = "SIGMAS", allow_negative_numbers = true)]
        pub reject: f64,
        /// Rows on either side for the median; values beyond six robust standard deviations from it are removed before
        /// smoothing (default: 0, none).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=10_000))]
        pub hampel: usize,
        /// Longest run of equal values in rows; a longer one is left out as stuck (default: 0, never).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=1_000_000_000))]
        pub stuck: usize,
        /// Measuring range of a sensor: values at or beyond these ends are left out (default: any value).
        #[arg(long, value_name = "LOW:HIGH", allow_hyphen_values = true)]
        pub range: Limits,
        /// Bounds of a channel: a row beyond them ends an episode (default: none).
        #[arg(long, value_name = "LOW:HIGH", allow_hyphen_values = true)]
        pub bounds: Limits,
        /// Rows of a window of savitzky-golay, an odd number (default: 11).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=100_001))]
        pub window: usize,
        /// Degree of the polynomials of savitzky-golay (default: 3), or of trend-filter, 1 to 3 (default: 2).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=100))]
        pub degree: usize,
        /// Frequency at which butterworth halves the power, run one way (default: none, it must be given).
        #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
        pub cutoff: f64,
        /// Order of butterworth, run one way (default: 4).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=100))]
        pub order: usize,
        /// Delay of a sensor's stamps in seconds (default: 0).
        #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
        pub delay: f64,
        /// Averaging time of a sensor before its stamp, in seconds (default: 0).
        #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
        pub average: f64,
        /// Seconds cut off at both ends of every episode, before any other step (default: 0).
        #[arg(long, value_name = "SECONDS", allow_negative_numbers = true)]
        pub clip: f64,
        /// Stamps by regression on the sample count, for an even sensor with late stamps (default: false).
        #[arg(long, value_name = "BOOL", num_args = 0..=1, require_equals = true, default_missing_value = "true", hide_possible_values = true)]
        pub dejitter: bool,
        /// Interval of the written rows. Channels of savitzky-golay and butterworth, and of topics faster than the
        /// rows, pass an anti-alias filter first (default: 1).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub decimate: usize,
        /// Rows below which a piece is not written (default: 50).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=1_000_000_000_000))]
        pub min_rows: usize,
    }
}
