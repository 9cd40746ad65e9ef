//! Requests to a regulator, checked, and by the place of each coordinate.

use fleetfoot_model::Model;

use super::{
    LqrOptions, Named,
    coordinates::{Coordinate, Coordinates, Of},
    gains::Weights,
};
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

/// Weights and sizes, as given or by the variance in training; `given` are the coordinates that the set point gives.
pub(super) fn weights(
    pieces: &Pieces,
    coordinates: &Coordinates<'_>,
    options: &LqrOptions,
    (kept, given): (&[usize], &[bool]),
    driven: &[usize],
    period: f64,
) -> Result<Weights, ControlError> {
    let n = pieces.states.len();
    let kept_coordinates: Vec<&Coordinate> = kept.iter().map(|&at| &coordinates.of[at]).collect();
    let driven_names: Vec<&String> = driven.iter().map(|&i| &pieces.inputs[i]).collect();
    let mut q: Vec<f64> = kept_coordinates.iter().map(|coordinate| coordinate.size.powi(-2)).collect();
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
        coordinates.find("q", "kept state", name, kept)?.into_iter().for_each(|at| q[at] = *value);
    }
    for (name, value) in &options.r {
        not_negative("r", name, *value, "a positive weight", *value > 0.0)?;
        r[find("r", "driven input", name, &driven_names)?] = *value;
    }
    let mut integrated: Vec<(usize, f64)> = Vec::new();
    for (name, value) in &options.integral {
        not_negative("integral", name, *value, "a positive weight", *value > 0.0)?;
        let matches = coordinates.find("integral", "kept state", name, kept)?;
        integrated.extend(matches.into_iter().map(|at| (at, *value)));
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
    let is_integrated = |coordinate: &Coordinate| {
        let named = |(name, _): &Named| match coordinate.of {
            Of::State(_) => *name == coordinate.name,
            Of::Turn { group, .. } => *name == coordinate.name || *name == coordinates.groups[group].name,
        };
        options.integral.iter().any(named)
    };
    Ok(Weights {
        q,
        r,
        integrated,
        held: kept
            .iter()
            .zip(&kept_coordinates)
            .map(|(&at, coordinate)| given[at] || is_integrated(coordinate))
            .collect(),
        state_sizes: kept_coordinates.iter().map(|coordinate| coordinate.size).collect(),
        input_sizes: driven.iter().map(|&i| pieces.size(n + i)).collect(),
        period,
    })
}
