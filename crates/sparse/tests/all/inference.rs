//! Inference against formulas over the rows, refits and constructed confounding.

use crate::common::gaussian;
use faer::{Mat, Side, linalg::solvers::Solve};
use fleetfoot_data::{Column, EpisodeId, MemorySource, Silent, Source, with_threads};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_sim::plant::aircraft::{AircraftClimb, Airplane, Flight, Latent};
use fleetfoot_sparse::{
    inference::{
        Clusters, InferenceError, bootstrap_intervals, clustered_covariance, confounded, influence, least_squares_on,
    },
    lars::{LarsOptions, lars},
    structured::{Assembled, Assembly, Tikhonov, assemble},
};
use fleetfoot_stats::{blocks, student_t_95};
use fleetfoot_sums::structured::{Banks, Candidates, Plan, Regression, Structure, Task, Term};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const CHUNK: usize = 25;

fn expression(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).expect("a formula")
}

fn candidates(name: &str, functions: &[&str]) -> Candidates {
    Candidates { name: name.into(), functions: functions.iter().map(|text| expression(text)).collect() }
}

fn task(name: &str, target: &str, terms: &[(usize, &str)], prior: bool) -> Task {
    Task {
        name: name.into(),
        target: expression(target),
        terms: terms.iter().map(|&(latent, text)| Term { latent, coefficient: expression(text) }).collect(),
        prior,
    }
}

/// Two equations that share the latent f, and a belief about g. Coefficients: f of (a, b, c), g of (1, d).
fn regression() -> Regression {
    Regression {
        latents: vec![candidates("f", &["a", "b", "c"]), candidates("g", &["1", "d"])],
        tasks: vec![
            task("first", "y", &[(0, "1"), (1, "e")], false),
            task("second", "z", &[(0, "d")], false),
            task("belief", "w", &[(1, "1")], true),
        ],
        weight: None,
    }
}

const NAMES: [&str; 8] = ["a", "b", "c", "d", "e", "y", "z", "w"];

/// Episodes of rows `[a b c d e y z w]` whose errors share a part within the episode; the fourth has a gross fault.
fn episodes() -> Vec<Vec<[f64; 8]>> {
    let mut rng = Pcg64::seed_from_u64(5);
    let episode = |k: usize| {
        let shared = [gaussian(&mut rng), gaussian(&mut rng)];
        let fault = if k == 3 { 4.0 } else { 0.0 };
        let rows = 40 + 13 * k;
        let row = |_| {
            let [a, b, c, d, e] = [0.0, 0.5, 100.0, 2.0, -1.0].map(|mean| mean + gaussian(&mut rng));
            let f = 1.5 * a - 0.7 * b + 0.02 * c;
            let g = 0.4 + 0.9 * d;
            let y = f + e * g + 0.3 * shared[0] + (0.2 + fault) * gaussian(&mut rng) + fault * a;
            [a, b, c, d, e, y, d * f + 0.5 * shared[1] + 0.4 * gaussian(&mut rng), g + 0.3 * gaussian(&mut rng)]
        };
        (0..rows).map(row).collect()
    };
    (0..9).map(episode).collect()
}

fn source(episodes: &[Vec<[f64; 8]>]) -> MemorySource {
    let mut source = MemorySource::new(NAMES.map(Column::float).to_vec());
    for (k, rows) in episodes.iter().enumerate() {
        let columns = (0..8).map(|j| rows.iter().map(|row| row[j]).collect()).collect();
        source.push_uniform(format!("{k}"), 0.1, columns);
    }
    source
}

/// Rows of one episode, task by task: columns of theta, and the target.
fn stacked(row: &[f64; 8]) -> [([f64; 5], f64, bool); 3] {
    let [a, b, c, d, e, y, z, w] = *row;
    [([a, b, c, e, e * d], y, true), ([d * a, d * b, d * c, 0.0, 0.0], z, true), ([0.0, 0.0, 0.0, 1.0, d], w, false)]
}

const WEIGHTS: [f64; 3] = [2.0, 0.7, 0.3];

fn assembly() -> Assembly {
    Assembly { weights: WEIGHTS.to_vec(), ..Assembly::default() }
}

fn banks(source: &MemorySource) -> (Banks, Structure) {
    let plan = Plan::new(regression(), Vec::new(), CHUNK, source).expect("a plan");
    (Banks::new(&plan.scan(source, &Silent).expect("a scan"), |_| true), plan.regression.structure())
}

/// Normal matrix and right side over rows, on a support.
fn normal(rows: &[[f64; 8]], support: &[usize], tikhonov: Option<&Tikhonov>) -> (Mat<f64>, Mat<f64>) {
    let k = support.len();
    let (mut h, mut c) = (Mat::zeros(k, k), Mat::zeros(k, 1));
    for (weight, (x, y, _)) in rows.iter().flat_map(|row| WEIGHTS.into_iter().zip(stacked(row))) {
        for i in 0..k {
            c[(i, 0)] += weight * x[support[i]] * y;
            (0..k).for_each(|j| h[(i, j)] += weight * x[support[i]] * x[support[j]]);
        }
    }
    if let Some(tikhonov) = tikhonov {
        let q = tikhonov.gamma.transpose() * &tikhonov.gamma;
        for i in 0..k {
            c[(i, 0)] += tikhonov.strength * (0..5).map(|j| q[(support[i], j)] * tikhonov.prior[j]).sum::<f64>();
            (0..k).for_each(|j| h[(i, j)] += tikhonov.strength * q[(support[i], support[j])]);
        }
    }
    (h, c)
}

fn fitted(rows: &[[f64; 8]], support: &[usize], tikhonov: Option<&Tikhonov>) -> Vec<f64> {
    let (h, c) = normal(rows, support, tikhonov);
    let expected_change = h.llt(Side::Lower).expect("positive").solve(&c);
    (0..support.len()).map(|i| expected_change[(i, 0)]).collect()
}

/// Weighted squares of the errors in measured tasks.
fn squares(rows: &[[f64; 8]], support: &[usize], theta: &[f64]) -> f64 {
    let tasks = rows.iter().flat_map(|row| WEIGHTS.into_iter().zip(stacked(row)));
    let error = |x: &[f64; 5], y: f64| y - support.iter().zip(theta).map(|(&j, theta)| x[j] * theta).sum::<f64>();
    tasks.filter(|(_, task)| task.2).map(|(weight, (x, y, _))| weight * error(&x, y).powi(2)).sum()
}

/// The sandwich by its formula over the rows: clusters of rows, coefficients on a support.
fn sandwich(clusters: &[Vec<[f64; 8]>], support: &[usize], theta: &[f64], tikhonov: Option<&Tikhonov>) -> Mat<f64> {
    let (k, g) = (support.len(), clusters.len() as f64);
    let all = clusters.concat();
    let (h, _) = normal(&all, support, tikhonov);
    let score = |rows: &Vec<[f64; 8]>| {
        let mut u = Mat::<f64>::zeros(k, 1);
        for (weight, (x, y, _)) in rows.iter().flat_map(|row| WEIGHTS.into_iter().zip(stacked(row))) {
            let error = y - support.iter().zip(theta).map(|(&j, theta)| x[j] * theta).sum::<f64>();
            (0..k).for_each(|i| u[(i, 0)] += weight * x[support[i]] * error);
        }
        u
    };
    let scores: Vec<Mat<f64>> = clusters.iter().map(score).collect();
    let mean = Mat::from_fn(k, 1, |i, _| scores.iter().map(|u| u[(i, 0)]).sum::<f64>() / g);
    let mut meat = Mat::<f64>::zeros(k, k);
    for u in &scores {
        let u = u - &mean;
        meat += &u * u.transpose();
    }
    let n = 2.0 * all.len() as f64;
    let inverse = h.llt(Side::Lower).expect("positive").solve(Mat::<f64>::identity(k, k));
    let factor = g / (g - 1.0) * (n - 1.0) / (n - k as f64);
    Mat::from_fn(k, k, |i, j| factor * (&inverse * &meat * &inverse)[(i, j)])
}

fn tikhonov() -> Tikhonov {
    let gamma = Mat::from_fn(3, 5, |i, j| if i == j { 1.0 + i as f64 } else { 0.1 * (i + j) as f64 });
    Tikhonov { strength: 60.0, gamma, prior: vec![1.0, -1.0, 0.0, 0.5, 1.0] }
}

#[test]
fn the_covariance_is_the_sandwich_of_the_rows() {
    let episodes = episodes();
    let (banks, structure) = banks(&source(&episodes));
    // Short chunks are one cluster with their neighbour.
    let pieces: Vec<(EpisodeId, &[[f64; 8]])> = episodes
        .iter()
        .enumerate()
        .flat_map(|(e, rows)| rows.chunks(CHUNK).map(move |piece| (EpisodeId(e as u128), piece)))
        .collect();
    let of = blocks(pieces.iter().map(|(episode, piece)| (*episode, piece.len() as u64)));
    let mut chunks: Vec<Vec<[f64; 8]>> = vec![Vec::new(); of.last().map_or(0, |last| last + 1)];
    pieces.iter().zip(&of).for_each(|((_, piece), &block)| chunks[block].extend_from_slice(piece));
    assert!(chunks.len() > 20 && chunks.len() < pieces.len());
    let mut compared = 0;
    for prior in [None, Some(tikhonov())] {
        let assembly = Assembly { tikhonov: prior.clone(), ..assembly() };
        let assembled = assemble(&structure, &banks.total(), &assembly).expect("a problem");
        let path = lars(&assembled.problem, &assembled.penalty, &LarsOptions::default()).expect("a path");
        let penalised = path.at(&assembled.problem, 0.05 * path.knots[0].l1).expect("on the path");
        let fits = [
            least_squares_on(&assembled, &[0, 1, 2, 3, 4]).expect("identified"),
            least_squares_on(&assembled, &[0, 2, 4]).expect("identified"),
            assembled.coefficients(&penalised),
        ];
        for theta in fits {
            for (clusters, rows) in [(Clusters::Episodes, &episodes), (Clusters::Chunks, &chunks)] {
                let covariance =
                    clustered_covariance(&banks, &structure, &assembly, &theta, clusters).expect("identified");
                let expected = sandwich(rows, &covariance.support, &covariance.estimate, prior.as_ref());
                assert_eq!(covariance.clusters, rows.len());
                for i in 0..covariance.support.len() {
                    let scale = |i: usize| expected[(i, i)].sqrt();
                    for j in 0..covariance.support.len() {
                        let apart = (covariance.matrix[(i, j)] - expected[(i, j)]).abs() / scale(i) / scale(j);
                        assert!(apart < 1e-10, "{i} {j}: {apart:e}");
                        compared += 1;
                    }
                    assert!((covariance.errors[i] / scale(i) - 1.0).abs() < 1e-10);
                    let half = student_t_95(rows.len() - 1) * scale(i);
                    let [low, high] = covariance.intervals[i];
                    assert!(
                        (high - low - 2.0 * half).abs() < 1e-9 * half
                            && (high + low - 2.0 * covariance.estimate[i]).abs() < 1e-9 * half
                    );
                }
            }
        }
    }
    assert!(compared > 150, "{compared}");
}

/// Intervals are to hold the truth about as often as they say, where errors are shared within episodes; intervals by rows would not.
#[test]
fn intervals_cover_the_truth_when_errors_are_shared_within_episodes() {
    let plain = Regression {
        latents: vec![candidates("f", &["1", "x"])],
        tasks: vec![task("only", "y", &[(0, "1")], false)],
        weight: None,
    };
    let structure = plain.structure();
    let (mut rng, mut covered, runs) = (Pcg64::seed_from_u64(17), [0, 0], 200);
    for _ in 0..runs {
        let mut source = MemorySource::new(["x", "y"].map(Column::float).to_vec());
        for k in 0..20 {
            let (shift, level) = (gaussian(&mut rng), gaussian(&mut rng));
            let x: Vec<f64> = (0..30).map(|_| level + 0.3 * gaussian(&mut rng)).collect();
            let y = x.iter().map(|x| 1.0 + 2.0 * x + shift + 0.1 * gaussian(&mut rng)).collect();
            source.push_uniform(format!("{k}"), 0.1, vec![x, y]);
        }
        let plan = Plan::new(plain.clone(), Vec::new(), 30, &source).expect("a plan");
        let banks = Banks::new(&plan.scan(&source, &Silent).expect("a scan"), |_| true);
        let assembly = Assembly { weights: vec![1.0], ..Assembly::default() };
        let assembled = assemble(&structure, &banks.total(), &assembly).expect("a problem");
        let theta = least_squares_on(&assembled, &[0, 1]).expect("identified");
        let covariance =
            clustered_covariance(&banks, &structure, &assembly, &theta, Clusters::Episodes).expect("identified");
        for (count, (interval, truth)) in covered.iter_mut().zip(covariance.intervals.iter().zip([1.0, 2.0])) {
            *count += usize::from(interval[0] <= truth && truth <= interval[1]);
        }
    }
    // 200 runs: three deviations of a binomial count of 95 % are 9; the sandwich is known to be a few percent short with 20 clusters.
    assert!(covered.iter().all(|&count| (172..=199).contains(&count)), "{covered:?} of {runs}");
}

#[test]
fn influence_matches_explicit_refits() {
    let episodes = episodes();
    let source = source(&episodes);
    let (banks, structure) = banks(&source);
    for (support, prior) in [(vec![0, 1, 2, 3, 4], None), (vec![0, 1, 4], Some(tikhonov()))] {
        let assembly = Assembly { tikhonov: prior.clone(), ..assembly() };
        let report = with_threads(1, || influence(&banks, &structure, &assembly, &support, &Silent)).expect("a report");
        assert_eq!(with_threads(3, || influence(&banks, &structure, &assembly, &support, &Silent)), Ok(report.clone()));
        let all = episodes.concat();
        let full = fitted(&all, &support, prior.as_ref());
        let n = all.len() as f64;
        let variance = squares(&all, &support, &full) / (2.0 * n - support.len() as f64);
        let (h, _) = normal(&all, &support, prior.as_ref());
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * b.abs().max(1e-3), "{a} {b}");
        report.coefficients.iter().zip(&full).for_each(|(a, b)| close(*a, *b));
        close(report.mean_square, squares(&all, &support, &full) / n);
        let mut held_out = 0.0;
        for influence_of in &report.episodes {
            let k =
                source.episodes().iter().position(|episode| episode.id == influence_of.episode).expect("an episode");
            let others: Vec<[f64; 8]> =
                (0..episodes.len()).filter(|&e| e != k).flat_map(|e| episodes[e].clone()).collect();
            let theta = fitted(&others, &support, prior.as_ref());
            influence_of.coefficients.iter().zip(&theta).for_each(|(a, b)| close(*a, *b));
            let count = episodes[k].len() as f64;
            close(influence_of.share, count / n);
            close(influence_of.training, squares(&others, &support, &theta) / (n - count));
            close(influence_of.held_out, squares(&episodes[k], &support, &theta) / count);
            close(influence_of.in_sample, squares(&episodes[k], &support, &full) / count);
            let change = Mat::from_fn(support.len(), 1, |i, _| theta[i] - full[i]);
            let distance = (change.transpose() * &h * &change)[(0, 0)] / (support.len() as f64 * variance);
            assert!((influence_of.distance - distance).abs() < 1e-8 * distance, "{} {distance}", influence_of.distance);
            held_out += influence_of.held_out * count / n;
        }
        close(report.held_out, held_out);
        assert_eq!(report.episodes.len(), 9);
        assert!(report.episodes.windows(2).all(|pair| pair[0].distance >= pair[1].distance));
        assert_eq!(report.episodes[0].episode, source.episodes()[3].id, "the faulty log stands first");
    }
}

#[test]
fn only_informative_episode_is_named() {
    let mut rng = Pcg64::seed_from_u64(3);
    let mut episodes: Vec<Vec<[f64; 8]>> = episodes();
    for (k, rows) in episodes.iter_mut().enumerate() {
        // Only the second episode moves b.
        rows.iter_mut().for_each(|row| row[1] = if k == 1 { gaussian(&mut rng) } else { 0.0 });
    }
    let source = source(&episodes);
    let (banks, structure) = banks(&source);
    let report = influence(&banks, &structure, &assembly(), &[0, 1, 2], &Silent).expect("a report");
    let first = &report.episodes[0];
    assert_eq!(first.episode, source.episodes()[1].id);
    assert!(first.distance.is_infinite() && first.coefficients.is_empty() && first.held_out.is_nan(), "{first:?}");
    assert!(report.episodes[1..].iter().all(|episode| episode.distance.is_finite()));
}

#[test]
fn quantiles_and_basic_intervals() {
    // numpy.quantile(values, [0.025, 0.975]) of 0.0, 0.1, .. 10.0 squared: 0.0625, 95.0625; interpolation between order statistics.
    let b = 101;
    let mut order: Vec<usize> = (0..b).collect();
    let mut rng = Pcg64::seed_from_u64(1);
    (1..b).rev().for_each(|i| order.swap(i, rng.random_range(0..=i)));
    let replicates = Mat::from_fn(b, 2, |i, j| {
        let value = order[i] as f64 / 10.0;
        if j == 0 { value * value } else { f64::from(u8::from(order[i] >= 40)) }
    });
    let intervals = bootstrap_intervals(replicates.as_ref(), &[30.0, 1.0], 0.95).expect("intervals");
    let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-12, "{a} {b}");
    close(intervals[0].percentile[0], 0.065);
    close(intervals[0].percentile[1], 95.065);
    close(intervals[0].basic[0], 60.0 - 95.065);
    close(intervals[0].basic[1], 60.0 - 0.065);
    close(intervals[0].bias, 33.5 - 30.0);
    close(intervals[1].frequency, 61.0 / 101.0);
    close(intervals[1].deviation, (61.0 * 40.0 / 101.0 / 100.0_f64).sqrt());
    let nan = Mat::from_fn(3, 1, |i, _| if i == 1 { f64::NAN } else { 0.0 });
    assert_eq!(bootstrap_intervals(nan.as_ref(), &[0.0], 0.9), Err(InferenceError::NotFinite { column: 0 }));
    assert!(bootstrap_intervals(replicates.as_ref(), &[0.0], 0.9).is_err());
    assert!(bootstrap_intervals(replicates.as_ref(), &[0.0, 0.0], 1.0).is_err());
    assert!(bootstrap_intervals(replicates.subrows(0, 1), &[0.0, 0.0], 0.9).is_err());
}

/// Columns by formulas of x0..x3 (independent), one task.
fn problem(formulas: &[&str]) -> Assembled {
    let mut rng = Pcg64::seed_from_u64(8);
    let columns: Vec<Vec<f64>> = (0..5).map(|_| (0..300).map(|_| 1.0 + gaussian(&mut rng)).collect()).collect();
    let mut source = MemorySource::new(["x0", "x1", "x2", "x3", "y"].map(Column::float).to_vec());
    source.push_uniform("one", 0.1, columns);
    let regression = Regression {
        latents: vec![candidates("f", formulas)],
        tasks: vec![task("only", "y", &[(0, "1")], false)],
        weight: None,
    };
    let plan = Plan::new(regression, Vec::new(), 100, &source).expect("a plan");
    let banks = Banks::new(&plan.scan(&source, &Silent).expect("a scan"), |_| true);
    let assembly = Assembly { weights: vec![1.0], ..Assembly::default() };
    assemble(&plan.regression.structure(), &banks.total(), &assembly).expect("a problem")
}

#[test]
fn constructed_confounding_is_found_with_its_direction() {
    // 0, 2: a copy in other units. 1, 3, 4: a sum. 5 alone, 6 zero.
    let assembled = problem(&["x0", "x1", "1000*x0", "x2", "x1 - 2*x2", "x3", "0*x0"]);
    let all: Vec<usize> = (0..7).collect();
    let confounding = confounded(&assembled, &all, 1e-9).expect("found");
    assert_eq!(confounding.groups, [vec![0, 2], vec![1, 3, 4]]);
    assert_eq!((confounding.zero.as_slice(), confounding.directions.len()), ([6].as_slice(), 2));
    for direction in &confounding.directions {
        let of = |j: usize| direction.direction.iter().find(|(i, _)| *i == j).map(|(_, value)| *value);
        match of(0) {
            Some(first) => assert!((of(2).expect("a pair") * 1000.0 / first + 1.0).abs() < 1e-9),
            None => {
                let [a, b, c] = [1, 3, 4].map(|j| of(j).expect("three"));
                assert!((a / c + 1.0).abs() < 1e-9 && (b / c - 2.0).abs() < 1e-9, "{a} {b} {c}");
            }
        }
        assert!(direction.remainder < 1e-12, "{}", direction.remainder);
    }
    assert!(
        confounding.inflation[5].is_finite() && confounding.inflation.iter().filter(|v| v.is_infinite()).count() == 6
    );
    assert_eq!(least_squares_on(&assembled, &[5, 6]), Err(InferenceError::NotIdentified { columns: vec![6] }));
    assert!(least_squares_on(&assembled, &[0, 1, 2]).is_err());
    assert!(least_squares_on(&assembled, &[9]).is_err());
    assert!(confounded(&assembled, &all, 0.0).is_err());
    // A difference of 1e-4 is confounded at a limit of 1e-3 only, and inflated by its square otherwise.
    let near = problem(&["x0", "x1", "x0 + 1e-4*x2"]);
    assert_eq!(confounded(&near, &[0, 1, 2], 1e-3).expect("found").groups, [vec![0, 2]]);
    let apart = confounded(&near, &[0, 1, 2], 1e-6).expect("found");
    assert!(apart.groups.is_empty() && (1e7..1e9).contains(&apart.inflation[0]), "{apart:?}");
    // Variance inflation by its definition: columns x0, x0 + x1 about zero.
    let pair = confounded(&problem(&["x0", "x0 + x1"]), &[0, 1], 1e-6).expect("found").inflation;
    assert!((pair[0] - pair[1]).abs() < 1e-12 * pair[0] && pair[0] > 1.5, "{pair:?}");
}

#[test]
fn prior_resolves_common_scale_of_latents() {
    let airplane = Airplane::new(&AircraftClimb::default()).expect("an airplane");
    let mut source = MemorySource::new(Flight::columns());
    (0..3).for_each(|number| airplane.flight(number).append_to(&mut source));
    let of = |latent: Latent| Candidates {
        name: latent.name().into(),
        functions: latent.features().iter().map(|text| expression(text)).collect(),
    };
    let truth: Vec<f64> = [Latent::Thrust, Latent::SpecificImpulse]
        .iter()
        .flat_map(|&latent| airplane.terms().coefficients(latent))
        .collect();
    let support: Vec<usize> = (0..truth.len()).filter(|&j| truth[j] != 0.0).collect();
    for believed in [false, true] {
        let mut tasks = vec![task("m", "0", &[(0, "1"), (1, "m_dot")], false)];
        if believed {
            tasks.push(task("belief", "Isp", &[(1, "1")], true));
        }
        let latents = vec![of(Latent::Thrust), of(Latent::SpecificImpulse)];
        let plan = Plan::new(Regression { latents, tasks, weight: None }, Vec::new(), 500, &source).expect("a plan");
        let banks = Banks::new(&plan.scan(&source, &Silent).expect("a scan"), |_| true);
        let weights = if believed { vec![1e-8, 1e-3] } else { vec![1e-8] };
        let assembly = Assembly { weights, ..Assembly::default() };
        let assembled = assemble(&plan.regression.structure(), &banks.total(), &assembly).expect("a problem");
        let confounding = confounded(&assembled, &support, 1e-7).expect("found");
        if believed {
            assert!(confounding.groups.is_empty(), "{confounding:?}");
            let theta = least_squares_on(&assembled, &support).expect("identified");
            support.iter().for_each(|&j| assert!((theta[j] / truth[j] - 1.0).abs() < 1e-6, "{j}: {}", theta[j]));
            continue;
        }
        assert_eq!(confounding.groups, std::slice::from_ref(&support), "all terms of T and Isp in one group");
        let direction = &confounding.directions[0].direction;
        let factor = direction[0].1 / truth[direction[0].0];
        for &(j, value) in direction {
            assert!((value / (factor * truth[j]) - 1.0).abs() < 1e-6, "{j}: {value} {}", factor * truth[j]);
        }
        let lost = least_squares_on(&assembled, &support);
        assert!(matches!(lost, Err(InferenceError::NotIdentified { .. })), "{lost:?}");
    }
}
