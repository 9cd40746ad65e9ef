//! Limits that forms of the latents keep at every row.

use faer::{Mat, Side};
use fleetfoot_data::{Column, Halo, MemorySource, Silent, Source, packed, with_threads};
use fleetfoot_library::{Expr, Program, Scope};
use fleetfoot_sim::plant::aircraft::{AircraftClimb, Airplane, Flight, Latent};
use fleetfoot_sparse::{
    Strength,
    constrained::{
        ConstrainedOptions, ConstrainedStatus, Constraints, Form, Limit, LimitOptions, LimitedFit, LimitedRegression,
        LinearConstraint, RowLimit, constrained, fit_within_limits,
    },
    lars::{LarsOptions, lars},
    structured::{Assembled, Assembly, assemble},
};
use fleetfoot_sums::structured::{Banks, Candidates, Plan, Regression, Task, Term};
use proptest::prelude::*;
use rand::{RngExt, SeedableRng};

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
fn limit_makes_drag_nonnegative() {
    let source = flights(6);
    let regression = aircraft();
    let plan = Plan::new(regression.clone(), Vec::new(), 4096, &source).expect("a plan");
    let scanned = plan.scan(&source, &Silent).expect("a scan");
    let roots = Banks::new(&scanned, |_| true).total();
    // Thrust is known up to a common factor of T and Isp, and T and D trade off: the failure of section 9.3.
    let weights = roots.iter().map(|root| 1.0 / (root.total[0] / root.weight).max(1e8)).collect();
    let assembly = Assembly { weights, ..Assembly::default() };
    let assembled = assemble(&regression.structure(), &roots, &assembly).expect("a problem");
    let path = lars(&assembled.problem, &assembled.penalty, &LarsOptions::default()).expect("a path");
    let strength = Strength::lasso(1e-3 * path.knots[0].l1);
    let constraints = Constraints::default();
    let free = constrained(&assembled, &constraints, strength, None, &ConstrainedOptions::default()).expect("free");
    let drag = least(&source, &regression, 1, &free.theta);
    println!("drag without a limit: {drag}, certificate {:?}", free.certificate);
    assert!(drag < -100.0, "{drag}");

    let limits = [0, 1, 3]
        .map(|latent| RowLimit::of_latent(format!("latent {latent}"), latent, Limit::AtLeast, Expr::number(0.0)));
    let problem = LimitedRegression {
        regression: &regression,
        assembled: &assembled,
        constraints: &constraints,
        limits: &limits,
        strength,
        support: None,
    };
    let fit = || fit_within_limits(&problem, Some(&source), &LimitOptions::default(), &Silent).expect("a fit");
    let fitted_once = with_threads(1, fit);
    println!(
        "{} passes, {} rows, clearance {:?}, certificate {:?}, objective {} of {}",
        fitted_once.passes,
        fitted_once.cuts.len(),
        fitted_once.clearance,
        fitted_once.fit.certificate,
        fitted_once.fit.objective,
        free.objective
    );
    assert!(fitted_once.kept && fitted_once.fit.status == ConstrainedStatus::Solved, "{fitted_once:?}");
    assert!(fitted_once.fit.objective >= free.objective * (1.0 - 1e-12));
    assert!(
        fitted_once.passes <= 20 && fitted_once.cuts.len() < 400,
        "{} passes, {} rows",
        fitted_once.passes,
        fitted_once.cuts.len()
    );
    for latent in [0, 1, 3] {
        let value = least(&source, &regression, latent, &fitted_once.fit.theta);
        // Another order of summation: rounding of the sum, 1e-12 of the terms, is below the margin.
        assert!(value >= 0.0, "latent {latent}: {value}");
    }
    let again: LimitedFit = with_threads(2, fit);
    assert_eq!(fitted_once, again);
    let missing = [RowLimit::of_latent("nobody", 4, Limit::AtMost, expression("nothing"))];
    let refused = |limits: &[RowLimit]| {
        let problem = LimitedRegression { limits, ..problem };
        fit_within_limits(&problem, Some(&source), &LimitOptions::default(), &Silent).expect_err("refused").to_string()
    };
    assert!(refused(&missing).contains("latent 4"));
    assert!(refused(&[RowLimit::of_latent("D", 1, Limit::AtMost, expression("nothing"))]).contains("`nothing`"));
}

/// Normal numbers of a seed.
fn normal(seed: u64) -> impl FnMut() -> f64 {
    let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
    move || {
        let uniform: [f64; 12] = random.random();
        uniform.iter().sum::<f64>() - 6.0
    }
}

/// Entries of a symmetric matrix (packed) measured `rows` times, each in a column of its own: the sum of all squared errors is that of Frobenius' norm.
fn measured(order: usize, entries: &[f64], rows: usize, noise: &mut impl FnMut() -> f64) -> (MemorySource, Regression) {
    let places: Vec<(usize, usize)> = (0..order).flat_map(|i| (0..=i).map(move |j| (i, j))).collect();
    let name = |&(i, j): &(usize, usize)| format!("y{i}{j}");
    let mut source = MemorySource::new(places.iter().map(|place| Column::float(name(place))).collect());
    let values = entries.iter().map(|entry| (0..rows).map(|_| entry + noise()).collect()).collect();
    source.push_uniform("all", 0.01, values);
    let factor = |&(i, j): &(usize, usize)| if i == j { "1".to_owned() } else { 2f64.sqrt().to_string() };
    let task = |(latent, place): (usize, &(usize, usize))| Task {
        name: name(place),
        target: expression(&format!("{}*{}", factor(place), name(place))),
        terms: vec![Term { latent, coefficient: expression(&factor(place)) }],
        prior: false,
    };
    let latents = places.iter().map(|place| Candidates { name: name(place), functions: vec![expression("1")] });
    (
        source,
        Regression { latents: latents.collect(), tasks: places.iter().enumerate().map(task).collect(), weight: None },
    )
}

/// The symmetric matrix with its entries bounded by `limit`, of latents that are these entries.
fn matrix_of(latents: usize, side: Limit, bound: f64) -> RowLimit {
    let form = |latent| Form { terms: vec![Term { latent, coefficient: Expr::number(1.0) }], rest: Expr::number(0.0) };
    RowLimit { name: "M".into(), forms: (0..latents).map(form).collect(), side, bound: Expr::number(bound) }
}

fn assembled(regression: &Regression, source: &MemorySource) -> Assembled {
    let plan = Plan::new(regression.clone(), Vec::new(), 4096, source).expect("a plan");
    let roots = Banks::new(&plan.scan(source, &Silent).expect("a scan"), |_| true).total();
    let assembly = Assembly { weights: vec![1.0; roots.len()], ..Assembly::default() };
    assemble(&regression.structure(), &roots, &assembly).expect("a problem")
}

fn full(order: usize, entries: &[f64]) -> Mat<f64> {
    Mat::from_fn(order, order, |i, j| entries[packed(i, j)])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// The nearest matrix without eigenvalues below a bound has those of the mean, lifted to it (Higham 1988), whatever the order of the matrix.
    #[test]
    fn a_bounded_matrix_is_the_nearest_one(order in 2_usize..=4, seed in 0_u64..1_000, bound in -0.5_f64..1.0, most in any::<bool>()) {
        let latents = order * (order + 1) / 2;
        let mut noise = normal(seed);
        let truth: Vec<f64> = (0..latents).map(|_| noise()).collect();
        let (source, regression) = measured(order, &truth, 40, &mut noise);
        let side = if most { Limit::AtMost } else { Limit::AtLeast };
        let constraints = Constraints::default();
        let assembled = assembled(&regression, &source);
        let problem = LimitedRegression {
            regression: &regression,
            assembled: &assembled,
            constraints: &constraints,
            limits: &[matrix_of(latents, side, bound)],
            strength: Strength::lasso(0.0),
            support: None,
        };
        // No rows are needed: the matrix is the same at all of them.
        let limited_fit = fit_within_limits(&problem, None, &LimitOptions::default(), &Silent).expect("a fit");
        prop_assert!(limited_fit.kept && limited_fit.fit.status == ConstrainedStatus::Solved, "{limited_fit:?}");
        prop_assert!(limited_fit.clearance[0].place.is_none());
        let block = source.read(0, 0..40, Halo::default()).expect("rows");
        let means: Vec<f64> = (0..latents).map(|column| block.column(column).iter().sum::<f64>() / 40.0).collect();
        let eigen = full(order, &means).self_adjoint_eigen(Side::Lower).expect("eigenvalues");
        let lifted = |value: f64| if most { value.min(bound) } else { value.max(bound) };
        let nearest = Mat::from_fn(order, order, |i, j| {
            (0..order).map(|k| lifted(eigen.S()[k]) * eigen.U()[(i, k)] * eigen.U()[(j, k)]).sum::<f64>()
        });
        // The margin is a millionth of the largest entry; objectives differ by it, and matrices by its root times the curvature of the cone.
        let size = means.iter().fold(1.0_f64, |size, mean| size.max(mean.abs()));
        let square = |matrix: &Mat<f64>| (matrix - &full(order, &means)).squared_norm_l2();
        let fitted = full(order, &limited_fit.fit.theta);
        prop_assert!(square(&fitted).sqrt() <= square(&nearest).sqrt() + 1e-5 * size, "{limited_fit:?}");
        prop_assert!((&fitted - &nearest).norm_max() < 5e-3 * size, "{fitted:?} {nearest:?}");
    }
}

#[test]
fn limit_makes_inertia_positive_definite() {
    // An arm of two links, of which the second hardly moves: its own inertia is told by noise.
    let mut noise = normal(7);
    let names = ["q", "a1", "a2", "t1", "t2"];
    let mut source = MemorySource::new(names.map(Column::float).to_vec());
    for episode in 0..3 {
        let mut values = vec![Vec::new(); 5];
        for row in 0..4_000 {
            let t = f64::from(row) * 0.01;
            let (q, a1, a2) = ((0.31 * t).sin() * 2.5, (1.7 * t).sin() * 3.0, 0.02 * (2.9 * t).cos());
            let m = [0.9 + 0.5 * q.cos(), 0.2 + 0.25 * q.cos(), 0.2];
            let torque = [m[0] * a1 + m[1] * a2 + 0.3 * noise(), m[1] * a1 + m[2] * a2 + 0.3 * noise()];
            values.iter_mut().zip([q, a1, a2, torque[0], torque[1]]).for_each(|(column, value)| column.push(value));
        }
        source.push_uniform(format!("{episode}"), 0.01, values);
    }
    let candidates = |name: &str, functions: &[&str]| Candidates {
        name: name.to_owned(),
        functions: functions.iter().map(|text| expression(text)).collect(),
    };
    let task = |name: &str, terms: [(usize, &str); 2]| Task {
        name: name.to_owned(),
        target: expression(name),
        terms: terms.map(|(latent, text)| Term { latent, coefficient: expression(text) }).to_vec(),
        prior: false,
    };
    let regression = Regression {
        latents: vec![
            candidates("M11", &["1", "cos(q)"]),
            candidates("M12", &["1", "cos(q)"]),
            candidates("M22", &["1"]),
        ],
        tasks: vec![task("t1", [(0, "a1"), (1, "a2")]), task("t2", [(1, "a1"), (2, "a2")])],
        weight: None,
    };
    let assembled = assembled(&regression, &source);
    let constraints = Constraints::default();
    let limits = [matrix_of(3, Limit::AtLeast, 1e-3)];
    let problem = LimitedRegression {
        regression: &regression,
        assembled: &assembled,
        constraints: &constraints,
        limits: &limits,
        strength: Strength::lasso(0.0),
        support: None,
    };
    // The least eigenvalue over all rows, by the formula for two rows and columns.
    let least = |theta: &[f64]| {
        let mut least = f64::INFINITY;
        for episode in 0..3 {
            for q in source.read(episode, 0..4_000, Halo::default()).expect("rows").column(0) {
                let m = [theta[0] + theta[1] * q.cos(), theta[2] + theta[3] * q.cos(), theta[4]];
                let (middle, half) = (0.5 * (m[0] + m[2]), 0.5 * (m[0] - m[2]));
                least = least.min(middle - half.hypot(m[1]));
            }
        }
        least
    };
    let free =
        constrained(&assembled, &constraints, problem.strength, None, &ConstrainedOptions::default()).expect("free");
    let fit = || fit_within_limits(&problem, Some(&source), &LimitOptions::default(), &Silent).expect("a fit");
    let fitted_once = with_threads(1, fit);
    println!("{} freely, {} within {:?}", least(&free.theta), least(&fitted_once.fit.theta), fitted_once.clearance);
    println!(
        "{} passes, {} cuts, {:?} {:?}",
        fitted_once.passes,
        fitted_once.cuts.len(),
        free.theta,
        fitted_once.fit.theta
    );
    assert!(least(&free.theta) < -0.05, "least squares is not positive definite: {free:?}");
    assert!(
        fitted_once.kept && fitted_once.fit.status == ConstrainedStatus::Solved && fitted_once.passes <= 25,
        "{fitted_once:?}"
    );
    // Rounding of another formula.
    assert!(least(&fitted_once.fit.theta) >= 1e-3 - 1e-14);
    assert!(fitted_once.fit.objective > free.objective);
    assert_eq!(with_threads(2, fit), fitted_once);
    assert_eq!(with_threads(7, fit), fitted_once);

    let no_rows =
        fit_within_limits(&problem, None, &LimitOptions::default(), &Silent).expect_err("refused").to_string();
    assert!(no_rows.contains("`M`") && no_rows.contains("rows"), "{no_rows}");
    let mut short = matrix_of(2, Limit::AtLeast, 0.0);
    short.name = "short".into();
    let short = [short];
    let refused = LimitedRegression { limits: &short, ..problem };
    let message =
        fit_within_limits(&refused, None, &LimitOptions::default(), &Silent).expect_err("refused").to_string();
    assert!(message.contains("`short`") && message.contains("2 forms"), "{message}");
}

#[test]
fn a_friction_takes_power_and_gives_none() {
    // Friction of a drive at low speeds, where noise is larger than it: a polynomial of degree 5 may push.
    let mut noise = normal(3);
    let mut source = MemorySource::new(["v", "f"].map(Column::float).to_vec());
    let v: Vec<f64> = (0..600).map(|row| 0.8 * (0.013 * f64::from(row)).sin()).collect();
    let f = v.iter().map(|v| 0.4 * v + 0.3 * v * v.abs() + 0.5 * noise()).collect();
    source.push_uniform("drive", 0.01, vec![v.clone(), f]);
    let functions = ["1", "v", "v^2", "v^3", "v^4", "v^5"].map(expression).to_vec();
    let regression = Regression {
        latents: vec![Candidates { name: "F".into(), functions }],
        tasks: vec![Task {
            name: "f".into(),
            target: expression("f"),
            terms: vec![Term { latent: 0, coefficient: Expr::number(1.0) }],
            prior: false,
        }],
        weight: None,
    };
    let power = |theta: &[f64], v: f64| v * (0..6).map(|k| theta[k] * v.powi(k as i32)).sum::<f64>();
    let least = |theta: &[f64]| v.iter().map(|&v| power(theta, v)).fold(f64::INFINITY, f64::min);
    let form = Form { terms: vec![Term { latent: 0, coefficient: expression("v") }], rest: Expr::number(0.0) };
    let limits =
        [RowLimit { name: "friction".into(), forms: vec![form], side: Limit::AtLeast, bound: Expr::number(0.0) }];
    let assembled = assembled(&regression, &source);
    let constraints = Constraints::default();
    let problem = LimitedRegression {
        regression: &regression,
        assembled: &assembled,
        constraints: &constraints,
        limits: &limits,
        strength: Strength::lasso(0.0),
        support: None,
    };
    let free =
        constrained(&assembled, &constraints, problem.strength, None, &ConstrainedOptions::default()).expect("free");
    let limited_fit = fit_within_limits(&problem, Some(&source), &LimitOptions::default(), &Silent).expect("a fit");
    println!("{} {:?}", least(&free.theta), limited_fit.clearance);
    assert!(least(&free.theta) < -1e-3, "{free:?}");
    // The sum is another one: rounding of its terms, which are below 1.
    assert!(limited_fit.kept && least(&limited_fit.fit.theta) >= -1e-15, "{limited_fit:?}");
    // All rows as constraints of one program, which the cutting planes do without: the same minimum, but for the margin.
    let all = v.iter().enumerate().map(|(row, &v)| LinearConstraint {
        name: format!("row {row}"),
        coefficients: (0..6).map(|k| (k, v.powi(k as i32 + 1))).collect(),
        bound: 0.0,
    });
    let all = Constraints {
        inequalities: all.filter(|row| row.coefficients.iter().any(|(_, c)| c.abs() > 1e-12)).collect(),
        ..Constraints::default()
    };
    let oracle =
        constrained(&assembled, &all, problem.strength, None, &ConstrainedOptions::default()).expect("an oracle");
    let difference = limited_fit.fit.objective - oracle.objective;
    assert!(
        (-1e-9..1e-5).contains(&(difference / oracle.objective)),
        "{} {}",
        limited_fit.fit.objective,
        oracle.objective
    );
}
