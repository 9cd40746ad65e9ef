//! Rollouts against closed forms.

use std::{collections::HashSet, f64::consts::PI};

use crate::common::*;
use fleetfoot_data::{Silent, Source, with_threads};
use fleetfoot_dynamics::{
    Baseline, End, Error, Method, Outside, RolloutOptions, Simulator, Start, Starts, Step, Trajectory, rollout,
};
use fleetfoot_model::{Branch, Cut, Model, Partition, Prediction, Role, Rule, Tree, UnseenLabel};
use proptest::prelude::*;

pub(crate) fn options(horizon: usize, method: Method) -> RolloutOptions {
    let mut options = RolloutOptions::new(horizon);
    options.method = method;
    options
}

fn one(simulator: &Simulator, source: &dyn Source, row: usize, options: &RolloutOptions) -> Trajectory {
    let start = Start { episode: 0, row };
    simulator.trajectories(source, &[start], options, &Silent).unwrap().remove(0).unwrap()
}

/// x' = v, v' = -w^2 x.
pub(crate) fn oscillator(w: f64) -> Model {
    let columns = vec![column("x", Role::State, false), column("v", Role::State, false)];
    model(
        columns,
        &["x", "v"],
        Partition::whole(),
        vec![("v", Prediction::Derivative, "forward(v)", vec![(0.0, vec![-w * w, 0.0])])],
        &[("x", Prediction::Derivative, "v")],
    )
}

pub(crate) fn oscillator_source(w: f64, dt: f64, rows: usize) -> fleetfoot_data::MemorySource {
    let time = || (0..rows).map(|k| k as f64 * dt);
    let x = time().map(|t| (w * t).cos()).collect();
    let v = time().map(|t| -w * (w * t).sin()).collect();
    source(&["x", "v"], dt, vec![vec![x, v]])
}

#[test]
fn euler_and_runge_kutta_have_their_orders() {
    let w = 2.0;
    let duration = 2.0;
    let error = |method: Method, steps: usize, general: bool| {
        let dt = duration / steps as f64;
        let source = oscillator_source(w, dt, steps + 3);
        let mut simulator = Simulator::new(&oscillator(w)).unwrap();
        assert!(simulator.is_affine());
        if general {
            simulator = simulator.general();
        }
        let mut options = options(steps, method);
        options.step = Step::Seconds(dt);
        let end = one(&simulator, &source, 1, &options);
        let t = dt + duration;
        let exact = [(w * t).cos(), -w * (w * t).sin()];
        (end.state(steps)[0] - exact[0]).hypot(end.state(steps)[1] - exact[1])
    };
    for general in [false, true] {
        let euler = error(Method::Euler, 400, general) / error(Method::Euler, 800, general);
        assert!((euler - 2.0).abs() < 0.05, "order one: {euler}");
        let rk4 = error(Method::Rk4, 50, general) / error(Method::Rk4, 100, general);
        assert!((rk4 - 16.0).abs() < 0.8, "order four: {rk4}");
        assert!(error(Method::Rk4, 400, general) < 1e-9);
    }
}

#[test]
fn a_linear_system_follows_the_matrix_exponential() {
    // Three coupled states with a constant input; exp(At) by its Taylor series with scaling and squaring.
    let a = [[-0.5, 1.0, 0.2], [-1.3, -0.4, 0.7], [0.1, -0.6, -0.9]];
    let b = [0.3, -0.2, 0.8];
    let names = ["p", "q", "r", "u"];
    let columns = (0..4).map(|i| column(names[i], if i < 3 { Role::State } else { Role::Input }, false)).collect();
    let fitted = (0..3)
        .map(|i| (names[i], Prediction::Derivative, "1", vec![(0.0, vec![a[i][0], a[i][1], a[i][2], b[i]])]))
        .collect();
    let model = model(columns, &names, Partition::whole(), fitted, &[]);
    let (dt, steps) = (0.01, 300);
    let start = [1.0, -0.5, 0.25, 0.6];
    let source = source(&names, dt, vec![start.iter().map(|&v| vec![v; steps + 2]).collect()]);
    let end = one(&Simulator::new(&model).unwrap(), &source, 1, &options(steps, Method::Rk4));
    // Augmented system [x; u]' = [[A, b], [0, 0]] [x; u].
    let mut m = [[0.0; 4]; 4];
    for i in 0..3 {
        m[i][..3].copy_from_slice(&a[i]);
        m[i][3] = b[i];
    }
    let exponential = exponential(m, dt * steps as f64);
    for i in 0..3 {
        let exact: f64 = (0..4).map(|j| exponential[i][j] * start[j]).sum();
        assert!((end.state(steps)[i] - exact).abs() < 1e-9, "{i}: {} {exact}", end.state(steps)[i]);
    }
}

fn exponential(m: [[f64; 4]; 4], t: f64) -> [[f64; 4]; 4] {
    let product = |a: &[[f64; 4]; 4], b: &[[f64; 4]; 4]| {
        let mut c = [[0.0; 4]; 4];
        for i in 0..4 {
            for j in 0..4 {
                c[i][j] = (0..4).map(|k| a[i][k] * b[k][j]).sum();
            }
        }
        c
    };
    let scaled = m.map(|row| row.map(|v| v * t / 1024.0));
    let mut identity = [[0.0; 4]; 4];
    (0..4).for_each(|i| identity[i][i] = 1.0);
    let (mut sum, mut term) = (identity, identity);
    for k in 1..20 {
        term = product(&term, &scaled).map(|row| row.map(|v| v / f64::from(k)));
        for i in 0..4 {
            for j in 0..4 {
                sum[i][j] += term[i][j];
            }
        }
    }
    for _ in 0..10 {
        sum = product(&sum, &sum);
    }
    sum
}

#[test]
fn autoregression_runs_free_from_history() {
    let columns = vec![column("y", Role::State, false), column("u", Role::Input, false)];
    let (a1, a2, b1, c) = (1.2, -0.5, 0.7, 0.05);
    let model = model(
        columns,
        &["y", "lag(y, 1)", "lag(u, 1)"],
        Partition::whole(),
        vec![("y", Prediction::Next, "lead(y, 1)", vec![(c, vec![a1, a2, b1])])],
        &[],
    );
    let rows = 60;
    let y: Vec<f64> = (0..rows).map(noise).collect();
    let u: Vec<f64> = (0..rows).map(|k| noise(1000 + k)).collect();
    // The source has its columns in another order.
    let source = source(&["u", "y"], 0.1, vec![vec![u.clone(), y.clone()]]);
    let simulator = Simulator::new(&model).unwrap();
    assert!(!simulator.is_affine());
    assert_eq!(simulator.needed_rows(40).before, 1);
    let (start, steps) = (5, 40);
    let end = one(&simulator, &source, start, &options(steps, Method::Euler));
    let (mut last, mut now) = (y[start - 1], y[start]);
    for k in 0..steps {
        let next = c + a1 * now + a2 * last + b1 * u[start + k - 1];
        (last, now) = (now, next);
        assert!((end.state(k + 1)[0] - now).abs() < 1e-12);
    }
}

#[test]
fn known_states_are_integrated_along_a_circle() {
    // x' = v cos(yaw), y' = v sin(yaw), yaw' = r: a circle of radius v / r.
    let columns = vec![
        column("x", Role::State, false),
        column("y", Role::State, false),
        column("yaw", Role::State, true),
        column("v", Role::Input, false),
        column("r", Role::Input, false),
    ];
    let model = model(
        columns,
        &["r"],
        Partition::whole(),
        vec![("yaw", Prediction::Derivative, "wrap(lead(yaw, 1) - yaw)", vec![(0.0, vec![1.0])])],
        &[("x", Prediction::Derivative, "v*cos(yaw)"), ("y", Prediction::Derivative, "v*sin(yaw)")],
    );
    let (dt, rows, v, r) = (0.01, 1000, 1.5, 2.0);
    let constant = |value: f64| vec![value; rows];
    let source = source(
        &["x", "y", "yaw", "v", "r"],
        dt,
        vec![vec![constant(0.0), constant(0.0), constant(3.0), constant(v), constant(r)]],
    );
    let simulator = Simulator::new(&model).unwrap();
    assert!(!simulator.is_affine(), "a product of columns needs the general path");
    let steps = 900;
    let end = one(&simulator, &source, 1, &options(steps, Method::Rk4));
    for k in [1, 10, 333, 900] {
        let angle = 3.0 + r * k as f64 * dt;
        let state = end.state(k);
        assert!((state[0] - v / r * (angle.sin() - 3f64.sin())).abs() < 1e-8);
        assert!((state[1] + v / r * (angle.cos() - 3f64.cos())).abs() < 1e-8);
        assert!(state[2] > -PI && state[2] <= PI);
        assert!((state[2] - angle).rem_euclid(2.0 * PI).min((angle - state[2]).rem_euclid(2.0 * PI)) < 1e-10);
    }
}

#[test]
fn errors_of_angles_are_wrapped() {
    // The recording turns on at 1 rad/s, the model too but 0.01 rad/s faster; it crosses pi in between.
    let columns = vec![column("yaw", Role::State, true)];
    let fitted = vec![("yaw", Prediction::Derivative, "wrap(lead(yaw, 1) - yaw)", vec![(1.01, vec![])])];
    let mut model = model(columns, &[], Partition::whole(), fitted, &[]);
    model.training.target_mean = vec![1.0];
    let yaw: Vec<f64> = (0..200).map(|k| (3.0 + 0.01 * f64::from(k) + PI).rem_euclid(2.0 * PI) - PI).collect();
    let source = source(&["yaw"], 0.01, vec![vec![yaw]]);
    let starts = Starts::At(vec![Start { episode: 0, row: 1 }]);
    let rollouts = rollout(&model, &source, &starts, &options(100, Method::Euler), &Silent).unwrap();
    for k in 0..100 {
        let expected = 0.01 * 0.01 * (k + 1) as f64;
        assert!((rollouts.horizon.model.rmse[k] - expected).abs() < 1e-9);
        assert!((rollouts.horizon.model.mae[k] - expected).abs() < 1e-9);
    }
    // Constant velocity is exact on this recording, the null model too: the model is never the best.
    assert_eq!(rollouts.horizon.useful.steps, 0);
    assert_eq!(rollouts.horizon.useful.seconds, 0.0);
}

#[test]
fn labels_choose_the_mode_and_unknown_labels_end_a_rollout() {
    let columns = vec![column("x", Role::State, false), column("ground", Role::Auxiliary, false)];
    let rule = Rule::Labels {
        values: vec![0.0, 1.0],
        names: vec!["0".into(), "1".into()],
        rules: vec![Rule::Whole, Rule::Whole],
        unseen: UnseenLabel::Refuse,
    };
    let model = model(
        columns,
        &["x"],
        partition(&["ground"], &[0.0], &[1.0], rule),
        vec![("x", Prediction::Derivative, "forward(x)", vec![(1.0, vec![0.0]), (-2.0, vec![0.0])])],
        &[],
    );
    let rows = 60;
    let ground: Vec<f64> = (0..rows)
        .map(|k| {
            if k < 20 {
                0.0
            } else if k < 40 {
                1.0
            } else {
                7.0
            }
        })
        .collect();
    let source = source(&["x", "ground"], 0.1, vec![vec![vec![0.0; rows], ground]]);
    let simulator = Simulator::new(&model).unwrap();
    let end = one(&simulator, &source, 10, &options(25, Method::Euler));
    assert_eq!(end.end, End::Horizon);
    assert!((end.state(10)[0] - 1.0).abs() < 1e-12 && (end.state(25)[0] - (1.0 - 3.0)).abs() < 1e-12);
    assert_eq!((end.regions[9], end.regions[10]), (0, 1));
    let end = one(&simulator, &source, 30, &options(25, Method::Euler));
    assert_eq!((end.end, end.steps()), (End::NoRegion, 10));
}

#[test]
fn divergence_is_noticed_counted_and_scored() {
    let columns = vec![column("x", Role::State, false)];
    let fitted = vec![("x", Prediction::Derivative, "forward(x)", vec![(0.0, vec![50.0])])];
    let model = model(columns, &["x"], Partition::whole(), fitted, &[]);
    let source = source(&["x"], 0.1, vec![vec![vec![1.0; 40]]]);
    for general in [false, true] {
        let simulator = Simulator::new(&model).unwrap();
        let simulator = if general { simulator.general() } else { simulator };
        let end = one(&simulator, &source, 1, &options(20, Method::Euler));
        // x grows sixfold a step: 6^3 = 216, and 6^4 = 1296 is beyond 1000 deviations from the start.
        assert_eq!((end.end, end.steps()), (End::Diverged, 3));
        assert_eq!(end.state(3)[0], 216.0);
        assert_eq!(end.state(19)[0], 216.0, "the last good state stands");
    }
    let rollouts = rollout(&model, &source, &Starts::Even(4), &options(20, Method::Euler), &Silent).unwrap();
    assert_eq!(rollouts.diverged(), 4);
    assert!((rollouts.outcomes[0].seconds - 0.3).abs() < 1e-12);
    assert_eq!((rollouts.horizon.ended[2], rollouts.horizon.ended[3]), (0.0, 1.0));
    assert_eq!(rollouts.horizon.model.rmse[19], 215.0, "an ended trajectory keeps its error");
    assert_eq!(rollouts.horizon.useful.beaten_by, Some(Baseline::Null));
}

#[test]
fn overflow_and_leaving_the_domain_are_noticed() {
    let columns = vec![column("x", Role::State, false)];
    let fitted = vec![("x", Prediction::Difference, "lead(x, 1) - x", vec![(1.0, vec![0.0])])];
    let mut growing = model(columns, &["x"], Partition::whole(), fitted, &[]);
    // Nothing known about the state's scale: only overflow ends it.
    growing.training.state_covariance = vec![0.0];
    growing.summaries[0].regions[0].range = vec![[-1.0, 4.5]];
    growing.latents[0].map.set(0, Some(0), 0.0);
    let source = source(&["x"], 0.1, vec![vec![vec![0.0; 20]]]);
    for general in [false, true] {
        // A coefficient of zero takes the function out of use; a tiny one keeps its range.
        growing.latents[0].map.set(0, Some(0), 1e-30);
        let simulator = Simulator::new(&growing).unwrap();
        let simulator = if general { simulator.general() } else { simulator };
        let end = one(&simulator, &source, 1, &options(10, Method::Euler));
        assert_eq!((end.end, end.left_domain), (End::Horizon, Some(5)));
        growing.latents[0].map.set(0, Some(0), 1e300);
        let simulator = Simulator::new(&growing).unwrap();
        let simulator = if general { simulator.general() } else { simulator };
        let end = one(&simulator, &source, 1, &options(10, Method::Euler));
        assert_eq!((end.end, end.steps()), (End::Diverged, 2));
    }
}

#[test]
fn the_fast_path_has_the_bits_of_the_general_path() {
    for (states, inputs, regions) in [(16, 2, 50), (3, 1, 7), (9, 0, 1), (17, 3, 12)] {
        let (mut model, source) = random_hybrid(states, inputs, regions, 400);
        // Some structure: a given equation, a sparse region, angles as cosine and sine.
        model.equations[0].target = None;
        model.equations[0].right = parse(if states > 3 { "x3" } else { "x1" });
        model.training.target_mean.pop();
        model.training.target_covariance = identity(states - 1, 1.0);
        model.training.target_deviation.pop();
        for region in &mut model.summaries[0].regions {
            region.residual_covariance = identity(states - 1, 1.0);
            region.range = vec![[-1.5, 1.4]; states + inputs];
        }
        model.columns[1].angle = true;
        model.libraries[0][1] = parse("cos(x1)");
        model.libraries[0][2] = parse("sin(x1)");
        model.partitions[0].columns[1] = parse("sin(x1)");
        let starts = Starts::Random { count: 70, seed: 9 };
        for method in [Method::Euler, Method::Rk4] {
            let fast = Simulator::new(&model).unwrap();
            assert!(fast.is_affine());
            let general = Simulator::new(&model).unwrap().general();
            let options = options(150, method);
            let chosen = starts.choose(&source, 150, 1, 150).unwrap();
            let a = fast.trajectories(&source, &chosen, &options, &Silent).unwrap();
            let b = general.trajectories(&source, &chosen, &options, &Silent).unwrap();
            let mut visited = HashSet::new();
            for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
                assert_eq!(a.regions, b.regions);
                assert!(a.states.iter().zip(&b.states).all(|(x, y)| x.to_bits() == y.to_bits()));
                assert_eq!((a.end, a.left_domain), (b.end, b.left_domain));
                visited.extend(a.regions.iter().copied());
            }
            assert!(visited.len() >= regions.min(3), "the rollouts must cross regions: {}", visited.len());
        }
    }
}

/// Regions of all rows of 50 simulations over 100 steps, by the path for affine models, which the general path must
/// equal.
#[track_caller]
fn regions_on_both_paths(model: &Model, source: &dyn Source, method: Method) -> Vec<u32> {
    let chosen = Starts::Even(50).choose(source, 100, 1, 100).unwrap();
    let options = options(100, method);
    let run = |simulator: Simulator| simulator.trajectories(source, &chosen, &options, &Silent).unwrap();
    let fast = Simulator::new(model).unwrap();
    assert!(fast.is_affine());
    let (fast, general) = (run(fast), run(Simulator::new(model).unwrap().general()));
    assert_eq!(fast, general);
    fast.iter().flatten().flat_map(|trajectory| trajectory.regions.iter().copied()).collect()
}

#[test]
fn balls_and_boxes_on_both_paths() {
    for rule in [Rule::Ball { radius: 1.5 }, Rule::Box { half: 0.9 }] {
        let (mut model, source) = random_hybrid(4, 1, 2, 300);
        model.partitions[0].rule = rule;
        let regions = regions_on_both_paths(&model, &source, Method::Euler);
        let inside = regions.iter().filter(|&&region| region == 0).count();
        assert!(inside > 100 && inside < 4900, "both regions are visited: {inside}");
    }
}

#[test]
fn joined_cells_on_both_paths() {
    let (mut model, source) = random_hybrid(4, 1, 3, 300);
    let centroid = |cell: u64| (0..4).map(|j| 1.5 * noise(7000 + 10 * cell + j)).collect();
    let cells = Rule::voronoi((0..20).map(centroid).collect());
    model.partitions[0].rule = Rule::Joined { cells: cells.into(), regions: (0..20).map(|cell| cell % 3).collect() };
    model.validate().unwrap();
    let regions = regions_on_both_paths(&model, &source, Method::Euler);
    assert_eq!(HashSet::<u32>::from_iter(regions).len(), 3);
}

#[test]
fn cuts_on_both_paths() {
    let (mut model, source) = random_hybrid(4, 1, 4, 300);
    let cut = |column, threshold, below, above| Cut { column, threshold, below, above };
    let tree = Tree {
        cuts: vec![
            cut(2, 0.1, Branch::Cut(1), Branch::Cut(2)),
            cut(0, -0.3, Branch::Region(0), Branch::Region(1)),
            cut(2, 0.6, Branch::Region(2), Branch::Region(3)),
        ],
    };
    let partition = &mut model.partitions[0];
    partition.rule = Rule::Tree(tree);
    // The second column has no cut.
    (partition.centre, partition.scale) = (vec![0.0; 4], vec![1.0; 4]);
    model.validate().unwrap();
    for method in [Method::Euler, Method::Rk4] {
        let regions = regions_on_both_paths(&model, &source, method);
        assert_eq!(HashSet::<u32>::from_iter(regions).len(), 4);
    }
}

#[test]
fn threads_and_groups_change_no_bit() {
    let (model, source) = random_hybrid(5, 2, 9, 500);
    let mut options = options(80, Method::Euler);
    options.keep = true;
    let starts = Starts::Random { count: 130, seed: 4 };
    let run = |threads| with_threads(threads, || rollout(&model, &source, &starts, &options, &Silent)).unwrap();
    let once = run(1);
    assert_eq!(once.outcomes.len(), 130);
    assert_eq!(once, run(2));
    assert_eq!(once, run(7));
    for general in [false, true] {
        let simulator = Simulator::new(&model).unwrap();
        let simulator = if general { simulator.general() } else { simulator };
        for trajectory in once.trajectories.iter().step_by(17) {
            let alone = simulator.trajectories(&source, &[trajectory.start], &options, &Silent).unwrap();
            assert_eq!(alone[0].as_ref(), Some(trajectory));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Trajectories that advance together, each alone, and each by the general path have the same bits. They may change
    /// regions, diverge, leave the training range, or need the recording's last row.
    #[test]
    fn batched_trajectories_equal_single_trajectories(
        (states, inputs, regions) in (1usize..20, 0usize..3, 1usize..60),
        (range, divergence) in (0.3f64..2.5, 0.2f64..4.0),
        outside in prop::sample::select(vec![Outside::Tell, Outside::End, Outside::Hold]),
        method in prop::sample::select(vec![Method::Euler, Method::Rk4]),
        (horizon, stamps, beyond) in (1usize..50, any::<bool>(), any::<bool>()),
        count in 1usize..45,
    ) {
        let rows = 100;
        let (mut model, source) = random_hybrid(states, inputs, regions, rows);
        if beyond {
            model = with_beyond(model, [-range, range], 3);
        }
        for (number, region) in model.summaries[0].regions.iter_mut().enumerate() {
            region.range = vec![[-range, range + 0.1 * number as f64]; states + inputs];
        }
        let mut options = options(horizon, method);
        (options.outside, options.divergence) = (outside, divergence);
        options.step = if stamps { Step::Stamps } else { Step::Median };
        let last = rows - 1 - horizon;
        let starts: Vec<Start> =
            (0..count).map(|i| Start { episode: i % 2, row: last - (i * 7) % last }).collect();
        let simulator = Simulator::new(&model).unwrap();
        prop_assert!(simulator.is_affine());
        let general = Simulator::new(&model).unwrap().general();
        let together = simulator.trajectories(&source, &starts, &options, &Silent).unwrap();
        for (start, together) in starts.iter().zip(&together) {
            for simulator in [&simulator, &general] {
                let alone = simulator.trajectories(&source, &[*start], &options, &Silent).unwrap().remove(0);
                let (alone, together) = (alone.unwrap(), together.as_ref().unwrap());
                prop_assert!(alone.states.iter().zip(&together.states).all(|(a, b)| a.to_bits() == b.to_bits()));
                prop_assert_eq!(&alone, together);
            }
        }
    }
}

#[test]
fn starts_with_missing_inputs_are_left_out_and_counted() {
    let (model, _) = random_hybrid(2, 1, 2, 10);
    let mut u = vec![0.1; 100];
    u[50] = f64::NAN;
    let source = source(&["x0", "x1", "u0"], 0.01, vec![vec![vec![0.2; 100], vec![0.3; 100], u]]);
    let rollouts = rollout(&model, &source, &Starts::Even(1000), &options(10, Method::Euler), &Silent).unwrap();
    // Rows 1..=89 are possible; a start needs the inputs of its row and the nine rows after it.
    assert_eq!((rollouts.missing, rollouts.outcomes.len()), (10, 79));
    let error = rollout(
        &model,
        &source,
        &Starts::At(vec![Start { episode: 0, row: 45 }]),
        &options(10, Method::Euler),
        &Silent,
    );
    assert!(matches!(error, Err(Error::MissingValues { starts: 1, needed: 12 })));
}

#[test]
fn time_and_irregular_stamps() {
    // x' = time(): x(t) = t^2 / 2, exactly with Runge-Kutta on the real stamps.
    let columns = vec![column("x", Role::State, false)];
    let fitted = vec![("x", Prediction::Derivative, "forward(x)", vec![(0.0, vec![1.0])])];
    let model = model(columns, &["time()"], Partition::whole(), fitted, &[]);
    let mut source = fleetfoot_data::MemorySource::new(vec![fleetfoot_data::Column::float("x")]);
    let stamps: Vec<i64> = (0..50i64).map(|k| 5_000_000_000 + k * 10_000_000 + (k * k % 7) * 1_000_000).collect();
    source.push("jitter", stamps.clone().into(), vec![vec![0.0; 50].into()]);
    let mut options = options(30, Method::Rk4);
    options.step = Step::Stamps;
    let end = one(&Simulator::new(&model).unwrap(), &source, 3, &options);
    let seconds = |row: usize| (stamps[row] - stamps[0]) as f64 * 1e-9;
    let exact = (seconds(33).powi(2) - seconds(3).powi(2)) / 2.0;
    assert!((end.state(30)[0] - exact).abs() < 1e-13);
    assert!((end.time[30] - (seconds(33) - seconds(3))).abs() < 1e-15);
}

#[test]
fn unsuitable_models_are_refused() {
    let columns = || vec![column("x", Role::State, false), column("y", Role::State, false)];
    let plain = |prediction, library: &str| {
        model(columns(), &[library], Partition::whole(), vec![("x", prediction, "x", vec![(0.0, vec![1.0])])], &[])
    };
    assert!(matches!(Simulator::new(&plain(Prediction::Value, "y")), Err(Error::NothingToAdvance { .. })));
    assert!(matches!(Simulator::new(&plain(Prediction::Next, "lead(x, 1)")), Err(Error::FutureState { ahead: 1, .. })));
    let simulator = Simulator::new(&plain(Prediction::Next, "lead(y, 2)")).unwrap();
    assert_eq!(simulator.replayed(), ["y"]);
    assert_eq!(simulator.needed_rows(10).after, 11);
    let twice = model(
        columns(),
        &["y"],
        Partition::whole(),
        vec![("x", Prediction::Next, "lead(x, 1)", vec![(0.0, vec![1.0])])],
        &[("x", Prediction::Derivative, "y")],
    );
    assert!(matches!(Simulator::new(&twice), Err(Error::Contradiction { .. })));
    let source = source(&["x"], 0.1, vec![vec![vec![0.0; 50]]]);
    let options = options(5, Method::Euler);
    let error = rollout(&plain(Prediction::Next, "y"), &source, &Starts::Even(3), &options, &Silent).unwrap_err();
    assert!(error.to_string().contains("`y`"), "{error}");
    let none = RolloutOptions::new(0);
    let error = rollout(&plain(Prediction::Next, "x"), &source, &Starts::Even(3), &none, &Silent);
    assert!(matches!(error, Err(Error::NoHorizon)));
}

/// x' = x, with a training range up to 2. Beyond it a trajectory goes on, ends, or grows at the rate of the border.
#[test]
fn leaving_the_training_range_is_noted_ended_or_held() {
    let columns = vec![column("x", Role::State, false)];
    let fitted = vec![("x", Prediction::Derivative, "1", vec![(0.0, vec![1.0])])];
    let mut model = model(columns, &["x"], Partition::whole(), fitted, &[]);
    model.summaries[0].regions[0].range = vec![[-1.0, 2.0]];
    let source = source(&["x"], 0.5, vec![vec![vec![1.0; 9]]]);
    for method in [Method::Euler, Method::Rk4] {
        for general in [false, true] {
            let mut simulator = Simulator::new(&model).unwrap();
            if general {
                simulator = simulator.general();
            }
            let run = |outside: Outside| {
                let mut options = options(6, method);
                options.outside = outside;
                one(&simulator, &source, 1, &options)
            };
            let (continued, ended, held) = (run(Outside::Tell), run(Outside::End), run(Outside::Hold));
            // 1, 1.5, 2.25: the third state is the first one outside; by Runge-Kutta 1, 1.65, 2.72.
            assert_eq!([continued.left_domain, ended.left_domain, held.left_domain], [Some(2); 3]);
            assert_eq!((continued.end, continued.steps()), (End::Horizon, 6));
            assert_eq!((ended.end, ended.steps()), (End::LeftDomain, 2));
            assert_eq!((held.end, held.steps()), (End::Horizon, 6));
            assert_eq!(ended.states, continued.states[..3]);
            for k in 2..6 {
                assert!((held.state(k + 1)[0] - held.state(k)[0] - 0.5 * 2.0).abs() < 1e-14);
            }
            let growth = if method == Method::Euler { 1.5 } else { 1.0 + 0.5 + 0.125 + 0.125 / 6.0 + 0.0625 / 24.0 };
            assert!((continued.state(6)[0] / continued.state(5)[0] - growth).abs() < 1e-14);
        }
    }
}

/// x' = 3 x seen from -1 to 2, and 0.5 x beyond: from the border on the slope is the other one, and by 0 the value is held.
#[test]
fn a_map_goes_on_from_the_border_by_other_slopes() {
    let columns = vec![column("x", Role::State, false)];
    let rule = Rule::voronoi(vec![vec![-10.0], vec![10.0]]);
    let maps = vec![(0.0, vec![3.0]), (0.0, vec![3.0])];
    let fitted = vec![("x", Prediction::Derivative, "1", maps)];
    let mut model = model(columns, &["x"], partition(&["x"], &[0.0], &[1.0], rule), fitted, &[]);
    model.summaries[0].regions.iter_mut().for_each(|region| region.range = vec![[-1.0, 2.0]]);
    let source = source(&["x"], 0.5, vec![vec![vec![1.5; 9]]]);
    for (slope, method) in [(0.5, Method::Euler), (0.0, Method::Euler), (0.5, Method::Rk4), (0.0, Method::Rk4)] {
        model.latents[0].beyond = vec![slope];
        let simulator = Simulator::new(&model).unwrap();
        assert!(simulator.is_affine());
        let trajectory = one(&simulator, &source, 1, &options(6, method));
        assert_eq!(trajectory, one(&simulator.general(), &source, 1, &options(6, method)));
        assert_eq!(trajectory.left_domain, Some(1));
        if method == Method::Euler {
            for k in 1..6 {
                let x = trajectory.state(k)[0];
                let expected = x + 0.5 * (3.0 * 2.0 + slope * (x - 2.0));
                assert!((trajectory.state(k + 1)[0] - expected).abs() < 1e-12, "{slope} {k}");
            }
        }
    }
    // A region without rows has no range, and its map holds everywhere.
    model.summaries[0].regions[1].range = vec![[f64::INFINITY, f64::NEG_INFINITY]];
    let trajectory = one(&Simulator::new(&model).unwrap(), &source, 1, &options(3, Method::Euler));
    assert!((trajectory.state(3)[0] / trajectory.state(2)[0] - 2.5).abs() < 1e-12);
    // Half of the latents of a partition would be two maps in one.
    model.latents[0].beyond = vec![0.5, 0.5];
    assert!(model.validate().unwrap_err().contains("2 slopes outside of training for 1 functions"));
}

/// A region's own range holds its own map; what is given, and what is not a number, is not held.
#[test]
fn held_map_matches_border() {
    let columns = vec![column("x", Role::State, false), column("v", Role::State, false)];
    let fitted = vec![("v", Prediction::Derivative, "1", vec![(0.5, vec![-2.0, 0.3])])];
    let given = [("x", Prediction::Derivative, "v")];
    let mut model = model(columns, &["x", "v"], Partition::whole(), fitted, &given);
    model.summaries[0].regions[0].range = vec![[-0.5, 0.5], [-1.0, 1.0]];
    let source = source(&["x", "v"], 0.1, vec![vec![vec![3.0; 4], vec![-4.0; 4]]]);
    let mut options = options(1, Method::Euler);
    options.outside = Outside::Hold;
    let held = one(&Simulator::new(&model).unwrap(), &source, 1, &options);
    assert!((held.state(1)[0] - (3.0 + 0.1 * -4.0)).abs() < 1e-15, "a given equation sees the state itself");
    assert!((held.state(1)[1] - (-4.0 + 0.1 * (0.5 - 2.0 * 0.5 - 0.3))).abs() < 1e-15);
}
