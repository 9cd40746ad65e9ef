//! A global search before the descent: initial values that diverge or lie in another valley, and the same bits on all
//! threads.

use fleetfoot_data::{MemorySource, Silent, with_threads};
use fleetfoot_estimate::{
    EstimateError, Options, OutputError, OutputErrorOptions, Parameter, Residual, nonlinear_least_squares, output_error,
};

use crate::{
    output_error::System,
    simulation::{expression, noise, source},
};

/// A wheel on a spring with damping.
const WHEEL: System = System {
    states: &[("x", "v"), ("v", "-k*x - c*v")],
    inputs: &[],
    parameters: &[("k", 25.0), ("c", 0.05)],
    slope: |x, _, p| vec![x[1], -p[0] * x[0] - p[1] * x[1]],
    beginning: [1.0, 0.0],
};

/// A start from which the wheel spins away.
fn unstable() -> Vec<Parameter> {
    vec![Parameter::new("k", 300.0).between(0.1, 1000.0), Parameter::new("c", -40.0).between(-50.0, 10.0)]
}

fn fit(search: usize) -> Result<OutputError, EstimateError> {
    let noisy = crate::output_error::Noise { measured: [0.05, 0.25], process: [0.0; 2] };
    let rows = WHEEL.source(0.02, vec![WHEEL.rows(3, 500, 0.02, noisy)]);
    let mut options = OutputErrorOptions::default();
    options.descent.search = search;
    output_error(&WHEEL.model(0.02), &unstable(), &rows, &options, &Silent)
}

#[test]
fn unstable_initial_values_reach_the_minimum() {
    assert!(matches!(fit(0), Err(EstimateError::Diverges { .. })));
    let fitted = fit(300).unwrap();
    for (j, (name, truth)) in WHEEL.parameters.iter().enumerate() {
        assert!((fitted.values[j] - truth).abs() < 3.0 * fitted.standard_errors()[j], "{name}: {fitted:?}");
    }
    assert!((fitted.deviations[0] / 0.05 - 1.0).abs() < 0.1, "{fitted:?}");
}

#[test]
fn threads_change_no_bit_of_a_search() {
    let [one, three] = [1, 3].map(|threads| with_threads(threads, || fit(60)).unwrap().values);
    assert_eq!(one, three);
}

#[test]
fn rows_without_simulation_are_searched_too() {
    let x: Vec<f64> = (0..150).map(|row| 0.05 * f64::from(row)).collect();
    let y = x.iter().enumerate().map(|(row, x)| (3.7 * x).sin() + 0.1 * noise(row)).collect();
    let rows: MemorySource = source(&["x", "y"], 0.05, vec![vec![x, y]]);
    let residual = Residual::new(expression("y"), expression("sin(w*x)"));
    let at = |search| {
        let options = Options { search, ..Options::default() };
        let parameter = Parameter::new("w", 0.5).between(0.01, 50.0);
        nonlinear_least_squares(std::slice::from_ref(&residual), &[parameter], &rows, &options, &Silent).unwrap()
    };
    let [without, with] = [0, 500].map(|search| (at(search).values[0] - 3.7).abs());
    assert!(without > 0.1 && with < 0.01, "{without} {with}");
}
