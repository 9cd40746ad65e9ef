//! By how much measurements correct a simulation.

use crate::EstimateError;

/// By how much measurements correct a simulation, one number an output, between 0 and 1.
#[derive(Debug, Clone, Default, PartialEq)]
pub enum Gains {
    /// Estimated, from 0 and from a half: the more likely end counts.
    #[default]
    Estimated,
    /// Estimated from here, in the order of the outputs.
    Near(Vec<f64>),
    /// Kept, in the order of the outputs.
    Held(Vec<f64>),
}

/// Starting values of unknown gains, all outputs alike. From 0, as by output error, parameters that are far off may not
/// get near to the recording. A gain of a half follows the recording with any parameters, and may do so to the end.
const STARTS: [f64; 2] = [0.0, 0.5];

impl Gains {
    /// Bounds of every output's gain.
    pub(crate) fn bounds(&self, outputs: usize) -> Result<Vec<[f64; 2]>, EstimateError> {
        let (Self::Near(gains) | Self::Held(gains)) = self else { return Ok(vec![[0.0, 1.0]; outputs]) };
        if gains.len() != outputs {
            return Err(EstimateError::GainCount { gains: gains.len(), outputs });
        }
        let bounds =
            |&gain: &f64| check(gain).map(|()| if matches!(self, Self::Held(_)) { [gain; 2] } else { [0.0, 1.0] });
        gains.iter().map(bounds).collect()
    }

    /// Starting points of the searches.
    pub(crate) fn starts(&self, outputs: usize) -> Vec<Vec<f64>> {
        match self {
            Self::Estimated => STARTS.map(|start| vec![start; outputs]).to_vec(),
            Self::Near(gains) | Self::Held(gains) => vec![gains.clone()],
        }
    }
}

fn check(value: f64) -> Result<(), EstimateError> {
    if (0.0..=1.0).contains(&value) {
        return Ok(());
    }
    Err(EstimateError::Option { option: "a gain", value, allowed: "it must be at least 0 and at most 1" })
}
