//! Data of a Python call: files, arrays, Arrow tables, or a statistic.

use std::{path::PathBuf, sync::Arc};

use fleetfoot::{
    Logs,
    log::{Log, MemoryTable},
};
use pyo3::prelude::*;

use crate::{
    array::{Array, Arrays},
    arrow::ArrowTable,
    error::of_engine,
    run::guard,
};

/// An array with the names of its columns.
type Part<'py> = (Bound<'py, PyAny>, Vec<String>);

/// Data to read: files, tables in memory, or both. Temporary files of the data are removed with it: it can be referred
/// to weakly.
#[pyclass(frozen, weakref, module = "fleetfoot._core")]
pub(crate) struct Data {
    pub(crate) logs: Logs,
}

impl Data {
    /// Tables in memory.
    pub(crate) fn of_tables(tables: Vec<Arc<dyn MemoryTable>>) -> Self {
        Self { logs: Logs::tables(tables) }
    }
}

#[pymethods]
impl Data {
    /// Files that paths, glob patterns and folders name.
    #[staticmethod]
    fn files(patterns: Vec<PathBuf>) -> PyResult<Self> {
        if fleetfoot::is_statistic(&patterns) {
            return Ok(Self { logs: (&patterns).into() });
        }
        let paths = fleetfoot::log::paths(patterns).map_err(of_engine)?;
        Ok(Self { logs: (&paths).into() })
    }

    /// Runs of arrays: for each its name, and its arrays with the names of their columns.
    #[staticmethod]
    fn arrays(runs: Vec<(String, Vec<Part<'_>>)>) -> PyResult<Self> {
        let mut tables: Vec<Arc<dyn MemoryTable>> = Vec::with_capacity(runs.len());
        for (name, parts) in runs {
            let arrays = parts
                .into_iter()
                .map(|(object, names)| {
                    let what = format!("{name}, `{}`", names.first().map_or("", String::as_str));
                    Ok((Array::of(&object, &what)?, names))
                })
                .collect::<PyResult<Vec<_>>>()?;
            tables.push(Arc::new(Arrays::new(name, arrays)?));
        }
        Ok(Self::of_tables(tables))
    }

    /// Arrow tables: for each its name, and the batches, tables or streams of one schema that make it.
    #[staticmethod]
    fn arrow(tables: Vec<(String, Vec<Bound<'_, PyAny>>)>) -> PyResult<Self> {
        let table = |(name, parts): (String, Vec<Bound<'_, PyAny>>)| {
            guard(|| ArrowTable::of(name, &parts)).map(|table| Arc::new(table) as Arc<dyn MemoryTable>)
        };
        Ok(Self::of_tables(tables.into_iter().map(table).collect::<PyResult<_>>()?))
    }

    /// These and others as one.
    fn joined(&self, others: Vec<PyRef<'_, Self>>) -> Self {
        let all = std::iter::once(&self.logs).chain(others.iter().map(|other| &other.logs));
        Self { logs: all.flat_map(|logs| logs.all().to_vec()).collect::<Vec<Log>>().into() }
    }

    /// Paths of the files, and names of the tables.
    fn names(&self) -> Vec<String> {
        self.logs.all().iter().map(|log| log.path().display().to_string()).collect()
    }

    fn __len__(&self) -> usize {
        self.logs.len()
    }
}
