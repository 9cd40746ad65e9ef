//! The same problem by dense algebra over all unknowns at once.

use nalgebra::{DMatrix, DVector};

use super::{
    Recording, options, problem,
    simulation::{GRAVITY, MOUNTING},
};
use crate::fuse::{
    FuseOptions, Prior,
    chain::{BORDER_AT, NEXT_AT, RIGHT, Row},
    problem::{Problem, STEPS},
    rotation::{Vector, exp},
    state::{BORDER, BorderError, STATE, State, StateError},
};

/// All rows of a problem: the matrix and the right side; tracks one after the other, the constants last.
fn rows(problem: &Problem<'_>) -> (DMatrix<f64>, DVector<f64>) {
    let nodes: usize = problem.tracks.iter().map(|track| track.nodes()).sum();
    let border = STATE * nodes;
    let mut all: Vec<(usize, Row)> = problem.border_rows(&problem.border).into_iter().map(|row| (0, row)).collect();
    let mut first = 0;
    for track in &problem.tracks {
        for node in 0..track.nodes() {
            let mut blocks = Vec::new();
            track.push(node, &problem.border, &problem.setting, &mut blocks);
            all.extend(blocks.into_iter().map(|row| (STATE * (first + node), row)));
        }
        first += track.nodes();
    }
    let mut matrix = DMatrix::zeros(all.len(), border + BORDER);
    let mut right = DVector::zeros(all.len());
    for (i, (at, row)) in all.iter().enumerate() {
        for j in 0..NEXT_AT + STATE {
            if row[j] != 0.0 {
                matrix[(i, at + j)] = row[j];
            }
        }
        for j in 0..BORDER {
            matrix[(i, border + j)] = row[BORDER_AT + j];
        }
        right[i] = row[RIGHT];
    }
    (matrix, right)
}

/// Two runs of twenty poses each with all constants unknown: the step and the covariances of the chain are those of one dense factorisation, to 1e-8 of a deviation.
#[test]
fn step_and_covariances_match_dense_algebra() {
    let recordings = [Recording::new(0.35, 1), Recording::new(0.35, 2)];
    let lever = Prior { value: [0.0; 3], deviation: 0.1 };
    let options = FuseOptions { lever, offset: Prior { value: 0.19, deviation: 0.01 }, ..options() };
    let mut problem = problem(&recordings.each_ref().map(Recording::run), &options);
    for round in 0..2 {
        let (matrix, right) = rows(&problem);
        let factor = matrix.clone().qr();
        let r = factor.r();
        let expected = r.solve_upper_triangular(&(factor.q().transpose() * &right)).unwrap();
        let inverse = r.solve_upper_triangular(&DMatrix::identity(r.nrows(), r.nrows())).unwrap();
        let covariance = &inverse * inverse.transpose();
        let deviation = |i: usize| covariance[(i, i)].sqrt();
        let step = problem.step(0.0).unwrap();
        let whole = problem.whole().unwrap();
        let solution: Vec<f64> = step
            .states
            .iter()
            .flatten()
            .flat_map(|error| error.iter().copied())
            .chain(step.border.iter().copied())
            .collect();
        assert_eq!(solution.len(), expected.len());
        let size = (0..solution.len()).map(|i| (expected[i] / deviation(i)).abs()).fold(1.0, f64::max);
        for i in 0..solution.len() {
            assert!(
                (solution[i] - expected[i]).abs() < 1e-8 * size * deviation(i),
                "{round} {i}: {} {}",
                solution[i],
                expected[i]
            );
        }
        let last = solution.len() - BORDER;
        let near = |value: f64, i: usize, j: usize| {
            let apart = (value - covariance[(i, j)]).abs();
            assert!(apart < 1e-8 * deviation(i) * deviation(j), "{round} {i} {j}: {value} {}", covariance[(i, j)]);
        };
        for i in 0..BORDER {
            (0..BORDER).for_each(|j| near(whole.covariance[(i, j)], last + i, last + j));
        }
        let mut first = 0;
        for at in 0..problem.tracks.len() {
            let nodes = problem.tracks[at].nodes();
            problem
                .visit(at, &whole, &mut |node, _, joint| {
                    let (joint, at) = (joint.unwrap(), STATE * (first + node));
                    for i in 0..STATE {
                        (0..STATE).for_each(|j| near(joint.node[(i, j)], at + i, at + j));
                        (0..BORDER).for_each(|j| near(joint.with_border[(i, j)], at + i, last + j));
                        (0..STATE)
                            .filter(|_| node + 1 < nodes)
                            .for_each(|j| near(joint.with_next[(i, j)], at + i, at + STATE + j));
                    }
                })
                .unwrap();
            first += nodes;
        }
        problem.descend(STEPS).unwrap();
    }
}

/// Of a long chain nothing is kept but the rows at every 1024th node, and readings are summed again wherever they are needed: to the same bits.
#[test]
fn recomputed_rows_equal_stored_rows() {
    let recording = Recording::new(11.0, 5);
    let mut problem = problem(&[recording.run()], &options());
    let nodes = problem.tracks[0].nodes();
    assert!(nodes > 1024 && problem.tracks[0].sums.len() == nodes - 1);
    let of = |problem: &mut Problem<'_>| {
        let step = problem.step(1e-9).unwrap();
        let whole = problem.whole().unwrap();
        let mut joints = Vec::new();
        problem.visit(0, &whole, &mut |_, _, joint| joints.extend(joint.map(|joint| joint.node))).unwrap();
        (step.states, step.border, whole.covariance, joints, problem.cost_now().unwrap())
    };
    let kept = of(&mut problem);
    problem.tracks[0].sums.clear();
    assert!(of(&mut problem) == kept && kept.3.len() == nodes);
}

/// Damping is what it says: the rows of the squares' norms stacked below, node by node, as the chain adds them, hold the step back and vanish with it.
#[test]
fn damping_shortens_the_step() {
    let recording = Recording::new(0.5, 3);
    let problem = problem(&[recording.run()], &options());
    let size = |damping: f64| {
        let step = problem.step(damping).unwrap();
        step.states[0].iter().map(StateError::norm_squared).sum::<f64>() + step.border.norm_squared()
    };
    let (free, weak, strong) = (size(0.0), size(1e-14), size(1.0));
    assert!((weak / free - 1.0).abs() < 1e-3 && strong < 0.5 * free, "{free} {weak} {strong}");
}

/// At the solution the cost, evaluated alone, has no slope along any of the unknowns: by central differences over a ten-thousandth of a deviation, in costs a deviation.
#[test]
fn the_solution_is_the_least() {
    let recording = Recording::new(0.6, 4);
    let mounting = exp(&Vector::from(MOUNTING));
    let options = FuseOptions {
        lever: Prior { value: [0.0; 3], deviation: 0.1 },
        mounting: Prior { value: [mounting.i, mounting.j, mounting.k, mounting.w], deviation: 0.1 },
        gravity: Prior { value: GRAVITY, deviation: 0.1 },
        offset: Prior { value: 0.19, deviation: 0.01 },
        ..options()
    };
    let mut problem = problem(&[recording.run()], &options);
    problem.descend(STEPS).unwrap();
    problem.move_nodes();
    assert!((0..20).any(|_| problem.descend(STEPS).unwrap().converged));
    let whole = problem.whole().unwrap();
    let spread = problem.spread(&whole, |_, _, joint| joint.node.diagonal()).unwrap();
    let states: Vec<State> = problem.tracks[0].states.clone();
    let slope = |h: f64, of: &dyn Fn(f64) -> f64| (of(h) - of(-h)) / 2e-4;
    let mut worst: f64 = 0.0;
    for node in 0..states.len() {
        for i in 0..STATE {
            let h = 1e-4 * spread[0][node][i].sqrt();
            let of = |h: f64| {
                let mut moved = states.clone();
                moved[node] = moved[node].moved(&StateError::ith(i, h));
                problem.cost(&[moved], &problem.border).unwrap()
            };
            worst = worst.max(slope(h, &of).abs());
        }
    }
    for i in 0..BORDER {
        let h = 1e-4 * whole.covariance[(i, i)].sqrt();
        let of = |h: f64| {
            problem.cost(std::slice::from_ref(&states), &problem.border.moved(&BorderError::ith(i, h))).unwrap()
        };
        worst = worst.max(slope(h, &of).abs());
    }
    assert!(worst < 1e-4, "{worst:e}");
}

/// The information of the noise is that of dense algebra: what is left of the residuals of one kind of noise, as the right side, of all unknowns' least squares, times those of another.
#[test]
fn information_of_the_noise_matches_dense_algebra() {
    let recordings = [Recording::new(0.4, 1), Recording::new(0.3, 2)];
    let lever = Prior { value: [0.0; 3], deviation: 0.1 };
    let options = FuseOptions { lever, offset: Prior { value: 0.19, deviation: 0.01 }, ..options() };
    let mut problem = problem(&recordings.each_ref().map(Recording::run), &options);
    problem.descend(STEPS).unwrap();
    let (matrix, right) = rows(&problem);
    // Rows of positions, attitudes and walks. The priors of the constants come first. Each node follows: biases (at the first node), six rows of the pose, fifteen of the readings.
    let known = problem.border_rows(&problem.border).len();
    let (mut parts, mut at) = (vec![DVector::zeros(right.len()); 4], known);
    for track in &problem.tracks {
        for node in 0..track.nodes() {
            at += if node == 0 { 6 } else { 0 };
            (0..6).for_each(|i| parts[i / 3][at + i] = 1.0);
            at += 6;
            if node + 1 < track.nodes() {
                (9..15).for_each(|i| parts[i / 3 - 1][at + i] = 1.0);
                at += 15;
            }
        }
    }
    assert_eq!(at, right.len());
    let q = matrix.qr().q();
    let weighted: Vec<_> = parts.iter().map(|part| part.component_mul(&right)).collect();
    let information = problem.information(&[8, 9, 10, 11]).unwrap();
    for (l, column) in weighted.iter().enumerate() {
        let left = column - &q * (q.transpose() * column);
        for (k, other) in weighted.iter().enumerate() {
            let expected = 0.5 * other.dot(&left);
            let scale = (information[(k, k)] * information[(l, l)]).sqrt();
            assert!(
                (information[(k, l)] - expected).abs() < 1e-8 * scale,
                "{k} {l}: {} {expected}",
                information[(k, l)]
            );
        }
    }
}
