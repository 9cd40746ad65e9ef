//! A model that was tried, those that nothing of as few coefficients beats, and the simplest of those that are as good as the best.

use fleetfoot_sparse::narx::NarxOrder;
use fleetfoot_stats::front;
use serde::Serialize;

use crate::serialize;

/// A model that was tried.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct NarxCandidate {
    /// Index among the partitions of the request.
    #[serde(skip)]
    pub partition: usize,
    /// The partition, as the user wrote it.
    #[serde(rename = "partition")]
    pub specification: String,
    /// Seed of its clustering.
    pub seed: u64,
    /// Its regions.
    #[serde(skip)]
    pub regions: usize,
    /// Lags and degree.
    #[serde(flatten, serialize_with = "serialize::tried_order")]
    pub order: NarxOrder,
    /// Most terms of an equation in a region.
    pub terms: usize,
    /// Root relative squared error of free runs of the held-out spans, the mean of the folds: of these terms, refitted
    /// on the other spans. Infinite if one diverged. NaN if one-step errors decide and nothing is simulated.
    pub rrse: f64,
    /// That of every fold: the root mean square over the outputs that move. Every fold has the same weight, whatever
    /// its rows and the movement of its outputs. NaN of a fold in which no output moves, which is left out.
    pub folds: Vec<f64>,
    /// Coefficients of the model: those of all regions and equations.
    pub coefficients: usize,
    /// Squared one-step error of the held-out spans over the variance of an output, the mean of the folds and outputs;
    /// `None` if free runs decide.
    pub loss: Option<f64>,
    /// That of every fold.
    #[serde(skip)]
    pub losses: Vec<f64>,
    /// Bayesian information criterion of one-step errors on all training rows, by the number of independent rows.
    /// `None` if a search compares models of several scans, which have different rows.
    pub bic: Option<f64>,
    /// Akaike's.
    #[serde(skip)]
    pub aic: Option<f64>,
    /// True on the front: no other model of as few coefficients has a lower held-out error, and none has the same error
    /// with fewer.
    pub front: bool,
    /// True for the model that is written.
    pub chosen: bool,
}

impl NarxCandidate {
    /// The held-out error that it is compared by, and that of every fold.
    pub fn error(&self) -> (f64, &[f64]) {
        self.loss.map_or((self.rrse, &self.folds), |loss| (loss, &self.losses))
    }
}

/// Marks the model that is written, and those that nothing with as few coefficients beats.
pub(crate) fn mark(tried: &mut [NarxCandidate], chosen: usize) {
    let models: Vec<(usize, f64)> = tried.iter().map(|tried| (tried.coefficients, tried.error().0)).collect();
    tried.iter_mut().zip(front(&models)).for_each(|(tried, on)| tried.front = on);
    if let Some(tried) = tried.get_mut(chosen) {
        tried.chosen = true;
    }
}

/// Errors that differ by less are the same.
const SAME: f64 = 1e-3;
const ROUNDING: f64 = 1e-9;

/// The least error; of errors that are the same the model with the fewest terms, then the lowest order. `None` when all diverge.
pub(crate) fn best<'a>(tried: impl Iterator<Item = &'a NarxCandidate> + Clone) -> Option<usize> {
    simplest(tried, |_| 0.0)
}

/// The fewest terms within one standard error of the least error, then the lowest order. Among hundreds of models, the
/// least error alone would take one that suits these very spans. `None` when all diverge.
pub(crate) fn best_within_one_standard_error<'a>(
    tried: impl Iterator<Item = &'a NarxCandidate> + Clone,
) -> Option<usize> {
    simplest(tried, |least| {
        let (mean, folds) = least.error();
        let moving = || folds.iter().filter(|error| !error.is_nan());
        let count = moving().count() as f64;
        let scatter: f64 = moving().map(|error| (error - mean).powi(2)).sum();
        if count > 1.0 { (scatter / (count - 1.0) / count).sqrt() } else { 0.0 }
    })
}

/// The simplest of the models whose error exceeds the least one by no more than the allowed excess; of equally simple
/// ones the best.
fn simplest<'a>(
    tried: impl Iterator<Item = &'a NarxCandidate> + Clone,
    allowed: impl Fn(&NarxCandidate) -> f64,
) -> Option<usize> {
    let error = |candidate: &NarxCandidate| candidate.error().0;
    let finite = || tried.clone().enumerate().filter(|(_, candidate)| error(candidate).is_finite());
    let (_, least) = finite().min_by(|a, b| error(a.1).total_cmp(&error(b.1)))?;
    let limit = error(least) + (error(least) * SAME + ROUNDING).max(allowed(least));
    let size =
        |c: &NarxCandidate| (c.regions * c.terms, c.order.degree, c.order.outputs + c.order.inputs, c.order.direct);
    let within = finite().filter(|(_, candidate)| error(candidate) <= limit);
    let simpler = |a: &NarxCandidate, b: &NarxCandidate| size(a).cmp(&size(b)).then(error(a).total_cmp(&error(b)));
    within.min_by(|a, b| simpler(a.1, b.1)).map(|(index, _)| index)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn simplest_candidate_within_one_error_is_chosen() {
        let of = |terms: usize, folds: [f64; 2]| NarxCandidate {
            partition: 0,
            specification: "average".into(),
            seed: 0,
            regions: 1,
            order: NarxOrder { outputs: 1, inputs: 1, degree: 2, direct: false, every: 1 },
            terms,
            rrse: (folds[0] + folds[1]) / 2.0,
            folds: folds.to_vec(),
            coefficients: terms,
            loss: None,
            losses: Vec::new(),
            bic: None,
            aic: None,
            front: false,
            chosen: false,
        };
        // The best has 0.2 with a standard error of 0.05.
        let tried =
            [of(3, [0.3, 0.5]), of(5, [0.24, 0.2]), of(5, [0.2, 0.26]), of(9, [0.15, 0.25]), of(1, [f64::INFINITY; 2])];
        assert_eq!(best(tried.iter()), Some(3));
        assert_eq!(best_within_one_standard_error(tried.iter()), Some(1), "the better of two that are as simple");
        assert_eq!(best_within_one_standard_error(tried[4..].iter()), None);
        // Errors of rounding are the same.
        let exact = [of(4, [1e-13, 3e-13]), of(3, [2e-12, 1e-11])];
        assert_eq!((best(exact.iter()), best_within_one_standard_error(exact.iter())), (Some(1), Some(1)));
    }

    /// A model of so many coefficients with this held-out error.
    fn with(coefficients: usize, rrse: f64) -> NarxCandidate {
        NarxCandidate {
            partition: 0,
            specification: "average".into(),
            seed: 0,
            regions: 1,
            order: NarxOrder { outputs: 1, inputs: 1, degree: 1, direct: false, every: 1 },
            terms: coefficients,
            rrse,
            folds: vec![rrse],
            coefficients,
            loss: None,
            losses: Vec::new(),
            bic: None,
            aic: None,
            front: false,
            chosen: false,
        }
    }

    proptest::proptest! {
        #[test]
        fn the_front_has_the_undominated_models(models in proptest::collection::vec((1usize..8, 0u8..9), 1..30)) {
            // An error of 8 stands for one that diverged.
            let error = |label: u8| if label == 8 { f64::INFINITY } else { f64::from(label) };
            let mut tried: Vec<NarxCandidate> = models.iter().map(|&(size, label)| with(size, error(label))).collect();
            mark(&mut tried, 0);
            proptest::prop_assert!(tried[0].chosen && tried[1..].iter().all(|tried| !tried.chosen));
            for (at, candidate) in tried.iter().enumerate() {
                let beats = |(place, other): (usize, &NarxCandidate)| {
                    let (size, less) = (other.coefficients <= candidate.coefficients, other.rrse <= candidate.rrse);
                    let better = other.coefficients < candidate.coefficients || other.rrse < candidate.rrse || place < at;
                    place != at && size && less && better
                };
                let beaten = !candidate.rrse.is_finite() || tried.iter().enumerate().any(beats);
                proptest::prop_assert_eq!(candidate.front, !beaten, "{:?}", candidate);
            }
        }
    }
}
