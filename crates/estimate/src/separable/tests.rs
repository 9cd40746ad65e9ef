//! Variable projection beside the joint problem, the recovered constants of filters, and the coverage of their standard
//! errors.

use fleetfoot_data::{Column, Halo, MemorySource, Silent, Source, mix, with_threads};
use fleetfoot_library::{Filtered, Scope};

use super::*;
use crate::nonlinear_least_squares;

mod crazyflie;

fn parse(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).unwrap()
}

fn target(name: &str, functions: &[&str]) -> LinearTarget {
    LinearTarget::new(parse(name), functions.iter().map(|text| parse(text)).collect())
}

fn uniform(seed: u64, key: u64) -> f64 {
    (mix(mix(seed).wrapping_add(key)) >> 11) as f64 / (1_u64 << 53) as f64
}

/// A normal number by its address (Box and Muller).
fn normal(seed: u64, key: u64) -> f64 {
    let radius = (-2.0 * (1.0 - uniform(seed, 2 * key)).ln()).sqrt();
    radius * (std::f64::consts::TAU * uniform(seed, 2 * key + 1)).cos()
}

fn solve(targets: &[LinearTarget], parameters: &[Parameter], source: &dyn Source) -> Separable {
    separable(targets, parameters, source, &SeparableOptions::default(), &Silent).unwrap()
}

/// Values of an expression with filters at all rows of the first episode; 0 where there is none.
fn values(source: &MemorySource, text: &str) -> Vec<f64> {
    let filtered = Filtered::of(source, &[parse(text)]).unwrap();
    let names: Vec<&str> = filtered.columns().iter().map(|column| column.name.as_str()).collect();
    let design = fleetfoot_library::Design::compile(&[parse(text)], &names).unwrap();
    let rows = source.episodes()[0].rows;
    let block = filtered.read(0, 0..rows, design.halo()).unwrap();
    let mut design_rows = fleetfoot_library::DesignRows::default();
    design.evaluate(&block, 0..rows, &mut design_rows);
    let mut all = vec![0.0; rows];
    design_rows.index.iter().zip(design_rows.output(0)).for_each(|(&row, &value)| all[row] = value);
    all
}

/// A column, and how it is made from the input.
type Made<'a> = (&'a str, &'a dyn Fn(&MemorySource) -> Vec<f64>);

/// An input that keeps a level for a random while, sampled every 10 ms, and columns made from it.
fn excited(rows: usize, seed: u64, columns: &[Made<'_>]) -> MemorySource {
    let mut level = 0.0;
    let u = (0..rows as u64).map(|row| {
        if uniform(seed, row) < 0.08 {
            level = 2.0 * uniform(!seed, row) - 1.0;
        }
        level
    });
    let u: Vec<f64> = u.collect();
    let mut plain = MemorySource::new(vec![Column::float("u")]);
    plain.push_uniform("e", 0.01, vec![u.clone()]);
    let mut source = MemorySource::new(
        [&["u"], &columns.iter().map(|(name, _)| *name).collect::<Vec<_>>()[..]]
            .concat()
            .into_iter()
            .map(Column::float)
            .collect(),
    );
    source.push_uniform("e", 0.01, [vec![u], columns.iter().map(|(_, make)| make(&plain)).collect()].concat());
    source
}

fn noisy(mut values: Vec<f64>, level: f64, seed: u64) -> Vec<f64> {
    values.iter_mut().enumerate().for_each(|(row, value)| *value += level * normal(seed, row as u64));
    values
}

#[test]
fn solution_is_the_joint_minimum() {
    let made = |text: &'static str, seed| move |source: &MemorySource| noisy(values(source, text), 0.02, seed);
    let (y, z) = (made("0.3 + 2*exp(-0.7*u)*u + lag1(u, 0.12)", 1), made("lag1(u^2, 0.12) - 0.4*exp(-0.7*u)", 2));
    let source = excited(2_000, 5, &[("y", &y), ("z", &z)]);
    let targets = [
        target("y", &["1", "exp(-k*u)*u", "lag1(u, tau)"]),
        target("z", &["lag1(u^2, tau)", "exp(-k*u)"]).weighted(3.0),
    ];
    let parameters = [Parameter::new("tau", 0.05).between(0.01, 1.0), Parameter::new("k", 0.1)];
    let solution = solve(&targets, &parameters, &source);
    let residuals = [
        Residual::new(parse("y"), parse("a + b*exp(-k*u)*u + c*lag1(u, tau)")),
        Residual::new(parse("z"), parse("d*lag1(u^2, tau) + e*exp(-k*u)")).weighted(3.0),
    ];
    let all: Vec<Parameter> =
        parameters.iter().cloned().chain(["a", "b", "c", "d", "e"].map(|name| Parameter::new(name, 0.5))).collect();
    let joint = nonlinear_least_squares(&residuals, &all, &source, &Options::default(), &Silent).unwrap();
    assert!(solution.estimate.status.converged() && solution.estimate.gradient < 1e-10, "{solution:?}");
    assert!((solution.estimate.cost / joint.cost - 1.0).abs() < 1e-12);
    for j in 0..7 {
        let (a, b) = (solution.estimate.values[j], joint.values[j]);
        assert!((a - b).abs() < 1e-6 * joint.standard_errors()[j], "{j}: {a} {b}");
        let (a, b) = (&solution.estimate.covariance, &joint.covariance);
        assert!((a[(j, j)] / b[(j, j)] - 1.0).abs() < 1e-6, "{j}");
    }
    assert_eq!(solution.targets[0].coefficients, solution.estimate.values[2..5]);
    assert_eq!(solution.targets[1].errors, solution.estimate.standard_errors()[5..]);
    assert!(solution.estimate.iterations < joint.iterations, "{} {}", solution.estimate.iterations, joint.iterations);
    let (y, z) = (solution.targets[0].rms, solution.target("z").unwrap().rms);
    assert!((2_000.0 * (y * y + 3.0 * z * z) / solution.estimate.cost - 1.0).abs() < 1e-12);
    assert!(
        (y / 0.02 - 1.0).abs() < 0.06 && (z / 0.02 - 1.0).abs() < 0.06,
        "4 standard errors of a deviation of 2000 rows"
    );
}

#[test]
fn exact_data_give_exact_constants() {
    let y = |source: &MemorySource| values(source, "1.5*lag1(lag1(u, 0.05), 0.31) - 0.2");
    let source = excited(3_000, 8, &[("y", &y)]);
    let parameters = [Parameter::new("a", 0.02).between(0.001, 0.1), Parameter::new("b", 0.15).between(0.1, 2.0)];
    let solution = solve(&[target("y", &["lag1(lag1(u, a), b)", "1"])], &parameters, &source);
    for (value, truth) in solution.estimate.values.iter().zip([0.05, 0.31, 1.5, -0.2]) {
        assert!((value - truth).abs() < 1e-9, "{:?}", solution.estimate);
    }
    assert!(solution.targets[0].rms < 1e-10);
    assert_eq!(solution.insert(&parse("lag1(u, a)")).to_string(), format!("lag1(u, {})", solution.estimate.values[0]));
}

const REPLICATES: usize = 400;

/// 95 % intervals of many replicates cover the truth as often as they should. The share has a standard error of 0.011,
/// and five standard errors of a parameter are exceeded once in thousands of such studies.
fn covers(truth: f64, replicate: impl Fn(u64) -> Uncertain + Sync) {
    let one = |seed| Ok::<_, EstimateError>(replicate(seed as u64));
    let all = fleetfoot_data::parallel_map(REPLICATES, &Silent, one).unwrap();
    let distances: Vec<f64> = all.iter().map(|estimated| (estimated.value - truth).abs() / estimated.error).collect();
    let share = distances.iter().filter(|&&distance| distance < 1.96).count() as f64 / REPLICATES as f64;
    let worst = distances.iter().copied().fold(0.0, f64::max);
    println!("coverage {share}, worst {worst}");
    assert!((0.905..=0.99).contains(&share) && worst < 5.0, "{share} {worst}");
}

#[test]
fn standard_errors_cover_a_time_constant() {
    covers(0.0716, |seed| {
        let y = |source: &MemorySource| {
            noisy(values(source, "0.02 + 0.5*lag1(u, 0.0716) + 0.3*lag1(u, 0.0716)^2"), 0.05, seed + 900)
        };
        let source = excited(400, seed, &[("y", &y)]);
        let parameters = [Parameter::new("tau", 0.05).between(0.01, 0.5)];
        let solution = solve(&[target("y", &["1", "lag1(u, tau)", "lag1(u, tau)^2"])], &parameters, &source);
        assert!(solution.estimate.status.converged() && solution.estimate.gradient < 1e-9);
        solution.parameter("tau").unwrap()
    });
}

#[test]
fn standard_errors_cover_a_delay() {
    covers(0.0873, |seed| {
        let y = |source: &MemorySource| noisy(values(source, "2*delay(lag1(u, 0.1), 0.0873) + 1"), 0.05, seed + 300);
        let source = excited(400, seed, &[("y", &y)]);
        let parameters = [Parameter::new("d", 0.02).between(0.0, 0.2)];
        let options = SeparableOptions { starts: 6, ..SeparableOptions::default() };
        let result =
            separable(&[target("y", &["delay(lag1(u, 0.1), d)", "1"])], &parameters, &source, &options, &Silent);
        let solution = result.unwrap();
        // The rows that have a past of 0.2 s, whatever the delay.
        assert_eq!(solution.estimate.rows, 380);
        solution.parameter("d").unwrap()
    });
}

/// A sine delayed by a period more or less fits nearly as well: the right minimum is found from the points between the bounds.
#[test]
fn starts_find_the_lowest_of_many_minima() {
    let rows = 2_000;
    let u: Vec<f64> = (0..rows)
        .map(|row| {
            let t = 0.01 * row as f64;
            (20.0 * t).sin() + 0.2 * (3.1 * t).sin()
        })
        .collect();
    let mut plain = MemorySource::new(vec![Column::float("u")]);
    plain.push_uniform("e", 0.01, vec![u.clone()]);
    let mut source = MemorySource::new(vec![Column::float("u"), Column::float("y")]);
    source.push_uniform("e", 0.01, vec![u, noisy(values(&plain, "delay(u, 1.234)"), 0.1, 4)]);
    let parameters = [Parameter::new("d", 0.3).between(0.0, 2.0)];
    let targets = [target("y", &["delay(u, d)"])];
    let alone = solve(&targets, &parameters, &source);
    let options = SeparableOptions { starts: 40, descents: 3, ..SeparableOptions::default() };
    let solution = separable(&targets, &parameters, &source, &options, &Silent).unwrap();
    assert!(
        alone.estimate.cost > 1.2 * solution.estimate.cost && (solution.estimate.values[0] - 1.234).abs() < 0.002,
        "{solution:?}"
    );
    assert_eq!((solution.starts.len(), alone.starts.len()), (41, 1));
    assert!(solution.starts.iter().all(|start| start.cost.unwrap() >= solution.estimate.cost));
}

#[test]
fn the_same_bits_on_any_number_of_threads() {
    let y = |source: &MemorySource| noisy(values(source, "lag1(u, 0.3) + delay(lag1(u, 0.1), 0.05)"), 0.1, 3);
    let source = excited(30_000, 77, &[("y", &y)]);
    let parameters = [Parameter::new("tau", 0.1).between(0.01, 3.0), Parameter::new("d", 0.1).between(0.0, 0.3)];
    let iteration = Options { chunk_rows: 1_000, ..Options::default() };
    let options = SeparableOptions { iteration, starts: 3, descents: 2 };
    let targets = [target("y", &["lag1(u, tau)", "delay(lag1(u, 0.1), d)"])];
    let run = |threads| with_threads(threads, || separable(&targets, &parameters, &source, &options, &Silent).unwrap());
    let one = run(1);
    assert_eq!(one, run(3));
    assert!(one.estimate.clustered.is_some());
    for ((value, error), truth) in
        one.estimate.values.iter().zip(one.estimate.standard_errors()).zip([0.3, 0.05, 1.0, 1.0])
    {
        assert!((value - truth).abs() < 3.0 * error, "{value} {error} {truth}");
    }
}

#[test]
fn missing_values_and_borders_drop_rows() {
    let y = |source: &MemorySource| values(source, "delay(u, 0.1)");
    let mut source = excited(500, 2, &[("y", &y)]);
    let rows = source.read(0, 0..500, Halo::default()).unwrap();
    let mut u = rows.core(0).to_vec();
    u[200] = f64::NAN;
    source.push_uniform("with a hole", 0.01, vec![u, rows.core(1).to_vec()]);
    let parameters = [Parameter::new("d", 0.095).between(0.0, 0.15)];
    let solution = solve(&[target("y", &["delay(u, d)"])], &parameters, &source);
    // 15 rows at the start of each, and 16 that see the hole.
    assert_eq!(solution.estimate.rows, 2 * (500 - 15) - 16);
    assert!((solution.estimate.values[0] - 0.1).abs() < 1e-9, "{:?}", solution.estimate);
    // By the other door too.
    let residuals = [Residual::new(parse("y"), parse("c*delay(u, d)"))];
    let all = [parameters[0].clone(), Parameter::new("c", 0.5)];
    let joint = nonlinear_least_squares(&residuals, &all, &source, &Options::default(), &Silent).unwrap();
    assert_eq!(joint.rows, solution.estimate.rows);
    assert!((joint.values[0] - 0.1).abs() < 1e-9 && (joint.values[1] - 1.0).abs() < 1e-9);
}

#[test]
fn bounds_hold_and_undetermined_parameters_are_named() {
    let y = |source: &MemorySource| noisy(values(source, "lag1(u, 0.3)"), 0.01, 6);
    let source = excited(1_000, 12, &[("y", &y), ("k", &|_| vec![2.0; 1_000])]);
    let at = |low: f64, high: f64| [Parameter::new("tau", low).between(low, high)];
    let solution = solve(&[target("y", &["lag1(u, tau)"])], &at(0.01, 0.2), &source);
    assert_eq!((solution.estimate.values[0], &solution.estimate.at_bounds), (0.2, &vec![0]));
    assert_eq!(solution.parameter("tau").unwrap().error, 0.0);
    // The lag of a constant is the constant; and twice the same function leaves a choice.
    let solution = solve(&[target("y", &["lag1(k, tau)", "u"])], &at(0.1, 1.0), &source);
    assert_eq!(solution.estimate.undetermined, [0]);
    let solution = solve(&[target("y", &["lag1(u, tau)", "2*lag1(u, tau)"])], &at(0.1, 1.0), &source);
    assert_eq!(solution.estimate.undetermined, [1, 2]);
    assert!((solution.estimate.values[0] - 0.3).abs() < 0.01);
    let [a, b] = solution.targets[0].coefficients[..] else { panic!("two") };
    assert!((a + 2.0 * b - 1.0).abs() < 0.01 && (a - 2.0 * b).abs() < 1e-10, "{a} {b}");
}

#[test]
fn impossible_problems_are_refused() {
    let source = excited(100, 1, &[]);
    let error = |targets: &[LinearTarget], parameters: &[Parameter]| {
        separable(targets, parameters, &source, &SeparableOptions::default(), &Silent).unwrap_err()
    };
    let tau = || Parameter::new("tau", 0.1).between(0.01, 1.0);
    let good = || target("u", &["lag1(u, tau)"]);
    assert!(matches!(error(&[good()], &[]), EstimateError::NoParameters));
    assert!(matches!(error(&[target("u", &[])], &[tau()]), EstimateError::NoFunctions { .. }));
    assert!(matches!(error(&[good(), good()], &[tau()]), EstimateError::NameTaken { .. }));
    assert!(matches!(error(&[target("u", &["u"])], &[tau()]), EstimateError::Unused { name } if name == "tau"));
    assert!(matches!(error(&[good().weighted(-1.0)], &[tau()]), EstimateError::Weight { .. }));
    assert!(matches!(error(&[target("u", &["lag1(u, rate*tau)"])], &[tau()]), EstimateError::Filter(_)));
    assert!(matches!(
        error(&[target("u", &["lag1(z, tau)"])], &[tau()]),
        EstimateError::UnknownColumn(_) | EstimateError::Filter(_)
    ));
    assert!(matches!(error(&[target("u", &["lag1(u*lag(tau, 1), tau)"])], &[tau()]), EstimateError::Lagged { .. }));
    assert!(matches!(
        error(&[target("u", &["delay(u, tau)"])], &[Parameter::new("tau", 0.1)]),
        EstimateError::Delay { .. }
    ));
    let zero = error(&[good()], &[Parameter::new("tau", 0.0)]).to_string();
    assert!(zero.contains("`lag1(u, 0)` has 0 seconds: a time constant is positive"), "{zero}");
    assert!(matches!(
        error(&[target("u", &["lag1(log(u - 2), tau)"])], &[tau()]),
        EstimateError::NotFinite { row: 0, .. }
    ));
}
