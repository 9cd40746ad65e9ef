//! Piecewise-affine regression of arrays.

use std::{collections::BTreeMap, convert::Infallible, ops::Range};

use fleetfoot::{
    Column, Episode, Halo, Source,
    data::{Block, Error as DataError, Fingerprint, ScalarBuffer},
    library::Expr,
    model::{Branch, Column as ModelColumn, Cut, Equation, Latent, Prediction, Role, Rule, Tree},
    pwa::{Identification, Options, Problem, Selection, Shrinkage, Specification, identify},
};
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::{
    array::Array,
    error::Kind,
    run::{Failure, run_any},
};

/// Nanoseconds between the rows of an array: it has no clock.
const SECOND: i64 = 1_000_000_000;

/// X, y and weights as a source: neighbouring rows of one group are an episode.
struct Table {
    parts: Vec<Array>,
    columns: Vec<Column>,
    episodes: Vec<Episode>,
    first: Vec<usize>,
}

impl Table {
    fn new(parts: Vec<Array>, names: &[String], groups: &[usize]) -> Self {
        let columns = names.iter().map(Column::float).collect();
        let mut table = Self { parts, columns, episodes: Vec::new(), first: Vec::new() };
        let mut first = 0;
        for (group, &rows) in groups.iter().enumerate() {
            let stamps: Vec<i64> = (0..rows as i64).map(|row| row * SECOND).collect();
            let mut fingerprint = Fingerprint::new();
            fingerprint.stamps(&stamps);
            let read = |rows| Ok::<_, Infallible>(table.block(first, rows));
            let Ok((id, marks)) = fingerprint.identify(&table.columns, rows, read);
            table.episodes.push(Episode {
                id,
                name: group.to_string(),
                file: None,
                labels: BTreeMap::new(),
                rows,
                start: 0,
                end: stamps.last().copied().unwrap_or(0),
                period: 1.0,
                marks,
            });
            table.first.push(first);
            first += rows;
        }
        table
    }

    /// Rows of the episode that begins at row `first` of the arrays.
    fn block(&self, first: usize, rows: Range<usize>) -> Block {
        let whole = first + rows.start..first + rows.end;
        let all = |part: &Array| part.values(&(0..part.columns()).collect::<Vec<_>>(), whole.clone());
        Block {
            first: rows.start,
            before: 0,
            rows: rows.len(),
            after: 0,
            start: 0,
            time: rows.map(|row| row as i64 * SECOND).collect::<Vec<_>>().into(),
            columns: self.parts.iter().flat_map(all).collect::<Vec<ScalarBuffer<f64>>>(),
        }
    }
}

impl Source for Table {
    fn columns(&self) -> &[Column] {
        &self.columns
    }

    fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    // Nothing here has lags or differences: there are no neighbours to bring along.
    fn read(&self, episode: usize, rows: Range<usize>, _: Halo) -> Result<Block, DataError> {
        self.episodes[episode].check(&rows)?;
        Ok(self.block(self.first[episode], rows))
    }
}

impl From<fleetfoot::pwa::Error> for Failure {
    fn from(error: fleetfoot::pwa::Error) -> Self {
        match error {
            fleetfoot::pwa::Error::Cancelled(cancelled) => cancelled.into(),
            error if error.is_memory() => Self::Other(Kind::Memory, error.to_string()),
            error => Self::Other(Kind::Fit, error.to_string()),
        }
    }
}

/// Request of regions and a choice among them: a dictionary in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PwaRequest {
    /// Partitions as users write them.
    partitions: String,
    /// Features that are partition columns.
    features: Vec<usize>,
    /// Rows of each group; neighbours.
    groups: Vec<usize>,
    folds: u16,
    /// Rows of shrinkage; `None`: by cross-validation.
    shrinkage: Option<f64>,
    /// True if maps meet at borders.
    continuous: bool,
    bic: bool,
    seed: u64,
    restarts: usize,
    max_iter: usize,
}

impl PwaRequest {
    fn options(&self) -> Result<Options, Failure> {
        let partitions = Specification::parse_list(&self.partitions)
            .map_err(|error| Failure::Other(Kind::Request, error.to_string()))?;
        let mut options = Options::default();
        options.partitions = partitions;
        options.folds = self.folds;
        options.shrinkage = self.shrinkage.map_or(Shrinkage::Auto, Shrinkage::Rows);
        options.continuous = self.continuous;
        options.selection = if self.bic { Selection::Bic } else { Selection::CrossValidation };
        options.seed = self.seed;
        options.restarts = self.restarts;
        options.iterations = self.max_iter;
        Ok(options)
    }
}

/// Names of the columns: features, targets, the weight.
fn names(features: usize, targets: usize, weighted: bool) -> Vec<String> {
    let x = (0..features).map(|j| format!("x{j}"));
    let y = (0..targets).map(|t| format!("y{t}"));
    x.chain(y).chain(weighted.then(|| "weight".to_owned())).collect()
}

fn problem(features: usize, targets: usize, weighted: bool, partition: &[usize]) -> Problem {
    let column = |name: String, role| ModelColumn::new(name, role);
    let x = |j: usize| Expr::column(format!("x{j}"));
    let inputs = (0..features).map(|j| column(format!("x{j}"), Role::Input));
    let outputs = (0..targets).map(|t| column(format!("y{t}"), Role::Auxiliary));
    Problem {
        columns: inputs.chain(outputs).collect(),
        library: (0..features).map(x).collect(),
        equations: (0..targets)
            .map(|t| Equation {
                subject: format!("y{t}"),
                prediction: Prediction::Value,
                right: Expr::column(format!("f{t}")),
                target: Some(Expr::column(format!("y{t}"))),
                unit: None,
            })
            .collect(),
        partition_columns: partition.iter().copied().map(x).collect(),
        weight: weighted.then(|| Expr::column("weight")),
        step: 1.0,
    }
}

/// A candidate: its partition, regions, held-out loss, standard error, loss of each fold, coefficients of determination, and BIC.
type Candidate = (String, usize, f64, f64, Vec<f64>, Vec<f64>, f64);

/// Piecewise-affine models of arrays.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct PwaFit {
    identification: Identification,
}

#[pymethods]
impl PwaFit {
    /// Fits X (n x p), y (n or n x q), row weights (n).
    #[new]
    #[pyo3(signature = (x, y, weights, request, progress=None))]
    fn new(
        x: &Bound<'_, PyAny>,
        y: &Bound<'_, PyAny>,
        weights: Option<&Bound<'_, PyAny>>,
        request: PwaRequest,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Self> {
        let mut parts = vec![Array::of(x, "X")?, Array::of(y, "y")?];
        let (features, targets) = (parts[0].columns(), parts[1].columns());
        parts.extend(weights.map(|weights| Array::of(weights, "sample_weight")).transpose()?);
        let rows = parts[0].rows();
        let group_total: usize = request.groups.iter().sum();
        if parts.iter().any(|part| part.rows() != rows) || group_total != rows {
            return Err(Kind::Data.error(format!("X has {rows} rows: y, sample_weight and groups have as many")));
        }
        if let Some(feature) = request.features.iter().find(|&&feature| feature >= features) {
            return Err(Kind::Request.error(format!("feature {feature} of the partition: X has {features}")));
        }
        let weighted = weights.is_some();
        let problem = problem(features, targets, weighted, &request.features);
        let identification = run_any(x.py(), progress, |progress| {
            let table = Table::new(parts, &names(features, targets, weighted), &request.groups);
            Ok(identify(&problem, &request.options()?, &table, progress)?)
        })?;
        Ok(Self { identification })
    }

    /// Coefficients of each region and target (regions x q x p).
    #[getter]
    fn coefficients(&self) -> Vec<Vec<Vec<f64>>> {
        let latents = &self.identification.model.latents;
        let row = |latent: &Latent, k| (0..latent.map.features()).map(|j| latent.map.coefficient(k, j)).collect();
        (0..self.regions()).map(|k| latents.iter().map(|latent| row(latent, k)).collect()).collect()
    }

    /// Constant of each region and target (regions x q).
    #[getter]
    fn constants(&self) -> Vec<Vec<f64>> {
        let latents = &self.identification.model.latents;
        (0..self.regions()).map(|k| latents.iter().map(|latent| latent.map.constant(k)).collect()).collect()
    }

    /// The partition as users write it.
    #[getter]
    fn partition(&self) -> String {
        self.identification.candidates[self.identification.chosen].specification.to_string()
    }

    /// Centre and scale of the partition's features.
    #[getter]
    fn units(&self) -> (Vec<f64>, Vec<f64>) {
        let partition = self.identification.model.partitions.first();
        partition.map_or_else(Default::default, |partition| (partition.centre.clone(), partition.scale.clone()))
    }

    /// Weights and offsets of the separators between regions, or between the cells of regions; empty where the partition has none.
    #[getter]
    fn separators(&self) -> (Vec<Vec<f64>>, Vec<f64>) {
        let rule = self.identification.model.partitions.first().map(|partition| &partition.rule);
        let cells = match rule {
            Some(Rule::Joined { cells, .. }) => Some(cells.as_ref()),
            other_rule => other_rule,
        };
        match cells {
            Some(Rule::Linear { weights, offsets }) => (weights.clone(), offsets.clone()),
            _ => Default::default(),
        }
    }

    /// The region of each cell, where cells are joined to regions; else empty.
    #[getter]
    fn joined(&self) -> Vec<u32> {
        match self.identification.model.partitions.first().map(|partition| &partition.rule) {
            Some(Rule::Joined { regions, .. }) => regions.clone(),
            _ => Vec::new(),
        }
    }

    /// The cuts of a tree ([`TreeCut`]); empty where the partition is none.
    #[getter]
    fn cuts(&self) -> Vec<TreeCut> {
        match self.identification.model.partitions.first().map(|partition| &partition.rule) {
            Some(Rule::Tree(tree)) => {
                let cut_tuple = |cut: &Cut| (cut.column, cut.threshold, cut.below.code(), cut.above.code());
                tree.cuts.iter().map(cut_tuple).collect()
            }
            _ => Vec::new(),
        }
    }

    /// True if the weights are centroids.
    #[getter]
    fn is_voronoi(&self) -> bool {
        matches!(self.identification.candidates[self.identification.chosen].specification, Specification::KMeans(_))
    }

    /// Radius of the ball, where the partition is one.
    #[getter]
    fn radius(&self) -> Option<f64> {
        match self.identification.model.partitions.first().map(|partition| &partition.rule) {
            Some(Rule::Ball { radius }) => Some(*radius),
            _ => None,
        }
    }

    /// Half of the sides of the box, where the partition is one.
    #[getter]
    fn half(&self) -> Option<f64> {
        match self.identification.model.partitions.first().map(|partition| &partition.rule) {
            Some(Rule::Box { half }) => Some(*half),
            _ => None,
        }
    }

    /// Rows that each region was fitted on.
    #[getter]
    fn rows(&self) -> Vec<u64> {
        let regions = self.identification.model.summaries.iter().take(1).flat_map(|summary| &summary.regions);
        regions.map(|region| region.rows).collect()
    }

    /// All partitions that were tried.
    #[getter]
    fn candidates(&self) -> Vec<Candidate> {
        let score_tuple = |score: &fleetfoot::pwa::Score| {
            let (name, losses) = (score.specification.to_string(), score.losses.clone());
            (name, score.regions, score.loss, score.standard_error, losses, score.r2.clone(), score.bic)
        };
        self.identification.candidates.iter().map(score_tuple).collect()
    }

    /// For each partition the held-out loss of maps that need not meet; NaN unless requested.
    #[getter]
    fn apart(&self) -> Vec<f64> {
        let apart_of = |score: &fleetfoot::pwa::Score| score.continuity.map_or(f64::NAN, |continuity| continuity.apart);
        self.identification.candidates.iter().map(apart_of).collect()
    }

    /// The number of the chosen one.
    #[getter]
    fn chosen(&self) -> usize {
        self.identification.chosen
    }

    /// Notes for the user; the flag is true if the note is about an iteration that has not converged.
    #[getter]
    fn notes(&self) -> Vec<(String, bool)> {
        let unconverged = self.identification.partition_notes.iter().filter(|note| note.is_unconverged());
        let unconverged: Vec<String> = unconverged.map(ToString::to_string).collect();
        self.identification.notes.iter().map(|note| (note.clone(), unconverged.contains(note))).collect()
    }
}

impl PwaFit {
    fn regions(&self) -> usize {
        self.identification.model.latents.first().map_or(0, |latent| latent.map.regions())
    }
}

/// Column, threshold, and the branches below and above: a cut, or `-1 - region`.
type TreeCut = (usize, f64, i64, i64);

/// The rule of a partition: a dictionary in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct PwaRule {
    features: Vec<usize>,
    centre: Vec<f64>,
    scale: Vec<f64>,
    weights: Vec<Vec<f64>>,
    offsets: Vec<f64>,
    /// The region of each of the cells that these separate; empty where they are the regions.
    joined: Vec<u32>,
    /// The cuts of a tree; empty where the partition is none.
    cuts: Vec<TreeCut>,
    radius: Option<f64>,
    half: Option<f64>,
}

/// A tree from its cuts.
fn tree(cuts: &[TreeCut], columns: usize) -> PyResult<Tree> {
    let cut = |&(column, threshold, below, above): &TreeCut| {
        Some(Cut { column, threshold, below: Branch::of_code(below)?, above: Branch::of_code(above)? })
    };
    let parsed_tree = cuts.iter().map(cut).collect::<Option<Vec<Cut>>>().map(|cuts| Tree { cuts });
    parsed_tree
        .filter(|tree| tree.check(columns).is_ok())
        .ok_or_else(|| Kind::Request.error("the partition's cuts are no tree"))
}

/// The region of each row of X (n x p).
#[pyfunction]
pub(crate) fn pwa_regions<'py>(x: &Bound<'py, PyAny>, rule: PwaRule) -> PyResult<Bound<'py, PyArray1<i32>>> {
    let array = Array::of(x, "X")?;
    let PwaRule { features, centre, scale, weights, offsets, joined, cuts, radius, half } = rule;
    let width = features.len();
    let fits = centre.len() == width && scale.len() == width && weights.iter().all(|row| row.len() == width);
    let fits = fits && (joined.is_empty() || joined.len() == weights.len());
    if !fits || offsets.len() != weights.len() || features.iter().any(|&feature| feature >= array.columns()) {
        return Err(Kind::Request.error("the partition's features, centres and scales do not go together"));
    }
    let tree = tree(&cuts, width)?;
    let rule = match (radius, half) {
        _ if !tree.cuts.is_empty() => Rule::Tree(tree),
        (Some(radius), _) => Rule::Ball { radius },
        (None, Some(half)) => Rule::Box { half },
        (None, None) if weights.is_empty() => Rule::Whole,
        (None, None) if joined.is_empty() => Rule::Linear { weights, offsets },
        (None, None) => Rule::Joined { cells: Rule::Linear { weights, offsets }.into(), regions: joined },
    };
    let regions_of_rows = run_any(x.py(), None, |progress| {
        const BLOCK: usize = 16_384;
        let blocks = fleetfoot::data::parallel_map(array.rows().div_ceil(BLOCK), progress, |block| {
            let rows = block * BLOCK..((block + 1) * BLOCK).min(array.rows());
            let mut regions = vec![0; rows.len()];
            let columns = array.values(&features, rows);
            let z: Vec<Vec<f64>> = columns
                .iter()
                .zip(centre.iter().zip(&scale))
                .map(|(column, (centre, scale))| column.iter().map(|value| (value - centre) / scale).collect())
                .collect();
            rule.assign(&z.iter().map(Vec::as_slice).collect::<Vec<_>>(), &mut regions);
            Ok::<_, Failure>(regions.into_iter().map(|region| region as i32).collect::<Vec<i32>>())
        })?;
        Ok(blocks.concat())
    })?;
    Ok(PyArray1::from_vec(x.py(), regions_of_rows))
}
