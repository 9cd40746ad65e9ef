//! What is asked of a regulator, checked, and by its place.

use fleetfoot_model::Model;

use super::{LqrOptions, Named, gains::Weights};
use crate::{control_error::ControlError, named::find, pieces::Pieces};

/// Periods may differ by this share.
const SAME_PERIOD: f64 = 1e-9;

/// Seconds between commands.
pub(super) fn period(model: &Model, pieces: &Pieces, given: Option<f64>) -> Result<f64, ControlError> {
    let period = given.unwrap_or(model.step);
    if given.is_none() && period == 0.0 {
        return Err(ControlError::NoPeriod);
    }
    if !(period.is_finite() && period > 0.0) {
        return Err(ControlError::Value {
            of: "period",
            name: "it".into(),
            value: period,
            allowed: "a positive number of seconds",
        });
    }
    if !pieces.continuous && (period / model.step - 1.0).abs() > SAME_PERIOD && model.step > 0.0 {
        return Err(ControlError::Period { period, step: model.step });
    }
    Ok(period)
}

/// Weights and sizes, as given or by the variance in training.
pub(super) fn weights(
    pieces: &Pieces,
    options: &LqrOptions,
    kept: &[usize],
    driven: &[usize],
    period: f64,
) -> Result<Weights, ControlError> {
    let n = pieces.states.len();
    let kept_names: Vec<&String> = kept.iter().map(|&s| &pieces.states[s]).collect();
    let driven_names: Vec<&String> = driven.iter().map(|&i| &pieces.inputs[i]).collect();
    let mut q: Vec<f64> = kept.iter().map(|&s| pieces.size(s).powi(-2)).collect();
    let mut r: Vec<f64> = driven.iter().map(|&i| pieces.size(n + i).powi(-2)).collect();
    let not_negative = |of: &'static str, name: &String, value: f64, allowed: &'static str, ok: bool| {
        if ok && value.is_finite() {
            Ok(())
        } else {
            Err(ControlError::Value { of, name: name.clone(), value, allowed })
        }
    };
    for (name, value) in &options.q {
        not_negative("q", name, *value, "0 or a positive weight", *value >= 0.0)?;
        q[find("q", "kept state", name, &kept_names)?] = *value;
    }
    for (name, value) in &options.r {
        not_negative("r", name, *value, "a positive weight", *value > 0.0)?;
        r[find("r", "driven input", name, &driven_names)?] = *value;
    }
    let mut integrated = Vec::new();
    for (name, value) in &options.integral {
        not_negative("integral", name, *value, "a positive weight", *value > 0.0)?;
        integrated.push((find("integral", "kept state", name, &kept_names)?, *value));
    }
    for (name, lowest, highest) in &options.limits {
        find("limits", "driven input", name, &driven_names)?;
        not_negative(
            "limits",
            name,
            *highest,
            "a number above the lowest value",
            highest > lowest && lowest.is_finite(),
        )?;
    }
    let held = |state: &usize| {
        let named = |names: &[Named]| names.iter().any(|(name, _)| *name == pieces.states[*state]);
        named(&options.setpoint) || named(&options.integral)
    };
    Ok(Weights {
        q,
        r,
        integrated,
        held: kept.iter().map(held).collect(),
        state_sizes: kept.iter().map(|&s| pieces.size(s)).collect(),
        input_sizes: driven.iter().map(|&i| pieces.size(n + i)).collect(),
        period,
    })
}
