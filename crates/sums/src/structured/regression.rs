//! Structured regression: latents as libraries, tasks as sums of coefficients times latents.

use fleetfoot_library::Expr;

use super::{Structure, TaskShape};

/// A latent function to be found, `f(x) = sum_j theta_j phi_j(x)`: its candidate functions phi (p_k). A constant is the function 1 among them.
#[derive(Debug, Clone, PartialEq)]
pub struct Candidates {
    /// The latent's name.
    pub name: String,
    /// Candidate functions over the columns of the rows.
    pub functions: Vec<Expr>,
}

/// A latent in a task: `coefficient(x) f(x)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Term {
    /// Index of the latent.
    pub latent: usize,
    /// Factor of the latent: `cos(alpha)`, `-1`.
    pub coefficient: Expr,
}

/// One equation of the regression, `target = sum of terms + error` (equation (15)).
#[derive(Debug, Clone, PartialEq)]
pub struct Task {
    /// Its name.
    pub name: String,
    /// The left side, measured.
    pub target: Expr,
    /// Terms, each of another latent.
    pub terms: Vec<Term>,
    /// True for a prior of a latent, which is believed and not measured (equation (41)). It counts with the strength of
    /// the Tikhonov penalty, and has no part in scales and scores.
    pub prior: bool,
}

/// A structured regression over the columns of a source: equation (15), any number of shared latents.
#[derive(Debug, Clone, PartialEq)]
pub struct Regression {
    /// The latent functions; their candidates in order are the p columns of the coefficients theta.
    pub latents: Vec<Candidates>,
    /// The tasks.
    pub tasks: Vec<Task>,
    /// Non-negative row weights.
    pub weight: Option<Expr>,
}

impl Regression {
    /// Expressions of a row in the regression: candidate functions, coefficients, targets.
    pub fn expressions(&self) -> impl Iterator<Item = &Expr> {
        let functions = self.latents.iter().flat_map(|latent| &latent.functions);
        let of_tasks =
            self.tasks.iter().flat_map(|task| task.terms.iter().map(|term| &term.coefficient).chain([&task.target]));
        functions.chain(of_tasks)
    }

    /// The shape, without the functions.
    pub fn structure(&self) -> Structure {
        let one = |expr: &Expr| expr.as_number() == Some(1.0);
        let constant = |term: &Term| one(&term.coefficient) && self.latents[term.latent].functions.iter().any(one);
        Structure {
            functions: self.latents.iter().map(|latent| latent.functions.len()).collect(),
            tasks: self
                .tasks
                .iter()
                .map(|task| TaskShape {
                    latents: task.terms.iter().map(|term| term.latent).collect(),
                    centred: task.terms.iter().any(constant),
                    prior: task.prior,
                })
                .collect(),
        }
    }

    /// The columns of a task: every term's coefficient times the functions of its latent, then the target.
    pub fn columns(&self, task: usize) -> Vec<Expr> {
        let task = &self.tasks[task];
        let product = |term: &Term, function: &Expr| (&term.coefficient * function).simplified();
        let terms = task
            .terms
            .iter()
            .flat_map(|term| self.latents[term.latent].functions.iter().map(move |function| product(term, function)));
        terms.chain([task.target.clone()]).collect()
    }

    /// Index of the first coefficient of a latent.
    pub fn first(&self, latent: usize) -> usize {
        self.latents[..latent].iter().map(|latent| latent.functions.len()).sum()
    }

    /// Number of coefficients, p.
    pub fn coefficients(&self) -> usize {
        self.first(self.latents.len())
    }
}
