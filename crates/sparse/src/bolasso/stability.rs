//! Stability selection by complementary halves, with its bounds on false selections.

use fleetfoot_data::Progress;

use super::{
    BolassoError, BootstrapUnit,
    counts::halves,
    joint::Joint,
    resample::descend,
    selection::{at_least, check_threshold},
    unit::enough,
};
use crate::{
    PathStatus,
    lars::{LarsOptions, lars},
    penalty::check_strength,
    structured::Assembly,
};
use fleetfoot_sums::structured::{Banks, Structure};

/// Options of a stability selection.
#[derive(Debug, Clone, PartialEq)]
pub struct StabilityOptions {
    /// Number of complementary pairs of halves, B: twice as many lassos. Shah and Samworth recommend 50.
    pub pairs: usize,
    /// The lambdas over which the largest frequency counts.
    pub lambdas: Vec<f64>,
    /// Seed of the halves.
    pub seed: u64,
    /// Share of the halves that must select a column, above 1/2: pi of Meinshausen and Buehlmann.
    pub threshold: f64,
}

/// Result of a stability selection, p columns.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Stability {
    /// Share of the halves that select each column, the largest over lambda (p).
    pub frequency: Vec<f64>,
    /// Share of the halves that select each column at each lambda of the grid, in its order.
    pub by_lambda: Vec<Vec<f64>>,
    /// Columns whose frequency reaches the threshold, ascending.
    pub support: Vec<usize>,
    /// q: mean number of columns that a half selects somewhere on the grid.
    pub selected: f64,
    /// Bound of the expected number of falsely selected columns, `q^2 / ((2 pi - 1) p)` (Meinshausen and Buehlmann 2010, theorem 1: under exchangeable noise
    /// columns, and a lasso no worse than guessing). Without these assumptions it bounds the expected number of selected columns that a half selects
    /// with probability q/p or less (Shah and Samworth 2013, theorem 1).
    pub bound: f64,
    /// The bound of complementary pairs where the distribution of the simultaneous frequencies is unimodal (Shah and Samworth 2013, theorem 2, equations
    /// (7) and (8)); `None` where the theorem does not hold: q/p above 1/sqrt(3), or a threshold too near 1/2.
    pub unimodal_bound: Option<f64>,
    /// The largest violation of the optimality conditions of any solution, as a correlation.
    pub worst_kkt: f64,
    /// Halves whose path ended before the smallest lambda and that coordinate descent finished.
    pub stalled: usize,
}

/// The columns that one half selects.
struct Half {
    /// Lambda by lambda.
    supports: Vec<Vec<usize>>,
    kkt: f64,
    stalled: bool,
}

/// Stability selection (Meinshausen and Buehlmann 2010) by complementary pairs (Shah and Samworth 2013): the units (episodes, or chunks) are divided at
/// random into two halves, B times; the lasso path of every half is followed once, and read at all lambdas.
///
/// # Errors
/// When an option is out of range, there are fewer than two units, the assembly does not fit, the statistic is not finite, or the user stops it.
pub fn stability_selection(
    structure: &Structure,
    banks: &Banks,
    assembly: &Assembly,
    unit: BootstrapUnit,
    options: &StabilityOptions,
    progress: &dyn Progress,
) -> Result<Stability, BolassoError> {
    if options.pairs == 0 {
        return Err(BolassoError::NoReplicates);
    }
    check_threshold(options.threshold, 0.5)?;
    if options.lambdas.is_empty() {
        return Err(BolassoError::NoLambdas);
    }
    for &lambda in &options.lambdas {
        check_strength("lambda", lambda)?;
    }
    enough(super::joint::units(banks.keys(), banks.rows(), unit).len(), unit, 2)?;
    let joint = Joint::new(structure, banks, assembly, unit, progress)?;
    let units = joint.units();
    let resampled = joint.resample(
        2 * options.pairs,
        progress,
        |half| {
            let [a, b] = halves(options.seed, half / 2, units);
            if half.is_multiple_of(2) { a } else { b }
        },
        |sums| {
            let problem = joint.frame.problem(sums)?;
            supports(&problem, &joint.frame.penalty, &options.lambdas)
        },
    )?;
    Ok(summary(&resampled, structure.coefficients(), options))
}

fn supports(problem: &crate::Quadratic, penalty: &crate::Penalty, lambdas: &[f64]) -> Result<Half, BolassoError> {
    let least = lambdas.iter().copied().fold(f64::INFINITY, f64::min);
    let path = lars(problem, penalty, &LarsOptions { lambda_min: least, ..LarsOptions::default() })?;
    let stalled = path.status == PathStatus::Stalled;
    let mut kkt = path.knots.iter().map(|knot| knot.certificate.kkt).fold(0.0, f64::max);
    let mut supports = Vec::with_capacity(lambdas.len());
    let end = path.knots.last().map_or(f64::INFINITY, |knot| knot.l1);
    for &lambda in lambdas {
        let selected = |values: Vec<f64>| (0..values.len()).filter(|&j| values[j] != 0.0).collect();
        supports.push(if lambda >= end {
            selected(path.coefficients(lambda)?)
        } else {
            let solution = descend(problem, penalty, lambda)?;
            kkt = kkt.max(solution.certificate.kkt);
            solution.support
        });
    }
    Ok(Half { supports, kkt, stalled })
}

fn summary(halves_drawn: &[Option<Half>], p: usize, options: &StabilityOptions) -> Stability {
    let halves = halves_drawn.iter().flatten().count().max(1) as f64;
    let mut by_lambda = vec![vec![0.0; p]; options.lambdas.len()];
    let mut selected = 0.0;
    for half in halves_drawn.iter().flatten() {
        let mut anywhere = vec![false; p];
        for (frequency, support) in by_lambda.iter_mut().zip(&half.supports) {
            for &j in support {
                frequency[j] += 1.0;
                anywhere[j] = true;
            }
        }
        selected += anywhere.iter().filter(|&&selected| selected).count() as f64 / halves;
    }
    by_lambda.iter_mut().flatten().for_each(|count| *count /= halves);
    let frequency: Vec<f64> =
        (0..p).map(|j| by_lambda.iter().map(|frequency| frequency[j]).fold(0.0, f64::max)).collect();
    let share = selected / p.max(1) as f64;
    Stability {
        support: at_least(&frequency, options.threshold),
        bound: selected * share / (2.0 * options.threshold - 1.0),
        unimodal_bound: unimodal(options.threshold, options.pairs as f64, share)
            .map(|factor| factor * selected * share),
        frequency,
        by_lambda,
        selected,
        worst_kkt: halves_drawn.iter().flatten().map(|half| half.kkt).fold(0.0, f64::max),
        stalled: halves_drawn.iter().flatten().filter(|half| half.stalled).count(),
    }
}

/// The factor C(tau, B) of Shah and Samworth (2013), theorem 2, in `C theta q`.
fn unimodal(tau: f64, pairs: f64, theta: f64) -> Option<f64> {
    let least = (0.5 + theta * theta).min(0.5 + 1.0 / (2.0 * pairs) + 0.75 * theta * theta);
    if theta > 1.0 / 3.0_f64.sqrt() || tau <= least {
        return None;
    }
    Some(if tau <= 0.75 {
        0.5 / (2.0 * tau - 1.0 - 0.5 / pairs)
    } else {
        4.0 * (1.0 - tau + 0.5 / pairs) / (1.0 + 1.0 / pairs)
    })
    .filter(|factor| *factor > 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unimodal_factor_matches_paper() {
        // Continuous at 3/4 up to terms of 1/B, and below the worst case 1 / (2 tau - 1) everywhere.
        let near = |a: f64, b: f64| (a - b).abs() < 1e-9;
        assert!(near(unimodal(0.75, 1e12, 0.1).unwrap(), 1.0));
        assert!(near(unimodal(0.75 + 1e-13, 1e12, 0.1).unwrap(), 1.0));
        // By hand: tau = 0.9, B = 50: 4 (0.1 + 0.01) / 1.02; tau = 0.6: 1 / (2 (0.2 - 0.01)).
        assert!(near(unimodal(0.9, 50.0, 0.1).unwrap(), 0.44 / 1.02));
        assert!(near(unimodal(0.6, 50.0, 0.1).unwrap(), 1.0 / 0.38));
        assert_eq!(unimodal(0.9, 50.0, 0.6), None);
        assert_eq!(unimodal(0.505, 50.0, 0.2), None);
        for tau in [0.6, 0.7, 0.75, 0.8, 0.9, 1.0] {
            assert!(unimodal(tau, 50.0, 0.1).unwrap() < 1.0 / (2.0 * tau - 1.0));
        }
    }
}
