//! A parameter as a coordinate of the search.

use super::Draws;

/// Ratio of positive bounds from which a parameter is searched by its logarithm.
const DECADES: f64 = 100.0;

/// Places of a parameter: of an interval between bounds those from 0 to 1; places beyond are mirrored at the ends.
#[derive(Debug, Clone, Copy)]
pub(super) enum Axis {
    Linear { low: f64, high: f64 },
    Logarithmic { low: f64, high: f64 },
    Open { centre: f64, scale: f64, bounds: [f64; 2] },
}

impl Axis {
    /// `None` for a fixed parameter.
    pub(super) fn new([low, high]: [f64; 2], initial: f64) -> Option<Self> {
        if low == high {
            return None;
        }
        if low.is_finite() && high.is_finite() {
            let spans_decades = low > 0.0 && high / low > DECADES;
            return Some(if spans_decades { Self::Logarithmic { low, high } } else { Self::Linear { low, high } });
        }
        // The first standard deviation is about the initial value.
        let scale = if initial == 0.0 { 1.0 } else { initial.abs() } / super::SPREAD;
        Some(Self::Open { centre: initial, scale, bounds: [low, high] })
    }

    pub(super) fn place(&self, value: f64) -> f64 {
        match *self {
            Self::Linear { low, high } => (value - low) / (high - low),
            Self::Logarithmic { low, high } => (value / low).ln() / (high / low).ln(),
            Self::Open { centre, scale, .. } => (value - centre) / scale,
        }
    }

    /// The value at a place, within the bounds.
    pub(super) fn value(&self, place: f64) -> f64 {
        match *self {
            Self::Linear { low, high } => (low + mirrored(place) * (high - low)).clamp(low, high),
            Self::Logarithmic { low, high } => (low * (high / low).powf(mirrored(place))).clamp(low, high),
            Self::Open { centre, scale, bounds: [low, high] } => {
                let value = centre + scale * place;
                if value < low {
                    2.0 * low - value
                } else if value > high {
                    2.0 * high - value
                } else {
                    value
                }
            }
        }
    }

    /// A random place: even between bounds, else normal about the initial value.
    pub(super) fn drawn(&self, draws: &mut Draws) -> f64 {
        match self {
            Self::Open { .. } => draws.normal(),
            _ => draws.uniform(),
        }
    }
}

/// A place between 0 and 1, by mirrors at both.
fn mirrored(place: f64) -> f64 {
    let folded = place.rem_euclid(2.0);
    if folded > 1.0 { 2.0 - folded } else { folded }
}
