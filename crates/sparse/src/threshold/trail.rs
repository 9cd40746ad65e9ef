//! Models of an optimiser, one after the other.

/// Why an optimiser stopped at a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Status {
    /// By its rule: nothing changes any more.
    Converged,
    /// After as many iterations as were allowed. The model is valid, and may not be where the iteration would end.
    MaxIterations,
    /// Every term that is not fixed was removed.
    Empty,
}

/// Checks of a model that need no second run of its optimiser.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct StepCertificate {
    /// The largest `|x_j'(y - X b) - p_j b_j| / (|x_j| |y|)` over the support, p_j the ridge on the coefficient (0 for a refitted model): 0 up to rounding
    /// (times the condition number) for least squares on the support. Of a coefficient at one of its bounds the part that points inwards counts. Infinite where it cannot be computed. For [`Sr3`](crate::threshold::Sr3) without a refit it is
    /// that of its relaxed coefficients.
    pub correlation: f64,
    /// The largest |coefficient| over the threshold of any term when it was removed: below 1. 0 when none was, or there is no threshold.
    pub dropped: f64,
    /// The smallest |coefficient| over the threshold of any term, fixed ones not counted, when it was last compared and kept: at least 1. Infinite when none
    /// was, or there is no threshold.
    pub kept: f64,
}

/// One model of one target, p candidate columns.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Step {
    /// Coefficients (p), raw units: those of the target over those of the column.
    pub coefficients: Vec<f64>,
    /// Columns in the model, ascending.
    pub support: Vec<usize>,
    /// Weighted sum of squared errors on the rows of the problem, squared units of the target.
    pub rss: f64,
    /// Regressions that were made for it.
    pub iterations: usize,
    /// Why the optimiser stopped.
    pub status: Status,
    /// The threshold, the penalty lambda, or the number of terms.
    pub parameter: f64,
    /// Forward regression: the error reduction ratio of each term, in the order of [`Trail::order`]. Their sum is `1 - rss / y'y`.
    pub err: Option<Vec<f64>>,
    /// Groups of columns of the support that the rows cannot tell apart. Their coefficients are those of least norm in
    /// units of the columns' root mean squares.
    pub confounded: Vec<Vec<usize>>,
    /// Certificate of the model.
    pub certificate: StepCertificate,
}

impl Step {
    /// Number of terms.
    pub fn terms(&self) -> usize {
        self.support.len()
    }
}

/// The models of one target, from the first to the last that an optimiser made.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Trail {
    /// The models; at least one.
    pub steps: Vec<Step>,
    /// Index of the model that the optimiser itself would choose.
    pub chosen: usize,
    /// Columns in the order in which they entered (forward regression) or left (stepwise regression); empty for the others.
    pub order: Vec<usize>,
    /// Sum of squared errors below which no model is better than another: the rounding of the target, or what it is known to
    /// ([`Compressed::resolution`](fleetfoot_stats::Compressed)).
    pub rounding: f64,
}

impl Trail {
    pub(super) fn single(step: Step) -> Self {
        Self { steps: vec![step], chosen: 0, order: Vec::new(), rounding: 0.0 }
    }

    /// Indices of the models on the Pareto front of error against number of terms, the fewest terms first: no other model has as few terms and a smaller error,
    /// or fewer terms and as small an error.
    pub fn front(&self) -> Vec<usize> {
        let error = |k: usize| self.steps[k].rss.max(self.rounding);
        let mut order: Vec<usize> = (0..self.steps.len()).collect();
        order.sort_by(|&a, &b| {
            (self.steps[a].terms(), error(a)).partial_cmp(&(self.steps[b].terms(), error(b))).unwrap_or(a.cmp(&b))
        });
        let mut least = f64::INFINITY;
        order.retain(|&k| {
            let better = error(k) < least;
            least = least.min(error(k));
            better
        });
        order
    }

    /// The model that the optimiser itself would choose.
    pub fn choice(&self) -> &Step {
        &self.steps[self.chosen]
    }
}
