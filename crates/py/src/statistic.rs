//! Statistics as values: scanned, merged, parted, solved.

use std::{
    collections::{BTreeMap, HashSet},
    num::NonZeroUsize,
    path::{Path, PathBuf},
    sync::Arc,
};

use fleetfoot::{
    Logs, Recipe, SolveMethod, Solved,
    data::Progress,
    solve_statistic,
    statistic::{self, LabelKey, ScanOptions, StatisticFile},
};
use numpy::{PyArray1, PyArray2};
use pyo3::{
    prelude::*,
    types::{PyBytes, PyDict, PyList},
};

use crate::{
    data::Data,
    error::{Kind, OrRaise, of_engine},
    run::{guard, run},
};

/// A statistic: a plan, and the sums that were scanned with it. It never changes.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct Statistic {
    file: Arc<StatisticFile>,
}

impl Statistic {
    fn of(file: StatisticFile) -> Self {
        Self { file: Arc::new(file) }
    }
}

/// Options of a scan beside recordings: labels from paths, rows of a chunk.
fn options(keys: &[String], chunk_rows: Option<usize>) -> PyResult<ScanOptions> {
    let keys: Result<Vec<LabelKey>, _> = keys.iter().map(|key| key.parse()).collect();
    let chunk_rows = match chunk_rows {
        None => None,
        Some(rows) => Some(NonZeroUsize::new(rows).ok_or_else(|| {
            Kind::Request.error("chunk_rows = 0: give a number from 1 on, or None for a choice by the number of rows")
        })?),
    };
    Ok(ScanOptions { keys: keys.or_raise(Kind::Request)?, chunk_rows })
}

fn parse(recipe: &str) -> PyResult<Recipe> {
    Recipe::parse(recipe, "the recipe").map_err(of_engine)
}

#[pymethods]
impl Statistic {
    /// The plan that a scan would freeze, without rows; and notes.
    #[staticmethod]
    #[pyo3(signature = (recipe, data, keys, chunk_rows=None, progress=None))]
    fn freeze(
        py: Python<'_>,
        recipe: &str,
        data: &Data,
        keys: Vec<String>,
        chunk_rows: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Self, Vec<String>)> {
        let (recipe, options) = (parse(recipe)?, options(&keys, chunk_rows)?);
        let (file, notes) = run(py, progress, |progress| statistic::freeze(&recipe, &options, &data.logs, progress))?;
        Ok((Self::of(file), notes))
    }

    /// A scan with a new plan; the skipped files, and notes.
    #[staticmethod]
    #[pyo3(signature = (recipe, data, keys, chunk_rows=None, progress=None))]
    fn scan(
        py: Python<'_>,
        recipe: &str,
        data: &Data,
        keys: Vec<String>,
        chunk_rows: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Self, Vec<String>, Vec<String>)> {
        let (recipe, options) = (parse(recipe)?, options(&keys, chunk_rows)?);
        let work = |progress: &dyn Progress| statistic::scan(&recipe, &options, None, &data.logs, progress);
        let (file, report) = run(py, progress, work)?;
        Ok((Self::of(file), report.skipped, report.notes))
    }

    /// A scan with this plan; `part`: it may be without a complete row.
    #[pyo3(signature = (data, keys, part=false, progress=None))]
    fn scan_with(
        &self,
        py: Python<'_>,
        data: &Data,
        keys: Vec<String>,
        part: bool,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Self, Vec<String>, Vec<String>)> {
        let options = options(&keys, None)?;
        let work = |progress: &dyn Progress| {
            if part {
                return statistic::scan_part(&self.file, &options, &data.logs, progress);
            }
            let recipe = Recipe::parse(&self.file.recipe, "the recipe of the plan")?;
            statistic::scan(&recipe, &options, Some(self.file.without_rows()), &data.logs, progress)
        };
        let (file, report) = run(py, progress, work)?;
        Ok((Self::of(file), report.skipped, report.notes))
    }

    /// The same plan without rows.
    fn plan(&self) -> Self {
        Self::of(self.file.without_rows())
    }

    /// Reads the bytes of a `.stats` file.
    #[staticmethod]
    fn from_bytes(bytes: &[u8]) -> PyResult<Self> {
        guard(|| Ok(Self::of(StatisticFile::from_bytes(bytes, Path::new("bytes")).or_raise(Kind::Statistic)?.0)))
    }

    /// The bytes of a `.stats` file.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        guard(|| Ok(PyBytes::new(py, &self.file.to_bytes().map_err(of_engine)?)))
    }

    /// Reads a `.stats` file.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        Ok(Self::of(run(py, None, |_| Ok(StatisticFile::read(&path)?))?))
    }

    /// Writes a `.stats` file, whole or not at all.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        run(py, None, |_| Ok(self.file.write(&path)?)).map(|_| ())
    }

    /// This and others as one; a log that two of them have is refused.
    fn merged(&self, py: Python<'_>, others: Vec<PyRef<'_, Self>>) -> PyResult<Self> {
        let others: Vec<Arc<StatisticFile>> = others.iter().map(|other| other.file.clone()).collect();
        let work = |progress: &dyn Progress| {
            let mut whole = self.file.as_ref().clone();
            for (at, other) in others.iter().enumerate() {
                if progress.cancelled() {
                    return Err(fleetfoot::data::Cancelled.into());
                }
                let right = format!("statistic {}", at + 2);
                whole.merge("statistic 1", other.as_ref().clone(), &right)?;
            }
            Ok(whole)
        };
        Ok(Self::of(run(py, None, work)?))
    }

    /// This and others as one, in order; of a file that two of them have, the first one's sums stay. Also the skipped
    /// files.
    fn appended(&self, py: Python<'_>, others: Vec<PyRef<'_, Self>>) -> PyResult<(Self, Vec<String>)> {
        let others: Vec<Arc<StatisticFile>> = others.iter().map(|other| other.file.clone()).collect();
        let work = |_: &dyn Progress| {
            let (mut whole, mut skipped) = (self.file.as_ref().clone(), Vec::new());
            for other in others {
                skipped.extend(whole.append(Arc::unwrap_or_clone(other))?);
            }
            Ok((whole, skipped))
        };
        let (whole, skipped) = run(py, None, work)?;
        Ok((Self::of(whole), skipped))
    }

    /// The episodes of these identities.
    fn kept(&self, identities: HashSet<String>) -> PyResult<Self> {
        guard(|| {
            let mut file = self.file.as_ref().clone();
            file.keep_episodes(|episode| identities.contains(&episode.id.to_string())).map_err(of_engine)?;
            Ok(Self::of(file))
        })
    }

    /// One chunk an episode.
    fn compacted(&self) -> PyResult<Self> {
        guard(|| {
            let mut file = self.file.as_ref().clone();
            file.compact();
            Ok(Self::of(file))
        })
    }

    /// Hash of the plan.
    #[getter]
    fn hash(&self) -> String {
        self.file.plan_hash()
    }

    /// The plan for people.
    #[getter]
    fn text(&self) -> String {
        self.file.plan_text()
    }

    /// The recipe as TOML, wildcards written out.
    #[getter]
    fn recipe(&self) -> &str {
        &self.file.recipe
    }

    /// The methods that need no logs, each with its regions.
    #[getter]
    fn serves(&self) -> Vec<String> {
        fleetfoot::statistic::serves(&self.file)
    }

    /// Rows of a chunk, at most.
    #[getter]
    fn chunk_rows(&self) -> usize {
        self.file.plan.chunk_rows
    }

    /// Number of chunks.
    #[getter]
    fn chunks(&self) -> usize {
        self.file.chunks()
    }

    /// Complete rows, rows at borders, incomplete rows.
    #[getter]
    fn rows(&self) -> (u64, u64, u64) {
        let counts = self.file.scanned.counts();
        (counts.complete, counts.at_border, counts.incomplete)
    }

    /// Names of the tasks.
    #[getter]
    fn tasks(&self) -> Vec<String> {
        self.file.plan.regression.tasks.iter().map(|task| task.name.clone()).collect()
    }

    /// Names of the latents and their functions.
    #[getter]
    fn latents(&self) -> Vec<(String, Vec<String>)> {
        let latents = self.file.plan.regression.latents.iter();
        latents
            .map(|latent| (latent.name.clone(), latent.functions.iter().map(ToString::to_string).collect()))
            .collect()
    }

    /// Names, hashes and sizes of the files.
    #[getter]
    fn files(&self) -> Vec<(String, String, u64)> {
        self.file.files.iter().map(|file| (file.name.clone(), file.hash.to_string(), file.bytes)).collect()
    }

    /// The episodes.
    fn episodes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyList>> {
        let records = PyList::empty(py);
        for episode in &self.file.episodes {
            let record = PyDict::new(py);
            let counts = self.file.scanned.rows.get(&episode.id).copied().unwrap_or_default();
            record.set_item("id", episode.id.to_string())?;
            record.set_item("name", &episode.name)?;
            record.set_item("file", self.file.file_of(episode).map(|file| file.name.clone()))?;
            record.set_item("labels", &episode.labels)?;
            record.set_item("rows", episode.rows)?;
            record.set_item("complete", counts.complete)?;
            record.set_item("start", episode.start)?;
            record.set_item("end", episode.end)?;
            record.set_item("period", episode.period)?;
            records.append(record)?;
        }
        Ok(records)
    }

    /// The square-root form of a task over all rows: names of its columns, R, z, means, weight, squared length beyond.
    fn root<'py>(&self, py: Python<'py>, task: usize) -> PyResult<Bound<'py, PyDict>> {
        guard(|| {
            let stats = self.file.scanned.tasks.get(task);
            let stats = stats.ok_or_else(|| Kind::Request.error(format!("there is no task {task}")))?;
            let total = stats.stats.total(|_| true);
            let total =
                total.ok_or_else(|| Kind::Statistic.error("there are no rows: this is the statistic of nothing"))?;
            let root = stats.preconditioner.square_root(&total);
            let p = root.r.ncols();
            let r: Vec<Vec<f64>> =
                (0..p).map(|i| (0..p).map(|j| if j >= i { root.r[(i, j)] } else { 0.0 }).collect()).collect();
            let z: Vec<f64> = (0..p).map(|i| root.z[(i, 0)]).collect();
            let mut names: Vec<String> =
                self.file.plan.regression.columns(task).iter().map(ToString::to_string).collect();
            let target = names.pop();
            let root_dict = PyDict::new(py);
            root_dict.set_item("names", names)?;
            root_dict.set_item("target", target)?;
            root_dict.set_item("r", PyArray2::from_vec2(py, &r).or_raise(Kind::Internal)?)?;
            root_dict.set_item("z", PyArray1::from_vec(py, z))?;
            root_dict.set_item("mean_x", PyArray1::from_slice(py, &root.mean_x))?;
            root_dict.set_item("mean_y", root.mean_y[0])?;
            root_dict.set_item("weight", root.weight)?;
            root_dict.set_item("residual", root.residual[0])?;
            Ok(root_dict)
        })
    }

    /// Coefficients at a penalty; without one least squares.
    #[pyo3(signature = (recipe, strength, l1_ratio, progress=None))]
    fn solve<'py>(
        &self,
        py: Python<'py>,
        recipe: Option<&str>,
        strength: Option<f64>,
        l1_ratio: f64,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let recipe = recipe.map(parse).transpose()?;
        let method = match strength {
            None => SolveMethod::LeastSquares,
            Some(lambda) => SolveMethod::Penalised { lambda, l1_ratio },
        };
        let solved = run(py, progress, |_| solve_statistic(&self.file, recipe.as_ref(), method))?;
        as_dict(py, &solved)
    }

    /// This in place of logs, for the fits that need no rows.
    fn data(&self) -> Data {
        Data { logs: Logs::of_statistic(self.file.clone()) }
    }

    /// Episodes and rows by the values of every label.
    fn by_label(&self) -> BTreeMap<String, BTreeMap<String, (usize, u64)>> {
        self.file.by_label()
    }
}

fn as_dict<'py>(py: Python<'py>, solved: &Solved) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    let array = |values: &[f64]| PyArray1::from_slice(py, values);
    dict.set_item("names", &solved.names)?;
    dict.set_item("coefficients", array(&solved.coefficients))?;
    dict.set_item("standard_errors", solved.standard_errors.as_deref().map(array))?;
    dict.set_item("certificate", (solved.certificate.kkt, solved.certificate.gap, solved.certificate.objective))?;
    dict.set_item("rows", solved.rows)?;
    dict.set_item("tasks", &solved.tasks)?;
    dict.set_item("confounded", &solved.confounded)?;
    dict.set_item("notes", &solved.notes)?;
    dict.set_item("model", solved.model.to_json())?;
    Ok(dict)
}
