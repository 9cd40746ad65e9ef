//! Bootstrap of a dense design with more columns than a Gram matrix a replicate is worth: the rows of every replicate stay rows.

use std::sync::Arc;

use fleetfoot_data::{Progress, parallel_map};

use super::{BolassoError, Selection, resample::Fitted, selection::check_threshold};
use crate::{
    Penalty, Quadratic, Sign, SparseError,
    coordinate::{CoordinateOptions, coordinate_descent_from},
    dense::{DenseDesign, DenseRows},
};

/// The lassos of every replicate of [`dense_bootstrap`].
#[derive(Debug, Clone, PartialEq)]
pub struct DenseBootstrap {
    /// Strength of every target's lasso, in raw units (q).
    pub lambdas: Vec<f64>,
    /// True with a free intercept.
    pub intercept: bool,
    /// True if coefficients must not be negative.
    pub positive: bool,
    /// Number of draws of every row by every replicate (b vectors of n counts).
    pub counts: Vec<Vec<f64>>,
    /// [`BootstrapOptions::threshold`](crate::bolasso::BootstrapOptions::threshold).
    pub threshold: f64,
}

/// Bolasso of rows in memory, each replicate a lasso with the rows' weights times their counts (Bach 2008): the answers of
/// [`row_bootstrap`](crate::bolasso::row_bootstrap) and [`block_bootstrap`](crate::bolasso::block_bootstrap) with the same counts.
///
/// Those sum one Gram matrix a replicate. Here a replicate costs a few times rows times columns: coordinate descent starts from the solution of all rows,
/// and correlations of the columns that take part are all that is formed. The columns of the selection are those of the first target, its intercept
/// behind them where there is one, then those of the next.
///
/// # Errors
/// When an option is out of range, lengths disagree, all replicates are empty, a value is not finite, or the user stops it.
pub fn dense_bootstrap(
    rows: &Arc<dyn DenseRows>,
    weights: Option<&[f64]>,
    request: &DenseBootstrap,
    progress: &dyn Progress,
) -> Result<Selection, BolassoError> {
    check_threshold(request.threshold, 0.0)?;
    if request.counts.is_empty() {
        return Err(BolassoError::NoReplicates);
    }
    let (count, expected) = (request.lambdas.len(), rows.targets());
    if count != expected {
        return Err(SparseError::Length { what: "the list of the targets' lambdas", actual: count, expected }.into());
    }
    if let Some(length) = request.counts.iter().map(Vec::len).find(|&length| length != rows.rows()) {
        let expected = rows.rows();
        return Err(SparseError::Length { what: "the counts of a replicate", actual: length, expected }.into());
    }
    let whole = request.fit(rows, weights.map(<[f64]>::to_vec), None, progress)?;
    let replicates = parallel_map(request.counts.len(), progress, |replicate| {
        let drawn = |(row, count): (usize, &f64)| count * weights.map_or(1.0, |weights| weights[row]);
        let drawn: Vec<f64> = request.counts[replicate].iter().enumerate().map(drawn).collect();
        if drawn.iter().all(|&weight| weight == 0.0) {
            return Ok(None);
        }
        request.fit(rows, Some(drawn), Some(&whole.coefficients), progress).map(Some)
    })?;
    Selection::of(&replicates, whole.coefficients.len(), request.threshold)
}

impl DenseBootstrap {
    /// The lassos of all targets with these weights, from these coefficients on.
    fn fit(
        &self,
        rows: &Arc<dyn DenseRows>,
        weights: Option<Vec<f64>>,
        start: Option<&[f64]>,
        progress: &dyn Progress,
    ) -> Result<Fitted, BolassoError> {
        let design = DenseDesign::for_few(rows.clone(), weights, progress)?;
        let p = rows.regressors();
        let width = p + usize::from(self.intercept);
        let mut fitted = Fitted { coefficients: Vec::new(), weight: 0.0, kkt: 0.0, stalled: false, converged: true };
        for (target, problem) in design.problems(None, self.intercept)?.iter().enumerate() {
            let zeros = vec![0.0; p];
            let start = start.map_or(zeros.as_slice(), |start| &start[target * width..][..p]);
            self.add(&mut fitted, problem, self.lambdas[target], start)?;
        }
        Ok(fitted)
    }

    fn add(&self, fitted: &mut Fitted, problem: &Quadratic, lambda: f64, start: &[f64]) -> Result<(), SparseError> {
        let signs = if self.positive { vec![Sign::NonNegative; start.len()] } else { Vec::new() };
        let penalty = Penalty { signs, ..Penalty::default() };
        let solutions = coordinate_descent_from(problem, &penalty, &[lambda], &CoordinateOptions::default(), start)?;
        let solution = &solutions.first().ok_or(SparseError::NoRows)?.solution;
        fitted.coefficients.extend(solution.dense(start.len()));
        fitted.coefficients.extend(self.intercept.then_some(solution.intercept));
        fitted.weight = problem.weight();
        fitted.kkt = fitted.kkt.max(solution.certificate.kkt);
        fitted.converged &= solution.converged;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;

    use faer::Mat;
    use fleetfoot_data::{Silent, with_threads};

    use super::*;
    use crate::lars::lasso_at;

    /// Rows of three quarters as many values as columns, and two targets.
    #[derive(Debug)]
    struct Waves;

    const ROWS: usize = 30;
    const COLUMNS: usize = 40;

    impl Waves {
        fn value(row: usize, column: usize) -> f64 {
            match column {
                COLUMNS => 2.0 * Self::value(row, 3) - Self::value(row, 8) + 0.1 * (row as f64 * 2.3).sin() + 4.0,
                41 => -Self::value(row, 20) + 0.2 * (row as f64 * 1.1).cos(),
                j => ((row * (j + 3) + 5 * j) as f64 * 0.37).sin() + 1.0,
            }
        }
    }

    impl DenseRows for Waves {
        fn rows(&self) -> usize {
            ROWS
        }

        fn regressors(&self) -> usize {
            COLUMNS
        }

        fn targets(&self) -> usize {
            2
        }

        fn read(&self, rows: Range<usize>, out: &mut Vec<f64>) {
            (0..COLUMNS + 2).for_each(|j| out.extend(rows.clone().map(|row| Self::value(row, j))));
        }
    }

    #[test]
    fn replicates_are_lassos_of_counted_rows() {
        let rows: Arc<dyn DenseRows> = Arc::new(Waves);
        let weights: Vec<f64> = (0..ROWS).map(|row| 0.5 + (row % 4) as f64).collect();
        let counts = |replicate: usize| (0..ROWS).map(|row| ((row * 7 + 3 * replicate) % 5 % 3) as f64).collect();
        let mut counts: Vec<Vec<f64>> = (0..4).map(counts).collect();
        counts.push(vec![0.0; ROWS]);
        let lambdas = vec![0.05, 0.02];
        let request = DenseBootstrap { lambdas, intercept: true, positive: false, counts, threshold: 1.0 };
        let run =
            |threads| with_threads(threads, || dense_bootstrap(&rows, Some(&weights), &request, &Silent).unwrap());
        let on_one_thread = run(1);
        assert_eq!(on_one_thread, run(3));
        assert_eq!((on_one_thread.empty, on_one_thread.unconverged), (1, 0));
        assert!(on_one_thread.worst_kkt < 1e-9);
        let x = Mat::from_fn(ROWS, COLUMNS, Waves::value);
        for (b, counts) in request.counts[..4].iter().enumerate() {
            let drawn: Vec<f64> = counts.iter().zip(&weights).map(|(count, weight)| count * weight).collect();
            for target in 0..2 {
                let y: Vec<f64> = (0..ROWS).map(|row| Waves::value(row, COLUMNS + target)).collect();
                let problem = Quadratic::from_rows(x.as_ref(), &y, Some(&drawn), true).unwrap();
                let path = lasso_at(&problem, &Penalty::default(), request.lambdas[target]).unwrap().unwrap();
                let (dense, width) = (path.dense(COLUMNS), COLUMNS + 1);
                (0..COLUMNS).for_each(|j| {
                    assert!(
                        (on_one_thread.coefficients[(b, target * width + j)] - dense[j]).abs() < 1e-7,
                        "{b} {target} {j}"
                    );
                });
                assert!((on_one_thread.coefficients[(b, target * width + COLUMNS)] - path.intercept).abs() < 1e-7);
            }
        }
    }

    #[test]
    fn contradicting_options_are_refused() {
        let rows: Arc<dyn DenseRows> = Arc::new(Waves);
        let good = DenseBootstrap {
            lambdas: vec![0.1; 2],
            intercept: false,
            positive: true,
            counts: vec![vec![1.0; ROWS]],
            threshold: 0.9,
        };
        let bootstrap = dense_bootstrap(&rows, None, &good, &Silent).unwrap();
        assert!(bootstrap.coefficients.col_iter().all(|column| column[0] >= 0.0));
        for bad in [
            DenseBootstrap { lambdas: vec![0.1], ..good.clone() },
            DenseBootstrap { counts: vec![vec![1.0; 3]], ..good.clone() },
            DenseBootstrap { counts: Vec::new(), ..good.clone() },
            DenseBootstrap { counts: vec![vec![0.0; ROWS]], ..good.clone() },
            DenseBootstrap { threshold: 0.0, ..good.clone() },
        ] {
            assert!(dense_bootstrap(&rows, None, &bad, &Silent).is_err());
        }
    }
}
