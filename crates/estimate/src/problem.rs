//! Residuals and parameters, checked; exact derivatives.

use fleetfoot_data::Source;
use fleetfoot_library::Expr;

use crate::{Bounded, EstimateError, limits::Limits, parameter::check_parameters, reads::Reads, rows::Layout};

/// One equation: `target - model` should be small at every row.
#[derive(Debug, Clone, PartialEq)]
pub struct Residual {
    /// Its name in messages.
    pub name: String,
    /// Measured expression, over columns.
    pub target: Expr,
    /// Model expression, over columns and parameters; the residual is target minus model.
    pub model: Expr,
    /// Weight of its squares, usually 1 over the variance of its error.
    pub weight: f64,
}

impl Residual {
    /// Of weight 1, named after its target.
    pub fn new(target: Expr, model: Expr) -> Self {
        Self { name: target.to_string(), target, model, weight: 1.0 }
    }

    /// The same with another weight.
    pub fn weighted(self, weight: f64) -> Self {
        Self { weight, ..self }
    }
}

/// Compiled problem of the minimisation.
#[derive(Debug, Clone)]
pub(crate) struct Problem {
    /// Of every residual of positive weight: `sqrt(weight) target`, and as outputs the slopes of `sqrt(weight) (target - model)` and itself.
    pub(crate) layout: Layout,
    /// The parameter of every slope.
    pub(crate) slopes: Vec<Vec<usize>>,
    pub(crate) bounds: Vec<[f64; 2]>,
    pub(crate) limits: Option<Limits>,
}

impl Problem {
    pub(crate) fn new(
        residuals: &[Residual],
        bounded: &Bounded<'_>,
        source: &dyn Source,
    ) -> Result<Self, EstimateError> {
        let parameters = bounded.parameters;
        check_parameters(parameters, source)?;
        let names: Vec<String> = parameters.iter().map(|parameter| parameter.name.clone()).collect();
        let mut layout = Layout { names, targets: Vec::new(), outputs: Vec::new(), presence: Vec::new() };
        let (mut slopes, mut reads) = (Vec::new(), Reads::new(parameters, source));
        for residual in residuals {
            check_weight(&residual.name, residual.weight)?;
            if residual.weight == 0.0 {
                continue;
            }
            let difference = residual.target.clone() - &residual.model;
            reads.add(&residual.name, &difference)?;
            let weighted = |expr: Expr| (Expr::number(residual.weight.sqrt()) * expr).simplified();
            let (target, value) = (weighted(residual.target.clone()), weighted(difference));
            let (mut outputs, mut of) = (Vec::new(), Vec::new());
            for (j, parameter) in parameters.iter().enumerate() {
                let slope = value.sensitivity(&parameter.name);
                if slope.as_number() != Some(0.0) {
                    outputs.push(slope);
                    of.push(j);
                }
            }
            outputs.push(value);
            layout.targets.push(target);
            layout.outputs.push(outputs);
            slopes.push(of);
        }
        layout.presence = reads.presence()?;
        let bounds = parameters.iter().map(|parameter| parameter.bounds).collect();
        Ok(Self { layout, slopes, bounds, limits: Limits::new(bounded, &[])? })
    }
}

pub(crate) fn check_weight(residual: &str, weight: f64) -> Result<(), EstimateError> {
    if weight >= 0.0 && weight.is_finite() {
        return Ok(());
    }
    Err(EstimateError::Weight { residual: residual.to_owned(), weight })
}
