//! Search and replacement of parts of expressions.

use std::sync::Arc;

use crate::{Expr, Filter, Node};

impl Expr {
    /// Replaces parts by what `replace` gives for them, the outermost first: what is inside of a replaced part is not looked at. Of a filter's column
    /// the input is a part of the expression.
    pub fn replaced(&self, mut replace: impl FnMut(&Expr) -> Option<Expr>) -> Self {
        self.replaced_by(&mut replace)
    }

    fn replaced_by(&self, replace: &mut dyn FnMut(&Expr) -> Option<Expr>) -> Self {
        self.fold(|part, arguments: &[Expr]| {
            if let Some(other) = replace(part) {
                return other;
            }
            let Node::Column { name, lag } = part.node() else { return part.with_children(arguments) };
            match Filter::of(name) {
                None => part.clone(),
                Some(filter) => {
                    let input = filter.input.replaced_by(replace);
                    Filter { input, ..filter }.column().shifted(*lag)
                }
            }
        })
    }

    /// Replaces columns by what `replace(name)` gives, shifted by the column's lag; `None` leaves the column, unless it is a filter's, whose
    /// arguments are then substituted: `tau` by 0.05 makes `lag1(m1, 0.05)` of `lag1(m1, tau)`.
    pub fn substituted(&self, mut replace: impl FnMut(&str) -> Option<Expr>) -> Self {
        self.substituted_by(&mut replace)
    }

    fn substituted_by(&self, replace: &mut dyn FnMut(&str) -> Option<Expr>) -> Self {
        self.rebuild(|node| match node {
            Node::Column { name, lag } => {
                let with = replace(name).or_else(|| Some(Filter::of(name)?.substituted(replace).column()));
                with.map(|with| with.shifted(*lag))
            }
            _ => None,
        })
    }

    /// Its columns (`None` is time) with the rows back at which it reads them, each pair once.
    pub fn reads(&self) -> Vec<(Option<Arc<str>>, i32)> {
        let mut parts = Vec::new();
        self.fold(|part, _: &[()]| {
            let read = match part.node() {
                Node::Column { name, lag } => (Some(name.clone()), *lag),
                Node::Time { lag } => (None, *lag),
                _ => return,
            };
            if !parts.contains(&read) {
                parts.push(read);
            }
        });
        parts
    }

    /// The rows by which this is another expression shifted back: `self == other.shifted(lag)`. `None` where it is not, and for what reads nothing.
    pub fn lag_behind(&self, other: &Expr) -> Option<i32> {
        if self.size() != other.size() {
            return None;
        }
        let lag = self.first_lag()?.checked_sub(other.first_lag()?)?;
        (*self == other.shifted(lag)).then_some(lag)
    }

    /// The rows back at which its first column or time is read.
    fn first_lag(&self) -> Option<i32> {
        self.fold(|part, arguments: &[Option<i32>]| match part.node() {
            Node::Column { lag, .. } | Node::Time { lag } => Some(*lag),
            _ => arguments.iter().find_map(|lag| *lag),
        })
    }
}

impl Filter {
    /// [`Expr::substituted`] of both arguments.
    fn substituted(&self, replace: &mut dyn FnMut(&str) -> Option<Expr>) -> Self {
        let input = self.input.substituted_by(replace);
        Self { kind: self.kind, input, constant: self.constant.substituted_by(replace) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Scope;

    fn parse(text: &str) -> Expr {
        Expr::parse(text, &Scope::open()).unwrap()
    }

    #[test]
    fn outermost_part_is_replaced_at_any_lag() {
        let (speed, field) = (parse("sqrt(a^2 + b^2)"), parse("a"));
        let replace = |part: &Expr| {
            let of = |other: &Expr, name: &str| Some(Expr::lagged(name, part.lag_behind(other)?));
            of(&speed, "v").or_else(|| of(&field, "x"))
        };
        for (text, expected) in [
            ("2*sqrt(a^2 + b^2) - a", "2*v - x"),
            ("lag(sqrt(a^2 + b^2), 3)*b", "lag(v, 3)*b"),
            ("lead(a, 1) - lag(a, 1)", "lead(x, 1) - lag(x, 1)"),
            ("sqrt(b^2 + a^2)", "sqrt(b^2 + x^2)"),
            ("lag1(cos(a), 0.5)*lag(lag1(lag1(a, 2), 3), 1)", "lag1(cos(x), 0.5)*lag(lag1(lag1(x, 2), 3), 1)"),
            ("2 + time()", "2 + time()"),
        ] {
            assert_eq!(parse(text).replaced(replace), parse(expected), "{text}");
        }
    }

    #[test]
    fn shifts_are_recognised_and_constants_have_none() {
        assert_eq!(parse("lag(x, 2) + lag(u, 1)").lag_behind(&parse("x + lead(u, 1)")), Some(2));
        assert_eq!(parse("lag(x, 2) + u").lag_behind(&parse("x + u")), None);
        assert_eq!(parse("3").lag_behind(&parse("3")), None);
        assert_eq!(parse("lead(time(), 1)").lag_behind(&parse("time()")), Some(-1));
        let reads: Vec<_> = parse("x*lag(x, 1) + x - lead(time(), 1)").reads();
        assert_eq!(reads, [(Some("x".into()), 0), (Some("x".into()), 1), (None, -1)]);
    }
}
