//! The problem of an identification (columns, library, equations) and its options.

use fleetfoot_library::Expr;
use fleetfoot_model::{Column, Equation, UnseenLabel};
use fleetfoot_stats::Purge;

use crate::{Phase, Specification};

/// The problem of an identification, over the columns (aliases) of a source.
#[derive(Debug, Clone)]
pub struct Problem {
    /// The columns of the model.
    pub columns: Vec<Column>,
    /// Candidate functions, the constant left out: the regressor of equation (5) without its 1.
    pub library: Vec<Expr>,
    /// Equations: those with a target are fitted, each to the latent that its right side names; the others are given.
    pub equations: Vec<Equation>,
    /// Partition columns (angles as cosine and sine).
    pub partition_columns: Vec<Expr>,
    /// Non-negative row weights: a row of weight w counts as if its squared error counted w times. Their scale has no
    /// effect: together they count as the effective number of rows, `(sum w)^2 / sum w^2`.
    pub weight: Option<Expr>,
    /// Sampling period, seconds.
    pub step: f64,
}

/// Options of an identification.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Options {
    /// Partitions to fit; the choice among them is [`Options::selection`]'s.
    pub partitions: Vec<Specification>,
    /// Folds of cross-validation; 0 or 1: none.
    pub folds: u16,
    /// Rows on either side of a held-out span that do not train; `None`: a tenth of the span. Rows that share samples with it never train.
    pub purge: Option<usize>,
    /// Rows over which the source was smoothed before; 0 where it was not.
    pub smoothed: usize,
    /// Rule of the choice among several partitions.
    pub selection: Selection,
    /// Pull of each region towards the one-region model.
    pub shrinkage: Shrinkage,
    /// Bound of the norm of every region's map over one sampling period, in a metric that all share (1: stable); `None`: free. See [`crate::Stability`].
    pub stability: Option<f64>,
    /// Ports at which the regions are to be passive. They contract too, with the bound 1 if none is given. See
    /// [`crate::Passivity`].
    pub ports: Vec<crate::Port>,
    /// Treatment of labels not seen in training.
    pub unseen: UnseenLabel,
    /// Seed of k-means++.
    pub seed: u64,
    /// Restarts of k-means, best kept.
    pub restarts: usize,
    /// Iterations of k-means at most.
    pub iterations: usize,
    /// Starting centroids (k x columns, standardised) in place of k-means++, for each partition that clusters.
    pub start: Option<Vec<f64>>,
    /// Fit the kept models by TSQR, the R factor of the rows themselves, in one more pass each: the accuracy of Householder QR whatever the pilot.
    pub tsqr: bool,
    /// Give the models of all partitions, not only the chosen one.
    pub keep_all: bool,
    /// True if the maps of neighbouring regions are to meet at their border.
    pub continuous: bool,
    /// A phase along which regions are counted, and from stride to stride; rows without it do not train.
    pub phase: Option<Phase>,
    /// Outside of what a region saw in training.
    pub outside: Outside,
    /// Bytes for the rows that k-means keeps; beyond it a hashed sample is clustered.
    pub memory: usize,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            partitions: vec![Specification::Average],
            folds: 10,
            purge: None,
            smoothed: 0,
            selection: Selection::CrossValidation,
            shrinkage: Shrinkage::Auto,
            stability: None,
            ports: Vec::new(),
            unseen: UnseenLabel::Refuse,
            seed: 0,
            restarts: 1,
            iterations: 100,
            start: None,
            tsqr: false,
            keep_all: false,
            continuous: false,
            phase: None,
            outside: Outside::Extrapolate,
            memory: 512 << 20,
        }
    }
}

impl Options {
    /// The gap beside held-out rows, where lags and differences reach over `halo` rows in all.
    pub fn gap(&self, halo: usize) -> Purge {
        let shared = halo.saturating_add(self.smoothed);
        match self.purge {
            None => Purge::Alike { shared, correlated: usize::MAX },
            Some(rows) => Purge::Exactly(rows.max(shared)),
        }
    }
}

/// Extrapolation of a model of several regions beyond the training range of a region.
///
/// Maps that meet at borders, and maps that are bounded, are followed everywhere: what they promise holds of the maps themselves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Outside {
    /// From the border of the range on by the slopes of the one-region model.
    Average,
    /// As at the border of the range.
    Hold,
    /// By the map of the region.
    #[default]
    Extrapolate,
}

/// Rule that chooses one of several partitions.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Selection {
    /// The smallest whose cross-validated error is within one standard error of the best.
    CrossValidation,
    /// The lowest Bayesian information criterion, with the effective sample size.
    Bic,
    /// The partition of this index, which the caller has chosen.
    Given(usize),
}

/// Pull of each region towards the one-region model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shrinkage {
    /// As if each region had seen this many more rows of standardised regressors that obey the one-region model.
    Rows(f64),
    /// That of the least held-out losses (the mean of their logarithms over the folds), one value for all regions of a
    /// partition. Of losses within a thousandth the smaller pull. None without folds.
    Auto,
}
