//! Sizes of expressions on a sample of the rows.

use faer::MatRef;
use fleetfoot_data::Source;
use fleetfoot_library::{Design, DesignRows, Expr};
use fleetfoot_stats::{Gram, scan::pilot_tiles};

use super::SystemError;

/// The mean square of every expression over the complete rows of a strided sample; 0 without rows.
///
/// # Errors
/// A column does not exist, or the source cannot be read.
pub fn sampled_mean_squares(expressions: &[Expr], source: &dyn Source) -> Result<Vec<f64>, SystemError> {
    if expressions.is_empty() {
        return Ok(Vec::new());
    }
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let design = Design::compile(expressions, &names)?;
    let (mut sums, mut count) = (vec![0.0; expressions.len()], 0_usize);
    let mut rows = DesignRows::default();
    pilot_tiles(source, design.halo(), |_, block, tile| {
        design.evaluate(block, tile, &mut rows);
        count += rows.rows();
        for (output, sum) in sums.iter_mut().enumerate() {
            *sum += rows.output(output).iter().map(|value| value * value).sum::<f64>();
        }
        Ok::<_, SystemError>(())
    })?;
    Ok(sums.into_iter().map(|sum| sum / (count as f64).max(1.0)).collect())
}

/// The variance of every expression over the complete rows of a strided sample; 0 without rows.
///
/// # Errors
/// A column does not exist, or the source cannot be read.
pub fn sampled_variances(expressions: &[Expr], source: &dyn Source) -> Result<Vec<f64>, SystemError> {
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let design = Design::compile(expressions, &names)?;
    let (mut total, mut rows) = (Gram::new(expressions.len()), DesignRows::default());
    pilot_tiles(source, design.halo(), |_, block, tile| {
        design.evaluate(block, tile, &mut rows);
        if rows.rows() > 0 {
            let values = MatRef::from_column_major_slice(&rows.values, rows.rows(), expressions.len());
            total.merge(&Gram::of_rows(values, None));
        }
        Ok::<_, SystemError>(())
    })?;
    Ok((0..expressions.len()).map(|j| total.get(j, j) / total.weight.max(1.0)).collect())
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{Column, MemorySource};
    use fleetfoot_library::{CentralDifference, Spacing};

    use super::*;

    /// `sin t` with stamps of 10 ms.
    fn sine() -> MemorySource {
        let mut source = MemorySource::new(vec![Column::float("x")]);
        source.push_uniform("one", 0.01, vec![(0..5000).map(|k| (f64::from(k) * 0.01).sin()).collect()]);
        source
    }

    #[test]
    fn error_of_differences_has_its_closed_form() {
        let source = sine();
        let central = CentralDifference { of: Expr::column("x"), angle: false, reach: 1, spacing: Spacing::Even };
        let error = central.expression() - Expr::time().cos();
        let squares = sampled_mean_squares(&[error, central.truncation()], &source).expect("squares");
        // h^2/6 sin' on average, and the next order is h^2 smaller.
        assert!((squares[0] / (1e-4_f64 / 6.0).powi(2) - 0.5).abs() < 0.02, "{squares:?}");
        assert!((squares[0] / squares[1] - 1.0).abs() < 1e-3, "{squares:?}");
    }
}
