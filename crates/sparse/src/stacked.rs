//! The problems of several targets as one: for penalties that join a column's coefficients across targets.

use crate::{
    Quadratic, SparseError,
    kernel::{LANES, Slab, norm, padded},
    quadratic::Form,
};

impl Quadratic {
    /// The problem `1/(2n) sum_t rss_t` in the coefficients of all targets, those of the first target first (q p columns): n is the rows of one target, and has
    /// to be the same for all. Columns are in their units of each problem; [`Solution::intercept`](crate::Solution) is 0, and the intercept of a target is
    /// [`Quadratic::intercept_of`] of its own problem.
    ///
    /// # Errors
    /// When there is no problem, or they have other numbers of columns or rows.
    pub fn stacked(problems: &[Self]) -> Result<Self, SparseError> {
        let first = problems.first().ok_or(SparseError::NoRows)?;
        let p = first.columns();
        for other in problems {
            let columns = other.columns();
            if columns != p {
                return Err(SparseError::OtherProblem { actual: columns, expected: p });
            }
            if other.weight != first.weight {
                return Err(SparseError::OtherRows { actual: other.weight, expected: first.weight });
            }
        }
        let size = norm(problems.iter().map(|problem| problem.size));
        // Share of the target's length that is in each problem's.
        let share: Vec<f64> = problems.iter().map(|one| if size > 0.0 { one.size / size } else { 0.0 }).collect();
        let roots = problems.iter().all(|problem| matches!(problem.form, Form::Root { .. }));
        let form = if roots { stacked_rows(problems, &share) } else { stacked_products(problems, &share) };
        Ok(Self {
            weight: first.weight,
            length: problems.iter().flat_map(|problem| problem.length.iter().copied()).collect(),
            size,
            means: None,
            noise: problems.iter().flat_map(|problem| problem.noise.iter().copied()).collect(),
            form,
        })
    }

    /// The intercept that goes with coefficients (p, raw units); 0 without one.
    pub fn intercept_of(&self, coefficients: &[f64]) -> f64 {
        self.intercept(coefficients.iter().copied().enumerate())
    }
}

fn stacked_rows(problems: &[Quadratic], share: &[f64]) -> Form {
    let (p, q) = (problems[0].columns(), problems.len());
    let parts: Vec<(&Slab, &[f64], f64)> = problems
        .iter()
        .filter_map(|problem| match &problem.form {
            Form::Root { a, z, beyond } => Some((a, z.as_slice(), *beyond)),
            Form::Gram { .. } => None,
        })
        .collect();
    let rows: usize = parts.iter().map(|(a, ..)| a.rows()).sum();
    let mut all = Slab::zeros(rows, p * q);
    let mut target = vec![0.0; all.stride()];
    let (mut start, mut left) = (0, 0.0);
    for (t, (a, z, beyond)) in parts.into_iter().enumerate() {
        let m = a.rows();
        for j in 0..p {
            all.column_mut(t * p + j)[start..start + m].copy_from_slice(&a.column(j)[..m]);
        }
        target[start..start + m].iter_mut().zip(z).for_each(|(target, z)| *target = share[t] * z);
        left += share[t] * share[t] * beyond;
        start += m;
    }
    Form::Root { a: all, z: target, beyond: left }
}

fn stacked_products(problems: &[Quadratic], share: &[f64]) -> Form {
    let (p, q) = (problems[0].columns(), problems.len());
    let mut g = Slab::zeros(p * q, p * q);
    let mut c = vec![0.0; padded(p * q).max(LANES)];
    for (t, problem) in problems.iter().enumerate() {
        let mut column = vec![0.0; padded(p).max(LANES)];
        for j in 0..p {
            problem.correlations_of(j, &mut column);
            g.column_mut(t * p + j)[t * p..(t + 1) * p].copy_from_slice(&column[..p]);
        }
        let correlations = problem.target_correlations();
        c[t * p..(t + 1) * p].iter_mut().zip(&correlations).for_each(|(c, product)| *c = share[t] * product);
    }
    Form::Gram { g, c }
}
