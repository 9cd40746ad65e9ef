//! The statistics of a scan side by side: folds, leave-one-out totals and replicates by reweighting, without a pass.

use faer::MatRef;
use fleetfoot_stats::{Bank, Key, Preconditioner, SquareRoot};

use super::Scanned;

/// Statistics of every task, member by member (chunk by chunk), ready for reweighting.
#[derive(Debug, Clone)]
pub struct Banks {
    keys: Vec<Key>,
    tasks: Vec<(Preconditioner, Bank)>,
}

impl Banks {
    /// The chunks that `wanted` selects, in key order.
    pub fn new(scanned: &Scanned, wanted: impl Fn(&Key) -> bool) -> Self {
        let keys = scanned
            .tasks
            .first()
            .map_or_else(Vec::new, |task| task.stats.iter().map(|(key, _)| *key).filter(|key| wanted(key)).collect());
        let tasks = scanned.tasks.iter().map(|task| {
            let grams = task.stats.iter().filter(|(key, _)| wanted(key)).map(|(_, gram)| gram);
            (task.preconditioner.clone(), Bank::new(grams))
        });
        Self { tasks: tasks.collect(), keys }
    }

    /// The members: one a chunk.
    pub fn keys(&self) -> &[Key] {
        &self.keys
    }

    /// Rows of every member.
    pub fn rows(&self) -> &[u64] {
        self.tasks.first().map_or(&[], |(_, bank)| bank.rows())
    }

    /// Coordinates and statistics of every task.
    pub fn tasks(&self) -> &[(Preconditioner, Bank)] {
        &self.tasks
    }

    /// For every column of `weights` (members x b) the square-root form of every task, in raw units, with each chunk's rows weighted so.
    ///
    /// # Panics
    /// When there is not one weight a member.
    pub fn roots(&self, weights: MatRef<'_, f64>) -> Vec<Vec<SquareRoot>> {
        let mut columns: Vec<Vec<SquareRoot>> = (0..weights.ncols()).map(|_| Vec::new()).collect();
        for (preconditioner, bank) in &self.tasks {
            for (column, gram) in columns.iter_mut().zip(bank.combine(weights)) {
                column.push(preconditioner.square_root(&gram));
            }
        }
        columns
    }

    /// The square-root form of every task over all members.
    pub fn total(&self) -> Vec<SquareRoot> {
        self.tasks.iter().map(|(preconditioner, bank)| preconditioner.square_root(&bank.total())).collect()
    }
}
