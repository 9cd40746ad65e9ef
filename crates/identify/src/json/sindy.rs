//! The report of a fit of equations.

use serde_json::{Value, json};

use super::{FORMAT, real, reals};
use crate::{EquationReport, RolloutChoice, SindyReport};

impl SindyReport {
    /// Equations, scores and terms for programs.
    pub fn to_json(&self) -> Value {
        let mut report = json!({
            "format": FORMAT, "rows": self.rows, "episodes": self.episodes,
            "rows_at_border": self.left_out[0], "rows_incomplete": self.left_out[1], "rows_unassigned": self.left_out[2],
            "method": self.method, "choice": self.choice, "folds": self.folds, "fold_rule": self.fold_rule, "ensemble": self.ensemble,
            "candidates": self.candidates,
            "parameters": self.parameters.iter().map(|parameter| json!({
                "name": parameter.name, "value": real(parameter.value), "standard_error": real(parameter.standard_error),
                "unit": parameter.unit, "at_bound": parameter.at_bound,
            })).collect::<Vec<_>>(),
            "regions": self.regions.iter().map(|region| json!({
                "name": region.name, "rows": region.rows,
                "equations": region.equations.iter().map(equation_json).collect::<Vec<_>>(),
            })).collect::<Vec<_>>(),
            "path": self.regions.iter().flat_map(|region| {
                region.equations.iter().map(|equation| path(&region.name, equation))
            }).collect::<Vec<_>>(),
            "rollouts": self.rollouts.as_ref().map(RolloutChoice::to_json),
            "notes": self.notes,
        });
        if let Some(windows) = &self.windows {
            report["weak"] = json!(windows);
        }
        if let Some(refinement) = &self.refinement {
            report["objective"] = refinement.to_json();
        }
        report
    }
}

/// What the functions of an equation contribute to its models of so many terms.
fn path(region: &str, equation: &EquationReport) -> Value {
    json!({
        "name": region, "label": equation.label, "entered": equation.entered,
        "terms": equation.front.iter().map(|point| point.terms).collect::<Vec<_>>(),
        "functions": equation.along.iter().map(|(function, along)| json!({
            "function": function, "coefficients": reals(along),
        })).collect::<Vec<_>>(),
    })
}

fn equation_json(equation: &EquationReport) -> Value {
    json!({
        "label": equation.label, "right": equation.right, "candidates": equation.candidates,
        "rms": real(equation.rms), "r2": real(equation.r2),
        "held_out_rms": real(equation.held_out), "held_out_r2": real(equation.held_out_r2),
        "parameter": real(equation.parameter), "correlation": real(equation.correlation),
        "terms": equation.terms.iter().map(|term| json!({
            "function": term.function, "coefficient": real(term.coefficient), "standard_error": real(term.standard_error),
            "unit": term.unit, "inclusion": term.inclusion.map(real), "fixed": term.fixed,
        })).collect::<Vec<_>>(),
        "inclusion": equation.inclusion.as_ref().map(|shares| shares.iter().map(|&share| real(share)).collect::<Vec<_>>()),
        "confounded": equation.confounded,
        "difference": equation.difference.map(|errors| json!({
            "order": errors.order, "rms_by_order": errors.by_order.map(real), "truncation_rms": real(errors.truncation),
            "noise_rms": real(errors.noise),
        })),
        "front": equation.front.iter().map(|point| json!({
            "terms": point.terms, "rms": real(point.rms), "held_out_rms": real(point.held_out), "parameter": real(point.parameter),
            "chosen": point.chosen, "functions": point.functions,
        })).collect::<Vec<_>>(),
    })
}
