//! `[resimulate]`: how recordings are followed by a model.

use super::{bounds::whole, settings::settings};

settings! {
    resimulate, |_, _| {};
    /// How recordings are followed. Every entry is the flag of `resimulate` of the same name.
    pub struct ResimulateSection {
        /// Every so many rows of the log are rows of the grid on which the equations hold (default: 1, every row).
        #[arg(long, value_name = "ROWS", value_parser = whole::<usize>(0..=1_000_000_000))]
        pub every: usize,
        /// Inputs that may move, separated by commas; the others are replayed (default: all inputs of the recipe).
        #[arg(long, value_name = "INPUTS")]
        pub free: String,
        /// What columns may be off, in their units, against which deviations are weighed: `V=0.5,alpha=0.01` (default: the noise that the recordings show beside the model).
        #[arg(long, value_name = "COLUMN=VALUE,...")]
        pub deviations: String,
        /// Bounds of states and inputs: `N1=0.2..1,alpha=-0.1..0.3` (default: the recorded range, widened).
        #[arg(long, value_name = "COLUMN=LOW..HIGH,...")]
        pub bounds: String,
        /// The share of the recorded range by which it is widened on both sides (default: 0.25).
        #[arg(long, value_name = "SHARE")]
        pub widen: f64,
        /// Convex programs that an episode may take (default: 50).
        #[arg(long, value_name = "N", value_parser = whole::<usize>(0..=1_000_000))]
        pub iterations: usize,
    }
}
