//! Values of a score.

use fleetfoot_data::EpisodeId;

use crate::{Baseline, Basis, Estimate, RawError};

/// The one-step scores of a model on a recording.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Scores {
    /// Rows scored.
    pub rows: u64,
    /// Rows that were not, and why.
    pub skipped: Skipped,
    /// Scored rows with a regressor outside the range of its region (those outside of all training included).
    pub outside_region: u64,
    /// Scored rows with a regressor outside the range of all training rows.
    pub outside_training: u64,
    /// One entry a fitted equation.
    pub targets: Vec<TargetScore>,
    /// Mean Mahalanobis score (equation 10) of the error vector under the training targets' covariance.
    pub mahalanobis: Estimate,
    /// The same under the covariance of the measured targets of these rows, on [`Self::sampled_rows`] rows.
    pub mahalanobis_measured: f64,
    /// Rows behind [`Self::mahalanobis_measured`] and [`Self::calibration`]: all, or an even sample of about 262,144.
    pub sampled_rows: u64,
    /// Distance to the region's centre against the score of the prediction (Fig. 6 of Buchan, Haldane, Fearing), by bins of equally many rows.
    pub calibration: Vec<CalibrationBin>,
    /// One entry an episode with scored rows, in the order of the source.
    pub episodes: Vec<EpisodeScore>,
    /// Parts that the intervals compare.
    pub basis: Basis,
}

/// Rows without a score.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Skipped {
    /// A lag or lead would cross the border of the episode.
    pub border: u64,
    /// A value is missing.
    pub missing: u64,
    /// The label was not seen in training.
    pub no_region: u64,
    /// The model gives no finite number.
    pub non_finite: u64,
}

/// The scores of one fitted equation. Errors are measured minus predicted.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct TargetScore {
    /// The left side: `d(vx)/dt`.
    pub name: String,
    /// The unit of the left side.
    pub unit: Option<String>,
    /// Mean absolute error.
    pub mae: Estimate,
    /// Mean absolute error over that of the null model on the same rows: the numbers printed in Table I of Buchan,
    /// Haldane, Fearing (their null model scores 1 everywhere). For a constant target 0 if the model has no error,
    /// else 1.
    pub mae_over_null: Estimate,
    /// Mean absolute error over the standard deviation of the training target, as the caption of their table says.
    pub mae_over_sigma: f64,
    /// Root of the mean squared error.
    pub rmse: f64,
    /// Coefficient of determination, against the mean of these rows. Of a constant target 1 for a model without error, else 0, as in scikit-learn.
    pub r2: f64,
    /// Explained variance `1 - var(error) / var(target)`: [`Self::r2`] of a model without its bias. Of a constant
    /// target as [`Self::r2`].
    pub explained_variance: f64,
    /// Mean error.
    pub bias: f64,
    /// Largest absolute error.
    pub max: f64,
    /// Standard deviation of the target over these rows.
    pub deviation: f64,
    /// The null model, persistence and constant velocity.
    pub baselines: Vec<BaselineScore>,
    /// The errors against raw measurements, where these are at hand and the left side is measured.
    pub raw: Option<RawError>,
}

/// A baseline, on the rows for which it and the target are known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BaselineScore {
    /// The baseline.
    pub baseline: Baseline,
    /// Rows on which it is known.
    pub rows: u64,
    /// Its mean absolute error.
    pub mae: f64,
    /// The root of its mean squared error.
    pub rmse: f64,
    /// The model's mean absolute error on the same rows.
    pub model_mae: f64,
    /// The root of the model's mean squared error on the same rows.
    pub model_rmse: f64,
}

/// The scores of one episode.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct EpisodeScore {
    /// Index in the source.
    pub episode: usize,
    /// Identity.
    pub id: EpisodeId,
    /// For people.
    pub name: String,
    /// True if the model was trained on it; its scores are then in-sample.
    pub in_training: bool,
    /// Rows scored.
    pub rows: u64,
    /// Mean absolute error of each target.
    pub mae: Vec<f64>,
    /// The same over the null model's.
    pub mae_over_null: Vec<f64>,
    /// Root of the mean squared error of each target.
    pub rmse: Vec<f64>,
    /// Mean Mahalanobis score under the training targets' covariance.
    pub mahalanobis: f64,
}

/// Equally many rows, neighbours in their distance from the region's centre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalibrationBin {
    /// Rows in the bin.
    pub rows: u64,
    /// Mean input score: Mahalanobis distance of the regressors from their region's mean under the covariance of all training rows.
    pub input: f64,
    /// Mean output score: Mahalanobis score of the error under the training targets' covariance.
    pub output: f64,
}
