use faer::{Mat, MatRef};
use fleetfoot_data::{Column, MemorySource, Silent, Source, with_threads};
use fleetfoot_library::{Design, DesignRows, Expr, Library, Scope, central_difference};
use fleetfoot_model::{Partition, Rule};
use fleetfoot_stats::{Factor, SquareRoot, least_squares, scan::RowError};
use proptest::prelude::*;

use super::*;

mod polynomial;
mod sums;
mod weak;

/// Lorenz trajectories, by Runge-Kutta steps; `offset` is added to every state, and a little noise that no polynomial
/// explains.
fn lorenz(episodes: usize, rows: usize, dt: f64, offset: f64, noise: f64) -> MemorySource {
    let mut source = MemorySource::new(["x", "y", "z", "w"].map(Column::float).to_vec());
    let slope = |[x, y, z]: [f64; 3]| [10.0 * (y - x), x * (28.0 - z) - y, x * y - 8.0 / 3.0 * z];
    for episode in 0..episodes {
        let mut s = [-8.0 + episode as f64, 7.0, 27.0];
        let mut columns = vec![Vec::new(); 4];
        for row in 0..rows {
            for (k, column) in columns[..3].iter_mut().enumerate() {
                let jitter =
                    ((row * (2 * k + 3) + 17 * episode) as f64 * 1.618).sin() * ((row + k) as f64 * 0.37).cos();
                column.push(s[k] + offset + noise * jitter);
            }
            columns[3].push(f64::from(row as u32 % 4) * 0.5);
            let ahead = |k: [f64; 3], h: f64| [s[0] + h * k[0], s[1] + h * k[1], s[2] + h * k[2]];
            let k1 = slope(s);
            let k2 = slope(ahead(k1, dt / 2.0));
            let k3 = slope(ahead(k2, dt / 2.0));
            let k4 = slope(ahead(k3, dt));
            s = std::array::from_fn(|i| s[i] + dt / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]));
        }
        source.push_uniform(format!("lorenz {episode}"), dt, columns);
    }
    source
}

fn states() -> Vec<Expr> {
    ["x", "y", "z"].map(Expr::column).to_vec()
}

fn derivatives() -> Vec<Expr> {
    states().iter().map(|state| central_difference(state, false)).collect()
}

fn monomials(degree: u32) -> Vec<Expr> {
    Library::polynomial(&states(), degree).unwrap().functions().to_vec()
}

fn scan(plan: &SystemPlan, source: &MemorySource) -> SystemScan {
    plan.scan(source, &Silent).unwrap()
}

/// All rows of expressions, with the counts.
fn rows_of(expressions: &[Expr], source: &MemorySource) -> Mat<f64> {
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let design = Design::compile(expressions, &names).unwrap();
    let mut columns = vec![Vec::new(); expressions.len()];
    let mut rows = DesignRows::default();
    for (episode, described) in source.episodes().iter().enumerate() {
        let block = source.read(episode, 0..described.rows, design.halo()).unwrap();
        design.evaluate(&block, 0..described.rows, &mut rows);
        columns.iter_mut().enumerate().for_each(|(j, column)| column.extend_from_slice(rows.output(j)));
    }
    Mat::from_fn(columns[0].len(), expressions.len(), |i, j| columns[j][i])
}

/// The square-root form by Householder QR of the rows.
fn reference(rows: MatRef<'_, f64>, p: usize, weights: Option<&[f64]>) -> SquareRoot {
    let mut factor = Factor::new(p, rows.ncols() - p);
    factor.push(rows, weights);
    factor.square_root()
}

/// Largest difference of least-squares fits, every coefficient in units of its column's deviation and its target's.
fn coefficient_error(actual: &SquareRoot, expected: &SquareRoot) -> f64 {
    let units = expected.deviation();
    let (a, b) = (least_squares(actual, &units), least_squares(expected, &units));
    let target: Vec<f64> = expected.total.iter().map(|total| (total / expected.weight).sqrt()).collect();
    let error = |j: usize, t: usize| (a.coefficients[(j, t)] - b.coefficients[(j, t)]).abs() * units[j] / target[t];
    (0..units.len()).flat_map(|j| (0..target.len()).map(move |t| (j, t))).map(|(j, t)| error(j, t)).fold(0.0, f64::max)
}

fn assert_close(actual: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(actual.len(), expected.len());
    for (a, b) in actual.iter().zip(expected) {
        assert!((a - b).abs() <= tolerance * b.abs().max(1e-300), "{a} {b}");
    }
}

fn voronoi() -> Partition {
    Partition {
        columns: vec![Expr::column("x"), Expr::column("z")],
        centre: vec![0.0, 25.0],
        scale: vec![8.0, 8.0],
        rule: Rule::voronoi(vec![vec![-1.0, 0.0], vec![1.0, 0.0], vec![0.0, 1.5]]),
        ..Partition::whole()
    }
}

/// Functions that are no polynomial library.
fn mixed() -> Vec<Expr> {
    let scope = Scope::open();
    ["x", "sin(x)", "x*z", "y^2", "abs(z - 20)"].map(|text| Expr::parse(text, &scope).unwrap()).to_vec()
}

#[test]
fn roots_match_rows_and_count_borders() {
    let source = lorenz(3, 700, 0.01, 0.0, 0.01);
    let system = System { also: states(), ..System::new(mixed(), derivatives()) };
    let plan = SystemPlan::new(system, Some(100), &source).unwrap();
    assert!(!plan.is_polynomial());
    let statistic = scan(&plan, &source);
    assert_eq!((statistic.functions(), statistic.targets(), statistic.regions()), (5, 3, 1));
    // A central difference needs a neighbour on both sides.
    let counts = statistic.counts();
    assert_eq!((counts.complete, counts.at_border, counts.incomplete), (3 * 698, 6, 0));
    assert_eq!((statistic.rows(0), statistic.units().len()), (3 * 698, 21));
    assert_eq!(statistic.units().iter().map(|unit| unit.rows).sum::<u64>(), 3 * 698);
    assert!(
        statistic.units().windows(2).all(|pair| (pair[0].episode, pair[0].chunk) < (pair[1].episode, pair[1].chunk))
    );

    let rows = rows_of(&[mixed(), derivatives()].concat(), &source);
    let (root, expected) = (statistic.root(0), reference(rows.as_ref(), 5, None));
    assert!(coefficient_error(&root, &expected) < 1e-12);
    assert_close(&root.total, &expected.total, 1e-12);
    assert_close(&root.residual, &expected.residual, 1e-11);
    for (j, range) in statistic.ranges(0).into_iter().enumerate() {
        let values = (0..rows.nrows()).map(|i| rows[(i, j)]);
        let (least, most) = values.fold((f64::MAX, f64::MIN), |(least, most), v| (least.min(v), most.max(v)));
        assert_eq!(range, [least, most]);
    }
    // Further moments are of the rows that take part.
    let x: f64 = (0..rows.nrows()).map(|i| rows[(i, 0)]).sum::<f64>() / rows.nrows() as f64;
    assert!((statistic.also().mean[0] - x).abs() < 1e-12 && statistic.also().rows == 3 * 698);
}

#[test]
fn missing_values_are_counted_and_left_out() {
    let mut source = MemorySource::new(["x", "y", "z", "w"].map(Column::float).to_vec());
    let clean = lorenz(1, 400, 0.01, 0.0, 0.01);
    let block = clean.read(0, 0..400, Default::default()).unwrap();
    let mut columns: Vec<Vec<f64>> = (0..4).map(|c| block.core(c).to_vec()).collect();
    columns[1][50] = f64::NAN;
    source.push_uniform("with a gap", 0.01, columns);
    for functions in [mixed(), monomials(2)] {
        let statistic = scan(&SystemPlan::new(System::new(functions, derivatives()), None, &source).unwrap(), &source);
        // The gap spoils its own row and the differences of its neighbours.
        assert_eq!(statistic.counts(), fleetfoot_stats::scan::RowCounts { complete: 395, at_border: 2, incomplete: 3 });
    }
}

#[test]
fn weights_count_rows() {
    let source = lorenz(2, 500, 0.01, 0.0, 0.05);
    for functions in [mixed(), monomials(2)] {
        let p = functions.len();
        let system = System { weight: Some(Expr::column("w")), ..System::new(functions.clone(), derivatives()) };
        let statistic = scan(&SystemPlan::new(system, Some(64), &source).unwrap(), &source);
        let all = rows_of(&[functions, derivatives(), vec![Expr::column("w")]].concat(), &source);
        let weights: Vec<f64> = (0..all.nrows()).map(|i| all[(i, p + 3)]).collect();
        let expected = reference(all.as_ref().subcols(0, p + 3), p, Some(&weights));
        let root = statistic.root(0);
        assert_eq!(root.rows, weights.iter().filter(|&&weight| weight > 0.0).count() as u64);
        assert_close(&[root.weight], &[expected.weight], 1e-13);
        assert!(coefficient_error(&root, &expected) < 1e-11);
    }
    let negative = System { weight: Some(-Expr::column("w")), ..System::new(mixed(), derivatives()) };
    let refused = SystemPlan::new(negative, None, &source);
    assert!(matches!(refused, Err(SystemError::Row(RowError::NegativeWeight { row: 1, value, .. })) if value == -0.5));
}

#[test]
fn regions_add_up() {
    let source = lorenz(2, 900, 0.01, 0.0, 0.01);
    let whole =
        scan(&SystemPlan::of_products(System::new(mixed(), derivatives()), Some(200), &source).unwrap(), &source);
    let system = System { partition: Some(voronoi()), ..System::new(mixed(), derivatives()) };
    let statistic = scan(&SystemPlan::new(system.clone(), Some(200), &source).unwrap(), &source);
    assert_eq!(statistic.regions(), 3);
    assert!((0..3).all(|region| statistic.rows(region) > 100));
    assert_eq!((0..3).map(|region| statistic.rows(region)).sum::<u64>(), whole.rows(0));
    // R'R and means of the regions, summed, are those of all rows.
    let all = whole.root(0).compressed(true);
    let parts: Vec<_> = (0..3).map(|region| statistic.root(region).compressed(true)).collect();
    let product = |r: &Mat<f64>, i: usize, j: usize| (0..6).map(|k| r[(k, i)] * r[(k, j)]).sum::<f64>();
    for i in 0..6 {
        for j in 0..=i {
            let sum: f64 = parts.iter().map(|part| product(&part.r, i, j)).sum();
            let size = (product(&all.r, i, i) * product(&all.r, j, j)).sqrt();
            assert!((sum - product(&all.r, i, j)).abs() < 1e-12 * size);
        }
    }
    // Each region is the fit of its own rows.
    let rows = rows_of(&[mixed(), derivatives()].concat(), &source);
    let partition = voronoi();
    let mine = |i: usize| {
        let z = [rows[(i, 0)] / 8.0, (rows_z(&source, i) - 25.0) / 8.0];
        partition.rule.assign_row(&z) == Some(2)
    };
    let index: Vec<usize> = (0..rows.nrows()).filter(|&i| mine(i)).collect();
    let some = Mat::from_fn(index.len(), 8, |i, j| rows[(index[i], j)]);
    assert_eq!(index.len() as u64, statistic.rows(2));
    assert!(coefficient_error(&statistic.root(2), &reference(some.as_ref(), 5, None)) < 1e-11);

    let labels = Partition {
        columns: vec![Expr::column("w")],
        centre: vec![0.0],
        scale: vec![1.0],
        rule: Rule::Labels {
            values: vec![0.0, 1.0],
            names: vec!["still".into(), "moving".into()],
            rules: vec![Rule::Whole, Rule::Whole],
            unseen: fleetfoot_model::UnseenLabel::Refuse,
        },
        ..Partition::whole()
    };
    let labelled = System { partition: Some(labels), ..system };
    let statistic = scan(&SystemPlan::new(labelled, None, &source).unwrap(), &source);
    assert_eq!(statistic.unassigned() + statistic.rows(0) + statistic.rows(1), statistic.counts().complete);
    assert_eq!(statistic.units().iter().map(|unit| unit.rows).sum::<u64>(), statistic.rows(0) + statistic.rows(1));
    assert!(statistic.unassigned() > 800);
}

/// z at the i-th complete row of two episodes whose first and last rows are incomplete.
fn rows_z(source: &MemorySource, i: usize) -> f64 {
    let rows = source.episodes()[0].rows - 2;
    source.read(i / rows, 0..rows + 2, Default::default()).unwrap().core(2)[i % rows + 1]
}

#[test]
fn weights_of_units_leave_episodes_out() {
    let source = lorenz(3, 600, 0.01, 0.0, 0.02);
    for functions in [mixed(), monomials(3)] {
        let system = System::new(functions, derivatives());
        let plan = SystemPlan::new(system, Some(150), &source).unwrap();
        let statistic = scan(&plan, &source);
        let left_out = source.episodes()[1].id;
        let weights = Mat::from_fn(statistic.units().len(), 40, |k, b| match b {
            0 => 1.0,
            1 => f64::from(u8::from(statistic.units()[k].episode != left_out)),
            _ => ((k * 7 + b * 3) % 4) as f64,
        });
        let roots = statistic.roots(0, weights.as_ref());
        assert_eq!(roots[0], statistic.root(0));
        assert_eq!(roots[35], statistic.roots(0, weights.as_ref().subcols(35, 1))[0]);
        let mut others = MemorySource::new(source.columns().to_vec());
        for episode in [0, 2] {
            let block = source.read(episode, 0..600, Default::default()).unwrap();
            others.push_uniform(
                &source.episodes()[episode].name,
                0.01,
                (0..4).map(|c| block.core(c).to_vec()).collect(),
            );
        }
        let alone = scan(&plan, &others).root(0);
        assert_eq!(roots[1].rows, alone.rows);
        assert!(coefficient_error(&roots[1], &alone) < 1e-10);
    }
}

#[test]
fn threads_and_order_of_episodes_do_not_change_bits() {
    let source = lorenz(4, 5_000, 0.002, 0.0, 0.01);
    let mut backwards = MemorySource::new(source.columns().to_vec());
    for episode in [2, 0, 3, 1] {
        let block = source.read(episode, 0..5_000, Default::default()).unwrap();
        backwards.push_uniform(
            &source.episodes()[episode].name,
            0.002,
            (0..4).map(|c| block.core(c).to_vec()).collect(),
        );
    }
    let partitioned = System { partition: Some(voronoi()), also: states(), ..System::new(mixed(), derivatives()) };
    for system in [partitioned, System::new(monomials(3), derivatives())] {
        let run = |threads: usize, source: &MemorySource| {
            with_threads(threads, || {
                let statistic = scan(&SystemPlan::new(system.clone(), None, source).unwrap(), source);
                let roots: Vec<SquareRoot> = (0..statistic.regions()).map(|region| statistic.root(region)).collect();
                (roots, statistic.also().clone(), statistic.ranges(0), statistic.units().to_vec())
            })
        };
        let one = run(1, &source);
        assert!(one == run(2, &source) && one == run(2, &backwards));
    }
}

#[test]
fn residuals_and_regions_match_rows() {
    let source = lorenz(1, 1_500, 0.01, 3.0, 0.05);
    for functions in [mixed(), monomials(2)] {
        let p = functions.len();
        let statistic =
            scan(&SystemPlan::new(System::new(functions.clone(), derivatives()), None, &source).unwrap(), &source);
        let solution = least_squares(&statistic.root(0), &statistic.root(0).deviation());
        // Not the best constant: the mean error counts.
        let constant: Vec<f64> = solution.intercept.iter().map(|c| c + 0.01).collect();
        let region = statistic.describe(0, "all", solution.coefficients.as_ref(), &constant);
        let rows = rows_of(&[functions, derivatives()].concat(), &source);
        let n = rows.nrows();
        let error = |i: usize, t: usize| {
            let model: f64 = (0..p).map(|j| rows[(i, j)] * solution.coefficients[(j, t)]).sum();
            rows[(i, p + t)] - model - constant[t]
        };
        for t in 0..3 {
            for u in 0..=t {
                let mean = |t: usize| (0..n).map(|i| error(i, t).powi(2)).sum::<f64>() / n as f64;
                let direct = (0..n).map(|i| error(i, t) * error(i, u)).sum::<f64>() / n as f64;
                let entry = region.residual_covariance[t * (t + 1) / 2 + u];
                assert!((entry - direct).abs() < 1e-8 * (mean(t) * mean(u)).sqrt(), "{entry} {direct}");
            }
        }
        assert_eq!((region.rows, region.rank, region.confounded.len()), (n as u64, p, 0));
        let variance = |j: usize| {
            let mean = (0..n).map(|i| rows[(i, j)]).sum::<f64>() / n as f64;
            (mean, (0..n).map(|i| (rows[(i, j)] - mean).powi(2)).sum::<f64>() / n as f64)
        };
        for j in 0..p {
            assert_close(
                &[region.mean[j], region.covariance[j * (j + 1) / 2 + j]],
                &[variance(j).0, variance(j).1],
                1e-9,
            );
        }
    }
}

#[test]
fn impossible_systems_are_refused_by_name() {
    let source = lorenz(1, 100, 0.01, 0.0, 0.0);
    let refuse = |system: System| SystemPlan::new(system, None, &source).and_then(|plan| plan.scan(&source, &Silent));
    assert!(matches!(refuse(System::new(mixed(), Vec::new())), Err(SystemError::NoTarget)));
    let unknown = refuse(System::new(vec![Expr::column("v")], derivatives()));
    assert!(matches!(unknown, Err(SystemError::UnknownColumn(_))));
    let ragged = Partition { scale: vec![1.0], ..voronoi() };
    let ragged = refuse(System { partition: Some(ragged), ..System::new(mixed(), derivatives()) });
    assert!(matches!(ragged, Err(SystemError::Partition { columns: 2, scale: 1, .. })));
    // A plan that has not seen a sentinel value in its pilot.
    let plan = SystemPlan::new(System::new(mixed(), derivatives()), None, &source).unwrap();
    let mut broken = MemorySource::new(source.columns().to_vec());
    let block = source.read(0, 0..100, Default::default()).unwrap();
    let mut columns: Vec<Vec<f64>> = (0..4).map(|c| block.core(c).to_vec()).collect();
    columns[2][50] = 1e300;
    broken.push_uniform("with a sentinel", 0.01, columns);
    let text = plan.scan(&broken, &Silent).map(|_| ()).unwrap_err().to_string();
    assert!(text.contains("overflow") && text.contains("x*z"), "{text}");
}
