//! The report of estimated parameters.

use serde_json::{Value, json};

use super::{FORMAT, real, reals};
use crate::{ParameterInterval, ParametersReport};

impl ParametersReport {
    /// Parameters, intervals, noise and held-out rollouts for programs.
    pub fn to_json(&self) -> Value {
        let pairs =
            self.confounded.iter().map(|pair| json!({ "names": pair.names, "correlation": real(pair.correlation) }));
        let noise = self.noise.iter().map(|(name, value)| json!({ "of": name, "deviation": real(*value) }));
        let held_out = self.held_out.as_ref().map(|held| {
            json!({
                "horizon": held.horizon, "over_persistence": real(held.share()), "folds": reals(&held.folds),
                "ended": held.ended, "starts": held.starts,
            })
        });
        json!({
            "format": FORMAT, "method": self.method, "rows": self.rows, "episodes": self.episodes, "files": self.files,
            "parameters": self.parameters.iter().map(parameter).collect::<Vec<_>>(), "confounded": pairs.collect::<Vec<_>>(),
            "noise": noise.collect::<Vec<_>>(), "segments": self.segments.map(|segments| segments[0]),
            "missing_segments": self.segments.map(|segments| segments[1]), "correlated_rows": self.memory,
            "condition": real(self.condition), "gradient": real(self.gradient), "converged": self.converged,
            "held_out": held_out, "equations": self.equations, "warnings": self.warnings(), "notes": self.notes,
        })
    }
}

fn parameter(own: &ParameterInterval) -> Value {
    json!({
        "name": own.name, "value": real(own.value), "standard_error": real(own.standard_error),
        "white_error": real(own.white_error), "interval": reals(&own.interval), "unit": own.unit, "fixed": own.fixed,
        "at_bound": own.at_bound, "determined": own.determined,
    })
}
