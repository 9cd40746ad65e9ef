//! One trajectory of equations without regions, lags and clock: right sides evaluated row by row, without the
//! bookkeeping of batches.
//!
//! The arithmetic is that of [`crate::general`], operation by operation.

use fleetfoot_library::{Leaf, Scratch};

use crate::{End, Method, Simulator, Trajectory, integrate::runge_kutta_mean, run::Run, state::State};

/// Source of a value that a right side reads.
#[derive(Debug, Clone, Copy)]
enum Reading {
    State(usize),
    /// A column of the recording.
    Recorded(usize),
    /// A latent that is the same at all rows.
    Number(f64),
}

/// A simulator whose right sides can be stepped one at a time.
pub(crate) struct Lean {
    readings: Vec<Reading>,
}

/// Memory of a trajectory.
struct Steps<'a> {
    lean: &'a Lean,
    simulator: &'a Simulator,
    recorded: Vec<&'a [f64]>,
    leaves: Vec<f64>,
    moved: Vec<f64>,
    scratch: Scratch,
}

impl Lean {
    /// `None` for a model that has regions, functions of latents, lags, a clock or a controller.
    pub(crate) fn new(simulator: &Simulator) -> Option<Self> {
        let compiled = &simulator.compiled;
        let numbers = compiled.constants().filter(|_| simulator.driver.is_none())?;
        let reading = |leaf: &Leaf| match *leaf {
            Leaf::Column { column, lag: 0 } => match column.checked_sub(simulator.columns.len()) {
                Some(latent) => Some(Reading::Number(numbers[latent])),
                None => {
                    let state = simulator.states.iter().position(|state| state.column == column);
                    Some(state.map_or(Reading::Recorded(column), Reading::State))
                }
            },
            _ => None,
        };
        Some(Self { readings: compiled.rights.leaves().iter().map(reading).collect::<Option<_>>()? })
    }

    /// The trajectory of a run from a beginning.
    pub(crate) fn simulate(
        &self,
        simulator: &Simulator,
        run: &Run<'_>,
        beginning: &[f64],
        method: Method,
    ) -> Trajectory {
        let states = &simulator.states;
        let recorded = |reading: &Reading| match *reading {
            Reading::Recorded(column) => run.window.values(column, 0, run.horizon as i64),
            _ => &[],
        };
        let mut steps = Steps {
            lean: self,
            simulator,
            recorded: self.readings.iter().map(recorded).collect(),
            leaves: vec![0.0; self.readings.len()],
            moved: vec![0.0; states.len()],
            scratch: Scratch::new(),
        };
        let stages = if method == Method::Rk4 && states.iter().any(|state| state.advance.continuous) { 4 } else { 1 };
        let mut slopes: [Vec<f64>; 4] = std::array::from_fn(|_| vec![0.0; states.len()]);
        let mut path = Vec::with_capacity((run.horizon + 1) * states.len());
        path.extend_from_slice(beginning);
        let (mut end, mut x) = (End::Horizon, vec![0.0; states.len()]);
        for step in 0..run.horizon {
            let now = &path[step * states.len()..];
            x.iter_mut().enumerate().for_each(|(s, x)| *x = run.corrected(simulator.moved(), s, step, |s| now[s]));
            let (x, seconds) = (x.as_slice(), run.step(step));
            for stage in 0..stages {
                let (before, now) = slopes.split_at_mut(stage);
                let fraction = [0.0, 0.5, 0.5, 1.0][stage];
                steps.slopes(step, x, before.last().map(|slopes| (slopes.as_slice(), seconds * fraction)), &mut now[0]);
            }
            let next = |s: usize, state: &State| {
                let [one, two, three, four] = &slopes;
                let mean = stages == 4 && state.advance.continuous;
                let slope = if mean { runge_kutta_mean([one[s], two[s], three[s], four[s]]) } else { one[s] };
                state.advance.next(x[s], slope, seconds)
            };
            let mut next: Vec<f64> = states.iter().enumerate().map(|(s, state)| next(s, state)).collect();
            simulator.geometry.retract(&mut next, |s| s);
            let near = |((state, value), start): ((&State, &f64), &f64)| {
                (value - start).abs() <= state.limit(run.divergence, *start)
            };
            if !states.iter().zip(&next).zip(beginning).all(near) {
                end = End::Diverged;
                break;
            }
            path.extend(next);
        }
        let made = path.len() / states.len() - 1;
        let (time, regions) = (run.time[..=made].to_vec(), vec![0; made]);
        Trajectory { start: run.start, time, states: path, inputs: Vec::new(), regions, end, left_domain: None }
    }
}

impl Steps<'_> {
    /// Right sides at a row, with the states moved along slopes by so many seconds.
    fn slopes(&mut self, step: usize, x: &[f64], along: Option<(&[f64], f64)>, out: &mut [f64]) {
        self.moved.copy_from_slice(x);
        if let Some((slopes, offset)) = along {
            for ((moved, slope), state) in self.moved.iter_mut().zip(slopes).zip(&self.simulator.states) {
                let slope = if state.advance.continuous { *slope } else { 0.0 };
                *moved = offset.mul_add(slope, *moved);
            }
        }
        for ((leaf, reading), recorded) in self.leaves.iter_mut().zip(&self.lean.readings).zip(&self.recorded) {
            *leaf = match *reading {
                Reading::State(state) => self.moved[state],
                Reading::Recorded(_) => recorded[step],
                Reading::Number(value) => value,
            };
        }
        self.simulator.compiled.rights.evaluate_row(&self.leaves, out, &mut self.scratch);
    }
}
