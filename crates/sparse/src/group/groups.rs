//! Groups of columns.

use crate::{Penalty, SparseError};

/// Groups of columns.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Groups {
    /// The group of every column (p), numbered from 0 and below p; the columns of a group need not be neighbours.
    pub of: Vec<usize>,
    /// Weights w_g of the groups' norms, by number; 0: no penalty on the norm. Empty: the root of the number of
    /// penalised columns of the group.
    pub weights: Vec<f64>,
}

impl Groups {
    /// Groups of equal weight a column: the root of their sizes.
    pub fn new(of: Vec<usize>) -> Self {
        Self { of, weights: Vec::new() }
    }

    /// Number of groups: one more than the largest number.
    pub fn len(&self) -> usize {
        self.of.iter().max().map_or(0, |last| last + 1)
    }

    /// Returns true if there are no columns.
    pub fn is_empty(&self) -> bool {
        self.of.is_empty()
    }

    /// The weight of every group under a penalty, once groups and problem belong together.
    pub(super) fn checked(&self, columns: usize, penalty: &Penalty) -> Result<Vec<f64>, SparseError> {
        let (count, expected) = (self.of.len(), columns);
        if count != expected {
            return Err(SparseError::Length { what: "the list of the columns' groups", actual: count, expected });
        }
        if let Some(column) = self.of.iter().position(|&group| group >= columns) {
            return Err(SparseError::GroupNumber { column, group: self.of[column], columns });
        }
        if self.weights.is_empty() {
            let factor = |j: usize| penalty.factors.get(j).copied().unwrap_or(1.0);
            let mut sizes = vec![0.0_f64; self.len()];
            let penalised = (0..columns).filter(|&j| factor(j) > 0.0 && factor(j).is_finite());
            penalised.for_each(|j| sizes[self.of[j]] += 1.0);
            return Ok(sizes.into_iter().map(f64::sqrt).collect());
        }
        let (count, expected) = (self.weights.len(), self.len());
        if count < expected {
            return Err(SparseError::Length { what: "the list of the groups' weights", actual: count, expected });
        }
        match self.weights.iter().position(|weight| !(*weight >= 0.0 && weight.is_finite())) {
            Some(group) => Err(SparseError::GroupWeight { group, value: self.weights[group] }),
            None => Ok(self.weights.clone()),
        }
    }
}
