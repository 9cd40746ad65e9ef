//! Figure 3: errors of the derivatives of flights that were left out, of the bolasso and of nonlinear least squares.

use std::time::{Duration, Instant};

use faer::Mat;
use fleetfoot::{Halo, Source, data::MemorySource, sparse::bolasso::refit};

use super::{
    Failure, equations,
    latents::Rows,
    nonlinear::{self, Without},
    selection::{Aircraft, Scan},
};

/// Mean squared errors of V', gamma', m' of one flight.
pub(crate) struct Left {
    pub(crate) flight: String,
    pub(crate) bolasso: [f64; 3],
    /// Of the flights that nonlinear least squares was fitted without.
    pub(crate) nonlinear: Option<[f64; 3]>,
}

/// What leaving flights out showed.
pub(crate) struct Errors {
    pub(crate) flights: Vec<Left>,
    pub(crate) bolasso_time: Duration,
    pub(crate) nonlinear_time: Duration,
    /// Fits of nonlinear least squares that did not converge.
    pub(crate) unconverged: usize,
}

/// Leaves every flight out of the bolasso's refit, and `nonlinear` flights, evenly spread, out of nonlinear least squares as well.
///
/// The support is that of all flights; one flight in hundreds does not move a selection frequency.
pub(crate) fn leave_one_out(
    source: &MemorySource,
    scan: &Scan,
    aircraft: &Aircraft,
    lambda_t: f64,
    nonlinear: usize,
) -> Result<Errors, Failure> {
    let structure = scan.plan.regression.structure();
    let assembly = equations::assembly(&scan.scanned, lambda_t)?;
    let began = Instant::now();
    let count = source.episodes().len();
    let members = scan.banks.keys();
    let weights = Mat::from_fn(members.len(), count, |m, flight| {
        f64::from(u8::from(members[m].episode != source.episodes()[flight].id))
    });
    let mut flights = Vec::with_capacity(count);
    for (flight, roots) in scan.banks.roots(weights.as_ref()).iter().enumerate() {
        let theta = refit(&structure, roots, &assembly, &aircraft.selection.support)?;
        let errors = errors(source, flight, &theta)?;
        flights.push(Left { flight: source.episodes()[flight].name.clone(), bolasso: errors, nonlinear: None });
    }
    let bolasso_time = began.elapsed();
    let began = Instant::now();
    let variances = variances(source)?;
    let mut unconverged = 0;
    // The first iteration begins at the linear estimate with all functions, the others at the first one's result.
    let mut initial = refit(&structure, &scan.roots, &assembly, &(0..structure.coefficients()).collect::<Vec<_>>())?;
    for k in 0..nonlinear.min(count) {
        let flight = k * count / nonlinear.min(count);
        let fit = nonlinear::fit(&Without::new(source, flight), &initial, variances)?;
        unconverged += usize::from(!fit.status.converged());
        flights[flight].nonlinear = Some(errors(source, flight, &fit.values)?);
        initial = fit.values;
    }
    Ok(Errors { flights, bolasso_time, nonlinear_time: began.elapsed(), unconverged })
}

fn errors(source: &MemorySource, flight: usize, theta: &[f64]) -> Result<[f64; 3], Failure> {
    let block = source.read(flight, 0..source.episodes()[flight].rows, Halo::default())?;
    let rows = Rows { block: &block, columns: source.columns() };
    rows.errors(&rows.latents(theta)?)
}

/// Variances of V', gamma', m' over all rows: what makes their residuals comparable.
pub(crate) fn variances(source: &MemorySource) -> Result<[f64; 3], Failure> {
    let (mut count, mut sums) = (0.0, [[0.0f64; 2]; 3]);
    for (episode, info) in source.episodes().iter().enumerate() {
        let block = source.read(episode, 0..info.rows, Halo::default())?;
        let rows = Rows { block: &block, columns: source.columns() };
        count += info.rows as f64;
        for (sum, name) in sums.iter_mut().zip(["V_dot", "gamma_dot", "m_dot"]) {
            for value in rows.column(name)? {
                *sum = [sum[0] + value, sum[1] + value * value];
            }
        }
    }
    Ok(sums.map(|[first, second]| second / count - (first / count).powi(2)))
}
