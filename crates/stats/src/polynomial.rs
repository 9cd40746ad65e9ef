//! The Gram matrix of a polynomial library in few moments.
//!
//! A library of all monomials of total degree `1..=D` in m base columns has p = C(m + D, m) - 1 functions and p (p + 1) / 2 pair products, but
//! those products are only monomials of degree up to 2D: for m = 3, D = 5 there are 286 of them for 1,596 pairs. Summing
//! the moments instead of the pairs is several times cheaper than any matrix product.
//!
//! Raw monomials of physical signals are nearly collinear, and nothing that is lost in a sum comes back. So a [`PolynomialPlan`]
//! first fixes, on a pilot sample, an affine map to centred, uncorrelated variables of one size (polynomials of total degree D
//! stay what they are under it), and then the basis of tensor Chebyshev polynomials `T_a(v_1) T_b(v_2) ...` of total degree `1..=D`. Because
//! `T_a T_b = (T_{a+b} + T_{|a-b|}) / 2`, the Gram matrix of that basis is a mean, with positive weights, of Chebyshev moments of degree up to 2D.
//! The unit of the variables is the one, from one to three standard deviations of the pilot, in which the
//! design has the least condition. Rows outside the pilot's range are exact, only less well scaled.
//!
//! A fit is solved in that basis; [`PolynomialPlan::to_monomials`] converts its coefficients at the end.
//!
//! **When to use it.** The moments hold X'X, so the relative error of coefficients in the basis is about `condition^2 x 1.1e-16`
//! ([`PolynomialPlan::condition`], as seen on the pilot): 1e-10 at a condition of 1e3. Use the moments below about 1e3
//! ([`PolynomialPlan::is_well_conditioned`]) and a general preconditioned Gram or an R factor beyond it: on such data (a base column that is nearly a
//! function of the others, two-valued columns with degree 2, too few distinct rows) the moments cannot tell what
//! the rows could.
//!
//! ```
//! use fleetfoot_stats::PolynomialPlan;
//! let x: Vec<f64> = (0..1000).map(|i| (i as f64 * 0.37).sin()).collect();
//! let y: Vec<f64> = x.iter().map(|x| 1.0 + 2.0 * x * x).collect();
//! let plan = PolynomialPlan::from_pilot(&[&x], &[&y], 2)?;
//! let mut moments = plan.moments();
//! moments.add(&plan, &mut plan.scratch(), &[&x], &[&y], None);
//! let gram = plan.gram(&moments); // of T_1, T_2 and y
//! assert_eq!((gram.dimension(), gram.rows), (3, 1000));
//! # Ok::<(), fleetfoot_stats::PolynomialError>(())
//! ```

mod affine;
mod bank;
mod bytes;
mod convert;
mod double;
mod functions;
mod graded;
mod kernel;
mod products;
mod sums;
mod tiling;

#[cfg(test)]
mod tests;

use faer::{Mat, MatRef};
use fleetfoot_data::packed;

use crate::{Gram, Preconditioner};
use affine::AffineMap;
pub use bank::PolynomialBank;
use functions::Functions;
use graded::Graded;
use kernel::{AddRows, Program, Registers, Rows, Workspace};
use products::ProductTable;
pub use sums::{PolynomialMoments, PolynomialScratch};
use tiling::Tiling;

/// Most base columns.
const VARIABLES: usize = 16;
/// Most library functions, the constant included: their Gram matrix has two million entries.
const FUNCTIONS: usize = 2_001;
/// Most moments: beyond it the functions of one tile of rows leave the second-level cache.
const MOMENTS: usize = 100_000;
/// Up to this condition the moments are as good as a general method for practical purposes.
const WELL_CONDITIONED: f64 = 1e3;
/// Units tried, in standard deviations of the pilot.
const UNITS: [f64; 6] = [1.0, 1.25, 1.5, 1.75, 2.0, 3.0];

/// Why there is no plan.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolynomialError {
    /// No columns, too many columns, or degree zero.
    #[error(
        "a polynomial library needs 1 to 16 base columns and a degree of at least 1, not {variables} columns and degree {degree}"
    )]
    Shape {
        /// Base columns.
        variables: usize,
        /// Total degree.
        degree: usize,
    },
    /// The moments would not fit the budget.
    #[error(
        "degree {degree} in {variables} columns makes {functions} functions and {moments} moments, more than 2,000 and 100,000: \
         lower the degree or take fewer columns"
    )]
    TooLarge {
        /// Base columns.
        variables: usize,
        /// Total degree.
        degree: usize,
        /// Library functions.
        functions: usize,
        /// Chebyshev moments.
        moments: usize,
    },
    /// The pilot sample is empty or its columns differ in length.
    #[error("the pilot sample is empty or its columns differ in length")]
    Pilot,
    /// The pilot sample holds NaN or infinity.
    #[error("column {column} of the pilot sample (base columns first, then targets) has values that are not finite")]
    NotFinite {
        /// Index of the column.
        column: usize,
    },
    /// Bytes that are no plan.
    #[error("the bytes of the polynomial plan are damaged or of another version")]
    Bytes,
}

/// Settings that are fixed before a scan: the base columns' affine map, the basis, and the reduction of rows to
/// moments.
#[derive(Debug, Clone)]
pub struct PolynomialPlan {
    degree: usize,
    map: AffineMap,
    target_centre: Vec<f64>,
    library: Graded,
    moments: Graded,
    program: Program,
    table: ProductTable,
    condition: f64,
}

impl PolynomialPlan {
    /// A plan for all monomials of total degree `1..=degree` of `base` (one slice a column) with `targets`, from a pilot sample of rows.
    ///
    /// # Errors
    /// No or more than 16 columns, degree 0, more than 2,000 functions or 100,000 moments, or a pilot that is empty, ragged or not finite.
    pub fn from_pilot(base: &[&[f64]], targets: &[&[f64]], degree: usize) -> Result<Self, PolynomialError> {
        let variables = base.len();
        check_size(variables, degree)?;
        let rows = base[0].len();
        if rows == 0 || base.iter().chain(targets).any(|column| column.len() != rows) {
            return Err(PolynomialError::Pilot);
        }
        if let Some(column) =
            base.iter().chain(targets).position(|column| column.iter().any(|value| !value.is_finite()))
        {
            return Err(PolynomialError::NotFinite { column });
        }
        let target_centre = targets.iter().map(|y| y.iter().sum::<f64>() / rows as f64).collect();
        let mut plan = Self::of_map(degree, AffineMap::from_pilot(base), target_centre);
        plan.choose_unit(base, targets);
        Ok(plan)
    }

    /// The plan whose basis this map defines, of a size that was checked; its condition is not known.
    fn of_map(degree: usize, map: AffineMap, target_centre: Vec<f64>) -> Self {
        let library = Graded::new(map.variables(), degree);
        let moments = Graded::new(map.variables(), 2 * degree);
        let registers = fleetfoot_data::arch().dispatch(Registers);
        Self {
            degree,
            map,
            program: program(&library, &moments, degree, target_centre.len(), registers),
            target_centre,
            table: ProductTable::new(&library, &moments),
            library,
            moments,
            condition: f64::INFINITY,
        }
    }

    /// Takes the unit of the variables in which the pilot's design has the least condition.
    fn choose_unit(&mut self, base: &[&[f64]], targets: &[&[f64]]) {
        let (map, mut best) = (self.map.clone(), self.map.in_units_of(UNITS[2]));
        let mut scratch = self.scratch();
        for unit in UNITS {
            self.map = map.in_units_of(unit);
            let mut moments = self.moments();
            moments.add(self, &mut scratch, base, targets, None);
            let condition = self.condition_of(&moments);
            if condition < self.condition {
                self.condition = condition;
                best = self.map.clone();
            }
        }
        self.map = best;
    }

    /// Condition of the design behind `moments`: [`PolynomialPlan::condition`] on other rows than the pilot's, for instance on all rows of a scan.
    pub fn condition_of(&self, moments: &PolynomialMoments) -> f64 {
        let (p, gram) = (self.functions(), self.gram(moments));
        // Rounding of a moment is relative to what was summed, so a column counts by its size before centring, and at least as 1.
        let size = |i: usize| {
            let raw = gram.get(i, i) + gram.weight * gram.mean[i] * gram.mean[i];
            raw.max(gram.weight).sqrt()
        };
        let sizes: Vec<f64> = (0..p).map(size).collect();
        let scaled = Mat::from_fn(p, p, |i, j| gram.get(i.max(j), i.min(j)) / (sizes[i] * sizes[j]));
        if !(0..p).all(|j| (0..p).all(|i| scaled[(i, j)].is_finite())) {
            return f64::INFINITY;
        }
        let Ok(values) = scaled.self_adjoint_eigenvalues(faer::Side::Lower) else {
            return f64::INFINITY;
        };
        let (least, most) = (values[0], values[p - 1].max(1.0));
        if least <= p as f64 * f64::EPSILON * most { f64::INFINITY } else { (most / least).sqrt() }
    }

    /// Base columns m.
    pub fn variables(&self) -> usize {
        self.map.variables()
    }

    /// Total degree D.
    pub fn degree(&self) -> usize {
        self.degree
    }

    /// Targets q.
    pub fn targets(&self) -> usize {
        self.target_centre.len()
    }

    /// Library functions p, without the constant.
    pub fn functions(&self) -> usize {
        self.library.len() - 1
    }

    /// Sums that a row adds to: moments, cross-moments and products of targets; the multiply-adds a row cannot do without.
    pub fn sums(&self) -> usize {
        self.program.sums()
    }

    /// The condition of the pilot's centred design in the basis, each column measured by the size of what is summed for it; infinite when the pilot
    /// cannot tell the functions apart. The relative error of coefficients in the basis is about its square times 1.1e-16.
    pub fn condition(&self) -> f64 {
        self.condition
    }

    /// Returns true if the moments are good enough for least squares: their condition is below 1e3.
    pub fn is_well_conditioned(&self) -> bool {
        self.condition < WELL_CONDITIONED
    }

    /// Powers of the base columns in each library function, in graded lexicographic order: x, y, x^2, x*y, y^2, ...
    ///
    /// Function i of the basis has the same numbers as degrees of its Chebyshev factors.
    pub fn exponents(&self) -> impl ExactSizeIterator<Item = &[u8]> {
        (1..self.library.len()).map(|i| self.library.exponent(i))
    }

    /// The monomials by name, `x^2*y`, for base columns of these names.
    ///
    /// # Panics
    /// If there are fewer names than base columns.
    pub fn names(&self, base: &[impl AsRef<str>]) -> Vec<String> {
        let factor = |(k, &power): (usize, &u8)| match power {
            0 => None,
            1 => Some(base[k].as_ref().to_owned()),
            _ => Some(format!("{}^{power}", base[k].as_ref())),
        };
        self.exponents().map(|e| e.iter().enumerate().filter_map(factor).collect::<Vec<_>>().join("*")).collect()
    }

    /// Empty sums.
    pub fn moments(&self) -> PolynomialMoments {
        PolynomialMoments::new(self.sums())
    }

    /// Working memory for [`PolynomialMoments::add`], one per thread.
    pub fn scratch(&self) -> PolynomialScratch {
        PolynomialScratch(Workspace::new(&self.program, self.variables()))
    }

    /// Gram matrix of (basis functions, targets), d = p + q. Targets are in their own units.
    ///
    /// # Panics
    /// If the moments belong to a plan of another shape.
    pub fn gram(&self, moments: &PolynomialMoments) -> Gram {
        self.gram_of(moments.rows(), &moments.values())
    }

    /// [`PolynomialPlan::gram`] of plain sums.
    fn gram_of(&self, rows: u64, sums: &[f64]) -> Gram {
        let (p, q) = (self.functions(), self.targets());
        assert_eq!(sums.len(), self.sums(), "moments of this plan");
        let weight = sums[0];
        let cross = |i: usize, t: usize| sums[self.moments.len() + t * self.library.len() + i];
        let pairs = self.moments.len() + q * self.library.len();
        let first = |i: usize| {
            if i < p { self.table.product(i + 1, 0, sums) } else { cross(0, i - p) }
        };
        let second = |i: usize, j: usize| match (i < p, j < p) {
            (true, true) => self.table.product(i + 1, j + 1, sums),
            (false, true) => cross(j + 1, i - p),
            _ => sums[pairs + (i - p) * (i - p + 1) / 2 + j - p],
        };
        let mut gram = Gram::new(p + q);
        gram.rows = rows;
        gram.weight = weight;
        if weight == 0.0 {
            return gram;
        }
        let firsts: Vec<f64> = (0..p + q).map(first).collect();
        for i in 0..p + q {
            let shift = if i < p { 0.0 } else { self.target_centre[i - p] };
            gram.mean[i] = shift + firsts[i] / weight;
            for j in 0..=i {
                let value = second(i, j) - firsts[i] * (firsts[j] / weight);
                // A sum of squares: below zero is rounding.
                gram.scatter[packed(i, j)] = if i == j { value.max(0.0) } else { value };
            }
        }
        gram
    }

    /// The basis functions of rows, n x p: for residuals, for methods that need rows, and for checks.
    ///
    /// # Panics
    /// If the number of columns is not the plan's or their lengths differ.
    pub fn evaluate(&self, base: &[&[f64]]) -> Mat<f64> {
        assert_eq!(base.len(), self.variables(), "columns of the plan");
        let rows = base[0].len();
        assert!(base.iter().all(|column| column.len() == rows), "columns of one length");
        let mut design = Mat::zeros(rows, self.functions());
        let mut v = vec![0.0; base.len()];
        // chebyshev[k][a] = T_a(v_k)
        let mut chebyshev = vec![vec![1.0; self.degree + 1]; base.len()];
        for row in 0..rows {
            v.iter_mut().zip(base).for_each(|(v, column)| *v = column[row]);
            self.map.apply(&mut v);
            for (values, &v) in chebyshev.iter_mut().zip(&v) {
                values[1] = v;
                (2..=self.degree).for_each(|a| values[a] = 2.0 * v * values[a - 1] - values[a - 2]);
            }
            for (i, exponent) in self.exponents().enumerate() {
                design[(row, i)] = exponent.iter().zip(&chebyshev).map(|(&a, values)| values[usize::from(a)]).product();
            }
        }
        design
    }

    /// Coefficients of the basis (p x q) with intercepts (q) as coefficients of the raw monomials of the base columns, with intercepts.
    ///
    /// The expansion is done in twice the working precision and adds no error of its own. What the basis coefficients have is
    /// magnified as far as raw monomials are worse conditioned than the basis: a column of 1000 +- 1 has nearly collinear powers.
    ///
    /// # Panics
    /// If the shapes are not the plan's p and one intercept per column.
    pub fn to_monomials(&self, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> (Mat<f64>, Vec<f64>) {
        assert_eq!(
            (coefficients.nrows(), coefficients.ncols()),
            (self.functions(), intercept.len()),
            "coefficients p x q"
        );
        convert::to_monomials(&self.library, &self.map, coefficients, intercept)
    }

    /// The inverse of [`PolynomialPlan::to_monomials`]: a model in raw monomials, for its error on a Gram of the basis.
    ///
    /// # Panics
    /// If the shapes are not the plan's p and one intercept per column.
    pub fn from_monomials(&self, coefficients: MatRef<'_, f64>, intercept: &[f64]) -> (Mat<f64>, Vec<f64>) {
        assert_eq!(
            (coefficients.nrows(), coefficients.ncols()),
            (self.functions(), intercept.len()),
            "coefficients p x q"
        );
        convert::from_monomials(&self.library, &self.map, coefficients, intercept)
    }

    /// From the basis to raw monomials: with it, [`Preconditioner::square_root`] of a Gram matrix of this plan is a factor of the raw monomials and the targets,
    /// made without their Gram matrix.
    ///
    /// `order[i]` is the place of monomial i ([`PolynomialPlan::exponents`]) among the raw columns.
    ///
    /// # Panics
    /// When `order` is not a permutation of the functions.
    pub fn preconditioner(&self, order: &[usize]) -> Preconditioner {
        let columns = convert::triangle(&self.library, &self.map);
        Preconditioner::of_columns(columns, order, self.targets(), self.condition)
    }

    fn add_rows(&self, rows: Rows<'_>, workspace: &mut Workspace, total: impl FnMut(usize, f64)) {
        let (program, map, target_centre) = (&self.program, &self.map, &self.target_centre);
        fleetfoot_data::arch().dispatch(AddRows { program, map, target_centre, rows, workspace, total });
    }
}

/// That a plan of this size can be made.
fn check_size(variables: usize, degree: usize) -> Result<(), PolynomialError> {
    if variables == 0 || variables > VARIABLES || degree == 0 {
        return Err(PolynomialError::Shape { variables, degree });
    }
    let (functions, sums) = (graded::count(variables, degree), graded::count(variables, degree.saturating_mul(2)));
    if functions > FUNCTIONS || sums > MOMENTS || degree > usize::from(u8::MAX) / 2 {
        return Err(PolynomialError::TooLarge { variables, degree, functions: functions - 1, moments: sums });
    }
    Ok(())
}

/// The kernel's functions, and its tiles for an instruction set with so many vector registers.
fn program(library: &Graded, moments: &Graded, degree: usize, targets: usize, registers: usize) -> Program {
    let (variables, top) = (library.exponent(0).len(), 2 * degree);
    let split = tiling::best_split(variables, top);
    let (first, second) = (Graded::new(split, top), Graded::new(variables - split, top));
    let (low, low_second) = (Graded::new(split, degree), Graded::new(variables - split, degree));
    let functions = Functions::below(&first, 0, top);
    let highest = if functions.all_stored() { top } else { top - 1 };
    let of_first = |i: usize| [first.exponent(i), second.exponent(0)].concat();
    Program {
        moments: Tiling::staircase((&first, highest), &second, top, moments, registers),
        tops: (highest < top)
            .then(|| Tiling::alone(first.of_degree(top), registers, |i| moments.index(&of_first(i)).unwrap_or(0))),
        cross: Tiling::staircase((&low, degree), &low_second, degree, library, registers),
        pairs: (0..targets).map(|t| Tiling::alone(0..t + 1, registers, |j| t * (t + 1) / 2 + j)).collect(),
        low: low.len(),
        first: functions,
        targets: Functions::given(targets),
        second: Functions::with_leaves(&second, split, degree, top),
    }
}
