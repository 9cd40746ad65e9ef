//! The central differences of a task, settled by the data.

use fleetfoot_data::Source;
use fleetfoot_library::{Expr, REACHES, Spacing, unevenness};
use fleetfoot_model::Equation;
use fleetfoot_sums::system::sampled_mean_squares;

use crate::{
    difference::{Difference, SettledDifference},
    equations::{EquationTask, FittedEquation},
    error::Error,
};

/// Unevenness of the stamps (root mean square) up to which the weights of even ones are right: their error is smaller
/// than the derivative by that factor.
const EVEN: f64 = 1e-4;

impl EquationTask {
    /// Estimates the errors of the central differences from a sample of the rows, and takes the order with the least error where it is free. Weights follow the stamps
    /// where these are uneven.
    ///
    /// # Errors
    /// Those of reading.
    pub fn differentiated(&self, source: &dyn Source, notes: &mut Vec<String>) -> Result<Self, Error> {
        let mut task = self.clone();
        let columns = source.columns();
        let known = |central: &Difference| {
            central.form.of.columns().iter().all(|name| columns.iter().any(|column| column.name == **name))
        };
        let differences =
            task.fitted.iter().enumerate().filter_map(|(at, equation)| Some((at, equation.central.clone()?)));
        let mut differences: Vec<(usize, Difference)> = differences.filter(|(_, central)| known(central)).collect();
        if differences.is_empty() {
            return Ok(task);
        }
        let uneven = sampled_mean_squares(&[unevenness()], source)?[0].sqrt() > EVEN;
        let spacing = if uneven { Spacing::Stamps } else { Spacing::Even };
        differences
            .iter_mut()
            .filter(|(_, difference)| difference.any_spacing)
            .for_each(|(_, difference)| difference.form.spacing = spacing);
        // The mean square of 1 tells whether any row has what all the others need.
        let witnesses = differences.iter().flat_map(|(_, central)| central.witnesses()).chain([Expr::number(1.0)]);
        let squares = sampled_mean_squares(&witnesses.collect::<Vec<_>>(), source)?;
        let measured = squares.last().is_some_and(|&one| one > 0.0);
        if !measured {
            notes.push(
                "derivatives by central differences: their error is not known, because no row has five complete neighbours on either side; the order is the \
                 lowest that was asked for"
                    .into(),
            );
        }
        for ((at, mut central), squares) in differences.into_iter().zip(squares.chunks(REACHES.len() + 1)) {
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

    /// Settled derivative of every fitted equation; `None` unless it is a central difference.
    pub fn settled_differences(&self) -> Vec<Option<SettledDifference>> {
        let of = |equation: &FittedEquation| {
            let Difference { form, errors, .. } = equation.central.as_ref()?;
            let settled = SettledDifference { reach: form.reach, spacing: form.spacing, errors: *errors };
            Some(settled).filter(|_| equation.measured == form.expression())
        };
        self.fitted.iter().map(of).collect()
    }

    /// The task with its derivatives settled like those of an equal one. An equation of `raw` (before settling) with
    /// the same derivative is settled alike.
    pub fn differentiated_like(mut self, raw: &Self, settled: &[Option<SettledDifference>]) -> Self {
        for at in 0..self.fitted.len() {
            let equation = &self.fitted[at];
            let same = |other: &FittedEquation| {
                (&other.label, &other.measured, &other.central)
                    == (&equation.label, &equation.measured, &equation.central)
            };
            let Some(place) = raw.fitted.iter().position(same) else { continue };
            if let (Some(mut central), Some(Some(kept))) = (equation.central.clone(), settled.get(place)) {
                (central.form.reach, central.form.spacing, central.errors) = (kept.reach, kept.spacing, kept.errors);
                self.measure_by(at, central);
            }
        }
        self
    }
}
