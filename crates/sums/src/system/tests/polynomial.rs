//! The scan by moments beside the scan by products and TSQR.

use super::*;
use crate::system::polynomial::Monomials;

fn plans(system: &System, source: &MemorySource) -> (SystemPlan, SystemPlan) {
    let (fast, general) =
        (SystemPlan::new(system.clone(), None, source), SystemPlan::of_products(system.clone(), None, source));
    (fast.unwrap(), general.unwrap())
}

/// Relative excess of the squared error of a fit on `actual` over the least one, on the rows behind `expected`.
fn excess(actual: &SquareRoot, expected: &SquareRoot) -> f64 {
    let fit = least_squares(actual, &expected.deviation());
    let errors = expected.error(fit.coefficients.as_ref(), &fit.intercept);
    let least = least_squares(expected, &expected.deviation()).rss;
    errors.iter().zip(&least).map(|(error, least)| (error / least - 1.0).abs()).fold(0.0, f64::max)
}

#[test]
fn loss_at_degree_five_follows_the_condition() {
    for (offset, noise) in [(0.0, 0.01), (0.0, 0.5), (30.0, 0.1)] {
        let source = lorenz(2, 10_000, 0.005, offset, noise);
        let (fast, general) = plans(&System::new(monomials(5), derivatives()), &source);
        assert!(fast.is_polynomial() && fast.sums() < general.sums() / 3);
        let rows = rows_of(&[monomials(5), derivatives()].concat(), &source);
        let expected = reference(rows.as_ref(), 55, None);
        let (moments, products) = (scan(&fast, &source), scan(&general, &source));
        let root = moments.root(0);
        let condition = least_squares(&expected, &expected.deviation()).condition;
        let error = coefficient_error(&root, &expected);
        // Digits lost by the factor of the Gram matrix, and by raw monomials whatever factors them.
        let bound = 1e-15 * root.condition + 1e-13 * condition;
        assert!(error < bound, "{error:e} {bound:e}");
        let (first, second) = (excess(&root, &expected), excess(&products.root(0), &expected));
        assert!(first < 1e-12 && second < 1e-12, "{first:e} {second:e}");
        assert_close(&root.residual, &expected.residual, 1e-9);
        for (range, direct) in moments.ranges(0).iter().flatten().zip(products.ranges(0).iter().flatten()) {
            assert!((range - direct).abs() <= 1e-14 * direct.abs(), "{range} {direct}");
        }
        assert_eq!(moments.counts(), products.counts());
    }
}

#[test]
fn exact_data_and_ill_conditioned_libraries_take_products() {
    let source = lorenz(1, 5_000, 0.002, 0.0, 0.0);
    let scope = Scope::open();
    let exact = ["10*(y - x)", "x*(28 - z) - y"].map(|text| Expr::parse(text, &scope).unwrap()).to_vec();
    let plan = SystemPlan::new(System::new(monomials(3), exact), None, &source).unwrap();
    assert!(!plan.is_polynomial());
    let root = scan(&plan, &source).root(0);
    assert!(root.residual.iter().zip(&root.total).all(|(residual, total)| *residual < 1e-24 * total));

    // w has four values: its fourth power is a sum of lower ones.
    let library = Library::polynomial(&[Expr::column("x"), Expr::column("w")], 4).unwrap().functions().to_vec();
    let plan = SystemPlan::new(System::new(library, derivatives()), None, &source).unwrap();
    assert!(!plan.is_polynomial());
    assert!(!scan(&plan, &source).spread(0).confounded.is_empty());
}

#[test]
fn polynomial_libraries_are_recognised() {
    let scope = Scope::open();
    let parse = |texts: &[&str]| -> Vec<Expr> { texts.iter().map(|text| Expr::parse(text, &scope).unwrap()).collect() };
    let recognised =
        Monomials::recognise(&parse(&["y*x", "sin(z)*x", "x", "y^2", "(x)^2", "y", "sin(z)^2", "sin(z)", "y*sin(z)"]));
    let recognised = recognised.expect("all monomials of y, x, sin(z) up to degree 2");
    assert_eq!((recognised.degree, recognised.variables.len()), (2, 3));
    for other in [
        &["x", "y", "x^2", "x*y"][..],
        &["x", "y", "x^2", "x*y", "x*y"],
        &["x", "y", "x^2", "x*y", "1/y"],
        &["x", "y", "x^2", "x*y", "2*y^2"],
        &[],
        &["1"],
    ] {
        assert_eq!(Monomials::recognise(&parse(other)), None, "{other:?}");
    }
    assert_eq!(Monomials::recognise(&monomials(4)).map(|monomials| monomials.degree), Some(4));
}

#[test]
fn nearly_a_thousand_columns() {
    let (n, m) = (12_000, 16);
    let mut source = MemorySource::new((0..m + 1).map(|k| Column::float(format!("x{k}"))).collect());
    let mut state = 1_u64;
    let mut random = || {
        state = fleetfoot_data::mix(state);
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    };
    let mut columns: Vec<Vec<f64>> = (0..m).map(|k| (0..n).map(|_| 0.02 * k as f64 + random()).collect()).collect();
    let target = (0..n).map(|i| columns[3][i] * columns[7][i] - 2.0 * columns[15][i].powi(3) + 0.1 * random());
    let target: Vec<f64> = target.collect();
    columns.push(target);
    source.push_uniform("many", 0.01, columns);
    let variables: Vec<Expr> = (0..m).map(|k| Expr::column(format!("x{k}"))).collect();
    let functions = Library::polynomial(&variables, 3).unwrap().functions().to_vec();
    let system = System::new(functions.clone(), vec![Expr::column("x16")]);
    let plan = SystemPlan::new(system, Some(3_000), &source).unwrap();
    assert!(plan.is_polynomial() && functions.len() == 968);
    let statistic = scan(&plan, &source);
    let fit = least_squares(&statistic.root(0), &statistic.root(0).deviation());
    let place = |text: &str| functions.iter().position(|f| f.to_string() == text).expect("a function");
    // 12,000 rows for 969 coefficients, noise of deviation 0.06: standard errors of a few hundredths.
    assert_eq!(fit.rank, 968);
    assert!((fit.coefficients[(place("x3*x7"), 0)] - 1.0).abs() < 0.05);
    assert!((fit.coefficients[(place("x15^3"), 0)] + 2.0).abs() < 0.05);
    let noise = fit.rss[0] / (n - 969) as f64;
    assert!((noise / (0.01 / 3.0) - 1.0).abs() < 0.1, "{noise}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    #[test]
    fn order_of_functions_is_the_users(seed in 0_u64..1_000, degree in 2_u32..4) {
        let source = lorenz(1, 3_000, 0.01, 2.0, 0.1);
        let functions = monomials(degree);
        let mut order: Vec<usize> = (0..functions.len()).collect();
        order.sort_by_key(|&j| fleetfoot_data::mix(seed * 1_000 + j as u64));
        let shuffled: Vec<Expr> = order.iter().map(|&j| functions[j].clone()).collect();
        let run = |functions: Vec<Expr>| {
            let plan = SystemPlan::new(System::new(functions, derivatives()), None, &source).unwrap();
            assert!(plan.is_polynomial());
            scan(&plan, &source)
        };
        let (plain, other) = (run(functions), run(shuffled));
        let permuted = plain.root(0).select(&order);
        prop_assert!(coefficient_error(&other.root(0), &permuted) < 1e-9);
        let ranges = plain.ranges(0);
        for (&j, range) in order.iter().zip(other.ranges(0)) {
            prop_assert!((0..2).all(|side| (range[side] - ranges[j][side]).abs() <= 1e-14 * ranges[j][side].abs()));
        }
    }
}
