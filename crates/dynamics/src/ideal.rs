//! Paths of the states that follow their references, beside a recording.

use fleetfoot_data::{Source, nearest};
use fleetfoot_library::{Expr, Program, Scratch, UnknownColumn};
use fleetfoot_model::Model;

use crate::{Error, Reference, Simulator, baseline::evaluate, window::Window};

/// References compiled for a recording.
pub(crate) struct References {
    program: Program,
    /// State of each output, and whether it is a rate.
    states: Vec<(usize, bool)>,
}

impl References {
    /// `None` without references.
    ///
    /// # Errors
    /// [`Error::UnknownColumn`] for a state that is not advanced or a column that is not recorded, and
    /// [`Error::Reference`] for a part of a rotation or a state with two references.
    pub(crate) fn compile(
        model: &Model,
        simulator: &Simulator,
        references: &[Reference],
        source: &dyn Source,
    ) -> Result<Option<Self>, Error> {
        let names = simulator.states();
        let mut states: Vec<(usize, bool)> = Vec::new();
        for reference in references {
            let refused = |problem: &str| Error::Reference {
                text: format!("{}=...", reference.state),
                problem: problem.to_owned(),
            };
            let state = names.iter().position(|name| *name == reference.state).ok_or_else(|| {
                let nearest = nearest(&reference.state, names.iter().map(String::as_str));
                Error::from(UnknownColumn { name: reference.state.clone(), nearest })
            })?;
            let column = simulator.shown()[state].column;
            if model.rotations().iter().any(|rotation| rotation.columns.contains(&column)) {
                return Err(refused("names a part of a rotation; use angles or positions"));
            }
            if states.iter().any(|&(known, _)| known == state) {
                return Err(refused("gives this state a second reference; keep one"));
            }
            states.push((state, reference.rate));
        }
        let columns: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        let values: Vec<Expr> = references.iter().map(|reference| reference.value.clone()).collect();
        let program = Program::compile(&values, &columns)?;
        Ok((!states.is_empty()).then_some(Self { program, states }))
    }

    /// Values of each state from the row before the start to the horizon, as those of `measured`; NaN of states without
    /// a reference.
    pub(crate) fn paths(&self, window: &Window<'_>, time: &[f64], measured: &[&[f64]]) -> Vec<Vec<f64>> {
        let steps = time.len() - 1;
        let rows = window.at..window.at + steps;
        let (mut values, mut scratch) = (Vec::new(), Scratch::default());
        evaluate(&self.program, window.block, &rows, &mut values, &mut scratch);
        let mut paths: Vec<Vec<f64>> = measured.iter().map(|series| vec![f64::NAN; series.len()]).collect();
        for (&(state, rate), value) in self.states.iter().zip(values.chunks_exact(steps.max(1))) {
            let path = &mut paths[state];
            path[..2].copy_from_slice(&measured[state][..2]);
            for k in 1..=steps {
                let reference = value[k - 1];
                path[k + 1] = if rate { reference.mul_add(time[k] - time[k - 1], path[k]) } else { reference };
            }
        }
        paths
    }
}
