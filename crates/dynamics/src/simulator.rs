//! A model compiled to run free: states advanced by the equations, dependent columns computed, everything else taken
//! from a recording.

use fleetfoot_data::{Halo, Source, nearest};
use fleetfoot_library::{Expr, UnknownColumn};
use fleetfoot_model::Model;

use crate::{
    Error, RolloutOptions, affine_kernel::AffineKernel, compiled::Compiled, controller::Driver, geometry::Geometry,
    run::Run, state::State, window::Window,
};

/// A model compiled for rollouts.
///
/// Columns that follow from simulated states and from inputs are computed ([`Model::closed`]). From the recording it
/// reads the remaining columns ([`Simulator::replayed`]), and the rows up to a start.
pub struct Simulator {
    /// As it was given.
    pub(crate) model: Model,
    /// Seconds of the steps that delays are counted in.
    pub(crate) period: f64,
    pub(crate) columns: Vec<String>,
    /// The states that equations advance, then the first-order lags of computed values.
    pub(crate) states: Vec<State>,
    /// Geometry of these states.
    pub(crate) geometry: Geometry,
    /// Columns that are computed, over the others.
    pub(crate) computed: Vec<(String, Expr)>,
    pub(crate) compiled: Compiled,
    /// Index among the compiled partitions of the one whose regions are reported.
    pub(crate) reported: usize,
    /// Columns that are recorded and used, with the lags at which they are used: `(column, most, least)`.
    pub(crate) recorded: Vec<(usize, i32, i32)>,
    pub(crate) history: usize,
    pub(crate) ahead: usize,
    pub(crate) kernel: Option<AffineKernel>,
    pub(crate) driver: Option<Driver>,
    pub(crate) names: Vec<String>,
}

impl Simulator {
    /// Inputs that a controller drives, in the order of [`Trajectory::inputs`](crate::Trajectory::inputs).
    pub fn driven_inputs(&self) -> &[String] {
        self.driver.as_ref().map_or(&[], |driver| &driver.names)
    }

    /// Returns true if the model runs on the fast path for piecewise-affine models.
    pub fn is_affine(&self) -> bool {
        self.kernel.is_some()
    }

    /// The states that are advanced, in the order of the model's columns.
    pub fn states(&self) -> &[String] {
        &self.names
    }

    /// The reported states, in the order of [`Simulator::states`]; lags come behind them.
    pub(crate) fn shown(&self) -> &[State] {
        &self.states[..self.names.len()]
    }

    /// Columns whose values after a start come from the recording, in the order of the model's columns. They are inputs
    /// that nothing drives, states without an equation, and all others that do not follow from simulated values.
    pub fn replayed(&self) -> Vec<String> {
        let mut columns: Vec<usize> = self.recorded.iter().map(|&(column, ..)| column).collect();
        columns.sort_unstable();
        columns.into_iter().map(|column| self.columns[column].clone()).collect()
    }

    /// The states, and where they live.
    pub(crate) fn moved(&self) -> (&[State], &Geometry) {
        (&self.states, &self.geometry)
    }

    /// Rows needed before and after a start for a rollout of `horizon` steps.
    ///
    /// At least one row before, for the constant-velocity baseline.
    pub fn needed_rows(&self, horizon: usize) -> Halo {
        Halo { before: self.history.max(1), after: horizon.max(horizon.saturating_add(self.ahead).saturating_sub(1)) }
    }

    pub(crate) fn history(&self) -> usize {
        self.history
    }

    pub(crate) fn ahead(&self) -> usize {
        self.ahead
    }

    /// Seconds from a start after each step, horizon + 1 values.
    pub(crate) fn times(&self, source: &dyn Source, window: &Window<'_>, options: &RolloutOptions) -> Vec<f64> {
        Run::new(source, window, options).time
    }

    /// The source's index of each column of the model; of a column that neither a state nor an equation needs, `usize::MAX` if absent.
    pub(crate) fn column_map(&self, source: &dyn Source) -> Result<Vec<usize>, Error> {
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        let needed = |column: usize| {
            self.states.iter().any(|state| state.column == column)
                || self.recorded.iter().any(|r| r.0 == column)
                || self.driver.as_ref().is_some_and(|driver| driver.drives.iter().any(|d| d.0 == column))
        };
        let mut map = Vec::with_capacity(self.columns.len());
        for (column, name) in self.columns.iter().enumerate() {
            match names.iter().position(|known| known == name) {
                Some(index) => map.push(index),
                None if !needed(column) => map.push(usize::MAX),
                None => {
                    let nearest = nearest(name, names.iter().copied());
                    return Err(UnknownColumn { name: name.clone(), nearest }.into());
                }
            }
        }
        Ok(map)
    }

    /// Returns true if everything that a rollout reads is finite.
    pub(crate) fn is_complete(&self, window: &Window<'_>, horizon: usize) -> bool {
        let back = self.history.max(1) as i64;
        let finite = |column: usize, from: i64, to: i64| window.values(column, from, to).iter().all(|v| v.is_finite());
        self.states.iter().all(|state| finite(state.column, -back, 1))
            && self
                .recorded
                .iter()
                .all(|&(column, most, least)| finite(column, -i64::from(most), horizon as i64 - i64::from(least)))
            && self.driver.as_ref().is_none_or(|driver| driver.is_complete(window))
    }
}
