//! States that a model's regions advance, and the linear maps from coefficients to their advance.

mod ports;

use std::fmt::{self, Display, Formatter};

use faer::Mat;
use fleetfoot_library::{Expr, Node, Unary};
use fleetfoot_model::{Equation, Model, Prediction, Training};

pub(crate) use ports::Ports;
pub use ports::{PassiveRegion, Passivity};

use crate::{Error, Options, Problem, port::Port};

/// A state at some rows back.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Variable {
    pub(crate) name: String,
    pub(crate) lag: i32,
}

impl Display for Variable {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.lag {
            0 => f.write_str(&self.name),
            lag => write!(f, "lag({}, {lag})", self.name),
        }
    }
}

/// The maps of a model's regions, `M = C + sum_t gain_t e_row(t) beta_t' reads`, and their bound. With m ports the inputs of these stand behind the variables as columns: `[M N]`.
#[derive(Debug, Clone)]
pub(crate) struct Loop {
    /// Advanced variables (n).
    pub(crate) variables: Vec<Variable>,
    /// C (n x n + m): the states' own part of a step, given equations, and the rows of lags.
    pub(crate) offset: Mat<f64>,
    /// The row of M that every target makes, and its factor; `None` for a target that advances nothing of the loop (q).
    pub(crate) targets: Vec<Option<(usize, f64)>>,
    /// Derivatives of the library's functions with respect to the variables and the ports' inputs (p x n + m).
    pub(crate) reads: Mat<f64>,
    /// The functions that do.
    pub(crate) regressors: Vec<usize>,
    /// States that act as inputs.
    pub(crate) inputs: Vec<String>,
    /// Variables of given equations.
    pub(crate) given: Vec<usize>,
    /// rho.
    pub(crate) bound: f64,
    /// Ports at which the model is to be passive.
    pub(crate) ports: Option<Ports>,
}

/// A state with its equation.
struct Advanced<'a> {
    equation: &'a Equation,
    target: Option<usize>,
}

impl Loop {
    /// The loop that the options bound; `None` where they bound none.
    ///
    /// # Errors
    /// As [`Loop::new`].
    pub(crate) fn requested(problem: &Problem, options: &Options) -> Result<Option<Self>, Error> {
        let bound = options.stability.or((!options.ports.is_empty()).then_some(1.0));
        bound.map(|bound| Self::new(problem, bound, &options.ports)).transpose()
    }

    /// Reads the loop out of a problem.
    ///
    /// # Errors
    /// A function that is not linear in a fitted state, nor bounded; no fitted state that the regressors read; ports that are none.
    pub(crate) fn new(problem: &Problem, bound: f64, ports: &[Port]) -> Result<Self, Error> {
        let (equations, library) = closed(problem)?;
        let mut advanced: Vec<Advanced<'_>> = Vec::new();
        let mut targets = 0;
        for equation in &equations {
            let target = equation.target.is_some().then_some(targets);
            targets += usize::from(equation.target.is_some());
            if equation.prediction != Prediction::Value {
                advanced.push(Advanced { equation, target });
            }
        }
        let is_angle = |name: &str| problem.columns.iter().any(|column| column.name == name && column.angle);
        let (mut inputs, mut linear): (Vec<String>, Vec<&Advanced<'_>>) = (Vec::new(), Vec::new());
        for equation in &advanced {
            let subject = equation.equation.subject.as_str();
            let mut readers = library.iter().filter(|function| reads(function, subject)).peekable();
            if readers.peek().is_none() {
                continue;
            }
            let bent = readers.find(|function| slopes(function, subject).is_none());
            match bent {
                // Columns that are read through bounded functions alone feed back bounded values.
                _ if library.iter().filter(|function| reads(function, subject)).all(is_bounded)
                    || is_angle(subject) =>
                {
                    inputs.push(subject.to_owned());
                }
                Some(_) if equation.target.is_none() => inputs.push(subject.to_owned()),
                Some(function) => {
                    return Err(Error::Bends { function: function.to_string(), state: subject.to_owned() });
                }
                None => linear.push(equation),
            }
        }
        // A given equation that bends, or that reads what is none of the loop, cannot be part of it; leaving one out may leave others without.
        loop {
            let names: Vec<&str> = linear.iter().map(|linear| linear.equation.subject.as_str()).collect();
            let fits = |advanced: &&Advanced<'_>| {
                advanced.target.is_some() || names.iter().all(|name| slopes(&advanced.equation.right, name).is_some())
            };
            let Some(at) = linear.iter().position(|linear| !fits(linear)) else { break };
            inputs.push(linear.remove(at).equation.subject.clone());
        }
        if linear.iter().all(|linear| linear.target.is_none()) {
            return Err(Error::NothingToBound);
        }
        Self::of(&linear, &library, (problem, targets), (inputs, ports), bound)
    }

    fn of(
        linear: &[&Advanced<'_>],
        library: &[Expr],
        (problem, targets): (&Problem, usize),
        (inputs, ports): (Vec<String>, &[Port]),
        bound: f64,
    ) -> Result<Self, Error> {
        let mut variables: Vec<Variable> = Vec::new();
        for linear in linear {
            let name = &linear.equation.subject;
            let read = library.iter().chain(std::iter::once(&linear.equation.right)).flat_map(Expr::reads);
            let deepest = read.filter(|(of, _)| of.as_deref() == Some(name)).map(|(_, lag)| lag).max().unwrap_or(0);
            variables.extend((0..=deepest.max(0)).map(|lag| Variable { name: name.clone(), lag }));
        }
        let n = variables.len();
        let place =
            |name: &str, lag: i32| variables.iter().position(|variable| variable.name == name && variable.lag == lag);
        let port_rows = match ports {
            [] => None,
            ports => Some(Ports::new(ports, problem, library, |name| place(name, 0))?),
        };
        let row_of = |expression: &Expr| {
            let mut row = vec![0.0; n + ports.len()];
            for linear in linear {
                for (lag, slope) in slopes(expression, &linear.equation.subject).into_iter().flatten() {
                    if let Some(at) = place(&linear.equation.subject, lag) {
                        row[at] += slope;
                    }
                }
            }
            for (at, port) in ports.iter().enumerate() {
                let slopes = slopes(expression, &port.input).into_iter().flatten().filter(|(lag, _)| *lag == 0);
                row[n + at] += slopes.map(|(_, slope)| slope).sum::<f64>();
            }
            row
        };
        let functions: Vec<Vec<f64>> = library.iter().map(&row_of).collect();
        let mut offset = Mat::zeros(n, n + ports.len());
        let (mut of_targets, mut given) = (vec![None; targets], Vec::new());
        for linear in linear {
            let Some(row) = place(&linear.equation.subject, 0) else { continue };
            let (factor, gain) = match linear.equation.prediction {
                Prediction::Derivative => (1.0, problem.step),
                Prediction::Difference => (1.0, 1.0),
                Prediction::Next | Prediction::Value => (0.0, 1.0),
            };
            offset[(row, row)] += factor;
            match linear.target {
                Some(target) => of_targets[target] = Some((row, gain)),
                None => {
                    given.push(row);
                    row_of(&linear.equation.right)
                        .iter()
                        .enumerate()
                        .for_each(|(k, slope)| offset[(row, k)] += gain * slope);
                }
            }
        }
        for (row, variable) in variables.iter().enumerate().filter(|(_, variable)| variable.lag > 0) {
            if let Some(before) = place(&variable.name, variable.lag - 1) {
                offset[(row, before)] = 1.0;
            }
        }
        let regressors = (0..functions.len()).filter(|&j| functions[j].iter().any(|&slope| slope != 0.0)).collect();
        let reads = Mat::from_fn(functions.len(), n + ports.len(), |j, k| functions[j][k]);
        Ok(Self { variables, offset, targets: of_targets, reads, regressors, inputs, given, bound, ports: port_rows })
    }

    /// The loop without the states that given equations advance; `None` where there are none, or a port is at one.
    pub(crate) fn without_given(&self) -> Option<Self> {
        if self.given.is_empty() {
            return None;
        }
        let is_given = |at: usize| self.given.iter().any(|&row| self.variables[row].name == self.variables[at].name);
        let kept: Vec<usize> = (0..self.variables.len()).filter(|&at| !is_given(at)).collect();
        let place = |row: usize| kept.iter().position(|&at| at == row);
        let mut ports = self.ports.clone();
        for output in ports.iter_mut().flat_map(|ports| &mut ports.outputs) {
            *output = place(*output)?;
        }
        let (n, all) = (self.variables.len(), kept.iter().copied());
        let columns: Vec<usize> = all.chain(n..self.reads.ncols()).collect();
        let reads = Mat::from_fn(self.reads.nrows(), columns.len(), |j, k| self.reads[(j, columns[k])]);
        let mut inputs = self.inputs.clone();
        inputs.extend(self.given.iter().map(|&row| self.variables[row].name.clone()));
        Some(Self {
            variables: kept.iter().map(|&at| self.variables[at].clone()).collect(),
            offset: Mat::from_fn(kept.len(), columns.len(), |i, k| self.offset[(kept[i], columns[k])]),
            targets: self
                .targets
                .iter()
                .map(|target| target.and_then(|(row, gain)| Some((place(row)?, gain))))
                .collect(),
            regressors: (0..reads.nrows()).filter(|&j| (0..reads.ncols()).any(|k| reads[(j, k)] != 0.0)).collect(),
            reads,
            inputs,
            given: Vec::new(),
            bound: self.bound,
            ports,
        })
    }
}

/// Equations and library with everything written out that follows from states, inputs and time, as a simulation sees them.
fn closed(problem: &Problem) -> Result<(Vec<Equation>, Vec<Expr>), Error> {
    let mut model = Model::new("pwa", problem.columns.clone(), problem.step, Training::default());
    model.libraries = vec![problem.library.clone()];
    model.equations = problem.equations.clone();
    let mut model = model.closed(problem.step, &[])?.model;
    // Steps of a lag that is simulated are equations of their own behind them.
    model.equations.truncate(problem.equations.len());
    Ok((model.equations, model.libraries.swap_remove(0)))
}

pub(super) fn reads(function: &Expr, state: &str) -> bool {
    function.sources().iter().any(|name| **name == *state)
}

/// Slopes of a function by a state, lag by lag; `None` if one is not constant, or the state is read through a filter.
pub(super) fn slopes(function: &Expr, state: &str) -> Option<Vec<(i32, f64)>> {
    if function.filters().iter().any(|filter| filter.sources().iter().any(|name| **name == *state)) {
        return None;
    }
    let lags = function.reads().into_iter().filter(|(name, _)| name.as_deref() == Some(state)).map(|(_, lag)| lag);
    let slope = |lag: i32| {
        // A name that no column can have.
        let marker = "\u{1}state";
        let marked = function.replaced(|part| match part.node() {
            Node::Column { name, lag: read } if **name == *state && *read == lag => Some(Expr::column(marker)),
            _ => None,
        });
        Some((lag, marked.derivative(marker).simplified().as_number().filter(|slope| slope.is_finite())?))
    };
    lags.map(slope).collect()
}

/// Returns true if the values of a function are bounded, whatever it reads.
fn is_bounded(function: &Expr) -> bool {
    matches!(function.node(), Node::Unary(Unary::Sin | Unary::Cos | Unary::Tanh | Unary::Sign | Unary::Step, _))
}
