//! `[auto]`: effort of the search for a model, and steps of the simulations that compare models.

use super::{bounds::whole, narx::Effort, settings::settings};

settings! {
    auto, |_, _| {};
    /// Settings of the search for models. Every entry is the flag of `auto` of the same name.
    pub struct AutoSection {
        /// Search effort, a count of work, never of seconds (default: normal).
        #[arg(long, value_enum, value_name = "EFFORT")]
        pub effort: Effort,
        /// Steps of the simulations that compare models (default: the correlation time of the states, in rows).
        #[arg(long, value_name = "STEPS", value_parser = whole::<usize>(1..=1_000_000))]
        pub horizon: usize,
    }
}
