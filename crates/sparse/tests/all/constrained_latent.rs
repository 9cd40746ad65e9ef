//! Limits on latents over all rows of the aircraft plant.

use fleetfoot_data::{Halo, MemorySource, Silent, Source, with_threads};
use fleetfoot_library::{Expr, Program, Scope};
use fleetfoot_sim::plant::aircraft::{AircraftClimb, Airplane, Flight, Latent};
use fleetfoot_sparse::{
    Strength,
    constrained::{
        ConstrainedLatent, ConstrainedOptions, ConstrainedStatus, Constraints, LatentFit, LatentLimit, LatentOptions,
        Limit, constrain_latent, constrained,
    },
    lars::{LarsOptions, lars},
    structured::{Assembly, Banks, Candidates, Plan, Regression, Task, Term},
};

fn expression(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).expect("a formula")
}

/// Equations (32) to (34), without a prior.
fn aircraft() -> Regression {
    let candidates = |latent: Latent| Candidates {
        name: latent.name().to_owned(),
        functions: latent.features().iter().map(|text| expression(text)).collect(),
    };
    let task = |name: &str, target: &str, terms: &[(usize, &str)]| Task {
        name: name.to_owned(),
        target: expression(target),
        terms: terms.iter().map(|&(latent, text)| Term { latent, coefficient: expression(text) }).collect(),
        prior: false,
    };
    Regression {
        latents: Latent::ALL.map(candidates).to_vec(),
        tasks: vec![
            task("V", "m*V_dot + m*9.80665*sin(gamma)", &[(0, "cos(alpha)"), (1, "-1")]),
            task("gamma", "m*V*gamma_dot + m*9.80665*cos(gamma)", &[(0, "sin(alpha)"), (2, "1")]),
            task("m", "0", &[(0, "1"), (3, "m_dot")]),
        ],
        weight: None,
    }
}

fn flights(count: u32) -> MemorySource {
    let mut parameters = AircraftClimb::default();
    (parameters.turbulence.longitudinal, parameters.turbulence.normal) = (0.05, 0.05);
    let airplane = Airplane::new(&parameters).expect("an airplane");
    let mut source = MemorySource::new(Flight::columns());
    (0..count).for_each(|number| airplane.flight(number).append_to(&mut source));
    source
}

/// Least value of a latent over all rows, by an evaluation of its own.
fn least(source: &MemorySource, regression: &Regression, latent: usize, theta: &[f64]) -> f64 {
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let first = regression.first(latent);
    let sum = regression.latents[latent].functions.iter().enumerate();
    let sum = sum.fold(Expr::number(0.0), |sum, (k, phi)| sum + theta[first + k] * phi.clone());
    let program = Program::compile(&[sum], &names).expect("columns");
    let mut least = f64::INFINITY;
    for (episode, info) in source.episodes().iter().enumerate() {
        let block = source.read(episode, 0..info.rows, Halo::default()).expect("rows");
        let mut values = vec![0.0; info.rows];
        program.evaluate_block(&block, 0..info.rows, &mut values, info.rows, &mut Default::default());
        least = values.into_iter().fold(least, f64::min);
    }
    least
}

#[test]
fn drag_that_least_squares_makes_negative_is_nowhere_negative_with_the_limit() {
    let source = flights(6);
    let regression = aircraft();
    let plan = Plan::new(regression.clone(), Vec::new(), 4096, &source).expect("a plan");
    let scanned = plan.scan(&source, &Silent).expect("a scan");
    let roots = Banks::new(&scanned, |_| true).total();
    // Thrust is known up to a common factor of T and Isp, and T and D trade off: the failure of section 9.3.
    let weights = roots.iter().map(|root| 1.0 / (root.total[0] / root.weight).max(1e8)).collect();
    let assembly = Assembly { weights, ..Assembly::default() };
    let assembled = regression.structure().assemble(&roots, &assembly).expect("a problem");
    let path = lars(&assembled.problem, &assembled.penalty, &LarsOptions::default()).expect("a path");
    let strength = Strength::lasso(1e-3 * path.knots[0].l1);
    let constraints = Constraints::default();
    let free = constrained(&assembled, &constraints, strength, None, &ConstrainedOptions::default()).expect("free");
    let drag = least(&source, &regression, 1, &free.theta);
    println!("drag without a limit: {drag}, certificate {:?}", free.certificate);
    assert!(drag < -100.0, "{drag}");

    let limits = [0, 1, 3].map(|latent| LatentLimit { latent, side: Limit::AtLeast, bound: Expr::number(0.0) });
    let problem = ConstrainedLatent {
        regression: &regression,
        assembled: &assembled,
        constraints: &constraints,
        limits: &limits,
        strength,
        support: None,
    };
    let fit = || constrain_latent(&problem, &source, &LatentOptions::default(), &Silent).expect("a fit");
    let found = with_threads(1, fit);
    println!(
        "{} passes, {} rows, clearance {:?}, certificate {:?}, objective {} of {}",
        found.passes, found.rows, found.clearance, found.fit.certificate, found.fit.objective, free.objective
    );
    assert!(found.kept && found.fit.status == ConstrainedStatus::Solved, "{found:?}");
    assert!(found.fit.objective >= free.objective * (1.0 - 1e-12));
    assert!(found.passes <= 20 && found.rows < 400, "{} passes, {} rows", found.passes, found.rows);
    for latent in [0, 1, 3] {
        let value = least(&source, &regression, latent, &found.fit.theta);
        // Another order of summation: rounding of the sum, 1e-12 of the terms, is below the margin.
        assert!(value >= 0.0, "latent {latent}: {value}");
    }
    let again: LatentFit = with_threads(2, fit);
    assert_eq!(found, again);
    let missing = [LatentLimit { latent: 4, side: Limit::AtMost, bound: expression("nothing") }];
    let refused = |limits: &[LatentLimit]| {
        let problem = ConstrainedLatent { limits, ..problem };
        constrain_latent(&problem, &source, &LatentOptions::default(), &Silent).expect_err("refused").to_string()
    };
    assert!(refused(&missing).contains("latent 4"));
    assert!(refused(&[LatentLimit { latent: 1, ..missing[0].clone() }]).contains("`nothing`"));
}
