//! Units of measurement of columns.

mod check;
mod parse;
mod symbols;
#[cfg(test)]
mod tests;

use std::fmt::{self, Display, Formatter};

pub use check::coefficient_unit;
use fleetfoot_data::did_you_mean;
use symbols::Dimension;

/// Exponents are kept in twelfths, so that square, cube and fourth roots are exact.
const WHOLE: i32 = 12;

/// A unit: a product of powers of named units, such as `kg*m^2/s`, with its dimension in the base units of the SI and its
/// size in them.
///
/// Radians have no dimension, as in the SI; degrees, turns and percent are sizes without a dimension. Two units are equal if
/// dimension and size are, however they are written: `N` and `kg*m/s^2`.
#[derive(Debug, Clone)]
pub struct Unit {
    /// Names in the order of their first appearance, with exponents in twelfths.
    symbols: Vec<(String, i32)>,
    dimension: Dimension,
    scale: f64,
}

/// Why a text is no unit, or why units do not fit together.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum UnitError {
    /// A unit that is not known.
    #[error("unknown unit `{symbol}` in `{text}`{}; leave the unit out if it has no name", did_you_mean(nearest))]
    Unknown {
        /// The whole unit.
        text: String,
        /// Name that is not a known unit.
        symbol: String,
        /// Units that resemble it.
        nearest: Vec<String>,
    },
    /// A text that is no product of powers.
    #[error("in the unit `{text}`, character {}: expected {expected}", text[..*position].chars().count() + 1)]
    Syntax {
        /// The whole unit.
        text: String,
        /// The byte where something else should stand.
        position: usize,
        /// Syntax that is valid at this position.
        expected: &'static str,
    },
    /// A sum, a difference, a minimum, a maximum or an arc tangent of unlike units.
    #[error("`{part}` joins `{left}` with `{right}`; convert one of them, or correct the columns' units")]
    Mismatch {
        /// The part of the expression.
        part: String,
        /// The unit of its first argument.
        left: String,
        /// The unit of its second argument.
        right: String,
    },
    /// A function of a number without a unit was given one.
    #[error(
        "`{part}` takes a number without a unit (an angle in rad), here it has `{unit}`; divide by a scale or convert"
    )]
    Argument {
        /// The part of the expression.
        part: String,
        /// The unit of its argument.
        unit: String,
    },
    /// An exponent with a unit, a power that is no twelfth, or one that varies, of something with a unit.
    #[error("`{part}`: `{unit}` cannot be raised to this power")]
    Power {
        /// The part of the expression.
        part: String,
        /// The unit of what is raised.
        unit: String,
    },
}

impl Unit {
    /// The unit of pure numbers.
    pub fn one() -> Self {
        Self { symbols: Vec::new(), dimension: [0; 7], scale: 1.0 }
    }

    /// Reads a unit: names of the SI with prefixes and some others (`deg`, `rpm`, `min`, `h`, `%`, `bar`, `ft`, ...), joined by `*` (or a
    /// space, or `·`) and `/`, with exponents as `^2`, `^-1`, `^0.5`, `^(1/2)` or `²`, and with parentheses. `1`, `-` and nothing
    /// are the unit of pure numbers. Degrees Celsius are kelvins: a unit has no zero point.
    ///
    /// # Errors
    /// [`UnitError::Unknown`] and [`UnitError::Syntax`].
    pub fn parse(text: &str) -> Result<Self, UnitError> {
        parse::unit(text)
    }

    /// Size of the unit in the SI's coherent units: 1000 for km.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// Returns true if both units measure the same kind of quantity, as `km` and `ft` do.
    pub fn same_dimension(&self, other: &Self) -> bool {
        self.dimension == other.dimension
    }

    /// Returns true for the unit of pure numbers, or of angles in radians.
    pub fn is_one(&self) -> bool {
        *self == Self::one()
    }

    /// The unit of a product.
    pub fn times(&self, other: &Self) -> Self {
        self.joined(other, 1)
    }

    /// The unit of a quotient.
    pub fn per(&self, other: &Self) -> Self {
        self.joined(other, -1)
    }

    /// The unit of a power; `None` where an exponent would be no twelfth, or out of any range.
    pub fn power(&self, exponent: f64) -> Option<Self> {
        let raised = |twelfths: i32| {
            let value = f64::from(twelfths) * exponent;
            let nearest = value.round();
            ((value - nearest).abs() < 1e-6 && nearest.abs() < 1e6).then_some(nearest as i32)
        };
        let mut dimension = self.dimension;
        for base in &mut dimension {
            *base = raised(*base)?;
        }
        let symbols = self.symbols.iter().map(|(name, exponent)| Some((name.clone(), raised(*exponent)?)));
        let symbols = symbols
            .filter(|symbol| symbol.as_ref().is_none_or(|(_, exponent)| *exponent != 0))
            .collect::<Option<_>>()?;
        Some(Self { symbols, dimension, scale: self.scale.powf(exponent) })
    }

    fn joined(&self, other: &Self, sign: i32) -> Self {
        let mut joined = self.clone();
        for (name, exponent) in &other.symbols {
            match joined.symbols.iter_mut().find(|(known, _)| known == name) {
                Some((_, total)) => *total = total.saturating_add(sign * exponent),
                None => joined.symbols.push((name.clone(), sign * exponent)),
            }
        }
        joined.symbols.retain(|(_, exponent)| *exponent != 0);
        for (dimension, exponent) in joined.dimension.iter_mut().zip(other.dimension) {
            *dimension = dimension.saturating_add(sign * exponent);
        }
        joined.scale *= if sign < 0 { 1.0 / other.scale } else { other.scale };
        joined
    }
}

impl PartialEq for Unit {
    /// The same dimension, and the same size up to rounding.
    fn eq(&self, other: &Self) -> bool {
        self.dimension == other.dimension && (self.scale - other.scale).abs() <= 1e-9 * self.scale.abs()
    }
}

impl Display for Unit {
    /// As it was written: names with positive exponents, then those below; `1` for a pure number.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let side = |sign: i32| {
            let symbols = self.symbols.iter().filter(|(_, exponent)| exponent.signum() == sign);
            symbols.map(|(name, exponent)| power_text(name, exponent.abs())).collect::<Vec<_>>()
        };
        let (above, below) = (side(1), side(-1));
        match above.as_slice() {
            [] => f.write_str("1")?,
            names => f.write_str(&names.join("*"))?,
        }
        below.iter().try_for_each(|name| write!(f, "/{name}"))
    }
}

/// A name with its exponent in twelfths, positive.
fn power_text(name: &str, twelfths: i32) -> String {
    if twelfths == WHOLE {
        return name.to_owned();
    }
    if twelfths % WHOLE == 0 {
        return format!("{name}^{}", twelfths / WHOLE);
    }
    let divisor = (1..=WHOLE).rev().find(|d| twelfths % d == 0 && WHOLE % d == 0).unwrap_or(1);
    format!("{name}^({}/{})", twelfths / divisor, WHOLE / divisor)
}
