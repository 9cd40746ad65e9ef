//! Long calls: without the interpreter's lock, stopped by Ctrl-C, reported by a progress callback, and whole after a
//! fork.

use std::{
    any::Any,
    panic::{AssertUnwindSafe, catch_unwind},
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use fleetfoot::{
    Progress, Threads, Work,
    data::{Stop, stoppable},
    stats::long_work,
};
use pyo3::prelude::*;

use crate::error::{Kind, of_engine};

/// Period between two checks for Ctrl-C and reports of progress.
const PERIOD: Duration = Duration::from_millis(50);

/// The largest number of threads allowed.
const MOST_THREADS: usize = 1024;

/// The threads, and the process that they are of: a forked child has none of its parent's.
struct Pool {
    process: u32,
    wanted: usize,
    threads: Arc<Threads>,
}

static POOL: Mutex<Option<Pool>> = Mutex::new(None);
static WANTED: AtomicUsize = AtomicUsize::new(0);

fn pool() -> PyResult<Arc<Threads>> {
    let (process, wanted) = (std::process::id(), WANTED.load(Ordering::Relaxed));
    let mut pool = POOL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(pool) = pool.as_ref()
        && pool.process == process
        && pool.wanted == wanted
    {
        return Ok(pool.threads.clone());
    }
    let threads = Threads::new(wanted).map_err(|problem| {
        Kind::Internal.error(format!("no threads can be started: {problem}; set fleetfoot.set_threads(1)"))
    })?;
    let threads = Arc::new(threads);
    let new = Pool { process, wanted, threads: threads.clone() };
    if let Some(old) = pool.replace(new)
        && old.process != process
    {
        // Its threads live in the parent: there is nobody here to end.
        std::mem::forget(old);
    }
    Ok(threads)
}

/// Sets the number of threads of all following calls; 0: as many as there are cores (as at first).
///
/// Results do not depend on it.
#[pyfunction]
pub(crate) fn set_threads(count: usize) -> PyResult<()> {
    if count > MOST_THREADS {
        let mend = format!("give at most {MOST_THREADS}, or 0 for as many as there are cores");
        return Err(Kind::Request.error(format!("{count} threads are too many: {mend}")));
    }
    WANTED.store(count, Ordering::Relaxed);
    Ok(())
}

/// The number of threads that calls use.
#[pyfunction]
pub(crate) fn thread_count(py: Python<'_>) -> PyResult<usize> {
    run(py, None, |_| Ok(fleetfoot::thread_count()))
}

/// Progress as it stands, for the thread that waits.
#[derive(Default)]
struct Watcher {
    stop: Stop,
    done: AtomicUsize,
    total: AtomicUsize,
    stage: Mutex<String>,
    /// Durations that are still to be reported.
    durations: Mutex<Vec<String>>,
}

impl Progress for Watcher {
    fn advance(&self, units: usize, total: usize) {
        self.total.store(total, Ordering::Relaxed);
        self.done.fetch_add(units, Ordering::Relaxed);
    }

    fn cancelled(&self) -> bool {
        self.stop.is_set()
    }

    fn stage(&self, name: &str) {
        *self.stage.lock().unwrap_or_else(PoisonError::into_inner) = name.to_owned();
        self.done.store(0, Ordering::Relaxed);
        self.total.store(0, Ordering::Relaxed);
    }

    fn expect(&self, work: Work) {
        self.durations.lock().unwrap_or_else(PoisonError::into_inner).extend(long_work(work));
    }
}

impl Watcher {
    /// Lets Python handle its signals and calls the progress callback; an exception of either stops the work.
    fn look(&self, callback: Option<&Py<PyAny>>) -> PyResult<()> {
        Python::attach(|py| {
            py.check_signals()?;
            for duration in std::mem::take(&mut *self.durations.lock().unwrap_or_else(PoisonError::into_inner)) {
                let tell = PyModule::import(py, "fleetfoot._warnings")?.getattr("tell_all")?;
                tell.call1(([duration],))?;
            }
            let Some(callback) = callback else { return Ok(()) };
            let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner).clone();
            let (done, total) = (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed));
            callback.call1(py, (stage, done, total)).map(|_| ())
        })
    }
}

/// Runs work of the engine with the package's threads, with the interpreter's lock released. `progress` is called now
/// and then with the name of the stage, the pieces that are done and the pieces in all (0: not known).
pub(crate) fn run<R: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&dyn Progress) -> Result<R, fleetfoot::Error> + Send,
) -> PyResult<R> {
    run_any(py, progress, |progress| work(progress).map_err(Failure::Engine))
}

/// Failure of work that is not a pipeline: a kind and a message, or a pipeline's error.
pub(crate) enum Failure {
    /// Of a pipeline.
    Engine(fleetfoot::Error),
    /// Of anything else.
    Other(Kind, String),
}

impl Failure {
    /// An error of the given kind.
    pub(crate) fn of(kind: Kind) -> impl Fn(&dyn std::fmt::Display) -> Self {
        move |error| Self::Other(kind, error.to_string())
    }
}

impl From<fleetfoot::data::Cancelled> for Failure {
    fn from(cancelled: fleetfoot::data::Cancelled) -> Self {
        Self::Engine(cancelled.into())
    }
}

impl From<fleetfoot::data::OutOfMemory> for Failure {
    fn from(error: fleetfoot::data::OutOfMemory) -> Self {
        Self::Engine(error.into())
    }
}

impl From<fleetfoot::Error> for Failure {
    fn from(error: fleetfoot::Error) -> Self {
        Self::Engine(error)
    }
}

impl From<Failure> for PyErr {
    fn from(failure: Failure) -> Self {
        match failure {
            Failure::Engine(error) => of_engine(error),
            Failure::Other(kind, message) => kind.error(message),
        }
    }
}

/// As [`run`], for work with other errors.
pub(crate) fn run_any<R: Send>(
    py: Python<'_>,
    progress: Option<Py<PyAny>>,
    work: impl FnOnce(&dyn Progress) -> Result<R, Failure> + Send,
) -> PyResult<R> {
    let threads = pool()?;
    let watcher = Watcher::default();
    let (answer, raised) = py.detach(|| {
        let mut raised = None;
        let guarded = || catch_unwind(AssertUnwindSafe(|| stoppable(&watcher.stop, || work(&watcher))));
        let answer = threads.run(guarded, PERIOD, || {
            if raised.is_none()
                && let Err(error) = watcher.look(progress.as_ref())
            {
                watcher.stop.set();
                raised = Some(error);
            }
        });
        (answer, raised)
    });
    match (raised, answer) {
        (Some(raised), _) => Err(raised),
        (None, Ok(answer)) => answer.unwrap_or_else(|cancelled| Err(cancelled.into())).map_err(PyErr::from),
        (None, Err(panic)) => Err(mistake(panic.as_ref())),
    }
}

/// Runs short work on the caller's thread; a panic becomes an exception.
pub(crate) fn guard<R>(work: impl FnOnce() -> PyResult<R>) -> PyResult<R> {
    catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(mistake(panic.as_ref())))
}

fn mistake(panic: &(dyn Any + Send)) -> PyErr {
    let message = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    Kind::Internal.error(format!(
        "fleetfoot failed where it should not ({}); please report it with the data that did it",
        message.unwrap_or("no message")
    ))
}
