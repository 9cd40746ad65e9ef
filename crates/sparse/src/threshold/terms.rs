//! Columns that an equation may use, and those that it must use.

use fleetfoot_stats::Compressed;

use super::ThresholdError;

/// Candidate columns of an equation, p in all.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Terms {
    /// Columns that may be used (p); `None`: all.
    pub allowed: Option<Vec<bool>>,
    /// Columns that are always in the model: never thresholded, dropped or penalised.
    pub fixed: Vec<usize>,
    /// Least and greatest value of every coefficient in raw units (p), infinite ends open; `None`: all are free. A column whose bounds exclude 0 is always in the model.
    pub bounds: Option<Vec<[f64; 2]>>,
}

/// Terms that were checked against a problem.
#[derive(Debug, Clone)]
pub(super) struct Checked {
    /// Columns that may be used, fixed ones included, ascending.
    pub(super) open: Vec<usize>,
    /// For each column: true if it is always in the model (p).
    pub(super) fixed: Vec<bool>,
    /// Least and greatest value of every coefficient (p); empty where all are free.
    pub(super) bounds: Vec<[f64; 2]>,
}

impl Terms {
    /// All columns allowed, none fixed.
    pub fn all() -> Self {
        Self::default()
    }

    pub(super) fn checked(&self, problem: &Compressed) -> Result<Checked, ThresholdError> {
        let columns = problem.columns();
        if let Some(allowed) = self.allowed.as_ref().filter(|allowed| allowed.len() != columns) {
            let (count, expected) = (allowed.len(), columns);
            let what = "the list of allowed columns";
            return Err(crate::SparseError::Length { what, actual: count, expected }.into());
        }
        let allowed = |j: usize| self.allowed.as_ref().is_none_or(|allowed| allowed[j]);
        let mut fixed = vec![false; columns];
        for &column in &self.fixed {
            if column >= columns {
                return Err(ThresholdError::NoSuchColumn { what: "fixed", column, columns });
            }
            if !allowed(column) {
                return Err(ThresholdError::FixedNotAllowed { column });
            }
            fixed[column] = true;
        }
        let bounds = self.bounds.clone().unwrap_or_default();
        if !bounds.is_empty() && bounds.len() != columns {
            let (what, count) = ("the list of bounds", bounds.len());
            return Err(crate::SparseError::Length { what, actual: count, expected: columns }.into());
        }
        for (column, &[low, high]) in bounds.iter().enumerate() {
            // NaN bounds nothing and is never meant.
            if !(low <= high && low < f64::INFINITY && high > f64::NEG_INFINITY) {
                return Err(ThresholdError::Bounds { column, low, high });
            }
            fixed[column] |= allowed(column) && !(low <= 0.0 && high >= 0.0);
        }
        Ok(Checked { open: (0..columns).filter(|&j| allowed(j)).collect(), fixed, bounds })
    }

    /// Refuses bounds where the regressions of a method cannot keep them.
    pub(super) fn refuse_bounds(&self, method: &'static str) -> Result<(), ThresholdError> {
        match self.bounds {
            Some(_) => Err(ThresholdError::BoundsNotKept { method }),
            None => Ok(()),
        }
    }
}
