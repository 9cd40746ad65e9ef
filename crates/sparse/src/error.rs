//! Errors of a problem or of the options of a fit.

/// A problem that cannot be posed, or an option out of its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SparseError {
    /// A statistic of no rows, or of no weight.
    #[error("there are no rows: a fit needs at least one row of positive weight")]
    NoRows,
    /// Two arguments that must have the same length have not.
    #[error("{what} has {actual} entries, {expected} are needed")]
    Length {
        /// The argument.
        what: &'static str,
        /// Its length.
        actual: usize,
        /// The length it must have.
        expected: usize,
    },
    /// A regressor holds NaN or an infinity, or values whose squares overflow.
    #[error(
        "column {column} holds a value that is not finite, or whose square is not: drop the column or the rows, or divide the column by its scale"
    )]
    ColumnNotFinite {
        /// The regressor.
        column: usize,
    },
    /// The target holds NaN or an infinity.
    #[error("the target holds a value that is not finite: drop the rows where it is missing")]
    TargetNotFinite,
    /// The statistic has fewer targets.
    #[error("there is no target {target}: the statistic has {targets}, counted from 0")]
    NoSuchTarget {
        /// Number of the requested target.
        target: usize,
        /// Number of targets.
        targets: usize,
    },
    /// A row weight is negative or not finite.
    #[error("the weight of row {} is {value}: weights are finite and not negative", row + 1)]
    RowWeight {
        /// The row.
        row: usize,
        /// Its weight.
        value: f64,
    },
    /// Products that no rows can have.
    #[error(
        "the products of columns {column} and {other} are not those of any rows: not symmetric, negative squares, or larger than the columns are \
         long (column {targets} is the target)"
    )]
    NotMoments {
        /// The first column.
        column: usize,
        /// The second column, or the number of columns for the target.
        other: usize,
        /// Index that stands for the target.
        targets: usize,
    },
    /// A penalty factor is negative or NaN.
    #[error(
        "the penalty factor of column {column} is {value}: it is 0 (not penalised), positive, or infinite (left out)"
    )]
    PenaltyFactor {
        /// The column.
        column: usize,
        /// The factor.
        value: f64,
    },
    /// A penalty strength is negative or not finite.
    #[error("{name} is {value}: it is finite and not negative")]
    Strength {
        /// The option.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// The share of the l1 penalty lies outside 0 to 1.
    #[error("l1_ratio is {value}: it lies between 0 (ridge) and 1 (lasso)")]
    L1Ratio {
        /// The value.
        value: f64,
    },
    /// A grid of penalties without an l1 part has no largest member.
    #[error(
        "l1_ratio is {value}: below 1e-3 a grid of lambda has no start (the lambda at which the first column enters); list the lambdas"
    )]
    NoLambdaMax {
        /// The share of the l1 penalty.
        value: f64,
    },
    /// The grid's shape is out of range.
    #[error(
        "a grid of {count} lambdas down to {ratio} of the largest is not possible: give at least one lambda, and a ratio between 0 and 1"
    )]
    Grid {
        /// Number of lambdas.
        count: usize,
        /// The smallest over the largest.
        ratio: f64,
    },
    /// The tolerance of coordinate descent is out of range.
    #[error("the tolerance is {value}: it lies between 1e-15 and 1")]
    Tolerance {
        /// The value.
        value: f64,
    },
    /// Plain LARS does not watch signs.
    #[error("column {column} has a sign constraint, which plain LARS does not keep; use the lasso modification")]
    SignsNeedLasso {
        /// The first column with a constraint.
        column: usize,
    },
    /// A lambda below the end of a path that was stopped.
    #[error("lambda = {lambda} lies below the end of the path at {end}: continue the path further down")]
    BelowPath {
        /// The lambda that was asked for.
        lambda: f64,
        /// The smallest lambda of the path.
        end: f64,
    },
    /// A lambda between two knots of a path that is not linear.
    #[error("lambda = {lambda} lies between two knots, and the path is not linear there: solve for it, or take a knot")]
    BetweenKnots {
        /// The lambda that was asked for.
        lambda: f64,
    },
    /// Targets of other rows.
    #[error(
        "one target has rows of total weight {actual}, another of {expected}: fit only targets with the same rows together"
    )]
    OtherRows {
        /// Weight of the one.
        actual: f64,
        /// Weight of the other.
        expected: f64,
    },
    /// The number of a group is too large.
    #[error(
        "column {column} is in group {group}: groups are numbered from 0, and below the number of columns, {columns}"
    )]
    GroupNumber {
        /// The column.
        column: usize,
        /// Its group.
        group: usize,
        /// Number of columns.
        columns: usize,
    },
    /// The weight of a group is negative or not finite.
    #[error(
        "the weight of group {group} is {value}: it is finite and not negative, and 0 leaves the group's norm unpenalised"
    )]
    GroupWeight {
        /// The group.
        group: usize,
        /// Its weight.
        value: f64,
    },
    /// A path and a problem that do not belong together.
    #[error("the path belongs to another problem: it has {actual} columns, the problem {expected}")]
    OtherProblem {
        /// Columns of the path.
        actual: usize,
        /// Columns of the problem.
        expected: usize,
    },
    /// The exponent of the adaptive lasso is out of range.
    #[error("the exponent of the adaptive weights is {value}: it is positive and finite")]
    Exponent {
        /// The value.
        value: f64,
    },
    /// Least squares does not know the coefficients that the adaptive weights are to be made from.
    #[error(
        "columns {columns:?} depend on the others, so least squares gives them no weights: start the adaptive lasso from a ridge fit"
    )]
    NeedsRidge {
        /// The dependent columns.
        columns: Vec<usize>,
    },
}
