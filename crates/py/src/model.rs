//! Models: read and written, evaluated at points, exported.

use std::{path::PathBuf, sync::OnceLock};

use fleetfoot::{
    codegen::{ExportOptions, Precision, StepMethod, Target},
    dynamics::{Linearized, Method, Stepper, StepperWorkspace, Tangent},
    library::{Expr, Filter, FilterKind},
};
use numpy::{PyArray1, PyArrayDyn};
use pyo3::{prelude::*, types::PyBytes};

use crate::{
    data::Data,
    error::{Kind, OrRaise},
    points::{Given, PointBatch, Rows, array, by_point, points},
    recipe::of_json,
    run::{Failure, guard, run, run_any},
};

/// Rows that are evaluated at a time.
const TILE: usize = 1_024;

/// A model. It does not change.
#[pyclass(frozen, module = "fleetfoot._core")]
pub(crate) struct Model {
    pub(crate) model: fleetfoot::Model,
    stepper: Stepper,
    tangent: OnceLock<Tangent>,
}

type Array<'py> = Bound<'py, PyArrayDyn<f64>>;

impl Model {
    /// A model, compiled.
    pub(crate) fn new(model: fleetfoot::Model) -> PyResult<Self> {
        let stepper = Stepper::looking_ahead(&model).or_raise(Kind::Model)?;
        Ok(Self { model, stepper, tangent: OnceLock::new() })
    }

    /// The model, compiled.
    pub(crate) fn stepper(&self) -> &Stepper {
        &self.stepper
    }

    fn tangent(&self) -> PyResult<&Tangent> {
        if let Some(tangent) = self.tangent.get() {
            return Ok(tangent);
        }
        let tangent = Tangent::new(&self.stepper).or_raise(Kind::Model)?;
        Ok(self.tangent.get_or_init(|| tangent))
    }

    /// A step in seconds; the model's own where none is given.
    fn seconds(&self, dt: Option<f64>) -> PyResult<f64> {
        match dt {
            Some(dt) if dt > 0.0 && dt.is_finite() => Ok(dt),
            Some(dt) => Err(Kind::Model.error(format!("dt={dt}: give a positive number of seconds"))),
            None if self.model.step > 0.0 || !self.stepper.is_continuous() => Ok(self.model.step),
            None => Err(Kind::Model.error("dt is missing: the model does not know its sampling period")),
        }
    }

    fn linearized<'py>(
        &self,
        py: Python<'py>,
        linearizations: Vec<Linearized>,
        single: bool,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>)> {
        let (n, m) = (self.stepper.states().len(), self.stepper.inputs().len());
        let count = linearizations.len();
        let (mut a, mut b, mut c) = (Vec::new(), Vec::new(), Vec::new());
        for point in linearizations {
            a.extend(point.a);
            b.extend(point.b);
            c.extend(point.c);
        }
        let shape = |dimensions: &[usize]| if single { dimensions.to_vec() } else { [&[count], dimensions].concat() };
        Ok((array(py, a, &shape(&[n, n]))?, array(py, b, &shape(&[n, m]))?, array(py, c, &shape(&[n]))?))
    }

    /// Points that a call gives, of a model that reads nothing of later rows.
    fn point_batch(&self, given: &Given<'_, '_>) -> PyResult<PointBatch> {
        let ahead = self.stepper.ahead();
        if ahead > 0 {
            return Err(Kind::Model.error(format!(
                "the model reads inputs {ahead} row{} ahead, which a single point does not have; take predict, or simulate with the inputs of every row",
                if ahead == 1 { "" } else { "s" }
            )));
        }
        points(&self.stepper, given)
    }
}

/// Integration method of derivatives, by name.
pub(crate) fn method(name: &str) -> PyResult<Method> {
    match name {
        "rk4" => Ok(Method::Rk4),
        "euler" => Ok(Method::Euler),
        other => Err(Kind::Model.error(format!("method={other:?}: give 'rk4' or 'euler'"))),
    }
}

/// Rows before a point: states and inputs.
pub(crate) type History<'py> = Option<(Bound<'py, PyAny>, Bound<'py, PyAny>)>;

#[pymethods]
impl Model {
    /// Reads a model's file.
    #[staticmethod]
    fn read(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let model = py.detach(|| fleetfoot::Model::read(&path)).or_raise(Kind::Model)?;
        guard(|| Self::new(model))
    }

    /// Reads a model from JSON; `name` is its origin, for messages.
    #[staticmethod]
    fn from_json(text: &str, name: &str) -> PyResult<Self> {
        guard(|| Self::new(fleetfoot::Model::from_json(text, name).or_raise(Kind::Model)?))
    }

    /// The model of a network that another program trained, by a recipe (TOML).
    #[staticmethod]
    #[pyo3(signature = (path, recipe_text, data, dt))]
    fn of_network(
        py: Python<'_>,
        path: PathBuf,
        recipe_text: &str,
        data: Option<&Data>,
        dt: Option<f64>,
    ) -> PyResult<Self> {
        let imported = run(py, None, |progress| {
            let recipe = fleetfoot::Recipe::parse(recipe_text, "the recipe")?;
            fleetfoot::import_network(&path, &recipe, data.map(|data| &data.logs), dt, progress)
        })?;
        guard(|| Self::new(imported.model))
    }

    fn to_json(&self) -> String {
        self.model.to_json()
    }

    /// The linear-quadratic regulator: the text of its file.
    fn control_lqr(&self, py: Python<'_>, recipe_text: &str) -> PyResult<String> {
        let section = of_json(recipe_text)?.control;
        run(py, None, |_| fleetfoot::control_lqr(&self.model, &section).map(|made| made.to_json()))
    }

    /// The predictive controller: the text of its file.
    fn control_mpc(&self, py: Python<'_>, recipe_text: &str) -> PyResult<String> {
        let section = of_json(recipe_text)?.control;
        run(py, None, |_| fleetfoot::control_mpc(&self.model, &section).map(|made| made.to_json()))
    }

    /// Writes the model's file, whole or not at all.
    fn write(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        py.detach(|| fleetfoot::write_model(&self.model, &path)).or_raise(Kind::Write)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyBytes>,))> {
        let class = py.get_type::<Self>();
        Ok((class.getattr("_of_bytes")?, (PyBytes::new(py, self.model.to_json().as_bytes()),)))
    }

    #[staticmethod]
    fn _of_bytes(bytes: &[u8]) -> PyResult<Self> {
        Self::from_json(&String::from_utf8_lossy(bytes), "the pickle")
    }

    fn hash(&self) -> String {
        self.model.hash()
    }

    fn describe(&self, regions: usize) -> String {
        fleetfoot::describe(&self.model, regions)
    }

    /// The equations as the content of `<math>` elements, each with the name of its region if there are several, in the
    /// order of their text form.
    fn mathml(&self) -> Vec<(Option<String>, String)> {
        let set = self.model.set_equations().into_iter();
        set.map(|(region, set)| (region.map(str::to_owned), set.left + &set.terms.concat())).collect()
    }

    /// Names of the states, the inputs and the fitted equations' left sides.
    fn names(&self) -> (Vec<String>, Vec<String>, Vec<String>) {
        let owned = |name: &str| name.to_owned();
        (self.stepper.states().map(owned).collect(), self.stepper.inputs().map(owned).collect(), self.model.outputs())
    }

    /// Rows that the equations look back; true if they contain the time; true if a derivative is integrated; and the
    /// sampling period.
    fn facts(&self) -> (usize, bool, bool, f64) {
        (self.stepper.history(), self.stepper.uses_time(), self.stepper.is_continuous(), self.model.step)
    }

    /// Rows that the equations look ahead at inputs.
    fn ahead(&self) -> usize {
        self.stepper.ahead()
    }

    /// The same model, whose columns are read as they are: by their own names, from a table that holds them.
    fn over_named_columns(&self) -> PyResult<Self> {
        let mut model = self.model.clone();
        let closed = model.closed(model.step, &[]).or_raise(Kind::Model)?;
        for column in &mut model.columns {
            // Computed columns are computed from the columns of the table.
            let computed = closed.computed.iter().find(|(name, _)| *name == column.name);
            let lag = closed.lags.iter().find(|lag| lag.equation.subject == column.name);
            let source = match (computed, lag) {
                (Some((_, definition)), _) => definition.clone(),
                (None, Some(lag)) => {
                    let constant = Expr::number(lag.constant);
                    Filter::new(FilterKind::Lag1, lag.equation.right.clone(), constant).column()
                }
                (None, None) => Expr::column(column.name.as_str()),
            };
            column.source = source.to_string();
        }
        Self::new(model)
    }

    /// The states one step later.
    #[pyo3(signature = (x, u=None, dt=None, method_name="rk4", history=None, t=None))]
    #[expect(clippy::too_many_arguments, reason = "those of the Python method")]
    fn step<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        u: Option<&Bound<'py, PyAny>>,
        dt: Option<f64>,
        method_name: &str,
        history: History<'py>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array<'py>> {
        let (method, seconds) = (method(method_name)?, self.seconds(dt)?);
        guard(|| {
            let mut batch = self.point_batch(&Given { x: Some(x), u, history, t })?;
            let mut workspace = StepperWorkspace::default();
            let next = match batch.points.count() {
                0..TILE => self.stepper.next(&mut batch.points, seconds, method, &mut workspace).to_vec(),
                _ => py.detach(|| self.stepper.next(&mut batch.points, seconds, method, &mut workspace).to_vec()),
            };
            by_point(py, &next, self.stepper.states().len(), &batch)
        })
    }

    /// The right sides of the states' equations.
    #[pyo3(signature = (x, u=None, history=None, t=None))]
    fn right_sides<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        u: Option<&Bound<'py, PyAny>>,
        history: History<'py>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Array<'py>> {
        guard(|| {
            let batch = self.point_batch(&Given { x: Some(x), u, history, t })?;
            let (count, states) = (batch.points.count(), self.stepper.states().len());
            let mut workspace = StepperWorkspace::default();
            py.detach(|| self.stepper.evaluate(&batch.points, &mut workspace));
            let values: Vec<f64> =
                (0..states).flat_map(|state| self.stepper.right_side(state, count, &workspace).to_vec()).collect();
            by_point(py, &values, states, &batch)
        })
    }

    /// Predictions for the consecutive rows of a run (rows x fitted equations), and the regions; NaN and -1 at a row
    /// without a past.
    #[pyo3(signature = (x=None, u=None, t=None))]
    fn fitted<'py>(
        &self,
        py: Python<'py>,
        x: Option<&Bound<'py, PyAny>>,
        u: Option<&Bound<'py, PyAny>>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Array<'py>, Bound<'py, PyArray1<i64>>)> {
        let rows = guard(|| Rows::of(&self.stepper, &Given { x, u, history: None, t }))?;
        let targets = self.stepper.targets();
        let (values, regions) = run_any(py, None, |progress| {
            let (mut values, mut regions) = (vec![f64::NAN; rows.count * targets], Vec::with_capacity(rows.count));
            let mut workspace = StepperWorkspace::default();
            for from in (0..rows.count).step_by(TILE) {
                if progress.cancelled() {
                    break;
                }
                let to = (from + TILE).min(rows.count);
                self.stepper.evaluate(&rows.points(&self.stepper, from..to), &mut workspace);
                for target in 0..targets {
                    let fitted_values = self.stepper.fitted(target, to - from, &workspace);
                    fitted_values
                        .iter()
                        .enumerate()
                        .for_each(|(at, &value)| values[(from + at) * targets + target] = value);
                }
                let regions_of_rows = self.stepper.regions(&workspace);
                let known = |at: usize| {
                    regions_of_rows.get(at).copied().unwrap_or(if regions_of_rows.is_empty() { 0 } else { u32::MAX })
                };
                regions.extend((0..to - from).map(|at| region(known(at))));
            }
            Ok::<_, Failure>((values, regions))
        })?;
        Ok((array(py, values, &[rows.count, targets])?, PyArray1::from_vec(py, regions)))
    }

    /// The region of every point; -1 for none.
    #[pyo3(signature = (x, u=None, history=None, t=None))]
    fn regions<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        u: Option<&Bound<'py, PyAny>>,
        history: History<'py>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Bound<'py, PyArray1<i64>>, bool)> {
        guard(|| {
            let batch = self.point_batch(&Given { x: Some(x), u, history, t })?;
            let mut workspace = StepperWorkspace::default();
            py.detach(|| self.stepper.evaluate(&batch.points, &mut workspace));
            let mut regions: Vec<i64> = self.stepper.regions(&workspace).iter().map(|&index| region(index)).collect();
            regions.resize(batch.points.count(), 0);
            Ok((PyArray1::from_vec(py, regions), batch.single))
        })
    }

    /// A, B and c of the equations, or with `dt` of a step.
    #[pyo3(signature = (x, u=None, dt=None, method_name="rk4", history=None, t=None))]
    #[expect(clippy::too_many_arguments, reason = "those of the Python method")]
    fn linearize<'py>(
        &self,
        py: Python<'py>,
        x: &Bound<'py, PyAny>,
        u: Option<&Bound<'py, PyAny>>,
        dt: Option<f64>,
        method_name: &str,
        history: History<'py>,
        t: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<(Array<'py>, Array<'py>, Array<'py>)> {
        let (method, seconds) = (method(method_name)?, dt.map(|dt| self.seconds(Some(dt))).transpose()?);
        guard(|| {
            let mut batch = self.point_batch(&Given { x: Some(x), u, history, t })?;
            let tangent = self.tangent()?;
            let mut workspace = StepperWorkspace::default();
            let linearizations = py.detach(|| match seconds {
                None => tangent.linearize(&self.stepper, &batch.points, &mut workspace),
                Some(seconds) => {
                    tangent.linearize_step(&self.stepper, &mut batch.points, seconds, method, &mut workspace)
                }
            });
            self.linearized(py, linearizations, batch.single)
        })
    }

    /// Writes the model in another language into a folder. Returns the files, the number of compared points, and the
    /// cost of the code (JSON).
    #[pyo3(signature = (target, folder, prefix="model", precision="double", method_name="rk4", dt=None, domain=true))]
    #[expect(clippy::too_many_arguments, reason = "those of the Python method")]
    fn export(
        &self,
        py: Python<'_>,
        target: &str,
        folder: PathBuf,
        prefix: &str,
        precision: &str,
        method_name: &str,
        dt: Option<f64>,
        domain: bool,
    ) -> PyResult<(Vec<PathBuf>, usize, Vec<String>)> {
        let mut options = export_options(target, prefix, precision, method_name)?;
        options.discretize = dt;
        options.domain = domain;
        let exported = run(py, None, |_| fleetfoot::export(&self.model, &options, &folder, &[]))?;
        let cost = exported.cost.as_ref().map_or_else(Vec::new, |cost| cost.lines());
        Ok((exported.files, exported.compared, cost))
    }
}

/// Options of an export.
fn export_options(target: &str, prefix: &str, precision: &str, method_name: &str) -> PyResult<ExportOptions> {
    let mut options = ExportOptions::new(match target {
        "c" => Target::C,
        "rust" => Target::Rust,
        "python" => Target::Python,
        "latex" => Target::Latex,
        "npz" => Target::Npz,
        "onnx" => Target::Onnx,
        other => {
            return Err(
                Kind::Model.error(format!("to={other:?}: give 'c', 'rust', 'python', 'latex', 'npz' or 'onnx'"))
            );
        }
    });
    options.precision = match precision {
        "double" => Precision::Double,
        "float" => Precision::Float,
        other => return Err(Kind::Model.error(format!("precision={other:?}: give 'double' or 'float'"))),
    };
    options.method = match method(method_name)? {
        Method::Euler => StepMethod::Euler,
        Method::Rk4 => StepMethod::Rk4,
    };
    options.prefix = prefix.to_owned();
    Ok(options)
}

/// Writes the filter of a model as C into a folder, by the recipe's `[filter]`. Returns the files.
#[pyfunction]
pub(crate) fn export_filter(
    py: Python<'_>,
    model: &Model,
    recipe_text: &str,
    folder: PathBuf,
    prefix: &str,
    precision: &str,
) -> PyResult<Vec<PathBuf>> {
    let options = export_options("c", prefix, precision, "rk4")?;
    let recipe = of_json(recipe_text)?;
    run(py, None, |_| fleetfoot::export_filter(&model.model, &recipe.filter, &options, &folder, &[]))
}

/// The text of a controller's file, once it is read without a mistake; `name` is the file's, for messages.
#[pyfunction]
pub(crate) fn check_controller(text: &str, name: &str) -> PyResult<String> {
    guard(|| {
        fleetfoot::ControllerFile::from_json(text, name).or_raise(Kind::Model)?;
        Ok(text.to_owned())
    })
}

/// Writes a controller, the text of its file, whole or not at all.
#[pyfunction]
pub(crate) fn write_controller(py: Python<'_>, text: &str, path: PathBuf) -> PyResult<()> {
    run(py, None, |_| fleetfoot::controller_file(text)?.write(&path))
}

/// Writes a controller, the text of its file, in another language into a folder. Returns the files.
#[pyfunction]
pub(crate) fn export_controller(
    py: Python<'_>,
    text: &str,
    target: &str,
    folder: PathBuf,
    prefix: &str,
    precision: &str,
) -> PyResult<Vec<PathBuf>> {
    let mut options = export_options(target, prefix, precision, "rk4")?;
    options.domain = false;
    let exported =
        run(py, None, |_| fleetfoot::export_controller(&fleetfoot::controller_file(text)?, &options, &folder, &[]))?;
    Ok(exported.files)
}

/// A region's number; -1 for none.
pub(crate) fn region(index: u32) -> i64 {
    if index == u32::MAX { -1 } else { i64::from(index) }
}
