//! The expression type: an immutable tree over columns, lags and time.

use std::{
    collections::HashMap,
    fmt,
    hash::{DefaultHasher, Hash, Hasher},
    ops,
    sync::Arc,
};

use crate::{Binary, Unary, function::integer_power};

/// Node at the root of an expression.
#[derive(Debug, Clone)]
pub enum Node {
    /// A constant. All NaN are one.
    Number(f64),
    /// A column, `lag` rows earlier (negative: later).
    Column {
        /// The column's name in the recording.
        name: Arc<str>,
        /// Rows back in time.
        lag: i32,
    },
    /// Seconds from the start of the episode, `lag` rows earlier (negative: later).
    Time {
        /// Rows back in time.
        lag: i32,
    },
    /// A function of one argument.
    Unary(Unary, Expr),
    /// A function of two arguments.
    Binary(Binary, Expr, Expr),
    /// An integer power other than 0 and 1, by multiplication: `x^k = x^floor(k/2) * x^ceil(k/2)`.
    Power(Expr, i32),
}

/// An immutable expression, cheap to clone.
///
/// Equal expressions have the same tree, with numbers compared by their bits. What is built is kept as written; nothing
/// is rewritten, except that the negative of a number is a number, `x^1` is `x`, `x^0` is 1 and an integer exponent makes
/// a [`Node::Power`] (see [`Expr::simplified`] for more). Common parts are shared, and every method takes time linear in the
/// number of distinct parts and constant stack, however deep the tree is; only printing is as long as the tree.
#[derive(Clone)]
pub struct Expr(Arc<Inner>);

struct Inner {
    node: Node,
    hash: u64,
    size: u64,
}

impl Expr {
    /// A constant.
    pub fn number(value: f64) -> Self {
        Self::from_node(Node::Number(if value.is_nan() { f64::NAN } else { value }))
    }

    /// A column at the current row.
    pub fn column(name: impl Into<Arc<str>>) -> Self {
        Self::lagged(name, 0)
    }

    /// A column `lag` rows earlier (negative: later).
    pub fn lagged(name: impl Into<Arc<str>>, lag: i32) -> Self {
        Self::from_node(Node::Column { name: name.into(), lag })
    }

    /// Seconds from the start of the episode.
    pub fn time() -> Self {
        Self::from_node(Node::Time { lag: 0 })
    }

    /// A function of one argument.
    pub fn unary(function: Unary, x: Expr) -> Self {
        if let (Unary::Neg, Node::Number(value)) = (function, x.node()) {
            return Self::number(-value);
        }
        Self::from_node(Node::Unary(function, x))
    }

    /// A function of two arguments.
    pub fn binary(function: Binary, a: Expr, b: Expr) -> Self {
        if let (Binary::Pow, Node::Number(exponent)) = (function, b.node()) {
            let integer = *exponent as i32;
            if f64::from(integer) == *exponent {
                return a.powi(integer);
            }
        }
        Self::from_node(Node::Binary(function, a, b))
    }

    /// An integer power, by multiplication.
    pub fn powi(&self, exponent: i32) -> Self {
        match exponent {
            0 => Self::number(1.0),
            1 => self.clone(),
            _ => Self::from_node(Node::Power(self.clone(), exponent)),
        }
    }

    /// A power; a number that is an integer as exponent gives [`Expr::powi`].
    pub fn pow(&self, exponent: impl Into<Expr>) -> Self {
        Self::binary(Binary::Pow, self.clone(), exponent.into())
    }

    /// The angle of the point (`x`, `self`).
    pub fn atan2(&self, x: impl Into<Expr>) -> Self {
        Self::binary(Binary::Atan2, self.clone(), x.into())
    }

    /// The smaller of two.
    pub fn min(&self, other: impl Into<Expr>) -> Self {
        Self::binary(Binary::Min, self.clone(), other.into())
    }

    /// The larger of two.
    pub fn max(&self, other: impl Into<Expr>) -> Self {
        Self::binary(Binary::Max, self.clone(), other.into())
    }

    /// The root.
    pub fn node(&self) -> &Node {
        &self.0.node
    }

    /// Nodes of the tree, shared parts counted every time (saturating).
    pub fn size(&self) -> u64 {
        self.0.size
    }

    /// The value, if this is a constant.
    pub fn as_number(&self) -> Option<f64> {
        match self.node() {
            Node::Number(value) => Some(*value),
            _ => None,
        }
    }

    /// The name, if this is a column at the current row.
    pub fn as_column(&self) -> Option<&str> {
        match self.node() {
            Node::Column { name, lag: 0 } => Some(name),
            _ => None,
        }
    }

    /// The same function `lag` rows earlier (negative: later): every column and time in it is shifted.
    pub fn shifted(&self, lag: i32) -> Self {
        if lag == 0 {
            return self.clone();
        }
        self.rebuild(|node| match node {
            Node::Column { name, lag: base } => Some(Self::lagged(name.clone(), base.saturating_add(lag))),
            Node::Time { lag: base } => Some(Self::from_node(Node::Time { lag: base.saturating_add(lag) })),
            _ => None,
        })
    }

    /// The names of the columns, each once, in the order of their first appearance from the left.
    pub fn columns(&self) -> Vec<Arc<str>> {
        let mut names: Vec<Arc<str>> = Vec::new();
        let mut seen = std::collections::HashSet::new();
        self.fold(|expr, _: &[()]| {
            if let Node::Column { name, .. } = expr.node()
                && seen.insert(name.clone())
            {
                names.push(name.clone());
            }
        });
        names
    }

    /// Number of rows back and ahead that the expression reads, in columns and in time.
    pub fn reach(&self) -> (u32, u32) {
        let (mut back, mut ahead) = (0, 0);
        self.fold(|expr, _: &[()]| {
            if let Node::Column { lag, .. } | Node::Time { lag } = expr.node() {
                back = back.max((*lag).max(0).unsigned_abs());
                ahead = ahead.max((*lag).min(0).unsigned_abs());
            }
        });
        (back, ahead)
    }

    /// The value, given the leaves: `column(name, lag)` and `time(lag)`. For single values; see [`Program`](crate::Program)
    /// for rows.
    pub fn value(&self, mut column: impl FnMut(&str, i32) -> f64, mut time: impl FnMut(i32) -> f64) -> f64 {
        self.fold(|expr, arguments: &[f64]| match (expr.node(), arguments) {
            (Node::Number(value), _) => *value,
            (Node::Column { name, lag }, _) => column(name, *lag),
            (Node::Time { lag }, _) => time(*lag),
            (Node::Unary(function, _), &[x]) => function.apply(x),
            (Node::Binary(function, ..), &[a, b]) => function.apply(a, b),
            (Node::Power(_, k), &[x]) => integer_power(x, *k),
            _ => unreachable!("one argument for each child"),
        })
    }

    /// Returns true if the expression reads other rows than the present one: lags or leads.
    pub fn reads_other_rows(&self) -> bool {
        self.fold(|part, arguments: &[bool]| {
            let other = matches!(part.node(), Node::Column { lag, .. } | Node::Time { lag } if *lag != 0);
            other || arguments.iter().any(|&argument| argument)
        })
    }

    /// Bottom-up, left to right, every distinct shared part once: `visit(part, results of its arguments)`.
    pub fn fold<T: Clone>(&self, visit: impl FnMut(&Expr, &[T]) -> T) -> T {
        self.fold_with(&mut HashMap::new(), visit)
    }

    /// [`Expr::fold`] with the results of earlier folds; the expressions behind `results` must still be alive.
    pub(crate) fn fold_with<T: Clone>(
        &self,
        results: &mut HashMap<*const (), T>,
        mut visit: impl FnMut(&Expr, &[T]) -> T,
    ) -> T {
        let mut stack = vec![self];
        let mut arguments = Vec::with_capacity(2);
        while let Some(&expr) = stack.last() {
            if results.contains_key(&expr.address()) {
                stack.pop();
                continue;
            }
            let open = stack.len();
            stack.extend(expr.children().rev().filter(|child| !results.contains_key(&child.address())));
            if stack.len() == open {
                arguments.clear();
                arguments.extend(expr.children().map(|child| results[&child.address()].clone()));
                results.insert(expr.address(), visit(expr, &arguments));
                stack.pop();
            }
        }
        results[&self.address()].clone()
    }

    /// Replaces leaves and keeps everything else.
    pub(crate) fn rebuild(&self, mut replace: impl FnMut(&Node) -> Option<Expr>) -> Self {
        self.fold(|expr, arguments: &[Expr]| match arguments {
            [] => replace(expr.node()).unwrap_or_else(|| expr.clone()),
            _ => expr.with_children(arguments),
        })
    }

    /// The same root over other arguments; a leaf as it is.
    pub(crate) fn with_children(&self, arguments: &[Expr]) -> Self {
        match (self.node(), arguments) {
            (Node::Unary(function, _), [x]) => Self::unary(*function, x.clone()),
            (Node::Binary(function, ..), [a, b]) => Self::binary(*function, a.clone(), b.clone()),
            (Node::Power(_, k), [x]) => x.powi(*k),
            _ => self.clone(),
        }
    }

    /// The arguments of the root.
    pub(crate) fn children(&self) -> impl DoubleEndedIterator<Item = &Expr> {
        let (first, second) = match self.node() {
            Node::Number(_) | Node::Column { .. } | Node::Time { .. } => (None, None),
            Node::Unary(_, x) | Node::Power(x, _) => (Some(x), None),
            Node::Binary(_, a, b) => (Some(a), Some(b)),
        };
        first.into_iter().chain(second)
    }

    /// The hash of the tree: equal for equal expressions, and the same in every run.
    pub(crate) fn digest(&self) -> u64 {
        self.0.hash
    }

    fn address(&self) -> *const () {
        Arc::as_ptr(&self.0).cast()
    }

    fn from_node(node: Node) -> Self {
        let mut hasher = DefaultHasher::new();
        std::mem::discriminant(&node).hash(&mut hasher);
        let size = match &node {
            Node::Number(value) => {
                value.to_bits().hash(&mut hasher);
                1
            }
            Node::Column { name, lag } => {
                (name, lag).hash(&mut hasher);
                1
            }
            Node::Time { lag } => {
                lag.hash(&mut hasher);
                1
            }
            Node::Unary(function, x) => {
                (function, x.0.hash).hash(&mut hasher);
                x.size().saturating_add(1)
            }
            Node::Binary(function, a, b) => {
                (function, a.0.hash, b.0.hash).hash(&mut hasher);
                a.size().saturating_add(b.size()).saturating_add(1)
            }
            Node::Power(x, k) => {
                (k, x.0.hash).hash(&mut hasher);
                x.size().saturating_add(1)
            }
        };
        Self(Arc::new(Inner { node, hash: hasher.finish(), size }))
    }
}

impl Drop for Inner {
    /// With an explicit stack: a sum of a million terms is a million levels deep.
    fn drop(&mut self) {
        fn take(node: &mut Node, stack: &mut Vec<Expr>) {
            match std::mem::replace(node, Node::Number(0.0)) {
                Node::Unary(_, x) | Node::Power(x, _) => stack.push(x),
                Node::Binary(_, a, b) => stack.extend([a, b]),
                Node::Number(_) | Node::Column { .. } | Node::Time { .. } => {}
            }
        }
        if matches!(self.node, Node::Number(_) | Node::Column { .. } | Node::Time { .. }) {
            return;
        }
        let mut stack = Vec::new();
        take(&mut self.node, &mut stack);
        while let Some(expr) = stack.pop() {
            if let Some(mut inner) = Arc::into_inner(expr.0) {
                take(&mut inner.node, &mut stack);
            }
        }
    }
}

impl PartialEq for Expr {
    fn eq(&self, other: &Self) -> bool {
        if self.0.hash != other.0.hash {
            return false;
        }
        let mut stack = vec![(self, other)];
        let mut compared = std::collections::HashSet::new();
        while let Some((a, b)) = stack.pop() {
            if Arc::ptr_eq(&a.0, &b.0) {
                continue;
            }
            if a.0.hash != b.0.hash || a.0.size != b.0.size {
                return false;
            }
            match (a.node(), b.node()) {
                (Node::Number(x), Node::Number(y)) if x.to_bits() == y.to_bits() => {}
                (Node::Column { name: n, lag: k }, Node::Column { name: m, lag: l }) if n == m && k == l => {}
                (Node::Time { lag: k }, Node::Time { lag: l }) if k == l => {}
                (Node::Unary(f, x), Node::Unary(g, y)) if f == g => stack.push((x, y)),
                (Node::Power(x, k), Node::Power(y, l)) if k == l => stack.push((x, y)),
                // Shared parts are compared once.
                (Node::Binary(f, x, v), Node::Binary(g, y, w)) if f == g => {
                    if compared.insert((a.address(), b.address())) {
                        stack.extend([(x, y), (v, w)]);
                    }
                }
                _ => return false,
            }
        }
        true
    }
}

impl Eq for Expr {}

impl Hash for Expr {
    fn hash<H: Hasher>(&self, state: &mut H) {
        state.write_u64(self.0.hash);
    }
}

impl fmt::Debug for Expr {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Expr({self})")
    }
}

impl From<f64> for Expr {
    fn from(value: f64) -> Self {
        Self::number(value)
    }
}

impl From<&Expr> for Expr {
    fn from(expr: &Expr) -> Self {
        expr.clone()
    }
}

macro_rules! unary_methods {
    ($($method:ident $function:ident $doc:literal,)*) => {
        impl Expr {
            $(#[doc = $doc]
            pub fn $method(&self) -> Self {
                Self::unary(Unary::$function, self.clone())
            })*
        }
    };
}

unary_methods! {
    sin Sin "Sine, radians.",
    cos Cos "Cosine, radians.",
    tan Tan "Tangent, radians.",
    asin Asin "Inverse sine, radians.",
    acos Acos "Inverse cosine, radians.",
    atan Atan "Inverse tangent, radians.",
    sinh Sinh "Hyperbolic sine.",
    cosh Cosh "Hyperbolic cosine.",
    tanh Tanh "Hyperbolic tangent.",
    exp Exp "Exponential.",
    log Log "Natural logarithm.",
    sqrt Sqrt "Square root.",
    abs Abs "Absolute value.",
    sign Sign "-1, 0 or 1; 0 at 0.",
    step Step "1 for positive values, otherwise 0.",
    wrap Wrap "The angle brought to (-pi, pi].",
}

macro_rules! operators {
    ($($trait:ident $method:ident,)*) => {
        $(impl<R: Into<Expr>> ops::$trait<R> for Expr {
            type Output = Expr;
            fn $method(self, other: R) -> Expr {
                Expr::binary(Binary::$trait, self, other.into())
            }
        }
        impl<R: Into<Expr>> ops::$trait<R> for &Expr {
            type Output = Expr;
            fn $method(self, other: R) -> Expr {
                Expr::binary(Binary::$trait, self.clone(), other.into())
            }
        }
        impl ops::$trait<Expr> for f64 {
            type Output = Expr;
            fn $method(self, other: Expr) -> Expr {
                Expr::binary(Binary::$trait, self.into(), other)
            }
        }
        impl ops::$trait<&Expr> for f64 {
            type Output = Expr;
            fn $method(self, other: &Expr) -> Expr {
                Expr::binary(Binary::$trait, self.into(), other.clone())
            }
        })*
    };
}

operators! {
    Add add,
    Sub sub,
    Mul mul,
    Div div,
}

impl ops::Neg for Expr {
    type Output = Expr;
    fn neg(self) -> Expr {
        Expr::unary(Unary::Neg, self)
    }
}

impl ops::Neg for &Expr {
    type Output = Expr;
    fn neg(self) -> Expr {
        Expr::unary(Unary::Neg, self.clone())
    }
}
