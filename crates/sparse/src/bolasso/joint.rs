//! All tasks of a statistic as one: moments of the rows of the block matrix B and its target, member by member, in coordinates where their total is the
//! identity, so that a resample is a sum of columns and one small Cholesky factor.
//!
//! With `[R z; 0 r]` the triangle of a QR of the whole statistic's [B y], the moments that are held are those of `x~ = [B y] [R z; 0 r]^-1`. A resample's
//! `x~'x~` is well conditioned as far as it resembles the whole, and `chol(x~'x~) [R z; 0 r]` is its square-root form: what the preconditioner of a scan
//! does for rows, done again for members.

use faer::{Accum, Mat, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_data::{Progress, packed_row, parallel_map};
use fleetfoot_stats::{Bank, Gram, Key, Preconditioner, SquareRoot, blocks};

use super::{
    BolassoError, BootstrapUnit,
    resample::{Frame, Sums, divide_right, scale, spread, triangle_of},
};
use crate::{
    kernel::Slab,
    structured::{Assembly, assemble, penalty, scales},
};
use fleetfoot_sums::structured::{Banks, Structure};

/// Columns of weights that are multiplied at once.
const BATCH: usize = 64;

/// The moments of all units of a statistic.
pub(crate) struct Joint<'a> {
    pub(crate) frame: Frame<'a>,
    layout: Layout,
    /// Moments of every unit, one a column.
    moments: Mat<f64>,
    raw: bool,
}

/// Layout of the moments of a unit. It holds the weight, the products of x~, and the sums of squares of B's columns
/// over measured tasks and over priors. For tasks whose scales are deviations, the sums of their columns follow.
#[derive(Debug, Clone)]
struct Layout {
    p: usize,
    /// The tasks with a constant.
    centred: Vec<Centred>,
    length: usize,
}

/// A task whose columns count by their deviations.
#[derive(Debug, Clone)]
struct Centred {
    task: usize,
    prior: bool,
    /// Its weight s_t.
    factor: f64,
    /// Columns of B that are its columns.
    columns: Vec<usize>,
    /// Centres subtracted from them, in units: their means over the whole statistic.
    centre: Vec<f64>,
    /// Index of their first sum; their sums of squares follow.
    first: usize,
}

impl Layout {
    fn new(structure: &Structure, total: &[SquareRoot], weights: &[f64], unit: &[f64]) -> Self {
        let p = structure.coefficients();
        let mut layout = Self { p, centred: Vec::new(), length: 1 + packed_row(p + 1) + 2 * p };
        for (task, shape) in structure.tasks.iter().enumerate() {
            if shape.centred {
                let (columns, first) = (structure.columns(task), layout.length);
                layout.length += 2 * columns.len();
                let centre = columns.iter().zip(&total[task].mean_x).map(|(&j, mean)| mean / unit[j]).collect();
                layout.centred.push(Centred {
                    task,
                    prior: shape.prior,
                    factor: weights[task],
                    columns,
                    centre,
                    first,
                });
            }
        }
        layout
    }

    fn products(&self) -> std::ops::Range<usize> {
        1..1 + packed_row(self.p + 1)
    }

    /// First of the sums of squares over measured tasks, or over priors.
    fn squares(&self, prior: bool) -> usize {
        1 + packed_row(self.p + 1) + if prior { self.p } else { 0 }
    }

    fn scales(&self, sums: &[f64], unit: &[f64]) -> Vec<f64> {
        let weight = sums[0];
        let mut squares: Vec<f64> =
            sums[self.squares(false)..self.squares(true) + self.p].iter().map(|sum| sum / weight).collect();
        for task in &self.centred {
            let first = if task.prior { self.p } else { 0 };
            let (values, products) = sums[task.first..].split_at(task.columns.len());
            for (c, &j) in task.columns.iter().enumerate() {
                squares[first + j] += task.factor * spread(products[c], values[c], weight, task.centre[c]);
            }
        }
        (0..self.p).map(|j| scale(squares[j], squares[self.p + j]).map_or(1.0, |scale| scale * unit[j])).collect()
    }
}

/// A task, ready to be added to a unit.
struct TaskMap<'a> {
    bank: &'a Bank,
    /// Its weight s_t.
    factor: f64,
    prior: bool,
    columns: Vec<usize>,
    /// Preconditioned columns to x~ (d x (p + 1)), and x~ of their centre.
    map: Mat<f64>,
    centre: Vec<f64>,
    /// Map from preconditioned columns to the task's regressors in units (d x (d - 1)), and their centre less the one
    /// that the sums subtract.
    regressors: Mat<f64>,
    offset: Vec<f64>,
    /// Index of its sums, if its scales are deviations.
    sums: Option<usize>,
}

impl<'a> Joint<'a> {
    /// The moments of the members of `banks`, summed over episodes where these are the units.
    pub(crate) fn new(
        structure: &Structure,
        banks: &Banks,
        assembly: &'a Assembly,
        unit: BootstrapUnit,
        progress: &dyn Progress,
    ) -> Result<Self, BolassoError> {
        let penalty = penalty(structure, assembly)?;
        let total = banks.total();
        // Errors of the statistic show here, once.
        assemble(structure, &total, assembly)?;
        let units = units(banks.keys(), banks.rows(), unit);
        let scales = scales(structure, &total, &assembly.weights);
        let (triangle, size) = triangle(structure, &total, &assembly.weights, &scales);
        let layout = Layout::new(structure, &total, &assembly.weights, &scales);
        let tasks: Vec<TaskMap<'_>> = banks
            .tasks()
            .iter()
            .enumerate()
            .map(|(task, part)| {
                let centred = layout.centred.iter().find(|centred| centred.task == task);
                task_map(structure, task, part, (&triangle, &scales, size), assembly.weights[task], centred)
            })
            .collect();
        let columns = parallel_map(units.len(), progress, |u| {
            let mut column = vec![0.0; layout.length];
            let mut work = Work::new();
            units[u].iter().for_each(|&member| add_member(&layout, &tasks, member, &mut column, &mut work));
            Ok::<_, BolassoError>(column)
        })?;
        let mut moments = Mat::zeros(layout.length, units.len());
        columns.iter().enumerate().for_each(|(u, column)| moments.col_as_slice_mut(u).copy_from_slice(column));
        let frame = Frame::new(triangle, scales, size, assembly, penalty);
        Ok(Self { frame, layout, moments, raw: assembly.raw })
    }

    /// Number of units.
    pub(crate) fn units(&self) -> usize {
        self.moments.ncols()
    }

    /// For `count` resamples, with the weights of the units that `weights` gives, what `work` makes of their sums: in order, in parallel.
    pub(crate) fn resample<R: Send>(
        &self,
        count: usize,
        progress: &dyn Progress,
        weights: impl Fn(usize) -> Vec<f64> + Sync,
        work: impl Fn(&Sums<'_>) -> Result<R, BolassoError> + Sync,
    ) -> Result<Vec<Option<R>>, BolassoError> {
        let batches = parallel_map(count.div_ceil(BATCH), progress, |batch| {
            let resamples = batch * BATCH..((batch + 1) * BATCH).min(count);
            // Always as many columns: the kernel that a column meets, and so its bits, do not depend on their number.
            let mut w = Mat::zeros(self.units(), BATCH);
            for (column, resample) in resamples.clone().enumerate() {
                w.col_as_slice_mut(column).copy_from_slice(&weights(resample));
            }
            let mut sums = Mat::zeros(self.layout.length, BATCH);
            matmul(sums.as_mut(), Accum::Replace, self.moments.as_ref(), w.as_ref(), 1.0, Par::Seq);
            (0..resamples.len())
                .map(|column| self.sums(sums.col_as_slice(column)).map(|sums| work(&sums)).transpose())
                .collect()
        });
        let batches: Vec<Vec<Option<R>>> = batches?;
        Ok(batches.into_iter().flatten().collect())
    }

    /// `None` when the resample has no rows.
    fn sums<'s>(&self, sums: &'s [f64]) -> Option<Sums<'s>> {
        let unit = &self.frame.unit;
        let scale = || if self.raw { vec![1.0; unit.len()] } else { self.layout.scales(sums, unit) };
        (sums[0] > 0.0).then(|| Sums { weight: sums[0], products: &sums[self.layout.products()], scale: scale() })
    }
}

/// The members of every unit, in the order of the keys; short chunks are joined ([`blocks`]).
pub(crate) fn units(keys: &[Key], rows: &[u64], unit: BootstrapUnit) -> Vec<Vec<usize>> {
    let blocks = blocks(keys.iter().map(|key| key.episode).zip(rows.iter().copied()));
    let mut units: Vec<Vec<usize>> = Vec::new();
    for (member, key) in keys.iter().enumerate() {
        let same = |other: usize| match unit {
            BootstrapUnit::Chunk => blocks[other] == blocks[member],
            BootstrapUnit::Episode => keys[other].episode == key.episode,
        };
        match units.last_mut() {
            Some(members) if members.last().is_some_and(|&other| same(other)) => members.push(member),
            _ => units.push(vec![member]),
        }
    }
    units
}

/// The triangle of the rows of [B / unit, y / size] that stand for the whole statistic, and the size of the target.
fn triangle(structure: &Structure, roots: &[SquareRoot], weights: &[f64], unit: &[f64]) -> (Mat<f64>, f64) {
    let p = structure.coefficients();
    let n = roots.iter().map(|root| root.weight).fold(0.0, f64::max);
    let square = |(root, factor): (&SquareRoot, &f64)| factor * (root.total[0] + root.weight * root.mean_y[0].powi(2));
    let size = (roots.iter().zip(weights).map(square).sum::<f64>() / n).sqrt();
    let size = if size > 0.0 && size.is_finite() { size } else { 1.0 };
    let mut rows: Vec<Vec<f64>> = Vec::new();
    let mut beyond = 0.0;
    for (task, root) in roots.iter().enumerate() {
        let columns = structure.columns(task);
        let factor = weights[task].sqrt();
        let mut mean = vec![0.0; p + 1];
        let weight = factor * root.weight.sqrt();
        columns.iter().zip(&root.mean_x).for_each(|(&j, value)| mean[j] = weight * value / unit[j]);
        mean[p] = weight * root.mean_y[0] / size;
        rows.push(mean);
        for i in 0..columns.len() {
            let mut row = vec![0.0; p + 1];
            (i..columns.len()).for_each(|c| row[columns[c]] = factor * root.r[(i, c)] / unit[columns[c]]);
            row[p] = factor * root.z[(i, 0)] / size;
            rows.push(row);
        }
        beyond += weights[task] * root.residual[0].max(0.0);
    }
    let mut last = vec![0.0; p + 1];
    last[p] = beyond.sqrt() / size;
    rows.push(last);
    (triangle_of(Slab::from_fn(rows.len(), p + 1, |i, j| rows[i][j]), n), size)
}

fn task_map<'a>(
    structure: &Structure,
    task: usize,
    (preconditioner, bank): &'a (Preconditioner, Bank),
    (triangle, unit, size): (&Mat<f64>, &[f64], f64),
    factor: f64,
    centred: Option<&Centred>,
) -> TaskMap<'a> {
    let p = unit.len();
    let columns = structure.columns(task);
    let (centre, raw) = preconditioner.raw_map();
    let d = centre.len();
    // Rows 0..d are the map, row d is the centre.
    let mut joint = vec![vec![0.0; d + 1]; p + 1];
    let in_units = |c: usize| if c + 1 < d { (columns[c], unit[columns[c]]) } else { (p, size) };
    for c in 0..d {
        let (j, unit) = in_units(c);
        (0..d).for_each(|k| joint[j][k] = raw[(k, c)] / unit);
        joint[j][d] = centre[c] / unit;
    }
    divide_right(&mut joint, triangle);
    let offset = |c: usize| centre[c] / unit[columns[c]] - centred.map_or(0.0, |centred| centred.centre[c]);
    TaskMap {
        bank,
        factor,
        prior: structure.tasks[task].prior,
        map: Mat::from_fn(d, p + 1, |k, j| joint[j][k]),
        centre: joint.iter().map(|column| column[d]).collect(),
        regressors: Mat::from_fn(d, d - 1, |k, c| raw[(k, c)] / unit[columns[c]]),
        offset: (0..d - 1).map(offset).collect(),
        columns,
        sums: centred.map(|centred| centred.first),
    }
}

/// Matrices that are used again.
struct Work {
    scatter: Mat<f64>,
    half: Mat<f64>,
    whole: Mat<f64>,
}

impl Work {
    fn new() -> Self {
        Self { scatter: Mat::new(), half: Mat::new(), whole: Mat::new() }
    }

    fn product(target: &mut Mat<f64>, lhs: MatRef<'_, f64>, rhs: MatRef<'_, f64>) {
        target.resize_with(lhs.nrows(), rhs.ncols(), |_, _| 0.0);
        matmul(target.as_mut(), Accum::Replace, lhs, rhs, 1.0, Par::Seq);
    }
}

fn add_member(layout: &Layout, tasks: &[TaskMap<'_>], member: usize, sums: &mut [f64], work: &mut Work) {
    let mut weight = 0.0_f64;
    for task in tasks {
        let gram = task.bank.member(member);
        weight = weight.max(gram.weight);
        if gram.weight > 0.0 {
            let d = gram.dimension();
            work.scatter.resize_with(d, d, |_, _| 0.0);
            for i in 0..d {
                for j in 0..=i {
                    let value = gram.scatter[packed_row(i) + j];
                    (work.scatter[(i, j)], work.scatter[(j, i)]) = (value, value);
                }
            }
            if task.factor > 0.0 {
                add_products(&mut sums[layout.products()], task, &gram, work);
            }
            add_squares(layout, sums, task, &gram, work);
        }
    }
    sums[0] += weight;
}

/// `s_t (K'S K + w m m')`: scatter about the mean and the mean itself, both in the coordinates x~.
fn add_products(products: &mut [f64], task: &TaskMap<'_>, gram: &Gram, work: &mut Work) {
    let width = task.centre.len();
    Work::product(&mut work.half, work.scatter.as_ref(), task.map.as_ref());
    Work::product(&mut work.whole, task.map.as_ref().transpose(), work.half.as_ref());
    let mean: Vec<f64> = (0..width).map(|j| task.centre[j] + inner(&gram.mean, task.map.col_as_slice(j))).collect();
    for i in 0..width {
        let factor = gram.weight * mean[i];
        for j in 0..=i {
            products[packed_row(i) + j] += task.factor * (work.whole[(j, i)] + factor * mean[j]);
        }
    }
}

fn add_squares(layout: &Layout, sums: &mut [f64], task: &TaskMap<'_>, gram: &Gram, work: &mut Work) {
    Work::product(&mut work.half, work.scatter.as_ref(), task.regressors.as_ref());
    let first = layout.squares(task.prior);
    for (c, &j) in task.columns.iter().enumerate() {
        let map = task.regressors.col_as_slice(c);
        let mean = task.offset[c] + inner(&gram.mean, map);
        let square = inner(map, work.half.col_as_slice(c)).max(0.0);
        let square = square + gram.weight * mean * mean;
        match task.sums {
            Some(at) => {
                sums[at + c] += gram.weight * mean;
                sums[at + task.columns.len() + c] += square;
            }
            None => sums[first + j] += task.factor * square,
        }
    }
}

fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
