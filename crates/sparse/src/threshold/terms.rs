//! Which columns an equation may use, and which it must.

use fleetfoot_stats::Compressed;

use super::ThresholdError;

/// What an equation may be made of, p candidate columns.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Terms {
    /// Columns that may be used (p); `None`: all.
    pub allowed: Option<Vec<bool>>,
    /// Columns that are always in the model: never thresholded, dropped or penalised.
    pub fixed: Vec<usize>,
}

/// Terms that were checked against a problem.
#[derive(Debug, Clone)]
pub(super) struct Checked {
    /// Columns that may be used, fixed ones included, ascending.
    pub(super) open: Vec<usize>,
    /// Whether a column is always in (p).
    pub(super) fixed: Vec<bool>,
}

impl Terms {
    /// All columns allowed, none fixed.
    pub fn all() -> Self {
        Self::default()
    }

    pub(super) fn checked(&self, problem: &Compressed) -> Result<Checked, ThresholdError> {
        let columns = problem.columns();
        if let Some(allowed) = self.allowed.as_ref().filter(|allowed| allowed.len() != columns) {
            let (found, expected) = (allowed.len(), columns);
            let what = "the list of allowed columns";
            return Err(crate::SparseError::Length { what, found, expected }.into());
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
        Ok(Checked { open: (0..columns).filter(|&j| allowed(j)).collect(), fixed })
    }
}
