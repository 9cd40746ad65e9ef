//! Libraries: ordered lists of candidate functions.

use crate::{Expr, MAX_FUNCTIONS, Program, UnknownColumn};

/// Candidate functions in their order. The constant is not among them: the intercept is the model's.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Library {
    functions: Vec<Expr>,
}

/// Why a library cannot be built.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum LibraryError {
    /// Too many candidate functions.
    #[error(
        "a library of all monomials of {variables} variables up to degree {degree} has more than {MAX_FUNCTIONS} functions; \
         lower the degree or leave out variables"
    )]
    TooLarge {
        /// Variables.
        variables: usize,
        /// Total degree.
        degree: u32,
    },
}

impl Library {
    /// These functions.
    pub fn new(functions: Vec<Expr>) -> Self {
        Self { functions }
    }

    /// All monomials of total degree 1 to `degree` in graded lexicographic order: x, y, x^2, x*y, y^2, ...
    ///
    /// Every monomial of degree d > 1 is the product of two others or a balanced power, so that the whole library costs one
    /// multiplication per monomial of degree two and more. `variables` are taken as they are given, repetitions included.
    ///
    /// # Errors
    /// [`LibraryError::TooLarge`] beyond [`MAX_FUNCTIONS`].
    pub fn polynomial(variables: &[Expr], degree: u32) -> Result<Self, LibraryError> {
        let too_large = LibraryError::TooLarge { variables: variables.len(), degree };
        let count = monomials(variables.len(), degree).filter(|&count| count <= MAX_FUNCTIONS).ok_or(too_large)?;
        let mut functions = Vec::with_capacity(count);
        for total in 1..=if variables.is_empty() { 0 } else { degree as i32 } {
            extend(None, variables, total, &mut functions);
        }
        Ok(Self { functions })
    }

    /// Every expression at every lag (rows back in time; negative: later), lag by lag: with lags 0 and 1,
    /// `x, u, lag(x, 1), lag(u, 1)`.
    pub fn with_lags(exprs: &[Expr], lags: &[i32]) -> Self {
        Self { functions: lags.iter().flat_map(|&lag| exprs.iter().map(move |expr| expr.shifted(lag))).collect() }
    }

    /// The functions in order.
    pub fn functions(&self) -> &[Expr] {
        &self.functions
    }

    /// The printed functions in order.
    pub fn names(&self) -> Vec<String> {
        self.functions.iter().map(Expr::to_string).collect()
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        self.functions.len()
    }

    /// Returns true if there is no function.
    pub fn is_empty(&self) -> bool {
        self.functions.is_empty()
    }

    /// The program that evaluates the functions, in order, on the rows of a recording with these columns.
    ///
    /// # Errors
    /// A function uses a column that is not among them.
    pub fn compile(&self, columns: &[&str]) -> Result<Program, UnknownColumn> {
        Program::compile(&self.functions, columns)
    }
}

impl Extend<Expr> for Library {
    fn extend<T: IntoIterator<Item = Expr>>(&mut self, functions: T) {
        self.functions.extend(functions);
    }
}

impl FromIterator<Expr> for Library {
    fn from_iter<T: IntoIterator<Item = Expr>>(functions: T) -> Self {
        Self::new(functions.into_iter().collect())
    }
}

/// Appends, in lexicographic order, `head` times every monomial of `variables` of the total degree `degree`.
///
/// The factors multiply from the left, `(x^2*y)*z^3`: what stands before the last power is itself a monomial of the library.
/// As deep as a monomial has different variables, which the limit on the library's size keeps small.
fn extend(head: Option<&Expr>, variables: &[Expr], degree: i32, functions: &mut Vec<Expr>) {
    for (i, variable) in variables.iter().enumerate() {
        for exponent in (1..=degree).rev() {
            let power = variable.powi(exponent);
            let product = head.map_or_else(|| power.clone(), |head| head * &power);
            if exponent == degree {
                functions.push(product);
            } else if i + 1 < variables.len() {
                extend(Some(&product), &variables[i + 1..], degree - exponent, functions);
            } else {
                break;
            }
        }
    }
}

/// `binomial(variables + degree, degree) - 1`, unless it overflows.
pub(crate) fn monomials(variables: usize, degree: u32) -> Option<usize> {
    let mut count: u128 = 1;
    // The smaller side of the binomial keeps the loop short; the product of i consecutive numbers is divisible by i!.
    let (smaller, larger) = ((degree as usize).min(variables), (degree as usize).max(variables));
    for i in 1..=smaller as u128 {
        count = count.checked_mul(larger as u128 + i)? / i;
        if count > usize::MAX as u128 {
            return None;
        }
    }
    usize::try_from(count - 1).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn columns(names: &[&str]) -> Vec<Expr> {
        names.iter().map(|&name| Expr::column(name)).collect()
    }

    #[test]
    fn monomials_come_in_graded_lexicographic_order() {
        let library = Library::polynomial(&columns(&["x", "y"]), 3).unwrap();
        assert_eq!(library.names(), ["x", "y", "x^2", "x*y", "y^2", "x^3", "x^2*y", "x*y^2", "y^3"]);
        let library = Library::polynomial(&columns(&["x", "y", "z"]), 2).unwrap();
        assert_eq!(library.names(), ["x", "y", "z", "x^2", "x*y", "x*z", "y^2", "y*z", "z^2"]);
        for (n, degree) in [(1, 7), (2, 5), (3, 5), (5, 4), (7, 1), (0, 3), (3, 0)] {
            let names: Vec<String> = (0..n).map(|i| format!("x{i}")).collect();
            let names: Vec<&str> = names.iter().map(String::as_str).collect();
            let library = Library::polynomial(&columns(&names), degree).unwrap();
            assert_eq!(Some(library.len()), monomials(n, degree), "{n} variables, degree {degree}");
            let distinct: std::collections::HashSet<_> = library.functions().iter().collect();
            assert_eq!(distinct.len(), library.len());
        }
    }

    #[test]
    fn a_monomial_costs_one_multiplication() {
        for (names, degree) in [(&["x", "y", "z"][..], 5), (&["x", "y"][..], 9), (&["a", "b", "c", "d", "e"][..], 4)] {
            let library = Library::polynomial(&columns(names), degree).unwrap();
            let program = library.compile(names).unwrap();
            // The variables themselves are copied.
            assert_eq!(program.instructions(), library.len());
            assert_eq!(program.registers(), 0);
        }
    }

    #[test]
    fn sizes_beyond_reason_are_refused() {
        let many: Vec<Expr> = (0..1000).map(|i| Expr::column(format!("x{i}"))).collect();
        for degree in [2, 3, 30, u32::MAX] {
            assert_eq!(Library::polynomial(&many, degree), Err(LibraryError::TooLarge { variables: 1000, degree }));
        }
        assert_eq!(Library::polynomial(&many[..1], 100_000).unwrap().len(), 100_000);
        assert!(Library::polynomial(&many[..1], 100_001).is_err());
        assert_eq!(Library::polynomial(&many, 1).unwrap().len(), 1000);
    }

    #[test]
    fn lags_come_lag_by_lag() {
        let library = Library::with_lags(&columns(&["x", "u"]), &[0, 1, 3]);
        assert_eq!(library.names(), ["x", "u", "lag(x, 1)", "lag(u, 1)", "lag(x, 3)", "lag(u, 3)"]);
    }
}
