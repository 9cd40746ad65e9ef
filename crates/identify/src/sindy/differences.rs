//! Derivatives by central differences: how large their errors are, and the order that the data ask for.

use fleetfoot_data::Source;
use fleetfoot_library::{CentralDifference, Expr, REACHES, Spacing, unevenness};
use fleetfoot_model::Equation;
use fleetfoot_sparse::system::sampled_mean_squares;
use serde::Serialize;

use super::{EquationTask, FittedEquation};
use crate::Error;

/// A central difference that a derivative is measured by.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Difference {
    /// Which one.
    pub form: CentralDifference,
    /// Whether the data may choose its order.
    pub any_order: bool,
    /// Whether its weights may follow the stamps: it was asked for by a word, not written out.
    pub any_spacing: bool,
    /// What the data say of its error; `None` before they are seen, and where no row has enough neighbours.
    pub errors: Option<DifferenceErrors>,
}

/// Estimated errors of central differences, root mean squares over a sample of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct DifferenceErrors {
    /// The order that is used.
    pub order: usize,
    /// What the differences of order 2, 4 and 6 err by.
    #[serde(rename = "rms_by_order")]
    pub by_order: [f64; 3],
    /// The part of the error of the order used that is there without noise.
    #[serde(rename = "truncation_rms")]
    pub truncation: f64,
    /// The part that noise of the samples makes, if it is white.
    #[serde(rename = "noise_rms")]
    pub noise: f64,
}

impl DifferenceErrors {
    /// Of the order that is used: the errors of orders 2, 4 and 6, then its own truncation and noise.
    pub(crate) fn new(order: usize, by_order: [f64; 3], [truncation, noise]: [f64; 2]) -> Self {
        Self { order, by_order, truncation, noise }
    }
}

/// What the data settled of a central difference.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SettledDifference {
    /// Rows to either side that it takes, 1 to 3; its order is twice that.
    pub reach: usize,
    /// How the stamps lie.
    pub spacing: Spacing,
    /// What the data say of its error.
    pub errors: Option<DifferenceErrors>,
}

/// Unevenness of the stamps (root mean square) up to which the weights of even ones are right: what they neglect is smaller than the derivative by that much.
const EVEN: f64 = 1e-4;

impl Difference {
    /// The difference that is measured by, where it is a central one. `said`: what a word says, else it is looked for in what was written.
    pub(super) fn of(said: Option<CentralDifference>, any_order: bool, measured: &Expr) -> Option<Self> {
        let any_spacing = said.is_some();
        let form = said.or_else(|| CentralDifference::recognised(measured))?;
        Some(Self { form, any_order, any_spacing, errors: None })
    }

    /// What tells its error: the truncation of every order, then the noise.
    fn witnesses(&self) -> impl Iterator<Item = Expr> {
        let truncations = REACHES.map(|reach| self.form.with_reach(reach).truncation());
        truncations.into_iter().chain([self.form.noise()])
    }

    /// Settles the order by mean squares of the witnesses.
    fn settle(&mut self, squares: &[f64]) {
        let noise = squares[REACHES.len()];
        let parts = REACHES.map(|reach| {
            let of_noise = noise * CentralDifference::amplification_of_truncation(reach);
            [(squares[reach - 1] - of_noise).max(0.0), noise * CentralDifference::amplification(reach)]
        });
        let total = |reach: usize| parts[reach - 1].iter().sum::<f64>();
        if self.any_order {
            let least = REACHES.into_iter().min_by(|&a, &b| total(a).total_cmp(&total(b)));
            self.form.reach = least.unwrap_or(self.form.reach);
        }
        let [truncation, noise] = parts[self.form.reach - 1].map(f64::sqrt);
        let by_order = REACHES.map(|reach| total(reach).sqrt());
        self.errors = Some(DifferenceErrors { order: self.form.order(), by_order, truncation, noise });
    }
}

impl FittedEquation {
    /// Measures the left side by another expression.
    pub(super) fn measure(&mut self, measured: Expr) {
        self.target = match &self.nominal {
            Some(nominal) => (&measured - nominal).simplified(),
            None => measured.clone(),
        };
        self.measured = measured;
    }
}

impl EquationTask {
    /// Estimates the errors of the central differences from a sample of the rows, and takes the order with the least error where it is free. Weights follow the stamps
    /// where these are uneven.
    ///
    /// # Errors
    /// Those of reading.
    pub(super) fn differentiated(&self, source: &dyn Source, notes: &mut Vec<String>) -> Result<Self, Error> {
        let mut task = self.clone();
        let columns = source.columns();
        let known = |central: &Difference| {
            central.form.of.columns().iter().all(|name| columns.iter().any(|column| column.name == **name))
        };
        let own = task.fitted.iter().enumerate().filter_map(|(at, equation)| Some((at, equation.central.clone()?)));
        let mut found: Vec<(usize, Difference)> = own.filter(|(_, central)| known(central)).collect();
        if found.is_empty() {
            return Ok(task);
        }
        let uneven = sampled_mean_squares(&[unevenness()], source)?[0].sqrt() > EVEN;
        let spacing = if uneven { Spacing::Stamps } else { Spacing::Even };
        found.iter_mut().filter(|(_, own)| own.any_spacing).for_each(|(_, own)| own.form.spacing = spacing);
        // The mean square of 1 tells whether any row has what all the others need.
        let witnesses = found.iter().flat_map(|(_, central)| central.witnesses()).chain([Expr::number(1.0)]);
        let squares = sampled_mean_squares(&witnesses.collect::<Vec<_>>(), source)?;
        let measured = squares.last().is_some_and(|&one| one > 0.0);
        if !measured {
            notes.push(
                "derivatives by central differences: their error is not known, because no row has five complete neighbours on either side; the order is the \
                 lowest that was asked for"
                    .into(),
            );
        }
        for ((at, mut central), squares) in found.into_iter().zip(squares.chunks(REACHES.len() + 1)) {
            if measured {
                central.settle(squares);
            }
            task.measure_by(at, central);
        }
        Ok(task)
    }

    /// Measures the left side of a fitted equation by a central difference.
    fn measure_by(&mut self, at: usize, central: Difference) {
        let equation = &mut self.fitted[at];
        equation.measure(central.form.expression());
        equation.difference = Some(central.form.truncation());
        equation.central = Some(central);
        let of = |one: &&mut Equation| one.right.columns().iter().any(|name| **name == *equation.latent);
        let same = self.equations.iter_mut().filter(|one| one.target.is_some()).filter(of);
        same.for_each(|one| one.target = Some(equation.measured.clone()));
    }

    /// How the derivative of every fitted equation was settled; `None` where it is no central difference.
    pub(crate) fn settled_differences(&self) -> Vec<Option<SettledDifference>> {
        let of = |equation: &FittedEquation| {
            let Difference { form, errors, .. } = equation.central.as_ref()?;
            let settled = SettledDifference { reach: form.reach, spacing: form.spacing, errors: *errors };
            Some(settled).filter(|_| equation.measured == form.expression())
        };
        self.fitted.iter().map(of).collect()
    }

    /// The task with its derivatives as those of an equal one were settled: where an equation of `raw` (as it was before) asks for the same derivative, it is
    /// settled alike.
    pub(crate) fn differentiated_like(mut self, raw: &Self, settled: &[Option<SettledDifference>]) -> Self {
        for at in 0..self.fitted.len() {
            let own = &self.fitted[at];
            let same = |other: &FittedEquation| {
                (&other.label, &other.measured, &other.central) == (&own.label, &own.measured, &own.central)
            };
            let Some(place) = raw.fitted.iter().position(same) else { continue };
            if let (Some(mut central), Some(Some(kept))) = (own.central.clone(), settled.get(place)) {
                (central.form.reach, central.form.spacing, central.errors) = (kept.reach, kept.spacing, kept.errors);
                self.measure_by(at, central);
            }
        }
        self
    }
}
