//! Choice between the cubic and the quintic spline for a channel.

use super::{Channel, Lambda, Rows, Spline, scores};
use crate::SignalError;

/// Measurements by which the quintic spline begins. The cubic one is not judged by them either.
const FIRST: usize = 3;

/// The cubic or the quintic spline, whichever a channel is more like, each under the penalty that it has, `[cubic, quintic]`, in s^3 and s^5.
///
/// Both are priors of a motion, so that the density of the measurements behind the first three, given these, compares them as it compares penalties: what is smooth is a quintic spline, what is pushed about anew in every
/// moment a cubic one. With [`Lambda::Gcv`] the score of generalised cross-validation compares them. `times` in s, increasing; NaN where nothing was measured. O(n).
///
/// # Errors
/// Arrays of different lengths, stamps that do not increase, fewer than four measurements.
pub fn better(times: &[f64], values: &[f64], lambdas: [f64; 2], by: Lambda) -> Result<Spline, SignalError> {
    let channel = Channel::new(times, values, None, FIRST)?;
    let [cubic, quintic] = match by {
        Lambda::Gcv => [
            channel.gcv::<2>(&[channel.in_units::<2>(lambdas[0])]),
            channel.gcv::<3>(&[channel.in_units::<3>(lambdas[1])]),
        ]
        .map(|scores| scores[0]),
        Lambda::Likelihood | Lambda::Given(_) => [channel.surprise::<2>(lambdas[0]), channel.surprise::<3>(lambdas[1])],
    };
    Ok(if quintic < cubic { Spline::Quintic } else { Spline::Cubic })
}

impl Channel<'_> {
    /// A penalty in units of the channel.
    fn in_units<const M: usize>(&self, lambda: f64) -> f64 {
        lambda / self.unit.powi(2 * M as i32 - 1)
    }

    /// Minus twice the logarithm of the density of all measurements but the first three, given these, sigma profiled out, up to a constant that the splines share.
    fn surprise<const M: usize>(&self, lambda: f64) -> f64 {
        let lambda = self.in_units::<M>(lambda);
        let all = scores::likelihoods::<M>(self.rows(), &[lambda])[0];
        let mut terms = [all.squares, all.log_variance];
        if M < FIRST {
            let behind = self.values.iter().enumerate().filter(|(_, value)| !value.is_nan()).nth(FIRST - 1);
            let rows = behind.map_or(0, |(row, _)| row + 1);
            let head = Rows { times: &self.times[..rows], values: &self.values[..rows], weights: None };
            let first = scores::likelihoods::<M>(head, &[lambda])[0];
            terms = [terms[0] - first.squares, terms[1] - first.log_variance];
        }
        (self.measured - FIRST) as f64 * terms[0].max(self.floor()).ln() + terms[1]
    }
}
