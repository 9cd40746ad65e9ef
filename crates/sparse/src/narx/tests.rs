//! Tests: known orders are recovered, and the columns of a smaller order agree with a separate scan.

use faer::Mat;
use fleetfoot_data::{Column, MemorySource, Silent, mix, with_threads};
use fleetfoot_library::{Expr, Library};
use fleetfoot_stats::Compressed;

use super::*;
use crate::threshold::{Criterion, CriterionOptions};
use fleetfoot_sums::system::{System, SystemPlan, SystemScan};

fn order(outputs: usize, inputs: usize, degree: usize) -> NarxOrder {
    NarxOrder { outputs, inputs, degree, direct: false, every: 1 }
}

fn direct(order: NarxOrder) -> NarxOrder {
    NarxOrder { direct: true, ..order }
}

fn library(most: NarxOrder) -> NarxLibrary {
    NarxLibrary::new(&[Expr::column("y")], &[Expr::column("u")], most).unwrap()
}

/// Uniform in -1 to 1.
fn noise(seed: u64, key: u64) -> f64 {
    mix(mix(seed).wrapping_add(key)) as f64 / u64::MAX as f64 * 2.0 - 1.0
}

/// `y(k) = 0.6 y(k-1) - 0.3 y(k-2) + 0.8 u(k-1) + 0.4 y(k-1) u(k-1) + noise`: ny 2, nu 1, degree 2.
fn recording(seed: u64, episodes: usize, rows: usize, size: f64) -> MemorySource {
    let mut source = MemorySource::new(vec![Column::float("u"), Column::float("y")]);
    for episode in 0..episodes as u64 {
        let u: Vec<f64> = (0..rows as u64).map(|k| noise(seed + 100 * episode, k)).collect();
        let mut y = vec![noise(seed, 7), noise(seed, 8)];
        for k in 2..rows {
            let e = size * noise(seed + 100 * episode + 1, k as u64);
            y.push(0.6 * y[k - 1] - 0.3 * y[k - 2] + 0.8 * u[k - 1] + 0.4 * y[k - 1] * u[k - 1] + e);
        }
        source.push_uniform(format!("run {episode}"), 0.1, vec![u, y]);
    }
    source
}

fn scan(functions: &[Expr], source: &MemorySource) -> SystemScan {
    let system = System::new(functions.to_vec(), vec![Expr::column("y").shifted(-1)]);
    SystemPlan::new(system, Some(50), source).unwrap().scan(source, &Silent).unwrap()
}

#[test]
fn orders_have_candidates_of_separate_libraries() {
    for most in [order(3, 2, 3), direct(order(2, 2, 2)), order(2, 0, 4), direct(order(0, 3, 2))] {
        let all = library(most);
        for order in all.orders() {
            let names = |library: &NarxLibrary| library.functions().iter().map(Expr::to_string).collect::<Vec<_>>();
            let columns = all.columns(order);
            assert_eq!(columns[0], 0);
            let mut taken: Vec<String> = columns[1..].iter().map(|&j| all.functions()[j - 1].to_string()).collect();
            let mut alone = names(&library(order));
            taken.sort();
            alone.sort();
            assert_eq!(taken, alone, "{order} of {most}");
        }
        assert_eq!(all.orders().last(), Some(&most));
        assert_eq!(all.columns(most).len(), all.functions().len() + 1);
    }
    let names: Vec<String> = library(direct(order(2, 1, 1))).functions().iter().map(Expr::to_string).collect();
    assert_eq!(names, ["y", "lag(y, 1)", "lead(u, 1)", "u"]);
    assert!(NarxLibrary::new(&[Expr::column("y")], &[], order(60, 0, 9)).is_err());
    assert_eq!(library(order(2, 2, 3)).functions(), Library::polynomial(&lagged(), 3).unwrap().functions());
}

#[test]
fn one_library_holds_unnested_orders() {
    let (y, u) = ([Expr::column("y")], [Expr::column("u")]);
    let orders = [order(5, 5, 1), order(2, 1, 2), direct(order(1, 1, 3)), order(3, 3, 1)];
    let all = NarxLibrary::of_orders(&y, &u, &orders).unwrap();
    for order in orders {
        let mut taken: Vec<String> =
            all.columns(order)[1..].iter().map(|&j| all.functions()[j - 1].to_string()).collect();
        let mut alone: Vec<String> = library(order).functions().iter().map(Expr::to_string).collect();
        taken.sort();
        alone.sort();
        assert_eq!(taken, alone, "{order}");
    }
    let mut once: Vec<String> = all.functions().iter().map(Expr::to_string).collect();
    once.sort();
    once.dedup();
    assert_eq!(once.len(), all.functions().len());
    // Ten lags; the squares and products of y, its lag and u; the input at once, its products, and all of degree three of three variables.
    assert_eq!(once.len(), 10 + 6 + (1 + 3) + 10);
}

/// Past values that are further apart: the columns of an order and of those within it, and what is not within.
#[test]
fn past_values_may_be_further_apart() {
    let spread = |order: NarxOrder| NarxOrder { every: 5, ..order };
    let all = library(spread(direct(order(3, 2, 2))));
    let names = |narx_order: NarxOrder| {
        let columns = all.columns(narx_order);
        let names = columns[1..].iter().map(|&j| all.functions()[j - 1].to_string());
        names.filter(|name| !name.contains(['*', '^'])).collect::<Vec<_>>()
    };
    assert_eq!(names(spread(direct(order(3, 2, 2)))), ["y", "lag(y, 5)", "lag(y, 10)", "lead(u, 1)", "u", "lag(u, 5)"]);
    assert_eq!(names(spread(order(2, 1, 1))), ["y", "lag(y, 5)", "u"]);
    assert!(all.orders().iter().all(|order| order.every == 5));
    assert_eq!(all.orders().last(), Some(&spread(direct(order(3, 2, 2)))));
    let (near, far) = (order(2, 2, 1), spread(order(3, 3, 2)));
    assert!(!near.is_within(far) && spread(near).is_within(far) && order(1, 1, 2).is_within(far));
    assert_eq!((far.reach(), near.reach(), order(0, 0, 1).reach()), (11, 2, 0));
    let addend = Addend { function: Expr::column("y").powi(2), outputs: true, inputs: false };
    let lagged = NarxLibrary::additive(&[addend], &[spread(order(3, 0, 1))]);
    let texts: Vec<String> = lagged.functions().iter().map(Expr::to_string).collect();
    assert_eq!(texts, ["y^2", "lag(y, 5)^2", "lag(y, 10)^2"]);
}

#[test]
fn given_functions_are_lagged_and_not_multiplied() {
    let (y, u) = (Expr::column("y"), Expr::column("u"));
    let addend = |function: Expr, outputs, inputs| Addend { function, outputs, inputs };
    let addends = [addend(y.max(0.0).sqrt(), true, false), addend(u.powi(2), false, true), addend(&y * &u, true, true)];
    let all = NarxLibrary::additive(&addends, &[direct(order(2, 3, 1))]);
    let names =
        |columns: &[usize]| columns[1..].iter().map(|&j| all.functions()[j - 1].to_string()).collect::<Vec<_>>();
    let most = names(&all.columns(direct(order(2, 3, 1))));
    let expected = [
        "sqrt(max(y, 0))",
        "sqrt(max(lag(y, 1), 0))",
        "lead(u, 1)^2",
        "u^2",
        "lag(u, 1)^2",
        "lag(u, 2)^2",
        "y*u",
        "lag(y, 1)*lag(u, 1)",
    ];
    assert_eq!(most, expected);
    assert_eq!(names(&all.columns(order(1, 1, 1))), ["sqrt(max(y, 0))", "u^2", "y*u"]);
    assert_eq!(names(&all.columns(order(2, 0, 1))), ["sqrt(max(y, 0))", "sqrt(max(lag(y, 1), 0))"]);
}

fn lagged() -> Vec<Expr> {
    let (y, u) = (Expr::column("y"), Expr::column("u"));
    vec![y.clone(), y.shifted(1), u.clone(), u.shifted(1)]
}

#[test]
fn every_criterion_recovers_the_true_order() {
    let source = recording(3, 8, 400, 0.05);
    let library = library(order(4, 3, 3));
    let scanned = scan(library.functions(), &source);
    let problem = scanned.root(0).compressed(true);
    let folds = folds(&scanned, 4);
    let criterion = |criterion| OrderChoice::Criterion(criterion, CriterionOptions::default());
    for (choice, max_terms) in [
        (criterion(Criterion::Bic), None),
        (criterion(Criterion::Bic), Some(10)),
        (OrderChoice::CrossValidation { one_standard_error: true }, None),
        (OrderChoice::CrossValidation { one_standard_error: true }, Some(10)),
    ] {
        let options = OrderOptions { max_terms, choice };
        let run = || search_orders(&problem, &library, &library.orders(), &folds, &options, &Silent).unwrap();
        let search = with_threads(1, run);
        assert_eq!(search, with_threads(2, run), "the threads change nothing");
        let best = search.choice();
        assert_eq!(best.order, order(2, 1, 2), "{options:?}: {best:?}");
        // One-step errors cannot be less than the noise, 0.05 / sqrt(3), by more than chance.
        let rmse = (best.rss[0] / problem.weight).sqrt();
        assert!((rmse / (0.05 / 3f64.sqrt()) - 1.0).abs() < 0.05, "{rmse}");
        if max_terms.is_some() {
            assert_eq!(best.terms, [4]);
        }
        assert_eq!(search.scores.len(), 4 * 3 * 3);
        assert!(search.scores.windows(2).all(|pair| pair[0].candidates <= pair[1].candidates));
    }
}

/// Every n-th episode held out.
fn folds(scan: &SystemScan, count: usize) -> Vec<NarxFold> {
    let mut episodes: Vec<_> = scan.units().iter().map(|unit| unit.episode).collect();
    episodes.dedup();
    let fold = |unit: usize| episodes.iter().position(|id| *id == scan.units()[unit].episode).unwrap() % count;
    let train = Mat::from_fn(scan.units().len(), count, |i, f| if fold(i) == f { 0.0 } else { 1.0 });
    let test = Mat::from_fn(scan.units().len(), count, |i, f| if fold(i) == f { 1.0 } else { 0.0 });
    let problems = |weights: &Mat<f64>| -> Vec<Compressed> {
        scan.roots(0, weights.as_ref()).iter().map(|root| root.compressed(true)).collect()
    };
    problems(&train).into_iter().zip(problems(&test)).map(|(train, test)| NarxFold { train, test }).collect()
}

#[test]
fn statistic_equals_scans_of_each_order() {
    let source = recording(5, 3, 200, 0.1);
    let all = library(order(3, 2, 2));
    let most = scan(all.functions(), &source);
    let search =
        search_orders(&most.root(0).compressed(true), &all, &all.orders(), &[], &OrderOptions::default(), &Silent)
            .unwrap();
    for score in &search.scores {
        // The smaller library on the rows that have all lags of the larger: the longest lag stays a condition by a term that is always zero.
        let functions: Vec<Expr> = library(score.order).functions().to_vec();
        let complete = Expr::column("y").shifted(2) + Expr::column("u").shifted(1);
        let zero = &complete - &complete;
        let system = System {
            weight: Some(Expr::number(1.0) + zero),
            ..System::new(functions, vec![Expr::column("y").shifted(-1)])
        };
        let scanned = SystemPlan::new(system, Some(50), &source).unwrap().scan(&source, &Silent).unwrap();
        let compressed = scanned.root(0).compressed(true);
        assert!(
            (compressed.residual[0] / score.rss[0] - 1.0).abs() < 1e-9,
            "{}: {} {}",
            score.order,
            compressed.residual[0],
            score.rss[0]
        );
    }
}

#[test]
fn cross_validation_needs_folds() {
    let source = recording(5, 2, 60, 0.1);
    let library = library(order(1, 1, 1));
    let problem = scan(library.functions(), &source).root(0).compressed(true);
    let choice = OrderChoice::CrossValidation { one_standard_error: false };
    let options = OrderOptions { choice, ..OrderOptions::default() };
    let error = search_orders(&problem, &library, &library.orders(), &[], &options, &Silent).unwrap_err().to_string();
    assert!(error.contains("no folds"), "{error}");
}
