//! Delays of inputs, found before orders are looked for: those that look for a few lags never see an input that acts later.
//!
//! One scan has a few lags of the outputs and many of every input. Forward regression takes the terms that explain the
//! outputs. An input acts late if all its terms lie beyond the lags of the search; its lags then begin there.

use fleetfoot_data::Progress;
use fleetfoot_recipe::Criterion;

use super::{
    OrderRule, TermRule,
    terms::{Problems, Trails, choice},
    training::Fit,
};
use crate::error::Error;

/// Lags of every output beside the inputs'.
const OUTPUTS: usize = 3;
/// Lags of every input at most, and fewer where products of all rows would be more than so many.
const MOST: usize = 200;
const PRODUCTS: f64 = 2e10;
/// Rows that every lag needs.
const ROWS_PER_LAG: usize = 10;
/// Terms that are taken at most. A term counts if it explains such a share of the variance that the outputs' past
/// leaves, and of the variance that the input's best term explains.
const TERMS: usize = 12;
const LEAST: f64 = 0.05;
const SHARE: f64 = 0.1;
/// Lags added before the first that counts: with an input that is held for some rows, the first lag is uncertain by so
/// many.
const MARGIN: usize = 3;

impl Fit<'_> {
    /// Rows by which every input is late, 0 where the lags that the search has reach it.
    pub(crate) fn delays(&self, rows: usize, progress: &dyn Progress) -> Result<Vec<usize>, Error> {
        let inputs = self.base.inputs();
        let late = vec![0; inputs];
        let OrderRule::Look(given) = self.options.order else { return Ok(late) };
        if inputs == 0 || given.inputs.is_some() || given.every.is_some_and(|every| every > 1) {
            return Ok(late);
        }
        let outputs = OUTPUTS * self.base.outputs();
        let columns = (PRODUCTS / rows.max(1) as f64).sqrt().min((rows / ROWS_PER_LAG) as f64) as usize;
        let reach = MOST.min(columns.saturating_sub(outputs) / inputs);
        let near = self.options.effort.lags().iter().copied().max().unwrap_or(1);
        if reach <= near {
            return Ok(late);
        }
        // The first lag of an input is that of one that acts at once.
        let task = self.base.lags(OUTPUTS, reach);
        let scan = self.scan(&task, None, progress)?;
        let columns = (0..=outputs + inputs * reach).collect();
        let trails = Trails::new(&Problems::all(&scan, None), columns, TermRule::Auto(TERMS), choice(Criterion::Ebic))?;
        let found = trails.terms(None);
        // Input, lag, and the share of what the outputs' past leaves that it explains; the constant comes first, then the outputs.
        let mut of_inputs: Vec<(usize, usize, f64)> = Vec::new();
        for equation in found.iter().flatten() {
            let past: f64 = equation.terms.iter().filter(|(column, ..)| *column <= outputs).map(|term| term.2).sum();
            let left = (1.0 - past).max(f64::EPSILON);
            of_inputs.extend(equation.terms.iter().filter_map(|(column, _, reduction)| {
                let at = column.checked_sub(1 + outputs)?;
                Some((at / reach, at % reach, reduction / left))
            }));
        }
        Ok((0..inputs)
            .map(|input| {
                let own = || of_inputs.iter().filter(|(of, ..)| *of == input);
                let most = own().map(|(.., reduction)| *reduction).fold(0.0, f64::max);
                let counts = |reduction: f64| reduction >= SHARE * most && reduction >= LEAST;
                let first = own().filter(|(.., reduction)| counts(*reduction)).map(|(_, lag, _)| *lag).min();
                first.filter(|first| *first > near).map_or(0, |first| first - 1 - MARGIN)
            })
            .collect())
    }
}
