//! The reduced problem: residuals at the best coefficients, as a function of the nonlinear parameters.
//!
//! Symbols: phi (functions at all rows), D_j = d(phi)/d(theta_j), y; U spans phi, P = I - U U'.

use faer::Mat;
use fleetfoot_data::{Progress, Source};
use fleetfoot_stats::{kernel::norm, svd};

use super::LinearTarget;
use crate::{
    EstimateError, Parameter,
    evaluate::{Evaluation, LinearPart, Objective, Pass},
    reads::Reads,
    rows::{Layout, Rows, Scan, Unfolded, unfold},
    step::rank_level,
};

/// Expressions that are evaluated for every target: its functions, their slopes, itself.
pub(super) struct Layer {
    layout: Layout,
    bounds: Vec<[f64; 2]>,
    tasks: Vec<Task>,
}

struct Task {
    functions: usize,
    /// Of every slope, the function and the parameter.
    slopes: Vec<(usize, usize)>,
    weight: f64,
}

impl Layer {
    pub(super) fn new(
        targets: &[LinearTarget],
        parameters: &[Parameter],
        source: &dyn Source,
    ) -> Result<Self, EstimateError> {
        let names = parameters.iter().map(|parameter| parameter.name.clone()).collect();
        let mut layout = Layout { names, targets: Vec::new(), outputs: Vec::new(), presence: Vec::new() };
        let (mut tasks, mut reads) = (Vec::with_capacity(targets.len()), Reads::new(parameters, source));
        for target in targets {
            let (mut outputs, mut slopes) = (target.functions.clone(), Vec::new());
            for (i, function) in target.functions.iter().enumerate() {
                reads.add(&target.name, function)?;
                for (j, parameter) in parameters.iter().enumerate() {
                    let slope = function.sensitivity(&parameter.name);
                    if slope.as_number() != Some(0.0) {
                        outputs.push(slope);
                        slopes.push((i, j));
                    }
                }
            }
            reads.add(&target.name, &target.target)?;
            outputs.push(target.target.clone());
            layout.targets.push(target.target.clone());
            layout.outputs.push(outputs);
            tasks.push(Task { functions: target.functions.len(), slopes, weight: target.weight });
        }
        layout.presence = reads.presence()?;
        let bounds = parameters.iter().map(|parameter| parameter.bounds).collect();
        Ok(Self { layout, bounds, tasks })
    }
}

/// The reduced problem over the rows of a source.
pub(super) struct Projected<'a> {
    layer: &'a Layer,
    rows: Rows<'a>,
}

/// Residual of one target at its best coefficients, without weight.
struct Left {
    /// `-P D c` (m x q).
    jacobian: Mat<f64>,
    /// `P y` (m).
    rhs: Vec<f64>,
    beyond: f64,
    coefficients: Vec<f64>,
}

impl<'a> Projected<'a> {
    pub(super) fn new(layer: &'a Layer, source: &'a dyn Source, chunk_rows: usize, progress: &'a dyn Progress) -> Self {
        Self { layer, rows: Rows::new(&layer.layout, source, chunk_rows, progress) }
    }
}

impl Objective for Projected<'_> {
    fn bounds(&self) -> &[[f64; 2]] {
        &self.layer.bounds
    }

    fn residuals(&self) -> usize {
        self.layer.tasks.len()
    }

    fn unknowns(&self) -> usize {
        self.layer.bounds.len() + self.layer.tasks.iter().map(|task| task.functions).sum::<usize>()
    }

    fn evaluate(&self, theta: &[f64]) -> Result<Pass, EstimateError> {
        let sums = match self.rows.scan(theta, |_| ())? {
            Scan::Complete(sums) => sums,
            Scan::Refused(error) => return Ok(Pass::Refused(error)),
        };
        let q = self.layer.bounds.len();
        let (mut rhs, mut columns, mut linear) = (Vec::new(), vec![Vec::new(); q], Vec::new());
        let (mut cost, mut targets) = (0.0, 0.0);
        for ((task, factor), size) in self.layer.tasks.iter().zip(&sums.factors).zip(&sums.targets) {
            let left = task.project(&unfold(factor), q)?;
            let root = task.weight.sqrt();
            let rss = left.rhs.iter().map(|r| r * r).sum::<f64>() + left.beyond;
            rhs.extend(left.rhs.iter().map(|r| root * r));
            for (j, column) in columns.iter_mut().enumerate() {
                column.extend(left.jacobian.col_as_slice(j).iter().map(|slope| root * slope));
            }
            cost += task.weight * rss;
            targets += task.weight * size;
            linear.push(LinearPart { coefficients: left.coefficients, rss });
        }
        let jacobian = Mat::from_fn(rhs.len(), q, |i, j| columns[j][i]);
        let rows = sums.rows;
        Ok(Pass::Finite(Evaluation {
            jacobian,
            rhs,
            cost,
            targets,
            rows,
            scores: Vec::new(),
            linear,
            shares: Vec::new(),
            ended: 0,
        }))
    }
}

impl Task {
    /// Solves for the coefficients, of least norm in units of the functions' lengths. Takes the part that the functions
    /// explain out of the target and the slopes.
    fn project(&self, rows: &Unfolded, q: usize) -> Result<Left, EstimateError> {
        let (m, p) = (rows.rhs.len(), self.functions);
        let length = |j: usize| norm(rows.columns.col_as_slice(j).iter().copied());
        let lengths: Vec<f64> = (0..p).map(length).map(|length| if length > 0.0 { length } else { 1.0 }).collect();
        let scaled = Mat::from_fn(m, p, |i, j| rows.columns[(i, j)] / lengths[j]);
        let factors = svd(scaled.as_ref()).ok_or(EstimateError::Overflow)?;
        let least = factors.s.first().map_or(0.0, |largest| largest * rank_level(p));
        let rank = factors.s.iter().filter(|&&s| s > least).count();
        // Twice is enough for orthogonality up to rounding (Kahan and Parlett).
        let off = |values: &mut [f64]| {
            let mut along = vec![0.0; rank];
            for _ in 0..2 {
                for (i, sum) in along.iter_mut().enumerate() {
                    let u = factors.u.col_as_slice(i);
                    let part: f64 = u.iter().zip(&*values).map(|(u, value)| u * value).sum();
                    values.iter_mut().zip(u).for_each(|(value, u)| *value -= part * u);
                    *sum += part;
                }
            }
            along
        };
        let mut rhs = rows.rhs.clone();
        let along = off(&mut rhs);
        let coefficient =
            |j: usize| (0..rank).map(|i| factors.v[(j, i)] * along[i] / factors.s[i]).sum::<f64>() / lengths[j];
        let coefficients: Vec<f64> = (0..p).map(coefficient).collect();
        let mut jacobian = Mat::zeros(m, q);
        for (k, &(i, j)) in self.slopes.iter().enumerate() {
            let slope = rows.columns.col_as_slice(p + k);
            let into = jacobian.col_as_slice_mut(j);
            into.iter_mut().zip(slope).for_each(|(value, slope)| *value -= coefficients[i] * slope);
        }
        (0..q).for_each(|j| _ = off(jacobian.col_as_slice_mut(j)));
        Ok(Left { jacobian, rhs, beyond: rows.beyond, coefficients })
    }
}
