//! Nonlinear least squares beside closed forms; bounds, weights, missing values and bad input.

use faer::Mat;
use fleetfoot_data::{Column, MemorySource, Silent, with_threads};
use fleetfoot_estimate::{Estimate, EstimateError, Options, Parameter, Residual, Status, nonlinear_least_squares};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_stats::{Factor, least_squares};
use proptest::prelude::*;

fn expression(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).expect("an expression")
}

fn residual(target: &str, model: &str) -> Residual {
    Residual::new(expression(target), expression(model))
}

fn parameters(initial: &[(&str, f64)]) -> Vec<Parameter> {
    initial.iter().map(|&(name, value)| Parameter::new(name, value)).collect()
}

/// Noise that is the same everywhere.
fn noise(i: usize) -> f64 {
    (12.9898 * i as f64).sin() + (78.233 * i as f64).cos()
}

/// Columns x and y = f(x, i), in episodes.
fn source(episodes: usize, rows: usize, y: impl Fn(f64, usize) -> f64) -> MemorySource {
    let mut source = MemorySource::new(vec![Column::float("x"), Column::float("y")]);
    for episode in 0..episodes {
        let index = |i: usize| episode * rows + i;
        let x: Vec<f64> = (0..rows).map(|i| 0.5 + 2.0 * index(i) as f64 / (episodes * rows) as f64).collect();
        let y = x.iter().enumerate().map(|(i, &x)| y(x, index(i))).collect();
        source.push_uniform(format!("episode {episode}"), 0.1, vec![x, y]);
    }
    source
}

fn fit(residuals: &[Residual], parameters: &[Parameter], source: &MemorySource) -> Estimate {
    nonlinear_least_squares(residuals, parameters, source, &Options::default(), &Silent).expect("an estimate")
}

/// Powers of x up to the sixth, condition 1e5: the coefficients of Householder QR, in one step and a second that
/// confirms it.
#[test]
fn a_linear_model_is_least_squares() {
    let source = source(3, 400, |x, i| 1.0 + (3.0 * x).sin() + 0.1 * noise(i));
    let terms: Vec<String> = (1..=6).map(|k| format!("c{k}*x^{k}")).collect();
    let model = format!("c0 + {}", terms.join(" + "));
    let names: Vec<String> = (0..=6).map(|k| format!("c{k}")).collect();
    let start: Vec<(&str, f64)> = names.iter().map(|name| (name.as_str(), 100.0)).collect();
    let options = Options { radius: 1e9, ..Options::default() };
    let residuals = [residual("y", &model)];
    let estimate =
        nonlinear_least_squares(&residuals, &parameters(&start), &source, &options, &Silent).expect("an estimate");
    let x = |i: usize| 0.5 + 2.0 * i as f64 / 1200.0;
    let y = |i: usize| 1.0 + (3.0 * x(i)).sin() + 0.1 * noise(i);
    let mut factor = Factor::new(6, 1);
    factor.push(Mat::from_fn(1200, 7, |i, j| if j < 6 { x(i).powi(j as i32 + 1) } else { y(i) }).as_ref(), None);
    let peer = least_squares(&factor.square_root(), &[1.0; 6]);
    println!(
        "{:?} after {} steps, condition {:.1e}, gradient {:.1e}",
        estimate.status, estimate.iterations, estimate.condition, estimate.gradient
    );
    assert!(estimate.iterations <= 4 && estimate.status.converged() && estimate.gradient < 1e-11);
    for k in 0..6 {
        let (a, b) = (estimate.values[k + 1], peer.coefficients[(k, 0)]);
        assert!((a - b).abs() < 1e-8 * b.abs().max(1.0), "{k}: {a} {b}");
    }
    assert!((estimate.cost / peer.rss[0] - 1.0).abs() < 1e-12);
    // Another road to the covariance: (X'X)^-1 of centred columns, scaled by hand from the triangle.
    let root = factor.square_root();
    let variance = peer.rss[0] / (1200.0 - 7.0);
    let mut inverse = Mat::<f64>::identity(6, 6);
    for column in 0..6 {
        for k in (0..6).rev() {
            let known: f64 = (k + 1..6).map(|j| root.r[(k, j)] * inverse[(j, column)]).sum();
            inverse[(k, column)] = (inverse[(k, column)] - known) / root.r[(k, k)];
        }
    }
    for k in 0..6 {
        let expected = variance * (0..6).map(|i| inverse[(k, i)].powi(2)).sum::<f64>();
        assert!((estimate.covariance[(k + 1, k + 1)] / expected - 1.0).abs() < 1e-6, "{k}");
    }
}

/// The mean of a column: the sandwich over chunks is the variance of the chunks' sums.
#[test]
fn the_clustered_covariance_of_a_mean() {
    let source = source(8, 50, |_, i| noise(i) + (i / 50) as f64 * 0.2);
    let estimate = fit(&[residual("y", "c")], &parameters(&[("c", 0.0)]), &source);
    let y: Vec<f64> = (0..400).map(|i| noise(i) + (i / 50) as f64 * 0.2).collect();
    let mean = y.iter().sum::<f64>() / 400.0;
    let scores = y.chunks(50).map(|chunk| chunk.iter().map(|y| y - mean).sum::<f64>().powi(2)).sum::<f64>();
    let expected = 8.0 / 7.0 * scores / (400.0 * 400.0);
    assert!((estimate.values[0] - mean).abs() < 1e-14);
    let clustered = estimate.clustered.expect("eight chunks");
    assert!((clustered[(0, 0)] / expected - 1.0).abs() < 1e-10, "{} {expected}", clustered[(0, 0)]);
}

#[test]
fn bounds_hold_and_the_others_are_the_best_for_them() {
    let source = source(1, 300, |x, i| 2.0 * (-1.3 * x).exp() + 0.5 + 0.01 * noise(i));
    let model = [residual("y", "a*exp(-b*x) + c")];
    let start = [("a", 1.0), ("b", 0.5), ("c", 0.0)];
    let free = fit(&model, &parameters(&start), &source);
    assert!(free.at_bounds.is_empty() && (free.values[1] - 1.3).abs() < 0.2, "{free:?}");
    let mut bounded = parameters(&start);
    bounded[1] = bounded[1].clone().between(0.1, 1.0);
    let estimate = fit(&model, &bounded, &source);
    assert_eq!((estimate.values[1], &estimate.at_bounds), (1.0, &vec![1]));
    assert!(estimate.status.converged() && estimate.cost > free.cost && estimate.covariance[(1, 1)] == 0.0);
    // The same problem with the parameter written as its bound.
    let fixed = fit(&[residual("y", "a*exp(-x) + c")], &parameters(&[("a", 1.0), ("c", 0.0)]), &source);
    assert!(
        (estimate.values[0] / fixed.values[0] - 1.0).abs() < 1e-10
            && (estimate.values[2] / fixed.values[1] - 1.0).abs() < 1e-9
    );
    assert!((estimate.cost / fixed.cost - 1.0).abs() < 1e-12);
    let equal = vec![Parameter::new("a", 1.0), Parameter::new("b", 1.0).between(1.0, 1.0), Parameter::new("c", 0.0)];
    let equal = fit(&model, &equal, &source);
    assert!(
        (equal.cost / fixed.cost - 1.0).abs() < 1e-12
            && equal.at_bounds.is_empty()
            && (equal.variance / fixed.variance - 1.0).abs() < 1e-12
    );
    // A bound that is not met changes nothing but the road.
    let mut wide = parameters(&start);
    wide[0] = wide[0].clone().between(0.0, 1e3);
    assert!((fit(&model, &wide, &source).values[1] / free.values[1] - 1.0).abs() < 1e-8);
}

#[test]
fn residuals_share_parameters_by_their_weights() {
    let source = source(2, 100, |x, i| 2.0 * x + noise(i));
    // Of c: the rows say mean(y/x) by one equation, and 5 by the other, which is exact.
    let both = |weight: f64| {
        let residuals = [residual("y/x", "c"), residual("5", "c").weighted(weight)];
        fit(&residuals, &parameters(&[("c", 1.0)]), &source).values[0]
    };
    let alone = both(0.0);
    for weight in [0.5, 1.0, 4.0] {
        assert!((both(weight) - (alone + 5.0 * weight) / (1.0 + weight)).abs() < 1e-12);
    }
}

#[test]
fn exact_data_leave_no_residual_and_missing_values_no_trace() {
    let truth = |x: f64| 2.0 * (-1.3 * x).exp() + 0.5;
    let clean = source(2, 200, |x, _| truth(x));
    let holes = source(2, 200, |x, i| if i % 7 == 3 { f64::NAN } else { truth(x) });
    let start = parameters(&[("a", 1.0), ("b", 0.5), ("c", 0.0)]);
    let model = [residual("y", "a*exp(-b*x) + c")];
    for source in [&clean, &holes] {
        let estimate = fit(&model, &start, source);
        assert!(estimate.status == Status::Zero || estimate.cost < 1e-28, "{estimate:?}");
        for (value, expected) in estimate.values.iter().zip([2.0, 1.3, 0.5]) {
            assert!((value / expected - 1.0).abs() < 1e-13, "{estimate:?}");
        }
    }
    assert_eq!(fit(&model, &start, &holes).rows, (0..400).filter(|i| i % 7 != 3).count() as u64);
    let inserted = fit(&model, &start, &clean).insert(&expression("b*x + 1"));
    let value = inserted.value(|_, _| 2.0, |_| 0.0);
    assert!((value - 3.6).abs() < 1e-12, "{value}");
}

/// A step into values where the model is not a number is taken back, not taken for a fit of fewer rows.
#[test]
fn steps_outside_the_domain_are_rejected() {
    let source = source(1, 100, |x, i| (x + 0.2_f64).sqrt() + 1e-3 * noise(i));
    let estimate = fit(&[residual("y", "a*sqrt(x + b)")], &parameters(&[("a", 0.1), ("b", 30.0)]), &source);
    assert!(estimate.rows == 100 && estimate.status.converged(), "{estimate:?}");
    assert!((estimate.values[0] - 1.0).abs() < 0.02 && (estimate.values[1] - 0.2).abs() < 0.05, "{estimate:?}");
}

#[test]
fn threads_and_chunks_change_no_result() {
    let source = source(5, 3000, |x, i| 2.0 * (-1.3 * x).exp() + 0.1 * noise(i));
    let run = |threads: usize, chunk_rows: usize| {
        let options = Options { chunk_rows, ..Options::default() };
        let start = parameters(&[("a", 1.0), ("b", 0.5)]);
        let residuals = [residual("y", "a*exp(-b*x)")];
        with_threads(threads, || {
            nonlinear_least_squares(&residuals, &start, &source, &options, &Silent).expect("an estimate")
        })
    };
    let one = run(1, 1000);
    assert_eq!(one, run(2, 1000));
    assert_eq!(one, run(5, 1000));
    let other = run(2, 65_536);
    assert!(one.values.iter().zip(&other.values).all(|(a, b)| (a / b - 1.0).abs() < 1e-10));
}

#[test]
fn undetermined_parameters_are_named() {
    let source = source(1, 50, |x, i| 2.0 * x + 0.1 * noise(i));
    let estimate = fit(&[residual("y", "a*b*x")], &parameters(&[("a", 1.0), ("b", 1.0)]), &source);
    assert!(estimate.status.converged() && estimate.undetermined == [0, 1], "{estimate:?}");
    assert!(estimate.standard_errors().iter().all(|error| error.is_infinite()));
    assert!((estimate.values[0] * estimate.values[1] - 2.0).abs() < 0.1);
}

#[test]
fn bad_input_is_named() {
    let source = source(1, 20, |x, _| x);
    let refused = |residuals: &[Residual], parameters: &[Parameter]| {
        nonlinear_least_squares(residuals, parameters, &source, &Options::default(), &Silent).expect_err("refused")
    };
    let model = [residual("y", "a*x")];
    assert!(matches!(refused(&model, &[]), EstimateError::NoParameters));
    let text = |residuals: &[Residual], start: &[(&str, f64)]| refused(residuals, &parameters(start)).to_string();
    assert!(text(&model, &[("a", 1.0), ("x", 1.0)]).contains("taken by a column"));
    assert!(text(&model, &[("a", 1.0), ("a", 1.0)]).contains("another parameter"));
    assert!(text(&model, &[("a", 1.0), ("b", 1.0)]).contains("no model uses the parameter `b`"));
    assert!(text(&model, &[("a", f64::NAN)]).contains("the initial value of the parameter `a` is NaN"));
    assert!(text(&[residual("y", "a*z")], &[("a", 1.0)]).contains("`z`"));
    assert!(text(&[residual("y", "lag(a, 1)*x")], &[("a", 1.0)]).contains("another row"));
    assert!(text(&[residual("y", "log(a)*x")], &[("a", -1.0)]).contains("row 1 of episode episode 0"));
    assert!(text(&[model[0].clone().weighted(-1.0)], &[("a", 1.0)]).contains("the weight of residual `y`"));
    let outside = [Parameter::new("a", 2.0).between(0.0, 1.0)];
    assert!(refused(&model, &outside).to_string().contains("its bounds are 0 and 1"));
    let options = Options { radius: 0.0, ..Options::default() };
    let error = nonlinear_least_squares(&model, &parameters(&[("a", 1.0)]), &source, &options, &Silent);
    assert!(matches!(error, Err(EstimateError::Option { .. })));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Units of columns and parameters change the numbers, not the fit.
    #[test]
    fn units_do_not_matter(a in 0.5_f64..3.0, b in 0.3_f64..2.0, x_unit in -5..5_i32, y_unit in -5..5_i32) {
        let (x_unit, y_unit) = (2.0_f64.powi(3 * x_unit), 2.0_f64.powi(3 * y_unit));
        let plain = source(1, 60, |x, i| a * (-b * x).exp() + 0.01 * noise(i));
        let mut scaled = MemorySource::new(vec![Column::float("x"), Column::float("y")]);
        let x: Vec<f64> = (0..60).map(|i| 0.5 + 2.0 * i as f64 / 60.0).collect();
        let y = x.iter().enumerate().map(|(i, x)| y_unit * (a * (-b * x).exp() + 0.01 * noise(i))).collect();
        scaled.push_uniform("scaled", 0.1, vec![x.iter().map(|x| x * x_unit).collect(), y]);
        let model = [residual("y", "a*exp(-b*x)")];
        let one = fit(&model, &parameters(&[("a", 1.0), ("b", 1.0)]), &plain);
        let other = fit(&model, &parameters(&[("a", y_unit), ("b", 1.0 / x_unit)]), &scaled);
        prop_assert!(one.status.converged() && other.status.converged());
        prop_assert!((other.values[0] / y_unit / one.values[0] - 1.0).abs() < 1e-9, "{one:?} {other:?}");
        prop_assert!((other.values[1] * x_unit / one.values[1] - 1.0).abs() < 1e-9, "{one:?} {other:?}");
    }
}
