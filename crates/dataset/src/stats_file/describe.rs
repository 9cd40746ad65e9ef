//! Description of a statistic, for people.

use std::collections::BTreeMap;

use fleetfoot_library::Expr;
use fleetfoot_stats::{SquareRoot, least_squares};
use fleetfoot_sums::structured::{Regression, Task};
use serde::Serialize;

use super::StatisticFile;

/// One task of a statistic.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct TaskSummary {
    /// Its name.
    pub name: String,
    /// Its target and terms.
    pub equation: String,
    /// True for a prior.
    pub prior: bool,
    /// Its columns, the target left out.
    pub columns: usize,
    /// Independent ones among them.
    pub rank: usize,
    /// Condition number of the independent columns, centred and of unit length.
    pub condition: f64,
    /// Condition number of the Gram matrix in the plan's coordinates: near 1 while the pilot sample was representative.
    #[serde(rename = "preconditioned_condition")]
    pub preconditioned: f64,
    /// Standard deviation of the target.
    #[serde(rename = "sigma")]
    pub deviation: f64,
    /// Share of the target's variance that least squares on all columns explains.
    pub r2: f64,
}

impl StatisticFile {
    /// The tasks, each over all rows.
    pub fn task_summaries(&self) -> Vec<TaskSummary> {
        let regression = &self.plan.regression;
        let mut summaries = Vec::with_capacity(regression.tasks.len());
        for (task, stats) in regression.tasks.iter().zip(&self.scanned.tasks) {
            let Some(total) = stats.stats.total(|_| true) else { continue };
            let root = stats.preconditioner.square_root(&total);
            let scale: Vec<f64> = (0..root.r.ncols()).map(|j| root.r.col(j).norm_l2()).collect();
            let solution = least_squares(&root, &scale);
            summaries.push(TaskSummary {
                name: task.name.clone(),
                equation: equation(regression, task),
                prior: task.prior,
                columns: root.r.ncols(),
                rank: solution.rank,
                condition: solution.condition,
                preconditioned: root.condition,
                deviation: (root.total[0] / root.weight).sqrt(),
                r2: if root.total[0] > rounding(&root) { 1.0 - solution.rss[0] / root.total[0] } else { f64::NAN },
            });
        }
        summaries
    }

    /// Episodes and rows by the values of every label.
    pub fn by_label(&self) -> BTreeMap<String, BTreeMap<String, (usize, u64)>> {
        let mut labels: BTreeMap<String, BTreeMap<String, (usize, u64)>> = BTreeMap::new();
        for episode in &self.episodes {
            for (name, value) in &episode.labels {
                let count = labels.entry(name.clone()).or_default().entry(value.clone()).or_default();
                count.0 += 1;
                count.1 += episode.rows;
            }
        }
        labels
    }
}

/// Squares of the target that are rounding.
fn rounding(root: &SquareRoot) -> f64 {
    root.weight * (1e-13 * root.mean_y[0]).powi(2)
}

/// `m*V_dot = cos(alpha)*T - D`.
fn equation(regression: &Regression, task: &Task) -> String {
    let mut right: Option<Expr> = None;
    for term in &task.terms {
        let latent = Expr::column(regression.latents[term.latent].name.as_str());
        right = Some(match (right, term.coefficient.as_number()) {
            (Some(sum), Some(-1.0)) => &sum - &latent,
            (Some(sum), _) => &sum + &(&term.coefficient * &latent).simplified(),
            (None, _) => (&term.coefficient * &latent).simplified(),
        });
    }
    format!("{} = {}", task.target, right.map_or_else(|| "0".to_owned(), |right| right.to_string()))
}
