//! Plan of a model's code: inputs, memory and results.

use std::collections::BTreeMap;

use fleetfoot_library::Leaf;
use fleetfoot_model::{Closed, Equation, Model, Prediction, Rotation};

use crate::{ExportError, evaluation::Evaluation};

/// The shape of the exported code: its vectors, its memory, and the two things that it may evaluate.
pub(crate) struct Plan<'a> {
    pub(crate) model: &'a Model,
    /// Columns that equations advance, in the order of the model's columns, then first-order lags.
    pub(crate) states: Vec<State>,
    /// Columns that are read and not advanced, in the order of the model's columns.
    pub(crate) inputs: Vec<Signal>,
    /// Columns predicted in the same row.
    pub(crate) outputs: Vec<Signal>,
    /// Values of earlier rows.
    pub(crate) delays: Vec<Delay>,
    /// True if the time since the start is read.
    pub(crate) time: bool,
    /// True if the states' equations read the inputs of the row that they lead to. The caller then gives them with a
    /// step.
    pub(crate) next_inputs: bool,
    /// The right sides of the states.
    pub(crate) advance: Option<Evaluation>,
    /// The right sides of the outputs.
    pub(crate) predict: Option<Evaluation>,
    places: BTreeMap<usize, Source>,
}

pub(crate) struct State {
    pub(crate) signal: Signal,
    pub(crate) advance: Advance,
}

/// Advance of a state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Advance {
    /// By an equation of the model.
    Equation(Prediction),
    /// As a first-order lag of its right side, with this time constant in seconds.
    Lag(f64),
}

pub(crate) struct Signal {
    pub(crate) name: String,
    pub(crate) unit: Option<String>,
    pub(crate) angle: bool,
    /// Its part of a rotation, for people: `w of the quaternion attitude`.
    pub(crate) part: Option<String>,
}

/// The earlier values of one signal: `depth` of them, the latest last, from `offset` on in the memory. Of the time, how long ago
/// those rows were.
pub(crate) struct Delay {
    pub(crate) source: Source,
    pub(crate) depth: usize,
    pub(crate) offset: usize,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Source {
    State(usize),
    Input(usize),
    Time,
}

impl<'a> Plan<'a> {
    pub(crate) fn new(closed: &'a Closed) -> Result<Self, ExportError> {
        let model = &closed.model;
        let (mut columns, mut advancing) = advanced(model)?;
        let mut advances: Vec<Advance> = advancing.iter().map(|e| Advance::Equation(e.prediction)).collect();
        for lag in &closed.lags {
            columns.push(lag.column);
            advancing.push(&lag.equation);
            advances.push(Advance::Lag(lag.constant));
        }
        let predicting: Vec<&Equation> =
            model.equations.iter().filter(|equation| equation.prediction == Prediction::Value).collect();
        if advancing.is_empty() && predicting.is_empty() {
            return Err(ExportError::NoEquations);
        }
        let evaluation = |equations: &[&Equation]| match equations {
            [] => Ok(None),
            _ => Evaluation::new(model, equations).map(Some),
        };
        let (advance, predict) = (evaluation(&advancing)?, evaluation(&predicting)?);
        let mut depths: BTreeMap<usize, i32> = BTreeMap::new();
        let mut time: Option<i32> = None;
        let next_inputs = reads_next_inputs(model, &columns, &advancing, advance.as_ref())?;
        refuse_leads(model, predict.as_ref(), |_| false)?;
        for leaf in advance.iter().chain(&predict).flat_map(|evaluation| evaluation.column_leaves(model.columns.len()))
        {
            match leaf {
                Leaf::Column { column, lag } => {
                    let depth = depths.entry(column).or_insert(0);
                    *depth = lag.max(*depth);
                }
                Leaf::Time { lag } => time = Some(lag.max(time.unwrap_or(0))),
            }
        }
        let signal = |column: usize| {
            let column = &model.columns[column];
            let part = column.rotation.as_ref();
            let part = part
                .map(|part| format!("{} of the {} {}", part.kind.letters()[part.part], part.kind.word(), part.group));
            Signal { name: column.name.clone(), unit: column.unit.clone(), angle: column.angle, part }
        };
        let inputs: Vec<usize> = depths.keys().copied().filter(|column| !columns.contains(column)).collect();
        let mut places: BTreeMap<usize, Source> = BTreeMap::new();
        places.extend(columns.iter().enumerate().map(|(i, &column)| (column, Source::State(i))));
        places.extend(inputs.iter().enumerate().map(|(i, &column)| (column, Source::Input(i))));
        let mut lagged: Vec<(Source, i32)> =
            depths.iter().filter_map(|(column, &depth)| Some((*places.get(column)?, depth))).collect();
        lagged.extend(time.map(|depth| (Source::Time, depth)));
        lagged.retain(|(_, depth)| *depth > 0);
        lagged.sort_unstable();
        let mut offset = 0;
        let delays = lagged
            .into_iter()
            .map(|(source, depth)| {
                let depth = usize::try_from(depth).unwrap_or(0);
                offset += depth;
                Delay { source, depth, offset: offset - depth }
            })
            .collect();
        Ok(Self {
            states: columns
                .iter()
                .zip(advances)
                .map(|(&column, advance)| State { signal: signal(column), advance })
                .collect(),
            inputs: inputs.iter().map(|&column| signal(column)).collect(),
            outputs: predicting
                .iter()
                .map(|equation| {
                    let angle = model.column(&equation.subject).is_some_and(|column| model.columns[column].angle);
                    Signal { name: equation.subject.clone(), unit: equation.unit.clone(), angle, part: None }
                })
                .collect(),
            delays,
            time: time.is_some(),
            next_inputs,
            advance,
            predict,
            places,
            model,
        })
    }

    /// The rotations among the states that are advanced, with the places of their parts.
    pub(crate) fn rotations(&self) -> Vec<(Rotation, Vec<usize>)> {
        let place = |column: &usize| match self.places.get(column) {
            Some(Source::State(place)) => Some(*place),
            _ => None,
        };
        let of = |rotation: Rotation| {
            let places = rotation.columns.iter().map(place).collect::<Option<Vec<_>>>()?;
            Some((rotation, places))
        };
        self.model.rotations().into_iter().filter_map(of).collect()
    }

    /// Number of kept values of earlier rows.
    pub(crate) fn memory(&self) -> usize {
        self.delays.last().map_or(0, |delay| delay.offset + delay.depth)
    }

    /// Returns true if a derivative is integrated.
    pub(crate) fn continuous(&self) -> bool {
        self.states.iter().any(|state| state.advance == Advance::Equation(Prediction::Derivative))
    }

    /// Returns true if there are first-order lags among the states.
    pub(crate) fn lags(&self) -> bool {
        self.states.iter().any(|state| matches!(state.advance, Advance::Lag(_)))
    }

    /// Returns true if the right sides read more than values of the present row.
    pub(crate) fn remembers(&self) -> bool {
        self.memory() > 0 || self.time
    }

    /// Place of a column.
    pub(crate) fn place(&self, column: usize) -> Option<Source> {
        self.places.get(&column).copied()
    }

    /// Index of an earlier value in the memory.
    pub(crate) fn past(&self, source: Source, lag: i32) -> Option<usize> {
        let delay = self.delays.iter().find(|delay| delay.source == source)?;
        let back = usize::try_from(lag).ok().filter(|back| *back > 0)?;
        Some(delay.offset + delay.depth.checked_sub(back)?)
    }
}

/// Returns true if equations read inputs of the row that they lead to. Only equations that give that row directly may:
/// within an integrated step its inputs are not known yet.
fn reads_next_inputs(
    model: &Model,
    states: &[usize],
    equations: &[&Equation],
    evaluation: Option<&Evaluation>,
) -> Result<bool, ExportError> {
    let discrete = equations.iter().all(|equation| equation.prediction != Prediction::Derivative);
    let next_input = |leaf: &Leaf| match *leaf {
        Leaf::Column { column, lag } => discrete && lag == -1 && !states.contains(&column),
        Leaf::Time { .. } => false,
    };
    refuse_leads(model, evaluation, next_input)?;
    Ok(evaluation.is_some_and(|evaluation| evaluation.column_leaves(model.columns.len()).any(|leaf| next_input(&leaf))))
}

/// Refuses reading of later rows, but for the known leaves.
fn refuse_leads(
    model: &Model,
    evaluation: Option<&Evaluation>,
    known: impl Fn(&Leaf) -> bool,
) -> Result<(), ExportError> {
    let mut leaves = evaluation.into_iter().flat_map(|evaluation| evaluation.column_leaves(model.columns.len()));
    let Some(leaf) = leaves.find(|leaf| leaf.lag() < 0 && !known(leaf)) else { return Ok(()) };
    let column = match leaf {
        Leaf::Column { column, .. } => model.columns[column].name.clone(),
        Leaf::Time { .. } => "time()".to_owned(),
    };
    Err(ExportError::Ahead { column, ahead: leaf.lag().unsigned_abs() })
}

/// The columns that equations advance, in the order of the columns, and their equations.
fn advanced(model: &Model) -> Result<(Vec<usize>, Vec<&Equation>), ExportError> {
    let (mut columns, mut equations) = (Vec::new(), Vec::new());
    for (index, column) in model.columns.iter().enumerate() {
        let mut latents = model
            .equations
            .iter()
            .filter(|equation| equation.prediction != Prediction::Value && equation.subject == column.name);
        let Some(equation) = latents.next() else { continue };
        if latents.next().is_some() {
            return Err(ExportError::Contradiction { state: column.name.clone() });
        }
        columns.push(index);
        equations.push(equation);
    }
    Ok((columns, equations))
}
