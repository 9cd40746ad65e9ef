//! Time of trainings on this machine, measured on the first rows. The progress line shows it; no choice depends on it.

use std::time::Instant;

use fleetfoot_data::{
    Silent, Work,
    setting::{EFFORT, HIDDEN},
    thread_count,
};
use fleetfoot_learn::{Output, TILE, slope, statistic};
use fleetfoot_stats::{duration_in_words, expected_seconds};

use super::{options::NetworkOptions, rows::Rows, train::units};
use crate::error::Error;

/// Tiles that are timed.
const TILES: usize = 4;
/// Passes over the rows that a step of L-BFGS takes: it looks for its length.
const OF_STEP: f64 = 1.5;
/// Ridges that are compared after a pass.
const SOLVES: f64 = 8.0;

/// Seconds of the sizes that are compared, at most: training ends early where it does not pay.
pub(super) struct Pace {
    /// Of one thread, for every size: all folds, and all rows.
    seconds: Vec<f64>,
    folds: usize,
}

impl Pace {
    /// Times one pass of every size over the first rows.
    ///
    /// # Errors
    /// Those of training.
    pub(super) fn measured(
        sizes: &[Vec<usize>],
        options: &NetworkOptions,
        (rows, all): (&Rows, &[usize]),
        folds: &[usize],
    ) -> Result<Self, Error> {
        let (inputs, targets) = (rows.table.inputs(), rows.table.targets());
        let some = &all[..all.len().min(TILES * TILE)];
        let samples = rows.table.samples(some, &units(&rows.table, some, rows.window.as_ref())?);
        let of = |hidden: &Vec<usize>| -> Result<f64, Error> {
            let shape = rows.shape(hidden, options);
            let parameters = shape.initial(0);
            let output = Output(faer::Mat::zeros(1 + inputs + shape.features(), targets));
            let tiles: Vec<usize> = (0..samples.tiles()).collect();
            let begin = Instant::now();
            let sums = statistic(&shape, &parameters, &samples, &Silent)?;
            std::hint::black_box(slope(&shape, &parameters, &output, (&samples, &tiles), &Silent)?);
            let row = begin.elapsed().as_secs_f64() / some.len().max(1) as f64;
            let begin = Instant::now();
            std::hint::black_box(sums.solve(1e-3).is_ok());
            let solve = begin.elapsed().as_secs_f64();
            let training = |rows: usize| {
                let training = options.training(&shape, rows, targets);
                (training.epochs as f64 + OF_STEP * training.steps as f64) * (row * rows as f64 + SOLVES * solve)
            };
            Ok(folds.iter().chain([&all.len()]).map(|&rows| training(rows)).sum())
        };
        Ok(Self { seconds: sizes.iter().map(of).collect::<Result<_, Error>>()?, folds: folds.len() })
    }

    /// The work of all sizes, in the unit of other methods' work.
    pub(super) fn work(&self) -> Work {
        Work {
            operations: self.seconds.iter().sum::<f64>() / expected_seconds(1.0),
            parts: self.folds,
            mend: format!(
                "less effort ({}) or one size of hidden layers ({}) makes it shorter, and Ctrl-C writes the best so far",
                EFFORT.to("low"),
                HIDDEN.to("16")
            ),
        }
    }

    /// The time that this size and those after it take at most, in words.
    pub(super) fn left(&self, at: usize) -> String {
        let seconds: f64 = self.seconds[at..].iter().sum();
        duration_in_words((seconds / thread_count().clamp(1, self.folds.max(1)) as f64).max(1.0))
    }
}
