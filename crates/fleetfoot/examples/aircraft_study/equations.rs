//! The aircraft's equations of motion as a structured regression: (32) to (34), with (31) for the latents and (41) for the prior.

use fleetfoot::{
    library::{Expr, Scope},
    sim::plant::aircraft::{Airplane, Latent},
    sparse::structured::Assembly,
    sums::structured::{Candidates, Regression, Scanned, Task, Term},
};

use super::Failure;

/// What is believed of the specific impulse, m/s: consumption of (0.334 + 0.44 M) sqrt(theta) lb/(lbf h), a textbook's formula for engines of this class,
/// taken 3 % too good.
pub(crate) const PRIOR: &str = "1.03*35304/((0.334 + 0.44*M)*sqrt(SAT/288.15))";
/// The measured tasks.
pub(crate) const MEASURED: [&str; 3] = ["m V'", "m V gamma'", "T + m' Isp"];

/// Thrust, drag, lift and specific impulse as polynomials (31): 15 + 10 + 10 + 10 functions, three tasks that share the thrust, and the prior.
pub(crate) fn regression() -> Result<Regression, Failure> {
    let parse = |text: &str| Ok::<_, Failure>(Expr::parse(text, &Scope::open())?);
    let latents = Latent::ALL.iter().map(|latent| {
        let functions = latent.features().iter().map(|text| parse(text)).collect::<Result<_, _>>()?;
        Ok::<_, Failure>(Candidates { name: latent.name().to_owned(), functions })
    });
    let task = |name: &str, target: &str, terms: [(usize, &str); 2]| {
        let terms = terms.iter().map(|&(latent, text)| Ok::<_, Failure>(Term { latent, coefficient: parse(text)? }));
        let terms = terms.collect::<Result<_, _>>()?;
        Ok::<_, Failure>(Task { name: name.to_owned(), target: parse(target)?, terms, prior: false })
    };
    let one = Term { latent: 3, coefficient: parse("1")? };
    Ok(Regression {
        latents: latents.collect::<Result<_, _>>()?,
        tasks: vec![
            task(MEASURED[0], "m*V_dot + m*9.80665*sin(gamma)", [(0, "cos(alpha)"), (1, "-1")])?,
            task(MEASURED[1], "m*V*gamma_dot + m*9.80665*cos(gamma)", [(0, "sin(alpha)"), (2, "1")])?,
            task(MEASURED[2], "0", [(0, "1"), (3, "m_dot")])?,
            Task { name: "prior of Isp".into(), target: parse(PRIOR)?, terms: vec![one], prior: true },
        ],
        weight: None,
    })
}

/// Targets in units of their deviations; the third is 0 and is a force like the first. The prior counts `lambda_t` times in units of its own size.
pub(crate) fn assembly(scanned: &Scanned, lambda_t: f64) -> Result<Assembly, Failure> {
    let target = |task: usize| {
        let task = &scanned.tasks[task];
        let total = task.stats.total(|_| true).ok_or("there are no rows")?;
        let root = task.preconditioner.square_root(&total);
        Ok::<_, Failure>((root.total[0] / root.weight, root.mean_y[0] * root.mean_y[0]))
    };
    let (along, normal, prior) = (target(0)?.0, target(1)?.0, target(3)?);
    let weights = vec![1.0 / along, 1.0 / normal, 1.0 / along, lambda_t / (prior.0 + prior.1)];
    Ok(Assembly { weights, ..Assembly::default() })
}

/// The true coefficients of an aircraft, in the order of the regression's.
pub(crate) fn truth(airplane: &Airplane) -> Vec<f64> {
    Latent::ALL.iter().flat_map(|&latent| airplane.terms().coefficients(latent)).collect()
}
