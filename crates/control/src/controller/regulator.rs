//! A linear law about a set point, region by region.

mod prediction;
mod predictor;

use fleetfoot_library::{Expr, Leaf, Program, Scope, Scratch};
use fleetfoot_model::{RotationKind, Rule};
use serde::{Deserialize, Serialize};

use super::{Controller, ControllerState, ParameterError, check};
use fleetfoot_dynamics::wrap;
pub use prediction::{ErrorBound, MOST_SAMPLES, PredictedStep, PredictedTarget, Prediction, PredictionTables};
pub use predictor::MOST_SEQUENCES;
use predictor::Predictor;

/// Stamps closer than this count as equal, s.
const SAME: f64 = 1e-9;

/// Feedback of states about a set point, with gains for every region of a partition:
/// `u = u_i - K_i (x - x*) - L_i z - F_i (w - w*)` within limits. Here i is the region of the present row, z the
/// integral of the error of some states, and w the measurements beside the states. The error of a rotation q is the
/// vector `Log(q*^-1 q)`, rad about the axes of the body, which turns its set point into it.
///
/// It is evaluated every `period` and held. At a limit the integral does not grow further outwards (conditional integration). Where no region holds, or something is missing, inputs and
/// integrals stay as they are. It is plain data, so that the same law drives models, simulated robots and exported code.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Regulator {
    /// Seconds between commands.
    pub period: f64,
    /// The states that are fed back, each an error.
    pub states: Vec<RegulatedState>,
    /// The rotations that are, each three errors behind those of the states: n errors in all.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub rotations: Vec<RegulatedRotation>,
    /// The inputs that are driven, m of them.
    pub inputs: Vec<DrivenInput>,
    /// Further columns that are read, k of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured: Vec<MeasuredColumn>,
    /// Errors that are integrated, indices, q of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub integrated: Vec<usize>,
    /// Choice of the region; `None`: there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub partition: Option<RegionChoice>,
    /// One a region.
    pub laws: Vec<RegionLaw>,
    /// Prediction, which makes the controller predictive: it plans inputs within their limits over a horizon, and the
    /// laws' cost ends the plan.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub prediction: Option<Prediction>,
}

/// A state that is fed back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegulatedState {
    /// Its column.
    pub name: String,
    /// Its set point.
    pub at: f64,
    /// Typical deviation: its standard deviation in training, 1 if that is unknown. Exported code is tested within
    /// twice that.
    pub size: f64,
    /// True if its error is taken within half a turn.
    #[serde(default)]
    pub angle: bool,
}

/// A rotation that is fed back.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegulatedRotation {
    /// Its name.
    pub name: String,
    /// Representation of the rotation in its columns.
    pub kind: RotationKind,
    /// Its columns, in the order of [`RotationKind::letters`].
    pub columns: Vec<String>,
    /// Its set point, in its columns.
    pub at: Vec<f64>,
    /// Typical deviation, rad about each axis of the body: standard deviations in training, 1 if they are unknown.
    pub size: [f64; 3],
}

/// An input that is driven.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DrivenInput {
    /// Its column.
    pub name: String,
    /// Lowest value.
    pub lowest: f64,
    /// Highest value.
    pub highest: f64,
}

/// A further column that is read.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MeasuredColumn {
    /// Its name.
    pub name: String,
    /// The value that the set point was found for.
    pub at: f64,
    /// Its standard deviation in training, 1 where that is not known.
    pub size: f64,
}

/// Choice of a row's region: [`fleetfoot_model::Partition`] without the names of its regions.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionChoice {
    /// Partition columns: expressions over columns.
    pub columns: Vec<String>,
    /// Subtracted from each.
    pub centre: Vec<f64>,
    /// Divides each.
    pub scale: Vec<f64>,
    /// Rule that gives the region.
    pub rule: Rule,
}

/// The law of a region; matrices by rows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RegionLaw {
    /// The inputs at the set point (m).
    pub inputs: Vec<f64>,
    /// K (m x n).
    pub gain: Vec<Vec<f64>>,
    /// L (m x q).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub integral: Vec<Vec<f64>>,
    /// F (m x k).
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub measured: Vec<Vec<f64>>,
}

impl RegionChoice {
    /// The columns, parsed.
    fn parsed(&self) -> Option<Vec<Expr>> {
        self.columns.iter().map(|text| Expr::parse(text, &Scope::open()).ok()).collect()
    }

    /// The columns that it reads; `None` if they cannot be read at the present row.
    fn reads(&self) -> Option<Vec<String>> {
        let mut names: Vec<String> = Vec::new();
        for expression in self.parsed()? {
            for (name, lag) in expression.reads() {
                let name = name.filter(|_| lag == 0)?.to_string();
                if !names.contains(&name) {
                    names.push(name);
                }
            }
        }
        Some(names)
    }
}

impl Regulator {
    /// The names of the errors: those of the states, and `NAME about x`, `y` and `z` of a rotation.
    pub fn errors(&self) -> Vec<String> {
        let axes = self
            .rotations
            .iter()
            .flat_map(|rotation| ["x", "y", "z"].map(|axis| format!("{} about {axis}", rotation.name)));
        self.states.iter().map(|state| state.name.clone()).chain(axes).collect()
    }

    /// Typical deviation of each error.
    pub fn sizes(&self) -> Vec<f64> {
        self.states
            .iter()
            .map(|state| state.size)
            .chain(self.rotations.iter().flat_map(|rotation| rotation.size))
            .collect()
    }

    /// The errors of states and rotations in this row of the columns that it reads.
    fn errors_in(&self, columns: &[f64], errors: &mut [f64]) {
        for ((error, state), value) in errors.iter_mut().zip(&self.states).zip(columns) {
            let off = value - state.at;
            *error = if state.angle { wrap(off) } else { off };
        }
        let mut columns = &columns[self.states.len()..];
        for (rotation, errors) in self.rotations.iter().zip(errors[self.states.len()..].chunks_exact_mut(3)) {
            let (parts, rest) = columns.split_at(rotation.columns.len());
            errors.copy_from_slice(&rotation.kind.difference(parts, &rotation.at));
            columns = rest;
        }
    }

    /// Columns that states and rotations are read from.
    fn state_columns(&self) -> impl Iterator<Item = &String> {
        self.states.iter().map(|state| &state.name).chain(self.rotations.iter().flat_map(|rotation| &rotation.columns))
    }

    /// Columns that decide the region and are neither states nor inputs nor measured.
    fn choosing(&self) -> Vec<String> {
        let known = |name: &String| {
            self.state_columns().any(|column| column == name)
                || self.measured.iter().any(|column| column.name == *name)
                || self.inputs.iter().any(|input| input.name == *name)
        };
        let reads = self.partition.as_ref().and_then(RegionChoice::reads).unwrap_or_default();
        reads.into_iter().filter(|name| !known(name)).collect()
    }

    /// Compiled partition columns, with the place of every leaf among the read columns or the inputs behind them.
    fn compiled(&self) -> Option<Chooser> {
        let partition = self.partition.as_ref()?;
        let names: Vec<String> =
            self.reads().into_iter().chain(self.inputs.iter().map(|input| input.name.clone())).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let program = Program::compile(&partition.parsed()?, &names).ok()?;
        let leaf = |leaf: &Leaf| match *leaf {
            Leaf::Column { column, lag: 0 } => Some(column),
            _ => None,
        };
        let leaves = program.leaves().iter().map(leaf).collect::<Option<Vec<_>>>()?;
        let values = vec![0.0; partition.columns.len()];
        let (centre, scale) = (partition.centre.clone(), partition.scale.clone());
        Some(Chooser {
            program,
            leaves,
            centre,
            scale,
            rule: partition.rule.clone(),
            values,
            scratch: Scratch::default(),
        })
    }

    fn check_shapes(&self) -> Result<(), ParameterError> {
        let (n, m, q, k) = (self.sizes().len(), self.inputs.len(), self.integrated.len(), self.measured.len());
        let is = |rows: &Vec<Vec<f64>>, columns: usize| {
            (columns == 0 && rows.is_empty()) || (rows.len() == m && rows.iter().all(|row| row.len() == columns))
        };
        for (i, law) in self.laws.iter().enumerate() {
            let shapes = law.inputs.len() == m && is(&law.gain, n) && is(&law.integral, q) && is(&law.measured, k);
            let numbers = law.gain.iter().chain(&law.integral).chain(&law.measured).flatten().chain(&law.inputs);
            if !shapes || numbers.clone().any(|value| !value.is_finite()) {
                let allowed =
                    format!("finite gains of {m} inputs by {n} errors, {q} integrals and {k} measured columns");
                return Err(ParameterError::new("laws", format!("that of region {i}"), allowed));
            }
        }
        let regions = self.partition.as_ref().map_or(1, |partition| partition.rule.count());
        if self.laws.len() != regions {
            return Err(ParameterError::new("laws", self.laws.len(), format!("{regions}, one a region")));
        }
        match self.integrated.iter().find(|&&state| state >= n) {
            Some(state) => Err(ParameterError::new("integrated", state, format!("the index of one of {n} errors"))),
            None => Ok(()),
        }
    }
}

impl Controller for Regulator {
    fn reads(&self) -> Vec<String> {
        let states = self.state_columns().cloned();
        states.chain(self.measured.iter().map(|column| column.name.clone())).chain(self.choosing()).collect()
    }

    fn drives(&self) -> Vec<String> {
        self.inputs.iter().map(|input| input.name.clone()).collect()
    }

    fn validate(&self) -> Result<(), ParameterError> {
        check("period", self.period, self.period > 0.0, "a positive time in s")?;
        if self.inputs.is_empty() {
            return Err(ParameterError::new("inputs", "none", "at least one"));
        }
        for input in &self.inputs {
            let allowed = "a number not below `lowest`";
            check(&format!("{}.highest", input.name), input.highest, input.highest >= input.lowest, allowed)?;
        }
        let states = self.states.iter().map(|state| (&state.name, state.at, state.size));
        for (name, at, size) in states.chain(self.measured.iter().map(|column| (&column.name, column.at, column.size)))
        {
            check(&format!("{name}.at"), at, true, "a finite number")?;
            check(&format!("{name}.size"), size, size > 0.0, "a positive number")?;
        }
        for rotation in &self.rotations {
            let length = rotation.at.iter().map(|part| part * part).sum::<f64>().sqrt();
            let is_one = rotation.kind == RotationKind::Vector || (length - 1.0).abs() < 1e-6;
            if rotation.columns.len() != rotation.kind.parts()
                || rotation.at.len() != rotation.kind.parts()
                || !length.is_finite()
                || !is_one
            {
                let allowed = format!("the {} parts of a {}", rotation.kind.parts(), rotation.kind.word());
                return Err(ParameterError::new(
                    &format!("{}.at", rotation.name),
                    format!("{:?}", rotation.at),
                    allowed,
                ));
            }
            for size in rotation.size {
                check(&format!("{}.size", rotation.name), size, size > 0.0, "a positive number")?;
            }
        }
        if let Some(partition) = &self.partition {
            let columns = partition.columns.len();
            let shapes = partition.centre.len() == columns && partition.scale.len() == columns;
            if !shapes || !partition.rule.fits(columns) || self.compiled().is_none() {
                let allowed = "expressions over columns at the present row, with a centre and a scale each";
                return Err(ParameterError::new("partition", partition.columns.join(", "), allowed));
            }
        }
        self.check_shapes()?;
        self.prediction.as_ref().map_or(Ok(()), |prediction| prediction.validate(self))
    }

    fn start(&self) -> Box<dyn ControllerState> {
        Box::new(RegulatorState {
            law: self.clone(),
            chooser: self.compiled(),
            predictor: self.prediction_tables().map(Predictor::new),
            next: 0.0,
            integrals: vec![0.0; self.integrated.len()],
            errors: vec![0.0; self.sizes().len()],
        })
    }
}

/// The region of a row, computed.
struct Chooser {
    program: Program,
    leaves: Vec<usize>,
    centre: Vec<f64>,
    scale: Vec<f64>,
    rule: Rule,
    values: Vec<f64>,
    scratch: Scratch,
}

impl Chooser {
    fn region(&mut self, columns: &[f64], inputs: &[f64]) -> Option<usize> {
        let leaf = |&at: &usize| columns.get(at).copied().unwrap_or_else(|| inputs[at - columns.len()]);
        let leaves: Vec<f64> = self.leaves.iter().map(leaf).collect();
        self.program.evaluate_row(&leaves, &mut self.values, &mut self.scratch);
        for ((value, centre), scale) in self.values.iter_mut().zip(&self.centre).zip(&self.scale) {
            *value = (*value - centre) / scale;
        }
        self.rule.assign_row(&self.values).map(|region| region as usize)
    }
}

struct RegulatorState {
    law: Regulator,
    chooser: Option<Chooser>,
    predictor: Option<Predictor>,
    /// The number of the next sample.
    next: f64,
    integrals: Vec<f64>,
    errors: Vec<f64>,
}

impl ControllerState for RegulatorState {
    fn control(&mut self, seconds: f64, columns: &[f64], inputs: &mut [f64]) {
        let tick = ((seconds + SAME) / self.law.period).floor();
        if tick < self.next {
            return;
        }
        self.next = tick + 1.0;
        let region = match &mut self.chooser {
            Some(chooser) => chooser.region(columns, inputs),
            None => Some(0),
        };
        let Some(region) = region else { return };
        self.law.errors_in(columns, &mut self.errors);
        let measured = &columns[self.law.state_columns().count()..][..self.law.measured.len()];
        if self.errors.iter().chain(measured).any(|value| !value.is_finite()) {
            return;
        }
        if self.predictor.is_some() {
            self.predict(region, columns, inputs);
            return;
        }
        let Some(law) = self.law.laws.get(region) else { return };
        let wanted = |integrals: &[f64], j: usize| {
            let mut value = law.inputs[j];
            for (gain, error) in law.gain[j].iter().zip(&self.errors) {
                value -= gain * error;
            }
            for (gain, integral) in law.integral.get(j).into_iter().flatten().zip(integrals) {
                value -= gain * integral;
            }
            for ((gain, column), value_of) in
                law.measured.get(j).into_iter().flatten().zip(&self.law.measured).zip(measured)
            {
                value -= gain * (value_of - column.at);
            }
            value
        };
        let grown = self.grown();
        // True if a longer integral would push a saturated input further outwards.
        let outwards = self.law.inputs.iter().enumerate().any(|(j, input)| {
            let (now, then) = (wanted(&self.integrals, j), wanted(&grown, j));
            (then > input.highest && then > now) || (then < input.lowest && then < now)
        });
        if !outwards {
            self.integrals = grown;
        }
        for (j, (value, input)) in inputs.iter_mut().zip(&self.law.inputs).enumerate() {
            let wanted = wanted(&self.integrals, j);
            *value = wanted.max(input.lowest).min(input.highest);
        }
    }
}

impl RegulatorState {
    /// The integrals after the present sample.
    fn grown(&self) -> Vec<f64> {
        let integrated = self.law.integrated.iter().zip(&self.integrals);
        integrated.map(|(&state, integral)| self.law.period.mul_add(self.errors[state], *integral)).collect()
    }

    /// The commands of a plan from the present errors; `inputs` come with the commands of the sample before.
    ///
    /// Partition columns that are no states and no inputs keep their present values along the plan.
    fn predict(&mut self, region: usize, columns: &[f64], inputs: &mut [f64]) {
        let grown = self.grown();
        // True if the regulator's feedback of longer integrals would push a saturated input further outwards.
        let law = &self.law.laws[region];
        let outwards = self.law.inputs.iter().zip(inputs.iter()).enumerate().any(|(j, (input, last))| {
            let gains = law.integral.get(j).into_iter().flatten();
            let push: f64 = gains.zip(grown.iter().zip(&self.integrals)).map(|(l, (then, now))| l * (now - then)).sum();
            (*last >= input.highest && push > 0.0) || (*last <= input.lowest && push < 0.0)
        });
        if !outwards {
            self.integrals = grown;
        }
        let Self { law, chooser, predictor, integrals, errors, .. } = self;
        let Some(predictor) = predictor else { return };
        let first = law.state_columns().count();
        let measured: Vec<f64> =
            law.measured.iter().zip(&columns[first..]).map(|(column, value)| value - column.at).collect();
        let mut row = columns.to_vec();
        let mut region_of = |errors: &[f64], inputs: &[f64]| {
            for ((value, state), error) in row.iter_mut().zip(&law.states).zip(errors) {
                *value = if state.angle { wrap(state.at + error) } else { state.at + error };
            }
            chooser.as_mut().map_or(Some(0), |chooser| chooser.region(&row, inputs))
        };
        let state = errors.iter().chain(integrals.iter()).copied();
        predictor.plan(state, &measured, &mut region_of, inputs);
        for (value, input) in inputs.iter_mut().zip(&law.inputs) {
            *value = value.max(input.lowest).min(input.highest);
        }
    }
}
