//! The certified values of the Statistical Reference Datasets, from both starting points.

use fleetfoot_data::{Column, MemorySource, Silent};
use fleetfoot_estimate::{Options, Parameter, Residual, nonlinear_least_squares};
use fleetfoot_library::{Expr, Scope};
use serde::Deserialize;

#[derive(Deserialize)]
struct File {
    problem: Vec<Problem>,
}

#[derive(Deserialize)]
struct Problem {
    name: String,
    model: String,
    starts: Vec<Vec<f64>>,
    certified: Vec<f64>,
    deviations: Vec<f64>,
    rss: f64,
    x: Vec<f64>,
    y: Vec<f64>,
}

#[test]
fn certified_values_from_both_starting_points() {
    let file: File = toml::from_str(include_str!("nist.toml")).expect("a readable fixture");
    assert_eq!(file.problem.len(), 9);
    for problem in &file.problem {
        let mut source = MemorySource::new(vec![Column::float("x"), Column::float("y")]);
        source.push_uniform("nist", 1.0, vec![problem.x.clone(), problem.y.clone()]);
        let model = Expr::parse(&problem.model, &Scope::open()).expect("a model");
        let residual = Residual::new(Expr::column("y"), model);
        for (start, initial) in problem.starts.iter().enumerate() {
            let what = format!("{} from start {}", problem.name, start + 1);
            let parameters = initial.iter().enumerate().map(|(j, &value)| Parameter::new(format!("b{}", j + 1), value));
            let parameters: Vec<Parameter> = parameters.collect();
            let result = nonlinear_least_squares(
                std::slice::from_ref(&residual),
                &parameters,
                &source,
                &Options::default(),
                &Silent,
            );
            let estimate = result.unwrap_or_else(|error| panic!("{what}: {error}"));
            let apart = |a: f64, b: f64| (a / b - 1.0).abs();
            let worst = estimate.values.iter().zip(&problem.certified).map(|(a, b)| apart(*a, *b)).fold(0.0, f64::max);
            let errors = estimate.standard_errors();
            let spread = errors.iter().zip(&problem.deviations).map(|(a, b)| apart(*a, *b)).fold(0.0, f64::max);
            println!(
                "{what}: {:?} after {} steps, parameters {worst:.1e}, deviations {spread:.1e}, rss {:.1e}, gradient {:.1e}, condition {:.1e}",
                estimate.status,
                estimate.iterations,
                apart(estimate.cost, problem.rss),
                estimate.gradient,
                estimate.condition,
            );
            assert!(estimate.status.converged(), "{what}: {:?}", estimate.status);
            // 11 digits are certified; the last is rounded.
            assert!(worst < 1e-9, "{what}: {worst:e} apart");
            assert!(spread < 1e-8, "{what}: standard deviations {spread:e} apart");
            assert!(apart(estimate.cost, problem.rss) < 1e-10, "{what}: {} and {}", estimate.cost, problem.rss);
            assert!(estimate.undetermined.is_empty() && estimate.at_bounds.is_empty());
        }
    }
}
