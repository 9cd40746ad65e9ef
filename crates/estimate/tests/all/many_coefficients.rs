//! Simulation error over many coefficients, J'J never formed, beside the fit that forms it, closed forms and conditions of the minimum.

use fleetfoot_data::{MemorySource, Silent, with_threads};
use fleetfoot_dynamics::{Coefficient, NormalBlocks};
use fleetfoot_estimate::{Hold, Simulated, SimulationOptions, WHOLE_COEFFICIENTS, simulation_error, simulation_errors};
use fleetfoot_model::{Model, Partition, Prediction, Rule};

use crate::simulation::{exact, expression, linear, linear_model, model, noise, source};

/// All models.
struct Everywhere;

impl Hold for Everywhere {
    fn nearest(&self, model: &Model, _: &NormalBlocks) -> Option<Model> {
        Some(model.clone())
    }
}

/// Models whose first latent has a first coefficient of at most so much. The nearest one moves the others of its block
/// along, by the conditions of a minimum under one constraint.
struct AtMost(f64);

impl Hold for AtMost {
    fn nearest(&self, model: &Model, normal: &NormalBlocks) -> Option<Model> {
        let mut model = model.clone();
        let (range, values) = normal.blocks().next()?;
        let (n, over) = (range.len(), model.latents[0].map.coefficient(0, 0) - self.0);
        if over <= 0.0 {
            return Some(model);
        }
        // H s = -e_1 mu with s_1 = -over, the constant first: a column of the inverse, by elimination without exchange.
        let mut rows: Vec<Vec<f64>> = (0..n).map(|i| (0..n).map(|j| values[i * n + j]).collect()).collect();
        rows.iter_mut().enumerate().for_each(|(i, row)| row.push(f64::from(u8::from(i == 1))));
        for k in 0..n {
            for i in (0..n).filter(|&i| i != k) {
                let factor = rows[i][k] / rows[k][k];
                (k..=n).for_each(|j| rows[i][j] -= factor * rows[k][j]);
            }
        }
        let column: Vec<f64> = (0..n).map(|i| rows[i][n] / rows[i][i]).collect();
        let move_by = |i: usize| -over * column[i] / column[1];
        let map = model.latents[0].affine_mut().unwrap();
        map.constants[0] += move_by(0);
        (1..n).for_each(|i| map.coefficients[0][i - 1] += move_by(i));
        map.coefficients[0][0] = self.0;
        Some(model)
    }
}

/// To the last digits, with one weight.
fn options(steps: usize, weight: f64) -> SimulationOptions {
    let mut options = exact(steps);
    let many = &mut options.many;
    (many.weights, many.trials, many.directions, many.reduction) = (vec![weight], 200, 20, 0.0);
    options
}

fn values(fitted: &Simulated) -> Vec<f64> {
    fitted.coefficients.iter().map(|coefficient| coefficient.value(&fitted.model)).collect()
}

/// A start of which every number is free in both fits.
fn start() -> (Model, MemorySource) {
    let mut start = linear_model(&[vec![0.8, 0.1, 0.2], vec![-0.1, 0.7, 0.2]]);
    start.latents.iter_mut().for_each(|latent| latent.map.set(0, None, 0.01));
    (start, source(&["x", "y", "u"], 0.1, (0..3).map(|seed| linear(seed, 300, 0.2)).collect()))
}

/// Without weight both fits have one minimum. That of products stops when a step reduces the sum of squares no further,
/// which determines a coefficient to the root of rounding.
#[test]
fn minimum_without_prior_matches_whole_matrix() {
    let (start, source) = start();
    for steps in [1, 8] {
        let whole = simulation_error(&start, &source, &exact(steps), &Silent).unwrap();
        let fits = simulation_errors(&start, &source, &options(steps, 1e-13), Some(&Everywhere), &Silent).unwrap();
        assert_eq!((whole.weight, fits.len()), (None, 1));
        let fitted = &fits[0];
        assert_eq!(fitted.coefficients, whole.coefficients);
        assert_eq!((fitted.segments, fitted.residuals, fitted.ended), (whole.segments, whole.residuals, whole.ended));
        assert!(
            (fitted.cost[0] / whole.cost[0] - 1.0).abs() < 1e-13
                && (fitted.cost[1] / whole.cost[1] - 1.0).abs() < 1e-12
        );
        for (value, other) in values(fitted).iter().zip(values(&whole)) {
            assert!((value - other).abs() < 1e-7, "{value} {other}");
        }
    }
}

/// Of one step the sum of squares is |theta - theta_2|_J'J^2 and a constant, J'J being H. The minimum therefore lies
/// between theta_2 and theta_1 at 1 to tau. H has a row more for every block: of 897 rows that moves it by the order of
/// a thousandth of the way.
#[test]
fn a_prior_pulls_towards_the_start() {
    let (start, source) = start();
    let free = values(&simulation_error(&start, &source, &exact(1), &Silent).unwrap());
    for tau in [0.1, 1.0, 10.0] {
        let fitted = &simulation_errors(&start, &source, &options(1, tau), Some(&Everywhere), &Silent).unwrap()[0];
        assert!(fitted.gradient < 1e-6 && fitted.status.converged(), "{} {:?}", fitted.gradient, fitted.status);
        for ((value, free), coefficient) in values(fitted).iter().zip(&free).zip(&fitted.coefficients) {
            let start = coefficient.value(&start);
            let expected = (free + tau * start) / (1.0 + tau);
            assert!((value - expected).abs() < 0.004 * (free - start).abs().max(0.05), "{tau}: {value} {expected}");
        }
    }
}

/// 120 regions, each with separate maps, of three states and two inputs: 2,160 coefficients, more than the limit of a
/// whole matrix.
fn many(seed: usize) -> (Model, MemorySource) {
    let (regions, states, inputs) = (120, 3, 2);
    let names = ["x", "y", "z", "u", "w"];
    let centres: Vec<Vec<f64>> = (0..regions).map(|r| (0..2).map(|i| noise(1000 + 2 * r + i)).collect()).collect();
    let truth = |target: usize, region: usize| -> (f64, Vec<f64>) {
        let coefficient = |j: usize| 0.06 * noise(50_000 + 97 * region + 11 * target + j);
        let slope = |j: usize| {
            coefficient(j)
                + if j == target {
                    0.85
                } else if j >= states {
                    0.3
                } else {
                    0.0
                }
        };
        (coefficient(10), (0..states + inputs).map(slope).collect())
    };
    let mut episodes = Vec::new();
    for episode in 0..4 {
        let (mut state, mut columns) = (vec![0.0; states], vec![Vec::new(); 5]);
        for k in 0..1500 {
            let key = 1_000_000 * (seed + 1) + 100_000 * episode + 10 * k;
            let input: Vec<f64> = (0..inputs).map(|i| noise(key + i)).collect();
            let row: Vec<f64> = state.iter().chain(&input).copied().collect();
            (0..5).for_each(|i| columns[i].push(row[i] + if i < states { 0.1 * noise(key + 3 + i) } else { 0.0 }));
            let distance = |r: usize| (0..2).map(|i| (state[i] - centres[r][i]).powi(2)).sum::<f64>();
            let region = (0..regions).min_by(|&a, &b| distance(a).total_cmp(&distance(b))).unwrap();
            state = (0..states)
                .map(|target| {
                    let (constant, map) = truth(target, region);
                    constant + map.iter().zip(&row).map(|(a, x)| a * x).sum::<f64>()
                })
                .collect();
        }
        episodes.push(columns);
    }
    let mut partition = Partition::whole();
    (partition.columns, partition.centre) = (vec![expression("x"), expression("y")], vec![0.0; 2]);
    (partition.scale, partition.rule) = (vec![1.0; 2], Rule::voronoi(centres.clone()));
    // Off the truth by what noise in the states does to one step, and by chance.
    let maps = |target: usize| {
        (0..regions)
            .map(|region| {
                let (constant, map) = truth(target, region);
                let off = |j: usize| 0.97 + 0.02 * noise(7_000_000 + 41 * region + 13 * target + j);
                (constant, map.iter().enumerate().map(|(j, a)| a * off(j)).collect())
            })
            .collect()
    };
    let fitted: Vec<_> = (0..states).map(|target| (names[target], Prediction::Next, maps(target))).collect();
    (model(&names[..3], &names[3..], &names, partition, &fitted, &[], 0.1), source(&names, 0.1, episodes))
}

#[test]
fn matrix_free_descent_has_the_same_bits_on_any_threads() {
    let (start, source) = many(0);
    assert!(Coefficient::support(&start).len() == 2_160 && WHOLE_COEFFICIENTS < 2_160);
    let mut options = SimulationOptions::new(10);
    options.descent.chunk_rows = 700;
    let fit = |threads| with_threads(threads, || simulation_errors(&start, &source, &options, None, &Silent).unwrap());
    let fits = fit(1);
    assert_eq!(fits.len(), options.many.weights.len());
    let (mut cost, mut passes) = (fits[0].cost[0], 0);
    for (at, weight) in fits.iter().zip(&options.many.weights) {
        println!(
            "{weight}: {} of {}, {} passes, certificate {:.1e}, {:?}",
            at.cost[1], at.cost[0], at.passes, at.gradient, at.status
        );
        assert!(at.cost[1] < cost && at.passes > passes && at.weight == Some(*weight));
        (cost, passes) = (at.cost[1], at.passes);
    }
    assert!(passes <= options.passes(2_160, false));
    // The sum of squares jumps where a trajectory meets other regions: the gradient that is left is told.
    assert!(fits[0].gradient < 0.05, "{}", fits[0].gradient);
    for threads in [2, 7] {
        for (fitted, other) in fits.iter().zip(fit(threads)) {
            assert_eq!(
                (&fitted.model, fitted.cost, fitted.gradient, fitted.passes),
                (&other.model, other.cost, other.gradient, other.passes)
            );
        }
    }
    let last = simulation_error(&start, &source, &options, &Silent).unwrap();
    assert_eq!(last.model, fits[2].model);
    // A quarter of the segments tells the curvature about as well.
    let mut sampled = options.clone();
    sampled.many.sample = 2.0;
    let part = simulation_errors(&start, &source, &sampled, None, &Silent).unwrap();
    println!("of a part of the segments: {:?}", part.iter().map(|at| at.cost[1]).collect::<Vec<f64>>());
    assert!(part[0].cost[1] < 0.5 * (fits[0].cost[0] + fits[0].cost[1]) && part[0].model != fits[0].model);
    assert!(part.windows(2).all(|pair| pair[1].cost[1] < pair[0].cost[1]));
    // Rows that did not train: a bound of the sum of squares is that of the start.
    let (_, others) = many(1);
    let mut look = options.clone();
    look.many.trials = 0;
    let held_out = |model: &Model| simulation_error(model, &others, &look, &Silent).unwrap().cost[0];
    let [before, after] = [&start, &fits[0].model].map(held_out);
    println!("held out: {before} {after}");
    assert!(after < before);
}

/// A coefficient whose optimum is beyond its bound ends at the bound. The others end at the least sum of squares and
/// prior with it there: no difference of theirs lowers it.
#[test]
fn constrained_model_satisfies_optimality_conditions() {
    let (start, source) = start();
    let (steps, tau, bound) = (8, 0.064, 0.9);
    let options = options(steps, tau / 64.0);
    let fitted = &simulation_errors(&start, &source, &options, Some(&AtMost(bound)), &Silent).unwrap()[0];
    assert_eq!(fitted.model.latents[0].map.coefficient(0, 0), bound);
    assert!(fitted.gradient < 1e-4 && fitted.cost[1] < 0.9 * fitted.cost[0], "{} {:?}", fitted.gradient, fitted.cost);
    let free = simulation_errors(&start, &source, &options, Some(&Everywhere), &Silent).unwrap();
    assert!(free[0].model.latents[0].map.coefficient(0, 0) > bound + 0.01 && free[0].cost[1] < fitted.cost[1]);
    // The sum of squares, by fits of no trial.
    let mut look = options.clone();
    look.many.trials = 0;
    let square =
        |model: &Model| simulation_errors(model, &source, &look, Some(&Everywhere), &Silent).unwrap()[0].cost[0];
    for number in 1..fitted.coefficients.len() {
        let coefficient = fitted.coefficients[number];
        if coefficient == (Coefficient { region: 0, latent: 0, function: Some(0) }) {
            continue;
        }
        let moved = |by: f64| {
            let mut model = fitted.model.clone();
            coefficient.set(&mut model, coefficient.value(&fitted.model) + by);
            square(&model)
        };
        // Bound on the force of the prior: tau |H (theta - theta_1)|, small against the curvature.
        let (down, middle, up) = (moved(-1e-4), moved(0.0), moved(1e-4));
        let curvature = (up + down - 2.0 * middle) / 1e-8;
        let newton = (up - down) / 2e-4 / curvature;
        assert!(newton.abs() < 0.02, "{coefficient:?}: {newton}");
    }
}
