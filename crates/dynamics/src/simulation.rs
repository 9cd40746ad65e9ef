//! Simulations of a model on values at hand, through the times of a grid.

use fleetfoot_data::checkpoint;

use crate::{Method, Points, Stepper, StepperWorkspace, TimeGrid, Tolerance, adaptive::Adaptive, points::Ramp};

/// Inputs of a simulation.
#[derive(Debug, Clone, Copy)]
pub struct InputSequence<'a> {
    /// Steps x inputs, or steps x inputs x points; with [`Course::Lines`] one row more, and as many more as the model looks ahead.
    pub values: &'a [f64],
    /// True if every point has separate inputs.
    pub by_point: bool,
    /// Course of the inputs between two times.
    pub course: Course,
}

/// The course of inputs between the times of a simulation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Course {
    /// Each row is held until the next time.
    #[default]
    Held,
    /// Straight lines from row to row.
    Lines,
}

impl InputSequence<'_> {
    /// The value of an input at a row, at each of `count` points.
    fn row(&self, at: usize, count: usize) -> Vec<f64> {
        match self.by_point {
            true => self.values[at * count..][..count].to_vec(),
            false => vec![self.values[at]; count],
        }
    }
}

/// Step rule of a simulation between two times.
#[derive(Debug, Clone, PartialEq)]
pub enum Integration {
    /// By steps whose estimated error is within a tolerance: the pair 5(4) of Dormand and Prince.
    Adaptive(Tolerance),
    /// By equal steps.
    Fixed {
        /// Integration method of derivatives.
        method: Method,
        /// Steps from one time to the next; `None`: as many as make no step longer than the model's sampling period.
        substeps: Option<usize>,
    },
}

impl Default for Integration {
    fn default() -> Self {
        Self::Adaptive(Tolerance::default())
    }
}

impl Stepper {
    /// Simulates from the points through the times of a grid ([`Self::grid`]).
    ///
    /// `take` gets the number of the time and the states there (states x points), the first ones included, and returns
    /// true to go on. The past moves by a row a time, so lagged values are held in between. Returns the shortfall from
    /// the tolerance: the largest sum of the errors of steps that could not be made short enough, over the size of a
    /// state. It is 0 if the tolerance was met, and with fixed steps.
    pub fn simulate(
        &self,
        points: &mut Points,
        grid: &TimeGrid,
        inputs: InputSequence<'_>,
        integration: &Integration,
        mut take: impl FnMut(usize, &[f64]) -> bool,
    ) -> f64 {
        let mut workspace = StepperWorkspace::default();
        let mut adaptive = match integration {
            Integration::Adaptive(tolerance) if self.is_continuous() => {
                Some(Adaptive::new(self, tolerance, points.count(), grid.shortest()))
            }
            _ => None,
        };
        let shortfall = |adaptive: &Option<Adaptive>| adaptive.as_ref().map_or(0.0, Adaptive::shortfall);
        let mut states: Vec<f64> =
            self.states.iter().flat_map(|state| points.column(state.column, 0).to_vec()).collect();
        if !take(0, &states) {
            return 0.0;
        }
        for (step, pair) in grid.times().windows(2).enumerate() {
            let seconds = pair[1] - pair[0];
            self.set_inputs(points, inputs, step, seconds);
            match (&mut adaptive, integration) {
                (Some(adaptive), _) => adaptive.advance(self, points, seconds, &mut workspace, &mut states),
                // Without derivatives there is nothing to integrate.
                (None, Integration::Adaptive(_)) => {
                    self.advance(points, seconds, 1, Method::Rk4, &mut workspace, &mut states);
                }
                (None, Integration::Fixed { method, substeps }) => {
                    let parts = if self.is_continuous() { substeps.unwrap_or(grid.periods(step)).max(1) } else { 1 };
                    self.advance(points, seconds, parts, *method, &mut workspace, &mut states);
                }
            }
            points.pass();
            points.seconds_mut(0).iter_mut().for_each(|time| *time += seconds);
            self.write_states(points, &states);
            if !take(step + 1, &states) {
                break;
            }
        }
        shortfall(&adaptive)
    }

    /// The states after `seconds` in `parts` equal parts. The points stay as they are.
    fn advance(
        &self,
        points: &mut Points,
        seconds: f64,
        parts: usize,
        method: Method,
        workspace: &mut StepperWorkspace,
        states: &mut Vec<f64>,
    ) {
        if parts == 1 {
            states.clear();
            states.extend_from_slice(self.next(points, seconds, method, workspace));
            return;
        }
        let row = points.clone();
        let seconds = seconds / parts as f64;
        for _ in 0..parts {
            checkpoint();
            states.clear();
            states.extend_from_slice(self.next(points, seconds, method, workspace));
            self.write_states(points, states);
            points.wait(seconds);
        }
        *points = row;
    }

    /// Writes the inputs of a step of so many seconds, and lets them move where they go in lines.
    fn set_inputs(&self, points: &mut Points, inputs: InputSequence<'_>, step: usize, seconds: f64) {
        let (count, width) = (points.count(), self.inputs.len());
        let mut ramps = Vec::new();
        for (i, &column) in self.inputs.iter().enumerate() {
            let begin = inputs.row(step * width + i, count);
            points.column_mut(column, 0).copy_from_slice(&begin);
            for rows in 1..=self.ahead() {
                let later = inputs.row((step + rows) * width + i, count);
                points.ahead_mut(column, rows).copy_from_slice(&later);
            }
            if inputs.course == Course::Lines {
                let end = inputs.row((step + 1) * width + i, count);
                let rate = end.iter().zip(&begin).map(|(end, begin)| (end - begin) / seconds).collect();
                ramps.push(Ramp { column, begin, rate });
            }
        }
        points.begin_ramps(ramps);
    }

    fn write_states(&self, points: &mut Points, states: &[f64]) {
        let count = points.count();
        for (s, state) in self.states.iter().enumerate() {
            points.column_mut(state.column, 0).copy_from_slice(&states[s * count..(s + 1) * count]);
        }
    }
}
