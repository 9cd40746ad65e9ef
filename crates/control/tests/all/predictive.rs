//! Programs of predictive control: certificate, peer, closed forms.

use fleetfoot_control::predictive::{Instance, Program, ProgramBound, ProgramStep, SOLVED, Solver, Status};
use fleetfoot_data::mix;
use proptest::prelude::*;

use crate::interior::Interior;

/// A random program and its instance.
struct Case {
    program: Program,
    start: Vec<f64>,
    sequence: Vec<usize>,
    constants: Vec<f64>,
    limits: Vec<[f64; 2]>,
    target: Vec<f64>,
    input_target: Vec<f64>,
}

impl Case {
    /// `growth` is the largest row sum of the steps.
    fn new(seed: u64, (n, m, horizon): (usize, usize, usize), (growth, penalty): (f64, f64)) -> Self {
        let mut draws = 0;
        let mut some = |count: usize, size: f64| -> Vec<f64> {
            let mut one = || {
                draws += 1;
                size * (mix(mix(seed) ^ draws) as f64 / 2f64.powi(63) - 1.0)
            };
            (0..count).map(|_| one()).collect()
        };
        let regions = 3;
        let steps: Vec<ProgramStep> = (0..regions)
            .map(|_| {
                let (mut a, b) = (some(n * n, 1.0), some(n * m, 1.0));
                for row in a.chunks_mut(n) {
                    let sum: f64 = row.iter().map(|entry| entry.abs()).sum();
                    row.iter_mut().for_each(|entry| *entry *= growth / sum);
                }
                ProgramStep { a, b }
            })
            .collect();
        let root = some(n * n, 2.0);
        let terminal: Vec<f64> =
            (0..n * n).map(|at| (0..n).map(|l| root[n * l + at / n] * root[n * l + at % n]).sum::<f64>()).collect();
        let input_weights: Vec<f64> = some(m, 1.0).iter().map(|w| 10f64.powf(*w)).collect();
        let curvature = (0..m)
            .map(|j| {
                let b = |i: usize| steps[0].b[m * i + j];
                let along = |i: usize| (0..n).map(|l| terminal[n * i + l] * b(l)).sum::<f64>();
                input_weights[j] + (0..n).map(|i| b(i) * along(i)).sum::<f64>()
            })
            .collect();
        let bounds: Vec<ProgramBound> = (0..n)
            .step_by(2)
            .map(|state| {
                let (low, high) = (some(1, 1.0)[0], some(1, 1.0)[0]);
                let highest = if state == 2 { f64::INFINITY } else { low.max(high) };
                ProgramBound { state, lowest: low.min(high), highest, weight: penalty }
            })
            .collect();
        let limits = (0..m)
            .map(|j| {
                let (low, width) = (some(1, 0.5)[0], some(1, 0.5)[0].abs());
                [low, if j == 1 { f64::INFINITY } else { low + width }]
            })
            .collect();
        Self {
            limits,
            sequence: some(horizon, 1.5).iter().map(|value| (value + 1.5) as usize % regions).collect(),
            program: Program {
                horizon,
                bounds,
                weights: some(n, 1.0).iter().map(|w| w.max(0.0)).collect(),
                input_weights,
                terminal,
                curvature,
                steps,
            },
            start: some(n, 3.0),
            constants: some(n * regions, 0.1),
            target: some(n, 0.3),
            input_target: some(m, 0.3),
        }
    }

    fn instance(&self) -> Instance<'_> {
        Instance {
            start: &self.start,
            sequence: &self.sequence,
            constants: &self.constants,
            limits: &self.limits,
            target: &self.target,
            input_target: &self.input_target,
        }
    }
}

#[test]
fn every_random_program_is_solved() {
    let mut steps = Vec::new();
    for seed in 0..1500 {
        let sizes = [(4, 2, 20), (2, 1, 10), (6, 3, 30), (1, 1, 1), (8, 2, 40)][seed as usize % 5];
        let (growth, penalty) = ([0.7, 1.0, 1.15][seed as usize % 3], [1.0, 1e2, 1e4][(seed / 3) as usize % 3]);
        let case = Case::new(seed, sizes, (growth, penalty));
        let mut solver = Solver::new(&case.program);
        let certificate = solver.solve(&case.program, &case.instance());
        assert_eq!(certificate.status, Status::Solved, "{seed} {certificate:?}");
        steps.push(certificate.steps);
        // From its own solution it has nothing to do, to the bit.
        let plan = solver.plan().to_vec();
        assert_eq!(solver.solve(&case.program, &case.instance()).steps, 0, "{seed}");
        assert_eq!(solver.plan(), plan, "{seed}");
    }
    steps.sort_unstable();
    // Newton steps alone solve most; states far beyond their bounds need the interior-point method behind them.
    assert!(steps[steps.len() / 2] <= 5 && steps[steps.len() - 1] <= 36, "{:?}", &steps[steps.len() - 5..]);
}

/// Largest difference of a solver's plan to the peer's.
fn difference(plan: &[f64], peer: &[f64]) -> f64 {
    plan.iter().zip(peer).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    /// Certificate first, then an interior-point solver.
    #[test]
    fn plans_agree_with_an_interior_point_solver(
        seed in 0u64..1_000_000,
        n in 1usize..7,
        m in 1usize..4,
        horizon in 1usize..31,
        growth in 0.5f64..1.15,
        penalty in 0.0f64..4.0,
    ) {
        let case = Case::new(seed, (n, m, horizon), (growth, 10f64.powf(penalty)));
        let mut solver = Solver::new(&case.program);
        let certificate = solver.solve(&case.program, &case.instance());
        prop_assert_eq!(certificate.status, Status::Solved, "{:?}", certificate);
        prop_assert!(certificate.residual <= SOLVED);
        for (v, [lowest, highest]) in solver.plan().iter().zip(case.limits.iter().cycle()) {
            prop_assert!(lowest <= v && v <= highest, "{v} {lowest} {highest}");
        }
        let program = Interior::new(&case.program, &case.instance());
        // The tightest tolerance that rounding lets the peer reach.
        let reached = |tolerance: f64| Some((program.solve(tolerance)?, tolerance));
        let solved = (8..15).rev().map(|digits| 10f64.powi(-digits)).find_map(reached);
        prop_assert!(solved.is_some(), "the peer reaches no tolerance");
        if let Some((peer, tolerance)) = solved {
            let cost = |plan: &[f64]| {
                let mut path = vec![0.0; (horizon + 1) * n];
                case.program.path(&case.instance(), plan, &mut path);
                case.program.cost(&case.instance(), plan, &path)
            };
            let (own, other) = (cost(solver.plan()), cost(&peer));
            // An objective of curvature R at least, which is above its minimum by the peer's gap.
            let least = case.program.input_weights.iter().copied().fold(f64::INFINITY, f64::min);
            let gap = tolerance * (1.0 + other.abs());
            let off = difference(solver.plan(), &peer);
            prop_assert!(off < 1e-6 + (2.0 * gap / least).sqrt(), "{off} {gap}");
            // The peer violates limits by its tolerance, which saves a little.
            prop_assert!(own <= other + 1e-10 * (1.0 + other.abs()), "{own} {other}");
        }
    }
}
