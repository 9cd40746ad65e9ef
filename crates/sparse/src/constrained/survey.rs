//! A pass over rows for those that break a limit.

use faer::{Mat, Side};
use fleetfoot_data::{Progress, Source, packed};
use fleetfoot_library::{Design, DesignRows, Expr};
use fleetfoot_stats::{Grid, reduce};

use super::{ConstrainedError, LinearConstraint, RowLimit};
use fleetfoot_sums::structured::Regression;

/// A row of the data that breaks a limit.
#[derive(Debug, Clone)]
pub(super) struct Breach {
    /// Distance from the bound, negative.
    clearance: f64,
    pub(super) episode: usize,
    pub(super) row: usize,
    /// The side's coefficients: `direction' matrix direction >= bound` cuts off what broke it.
    coefficients: Vec<(usize, f64)>,
    bound: f64,
}

/// Result of a pass for one limit.
#[derive(Debug, Clone)]
pub(super) struct LimitSurvey {
    /// Least distance from the bound; negative where it is broken.
    pub(super) least: f64,
    /// Episode and row.
    pub(super) place: Option<(usize, usize)>,
    /// The largest absolute value of an entry.
    pub(super) size: f64,
    pub(super) breaches: Vec<Breach>,
}

impl LimitSurvey {
    fn new() -> Self {
        Self { least: f64::INFINITY, place: None, size: 0.0, breaches: Vec::new() }
    }

    /// Joins what later rows say, and keeps the worst breaches; of equals, the earlier.
    fn merge(&mut self, other: Self, keep: usize) {
        if other.least < self.least {
            (self.least, self.place) = (other.least, other.place);
        }
        self.size = self.size.max(other.size);
        self.breaches.extend(other.breaches);
        self.breaches.sort_by(|a, b| a.clearance.total_cmp(&b.clearance));
        self.breaches.truncate(keep);
    }
}

/// Limits, compiled for a source.
pub(super) struct Survey<'a> {
    regression: &'a Regression,
    limits: Vec<&'a RowLimit>,
    source: &'a dyn Source,
    /// [`RowLimit::expressions`] of every limit.
    design: Design,
}

impl<'a> Survey<'a> {
    pub(super) fn new(
        regression: &'a Regression,
        limits: Vec<&'a RowLimit>,
        source: &'a dyn Source,
    ) -> Result<Self, ConstrainedError> {
        let expressions: Vec<Expr> = limits.iter().flat_map(|limit| limit.expressions(regression)).collect();
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        Ok(Self { regression, limits, source, design: Design::compile(&expressions, &names)? })
    }

    /// One pass over all rows.
    pub(super) fn pass(
        &self,
        theta: &[f64],
        keep: usize,
        progress: &dyn Progress,
    ) -> Result<Vec<LimitSurvey>, ConstrainedError> {
        let chunks = Grid { chunk_rows: 65_536 }.chunks(self.source.episodes());
        let empty = || vec![LimitSurvey::new(); self.limits.len()];
        let mut total = empty();
        reduce(
            self.source,
            &chunks,
            self.design.halo(),
            progress,
            || (empty(), DesignRows::default()),
            |(surveys, rows), chunk, block, tile| {
                self.design.evaluate(block, tile, rows);
                let mut first = 0;
                for (&limit, survey) in self.limits.iter().zip(surveys) {
                    let tile = Tile::new(limit, self.regression, rows, &mut first);
                    survey.merge(tile.worst(theta, chunk.episode, block.first), keep);
                }
                Ok::<_, ConstrainedError>(())
            },
            |_, (surveys, _)| {
                total.iter_mut().zip(surveys).for_each(|(total, survey)| total.merge(survey, keep));
                Ok(())
            },
        )?;
        Ok(total)
    }

    /// The side of a limit that cuts off a breach, tightened by the margin.
    pub(super) fn constraint(&self, at: usize, breach: &Breach, margin: f64) -> LinearConstraint {
        let limit = self.limits[at];
        let place = match limit.is_constant(self.regression) {
            true => String::new(),
            false => format!(" at row {} of {}", breach.row + 1, self.source.episodes()[breach.episode].name),
        };
        LinearConstraint {
            name: format!("{} {} {}{place}", limit.name, limit.side.symbol(), limit.bound),
            coefficients: breach.coefficients.clone(),
            bound: breach.bound + margin,
        }
    }
}

/// One limit at the rows of one tile.
struct Tile<'a> {
    limit: &'a RowLimit,
    rows: &'a DesignRows,
    /// Of every form the coefficients and, in `rows`, the first of their products; the form's rest stands behind them.
    forms: Vec<(Vec<usize>, usize)>,
    /// The bound in `rows`.
    bound: usize,
}

impl<'a> Tile<'a> {
    /// Takes the outputs from `first` on, and leaves it behind them.
    fn new(limit: &'a RowLimit, regression: &'a Regression, rows: &'a DesignRows, first: &mut usize) -> Self {
        let mut forms = Vec::with_capacity(limit.forms.len());
        for form in 0..limit.forms.len() {
            let coefficients: Vec<usize> = limit.coefficients(form, regression).collect();
            let behind = *first + coefficients.len() + 1;
            forms.push((coefficients, std::mem::replace(first, behind)));
        }
        let bound = *first;
        *first += 1;
        Self { limit, rows, forms, bound }
    }

    /// Only the tile's worst row can become a constraint, since its neighbours say much the same.
    fn worst(&self, theta: &[f64], episode: usize, offset: usize) -> LimitSurvey {
        let (rows, sign) = (self.rows, self.limit.side.sign());
        let entries: Vec<Vec<f64>> = self.forms.iter().map(|form| self.values(form, theta)).collect();
        let bounds = rows.output(self.bound);
        let order = self.limit.order();
        let (mut survey, mut worst) = (LimitSurvey::new(), None);
        let mut matrix = vec![0.0; entries.len()];
        for (i, &bound) in bounds.iter().enumerate() {
            for (entry, values) in matrix.iter_mut().zip(&entries) {
                *entry = sign * values[i];
                survey.size = survey.size.max(entry.abs());
            }
            let bound = sign * bound;
            if discs(&matrix, order) - bound < survey.least {
                let (least, direction) = least_eigenvalue(&matrix, order);
                if least - bound < survey.least {
                    (survey.least, worst) = (least - bound, Some((i, direction)));
                }
            }
        }
        let Some((i, direction)) = worst else { return survey };
        survey.place = Some((episode, offset + rows.index[i]));
        if survey.least < 0.0 {
            let mut coefficients = Vec::new();
            let mut bound = sign * bounds[i];
            for row in 0..order {
                for column in 0..=row {
                    let (of, first) = &self.forms[packed(row, column)];
                    let twice = if row == column { 1.0 } else { 2.0 };
                    let weight = sign * twice * direction[row] * direction[column];
                    let product = |(k, &j): (usize, &usize)| (j, weight * rows.output(first + k)[i]);
                    coefficients.extend(of.iter().enumerate().map(product));
                    bound -= weight * rows.output(first + of.len())[i];
                }
            }
            let row = offset + rows.index[i];
            survey.breaches.push(Breach { clearance: survey.least, episode, row, coefficients, bound });
        }
        survey
    }

    /// A form at every row.
    fn values(&self, (coefficients, first): &(Vec<usize>, usize), theta: &[f64]) -> Vec<f64> {
        let mut values = vec![0.0; self.rows.rows()];
        for (k, theta) in coefficients.iter().map(|&j| theta[j]).enumerate().filter(|(_, theta)| *theta != 0.0) {
            values.iter_mut().zip(self.rows.output(first + k)).for_each(|(value, phi)| *value += theta * phi);
        }
        let rest = self.rows.output(first + coefficients.len());
        values.iter_mut().zip(rest).for_each(|(value, rest)| *value += rest);
        values
    }
}

/// Lower bound of the eigenvalues: the least end of Gershgorin's discs. For a matrix of one entry, that entry.
fn discs(matrix: &[f64], order: usize) -> f64 {
    let disc = |i: usize| {
        let beside: f64 = (0..order).filter(|&j| j != i).map(|j| matrix[packed(i, j)].abs()).sum();
        matrix[packed(i, i)] - beside
    };
    (0..order).map(disc).fold(f64::INFINITY, f64::min)
}

/// The least eigenvalue of a symmetric matrix (packed) and its eigenvector of unit length.
fn least_eigenvalue(matrix: &[f64], order: usize) -> (f64, Vec<f64>) {
    if order == 1 {
        return (matrix[0], vec![1.0]);
    }
    let full = Mat::from_fn(order, order, |i, j| matrix[packed(i, j)]);
    match full.self_adjoint_eigen(Side::Lower) {
        // In ascending order.
        Ok(eigen) => (eigen.S()[0], eigen.U().col(0).iter().copied().collect()),
        // It refuses what is not finite alone, and such rows are left out.
        Err(_) => (f64::NAN, vec![0.0; order]),
    }
}
