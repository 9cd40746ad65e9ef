//! One pass over the rows: residuals and Jacobian at given parameters, as triangular factors.

use std::ops::Range;

use faer::{Mat, MatRef};
use fleetfoot_data::{Block, Progress, Source};
use fleetfoot_library::{Design, DesignRows, Expr};
use fleetfoot_stats::{Chunk, Factor, Grid, reduce};

use crate::{EstimateError, problem::Problem};

/// The problem over the rows of a source.
pub(crate) struct Rows<'a> {
    pub(crate) problem: &'a Problem,
    source: &'a dyn Source,
    columns: Vec<&'a str>,
    chunks: Vec<Chunk>,
    /// Targets and what the residuals read: the rows at which these are finite are the rows of the problem, whatever the parameters.
    data: Design,
    progress: &'a dyn Progress,
}

/// Residuals and Jacobian of all rows, compressed: `|r + J s|^2 = |rhs + jacobian s|^2 + beyond` for every step s.
#[derive(Debug, Clone)]
pub(crate) struct Evaluation {
    /// (m x p).
    pub(crate) jacobian: Mat<f64>,
    pub(crate) rhs: Vec<f64>,
    /// `|r|^2`.
    pub(crate) cost: f64,
    /// `sum (sqrt(weight) target)^2`.
    pub(crate) targets: f64,
    /// Complete rows.
    pub(crate) rows: u64,
    /// J'r of every chunk (p each).
    pub(crate) scores: Vec<Vec<f64>>,
}

/// What a pass finds.
pub(crate) enum Pass {
    Finite(Evaluation),
    /// The first row at which a residual or a derivative is not finite: episode and row.
    NotFinite(String, usize),
}

/// The factors of one chunk.
struct Part {
    factors: Vec<Factor>,
    targets: f64,
    rows: u64,
    broken: Option<usize>,
    data: DesignRows,
    values: DesignRows,
    picked: Vec<f64>,
}

impl<'a> Rows<'a> {
    pub(crate) fn new(
        problem: &'a Problem,
        source: &'a dyn Source,
        chunk_rows: usize,
        progress: &'a dyn Progress,
    ) -> Result<Self, EstimateError> {
        let columns: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        let targets = problem.tasks.iter().map(|task| &task.target);
        let data: Vec<Expr> = targets.chain(&problem.leaves).cloned().collect();
        let data = Design::compile(&data, &columns)?;
        let chunks = Grid { chunk_rows, folds: 0, purge: 0 }.chunks(source.episodes());
        Ok(Self { problem, source, columns, chunks, data, progress })
    }

    /// Residuals and Jacobian at `theta`. Parameters are constants of the program, which is compiled anew: next to a pass that is nothing, and what
    /// depends on parameters alone is computed once.
    pub(crate) fn evaluate(&self, theta: &[f64]) -> Result<Pass, EstimateError> {
        let tasks = self.problem.tasks.iter();
        let outputs = tasks.flat_map(|task| task.slopes.iter().map(|(_, slope)| slope).chain([&task.value]));
        let outputs: Vec<Expr> = outputs.map(|expr| self.problem.at(expr, theta)).collect();
        let design = Design::compile(&outputs, &self.columns)?;
        let mut total = Part::new(self.problem);
        let (mut scores, mut broken) = (Vec::with_capacity(self.chunks.len()), None);
        reduce(
            self.source,
            &self.chunks,
            self.data.halo(),
            self.progress,
            || Part::new(self.problem),
            |part, _, block, tile| {
                part.add(self, &design, block, tile);
                Ok::<_, EstimateError>(())
            },
            |chunk, part| {
                if let (None, Some(row)) = (&broken, part.broken) {
                    broken = Some((self.source.episodes()[chunk.episode].name.clone(), row));
                }
                scores.push(self.score(&part.factors));
                total.merge(&part);
                Ok(())
            },
        )?;
        if let Some((episode, row)) = broken {
            return Ok(Pass::NotFinite(episode, row));
        }
        let (jacobian, rhs, beyond) = self.stack(&total.factors);
        let cost = rhs.iter().map(|r| r * r).sum::<f64>() + beyond;
        let (targets, rows) = (total.targets, total.rows);
        Ok(Pass::Finite(Evaluation { jacobian, rhs, cost, targets, rows, scores }))
    }

    /// Compressed rows of all residuals; the row `sqrt(n) mean` is what centring took away.
    fn stack(&self, factors: &[Factor]) -> (Mat<f64>, Vec<f64>, f64) {
        let tasks = &self.problem.tasks;
        let rows = tasks.iter().map(|task| task.slopes.len() + 1).sum();
        let mut jacobian = Mat::zeros(rows, self.problem.names.len());
        let (mut rhs, mut beyond) = (vec![0.0; rows], 0.0);
        let mut first = 0;
        for (task, factor) in tasks.iter().zip(factors) {
            let root = factor.square_root();
            let n = root.weight.sqrt();
            for (column, &(j, _)) in task.slopes.iter().enumerate() {
                jacobian[(first, j)] = n * root.mean_x[column];
                (0..=column).for_each(|i| jacobian[(first + 1 + i, j)] = root.r[(i, column)]);
            }
            rhs[first] = n * root.mean_y[0];
            (0..task.slopes.len()).for_each(|i| rhs[first + 1 + i] = root.z[(i, 0)]);
            beyond += root.residual[0];
            first += task.slopes.len() + 1;
        }
        (jacobian, rhs, beyond)
    }

    fn score(&self, factors: &[Factor]) -> Vec<f64> {
        let (jacobian, rhs, _) = self.stack(factors);
        (0..jacobian.ncols()).map(|j| jacobian.col_as_slice(j).iter().zip(&rhs).map(|(a, r)| a * r).sum()).collect()
    }
}

impl Part {
    fn new(problem: &Problem) -> Self {
        Self {
            factors: problem.tasks.iter().map(|task| Factor::new(task.slopes.len(), 1)).collect(),
            targets: 0.0,
            rows: 0,
            broken: None,
            data: DesignRows::default(),
            values: DesignRows::default(),
            picked: Vec::new(),
        }
    }

    fn add(&mut self, rows: &Rows<'_>, design: &Design, block: &Block, tile: Range<usize>) {
        rows.data.evaluate(block, tile.clone(), &mut self.data);
        design.evaluate(block, tile, &mut self.values);
        let n = self.data.rows();
        if n == 0 || self.broken.is_some() {
            return;
        }
        let Some(places) = places(&self.data.index, &self.values.index) else {
            let missing = self.data.index.iter().find(|row| self.values.index.binary_search(row).is_err());
            self.broken = missing.map(|row| block.first + row);
            return;
        };
        for task in 0..self.factors.len() {
            self.targets += self.data.output(task).iter().map(|target| target * target).sum::<f64>();
        }
        self.rows += n as u64;
        let mut first = 0;
        for (factor, task) in self.factors.iter_mut().zip(&rows.problem.tasks) {
            let count = task.slopes.len() + 1;
            self.picked.clear();
            for output in first..first + count {
                let values = self.values.output(output);
                match &places {
                    Places::Same => self.picked.extend_from_slice(values),
                    Places::At(at) => self.picked.extend(at.iter().map(|&at| values[at])),
                }
            }
            factor.push(MatRef::from_column_major_slice(&self.picked, n, count), None);
            first += count;
        }
    }

    fn merge(&mut self, other: &Self) {
        self.factors.iter_mut().zip(&other.factors).for_each(|(factor, other)| factor.merge(other));
        self.targets += other.targets;
        self.rows += other.rows;
    }
}

/// Where the rows of the data stand among the rows that have values.
enum Places {
    Same,
    At(Vec<usize>),
}

/// `None` when a row has no values.
fn places(data: &[usize], values: &[usize]) -> Option<Places> {
    if data == values {
        return Some(Places::Same);
    }
    data.iter().map(|row| values.binary_search(row).ok()).collect::<Option<Vec<usize>>>().map(Places::At)
}
