//! A model on values at hand: right sides, regions and steps, without a recording.

use fleetfoot_library::Leaf;
use fleetfoot_model::{Closed, Equation, FirstOrderLag, Model, Prediction, Role};

use crate::{
    Error, Method, Points,
    compiled::{Compiled, Workspace},
    geometry::Geometry,
    integrate::runge_kutta_mean,
    state::{State, advanced},
};

/// A model compiled for values at hand ([`Points`]). Its numbers are, bit for bit, those of [`crate::Simulator`] and [`crate::Predictor`] on a recording.
///
/// Columns that follow from states, inputs and time are computed ([`Model::closed`]): they are no inputs. First-order
/// lags of computed values are further states, behind those that equations advance.
pub struct Stepper {
    /// The model whose equations are evaluated.
    pub(crate) model: Model,
    pub(crate) lags: Vec<FirstOrderLag>,
    names: Vec<String>,
    pub(crate) states: Vec<State>,
    /// Geometry of these states.
    pub(crate) geometry: Geometry,
    pub(crate) inputs: Vec<usize>,
    /// Index of the right side of every fitted equation.
    fitted: Vec<usize>,
    pub(crate) compiled: Compiled,
    reported: usize,
    history: usize,
    ahead: usize,
    uses_time: bool,
    step: f64,
}

/// Memory of a [`Stepper`], reused from call to call.
#[derive(Default)]
pub struct StepperWorkspace {
    pub(crate) model: Workspace,
    next: Vec<f64>,
    present: Vec<f64>,
    stages: [Vec<f64>; 4],
}

impl Stepper {
    /// Compiles all equations of a model.
    ///
    /// # Errors
    /// [`Error::Inconsistent`], [`Error::Contradiction`], [`Error::FutureState`], [`Error::Closed`], [`Error::LaggedLatent`], [`Error::UnknownColumn`].
    pub fn new(model: &Model) -> Result<Self, Error> {
        Self::compile(model, false)
    }

    /// The same of a model that may read inputs of later rows, which a simulation and a run of rows have ([`Self::ahead`]).
    ///
    /// # Errors
    /// As [`Self::new`]; [`Error::FutureState`] for states alone.
    pub fn looking_ahead(model: &Model) -> Result<Self, Error> {
        Self::compile(model, true)
    }

    fn compile(model: &Model, may_look_ahead: bool) -> Result<Self, Error> {
        model.validate().map_err(Error::Inconsistent)?;
        let Closed { model, lags, computed, .. } = &model.closed(model.step, &[])?;
        let (mut states, mut equations) = advanced(model)?;
        states.extend(lags.iter().map(State::of_lag));
        equations.extend(lags.iter().map(|lag| &lag.equation));
        equations.extend(model.equations.iter().filter(|equation| equation.prediction == Prediction::Value));
        let names: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
        let compiled = Compiled::new(model, &names, &equations, None)?;
        let mut read = vec![false; names.len()];
        let (mut history, mut ahead, mut uses_time) = (0, 0, false);
        let is_state = |column: usize| states.iter().any(|state| state.column == column);
        for leaf in compiled.functions.leaves().iter().chain(compiled.rights.leaves()) {
            match *leaf {
                Leaf::Column { column, .. } if column >= names.len() => continue,
                Leaf::Column { column, .. } => read[column] = true,
                Leaf::Time { .. } => uses_time = true,
            }
            let lag = leaf.lag();
            let (name, known) = match *leaf {
                Leaf::Column { column, .. } => (names[column], !is_state(column)),
                Leaf::Time { .. } => ("time()", true),
            };
            if lag < 0 && !(known && may_look_ahead) {
                return Err(Error::FutureState { state: name.to_owned(), ahead: lag.saturating_neg() });
            }
            history = history.max(usize::try_from(lag).unwrap_or(0));
            ahead = ahead.max(usize::try_from(-i64::from(lag)).unwrap_or(0));
        }
        let inputs = (0..names.len())
            .filter(|&column| states.iter().all(|state| state.column != column))
            .filter(|&column| read[column] || model.columns[column].role != Role::Auxiliary)
            .filter(|&column| computed.iter().all(|(name, _)| *name != model.columns[column].name))
            .collect();
        let same = |equation: &Equation| equations.iter().position(|candidate| std::ptr::eq(*candidate, equation));
        let fitted = model.fitted().filter_map(same).collect();
        let first = model.latents.first();
        let reported =
            first.and_then(|latent| compiled.partitions.iter().position(|p| p.partition == latent.partition));
        Ok(Self {
            model: model.clone(),
            lags: lags.clone(),
            geometry: Geometry::new(model, &states.iter().map(|state| state.column).collect::<Vec<_>>()),
            states,
            inputs,
            fitted,
            reported: reported.unwrap_or(0),
            history,
            ahead,
            uses_time,
            step: model.step,
            compiled,
            names: names.into_iter().map(str::to_owned).collect(),
        })
    }

    /// The states that equations advance, in the order of the model's columns, then first-order lags.
    pub fn states(&self) -> impl ExactSizeIterator<Item = &str> {
        self.states.iter().map(|state| self.names[state.column].as_str())
    }

    /// Names of the values given from outside, in the order of the model's columns. They are inputs, states that no
    /// equation advances, and other columns that it reads and cannot compute. Fields that computed columns read follow
    /// them.
    pub fn inputs(&self) -> impl ExactSizeIterator<Item = &str> {
        self.inputs.iter().map(|&column| self.names[column].as_str())
    }

    /// Index of each state among the model's columns.
    pub fn state_column(&self, state: usize) -> usize {
        self.states[state].column
    }

    /// Index of each input among the model's columns.
    pub fn input_column(&self, input: usize) -> usize {
        self.inputs[input]
    }

    /// Number of fitted equations, and of the values of [`Self::fitted`].
    pub fn targets(&self) -> usize {
        self.fitted.len()
    }

    /// Rows that the equations look back.
    pub fn history(&self) -> usize {
        self.history
    }

    /// Rows that the equations look ahead at inputs; 0 but for [`Self::looking_ahead`].
    pub fn ahead(&self) -> usize {
        self.ahead
    }

    /// Returns true if the equations contain the time.
    pub fn uses_time(&self) -> bool {
        self.uses_time
    }

    /// The model's sampling period, seconds; 0 where it is not known.
    pub fn step(&self) -> f64 {
        self.step
    }

    /// Returns true if a derivative is integrated.
    pub fn is_continuous(&self) -> bool {
        self.states.iter().any(|state| state.advance.continuous)
    }

    /// Returns true if some states are first-order lags of computed values.
    pub fn has_lags(&self) -> bool {
        !self.lags.is_empty()
    }

    /// Returns true if derivatives are integrated of some states, while others have a next value or a difference.
    pub fn is_mixed(&self) -> bool {
        let continuous = self.is_continuous();
        self.states.iter().any(|state| state.advance.continuous != continuous)
    }

    /// The standard deviation of a state in training; 1 where that is not known, or zero.
    pub fn state_size(&self, state: usize) -> f64 {
        self.states[state].size()
    }

    /// Index of a state among the columns with role State, as the training's covariance has them; `None` where it is not one.
    pub fn state_order(&self, state: usize) -> Option<usize> {
        self.states[state].order
    }

    /// Geometry of the states.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// The model as it is evaluated: closed, its first-order lags and computed columns among its columns.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Zeros for this many points.
    pub fn points(&self, count: usize) -> Points {
        Points::reaching(count, self.names.len(), self.history, self.ahead)
    }

    /// Evaluates all equations at the points.
    pub fn evaluate(&self, points: &Points, workspace: &mut StepperWorkspace) {
        self.compiled.evaluate(points.count(), &|leaf| points.leaf(leaf), &mut workspace.model);
    }

    /// The right side of a state's equation after [`Self::evaluate`]: its derivative, difference or next value at each of `count` points; NaN where no region holds.
    pub fn right_side<'a>(&self, state: usize, count: usize, workspace: &'a StepperWorkspace) -> &'a [f64] {
        &workspace.model.outputs[state * workspace.model.stride..][..count]
    }

    /// The right side of a fitted equation after [`Self::evaluate`].
    pub fn fitted<'a>(&self, target: usize, count: usize, workspace: &'a StepperWorkspace) -> &'a [f64] {
        self.right_side(self.fitted[target], count, workspace)
    }

    /// The regions of the points in the first latent's partition, after [`Self::evaluate`]; `u32::MAX` for none. Empty for a model without latents.
    pub fn regions<'a>(&self, workspace: &'a StepperWorkspace) -> &'a [u32] {
        workspace.model.regions.get(self.reported).map_or(&[], Vec::as_slice)
    }

    /// The states one step of `seconds` later (states x points). Recorded columns are held; derivatives are integrated by `method`,
    /// differences and next values are those of one sample.
    pub fn next<'a>(
        &self,
        points: &mut Points,
        seconds: f64,
        method: Method,
        workspace: &'a mut StepperWorkspace,
    ) -> &'a [f64] {
        let count = points.count();
        self.evaluate(points, workspace);
        let mut slopes = self.slopes(workspace, count, 0);
        if method == Method::Rk4 && self.is_continuous() {
            slopes = self.refined(points, seconds, slopes, workspace);
        }
        let mut next = std::mem::take(&mut workspace.next);
        next.clear();
        for (s, state) in self.states.iter().enumerate() {
            let x = points.column(state.column, 0);
            next.extend(x.iter().zip(&slopes[s * count..]).map(|(&x, &slope)| state.advance.next(x, slope, seconds)));
        }
        for b in 0..count {
            self.geometry.retract(&mut next, |s| s * count + b);
        }
        workspace.stages[0] = slopes;
        workspace.next = next;
        &workspace.next
    }

    /// The states' right sides, copied into the memory of a stage.
    fn slopes(&self, workspace: &mut StepperWorkspace, count: usize, stage: usize) -> Vec<f64> {
        let mut slopes = std::mem::take(&mut workspace.stages[stage]);
        slopes.clear();
        for state in 0..self.states.len() {
            slopes.extend_from_slice(self.right_side(state, count, workspace));
        }
        slopes
    }

    /// Slopes of the continuous states by the classical Runge-Kutta method, given those at the points.
    fn refined(
        &self,
        points: &mut Points,
        seconds: f64,
        mut first: Vec<f64>,
        workspace: &mut StepperWorkspace,
    ) -> Vec<f64> {
        let count = points.count();
        let mut present = std::mem::take(&mut workspace.present);
        present.clear();
        for state in &self.states {
            present.extend_from_slice(points.column(state.column, 0));
        }
        let mut stages = [Vec::new(), Vec::new(), Vec::new()];
        for stage in 0..3 {
            let offset = seconds * if stage == 2 { 1.0 } else { 0.5 };
            let before: &[f64] = if stage == 0 { &first } else { &stages[stage - 1] };
            self.move_states(points, &present, before, offset);
            points.wait(offset);
            self.evaluate(points, workspace);
            points.wait(-offset);
            stages[stage] = self.slopes(workspace, count, stage + 1);
        }
        for (s, state) in self.states.iter().enumerate() {
            let place = s * count..(s + 1) * count;
            points.column_mut(state.column, 0).copy_from_slice(&present[place.clone()]);
            if state.advance.continuous {
                for i in place {
                    first[i] = runge_kutta_mean([first[i], stages[0][i], stages[1][i], stages[2][i]]);
                }
            }
        }
        workspace.present = present;
        for (kept, stage) in workspace.stages[1..].iter_mut().zip(stages) {
            *kept = stage;
        }
        first
    }

    /// `x + offset * slope` for the continuous states.
    pub(crate) fn move_states(&self, points: &mut Points, present: &[f64], slopes: &[f64], offset: f64) {
        let count = points.count();
        for (s, state) in self.states.iter().enumerate() {
            let column = points.column_mut(state.column, 0);
            for (b, value) in column.iter_mut().enumerate() {
                let slope = if state.advance.continuous { slopes[s * count + b] } else { 0.0 };
                *value = offset.mul_add(slope, present[s * count + b]);
            }
        }
    }
}
