//! A model region by region: its submodels, linearised about any point.

use faer::Mat;
use fleetfoot_data::packed;
use fleetfoot_dynamics::{Linearized, Points, Stepper, StepperWorkspace, Tangent, nothing_to_advance};
use fleetfoot_model::{Model, Partition, Prediction, RegionSummary};

use crate::{
    Error,
    control_error::ControlError,
    linear::{exponential, of_rows},
};

/// The submodels of a model.
pub(crate) struct Pieces {
    pub(crate) regions: Vec<Piece>,
    /// All regions together.
    pub(crate) whole: Stepper,
    pub(crate) states: Vec<String>,
    pub(crate) inputs: Vec<String>,
    /// True if derivatives are integrated.
    pub(crate) continuous: bool,
    /// Mean and standard deviation of the states in training, then of the inputs, where they are known.
    pub(crate) seen: Vec<Option<[f64; 2]>>,
    /// Index of the partition whose regions they are.
    pub(crate) partition: Option<usize>,
}

/// The submodel of a region.
pub(crate) struct Piece {
    pub(crate) name: String,
    pub(crate) rows: u64,
    /// The standard error of its prediction of a state's derivative (next value), the root of the mean square over its
    /// training rows. It is 0 if the equation is given or nothing is known.
    pub(crate) doubt: Vec<f64>,
    stepper: Stepper,
    tangent: Tangent,
    /// The place of the submodel's inputs among the model's.
    places: Vec<usize>,
}

/// A step `x+ = A x + B u + c`.
#[derive(Debug, Clone)]
pub(crate) struct Affine {
    pub(crate) a: Mat<f64>,
    pub(crate) b: Mat<f64>,
    pub(crate) c: Vec<f64>,
}

impl Pieces {
    pub(crate) fn new(model: &Model) -> Result<Self, Error> {
        let whole = Stepper::new(model)?;
        let states: Vec<String> = whole.states().map(str::to_owned).collect();
        let inputs: Vec<String> = whole.inputs().map(str::to_owned).collect();
        if states.is_empty() {
            return Err(nothing_to_advance(model).into());
        }
        if whole.history() > 0 || whole.uses_time() || whole.has_lags() {
            return Err(ControlError::Memory.into());
        }
        let continuous = whole.is_continuous();
        if whole.is_mixed() {
            return Err(ControlError::Mixed.into());
        }
        let partition = divided(model)?;
        let count = partition.map_or(1, |index| model.partitions[index].rule.count());
        let piece = |region: usize| {
            let part = partition.map_or_else(|| model.clone(), |partition| submodel(model, partition, region));
            let stepper = Stepper::new(&part)?;
            let tangent = Tangent::new(&stepper)?;
            let place = |name: &str| inputs.iter().position(|input| input == name);
            let places = stepper.inputs().map(|name| place(name).unwrap_or(usize::MAX)).collect();
            let described = partition.or((model.partitions.len() == 1).then_some(0));
            let about = described.and_then(|index| model.summaries[index].regions.get(region));
            let name = about.map_or_else(|| "all".to_owned(), |about| about.name.clone());
            let doubt = about.map_or_else(|| vec![0.0; states.len()], |about| doubt(model, &states, about));
            Ok(Piece { name, rows: about.map_or(1, |about| about.rows), doubt, stepper, tangent, places })
        };
        let regions = (0..count).map(piece).collect::<Result<Vec<_>, Error>>()?;
        let names: Vec<&String> = states.iter().chain(&inputs).collect();
        let seen = names.iter().map(|name| seen(model, name)).collect();
        Ok(Self { regions, whole, states, inputs, continuous, seen, partition })
    }

    /// Typical size of a state or, behind these, an input: its standard deviation in training; 1 if that is unknown.
    pub(crate) fn size(&self, variable: usize) -> f64 {
        let known = if variable < self.states.len() { self.whole.state_size(variable) } else { 1.0 };
        self.seen[variable].map_or(known, |[_, deviation]| if deviation > 0.0 { deviation } else { known })
    }

    /// The region of a point by the partition of the whole model.
    pub(crate) fn region(&self, x: &[f64], u: &[f64]) -> Option<usize> {
        if self.regions.len() == 1 {
            return Some(0);
        }
        let (mut points, mut workspace) = (self.whole.points(1), StepperWorkspace::default());
        (0..x.len()).for_each(|s| points.column_mut(self.whole.state_column(s), 0)[0] = x[s]);
        (0..u.len()).for_each(|i| points.column_mut(self.whole.input_column(i), 0)[0] = u[i]);
        self.whole.evaluate(&points, &mut workspace);
        self.whole.regions(&workspace).first().filter(|&&region| region != u32::MAX).map(|&region| region as usize)
    }
}

impl Piece {
    /// The derivatives of a continuous submodel, the next states of a discrete one, to first order at a point.
    pub(crate) fn linearized(&self, x: &[f64], u: &[f64]) -> Affine {
        let linearized = self.tangent.linearize(&self.stepper, &self.points(x, u), &mut StepperWorkspace::default());
        self.spread(linearized, x.len(), u.len())
    }

    fn points(&self, x: &[f64], u: &[f64]) -> Points {
        let mut points = self.stepper.points(1);
        (0..x.len()).for_each(|s| points.column_mut(self.stepper.state_column(s), 0)[0] = x[s]);
        for (i, &place) in self.places.iter().enumerate() {
            points.column_mut(self.stepper.input_column(i), 0)[0] = u.get(place).copied().unwrap_or(0.0);
        }
        points
    }

    /// With the inputs of the model in the place of those that the submodel reads.
    fn spread(&self, linearized: Vec<Linearized>, n: usize, m: usize) -> Affine {
        let Some(Linearized { a, b, c, .. }) = linearized.into_iter().next() else {
            return Affine { a: Mat::zeros(0, 0), b: Mat::zeros(0, 0), c: Vec::new() };
        };
        let of_inputs = of_rows(n, self.places.len(), &b);
        let mut all = Mat::zeros(n, m);
        for (i, &place) in self.places.iter().enumerate().filter(|(_, place)| **place < m) {
            (0..n).for_each(|row| all[(row, place)] = of_inputs[(row, i)]);
        }
        Affine { a: of_rows(n, n, &a), b: all, c }
    }
}

impl Affine {
    /// From derivatives to the step of `period` seconds with inputs held.
    pub(crate) fn held(&self, period: f64) -> Self {
        let (n, m) = self.b.shape();
        let generator = Mat::from_fn(n + m + 1, n + m + 1, |i, j| match () {
            () if i >= n => 0.0,
            () if j < n => period * self.a[(i, j)],
            () if j < n + m => period * self.b[(i, j - n)],
            () => period * self.c[i],
        });
        let all = exponential(generator.as_ref());
        Self {
            a: Mat::from_fn(n, n, |i, j| all[(i, j)]),
            b: Mat::from_fn(n, m, |i, j| all[(i, n + j)]),
            c: (0..n).map(|i| all[(i, n + m)]).collect(),
        }
    }

    /// `A x + B u + c`.
    pub(crate) fn at(&self, x: &[f64], u: &[f64]) -> Vec<f64> {
        let row = |i: usize| {
            let states: f64 = x.iter().enumerate().map(|(j, x)| self.a[(i, j)] * x).sum();
            let inputs: f64 = u.iter().enumerate().map(|(j, u)| self.b[(i, j)] * u).sum();
            states + inputs + self.c[i]
        };
        (0..self.c.len()).map(row).collect()
    }
}

/// The one partition in use that has more than a region; `None` where there is none.
fn divided(model: &Model) -> Result<Option<usize>, Error> {
    let many = |&index: &usize| {
        model.partitions[index].rule.count() > 1 && model.latents.iter().any(|latent| latent.partition == index)
    };
    let mut candidates = (0..model.partitions.len()).filter(many);
    let first = candidates.next();
    if candidates.next().is_some() {
        return Err(ControlError::Partitions.into());
    }
    Ok(first)
}

/// The model as it is in a region, everywhere.
fn submodel(model: &Model, partition: usize, region: usize) -> Model {
    let mut copy = model.clone();
    for latent in copy.latents.iter_mut().filter(|latent| latent.partition == partition) {
        latent.map.keep_region(region);
        // The submodel holds wherever the filter or the regulator is: its linear algebra has no borders.
        latent.beyond.clear();
    }
    let regions = model.summaries[partition].regions[region].clone();
    copy.partitions[partition] = Partition::whole();
    copy.summaries[partition] = vec![regions].into();
    copy
}

/// Standard errors of a region's least squares, by state. The leverages of n rows in a regression of p numbers add up
/// to p, so that the variance of a prediction is `s^2 p / n` in their mean.
fn doubt(model: &Model, states: &[String], about: &RegionSummary) -> Vec<f64> {
    let (rows, spent) = (about.rows as f64, about.rank as f64 + 1.0);
    let mut doubt = vec![0.0; states.len()];
    for (target, equation) in model.fitted().enumerate() {
        let state = states.iter().position(|state| *state == equation.subject);
        if let Some(state) = state.filter(|_| equation.prediction != Prediction::Value && rows > spent) {
            let square = about.residual_covariance.get(packed(target, target)).copied().unwrap_or(f64::NAN);
            let error = (square * spent / (rows - spent)).sqrt();
            doubt[state] = if error.is_finite() { error } else { 0.0 };
        }
    }
    doubt
}

/// Mean and standard deviation of a column over the training rows of all regions, where it is a function of the first latent's library.
fn seen(model: &Model, name: &str) -> Option<[f64; 2]> {
    let latent = model.latents.first()?;
    let functions = model.libraries.get(latent.library)?;
    let j = functions.iter().position(|function| function.as_column() == Some(name))?;
    let regions = &model.summaries.get(latent.partition)?.regions;
    let rows: f64 = regions.iter().map(|region| region.rows as f64).sum();
    let over = |value: &dyn Fn(&RegionSummary) -> f64| {
        regions.iter().map(|region| region.rows as f64 * value(region)).sum::<f64>() / rows
    };
    let mean = over(&|region| region.mean[j]);
    let variance = over(&|region| region.covariance[packed(j, j)] + (region.mean[j] - mean).powi(2));
    (mean.is_finite() && variance.is_finite()).then(|| [mean, variance.max(0.0).sqrt()])
}
