//! Function calls: elementary functions, lags, differences, filters and rotations.

use std::fmt;

use fleetfoot_data::nearest;

use super::{Parser, Power};
use crate::{
    Binary, CentralDifference, Expr, Filter, FilterKind, ParseError, ParseErrorKind, Quaternion, Spacing, Unary,
    backward_difference, central_difference, forward_difference,
    limits::{MAX_LAG, MAX_SIZE},
};

/// Filters inside each other.
const MAX_FILTERS: usize = 8;

impl Parser<'_> {
    /// A function's arguments and value; its name and the parenthesis are read.
    pub(crate) fn call(&mut self, function: &str, start: usize) -> Result<Expr, ParseError> {
        match function {
            "lag" | "lead" => return self.lag(if function == "lag" { 1.0 } else { -1.0 }),
            "yaw" | "pitch" | "roll" => {
                let rotation = self.quaternion()?;
                self.expect(")", "`)`")?;
                return Ok(match function {
                    "yaw" => rotation.yaw(),
                    "pitch" => rotation.pitch(),
                    _ => rotation.roll(),
                });
            }
            "rotate" | "rotate_inv" | "vec" => {
                let vector = self.vector_call(function, start)?;
                return self.component(vector);
            }
            _ => {}
        }
        if let Some(kind) = FilterKind::named(function) {
            return self.filter_column(kind, start);
        }
        let arguments = self.arguments()?;
        let count = |expected: usize| ParseErrorKind::Arguments {
            function: function.to_owned(),
            expected,
            actual: arguments.len(),
        };
        let kind = match (function, arguments.as_slice()) {
            ("time", []) => return Ok(Expr::time()),
            ("forward", [x]) => return Ok(forward_difference(x, false)),
            ("backward", [x]) => return Ok(backward_difference(x, false)),
            ("central", [x]) => return Ok(central_difference(x, false)),
            ("central4" | "central6", [x]) => {
                let reach = if function == "central4" { 2 } else { 3 };
                let difference = CentralDifference { of: x.clone(), angle: false, reach, spacing: Spacing::Stamps };
                return Ok(difference.expression());
            }
            ("time", _) => count(0),
            ("forward" | "backward" | "central" | "central4" | "central6", _) => count(1),
            _ => match (named_unary(function), named_binary(function), arguments.as_slice()) {
                (Some(unary), _, [x]) => return Ok(Expr::unary(unary, x.clone())),
                (_, Some(binary), [a, b]) => return Ok(Expr::binary(binary, a.clone(), b.clone())),
                (Some(_), _, _) => count(1),
                (_, Some(_), _) => count(2),
                _ => ParseErrorKind::UnknownFunction {
                    name: function.to_owned(),
                    nearest: nearest(function, function_names()),
                },
            },
        };
        Err(self.error(start, kind))
    }

    /// Expressions up to the closing parenthesis.
    fn arguments(&mut self) -> Result<Vec<Expr>, ParseError> {
        let mut arguments = Vec::new();
        if self.peek() == Some(')') {
            self.at += 1;
            return Ok(arguments);
        }
        loop {
            arguments.push(self.expression(Power::Any)?);
            match self.peek() {
                Some(',') => self.at += 1,
                Some(')') => {
                    self.at += 1;
                    return Ok(arguments);
                }
                _ => return Err(self.expected("an operator, `,` or `)`")),
            }
        }
    }

    /// `x, rows)` of `lag(x, rows)`.
    fn lag(&mut self, direction: f64) -> Result<Expr, ParseError> {
        let x = self.expression(Power::Any)?;
        self.expect(",", "`,` and a number of rows")?;
        self.skip_space();
        let start = self.at;
        let rows = self.expression(Power::Any)?;
        self.expect(")", "`)`")?;
        match rows.as_number() {
            Some(rows) if rows.fract() == 0.0 && rows.abs() <= MAX_LAG => Ok(x.shifted((direction * rows) as i32)),
            _ => {
                self.at = start;
                Err(self.expected("a whole number of rows, at most a million"))
            }
        }
    }

    /// The column of `x, constant)` of a filter.
    fn filter_column(&mut self, kind: FilterKind, start: usize) -> Result<Expr, ParseError> {
        let filter = self.filter(kind, start)?;
        if self.scope.is_of_name() {
            return Ok(Expr::column(&self.text[start..self.at]));
        }
        let too_large = |parser: &Self| parser.error(start, ParseErrorKind::FilterTooLarge { function: kind.name() });
        if filter.levels() > MAX_FILTERS {
            return Err(too_large(self));
        }
        // Aliases written out may make it longer, or deeper, than what can be read again.
        let mut name = Bounded(String::new());
        match fmt::Write::write_fmt(&mut name, format_args!("{filter}")) {
            Ok(()) if Filter::of(&name.0).is_some() => Ok(Expr::column(name.0)),
            _ => Err(too_large(self)),
        }
    }

    /// `x, constant)` of a filter.
    pub(super) fn filter(&mut self, kind: FilterKind, start: usize) -> Result<Filter, ParseError> {
        let [input, constant] = self.exactly(kind.name(), start)?;
        if !constant.is_constant() {
            return Err(self.error(start, ParseErrorKind::NotConstant { function: kind.name() }));
        }
        Ok(Filter { kind, input, constant })
    }

    fn quaternion(&mut self) -> Result<Quaternion, ParseError> {
        let start = self.start();
        let name = self.name("a quaternion: the name before its .x, or quat(x, y, z, w)")?;
        if name == "quat" && self.peek() == Some('(') {
            self.at += 1;
            let [x, y, z, w] = self.exactly("quat", start)?;
            return Ok(Quaternion::new(x, y, z, w));
        }
        if let Some(rotation) = self.scope.rotations.get(&name) {
            return Ok(rotation.clone());
        }
        let [x, y, z, w] =
            self.scope.components(&name, ["x", "y", "z", "w"]).map_err(|kind| self.error(start, kind))?;
        Ok(Quaternion::new(x, y, z, w))
    }

    fn vector(&mut self) -> Result<[Expr; 3], ParseError> {
        let start = self.start();
        let name = self.name("a vector: the name before its .x, vec(a, b, c), rotate(..) or rotate_inv(..)")?;
        if matches!(name.as_str(), "vec" | "rotate" | "rotate_inv") && self.peek() == Some('(') {
            self.at += 1;
            return self.nested(|parser| parser.vector_call(&name, start));
        }
        self.scope.components(&name, ["x", "y", "z"]).map_err(|kind| self.error(start, kind))
    }

    /// The vector of `vec(a, b, c)`, `rotate(q, v)` or `rotate_inv(q, v)`; the parenthesis is read.
    fn vector_call(&mut self, function: &str, start: usize) -> Result<[Expr; 3], ParseError> {
        if function == "vec" {
            return self.exactly("vec", start);
        }
        let rotation = self.quaternion()?;
        self.expect(",", "`,` and a vector")?;
        let vector = self.vector()?;
        self.expect(")", "`)`")?;
        let rotated = if function == "rotate" { rotation.rotate(&vector) } else { rotation.rotate_inverse(&vector) };
        if rotated[0].size() > MAX_SIZE {
            return Err(self.error(start, ParseErrorKind::TooLarge));
        }
        Ok(rotated)
    }

    fn component(&mut self, [x, y, z]: [Expr; 3]) -> Result<Expr, ParseError> {
        let component = match self.text.as_bytes()[self.at..] {
            [b'.', b'x', ..] => x,
            [b'.', b'y', ..] => y,
            [b'.', b'z', ..] => z,
            _ => return Err(self.expected("`.x`, `.y` or `.z` of the vector")),
        };
        self.at += 2;
        Ok(component)
    }

    fn exactly<const N: usize>(&mut self, function: &str, start: usize) -> Result<[Expr; N], ParseError> {
        let arguments = self.arguments()?;
        let count = arguments.len();
        arguments.try_into().map_err(|_| {
            self.error(start, ParseErrorKind::Arguments { function: function.to_owned(), expected: N, actual: count })
        })
    }
}

/// Text up to the longest name of a filter.
struct Bounded(String);

impl fmt::Write for Bounded {
    fn write_str(&mut self, part: &str) -> fmt::Result {
        if self.0.len() + part.len() > Filter::MAX_NAME {
            return Err(fmt::Error);
        }
        self.0.push_str(part);
        Ok(())
    }
}

pub(crate) fn named_unary(name: &str) -> Option<Unary> {
    Unary::ALL.into_iter().find(|function| *function != Unary::Neg && function.name() == name)
}

fn named_binary(name: &str) -> Option<Binary> {
    match name {
        "pow" => Some(Binary::Pow),
        "atan2" => Some(Binary::Atan2),
        "min" => Some(Binary::Min),
        "max" => Some(Binary::Max),
        _ => None,
    }
}

pub(crate) fn function_names() -> impl Iterator<Item = &'static str> {
    let others =
        ["pow", "atan2", "min", "max", "time", "lag", "lead", "forward", "backward", "central", "central4", "central6"];
    let rotations = ["yaw", "pitch", "roll", "rotate", "rotate_inv", "vec", "quat"];
    let filters = FilterKind::ALL.into_iter().map(FilterKind::name);
    Unary::ALL.into_iter().skip(1).map(Unary::name).chain(others).chain(rotations).chain(filters)
}
