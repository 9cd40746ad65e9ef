//! A system from separate tasks beside its own scan.

use super::*;
use crate::structured::{Candidates, Plan, Regression, Task, Term};

fn regression(functions: &[Expr]) -> Regression {
    let latent = |name: &str| Candidates { name: name.into(), functions: functions.to_vec() };
    let task = |(latent, target): (usize, Expr)| Task {
        name: format!("equation {latent}"),
        target,
        terms: vec![Term { latent, coefficient: Expr::number(1.0) }],
        prior: false,
    };
    Regression {
        latents: ["dx", "dy", "dz"].map(latent).to_vec(),
        tasks: derivatives().into_iter().enumerate().map(task).collect(),
        weight: None,
    }
}

#[test]
fn separate_equations_are_a_system() {
    let source = lorenz(2, 800, 0.01, 1.0, 0.05);
    let system = System { also: states(), ..System::new(mixed(), derivatives()) };
    let own = scan(&SystemPlan::new(system, Some(100), &source).unwrap(), &source);
    let with_constant = [vec![Expr::number(1.0)], mixed()].concat();
    for (functions, constant) in [(mixed(), None), (with_constant, Some(0))] {
        let regression = regression(&functions);
        let scanned = Plan::new(regression.clone(), states(), 100, &source).unwrap().scan(&source, &Silent).unwrap();
        let found = SystemScan::of_tasks(&scanned, &regression).unwrap();
        assert_eq!((found.constant(), found.functions(), found.targets()), (constant, 5, 3));
        assert_eq!((found.units(), found.counts()), (own.units(), own.counts()));
        assert_eq!((found.ranges(0), found.also()), (own.ranges(0), own.also()));
        let weights = Mat::from_fn(found.units().len(), 2, |k, b| if b == 0 { 1.0 } else { (k % 3) as f64 });
        let roots = found.roots(0, weights.as_ref());
        for (root, expected) in roots.iter().zip(own.roots(0, weights.as_ref())) {
            assert!(coefficient_error(root, &expected) < 1e-11);
            assert_close(&root.residual, &expected.residual, 1e-10);
        }
        let solution = least_squares(&own.root(0), &own.root(0).deviation());
        let errors =
            |scan: &SystemScan| scan.residual_covariance(0, solution.coefficients.as_ref(), &solution.intercept);
        for (k, (entry, expected)) in errors(&found).iter().zip(errors(&own)).enumerate() {
            // Places 0, 2 and 5 are variances.
            let known = [0, 2, 5].contains(&k);
            assert!(if known { (entry - expected).abs() < 1e-9 * expected } else { entry.is_nan() }, "{k}: {entry}");
        }
    }
}

#[test]
fn tasks_that_are_no_system_are_refused() {
    let source = lorenz(1, 200, 0.01, 0.0, 0.05);
    let plain = regression(&mixed());
    let scanned = Plan::new(plain.clone(), Vec::new(), 100, &source).unwrap().scan(&source, &Silent).unwrap();
    let mut scaled = plain.clone();
    scaled.tasks[1].terms[0].coefficient = Expr::number(-1.0);
    let mut other = plain.clone();
    other.latents[2].functions.pop();
    for wrong in [scaled, other] {
        assert!(matches!(SystemScan::of_tasks(&scanned, &wrong), Err(SystemError::TaskShape { .. })));
    }
    let mut fewer = scanned.clone();
    fewer.tasks.pop();
    assert!(matches!(SystemScan::of_tasks(&fewer, &plain), Err(SystemError::TaskCoordinates)));
}
