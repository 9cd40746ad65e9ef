//! Windows in the place of rows.

use std::f64::consts::TAU;

use super::*;
use crate::system::{columns::Columns, weak::Window, windows::WindowRows};

/// Rows at these stamps, of columns of the time.
fn signals(stamps: Vec<f64>, columns: &[(&str, &dyn Fn(f64) -> f64)]) -> MemorySource {
    let mut source = MemorySource::new(columns.iter().map(|(name, _)| Column::float(*name)).collect());
    let values = columns.iter().map(|(_, of)| stamps.iter().map(|&t| of(t)).collect::<Vec<f64>>().into()).collect();
    let stamps: Vec<i64> = stamps.iter().map(|t| (t * 1e9).round() as i64).collect();
    source.push("signals", stamps.into(), values);
    source
}

fn even(rows: usize, dt: f64) -> Vec<f64> {
    (0..rows).map(|k| k as f64 * dt).collect()
}

/// Stamps that lie up to a fifth of a period off.
fn uneven(rows: usize, dt: f64) -> Vec<f64> {
    (0..rows).map(|k| (k as f64 + 0.2 * (k as f64 * 12.9898).sin()) * dt).collect()
}

fn rate(of: &str) -> WeakTarget {
    WeakTarget { rate: Some(Rate { of: Expr::column(of), angle: false }), mean: Expr::number(0.0) }
}

/// The means of functions and the rates of states over all windows, in the order of the episodes.
fn windows(functions: &[&str], states: &[&str], reach: usize, source: &MemorySource) -> Mat<f64> {
    let scope = Scope::open();
    let functions = functions.iter().map(|text| Expr::parse(text, &scope).unwrap()).collect();
    let weak = Weak { reach, targets: states.iter().map(|state| rate(state)).collect(), accuracy: 1e-12 };
    let targets = states.iter().map(|state| central_difference(&Expr::column(*state), false)).collect();
    let system = System { weak: Some(weak.clone()), ..System::new(functions, targets) };
    let columns = Columns::compile(&system, &system.functions, source).unwrap();
    let mut window_rows = WindowRows::default();
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for (episode, described) in source.episodes().iter().enumerate() {
        let block = source.read(episode, 0..described.rows, columns.halo()).unwrap();
        window_rows.evaluate((&columns, &weak), &block, described, 0..described.rows).unwrap();
        let outputs = window_rows.outputs(&columns);
        rows.extend((0..window_rows.count()).map(|at| outputs.iter().map(|column| column[at]).collect::<Vec<f64>>()));
    }
    Mat::from_fn(rows.len(), system.functions.len() + system.targets.len(), |i, j| rows[i][j])
}

/// The mean of `(t - c)^2` under `(1 - s^2)^p` over windows whose half is `half`: that of s^2, a moment of the beta distribution, is 1/(2 p + 3).
fn second_moment(reach: usize, half: f64) -> f64 {
    let order = Weak { reach, targets: Vec::new(), accuracy: 1e-12 }.order();
    half * half / (2.0 * f64::from(order) + 3.0)
}

#[test]
fn polynomials_have_the_means_and_rates_of_their_integrals() {
    let (reach, dt, centre) = (20, 0.01, 2.5);
    let half = reach as f64 * dt;
    let source = signals(even(501, dt), &[("x", &|t| t - centre), ("w", &|t| (t - centre).powi(3))]);
    let matrix = windows(&["x", "x^2"], &["x", "w"], reach, &source);
    let middle = (0..matrix.nrows()).find(|&i| matrix[(i, 0)].abs() < 1e-9).expect("a window about 2.5 s");
    let moment = second_moment(reach, half);
    for (i, expected) in [1.0, 3.0 * moment].into_iter().enumerate() {
        // Euler and Maclaurin: what is left is of the order of the test function beside the end.
        assert!((matrix[(middle, 2 + i)] - expected).abs() < 1e-9 * expected.max(half), "{i}: {matrix:?}");
    }
    assert!((matrix[(middle, 1)] - moment).abs() < 1e-9 * moment);
    // By parts: the rate of the cube is three times the mean of the square, in every window.
    for i in 0..matrix.nrows() {
        assert!((matrix[(i, 3)] - 3.0 * matrix[(i, 1)]).abs() < 1e-8 * matrix[(i, 3)].abs(), "{i}");
    }
}

#[test]
fn weak_rates_of_waves_match_integrals() {
    let columns: [(&str, &dyn Fn(f64) -> f64); 2] = [("s", &|t| (3.0 * t).sin()), ("c", &|t| 3.0 * (3.0 * t).cos())];
    for (stamps, tolerance) in [(even(400, 0.01), 1e-9), (uneven(400, 0.01), 6e-4)] {
        let source = signals(stamps, &columns);
        let matrix = windows(&["c"], &["s"], 24, &source);
        assert_eq!(matrix.nrows(), (400 - 48_usize).div_ceil(6));
        let worst = (0..matrix.nrows()).map(|i| (matrix[(i, 0)] - matrix[(i, 1)]).abs()).fold(0.0, f64::max);
        assert!(worst < 3.0 * tolerance, "{worst:e}");
        // The error estimate from the stamps alone is of the error's size.
        let accuracy = weak_accuracy(24, &source).unwrap();
        assert!(worst < 30.0 * accuracy && accuracy < tolerance, "{accuracy:e} for {worst:e}");
    }
}

#[test]
fn constants_and_lines_are_exact_at_any_stamps() {
    let source = signals(uneven(300, 0.02), &[("x", &|t| 1e3 + 2.0 * t), ("one", &|_| 7.0)]);
    let matrix = windows(&["one"], &["x", "one"], 15, &source);
    for i in 0..matrix.nrows() {
        assert!((matrix[(i, 0)] - 7.0).abs() < 1e-13, "mean {}", matrix[(i, 0)]);
        assert!((matrix[(i, 1)] - 2.0).abs() < 1e-8 && matrix[(i, 2)].abs() < 1e-10, "rates");
    }
}

#[test]
fn the_units_of_time_and_of_states_scale_the_rates() {
    let wave = |scale: f64, unit: f64| {
        let stamps = even(200, 0.01 * unit);
        windows(&["s"], &["s"], 12, &signals(stamps, &[("s", &|t| scale * (3.0 * t / unit).sin())]))
    };
    let (one, other) = (wave(1.0, 1.0), wave(1e3, 10.0));
    for i in 0..one.nrows() {
        assert!((other[(i, 0)] - 1e3 * one[(i, 0)]).abs() < 1e-9);
        assert!((other[(i, 1)] - 1e2 * one[(i, 1)]).abs() < 1e-9);
    }
}

#[test]
fn wrapped_angle_continues() {
    let wrapped = |t: f64| (5.0 * t).rem_euclid(TAU) - TAU / 2.0;
    let source = signals(even(300, 0.01), &[("a", &wrapped)]);
    let weak = |angle| Weak {
        reach: 10,
        targets: vec![WeakTarget { rate: Some(Rate { of: Expr::column("a"), angle }), mean: Expr::number(0.0) }],
        accuracy: 1e-12,
    };
    let rates = |angle| {
        let target = central_difference(&Expr::column("a"), true);
        let system = System { weak: Some(weak(angle)), ..System::new(Vec::new(), vec![target]) };
        let root = scan(&SystemPlan::new(system, Some(100), &source).unwrap(), &source).root(0);
        [root.mean_y[0], (root.total[0] / root.weight).sqrt()]
    };
    let [mean, spread] = rates(true);
    assert!((mean - 5.0).abs() < 1e-9 && spread < 1e-6, "{mean} {spread}");
    assert!(rates(false)[1] > 1.0);
}

fn lorenz_system(reach: usize) -> System {
    let targets = ["x", "y", "z"].map(rate).to_vec();
    System {
        weak: Some(Weak { reach, targets, accuracy: 1e-12 }),
        also: states(),
        ..System::new(monomials(2), derivatives())
    }
}

#[test]
fn noise_free_rows_have_the_equations_of_the_system() {
    let source = lorenz(3, 700, 0.005, 0.0, 0.0);
    let plan = SystemPlan::new(lorenz_system(20), None, &source).unwrap();
    assert!(!plan.is_polynomial());
    let statistic = scan(&plan, &source);
    let root = statistic.root(0);
    let solution = least_squares(&root, &root.deviation());
    let functions: Vec<String> = monomials(2).iter().map(Expr::to_string).collect();
    let truth = |function: &str, target: usize| match (function, target) {
        ("x", 0) => -10.0,
        ("y", 0) => 10.0,
        ("x", 1) => 28.0,
        ("y", 1) | ("x*z", 1) => -1.0,
        ("x*y", 2) => 1.0,
        ("z", 2) => -8.0 / 3.0,
        _ => 0.0,
    };
    for (j, function) in functions.iter().enumerate() {
        for t in 0..3 {
            let error = solution.coefficients[(j, t)] - truth(function, t);
            // The recorded steps of Runge and Kutta err by 1e-6 themselves, central differences by 1e-2.
            assert!(error.abs() < 2e-5, "{function} in {t}: {error:e}");
        }
    }
}

#[test]
fn windows_are_counted_at_their_middles() {
    let source = lorenz(2, 401, 0.01, 0.0, 0.1);
    let plan = SystemPlan::new(lorenz_system(16), Some(100), &source).unwrap();
    let statistic = scan(&plan, &source);
    // Middles at 0, 4, ..., 400 of 401 rows; those from 16 to 384 have all their rows.
    let counts = statistic.counts();
    assert_eq!((counts.complete, counts.at_border, counts.incomplete), (2 * 93, 2 * 8, 0));
    assert_eq!(statistic.rows(0), 186);
    assert_eq!(statistic.also().rows, 802);
    // Ranges are those of the rows.
    let rows = rows_of(&states(), &source);
    let most = (0..rows.nrows()).map(|i| rows[(i, 0)]).fold(f64::NEG_INFINITY, f64::max);
    assert_eq!(statistic.ranges(0)[0][1], most);
}

#[test]
fn missing_values_end_windows() {
    let mut x: Vec<f64> = (0..200).map(|k| (f64::from(k) * 0.1).sin()).collect();
    x[100] = f64::NAN;
    let mut source = MemorySource::new(vec![Column::float("x")]);
    source.push_uniform("holed", 0.01, vec![x.clone()]);
    let system = |reach| System {
        weak: Some(Weak { reach, targets: vec![rate("x")], accuracy: 1e-12 }),
        ..System::new(vec![Expr::column("x")], vec![central_difference(&Expr::column("x"), false)])
    };
    let count = |reach, source: &MemorySource| {
        let counts = scan(&SystemPlan::new(system(reach), None, source).unwrap(), source).counts();
        (counts.complete, counts.at_border, counts.incomplete)
    };
    // Reach 8, every second row: middles 8 to 190 are whole but those from 92 to 108.
    assert_eq!(count(8, &source), (92 - 9, 8, 9));
    // Two episodes, as a gap makes them, have what each has alone.
    let mut split = MemorySource::new(vec![Column::float("x")]);
    split.push_uniform("before", 0.01, vec![x[..100].to_vec()]);
    split.push_uniform("behind", 0.01, vec![x[101..].to_vec()]);
    assert_eq!(count(8, &split), (2 * 42, 4 + 4 + 4 + 4, 0));
    assert_eq!(count(60, &split).0, 0);
}

#[test]
fn windows_across_regions_are_dropped() {
    let source = lorenz(2, 600, 0.01, 0.0, 0.1);
    let system = System { partition: Some(voronoi()), ..lorenz_system(8) };
    let statistic = scan(&SystemPlan::new(system, None, &source).unwrap(), &source);
    let counts = statistic.counts();
    let in_regions: u64 = (0..3).map(|region| statistic.rows(region)).sum();
    assert!(statistic.unassigned() > 0 && in_regions > 0);
    assert_eq!(in_regions + statistic.unassigned(), counts.complete);
}

#[test]
fn windows_have_their_least_row_weight() {
    let source = lorenz(2, 400, 0.01, 0.0, 0.1);
    let weighted = |weight: &str| {
        let weight = Expr::parse(weight, &Scope::open()).unwrap();
        let system = System { weight: Some(weight), ..lorenz_system(8) };
        let statistic = scan(&SystemPlan::new(system, None, &source).unwrap(), &source);
        (statistic.rows(0), statistic.root(0).weight)
    };
    let (rows, weight) = weighted("2 + 0*w");
    assert_eq!(weight, 2.0 * rows as f64);
    // `w` is 0 in every fourth row.
    assert_eq!(weighted("w").0, 0);
}

#[test]
fn merged_parts_equal_the_whole() {
    let source = lorenz(4, 500, 0.01, 0.0, 0.5);
    let plan = SystemPlan::new(lorenz_system(16), Some(64), &source).unwrap();
    let whole = plan.sum_rows(&source, &Silent).unwrap();
    let one = with_threads(1, || plan.sum_rows(&source, &Silent)).unwrap();
    assert_eq!(one, whole);
    let part = |episodes: &[usize]| {
        let mut part = MemorySource::new(source.columns().to_vec());
        for &episode in episodes {
            let described = &source.episodes()[episode];
            let block = source.read(episode, 0..described.rows, Default::default()).unwrap();
            part.push(&described.name, block.time.clone(), block.columns.clone());
        }
        part
    };
    let permuted = plan.sum_rows(&part(&[2, 0, 3, 1]), &Silent).unwrap();
    assert_eq!(permuted, whole);
    let mut merged = plan.sum_rows(&part(&[3, 1]), &Silent).unwrap();
    merged.merge(plan.sum_rows(&part(&[2, 0]), &Silent).unwrap()).unwrap();
    assert_eq!(merged, whole);
    // Sums of rows, or of other windows, are not those of these windows.
    for other in [System { weak: None, ..lorenz_system(16) }, lorenz_system(20)] {
        let other = SystemPlan::of_products(other, Some(64), &source).unwrap();
        assert!(merged.merge(other.sum_rows(&part(&[0]), &Silent).unwrap()).is_err());
    }
    let again = SystemPlan::of_coordinates(plan.system.clone(), plan.chunk_rows, &plan.coordinates()).unwrap();
    assert_eq!(again.hash(), plan.hash());
}

#[test]
fn impossible_windows_are_refused() {
    let source = lorenz(1, 100, 0.01, 0.0, 0.1);
    let short = SystemPlan::new(lorenz_system(3), None, &source).unwrap_err().to_string();
    assert!(short.contains("3 rows to either side") && short.contains("need 4 rows"), "{short}");
}

proptest! {
    /// Means are weighted means, and the rate of a line is its slope, whatever the stamps.
    #[test]
    fn weights_match_means_and_of_slopes(steps in prop::collection::vec(1_i64..5_000_000, 8..60)) {
        let mut stamps = vec![0_i64];
        steps.iter().for_each(|step| stamps.push(stamps[stamps.len() - 1] + step));
        stamps.truncate(stamps.len() / 2 * 2 - 1);
        let mut window = Window::default();
        window.set(&stamps, 6);
        prop_assert!((window.mean.iter().sum::<f64>() - 1.0).abs() < 1e-12);
        prop_assert!(window.mean.iter().all(|&weight| weight >= 0.0));
        let size: f64 = window.rate.iter().map(|rate| rate.abs()).sum();
        prop_assert!(window.rate.iter().sum::<f64>().abs() < 1e-12 * size);
        let slope: f64 = window.rate.iter().zip(&stamps).map(|(rate, &stamp)| rate * (stamp as f64 * 1e-9)).sum();
        prop_assert!((slope - 1.0).abs() < 1e-9, "{slope}");
    }
}
