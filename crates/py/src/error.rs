//! One Python exception for each kind of error; the classes are Python's (`fleetfoot.exceptions`).

use std::fmt::Display;

use fleetfoot::{
    Cause, Error, RequestError, dataset::Error as DatasetError, output::Error as OutputError,
    recipe::Error as RecipeError, statistic::StatisticError,
};
use pyo3::{
    exceptions::{PyBaseException, PyImportError, PyKeyboardInterrupt, PyRuntimeError},
    prelude::*,
    types::PyType,
};

/// The kinds of errors, by the names of their classes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// A request that cannot be understood or met: recipes, expressions, columns, options.
    Request,
    /// A request: an option has a value that it does not take, is missing, or excludes another.
    Option,
    /// A request: nothing has the name.
    UnknownName,
    /// A request: too few rows.
    TooFewRows,
    /// A request: a statistic cannot answer it, and the logs could.
    NeedsLogs,
    /// A request: the data do not determine the answer.
    Undetermined,
    /// Recordings that cannot be read, or lack a needed column.
    Data,
    /// The data do not determine the fit, or the options of a fit are out of their range.
    Fit,
    /// A model that cannot be read, run or exported.
    Model,
    /// Statistics that cannot be read or do not go together.
    Statistic,
    /// Files that cannot be written.
    Write,
    /// More memory than the system gives.
    Memory,
    /// A mistake in fleetfoot itself.
    Internal,
}

impl Kind {
    fn class(self) -> &'static str {
        match self {
            Self::Request => "RequestError",
            Self::Option => "OptionError",
            Self::UnknownName => "UnknownNameError",
            Self::TooFewRows => "TooFewRowsError",
            Self::NeedsLogs => "NeedsLogsError",
            Self::Undetermined => "UndeterminedError",
            Self::Data => "DataError",
            Self::Fit => "FitError",
            Self::Model => "ModelError",
            Self::Statistic => "StatisticError",
            Self::Write => "WriteError",
            Self::Memory => "OutOfMemoryError",
            Self::Internal => "InternalError",
        }
    }

    /// The exception of this kind with a message.
    pub(crate) fn error(self, message: impl Display) -> PyErr {
        let message = message.to_string();
        Python::attach(|py| match class(py, self.class()) {
            Ok(class) => PyErr::from_type(class, (message,)),
            // Only while the package itself is broken.
            Err(_) => PyRuntimeError::new_err(message),
        })
    }
}

fn class<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyType>> {
    let class_object = py.import("fleetfoot.exceptions")?.getattr(name)?;
    class_object.cast_into::<PyType>().map_err(|_| PyImportError::new_err(name.to_owned()))
}

/// The Python exception of a pipeline's error.
pub(crate) fn of_engine(error: impl Into<Error>) -> PyErr {
    let error = error.into();
    let kind = match &error {
        error if error.is_memory() => Kind::Memory,
        Error::Cancelled(_) | Error::Paused { .. } => return PyKeyboardInterrupt::new_err(error.to_string()),
        Error::Request(request) => return of_request(request),
        Error::Dataset(DatasetError::Recipe(RecipeError::UnknownColumn { name, candidates, .. })) => {
            return with(Kind::UnknownName.error(&error), |value| {
                value.setattr("name", name)?;
                value.setattr("candidates", candidates)
            });
        }
        Error::Dataset(error) => of_dataset(error),
        Error::World { .. } | Error::Specification(_) => Kind::Request,
        Error::Export(_) | Error::Import { .. } | Error::Dynamics(_) | Error::Control(_) => Kind::Model,
        Error::Merge(_) => Kind::Statistic,
        _ => Kind::Fit,
    };
    kind.error(error)
}

/// Kind of an error between a recipe and the rows of its logs.
fn of_dataset(error: &DatasetError) -> Kind {
    match error {
        DatasetError::Recipe(RecipeError::Columns(_)) => Kind::UnknownName,
        DatasetError::Recipe(RecipeError::TargetInPartition { .. }) => Kind::Fit,
        DatasetError::Recipe(_) => Kind::Request,
        DatasetError::Output(OutputError::Io { .. })
        | DatasetError::Log(fleetfoot::log::Error::Output(OutputError::Io { .. }))
        | DatasetError::Write { .. } => Kind::Write,
        DatasetError::Statistic(StatisticError::Key { .. }) => Kind::Request,
        DatasetError::Log(_)
        | DatasetError::Output(_)
        | DatasetError::Data(_)
        | DatasetError::Signal { .. }
        | DatasetError::UnseenLabel { .. }
        | DatasetError::TextAsNumber { .. } => Kind::Data,
        DatasetError::Model(_) => Kind::Model,
        DatasetError::Statistic(_) | DatasetError::Merge(_) => Kind::Statistic,
        _ => Kind::Fit,
    }
}

/// The Python exception of a request that cannot be met: a class a cause, with attributes on which a program can act.
fn of_request(request: &RequestError) -> PyErr {
    match &request.cause {
        Cause::Value | Cause::Conflict | Cause::Missing | Cause::NameTaken { .. } => Kind::Option.error(request),
        Cause::UnknownName { name } => with(Kind::UnknownName.error(request), |value| value.setattr("name", name)),
        Cause::TooFewRows { rows, needed } => with(Kind::TooFewRows.error(request), |value| {
            value.setattr("rows", rows)?;
            value.setattr("needed", needed)
        }),
        Cause::NeedsRows | Cause::OtherStatistic => Kind::NeedsLogs.error(request),
        Cause::Undetermined => Kind::Undetermined.error(request),
        Cause::Internal => Kind::Internal.error(request),
        _ => Kind::Request.error(request),
    }
}

/// An exception with attributes; without them where Python refuses.
fn with(error: PyErr, set: impl FnOnce(&Bound<'_, PyBaseException>) -> PyResult<()>) -> PyErr {
    let _ = Python::attach(|py| set(error.value(py)));
    error
}

/// An answer of a solver or a reader with an error of the given kind.
pub(crate) trait OrRaise<T> {
    /// The value, or the exception.
    fn or_raise(self, kind: Kind) -> PyResult<T>;
}

impl<T, E: Display> OrRaise<T> for Result<T, E> {
    fn or_raise(self, kind: Kind) -> PyResult<T> {
        self.map_err(|error| kind.error(error))
    }
}
