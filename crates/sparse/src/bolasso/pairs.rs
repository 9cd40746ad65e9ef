//! Products of columns that the Grams of all replicates consist of: the columns of E.
//!
//! The sum of squares over tasks, `sum_t s_t (y_t - sum_k c_tk phi_k'theta_k)^2`, needs only `a_kl phi_k phi_l'` for
//! two latents k and l. `a_kl = sum_t s_t c_tk c_tl` is one coefficient a row, however many tasks they share. If two
//! latents have the same library and the same coefficient up to a number, one block serves both. The target is one more
//! latent, whose library is the function 1 and whose coefficients are the y_t.

use fleetfoot_data::{packed, packed_row};
use fleetfoot_library::Expr;

use crate::structured::Assembly;
use fleetfoot_sums::structured::Regression;

/// Products of the functions of two libraries and a coefficient.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Block {
    /// Libraries; where they are the same, only the lower triangle is formed.
    pub(crate) libraries: [usize; 2],
    /// Index of the coefficient.
    pub(crate) coefficient: usize,
    /// First column of E.
    pub(crate) first: usize,
    /// Latents (rows and columns of the Gram matrix) that it serves, with the factor.
    pub(crate) places: Vec<([usize; 2], f64)>,
}

/// All blocks of a regression.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Pairs {
    /// Functions of every distinct library, the function 1 of the target last.
    pub(crate) libraries: Vec<Vec<Expr>>,
    /// The library of every latent, the target last.
    pub(crate) library_of: Vec<usize>,
    /// Distinct coefficients; the first is 1.
    pub(crate) coefficients: Vec<Expr>,
    /// The blocks; the first is the sum of the weights and has no place.
    pub(crate) blocks: Vec<Block>,
    /// Columns of E.
    pub(crate) columns: usize,
}

impl Pairs {
    /// The pairs of a regression with task weights s_t; targets are divided by `size`.
    pub(crate) fn new(regression: &Regression, assembly: &Assembly, size: f64) -> Self {
        let mut libraries: Vec<Vec<Expr>> = Vec::new();
        let mut library_of = Vec::new();
        let one = vec![Expr::number(1.0)];
        for functions in regression.latents.iter().map(|latent| &latent.functions) {
            let index = libraries.iter().position(|library| library == functions);
            library_of.push(index.unwrap_or(libraries.len()));
            if index.is_none() {
                libraries.push(functions.clone());
            }
        }
        library_of.push(libraries.len());
        libraries.push(one);
        let mut pairs = Self { libraries, library_of, coefficients: Vec::new(), blocks: Vec::new(), columns: 0 };
        let target = regression.latents.len();
        let unit = pairs.library_of[target];
        pairs.add([unit, unit], Expr::number(1.0), None);
        for k in 0..=target {
            for l in k..=target {
                if let Some((factor, expression)) = coefficient(regression, assembly, [k, l], size) {
                    let libraries = [pairs.library_of[k], pairs.library_of[l]];
                    pairs.add(libraries, expression, Some(([k, l], factor)));
                }
            }
        }
        pairs
    }

    fn add(&mut self, libraries: [usize; 2], coefficient: Expr, place: Option<([usize; 2], f64)>) {
        let known = self.coefficients.iter().position(|expr| *expr == coefficient);
        let index = known.unwrap_or(self.coefficients.len());
        if known.is_none() {
            self.coefficients.push(coefficient);
        }
        let same = |block: &&mut Block| block.libraries == libraries && block.coefficient == index;
        match self.blocks.iter_mut().find(same) {
            Some(block) => block.places.extend(place),
            None => {
                let first = self.columns;
                let [a, b] = libraries.map(|library| self.libraries[library].len());
                self.columns += if libraries[0] == libraries[1] { packed_row(a) } else { a * b };
                let places = place.into_iter().collect();
                self.blocks.push(Block { libraries, coefficient: index, first, places });
            }
        }
    }

    /// Column of E of entry (i, j) of a block: function i of its first library and j of its second.
    pub(crate) fn column(&self, block: &Block, i: usize, j: usize) -> usize {
        if block.libraries[0] == block.libraries[1] {
            block.first + packed(i, j)
        } else {
            block.first + i * self.libraries[block.libraries[1]].len() + j
        }
    }
}

/// `sum_t s_t c_tk c_tl` as a number times an expression; `None` where no task of positive weight has both.
fn coefficient(regression: &Regression, assembly: &Assembly, [k, l]: [usize; 2], size: f64) -> Option<(f64, Expr)> {
    let target = regression.latents.len();
    let mut products: Vec<(f64, Expr)> = Vec::new();
    for (task, &weight) in regression.tasks.iter().zip(&assembly.weights) {
        let of = |latent: usize| {
            if latent == target {
                return Some(task.target.clone());
            }
            task.terms.iter().find(|term| term.latent == latent).map(|term| term.coefficient.clone())
        };
        let (Some(a), Some(b)) = (of(k), of(l)) else { continue };
        let divisor = [k, l].iter().filter(|&&latent| latent == target).map(|_| size).product::<f64>();
        let (factor, product) = number_times(&(&a * &b).simplified());
        let factor = weight / divisor * factor;
        if factor == 0.0 {
            continue;
        }
        match products.iter_mut().find(|(_, known)| *known == product) {
            Some((sum, _)) => *sum += factor,
            None => products.push((factor, product)),
        }
    }
    if products.len() <= 1 {
        return products.pop();
    }
    let sum = products.into_iter().map(|(factor, product)| &Expr::number(factor) * &product).reduce(|a, b| &a + &b);
    sum.map(|sum| (1.0, sum))
}

/// The number in front of an expression, and the rest.
fn number_times(expr: &Expr) -> (f64, Expr) {
    use fleetfoot_library::{Binary, Node, Unary};
    match expr.node() {
        Node::Number(value) if value.is_finite() => (*value, Expr::number(1.0)),
        Node::Unary(Unary::Neg, x) => {
            let (factor, rest) = number_times(x);
            (-factor, rest)
        }
        Node::Binary(Binary::Mul, a, b) => match (a.as_number(), b.as_number()) {
            (Some(value), _) if value.is_finite() => (value, b.clone()),
            (_, Some(value)) if value.is_finite() => (value, a.clone()),
            _ => (1.0, expr.clone()),
        },
        _ => (1.0, expr.clone()),
    }
}
