//! Points of a model as numpy arrays: read, and given back.

use fleetfoot::dynamics::{Points, Stepper};
use numpy::{PyArray1, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods, ndarray::IxDyn};
use pyo3::prelude::*;

use crate::{array::plain, error::Kind};

/// Numbers of an array in the order of its indices, and its shape.
pub(crate) struct Floats {
    pub(crate) values: Vec<f64>,
    pub(crate) shape: Vec<usize>,
}

impl Floats {
    /// Reads an array of any order of memory, any strides and any type of number, or an object that becomes one; `what`
    /// is the argument's name.
    pub(crate) fn of(object: &Bound<'_, PyAny>, what: &str) -> PyResult<Self> {
        // A stride of other than whole numbers is one of a field among others.
        let as_it_lies = object.cast_exact::<PyArrayDyn<f64>>().ok().filter(|array| {
            array.data().is_aligned() && array.strides().iter().all(|stride| stride.unsigned_abs().is_multiple_of(8))
        });
        let array = match as_it_lies {
            Some(array) => array.clone(),
            None => plain(object, what, "floats")?.cast_into::<PyArrayDyn<f64>>()?,
        };
        // Of an array in the order of C, and no other, the memory is the order of the indices.
        let values = match array.is_c_contiguous() {
            true => array.to_vec()?,
            false => array.readonly().as_array().iter().copied().collect(),
        };
        Ok(Self { values, shape: array.shape().to_vec() })
    }

    /// The argument, or nothing of this width where it was not given.
    fn or_none(object: Option<&Bound<'_, PyAny>>, what: &str) -> PyResult<Option<Self>> {
        object.filter(|object| !object.is_none()).map(|object| Self::of(object, what)).transpose()
    }
}

/// Arguments of a call at points.
pub(crate) struct Given<'a, 'py> {
    pub(crate) x: Option<&'a Bound<'py, PyAny>>,
    pub(crate) u: Option<&'a Bound<'py, PyAny>>,
    /// Earlier rows of x and of u, the oldest first.
    pub(crate) history: Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>,
    pub(crate) t: Option<&'a Bound<'py, PyAny>>,
}

/// Points, and whether the caller gave one without a batch around it.
pub(crate) struct PointBatch {
    pub(crate) points: Points,
    pub(crate) single: bool,
}

/// Values of states or inputs at points: (width), (points, width), or with rows in between.
struct Block {
    values: Vec<f64>,
    /// True if every point has separate values.
    by_point: bool,
    rows: usize,
    width: usize,
}

impl Block {
    fn at(&self, point: usize, row: usize, index: usize) -> f64 {
        let point = if self.by_point { point } else { 0 };
        self.values[(point * self.rows + row) * self.width + index]
    }
}

fn names<'a>(names: impl Iterator<Item = &'a str>) -> String {
    names.collect::<Vec<_>>().join(", ")
}

/// The number of points that an argument of shape (width) or (points, width) gives; `None` for the first.
fn points_of(given: Option<&Floats>, what: &str, width: usize, column_names: &str) -> PyResult<Option<usize>> {
    let Some(given) = given else {
        return match width {
            0 => Ok(None),
            _ => Err(Kind::Model.error(format!("{what} is missing: give {width} values ({column_names})"))),
        };
    };
    match given.shape.as_slice() {
        // A number, where the model has but one.
        [] if width == 1 => Ok(None),
        [last] if *last == width => Ok(None),
        [count] if width == 1 => Ok(Some(*count)),
        [count, last] if *last == width => Ok(Some(*count)),
        shape => Err(Kind::Model.error(format!(
            "{what} has the shape {shape:?}; the model has {width} ({column_names}): give ({width},), or as many for each point, (points, {width})"
        ))),
    }
}

/// Earlier rows, of shape (rows, width) or (points, rows, width).
fn past(given: Option<Floats>, what: &str, needed: usize, count: usize, width: usize) -> PyResult<Block> {
    let shape = |shape: &[usize]| {
        Kind::Model.error(format!(
            "history: {what} has the shape {shape:?}; give the {needed} rows before the points, the oldest first: ({needed}, {width}), or ({count}, {needed}, {width})"
        ))
    };
    let Some(given) = given else {
        return match needed * width {
            0 => Ok(Block { values: Vec::new(), by_point: false, rows: 0, width }),
            _ => Err(shape(&[])),
        };
    };
    match given.shape.as_slice() {
        [rows, last] if *last == width && *rows >= needed => {
            Ok(Block { values: given.values, by_point: false, rows: *rows, width })
        }
        [points, rows, last] if *last == width && *rows >= needed && *points == count => {
            Ok(Block { values: given.values, by_point: true, rows: *rows, width })
        }
        _ if width == 0 => Ok(Block { values: Vec::new(), by_point: false, rows: 0, width }),
        other => Err(shape(other)),
    }
}

/// Points that do not depend on each other, each with its own past where the model looks back.
pub(crate) fn points(stepper: &Stepper, given: &Given<'_, '_>) -> PyResult<PointBatch> {
    let (x, u) = (Floats::or_none(given.x, "x")?, Floats::or_none(given.u, "u")?);
    let (states, inputs) = (stepper.states().len(), stepper.inputs().len());
    let of_x = points_of(x.as_ref(), "x", states, &names(stepper.states()))?;
    let of_u = points_of(u.as_ref(), "u", inputs, &names(stepper.inputs()))?;
    let count = match (of_x, of_u) {
        (Some(x), Some(u)) if x != u => {
            return Err(Kind::Model.error(format!("x has {x} points and u has {u}; give as many, or one u for all")));
        }
        (x, u) => x.or(u).unwrap_or(1),
    };
    let block = |given: Option<Floats>, expected_rows: Option<usize>, width| Block {
        values: given.map_or_else(Vec::new, |given| given.values),
        by_point: expected_rows.is_some(),
        rows: 1,
        width,
    };
    let present = [block(x, of_x, states), block(u, of_u, inputs)];
    let needed = stepper.history();
    let (px, pu) = match &given.history {
        None if needed > 0 => {
            return Err(Kind::Model.error(format!(
                "history is missing: the model looks {needed} rows back; give history=(x_past, u_past), the rows before the points, the oldest first, \
                 of shape ({needed}, {states}) and ({needed}, {inputs})"
            )));
        }
        None => (None, None),
        Some((x, u)) => (Floats::or_none(Some(x), "history: x")?, Floats::or_none(Some(u), "history: u")?),
    };
    let before = [past(px, "x", needed, count, states)?, past(pu, "u", needed, count, inputs)?];
    let mut points = stepper.points(count);
    for (kind, width) in [states, inputs].into_iter().enumerate() {
        for i in 0..width {
            let column = if kind == 0 { stepper.state_column(i) } else { stepper.input_column(i) };
            for lag in 0..=needed {
                for (b, value) in points.column_mut(column, lag).iter_mut().enumerate() {
                    *value = match lag {
                        0 => present[kind].at(b, 0, i),
                        _ => before[kind].at(b, before[kind].rows - lag, i),
                    };
                }
            }
        }
    }
    set_time(stepper, &mut points, given.t)?;
    Ok(PointBatch { points, single: of_x.is_none() && of_u.is_none() })
}

/// Sets the time of the points; that of earlier rows is a step of the model's earlier each.
fn set_time(stepper: &Stepper, points: &mut Points, t: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
    let Some(t) = Floats::or_none(t, "t")? else {
        return match stepper.uses_time() {
            true => Err(Kind::Model.error(
                "t is missing: the model's equations contain time; give seconds since the start of the episode",
            )),
            false => Ok(()),
        };
    };
    let count = points.count();
    if t.values.len() != 1 && t.values.len() != count {
        return Err(Kind::Model.error(format!("t has {} values for {count} points", t.values.len())));
    }
    for lag in 0..=points.history() {
        for (b, seconds) in points.seconds_mut(lag).iter_mut().enumerate() {
            *seconds = t.values[if t.values.len() == 1 { 0 } else { b }] - lag as f64 * stepper.step();
        }
    }
    Ok(())
}

/// Consecutive rows of a run: x of shape (rows, states), u of shape (rows, inputs).
pub(crate) struct Rows {
    x: Vec<f64>,
    u: Vec<f64>,
    t: Vec<f64>,
    states: usize,
    inputs: usize,
    /// Number of rows.
    pub(crate) count: usize,
}

impl Rows {
    /// Reads a run; `t` is needed if the model contains the time.
    pub(crate) fn of(stepper: &Stepper, given: &Given<'_, '_>) -> PyResult<Self> {
        let (x, u) = (Floats::or_none(given.x, "x")?, Floats::or_none(given.u, "u")?);
        let (states, inputs) = (stepper.states().len(), stepper.inputs().len());
        let of_x = points_of(x.as_ref(), "x", states, &names(stepper.states()))?;
        let of_u = points_of(u.as_ref(), "u", inputs, &names(stepper.inputs()))?;
        let count = match (of_x, of_u) {
            (Some(x), Some(u)) if x != u => {
                return Err(Kind::Model.error(format!("x has {x} rows and u has {u}; a run has as many of both")));
            }
            // A vector of one number is one row too.
            (None, Some(1)) | (Some(1), None) => 1,
            (None, Some(_)) if states > 0 => {
                return Err(Kind::Model.error("x is one row and u has several; a run has as many of both"));
            }
            (Some(_), None) if inputs > 0 => {
                return Err(Kind::Model.error("u is one row and x has several; a run has as many of both"));
            }
            (x, u) => x.or(u).unwrap_or(1),
        };
        let t = match Floats::or_none(given.t, "t")? {
            None if stepper.uses_time() => (0..count).map(|row| row as f64 * stepper.step()).collect(),
            None => Vec::new(),
            Some(t) if t.values.len() == count => t.values,
            Some(t) => return Err(Kind::Model.error(format!("t has {} values for {count} rows", t.values.len()))),
        };
        let values = |given: Option<Floats>| given.map_or_else(Vec::new, |given| given.values);
        Ok(Self { x: values(x), u: values(u), t, states, inputs, count })
    }

    /// Some rows as points; rows before the first are NaN.
    pub(crate) fn points(&self, stepper: &Stepper, rows: std::ops::Range<usize>) -> Points {
        let mut points = stepper.points(rows.len());
        let parts = [(&self.x, self.states), (&self.u, self.inputs)];
        for lag in 0..=stepper.history() {
            for (kind, (values, width)) in parts.iter().enumerate() {
                for i in 0..*width {
                    let column = if kind == 0 { stepper.state_column(i) } else { stepper.input_column(i) };
                    for (value, row) in points.column_mut(column, lag).iter_mut().zip(rows.clone()) {
                        *value = row.checked_sub(lag).map_or(f64::NAN, |row| values[row * width + i]);
                    }
                }
            }
            if !self.t.is_empty() {
                for (value, row) in points.seconds_mut(lag).iter_mut().zip(rows.clone()) {
                    *value = row.checked_sub(lag).map_or(f64::NAN, |row| self.t[row]);
                }
            }
        }
        for ahead in 1..=stepper.ahead() {
            for i in 0..self.inputs {
                let later = points.ahead_mut(stepper.input_column(i), ahead).iter_mut().zip(rows.clone());
                later.for_each(|(value, row)| {
                    let row = row + ahead;
                    *value = if row < self.count { self.u[row * self.inputs + i] } else { f64::NAN };
                });
            }
        }
        points
    }
}

/// Columns of points (width x points) as an array (points, width), or (width) for a single point.
pub(crate) fn by_point<'py>(
    py: Python<'py>,
    columns: &[f64],
    width: usize,
    batch: &PointBatch,
) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    let count = batch.points.count();
    if batch.single {
        return array(py, columns.to_vec(), &[width]);
    }
    let values =
        (0..count).flat_map(|b| (0..width).map(move |i| (i, b))).map(|(i, b)| columns[i * count + b]).collect();
    array(py, values, &[count, width])
}

/// An array of this shape.
pub(crate) fn array<'py>(py: Python<'py>, values: Vec<f64>, shape: &[usize]) -> PyResult<Bound<'py, PyArrayDyn<f64>>> {
    PyArray1::from_vec(py, values).reshape(IxDyn(shape))
}
