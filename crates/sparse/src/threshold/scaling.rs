//! Units of coefficients.

/// Units u_j of the coefficients that are thresholded and penalised, as `u_j b_j`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Scaling {
    /// 1: coefficients in the units of the log.
    #[default]
    Physical,
    /// The length of the column, `sqrt(sum w x^2)`, which grows with the number of rows: pysindy's `normalize_columns = True`.
    Length,
    /// The length of the column; thresholds are relative to the length of the target: a threshold of 0.01 drops terms whose root mean square is below 1 % of the
    /// target's. It depends neither on units nor on the number of rows.
    Share,
}
