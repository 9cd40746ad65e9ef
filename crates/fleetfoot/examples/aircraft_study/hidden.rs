//! Figure 5: what the prior does to the latents that no instrument measures, and what a constraint does instead.

use fleetfoot::{
    Halo, Silent, Source,
    data::MemorySource,
    library::Expr,
    sparse::{
        Strength,
        constrained::{Constraints, Limit, LimitOptions, LimitedRegression, RowLimit, fit_within_limits},
        structured::assemble,
    },
};

use super::{
    Arguments, Failure, equations,
    errors::variances,
    latents::{Latents, Rows},
    nonlinear,
    selection::Scan,
};

/// Latents by one method.
pub(crate) struct Hidden {
    pub(crate) method: String,
    pub(crate) lambda: Option<f64>,
    pub(crate) functions: usize,
    /// Median of T, D, L, Isp over the true ones, all rows.
    pub(crate) over_true: [f64; 4],
    /// Rows with negative drag.
    pub(crate) negative_drag: usize,
    pub(crate) rows: usize,
    /// Roots of the mean squared errors of V' (m/s^2), gamma' (rad/s), m' (kg/s), all rows.
    pub(crate) errors: [f64; 3],
    /// Latents along the flight that is shown.
    pub(crate) shown: Latents,
}

/// Estimates the latents of one aircraft with priors of these strengths, with the constraint that drag is not negative in place of a prior, and by
/// nonlinear least squares.
pub(crate) fn estimate(
    source: &MemorySource,
    scan: &Scan,
    strengths: &[f64],
    shown: usize,
    arguments: &Arguments,
) -> Result<Vec<Hidden>, Failure> {
    let structure = scan.plan.regression.structure();
    let mut estimates = Vec::new();
    for &lambda_t in strengths {
        let assembly = equations::assembly(&scan.scanned, lambda_t)?;
        let (_, lambda) = scan.choose(&assembly, arguments)?;
        let (selection, theta) = scan.bolasso(source, &assembly, lambda, arguments)?;
        let described = describe(source, &theta, shown, format!("bolasso, lambda_t = {lambda_t}"))?;
        estimates.push(Hidden { lambda: Some(lambda), ..described });
        if lambda_t == 0.0 {
            estimates.push(constrained(source, scan, &selection.support, shown)?);
        }
    }
    let all: Vec<usize> = (0..structure.coefficients()).collect();
    let strongest = strengths.iter().fold(0.0f64, |most, &strength| most.max(strength));
    let initial = fleetfoot::sparse::bolasso::refit(
        &structure,
        &scan.roots,
        &equations::assembly(&scan.scanned, strongest)?,
        &all,
    )?;
    let nonlinear = nonlinear::fit(source, &initial, variances(source)?)?;
    let method = if nonlinear.status.converged() {
        "nonlinear least squares"
    } else {
        "nonlinear least squares (not converged)"
    };
    estimates.push(describe(source, &nonlinear.values, shown, method.into())?);
    Ok(estimates)
}

/// No prior, the functions that the bolasso selected without one, and drag at least 0 at every row.
fn constrained(source: &MemorySource, scan: &Scan, support: &[usize], shown: usize) -> Result<Hidden, Failure> {
    let regression = &scan.plan.regression;
    let assembled = assemble(&regression.structure(), &scan.roots, &equations::assembly(&scan.scanned, 0.0)?)?;
    let limits = [RowLimit::of_latent("D", 1, Limit::AtLeast, Expr::number(0.0))];
    let problem = LimitedRegression {
        regression,
        assembled: &assembled,
        constraints: &Constraints::default(),
        limits: &limits,
        strength: Strength::lasso(0.0),
        support: Some(support),
    };
    let fit = fit_within_limits(&problem, Some(source), &LimitOptions::default(), &Silent)?;
    if !fit.kept {
        return Err("drag could not be kept from below 0".into());
    }
    describe(source, &fit.fit.theta, shown, format!("no prior, D >= 0 at every row ({} passes)", fit.passes))
}

fn describe(source: &MemorySource, theta: &[f64], shown: usize, method: String) -> Result<Hidden, Failure> {
    let mut ratios: [Vec<f64>; 4] = Default::default();
    let (mut negative_drag, mut rows, mut squares) = (0, 0, [0.0; 3]);
    let mut kept = Latents::default();
    for (flight, info) in source.episodes().iter().enumerate() {
        let block = source.read(flight, 0..info.rows, Halo::default())?;
        let of = Rows { block: &block, columns: source.columns() };
        let latents = of.latents(theta)?;
        for ((ratios, values), name) in ratios.iter_mut().zip(&latents).zip(["T", "D", "L", "Isp"]) {
            ratios.extend(values.iter().zip(of.column(name)?).map(|(value, truth)| value / truth));
        }
        negative_drag += latents[1].iter().filter(|&&drag| drag < 0.0).count();
        let errors = of.errors(&latents)?;
        squares.iter_mut().zip(errors).for_each(|(sum, error)| *sum += error * info.rows as f64);
        rows += info.rows;
        if flight == shown {
            kept = latents;
        }
    }
    Ok(Hidden {
        method,
        lambda: None,
        functions: theta.iter().filter(|&&value| value != 0.0).count(),
        over_true: ratios.map(|mut values| median(&mut values)),
        negative_drag,
        rows,
        errors: squares.map(|sum| (sum / rows.max(1) as f64).sqrt()),
        shown: kept,
    })
}

pub(crate) fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
