//! The mergeable sums of a polynomial plan.

use super::{PolynomialPlan, double::two_sum, kernel};
use crate::Sum;

/// Weighted sums over rows: Chebyshev moments of the base columns up to twice the library's degree, moments of the library with
/// each target, and products of the targets. Made by [`PolynomialPlan::moments`].
///
/// Every 1,024 rows the plain sums go into totals with a compensation term (Knuth's exact sum). The rounding therefore
/// does not grow with the number of rows. The result depends only on the rows of each `add`, the order of adds and
/// merges, and the instruction set (another vector width adds in another order).
#[derive(Debug, Clone, PartialEq)]
pub struct PolynomialMoments {
    rows: u64,
    totals: Vec<f64>,
    /// Rounding error of each total (compensated summation).
    lost: Vec<f64>,
}

/// Working memory of [`PolynomialMoments::add`], kept between calls by its user; made by [`PolynomialPlan::scratch`].
#[derive(Debug, Clone)]
pub struct PolynomialScratch(pub(super) kernel::Workspace);

impl PolynomialMoments {
    pub(super) fn new(sums: usize) -> Self {
        Self { rows: 0, totals: vec![0.0; sums], lost: vec![0.0; sums] }
    }

    /// Rows of positive weight.
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Sum of the weights.
    pub fn weight(&self) -> f64 {
        self.total(0)
    }

    /// Adds rows: one slice per base column and per target, all of one length; one weight a row, finite and not negative, or none for
    /// ones. A weight of w counts a row as w rows; rows of weight zero may hold anything, elsewhere NaN spoils the sums.
    ///
    /// A row so far outside the pilot sample that T_2D overflows (for degree 5 about 1e30 standard deviations) makes them infinite.
    ///
    /// # Panics
    /// If the numbers of columns are not the plan's, lengths differ, or `self` or `scratch` belong to a plan of another shape.
    pub fn add(
        &mut self,
        plan: &PolynomialPlan,
        scratch: &mut PolynomialScratch,
        base: &[&[f64]],
        targets: &[&[f64]],
        weights: Option<&[f64]>,
    ) {
        let rows = kernel::Rows { base, targets, weights, count: base.first().map_or(0, |column| column.len()) };
        assert_eq!((base.len(), targets.len()), (plan.variables(), plan.targets()), "columns of the plan");
        let columns = base.iter().chain(targets).chain(weights.as_ref());
        assert!(columns.into_iter().all(|column| column.len() == rows.count), "columns of one length");
        assert_eq!(self.totals.len(), plan.sums(), "moments of this plan");
        self.rows += weights.map_or(rows.count, |weights| weights.iter().filter(|&&w| w > 0.0).count()) as u64;
        let (totals, lost) = (&mut self.totals, &mut self.lost);
        plan.add_rows(rows, &mut scratch.0, |i, value| {
            let (sum, error) = two_sum(totals[i], value);
            totals[i] = sum;
            lost[i] += error;
        });
    }

    /// Adds the rows of `other`. Merging in a fixed order gives fixed bits; another order differs by rounding of the last place.
    ///
    /// # Panics
    /// If `other` belongs to a plan of another shape.
    pub fn merge(&mut self, other: &Self) {
        assert_eq!(self.totals.len(), other.totals.len(), "moments of one plan");
        self.rows += other.rows;
        for i in 0..self.totals.len() {
            let (sum, error) = two_sum(self.totals[i], other.totals[i]);
            self.totals[i] = sum;
            self.lost[i] += other.lost[i] + error;
        }
    }

    /// Returns true if all sums are finite: no row had a NaN, and no sum overflowed.
    pub fn is_finite(&self) -> bool {
        self.totals.iter().all(|total| total.is_finite())
    }

    pub(super) fn sums(&self) -> usize {
        self.totals.len()
    }

    pub(super) fn total(&self, index: usize) -> f64 {
        let total = self.totals[index] + self.lost[index];
        // An infinite total has a NaN for its lost part.
        if total.is_nan() { self.totals[index] } else { total }
    }

    pub(super) fn values(&self) -> Vec<f64> {
        (0..self.totals.len()).map(|i| self.total(i)).collect()
    }
}

impl Sum for PolynomialMoments {
    fn merge(&mut self, other: &Self) {
        PolynomialMoments::merge(self, other);
    }

    fn shape(&self) -> usize {
        self.sums()
    }

    fn words(shape: usize) -> Option<usize> {
        shape.checked_mul(2)?.checked_add(1)
    }

    fn write(&self, put: &mut dyn FnMut([u8; 8])) {
        put(self.rows.to_le_bytes());
        self.totals.iter().chain(&self.lost).for_each(|value| put(value.to_le_bytes()));
    }

    fn read(shape: usize, take: &mut dyn FnMut() -> Option<[u8; 8]>) -> Option<Self> {
        let rows = u64::from_le_bytes(take()?);
        let mut numbers = || (0..shape).map(|_| take().map(f64::from_le_bytes)).collect::<Option<Vec<_>>>();
        Some(Self { rows, totals: numbers()?, lost: numbers()? })
    }
}
