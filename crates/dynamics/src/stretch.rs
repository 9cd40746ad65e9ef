//! Stretches of a recording, simulated from beginnings that are unknowns themselves: what output-error methods are made of.
//!
//! A segment of [`Shooting`](crate::Shooting) begins at its measured state, noise and all. Here the beginning is given, the errors are those of all rows of the
//! stretch, its first one too, and they have derivatives by the model's coefficients and by the beginning.

use fleetfoot_data::{Block, Halo, Source};
use fleetfoot_model::Model;

use crate::{
    Coefficient, End, Error, RolloutOptions, ShootingOptions, Simulator, Start, angle::wrap, general, lean::Lean,
    sensitivity::Sensitivity, simulator::Run, window::Window,
};

/// Consecutive rows of an episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stretch {
    /// The first row.
    pub start: Start,
    /// Steps from there: one row less than there are.
    pub steps: usize,
}

/// What a simulation through a stretch leaves.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct StretchPath {
    /// Measured less simulated, rows x states; NaN where nothing was measured. Those of angles are in (-pi, pi].
    pub errors: Vec<f64>,
    /// Derivatives of the simulated states by the coefficients, rows x states x coefficients.
    pub by_coefficients: Vec<f64>,
    /// Derivatives of the simulated states by those of the beginning, rows x states x states.
    pub by_beginning: Vec<f64>,
}

/// A model on stretches of a recording.
pub struct Stretches<'a> {
    source: &'a dyn Source,
    simulator: Simulator,
    /// Where the equations allow it.
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

    /// The states that are simulated, in the order of everything that speaks of states here.
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
        let value = |state: &crate::simulator::State| window.values(state.column, 0, 1)[0];
        there.then(|| self.simulator.states.iter().map(value).collect())
    }

    /// Simulates a stretch from a beginning (states); `None` where the simulation diverges on the way.
    pub fn simulate(&self, block: &Block, stretch: Stretch, beginning: &[f64]) -> Option<StretchPath> {
        let window = Window::new(block, stretch.start, &self.map);
        let options = RolloutOptions { horizon: stretch.steps, ..self.options.clone() };
        let mut run = Run::new(self.source, &window, &options);
        run.beginning = Some(beginning);
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
            by_beginning: Vec::with_capacity(rows * states * states),
        };
        for row in 0..rows {
            for (s, state) in self.simulator.states.iter().enumerate() {
                let error = window.values(state.column, row as i64, row as i64 + 1)[0] - trajectory.state(row)[s];
                path.errors.push(if state.advance.angle { wrap(error) } else { error });
                path.by_beginning.extend_from_slice(tangents.by_beginning(row, s, states));
                let own = &mut path.by_coefficients[(row * states + s) * self.coefficients..][..self.coefficients];
                for (&coefficient, &value) in tangents.active.iter().zip(tangents.of(row, s, states)) {
                    own[coefficient] = value;
                }
            }
        }
        Some(path)
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
        let column =
            |name: &str, role| Column { name: name.into(), source: name.into(), unit: None, role, angle: name == "q" };
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

    /// Row by row the equations take the steps that batches take, to the bit; and the derivatives by the beginning are those of differences.
    #[test]
    fn lean_steps_are_those_of_batches() {
        let mut source = MemorySource::new(["q", "v", "u"].map(DataColumn::float).to_vec());
        let wave = |shift: f64| (0..90).map(|k| (0.3 * f64::from(k) + shift).sin()).collect::<Vec<f64>>();
        source.push_uniform("run", 0.05, vec![wave(0.0), wave(1.0), wave(2.0)]);
        for method in [Method::Rk4, Method::Euler] {
            let options = ShootingOptions { method, ..ShootingOptions::new(1) };
            let mut own = Stretches::new(&model(), &source, &[], &options).unwrap();
            assert!(own.lean.is_some());
            let stretch = own.cut(Some(45))[1];
            assert_eq!((stretch.start.row, stretch.steps), (45, 44));
            let block = own.read(stretch).unwrap();
            let beginning = [3.0, 0.7];
            let lean = own.simulate(&block, stretch, &beginning).unwrap();
            let moved = own.simulate(&block, stretch, &[3.0, 0.7 + 1e-6]).unwrap();
            own.lean = None;
            assert_eq!(own.simulate(&block, stretch, &beginning).unwrap(), lean);
            let last = 2 * stretch.steps;
            let slope = (lean.errors[last] - moved.errors[last]) / 1e-6;
            assert!((slope - lean.by_beginning[2 * last + 1]).abs() < 1e-4 * slope.abs().max(1.0), "{slope}");
        }
    }
}
