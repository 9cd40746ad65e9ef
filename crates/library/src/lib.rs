//! Candidate functions: parsing, evaluation over columns, differentiation and printing.
//!
//! An [`Expr`] is an immutable tree over the columns of a recording, their lags and time. It is read from text within a
//! [`Scope`] ([`Expr::parse`], with the grammar), and printed so that it reads back equal. It is differentiated exactly
//! ([`Expr::derivative`]), and compiled together with others into a [`Program`] that evaluates blocks of rows. A
//! [`Filter`] is a column with memory, provided by a [`Filtered`] source. A [`Library`] is an ordered list of candidate
//! functions: monomials, lags, or any expressions.
//!
//! ```
//! use fleetfoot_library::{Expr, Library, Scope};
//!
//! let scope = Scope::new(["x", "v"]);
//! let energy = Expr::parse("v^2/2 - cos(x)", &scope)?;
//! assert_eq!(energy.derivative("x").simplified().to_string(), "sin(x)");
//! assert!(Expr::parse("v^2/2 - cos(y)", &scope).is_err());
//!
//! let library = Library::polynomial(&[Expr::column("x"), Expr::column("v")], 2)?;
//! assert_eq!(library.names(), ["x", "v", "x^2", "x*v", "v^2"]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod canonical;
mod central;
mod derivative;
mod design;
mod difference;
mod expr;
mod filter;
mod filtered;
mod function;
mod kernel;
mod latex;
mod library;
mod limits;
mod mathml;
mod parse;
mod parse_error;
mod print;
mod program;
mod replaced;
mod rotation;
mod scope;
mod simplify;
mod straight_line;
mod terms;
mod typeset;
mod unit;
mod view;

pub use central::{CentralDifference, REACHES, Spacing, central_difference, unevenness};
pub use design::{Design, DesignRows, TooLarge};
pub use difference::{backward_difference, forward_difference, mean_slope, mean_slope_rows};
pub use expr::{Expr, Node};
pub use filter::{Filter, FilterKind};
pub use filtered::{FilterError, Filtered};
pub use function::{Binary, Unary};
pub use kernel::Scratch;
pub use library::{Library, LibraryError};
pub use limits::MAX_FUNCTIONS;
pub use parse_error::{ParseError, ParseErrorKind};
pub use program::{Leaf, Program, UnknownColumn};
pub use rotation::{Quaternion, rotation_vector_rates};
pub use scope::Scope;
pub use straight_line::{Argument, Statement, StraightLine};
pub use terms::{PolynomialLibrary, Terms, TermsError, Vocabulary};
pub use unit::{Unit, UnitError, coefficient_unit};
pub use view::View;
