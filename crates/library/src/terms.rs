//! The library language: candidate functions from text.

mod candidates;
mod item;
mod polynomial;
#[cfg(test)]
mod tests;

pub use polynomial::PolynomialLibrary;

use crate::{Expr, MAX_FUNCTIONS, ParseError, Scope};
use candidates::{Candidates, Workshop};
use item::parse_item;

/// Variables and names that a library's text refers to.
#[derive(Debug, Clone, Copy)]
pub struct Vocabulary<'a> {
    /// Variables of `poly`, `sin`, `past` and so on when the text names none. They are columns, or expressions in their
    /// place, such as the cosine and the sine of an angle.
    pub variables: &'a [Expr],
    /// The names that expressions may use.
    pub scope: &'a Scope,
}

/// The candidate functions of a library.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Terms {
    /// True if the constant 1 is a candidate.
    pub constant: bool,
    /// The other candidates, distinct up to a number in front and up to the order of factors and addends, simplified.
    pub functions: Vec<Expr>,
}

/// Why texts are not a library.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TermsError {
    /// An item that cannot be read, or is too large by itself.
    #[error(transparent)]
    Item(#[from] ParseError),
    /// All items together have too many functions.
    #[error(
        "the library has {functions} candidate functions, at most {MAX_FUNCTIONS} are possible; lower a degree or a number of \
         lags, or name fewer variables"
    )]
    TooLarge {
        /// Number of functions that the library would have.
        functions: usize,
    },
}

impl Terms {
    /// Reads the items of a library; together they are its candidate functions, in their order, each once.
    ///
    /// An item is a sum of products of factors. A factor that is a library has many functions:
    ///
    /// ```text
    /// poly(d)          monomials up to total degree d of the variables, the constant among them; poly(d, bias=false) without
    /// interactions(d)  products of up to d different variables, the constant among them
    /// fourier(n)       sin(k*x), cos(k*x) of every variable x, k = 1..n
    /// sin, abs, ...    any function of one argument, of every variable; sign and step too
    /// identity         the variables themselves
    /// past(L)          the variables at the last L rows, this one first; past(L, every=k) at every k-th of them: 0, k, 2k, ... < L
    /// lags(n)          the variables 1 to n rows ago; lags(n, every=k) at k, 2k, ... <= n
    /// ```
    ///
    /// They range over [`Vocabulary::variables`], or over named expressions: `poly(2, [x, y*z])`, `sin([x, y])`,
    /// `identity([x])`. The argument may also be a library, whose functions are then the variables:
    /// `poly(2, past(10, every=5))`, `lags(3, sin)`, `abs(poly(2))`. If a variable that was not named is the cosine or
    /// the sine of an angle, `fourier`, `sin`, `cos` and `tan` are of that angle.
    ///
    /// Libraries are added and multiplied with each other and with expressions. `poly(2)*fourier(1)` is all pairwise
    /// products, `poly(1) + abs` the functions of both, and `poly(2)*V^2` and `poly(2)/m` every function times an
    /// expression. In `poly(1) + x*y + z` each addend is one more function. An item without any library is one
    /// function, `"V^2*alpha"`, `"sin(x - y)"`, in the grammar of [`Expr::parse`]; `"1"` is the constant. A column with
    /// the name of a library needs backticks.
    ///
    /// The order is that of the text; products are in graded lexicographic order as in
    /// [`Library::polynomial`](crate::Library::polynomial), with the variables in front. Of functions that differ only
    /// by a number in front, the first is taken, as it was written. Products of libraries have no number in front.
    ///
    /// # Errors
    /// [`TermsError`] with the place, the expected syntax, the names nearest to an unknown one, or the number of
    /// functions if it exceeds [`MAX_FUNCTIONS`].
    pub fn parse<S: AsRef<str>>(items: &[S], vocabulary: &Vocabulary) -> Result<Self, TermsError> {
        let mut workshop = Workshop::new(vocabulary.variables);
        let mut all = Candidates::default();
        for item in items {
            all.append(parse_item(item.as_ref(), vocabulary, &mut workshop)?);
            if all.len() > MAX_FUNCTIONS {
                return Err(TermsError::TooLarge { functions: all.len() });
            }
        }
        Ok(Self { constant: all.constant, functions: all.functions(&workshop) })
    }

    /// All functions in their order, the constant first if it is one of them.
    pub fn with_constant(&self) -> Vec<Expr> {
        self.constant.then(|| Expr::number(1.0)).into_iter().chain(self.functions.iter().cloned()).collect()
    }
}

impl crate::Library {
    /// Reads the items of a library: see [`Terms::parse`].
    ///
    /// # Errors
    /// As [`Terms::parse`].
    pub fn parse<S: AsRef<str>>(items: &[S], vocabulary: &Vocabulary) -> Result<Terms, TermsError> {
        Terms::parse(items, vocabulary)
    }
}
