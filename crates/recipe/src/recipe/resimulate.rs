//! `[resimulate]`: settings of a resimulation of recordings.

use super::{bounds::whole, settings::settings};

settings! {
    resimulate, |_, _| {};
    /// Settings of a resimulation. Every entry is the flag of `resimulate` of the same name.
    pub struct ResimulateSection {
        /// Interval of the log's rows that make the grid of the equations (default: 1, every row).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=1_000_000_000))]
        pub every: usize,
        /// Inputs that may deviate from the recording, separated by commas; the others are replayed (default: all
        /// inputs of the recipe).
        #[arg(long, value_name = "INPUTS")]
        pub free: String,
        /// Expected deviations of columns, in their units: `V=0.5,alpha=0.01` (default: the noise of the recordings
        /// relative to the model).
        #[arg(long, value_name = "COLUMN=VALUE,...")]
        pub deviations: String,
        /// Bounds of states and inputs: `N1=0.2..1,alpha=-0.1..0.3` (default: the recorded range, widened).
        #[arg(long, value_name = "COLUMN=LOW..HIGH,...")]
        pub bounds: String,
        /// Share of the recorded range that widens it on both sides (default: 0.25).
        #[arg(long, value_name = "SHARE")]
        pub widen: f64,
        /// Largest number of convex programs for an episode (default: 50).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub iterations: usize,
    }
}
