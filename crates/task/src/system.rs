//! Sums for a fit of equations.

use fleetfoot_model::Partition;
use fleetfoot_pwa::Problem;
use fleetfoot_sums::system::System;

use crate::equations::EquationTask;

impl EquationTask {
    /// Sums for a fit: the system in its regions, and the errors of its differences.
    pub fn summed(&self, partition: Option<Partition>) -> System {
        let sampled = self.fitted.iter().filter_map(|equation| equation.difference.clone()).collect();
        match &self.windows {
            None => System { sampled, partition, ..self.system() },
            Some(windows) => System { partition, weak: Some(self.weak(windows)), ..self.system() },
        }
    }

    /// Sums for a fit, in one region.
    pub fn system(&self) -> System {
        System {
            also: self.also(),
            weight: self.weight.clone(),
            ..System::new(self.functions.clone(), self.fitted.iter().map(|equation| equation.target.clone()).collect())
        }
    }

    /// The task as it is cut into regions.
    pub fn problem(&self, step: f64) -> Problem {
        Problem {
            columns: self.columns.clone(),
            library: self.functions.clone(),
            equations: self.equations.clone(),
            partition_columns: self.partition_columns.clone(),
            weight: self.weight.clone(),
            step,
        }
    }
}
