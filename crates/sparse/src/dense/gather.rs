//! Few rows: read in place whenever they are needed.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_data::{Progress, checkpoint, parallel_map};

use super::{DenseDesign, DenseError};
use crate::SparseError;

/// Rows that are read at once.
const BLOCK: usize = 4096;
/// Rows that are read at once where most of them are used.
const STRETCH: usize = 512;
/// Rows whose errors are computed at once.
const SCORED: usize = 256;

/// Rows, ascending, as they are read: all of a stretch where most of it is used, else runs of neighbours.
fn stretches(used: &[usize]) -> impl Iterator<Item = &[usize]> {
    used.chunk_by(|a, b| a / STRETCH == b / STRETCH).flat_map(|part| {
        let most = 2 * part.len() > part[part.len() - 1] - part[0];
        part.chunk_by(move |a, b| most || a + 1 == *b)
    })
}

impl DenseDesign {
    /// Rows of positive weight in the chosen groups, ascending.
    pub(super) fn used(&self, chosen: &[bool]) -> Vec<usize> {
        let all = chosen.iter().all(|chosen| *chosen);
        let meant = |row: &usize| all || self.labels.get(*row).map_or(chosen[0], |&label| chosen[label as usize]);
        let weighs = |row: &usize| self.weights.as_ref().is_none_or(|weights| weights[*row] > 0.0);
        (0..self.rows.rows()).filter(|row| meant(row) && weighs(row)).collect()
    }

    /// Some rows, ascending: column after column, and their weights.
    pub(super) fn gathered(&self, used: &[usize]) -> (Vec<f64>, Option<Vec<f64>>) {
        let weights = self.weights.as_ref().map(|weights| used.iter().map(|&row| weights[row]).collect());
        let d = self.columns();
        if let (Some(&first), Some(&last)) = (used.first(), used.last())
            && last - first + 1 == used.len()
        {
            let mut values = Vec::with_capacity(d * used.len());
            self.rows.read(first..last + 1, &mut values);
            return (values, weights);
        }
        let mut values = vec![0.0; d * used.len()];
        let mut block = Vec::new();
        let mut at = 0;
        for part in stretches(used) {
            let (first, last) = (part[0], part[part.len() - 1]);
            block.clear();
            self.rows.read(first..last + 1, &mut block);
            for (j, column) in block.chunks_exact(last - first + 1).enumerate() {
                let values = &mut values[j * used.len() + at..][..part.len()];
                values.iter_mut().zip(part).for_each(|(value, &row)| *value = column[row - first]);
            }
            at += part.len();
        }
        (values, weights)
    }

    /// Hands some rows on block by block: values column after column, number of rows, weights.
    pub(super) fn blocks(&self, used: &[usize], mut take: impl FnMut(&[f64], usize, Option<&[f64]>)) {
        for part in used.chunks(BLOCK) {
            checkpoint();
            let (values, weights) = self.gathered(part);
            take(&values, part.len(), weights.as_deref());
        }
    }

    /// Weighted mean squared errors of models on some rows; none where there are no rows.
    pub(super) fn errors_of_rows(
        &self,
        used: &[usize],
        target: usize,
        models: MatRef<'_, f64>,
        intercepts: &[f64],
        progress: &dyn Progress,
    ) -> Result<Vec<f64>, DenseError> {
        let (p, k) = (models.nrows(), models.ncols());
        let parts: Vec<&[usize]> = used.chunks(SCORED).collect();
        let sums = parallel_map(parts.len(), progress, |part| {
            let rows = parts[part];
            let (values, weights) = self.gathered(rows);
            let x = MatRef::from_column_major_slice(&values[..p * rows.len()], rows.len(), p);
            let y = &values[(p + target) * rows.len()..][..rows.len()];
            if values.iter().any(|value| !value.is_finite()) {
                return Err(SparseError::TargetNotFinite.into());
            }
            let mut predicted = Mat::zeros(rows.len(), k);
            matmul(predicted.as_mut(), Accum::Replace, x, models, 1.0, Par::Seq);
            let weight = |i: usize| weights.as_ref().map_or(1.0, |weights| weights[i]);
            let square = |(i, y): (usize, &f64), m: usize| weight(i) * (y - intercepts[m] - predicted[(i, m)]).powi(2);
            let squares: Vec<f64> = (0..k).map(|m| y.iter().enumerate().map(|row| square(row, m)).sum()).collect();
            Ok::<_, DenseError>((squares, (0..rows.len()).map(weight).sum::<f64>()))
        })?;
        let total: f64 = sums.iter().map(|(_, weight)| weight).sum();
        if total <= 0.0 {
            return Ok(Vec::new());
        }
        Ok((0..k).map(|m| sums.iter().map(|(squares, _)| squares[m]).sum::<f64>() / total).collect())
    }
}
