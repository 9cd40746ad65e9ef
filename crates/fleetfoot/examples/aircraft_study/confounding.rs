//! True functions that were not selected: what the selected ones leave of them.

use faer::{Mat, linalg::solvers::SolveLstsq};
use fleetfoot::stats::SquareRoot;

use super::{Failure, selection::Scan};

/// Length of what is left of column `j` of the coefficients when the selected functions of its latent have taken their part, relative to its own length
/// (root mean squares over all rows of a task that has the latent): 0 when they rebuild it.
pub(crate) fn remainder(scan: &Scan, support: &[usize], j: usize) -> Result<f64, Failure> {
    let structure = scan.plan.regression.structure();
    let latent = structure.latent_of()[j];
    let shape = |task: &usize| !structure.tasks[*task].prior && structure.tasks[*task].latents.contains(&latent);
    let task = (0..structure.tasks.len()).find(shape).ok_or("a latent without a task")?;
    let (root, columns) = (&scan.roots[task], structure.columns(task));
    let place = |coefficient: usize| columns.iter().position(|&column| column == coefficient).ok_or("no such column");
    let others: Vec<usize> = support.iter().copied().filter(|i| structure.range(latent).contains(i)).collect();
    let others = others.into_iter().map(place).collect::<Result<Vec<_>, _>>()?;
    let y = column(root, place(j)?);
    if others.is_empty() {
        return Ok(1.0);
    }
    // At unit length: the columns' units are decades apart.
    let x: Vec<Vec<f64>> = others.iter().map(|&other| unit(column(root, other))).collect();
    let y = unit(y);
    let x = Mat::from_fn(y.len(), x.len(), |i, k| x[k][i]);
    let y = Mat::from_fn(y.len(), 1, |i, _| y[i]);
    let left = &y - &x * x.col_piv_qr().solve_lstsq(&y);
    Ok(left.norm_l2())
}

/// A column of compressed rows, the one that centring took away first.
fn column(root: &SquareRoot, at: usize) -> Vec<f64> {
    let mean = root.weight.sqrt() * root.mean_x[at];
    std::iter::once(mean).chain(root.r.col_as_slice(at).iter().copied()).collect()
}

fn unit(values: Vec<f64>) -> Vec<f64> {
    let length = values.iter().map(|value| value * value).sum::<f64>().sqrt();
    values.into_iter().map(|value| value / length.max(f64::MIN_POSITIVE)).collect()
}
