//! Stretches of a recording, simulated from unknown beginnings, for output-error methods.
//!
//! With gains the simulation is that of a filter: at every row the states are moved towards their measurements, and the
//! next step is made from them.
//!
//! A segment of [`Shooting`](crate::Shooting) begins at its measured state, with its noise. Here the beginning is
//! given, and the errors are those of all rows of the stretch, its first one too. They have derivatives by the model's
//! coefficients and by the beginning.

use fleetfoot_data::{Block, Halo, Source};
use fleetfoot_model::{Model, RotationKind};

use crate::{
    Coefficient, End, Error, RolloutOptions, ShootingOptions, Simulator, Start, general, lean::Lean, run::Run,
    sensitivity::Sensitivity, state::State, window::Window,
};

/// Consecutive rows of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretch {
    /// The first row.
    pub start: Start,
    /// Steps from there: one row less than there are.
    pub steps: usize,
}

/// Errors and derivatives of a simulation through a stretch.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct StretchPath {
    /// Measured less simulated, rows x states; NaN where nothing was measured. Those of angles are in (-pi, pi]; of a rotation the measured one is written as near to the
    /// simulated one as it can be. Behind the first row a quaternion has three errors: the one of its largest part, which follows from the others, is NaN.
    pub errors: Vec<f64>,
    /// Derivatives of the simulated states by the coefficients, rows x states x coefficients.
    pub by_coefficients: Vec<f64>,
    /// Derivatives of the simulated states by the gains, rows x states x states; none without gains.
    pub by_gains: Vec<f64>,
    /// Derivatives of the simulated states by those of the beginning, rows x states x states.
    pub by_beginning: Vec<f64>,
}

/// A model on stretches of a recording.
pub struct Stretches<'a> {
    source: &'a dyn Source,
    simulator: Simulator,
    /// Lean form of the equations, if they allow it.
    lean: Option<Lean>,
    sensitivity: Sensitivity,
    options: RolloutOptions,
    coefficients: usize,
    map: Vec<usize>,
}

impl<'a> Stretches<'a> {
    /// Compiles a model for stretches of a source whose columns are the model's, and differentiates it with respect to `coefficients`. Of the options the
    /// steps do not count.
    ///
    /// # Errors
    /// Those of [`Shooting::new`](crate::Shooting::new), but for the length of the recording.
    pub fn new(
        model: &Model,
        source: &'a dyn Source,
        coefficients: &[Coefficient],
        options: &ShootingOptions,
    ) -> Result<Self, Error> {
        let options = options.rollout();
        options.validate()?;
        let simulator = Simulator::for_source(model, source, options.step)?;
        Ok(Self {
            sensitivity: Sensitivity::new(&simulator, coefficients)?,
            map: simulator.column_map(source)?,
            coefficients: coefficients.len(),
            lean: Lean::new(&simulator),
            source,
            simulator,
            options,
        })
    }

    /// The simulated states; all values here are in their order.
    pub fn states(&self) -> &[String] {
        self.simulator.states()
    }

    /// The recording cut into stretches of `rows` rows at most, of equal lengths within an episode; `None`: every episode whole. Rows that are too few for a
    /// step are left out.
    pub fn cut(&self, rows: Option<usize>) -> Vec<Stretch> {
        let (before, after) = (self.simulator.history(), self.simulator.ahead());
        let of_episode = |(episode, info): (usize, &fleetfoot_data::Episode)| {
            let usable = info.rows.saturating_sub(before + after);
            let count = usable.div_ceil(rows.unwrap_or(usize::MAX)).max(1);
            let stretch = move |at: usize| {
                let (first, end) = (at * usable / count, (at + 1) * usable / count);
                let start = Start { episode, row: before + first };
                (end > first + 1).then(|| Stretch { start, steps: end - first - 1 })
            };
            (0..count).filter_map(stretch).collect::<Vec<_>>()
        };
        self.source.episodes().iter().enumerate().flat_map(of_episode).collect()
    }

    /// Reads the rows of a stretch.
    ///
    /// # Errors
    /// Of reading.
    pub fn read(&self, stretch: Stretch) -> Result<Block, Error> {
        let Stretch { start: Start { episode, row }, steps } = stretch;
        let halo = Halo { before: self.simulator.history(), after: self.simulator.ahead() };
        Ok(self.source.read(episode, row..row + steps + 1, halo)?)
    }

    /// The measured states at the beginning; `None` where they, or anything that is taken from the recording on the way, are missing.
    pub fn measured_beginning(&self, block: &Block, stretch: Stretch) -> Option<Vec<f64>> {
        let window = Window::new(block, stretch.start, &self.map);
        let finite = |column: usize, from: i64, to: i64| window.values(column, from, to).iter().all(|v| v.is_finite());
        let back = self.simulator.history() as i64;
        let steps = stretch.steps as i64;
        let there = self.simulator.states.iter().all(|state| finite(state.column, -back, 1))
            && self
                .simulator
                .recorded
                .iter()
                .all(|&(column, most, least)| finite(column, -i64::from(most), steps - i64::from(least)));
        let value = |state: &State| window.values(state.column, 0, 1)[0];
        there.then(|| self.simulator.states.iter().map(value).collect())
    }

    /// Simulates a stretch from a beginning (states); `None` where the simulation diverges on the way.
    ///
    /// `gains` are one a state, or none. With them the next step is made from `x_k + K (y_k - x_k)`, K diagonal, if y_k
    /// was measured. A gain of 0 takes nothing from the measurement, and one of 1 begins every step at it. The errors
    /// compare x_k.
    pub fn simulate(&self, block: &Block, stretch: Stretch, beginning: &[f64], gains: &[f64]) -> Option<StretchPath> {
        let window = Window::new(block, stretch.start, &self.map);
        let options = RolloutOptions { horizon: stretch.steps, ..self.options.clone() };
        let mut run = Run::new(self.source, &window, &options);
        (run.beginning, run.gains) = (Some(beginning), gains);
        let run = [run];
        let trajectory = match &self.lean {
            Some(lean) => lean.simulate(&self.simulator, &run[0], beginning, options.method),
            None => general::simulate(&self.simulator, &run, &options).pop()?,
        };
        if trajectory.end != End::Horizon {
            return None;
        }
        let tangents = self.sensitivity.along(&self.simulator, &run[0], &trajectory, options.method, true);
        let (states, rows) = (self.simulator.states.len(), stretch.steps + 1);
        let mut path = StretchPath {
            errors: Vec::with_capacity(rows * states),
            by_coefficients: vec![0.0; rows * states * self.coefficients],
            by_gains: Vec::with_capacity(rows * states * gains.len()),
            by_beginning: Vec::with_capacity(rows * states * states),
        };
        for row in 0..rows {
            for s in 0..states {
                path.errors.push(run[0].error(self.simulator.moved(), s, row, |s| trajectory.state(row)[s]));
                path.by_gains.extend_from_slice(tangents.by_gains(row, s, states));
                path.by_beginning.extend_from_slice(tangents.by_beginning(row, s, states));
                let row_slopes =
                    &mut path.by_coefficients[(row * states + s) * self.coefficients..][..self.coefficients];
                for (&coefficient, &value) in tangents.active.iter().zip(tangents.of(row, s, states)) {
                    row_slopes[coefficient] = value;
                }
            }
        }
        self.leave_out(&run[0], &mut path);
        Some(path)
    }

    /// Leaves the largest part of a recorded quaternion out of the errors, as it follows from the other three. At the
    /// beginning, whose length is free, it stays.
    fn leave_out(&self, run: &Run<'_>, path: &mut StretchPath) {
        let states = self.simulator.states.len();
        let quaternions = self.simulator.geometry.groups.iter().filter(|group| group.kind == RotationKind::Quaternion);
        for group in quaternions {
            for row in 1..path.errors.len() / states {
                let measured = |&place: &usize| {
                    run.window.values(self.simulator.states[place].column, row as i64, row as i64 + 1)[0].abs()
                };
                let largest =
                    group.places.iter().copied().reduce(|a, b| if measured(&b) > measured(&a) { b } else { a });
                largest.into_iter().for_each(|place| path.errors[row * states + place] = f64::NAN);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column as DataColumn, MemorySource};
    use fleetfoot_library::{Expr, Scope};
    use fleetfoot_model::{Column, Equation, Prediction, Role, Training};

    use super::*;
    use crate::Method;

    fn model() -> Model {
        let column = |name: &str, role| Column { angle: name == "q", ..Column::new(name, role) };
        let columns = vec![column("q", Role::State), column("v", Role::State), column("u", Role::Input)];
        let training = Training { state_covariance: vec![1.0, 0.0, 1.0], ..Training::default() };
        let mut model = Model::new("test", columns, 0.05, training);
        model.equations = [("q", "v"), ("v", "u - sin(q) - 0.3*v*abs(v)")]
            .map(|(subject, right)| Equation {
                subject: subject.into(),
                prediction: Prediction::Derivative,
                right: Expr::parse(right, &Scope::open()).unwrap(),
                target: None,
                unit: None,
            })
            .to_vec();
        model
    }

    /// Row by row the equations take the steps that batches take, to the bit, with gains too. The derivatives by the
    /// beginning are those of differences.
    #[test]
    fn lean_steps_match_batches() {
        let mut source = MemorySource::new(["q", "v", "u"].map(DataColumn::float).to_vec());
        let wave = |shift: f64| (0..90).map(|k| (0.3 * f64::from(k) + shift).sin()).collect::<Vec<f64>>();
        source.push_uniform("run", 0.05, vec![wave(0.0), wave(1.0), wave(2.0)]);
        for method in [Method::Rk4, Method::Euler] {
            let options = ShootingOptions { method, ..ShootingOptions::new(1) };
            let mut stretches = Stretches::new(&model(), &source, &[], &options).unwrap();
            assert!(stretches.lean.is_some());
            let stretch = stretches.cut(Some(45))[1];
            assert_eq!((stretch.start.row, stretch.steps), (45, 44));
            let block = stretches.read(stretch).unwrap();
            let beginning = [3.0, 0.7];
            let lean = stretches.simulate(&block, stretch, &beginning, &[]).unwrap();
            let moved = stretches.simulate(&block, stretch, &[3.0, 0.7 + 1e-6], &[]).unwrap();
            let filtered = stretches.simulate(&block, stretch, &beginning, &[0.3, 0.8]).unwrap();
            stretches.lean = None;
            assert_eq!(stretches.simulate(&block, stretch, &beginning, &[]).unwrap(), lean);
            assert_eq!(stretches.simulate(&block, stretch, &beginning, &[0.3, 0.8]).unwrap(), filtered);
            let last = 2 * stretch.steps;
            let slope = (lean.errors[last] - moved.errors[last]) / 1e-6;
            assert!((slope - lean.by_beginning[2 * last + 1]).abs() < 1e-4 * slope.abs().max(1.0), "{slope}");
        }
    }

    /// The filter of the definition, written out; and derivatives by gains and beginning against central differences. A measurement is missing, and an angle goes round.
    #[test]
    fn gains_correct_before_the_step() {
        let mut source = MemorySource::new(["q", "v", "u"].map(DataColumn::float).to_vec());
        let angle = |k: usize| crate::angle::wrap(0.4 * k as f64 + 0.1 * (k as f64 * 1.7).sin());
        let (q, mut v): (Vec<f64>, Vec<f64>) = (0..40).map(|k| (angle(k), 0.4 + (k as f64).sin())).unzip();
        v[17] = f64::NAN;
        let u: Vec<f64> = (0..40).map(|k| (0.2 * k as f64).cos()).collect();
        source.push_uniform("run", 0.05, vec![q.clone(), v.clone(), u.clone()]);
        let options = ShootingOptions { method: Method::Euler, ..ShootingOptions::new(1) };
        let stretches = Stretches::new(&model(), &source, &[], &options).unwrap();
        let stretch = stretches.cut(None)[0];
        let block = stretches.read(stretch).unwrap();
        let (beginning, gains) = ([0.2, 0.1], [0.35, 0.6]);
        let path = stretches.simulate(&block, stretch, &beginning, &gains).unwrap();
        let mut x = beginning;
        for k in 0..40 {
            let errors = [crate::angle::wrap(q[k] - x[0]), v[k] - x[1]];
            for (s, error) in errors.into_iter().enumerate() {
                let simulated = path.errors[2 * k + s];
                assert!(
                    (simulated.is_nan() && error.is_nan()) || (simulated - error).abs() < 1e-12,
                    "{k} {s} {simulated} {error}"
                );
                x[s] += if error.is_nan() { 0.0 } else { gains[s] * error };
            }
            x = [x[0] + 0.05 * x[1], x[1] + 0.05 * (u[k] - x[0].sin() - 0.3 * x[1] * x[1].abs())];
        }
        for method in [Method::Euler, Method::Rk4] {
            let stretches =
                Stretches::new(&model(), &source, &[], &ShootingOptions { method, ..options.clone() }).unwrap();
            let path = stretches.simulate(&block, stretch, &beginning, &gains).unwrap();
            for moved in 0..4 {
                let errors = |h: f64| {
                    let (mut beginning, mut gains) = (beginning, gains);
                    if moved < 2 {
                        gains[moved] += h
                    } else {
                        beginning[moved - 2] += h
                    };
                    stretches.simulate(&block, stretch, &beginning, &gains).unwrap().errors
                };
                let (high, low) = (errors(1e-6), errors(-1e-6));
                let slopes = if moved < 2 { &path.by_gains } else { &path.by_beginning };
                for at in (0..path.errors.len()).filter(|&at| path.errors[at].is_finite()) {
                    // The state is the measurement less the error; truncation and rounding leave some 1e-9.
                    let (slope, difference) = (slopes[2 * at + moved % 2], (low[at] - high[at]) / 2e-6);
                    assert!(
                        (slope - difference).abs() < 1e-8 * slope.abs().max(1.0),
                        "{moved} {at} {slope} {difference}"
                    );
                }
            }
        }
    }
}
