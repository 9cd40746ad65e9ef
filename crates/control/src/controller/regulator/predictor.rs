//! A predictive controller at work: a plan at every sample, begun with the plan of the sample before.

use super::prediction::PredictionTables;
use crate::predictive::{Certificate, Instance, Solver, Status, project};

/// Most sequences of regions that are tried at a sample.
pub const MOST_SEQUENCES: usize = 5;

/// The region of predicted errors (n) and inputs (m), in their units; `None` where none holds.
pub(super) type RegionOf<'a> = &'a mut dyn FnMut(&[f64], &[f64]) -> Option<usize>;

/// A plan and the memory of its computation.
///
/// The regions along the path of the present plan make the program, whose solution may pass through other regions.
/// Then the program is made again. Of all plans the one is kept that costs least along the path that it really has in
/// the model: a sample never makes the plan of the sample before worse.
pub(super) struct Predictor {
    tables: PredictionTables,
    solver: Solver,
    /// Regions of the samples of a plan.
    sequence: Vec<usize>,
    /// Path of a plan through the regions that it meets, and this plan's regions.
    path: Vec<f64>,
    met: Vec<usize>,
    best: Vec<f64>,
    start: Vec<f64>,
    constants: Vec<f64>,
    target: Vec<f64>,
    input_target: Vec<f64>,
    /// Predicted errors and inputs in their units.
    errors: Vec<f64>,
    inputs: Vec<f64>,
    began: bool,
}

impl Predictor {
    pub(super) fn new(tables: PredictionTables) -> Self {
        let (n, m, horizon) = (tables.program.states(), tables.program.inputs(), tables.program.horizon);
        Self {
            solver: Solver::new(&tables.program),
            sequence: vec![0; horizon],
            path: vec![0.0; (horizon + 1) * n],
            met: vec![0; horizon],
            best: vec![0.0; horizon * m],
            start: vec![0.0; n],
            constants: tables.constants.clone(),
            target: tables.target.clone(),
            input_target: tables.input_target.clone(),
            errors: vec![0.0; n],
            inputs: vec![0.0; m],
            began: false,
            tables,
        }
    }

    /// Plans from errors and integrals (n), and deviations of measured columns (k), in their units. The commands (m)
    /// are those of the first sample.
    pub(super) fn plan(
        &mut self,
        state: impl Iterator<Item = f64>,
        measured: &[f64],
        region: RegionOf<'_>,
        commands: &mut [f64],
    ) -> Certificate {
        let (m, horizon) = (self.tables.program.inputs(), self.tables.program.horizon);
        for ((start, value), size) in self.start.iter_mut().zip(state).zip(&self.tables.sizes) {
            *start = value / size;
        }
        shifted(&self.tables.constants, &self.tables.constant_slopes, measured, &mut self.constants);
        shifted(&self.tables.target, &self.tables.target_slopes, measured, &mut self.target);
        shifted(&self.tables.input_target, &self.tables.input_target_slopes, measured, &mut self.input_target);
        let kept = if self.began { horizon - 1 } else { 0 };
        self.began = true;
        self.solver.plan_mut().copy_within(m.., 0);
        let mut least = self.follow(kept, region);
        self.best.copy_from_slice(self.solver.plan());
        let mut certificate = Certificate { status: Status::Unfinished, residual: f64::INFINITY, steps: 0 };
        let mut steps = 0;
        for _ in 0..MOST_SEQUENCES {
            self.sequence.copy_from_slice(&self.met);
            let instance = Instance {
                start: &self.start,
                sequence: &self.sequence,
                constants: &self.constants,
                limits: &self.tables.limits,
                target: &self.target,
                input_target: &self.input_target,
            };
            let solved = self.solver.solve(&self.tables.program, &instance);
            steps += solved.steps;
            if self.tables.program.steps.len() == 1 {
                self.best.copy_from_slice(self.solver.plan());
                certificate = solved;
                break;
            }
            let cost = self.follow(horizon, region);
            let settled = self.met == self.sequence;
            if cost < least || settled {
                let status = if settled && cost <= least { solved.status } else { Status::Unfinished };
                certificate = Certificate { status, ..solved };
            }
            if cost < least {
                least = cost;
                self.best.copy_from_slice(self.solver.plan());
            }
            if settled {
                break;
            }
        }
        self.solver.plan_mut().copy_from_slice(&self.best);
        for (j, command) in commands.iter_mut().enumerate() {
            *command = self.tables.input_sizes[j] * self.best[j] + self.tables.at[j];
        }
        Certificate { steps, ..certificate }
    }

    /// Follows the plan from the start, and the linear law within limits behind its first `kept` samples, through the
    /// regions that they meet. The law's inputs become the plan. Returns the cost.
    fn follow(&mut self, kept: usize, region: RegionOf<'_>) -> f64 {
        let program = &self.tables.program;
        let (n, m) = (program.states(), program.inputs());
        self.path[..n].copy_from_slice(&self.start);
        let mut last = 0;
        for k in 0..program.horizon {
            let (now, next) = self.path[n * k..].split_at_mut(n);
            let v = &mut self.solver.plan_mut()[m * k..][..m];
            for (j, v) in v.iter_mut().enumerate() {
                if k >= kept {
                    let mut sum = self.input_target[j];
                    for (i, now) in now.iter().enumerate() {
                        sum -= self.tables.gain[n * j + i] * (now - self.target[i]);
                    }
                    *v = sum;
                }
                *v = project(*v, self.tables.limits[j]);
            }
            if program.steps.len() > 1 {
                for (i, error) in self.errors.iter_mut().enumerate() {
                    *error = now[i] * self.tables.sizes[i];
                }
                for (j, input) in self.inputs.iter_mut().enumerate() {
                    *input = self.tables.input_sizes[j] * v[j] + self.tables.at[j];
                }
                // Outside of all regions the last one goes on.
                last = region(&self.errors, &self.inputs).unwrap_or(last);
            }
            self.met[k] = last;
            program.step(last, &self.constants, now, v, &mut next[..n]);
        }
        let instance = Instance {
            start: &self.start,
            sequence: &self.met,
            constants: &self.constants,
            limits: &self.tables.limits,
            target: &self.target,
            input_target: &self.input_target,
        };
        program.cost(&instance, self.solver.plan(), &self.path)
    }
}

/// Values (by rows) with their change by measured columns.
fn shifted(values: &[f64], slopes: &[f64], measured: &[f64], out: &mut [f64]) {
    let count = measured.len();
    for (i, (out, value)) in out.iter_mut().zip(values).enumerate() {
        *out = *value;
        for (j, measured) in measured.iter().enumerate() {
            *out += slopes[count * i + j] * measured;
        }
    }
}
