//! Assembly of a simulator: equations compiled, the fast path laid out, a controller bound.

use std::sync::Arc;

use fleetfoot_data::Source;
use fleetfoot_library::Leaf;
use fleetfoot_model::{Closed, Model};

use crate::{
    Error, Simulator, Step,
    affine_kernel::AffineKernel,
    compiled::{Compiled, Latents},
    controller::{Controller, Driver},
    geometry::Geometry,
    integrate::typical_period,
    state::{State, advanced_states},
};

impl Simulator {
    /// Compiles the equations that advance a state, for steps of the model's sampling period.
    ///
    /// # Errors
    /// [`Error::NothingToAdvance`], [`Error::Contradiction`], [`Error::FutureState`], [`Error::Closed`], [`Error::LaggedLatent`],
    /// [`Error::UnknownColumn`], [`Error::Inconsistent`].
    pub fn new(model: &Model) -> Result<Self, Error> {
        Self::compile(model, model.step, &[])
    }

    /// [`Simulator::new`] for steps of a recording: of delays inside of the model they are so many (of first-order lags the steps are those made).
    ///
    /// # Errors
    /// As [`Simulator::new`].
    pub fn for_source(model: &Model, source: &dyn Source, step: Step) -> Result<Self, Error> {
        let period = match step {
            Step::Seconds(seconds) => seconds,
            Step::Median | Step::Stamps => typical_period(source).unwrap_or(model.step),
        };
        Self::compile(model, period, &[])
    }

    /// Compiles for steps of `period` seconds; the columns in `driven` are computed by a controller.
    fn compile(source_model: &Model, period: f64, driven: &[String]) -> Result<Self, Error> {
        source_model.validate().map_err(Error::Inconsistent)?;
        let Closed { model, lags, computed, .. } = &source_model.closed(period, driven)?;
        let (mut states, mut equations) = advanced_states(model)?;
        let names = states.iter().map(|state| model.columns[state.column].name.clone()).collect();
        states.extend(lags.iter().map(State::of_lag));
        equations.extend(lags.iter().map(|lag| &lag.equation));
        let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
        let compiled = Compiled::new(model, &columns, &equations, None)?;
        let first = model.latents.first().and_then(|latent| {
            let partition = |group: &Latents| compiled.partitions[group.regions].partition;
            compiled.groups.iter().find(|group| group.library == latent.library && partition(group) == latent.partition)
        });
        let reported = first.map_or(0, |group| group.regions);
        let mut simulator = Self {
            model: source_model.clone(),
            period,
            columns: model.columns.iter().map(|column| column.name.clone()).collect(),
            names,
            computed: computed.clone(),
            recorded: Vec::new(),
            history: 0,
            ahead: 0,
            kernel: None,
            driver: None,
            reported,
            geometry: Geometry::new(model, &states.iter().map(|state| state.column).collect::<Vec<_>>()),
            states,
            compiled,
        };
        simulator.find_reach()?;
        simulator.kernel = AffineKernel::new(model, &simulator, &equations);
        Ok(simulator)
    }

    /// Finds the rows back and ahead that the equations read.
    fn find_reach(&mut self) -> Result<(), Error> {
        let count = self.columns.len();
        let mut reach: Vec<Option<(i32, i32)>> = vec![None; count];
        for leaf in self.compiled.functions.leaves().iter().chain(self.compiled.rights.leaves()) {
            let (column, lag) = match *leaf {
                Leaf::Column { column, lag } if column < count => (Some(column), lag),
                Leaf::Column { .. } => continue,
                Leaf::Time { lag } => (None, lag),
            };
            self.history = self.history.max(usize::try_from(lag).unwrap_or(0));
            self.ahead = self.ahead.max(usize::try_from(-i64::from(lag)).unwrap_or(0));
            let Some(column) = column else { continue };
            if lag < 0 && self.states.iter().any(|state| state.column == column) {
                return Err(Error::FutureState { state: self.columns[column].clone(), ahead: lag.saturating_neg() });
            }
            let (most, least) = reach[column].unwrap_or((lag, lag));
            reach[column] = Some((most.max(lag), least.min(lag)));
        }
        let advanced = |column: usize| self.states.iter().any(|state| state.column == column);
        self.recorded = (0..count)
            .filter(|&column| !advanced(column))
            .filter_map(|column| reach[column].map(|(most, least)| (column, most, least)))
            .collect();
        Ok(())
    }

    /// Forces the path that evaluates any expression, also where the faster one for affine models would do. The results are the same.
    pub fn general(mut self) -> Self {
        self.kernel = None;
        self
    }

    /// Closes the loop: inputs come from a controller that sees the simulated states, instead of from the recording.
    ///
    /// A driven input is taken from the recording up to the start, where lagged terms and latencies reach back to it.
    ///
    /// # Errors
    /// [`Error::Parameter`]. [`Error::Controller`] for columns that the model does not have, that are advanced states,
    /// or that the controller also reads. [`Error::FutureState`] if the model reads later rows of a driven input.
    pub fn driven_by(self, controller: Arc<dyn Controller>) -> Result<Self, Error> {
        let mut simulator = Self::compile(&self.model, self.period, &controller.drives())?;
        if self.kernel.is_none() {
            simulator.kernel = None;
        }
        simulator.driver = Some(Driver::bind(controller, &mut simulator)?);
        Ok(simulator)
    }
}
