//! Simulations from values at hand.

use fleetfoot::data::ensure_memory;
use fleetfoot::dynamics::{Course, InputSequence, Integration, Method, TimeGrid as Grid, Tolerance};
use numpy::{PyArray1, PyArrayDyn};
use pyo3::prelude::*;

use crate::{
    error::{Kind, OrRaise},
    model::{History, Model, method},
    points::{Floats, Given, array, points},
    run::{Failure, guard, run_any},
};

/// Times at which a model can be simulated.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct TimeGrid {
    grid: Grid,
}

#[pymethods]
impl TimeGrid {
    /// The times, seconds.
    #[getter]
    fn times<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.grid.times())
    }

    fn __len__(&self) -> usize {
        self.grid.intervals()
    }

    /// A grid of one interval.
    fn interval(&self, at: usize) -> PyResult<Self> {
        if at >= self.grid.intervals() {
            return Err(Kind::Request.error(format!("interval {at} of {}", self.grid.intervals())));
        }
        Ok(Self { grid: self.grid.interval(at) })
    }

    /// The same with no interval longer than a sampling period, and where the times stand in it.
    fn refined<'py>(&self, py: Python<'py>) -> PyResult<(Self, Bound<'py, PyArray1<i64>>)> {
        let (grid, places) = self.grid.refined().or_raise(Kind::Model)?;
        Ok((Self { grid }, PyArray1::from_iter(py, places.into_iter().map(|place| place as i64))))
    }
}

/// The times of a simulation, checked: rising, and of a model that goes by rows a row apart.
#[pyfunction]
pub(crate) fn time_grid(model: &Model, t: &Bound<'_, PyAny>) -> PyResult<TimeGrid> {
    let t = Floats::of(t, "t")?;
    if t.shape.len() != 1 {
        return Err(Kind::Model.error(format!(
            "t has the shape {:?}; give the times of the simulation in seconds, rising, the first one that of x0",
            t.shape
        )));
    }
    Ok(TimeGrid { grid: model.stepper().grid(t.values).or_raise(Kind::Model)? })
}

/// Step rule of a simulation between two times: a dictionary in Python.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Passing {
    /// "rk45", "rk4", "euler".
    method: String,
    substeps: Option<usize>,
    rtol: Option<f64>,
    /// One for each state.
    atol: Option<Vec<f64>>,
}

impl Passing {
    fn integration(&self, states: usize) -> PyResult<Integration> {
        let refused = |what: &str, mend: &str| Err(Kind::Model.error(format!("{what}; {mend}")));
        if self.method != "rk45" {
            let method: Method = method(&self.method)
                .map_err(|_| Kind::Model.error(format!("method={:?}: give 'rk45', 'rk4' or 'euler'", self.method)))?;
            return match (self.substeps, self.rtol.is_some() || self.atol.is_some()) {
                (_, true) => refused(
                    &format!("rtol and atol with method={:?}: its steps are of fixed length", self.method),
                    "leave them out, or take method='rk45'",
                ),
                (Some(0), _) => refused("substeps=0", "give 1 or more"),
                (substeps, _) => Ok(Integration::Fixed { method, substeps }),
            };
        }
        if let Some(substeps) = self.substeps {
            return refused(
                &format!("substeps={substeps} with method='rk45', which chooses its steps"),
                "give rtol and atol, or method='rk4'",
            );
        }
        let mut tolerance = Tolerance::default();
        if let Some(rtol) = self.rtol {
            if !(rtol.is_finite() && rtol > 0.0) {
                return refused(&format!("rtol={rtol}"), "give a positive number");
            }
            tolerance.relative = rtol;
        }
        if let Some(atol) = &self.atol {
            if atol.len() != states || !atol.iter().all(|atol| atol.is_finite() && *atol >= 0.0) {
                return refused(
                    &format!("atol={atol:?}"),
                    &format!("give a number of zero or more for each of {states} states"),
                );
            }
            tolerance.absolute = Some(atol.clone());
        }
        Ok(Integration::Adaptive(tolerance))
    }
}

/// Inputs of a simulation, rows x inputs or rows x inputs x points, and whether every point has its own.
///
/// `times` is their number, without those of rows that the model looks ahead at.
fn sequence(
    model: &Model,
    u: Option<&Bound<'_, PyAny>>,
    times: usize,
    course: Course,
    count: usize,
) -> PyResult<(Vec<f64>, bool)> {
    let lines = course == Course::Lines;
    // The end of the last line is a row too, and so is what the last step looks ahead at.
    let steps = times - 1 + model.stepper().ahead().max(usize::from(lines));
    let names: Vec<&str> = model.stepper().inputs().collect();
    let width = names.len();
    let Some(u) = u.filter(|u| !u.is_none()) else {
        return match width {
            0 => Ok((Vec::new(), false)),
            _ => Err(Kind::Model.error(format!("u is missing: the model has the inputs {}", names.join(", ")))),
        };
    };
    let u = Floats::of(u, "u")?;
    // A line more or less would be another course; of held rows those behind the last step say nothing.
    let enough = |rows: usize| if lines { rows == steps } else { rows >= steps };
    match u.shape.as_slice() {
        [rows] if width == 1 && enough(*rows) => Ok((u.values, false)),
        [rows, last] if *last == width && enough(*rows) => Ok((u.values, false)),
        [points, rows, last] if *last == width && enough(*rows) && *points == count => {
            let value = |i: usize| {
                let (step, rest) = (i / (width * count), i % (width * count));
                u.values[((rest % count) * rows + step) * width + rest / count]
            };
            Ok(((0..steps * width * count).map(value).collect(), true))
        }
        shape => {
            let rows = match (lines || steps >= times, steps > times) {
                (_, true) => format!("{steps} rows: of {times} times, and of those that the last step looks ahead at"),
                (true, false) => format!("{times} rows, one for each time"),
                (false, false) => format!("{times} rows, one for each time (that of the last may be missing)"),
            };
            let width = if width == 1 {
                format!("1 input ({})", names[0])
            } else {
                format!("{width} inputs ({})", names.join(", "))
            };
            Err(Kind::Model.error(format!("u has the shape {shape:?}; give the {width} in {rows}")))
        }
    }
}

/// States at the times of a grid from x0: (times, states), or (points, times, states). Then the shortfall from the
/// tolerance, in sizes of a state.
#[pyfunction]
#[pyo3(signature = (model, x0, grid, u, passing, history=None, lines=false))]
#[expect(clippy::too_many_arguments, reason = "those of the Python method")]
pub(crate) fn simulate<'py>(
    py: Python<'py>,
    model: &Model,
    x0: &Bound<'py, PyAny>,
    grid: &TimeGrid,
    u: Option<&Bound<'py, PyAny>>,
    passing: Passing,
    history: History<'py>,
    lines: bool,
) -> PyResult<(Bound<'py, PyArrayDyn<f64>>, f64)> {
    let course = if lines { Course::Lines } else { Course::Held };
    let (stepper, grid) = (model.stepper(), &grid.grid);
    let states = stepper.states().len();
    if states == 0 {
        return Err(Kind::Model.error("no equation of the model advances a state: there is nothing to simulate"));
    }
    let integration = passing.integration(states)?;
    let (mut batch, inputs) = guard(|| {
        let first = PyArray1::from_vec(py, vec![grid.times()[0]]).into_any();
        // The inputs of the first row are set with those of the others.
        let width = stepper.inputs().len();
        let none = array(py, vec![0.0; width], &[width])?.into_any();
        let batch = points(stepper, &Given { x: Some(x0), u: Some(&none), history, t: Some(&first) })?;
        let inputs = sequence(model, u, grid.intervals() + 1, course, batch.points.count())?;
        Ok((batch, inputs))
    })?;
    let (count, length) = (batch.points.count(), grid.times().len());
    let (out, shortfall) = run_any(py, None, |progress| {
        ensure_memory(
            count.saturating_mul(length).saturating_mul(8 * states),
            &format!("a simulation of {count} points over {length} times"),
            "give fewer times or points, or simulate in parts",
        )?;
        let mut out = vec![f64::NAN; count * length * states];
        let inputs = InputSequence { values: &inputs.0, by_point: inputs.1, course };
        let shortfall = stepper.simulate(&mut batch.points, grid, inputs, &integration, |step, state_values| {
            for (s, column) in state_values.chunks_exact(count.max(1)).enumerate() {
                column.iter().enumerate().for_each(|(b, &x)| out[(b * length + step) * states + s] = x);
            }
            !progress.cancelled()
        });
        Ok::<_, Failure>((out, shortfall))
    })?;
    let state_values = match batch.single {
        true => array(py, out, &[length, states])?,
        false => array(py, out, &[count, length, states])?,
    };
    Ok((state_values, shortfall))
}
