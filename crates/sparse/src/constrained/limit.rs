//! Limits that a fit keeps at every row. A form that is linear in the latents, or a symmetric matrix of such forms,
//! stays on one side of a bound.
//!
//! A form is a matrix of one entry, so both are the same condition. The least eigenvalue is at least the bound, or the
//! greatest is at most the bound.

use fleetfoot_data::packed_row;
use fleetfoot_library::{Expr, Node};

use super::ConstrainedError;
use fleetfoot_sums::structured::{Regression, Term};

/// On which side of its bound a form stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Limit {
    /// `form >= bound`.
    AtLeast,
    /// `form <= bound`.
    AtMost,
}

impl Limit {
    /// Factor that turns the limit into a lower bound.
    pub(super) fn sign(self) -> f64 {
        match self {
            Self::AtLeast => 1.0,
            Self::AtMost => -1.0,
        }
    }

    pub(super) fn symbol(self) -> &'static str {
        match self {
            Self::AtLeast => ">=",
            Self::AtMost => "<=",
        }
    }
}

/// Linear form of the latents, `sum of coefficient(x) latent(x) + rest(x)`, such as the power of a friction `F*v` or an
/// entry of an inertia matrix.
#[derive(Debug, Clone, PartialEq)]
pub struct Form {
    /// Terms, each of another latent.
    pub terms: Vec<Term>,
    /// Term without latents.
    pub rest: Expr,
}

/// Limit that a fit keeps at every row.
#[derive(Debug, Clone, PartialEq)]
pub struct RowLimit {
    /// Name in messages: `D`, `inertia`.
    pub name: String,
    /// The matrix (packed lower triangle by rows): one form for a number.
    pub forms: Vec<Form>,
    /// The side.
    pub side: Limit,
    /// The bound: a number, or an expression over the columns.
    pub bound: Expr,
}

impl RowLimit {
    /// A bound of one latent.
    pub fn of_latent(name: impl Into<String>, latent: usize, side: Limit, bound: Expr) -> Self {
        let terms = vec![Term { latent, coefficient: Expr::number(1.0) }];
        Self { name: name.into(), forms: vec![Form { terms, rest: Expr::number(0.0) }], side, bound }
    }

    /// Rows and columns of the matrix; 1 for a number.
    pub fn order(&self) -> usize {
        (1..).find(|&order| packed_row(order) >= self.forms.len()).unwrap_or(1)
    }

    /// Returns true if the limit is the same at every row: then no rows are needed to keep it.
    pub fn is_constant(&self, regression: &Regression) -> bool {
        let varies = |expression: &Expr| {
            expression.fold(|part, arguments: &[bool]| {
                arguments.contains(&true) || matches!(part.node(), Node::Column { .. } | Node::Time { .. })
            })
        };
        !self.expressions(regression).iter().any(varies)
    }

    /// Expressions to evaluate at a row: for every form the products of its coefficients with their functions, then the
    /// rest; then the bound.
    pub(super) fn expressions(&self, regression: &Regression) -> Vec<Expr> {
        let product = |term: &Term, function: &Expr| match term.coefficient.as_number() {
            // As it stands, so that a bound of a latent has the bits of its functions.
            Some(1.0) => function.clone(),
            _ => (&term.coefficient * function).simplified(),
        };
        let mut all = Vec::new();
        for form in &self.forms {
            for term in &form.terms {
                all.extend(regression.latents[term.latent].functions.iter().map(|function| product(term, function)));
            }
            all.push(form.rest.clone());
        }
        all.push(self.bound.clone());
        all
    }

    /// The coefficients that the products of a form are multiplied with, in their order.
    pub(super) fn coefficients<'a>(
        &'a self,
        form: usize,
        regression: &'a Regression,
    ) -> impl Iterator<Item = usize> + 'a {
        self.forms[form].terms.iter().flat_map(|term| {
            let first = regression.first(term.latent);
            first..first + regression.latents[term.latent].functions.len()
        })
    }

    pub(super) fn check(&self, regression: &Regression) -> Result<(), ConstrainedError> {
        let latents = regression.latents.len();
        let mut used = self.forms.iter().flat_map(|form| &form.terms).map(|term| term.latent);
        if let Some(latent) = used.find(|&latent| latent >= latents) {
            return Err(ConstrainedError::NoSuchLatent { latent, latents });
        }
        let entries = self.forms.len();
        match entries > 0 && packed_row(self.order()) == entries {
            true => Ok(()),
            false => Err(ConstrainedError::NoMatrix { name: self.name.clone(), entries }),
        }
    }
}
