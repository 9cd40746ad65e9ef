//! Derivatives by central differences: how large their errors are, and the order that the data ask for.

use fleetfoot_data::Canonical;
use fleetfoot_library::{CentralDifference, Expr, REACHES, Spacing};
use serde::Serialize;

/// A central difference that a derivative is measured by.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Difference {
    /// The difference.
    pub form: CentralDifference,
    /// True if the data may choose its order.
    pub any_order: bool,
    /// True if its weights may follow the stamps: the recipe names it by a word, without weights.
    pub any_spacing: bool,
    /// Its estimated error; `None` before the data are read, or if no row has enough neighbours.
    pub errors: Option<DifferenceErrors>,
}

/// Estimated errors of central differences, root mean squares over a sample of the rows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
#[non_exhaustive]
pub struct DifferenceErrors {
    /// The order that is used.
    pub order: usize,
    /// Errors of the differences of order 2, 4 and 6.
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
    pub fn new(order: usize, by_order: [f64; 3], [truncation, noise]: [f64; 2]) -> Self {
        Self { order, by_order, truncation, noise }
    }
}

/// Order and spacing of a central difference, settled by the data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SettledDifference {
    /// Rows to either side that it takes, 1 to 3; its order is twice that.
    pub reach: usize,
    /// Spacing of the stamps.
    pub spacing: Spacing,
    /// Its estimated error.
    pub errors: Option<DifferenceErrors>,
}

impl SettledDifference {
    /// Adds all that was settled.
    pub fn encode(&self, out: &mut Canonical) {
        out.count(self.reach as u64);
        out.tag(match self.spacing {
            Spacing::Even => 0,
            Spacing::Stamps => 1,
        });
        out.tag(self.errors.is_some().into());
        if let Some(DifferenceErrors { order, by_order, truncation, noise }) = &self.errors {
            out.count(*order as u64);
            out.numbers(&[&by_order[..], &[*truncation, *noise]].concat());
        }
    }
}

impl Difference {
    /// The difference that measures the derivative, if it is a central one. `said`: the difference that a word names;
    /// else it is recognised in the written expression.
    pub fn of(central: Option<CentralDifference>, any_order: bool, measured: &Expr) -> Option<Self> {
        let any_spacing = central.is_some();
        let form = central.or_else(|| CentralDifference::recognised(measured))?;
        Some(Self { form, any_order, any_spacing, errors: None })
    }

    /// Expressions that estimate its error: the truncation of every order, then the noise.
    pub(super) fn witnesses(&self) -> impl Iterator<Item = Expr> {
        let truncations = REACHES.map(|reach| self.form.with_reach(reach).truncation());
        truncations.into_iter().chain([self.form.noise()])
    }

    /// Settles the order by mean squares of the witnesses.
    pub(super) fn settle(&mut self, squares: &[f64]) {
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
