//! Structured problems with their rows: the block matrix B of equations (18) and (19) written out, for checks that assemble nothing.

use faer::Mat;
use fleetfoot_sparse::{
    Quadratic,
    structured::{Assembly, Tikhonov},
};
use fleetfoot_stats::{Gram, Preconditioner, SquareRoot};
use fleetfoot_sums::structured::{Structure, TaskShape};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use super::gaussian;

/// Rows of every task: the columns of [`Structure::columns`], then the target.
#[derive(Debug, Clone)]
pub(crate) struct Tasks {
    pub(crate) structure: Structure,
    pub(crate) rows: Vec<Mat<f64>>,
    pub(crate) weights: Vec<f64>,
    pub(crate) assembly: Assembly,
}

/// One to three measured tasks, perhaps a prior, of up to four latents with up to three functions each; offsets, units over six decades, row weights.
pub(crate) fn random(seed: u64) -> Tasks {
    let mut rng = Pcg64::seed_from_u64(seed);
    let latents = rng.random_range(1..=4_usize);
    let measured = rng.random_range(1..=3_usize);
    let functions: Vec<usize> = (0..latents).map(|_| rng.random_range(1..=3)).collect();
    // Every latent is in a measured task; the last one may stand in a prior besides.
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); measured];
    for latent in 0..latents {
        members[latent % measured].push(latent);
        for (task, members) in members.iter_mut().enumerate() {
            if task != latent % measured && rng.random_bool(0.4) {
                members.push(latent);
            }
        }
    }
    members.retain(|members| !members.is_empty());
    let mut shapes: Vec<TaskShape> =
        members.into_iter().map(|latents| TaskShape { latents, centred: false, prior: false }).collect();
    if rng.random_bool(0.5) {
        shapes.push(TaskShape { latents: vec![latents - 1], centred: false, prior: true });
    }
    let n = rng.random_range(12..40_usize);
    let structure = Structure { functions, tasks: shapes };
    let p = structure.coefficients();
    let unit: Vec<f64> = (0..p).map(|_| 10.0_f64.powf(rng.random_range(-3.0..3.0))).collect();
    let phi = Mat::from_fn(n, p, |_, j| unit[j] * (1.0 + gaussian(&mut rng)));
    let mut tasks = Tasks { rows: Vec::new(), weights: Vec::new(), assembly: Assembly::default(), structure };
    for task in 0..tasks.structure.tasks.len() {
        let columns = tasks.structure.columns(task);
        let coefficients: Vec<f64> = (0..n * tasks.structure.functions.len()).map(|_| gaussian(&mut rng)).collect();
        let latent_of = tasks.structure.latent_of();
        let size = 10.0_f64.powf(rng.random_range(-2.0..2.0));
        let mut rows = Mat::from_fn(n, columns.len() + 1, |i, column| match columns.get(column) {
            Some(&j) => size * coefficients[latent_of[j] * n + i] * phi[(i, j)],
            None => size * gaussian(&mut rng),
        });
        // A constant in the task.
        if rng.random_bool(0.4) {
            tasks.structure.tasks[task].centred = true;
            (0..n).for_each(|i| rows[(i, 0)] = size * unit[columns[0]]);
        }
        (0..n).for_each(|i| rows[(i, columns.len())] += size);
        tasks.rows.push(rows);
        tasks.assembly.weights.push(rng.random_range(0.1..2.0) / (size * size));
    }
    tasks.weights = (0..n).map(|_| if rng.random_bool(0.1) { 0.0 } else { rng.random_range(0.2..3.0) }).collect();
    if rng.random_bool(0.5) {
        tasks.assembly.latents = (0..latents).map(|_| rng.random_range(0.2..3.0)).collect();
    }
    tasks
}

/// Fewer rows than coefficients, as it happens.
pub(crate) fn few(seed: u64) -> Tasks {
    let mut tasks = random(seed);
    let n = 1 + (seed % 5) as usize;
    tasks.rows.iter_mut().for_each(|rows| *rows = rows.as_ref().subrows(0, n).to_owned());
    tasks.weights = (0..n).map(|i| 1.0 + 0.5 * i as f64).collect();
    tasks
}

impl Tasks {
    pub(crate) fn p(&self) -> usize {
        self.structure.coefficients()
    }

    /// Sum of the row weights.
    pub(crate) fn n(&self) -> f64 {
        self.weights.iter().sum()
    }

    /// The square-root forms, by the way that a scan goes.
    pub(crate) fn roots(&self) -> Vec<SquareRoot> {
        let root = |rows: &Mat<f64>| {
            let preconditioner = Preconditioner::from_pilot(rows.as_ref(), rows.ncols() - 1);
            let mut z = rows.clone();
            preconditioner.apply(z.as_mut());
            preconditioner.square_root(&Gram::of_rows(z.as_ref(), Some(&self.weights)))
        };
        self.rows.iter().map(root).collect()
    }

    /// The scale of every coefficient's column, as [`fleetfoot_sparse::structured::Assembled::scale`] defines it, from the rows.
    pub(crate) fn scale(&self) -> Vec<f64> {
        let mut squares = vec![[0.0_f64; 2]; self.p()];
        for (task, rows) in self.rows.iter().enumerate() {
            let shape = &self.structure.tasks[task];
            for (column, &j) in self.structure.columns(task).iter().enumerate() {
                let mean = |value: &dyn Fn(f64) -> f64| {
                    let sum = self.weights.iter().enumerate().map(|(i, w)| w * value(rows[(i, column)]));
                    sum.sum::<f64>() / self.n()
                };
                let whole = mean(&|x| x * x);
                let average = mean(&|x| x);
                let about_mean = mean(&|x| (x - average) * (x - average));
                // The constant is measured as it is.
                let square = if shape.centred && about_mean > 1e-24 * whole { about_mean } else { whole };
                squares[j][usize::from(shape.prior)] += self.assembly.weights[task] * square;
            }
        }
        let scale = |&[measured, believed]: &[f64; 2]| match (measured > 0.0, believed > 0.0) {
            (true, _) => measured.sqrt(),
            (_, true) => believed.sqrt(),
            _ => 1.0,
        };
        squares.iter().map(scale).collect()
    }

    /// B and Y stacked over tasks and rows, each row times the root of its weight and its task's, the Tikhonov rows last; columns in raw units.
    pub(crate) fn stacked(&self) -> (Mat<f64>, Vec<f64>) {
        let (p, n) = (self.p(), self.weights.len());
        let none = Tikhonov { strength: 0.0, gamma: Mat::zeros(0, p), prior: vec![0.0; p] };
        let tikhonov = self.assembly.tikhonov.as_ref().unwrap_or(&none);
        let m = self.rows.len() * n;
        let mut b = Mat::zeros(m + tikhonov.gamma.nrows(), p);
        let mut y = vec![0.0; b.nrows()];
        for (task, rows) in self.rows.iter().enumerate() {
            let columns = self.structure.columns(task);
            for i in 0..n {
                let root = (self.weights[i] * self.assembly.weights[task]).sqrt();
                columns.iter().enumerate().for_each(|(k, &j)| b[(task * n + i, j)] = root * rows[(i, k)]);
                y[task * n + i] = root * rows[(i, columns.len())];
            }
        }
        let root = tikhonov.strength.sqrt();
        for i in 0..tikhonov.gamma.nrows() {
            for j in 0..p {
                b[(m + i, j)] = root * tikhonov.gamma[(i, j)];
                y[m + i] += root * tikhonov.gamma[(i, j)] * tikhonov.prior[j];
            }
        }
        (b, y)
    }

    /// The surrogate problem of rows b, y whose columns are divided by `scale`, with the objective's n.
    pub(crate) fn explicit(&self, b: &Mat<f64>, y: &[f64], scale: &[f64]) -> Quadratic {
        let m = b.nrows();
        // Weights that sum to n, and rows that make up for them.
        let weight = self.n() / m as f64;
        let root = weight.sqrt();
        let x = Mat::from_fn(m, b.ncols(), |i, j| b[(i, j)] / root / scale[j]);
        let y: Vec<f64> = y.iter().map(|y| y / root).collect();
        Quadratic::from_rows(x.as_ref(), &y, Some(&vec![weight; m]), false).expect("rows")
    }
}
