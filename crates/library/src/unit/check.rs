//! Units of expressions, derived from those of the columns.

use super::{Unit, UnitError};
use crate::{Binary, Expr, Filter, FilterKind, Node, Terms, Unary};

/// Unit of a part, as far as it is known.
#[derive(Debug, Clone)]
enum Measure {
    /// Written numbers only: pure in products, and of any unit where they are added, as in `thrust/mass - 9.81`.
    Number,
    Unknown,
    Known(Unit),
}

impl Expr {
    /// The unit of the expression, given those of the columns; `None` where it depends on a column whose unit is not known.
    ///
    /// Written numbers are pure where they multiply, and take the unit of what they are added to. Time is in seconds. A
    /// filter's output has the unit of its input, unless `column` knows better.
    ///
    /// # Errors
    /// Sums of unlike units (`m + s`, but also `m + mm`), functions such as `sin` and `exp` of what has a unit (degrees
    /// too), powers that do not come out. What involves unknown units is not checked.
    pub fn unit(&self, column: impl Fn(&str) -> Option<Unit>) -> Result<Option<Unit>, UnitError> {
        Ok(match self.measure(&column)? {
            Measure::Number => Some(Unit::one()),
            Measure::Unknown => None,
            Measure::Known(unit) => Some(unit),
        })
    }

    fn measure(&self, column: &dyn Fn(&str) -> Option<Unit>) -> Result<Measure, UnitError> {
        self.fold(|expr, arguments: &[Result<Measure, UnitError>]| {
            let arguments = arguments.iter().cloned().collect::<Result<Vec<_>, _>>()?;
            match (expr.node(), arguments.as_slice()) {
                (Node::Number(_), _) => Ok(Measure::Number),
                (Node::Time { .. }, _) => Unit::parse("s").map(Measure::Known),
                (Node::Column { name, .. }, _) => of_column(name, column),
                (Node::Unary(function, _), [x]) => of_unary(expr, *function, x),
                (Node::Power(_, k), [x]) => power(expr, x, f64::from(*k)),
                (Node::Binary(function, _, b), [x, y]) => of_binary(expr, *function, b, x, y),
                _ => unreachable!("one argument for each child"),
            }
        })
    }
}

fn of_column(name: &str, column: &dyn Fn(&str) -> Option<Unit>) -> Result<Measure, UnitError> {
    if let Some(unit) = column(name) {
        return Ok(Measure::Known(unit));
    }
    let Some(filter) = Filter::of(name) else { return Ok(Measure::Unknown) };
    let input = filter.input.measure(column)?;
    Ok(match (filter.kind, input) {
        (FilterKind::Lag1 | FilterKind::Delay, input) => input,
        (FilterKind::Lag1Slope | FilterKind::DelaySlope, Measure::Known(unit)) => {
            Measure::Known(unit.per(&Unit::parse("s")?))
        }
        _ => Measure::Unknown,
    })
}

fn of_unary(expr: &Expr, function: Unary, x: &Measure) -> Result<Measure, UnitError> {
    match (function, x) {
        (Unary::Neg | Unary::Abs, x) => Ok(x.clone()),
        (Unary::Sign | Unary::Step, _) => Ok(Measure::Known(Unit::one())),
        (Unary::Sqrt, x) => power(expr, x, 0.5),
        (_, Measure::Known(unit)) if !unit.is_one() => {
            Err(UnitError::Argument { part: expr.to_string(), unit: unit.to_string() })
        }
        (Unary::Wrap, x) => Ok(x.clone()),
        (_, Measure::Number) => Ok(Measure::Number),
        (Unary::Asin | Unary::Acos | Unary::Atan, _) => Unit::parse("rad").map(Measure::Known),
        _ => Ok(Measure::Known(Unit::one())),
    }
}

fn of_binary(expr: &Expr, function: Binary, b: &Expr, x: &Measure, y: &Measure) -> Result<Measure, UnitError> {
    match function {
        Binary::Add | Binary::Sub | Binary::Min | Binary::Max => alike(expr, x, y),
        Binary::Atan2 => {
            alike(expr, x, y)?;
            Unit::parse("rad").map(Measure::Known)
        }
        Binary::Mul => Ok(product(x, y, Unit::times)),
        Binary::Div => Ok(product(x, y, Unit::per)),
        Binary::Pow => match (x, y, b.as_number()) {
            (_, Measure::Known(unit), _) if !unit.is_one() => {
                Err(UnitError::Power { part: expr.to_string(), unit: unit.to_string() })
            }
            (x, _, Some(exponent)) => power(expr, x, exponent),
            (Measure::Known(unit), ..) if !unit.is_one() => {
                Err(UnitError::Power { part: expr.to_string(), unit: unit.to_string() })
            }
            (x, ..) => Ok(x.clone()),
        },
    }
}

fn alike(expr: &Expr, x: &Measure, y: &Measure) -> Result<Measure, UnitError> {
    match (x, y) {
        (Measure::Known(a), Measure::Known(b)) if a != b => {
            Err(UnitError::Mismatch { part: expr.to_string(), left: a.to_string(), right: b.to_string() })
        }
        (Measure::Known(_), _) | (Measure::Unknown, Measure::Number) => Ok(x.clone()),
        (_, y) => Ok(y.clone()),
    }
}

fn product(x: &Measure, y: &Measure, join: impl Fn(&Unit, &Unit) -> Unit) -> Measure {
    match (x, y) {
        (Measure::Number, Measure::Number) => Measure::Number,
        (Measure::Unknown, _) | (_, Measure::Unknown) => Measure::Unknown,
        (Measure::Known(a), Measure::Known(b)) => Measure::Known(join(a, b)),
        (Measure::Known(a), Measure::Number) => Measure::Known(a.clone()),
        (Measure::Number, Measure::Known(b)) => Measure::Known(join(&Unit::one(), b)),
    }
}

fn power(expr: &Expr, x: &Measure, exponent: f64) -> Result<Measure, UnitError> {
    match x {
        Measure::Known(unit) => match unit.power(exponent) {
            Some(power) => Ok(Measure::Known(power)),
            None => Err(UnitError::Power { part: expr.to_string(), unit: unit.to_string() }),
        },
        other => Ok(other.clone()),
    }
}

impl Terms {
    /// The unit of each function's coefficient in a sum that has the unit `target`: `target` divided by the function's unit;
    /// `None` where one of them is not known. The constant is not among the functions: its coefficient has the unit `target`.
    ///
    /// The functions of one library may have any units, as each has a coefficient of its own; within a function they must fit.
    ///
    /// # Errors
    /// A function whose units do not fit: see [`Expr::unit`].
    pub fn coefficient_units(
        &self,
        target: Option<&Unit>,
        column: impl Fn(&str) -> Option<Unit>,
    ) -> Result<Vec<Option<Unit>>, UnitError> {
        self.functions.iter().map(|function| coefficient_unit(target, function, &column)).collect()
    }
}

/// The unit of a function's coefficient in a sum that has the unit `target`: `target` divided by the function's unit; `None` where
/// one of them is not known.
///
/// # Errors
/// The function's units do not fit: see [`Expr::unit`].
pub fn coefficient_unit(
    target: Option<&Unit>,
    function: &Expr,
    column: impl Fn(&str) -> Option<Unit>,
) -> Result<Option<Unit>, UnitError> {
    let unit = function.unit(column)?;
    Ok(target.zip(unit).map(|(target, unit)| target.per(&unit)))
}
