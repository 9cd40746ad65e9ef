//! One pass over the rows: values of a problem at given parameters, as a triangular factor for each of its residuals.

use std::ops::Range;

use faer::{Mat, MatRef};
use fleetfoot_data::{Block, Halo, Progress, Source};
use fleetfoot_library::{Design, DesignRows, Expr, FilterError, Filtered};
use fleetfoot_stats::{Chunk, Factor, Grid, reduce};

use crate::{EstimateError, parameter::substitute};

/// Expressions that are evaluated at every row.
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    /// Names of the parameters.
    pub(crate) names: Vec<String>,
    /// Measured expressions, one a residual.
    pub(crate) targets: Vec<Expr>,
    /// For every residual, expressions over columns and parameters; the last of each is the factor's right-hand side.
    pub(crate) outputs: Vec<Vec<Expr>>,
    /// With the targets: the rows at which these are finite are the rows of the problem, whatever the parameters.
    pub(crate) presence: Vec<Expr>,
}

/// The layout over the rows of a source.
pub(crate) struct Rows<'a> {
    pub(crate) layout: &'a Layout,
    source: &'a dyn Source,
    chunks: Vec<Chunk>,
    progress: &'a dyn Progress,
}

/// Result of a pass.
pub(crate) enum Scan {
    Complete(Sums),
    /// Parameters that cannot be: an expression is not finite at some row, or a filter does not take its constant.
    Refused(EstimateError),
}

/// The rows, compressed.
pub(crate) struct Sums {
    /// One a residual.
    pub(crate) factors: Vec<Factor>,
    /// Sums of squares of the targets.
    pub(crate) targets: Vec<f64>,
    /// Complete rows.
    pub(crate) rows: u64,
}

/// Rows of a factor: `|y - X b|^2 = |rhs - columns b|^2 + beyond` for all b; the first is the mean that centring took
/// away.
pub(crate) struct Unfolded {
    pub(crate) columns: Mat<f64>,
    pub(crate) rhs: Vec<f64>,
    pub(crate) beyond: f64,
}

pub(crate) fn unfold(factor: &Factor) -> Unfolded {
    let root = factor.square_root();
    let (p, size) = (root.regressors(), root.weight.sqrt());
    let columns = Mat::from_fn(p + 1, p, |i, j| match i {
        0 => size * root.mean_x[j],
        _ if i <= j + 1 => root.r[(i - 1, j)],
        _ => 0.0,
    });
    let rhs = (0..=p).map(|i| if i == 0 { size * root.mean_y[0] } else { root.z[(i - 1, 0)] }).collect();
    Unfolded { columns, rhs, beyond: root.residual[0] }
}

/// The expressions of a pass, compiled with numbers for the parameters.
struct Compiled {
    data: Design,
    values: Design,
    halo: Halo,
}

/// The factors of one chunk.
struct Part {
    factors: Vec<Factor>,
    targets: Vec<f64>,
    rows: u64,
    broken: Option<usize>,
    data: DesignRows,
    values: DesignRows,
    picked: Vec<f64>,
}

impl<'a> Rows<'a> {
    pub(crate) fn new(
        layout: &'a Layout,
        source: &'a dyn Source,
        chunk_rows: usize,
        progress: &'a dyn Progress,
    ) -> Self {
        let chunks = Grid { chunk_rows }.chunks(source.episodes());
        Self { layout, source, chunks, progress }
    }

    /// Evaluates the rows at `theta`; `each` gets the factors of every chunk. Parameters are constants of the program,
    /// which is compiled anew. That costs nothing beside a pass, and expressions of parameters alone are computed once.
    pub(crate) fn scan(&self, theta: &[f64], mut each: impl FnMut(&[Factor]) + Send) -> Result<Scan, EstimateError> {
        let at = |expr: &Expr| substitute(&self.layout.names, expr, theta);
        let data: Vec<Expr> = self.layout.targets.iter().chain(&self.layout.presence).cloned().collect();
        let values: Vec<Expr> = self.layout.outputs.iter().flatten().map(at).collect();
        let filtered = match Filtered::of(self.source, &[data.as_slice(), &values].concat()) {
            Ok(filtered) => filtered,
            Err(error @ FilterError::Range { .. }) => return Ok(Scan::Refused(error.into())),
            Err(error) => return Err(error.into()),
        };
        let compiled = Compiled::new(&data, &values, &filtered)?;
        let mut total = Part::new(self.layout);
        let mut broken = None;
        reduce(
            &filtered,
            &self.chunks,
            compiled.halo,
            self.progress,
            || Part::new(self.layout),
            |part, _, block, tile| {
                part.add(self.layout, &compiled, block, tile);
                Ok::<_, EstimateError>(())
            },
            |chunk, part| {
                if let (None, Some(row)) = (&broken, part.broken) {
                    broken = Some((self.source.episodes()[chunk.episode].name.clone(), row));
                }
                each(&part.factors);
                total.merge(&part);
                Ok(())
            },
        )?;
        Ok(match broken {
            Some((episode, row)) => Scan::Refused(EstimateError::NotFinite { episode, row }),
            None => Scan::Complete(Sums { factors: total.factors, targets: total.targets, rows: total.rows }),
        })
    }
}

impl Compiled {
    fn new(data: &[Expr], values: &[Expr], source: &dyn Source) -> Result<Self, EstimateError> {
        let columns: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        let (data, values) = (Design::compile(data, &columns)?, Design::compile(values, &columns)?);
        let (a, b) = (data.halo(), values.halo());
        let halo = Halo { before: a.before.max(b.before), after: a.after.max(b.after) };
        Ok(Self { data, values, halo })
    }
}

impl Part {
    fn new(layout: &Layout) -> Self {
        Self {
            factors: layout.outputs.iter().map(|outputs| Factor::new(outputs.len() - 1, 1)).collect(),
            targets: vec![0.0; layout.targets.len()],
            rows: 0,
            broken: None,
            data: DesignRows::default(),
            values: DesignRows::default(),
            picked: Vec::new(),
        }
    }

    fn add(&mut self, layout: &Layout, compiled: &Compiled, block: &Block, tile: Range<usize>) {
        compiled.data.evaluate(block, tile.clone(), &mut self.data);
        compiled.values.evaluate(block, tile, &mut self.values);
        let n = self.data.rows();
        if n == 0 || self.broken.is_some() {
            return;
        }
        let Some(places) = places(&self.data.index, &self.values.index) else {
            let missing = self.data.index.iter().find(|row| self.values.index.binary_search(row).is_err());
            self.broken = missing.map(|row| block.first + row);
            return;
        };
        for (k, sum) in self.targets.iter_mut().enumerate() {
            *sum += self.data.output(k).iter().map(|target| target * target).sum::<f64>();
        }
        self.rows += n as u64;
        let mut first = 0;
        for (factor, outputs) in self.factors.iter_mut().zip(&layout.outputs) {
            self.picked.clear();
            for output in first..first + outputs.len() {
                let values = self.values.output(output);
                match &places {
                    Places::Same => self.picked.extend_from_slice(values),
                    Places::At(at) => self.picked.extend(at.iter().map(|&at| values[at])),
                }
            }
            factor.push(MatRef::from_column_major_slice(&self.picked, n, outputs.len()), None);
            first += outputs.len();
        }
    }

    fn merge(&mut self, other: &Self) {
        self.factors.iter_mut().zip(&other.factors).for_each(|(factor, other)| factor.merge(other));
        self.targets.iter_mut().zip(&other.targets).for_each(|(sum, other)| *sum += other);
        self.rows += other.rows;
    }
}

/// Places of the data's rows among the rows that have values.
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
