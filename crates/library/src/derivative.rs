//! Exact derivatives.

use crate::{
    Binary, Expr, Filter, FilterKind, Node, Unary,
    simplify::{difference, power, product, quotient, sum, unary},
};

impl Expr {
    /// The derivative with respect to the column `name` at the current row, simplified ([`Expr::simplified`]).
    ///
    /// The same column at another lag is a constant, as is time. Where a function has a kink, one of its one-sided
    /// derivatives or their mean stands: `abs` gives `sign`, 0 at 0; `max` and `min` give the derivative of their second
    /// argument where both are equal; `sign` and `step` give 0; `wrap` gives the derivative of its argument.
    /// A filter's column is a column like any other: see [`Expr::sensitivity`] for what its constant does.
    pub fn derivative(&self, name: &str) -> Expr {
        self.chain_rule(|leaf| match leaf {
            Node::Column { name: column, lag: 0 } if **column == *name => Expr::number(1.0),
            _ => Expr::number(0.0),
        })
    }

    /// The derivative with respect to a parameter, a name that stands for the same number at every row: as [`Expr::derivative`], and through filters,
    /// whose slopes are columns of their own: of `lag1(m1, tau)` with respect to `tau`, `lag1_slope(m1, tau)`.
    ///
    /// The second derivative of a filter with respect to its constant is NaN.
    pub fn sensitivity(&self, parameter: &str) -> Expr {
        self.chain_rule(|leaf| match leaf {
            Node::Column { name, lag: 0 } if **name == *parameter => Expr::number(1.0),
            Node::Column { name, lag } => match Filter::of(name) {
                Some(filter) => filter.sensitivity(parameter).shifted(*lag),
                None => Expr::number(0.0),
            },
            _ => Expr::number(0.0),
        })
    }

    /// The derivative, given those of the leaves.
    fn chain_rule(&self, of_leaf: impl Fn(&Node) -> Expr) -> Expr {
        self.fold(|expr, slopes: &[Expr]| match (expr.node(), slopes) {
            (Node::Unary(function, x), [dx]) if !dx.is_number(0.0) => of_unary(*function, expr, x, dx.clone()),
            (Node::Power(x, k), [dx]) => {
                product(product(Expr::number(f64::from(*k)), power(x.clone(), k.saturating_sub(1))), dx.clone())
            }
            (Node::Binary(function, a, b), [da, db]) if !(da.is_number(0.0) && db.is_number(0.0)) => {
                of_binary(*function, expr, (a, b), da.clone(), db.clone())
            }
            (leaf, []) => of_leaf(leaf),
            _ => Expr::number(0.0),
        })
    }
}

impl Filter {
    /// The derivative of the output with respect to a parameter. Every filter is linear in its input; what has no closed recursion (the
    /// derivative of a slope with respect to its own constant) is NaN.
    fn sensitivity(&self, parameter: &str) -> Expr {
        let of_input = self.input.sensitivity(parameter);
        let of_constant = self.constant.sensitivity(parameter);
        let slope = match self.kind {
            FilterKind::Present => return Expr::number(0.0),
            FilterKind::Lag1 => Self { kind: FilterKind::Lag1Slope, ..self.clone() }.column(),
            FilterKind::Delay => Self { kind: FilterKind::DelaySlope, ..self.clone() }.column(),
            FilterKind::Lag1Slope | FilterKind::DelaySlope => Expr::number(f64::NAN),
        };
        let through = match of_input.as_number() {
            // A constant passes a lag and a delay unchanged, and has no slope.
            Some(value) if matches!(self.kind, FilterKind::Lag1 | FilterKind::Delay) => Expr::number(value),
            Some(_) => Expr::number(0.0),
            None => Self { input: of_input, ..self.clone() }.column(),
        };
        match of_constant.as_number() {
            Some(0.0) => through,
            _ => (through + slope * of_constant).simplified(),
        }
    }
}

/// d f(x) for `f(x)` = `value`, by the chain rule.
fn of_unary(function: Unary, value: &Expr, x: &Expr, dx: Expr) -> Expr {
    let one = || Expr::number(1.0);
    match function {
        Unary::Neg => unary(Unary::Neg, dx),
        Unary::Sin => product(x.cos(), dx),
        Unary::Cos => product(-x.sin(), dx),
        Unary::Tan => product(sum(one(), value.powi(2)), dx),
        Unary::Asin => quotient(dx, difference(one(), power(x.clone(), 2)).sqrt()),
        Unary::Acos => quotient(unary(Unary::Neg, dx), difference(one(), power(x.clone(), 2)).sqrt()),
        Unary::Atan => quotient(dx, sum(one(), power(x.clone(), 2))),
        Unary::Sinh => product(x.cosh(), dx),
        Unary::Cosh => product(x.sinh(), dx),
        Unary::Tanh => product(difference(one(), value.powi(2)), dx),
        Unary::Exp => product(value.clone(), dx),
        Unary::Log => quotient(dx, x.clone()),
        Unary::Sqrt => quotient(dx, product(Expr::number(2.0), value.clone())),
        Unary::Abs => product(x.sign(), dx),
        Unary::Sign | Unary::Step => Expr::number(0.0),
        Unary::Wrap => dx,
    }
}

/// d f(a, b) for `f(a, b)` = `value`; one of `da`, `db` may be zero.
fn of_binary(function: Binary, value: &Expr, (a, b): (&Expr, &Expr), da: Expr, db: Expr) -> Expr {
    match function {
        Binary::Add => sum(da, db),
        Binary::Sub => difference(da, db),
        Binary::Mul => sum(product(da, b.clone()), product(a.clone(), db)),
        Binary::Div if db.is_number(0.0) => quotient(da, b.clone()),
        Binary::Div => quotient(difference(product(da, b.clone()), product(a.clone(), db)), power(b.clone(), 2)),
        Binary::Pow if db.is_number(0.0) => {
            let lower = a.pow(difference(b.clone(), Expr::number(1.0)));
            product(product(b.clone(), lower), da)
        }
        Binary::Pow => {
            let of_exponent = product(db, unary(Unary::Log, a.clone()));
            product(value.clone(), sum(of_exponent, quotient(product(b.clone(), da), a.clone())))
        }
        Binary::Atan2 => quotient(
            difference(product(b.clone(), da), product(a.clone(), db)),
            sum(power(a.clone(), 2), power(b.clone(), 2)),
        ),
        Binary::Min => choose(difference(b.clone(), a.clone()), da, db),
        Binary::Max => choose(difference(a.clone(), b.clone()), da, db),
    }
}

/// `first` where `margin` is positive, else `second`.
fn choose(margin: Expr, first: Expr, second: Expr) -> Expr {
    if first == second {
        return first;
    }
    let step = unary(Unary::Step, margin);
    let rest = difference(Expr::number(1.0), step.clone());
    sum(product(step, first), product(rest, second))
}
