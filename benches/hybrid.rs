//! A piecewise-affine model of a running robot's size, and recordings for it, to time rollouts and their sensitivities.

use fleetfoot_data::{Column, MemorySource};
use fleetfoot_library::Expr;
use fleetfoot_model::{
    AffineMap, Column as ModelColumn, Equation, Latent, Model, Partition, Prediction, RegionSummary, Role, Rule,
    Training,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Its states.
pub const STATES: usize = 16;
/// Its inputs.
pub const INPUTS: usize = 2;
/// States and inputs.
pub const COLUMNS: usize = STATES + INPUTS;
/// Its regions, cells of k-means in all states.
pub const REGIONS: usize = 50;
/// Seconds of a row.
pub const DT: f64 = 1e-3;

/// The columns: states, then inputs.
pub fn names() -> Vec<String> {
    (0..STATES).map(|i| format!("x{i}")).chain((0..INPUTS).map(|i| format!("u{i}"))).collect()
}

/// Oscillating channels around `hertz`, in four episodes.
pub fn recording(hertz: f64) -> MemorySource {
    let mut source = MemorySource::new(names().into_iter().map(Column::float).collect());
    for episode in 0..4 {
        let mut random = Pcg64::seed_from_u64(100 + episode);
        let columns = (0..COLUMNS)
            .map(|_| {
                let frequency = std::f64::consts::TAU * hertz * random.random_range(0.8..1.2);
                let phase: f64 = random.random_range(0.0..std::f64::consts::TAU);
                (0..2_000).map(|k| 1.3 * (frequency * DT * f64::from(k) + phase).sin()).collect()
            })
            .collect();
        source.push_uniform(format!("run {episode}"), DT, columns);
    }
    source
}

/// Damped rotations in eight planes at about `hertz`, differently coupled and driven in every region, so that trajectories
/// keep moving through the regions.
pub fn model(hertz: f64) -> Model {
    let mut random = Pcg64::seed_from_u64(1);
    let names = names();
    let omega = std::f64::consts::TAU * hertz;
    // An explicit Euler step turns and stretches by |1 + (i w - d) dt|: the damping holds that below one, as far as steps allow.
    let (turn, damping) =
        if omega * DT < 0.5 { (omega, 0.1 * omega + omega * omega * DT) } else { (0.6 / DT, 1.0 / DT) };
    let mut coefficients = vec![vec![vec![0.0; COLUMNS]; REGIONS]; STATES];
    let mut constants = vec![vec![0.0; REGIONS]; STATES];
    for region in 0..REGIONS {
        for i in 0..STATES {
            for j in 0..COLUMNS {
                coefficients[i][region][j] = 0.02 * turn * random.random_range(-1.0..1.0);
            }
            coefficients[i][region][i] -= damping;
            let partner = i ^ 1;
            coefficients[i][region][partner] += if i < partner { turn } else { -turn };
            constants[i][region] = turn * random.random_range(-1.0..1.0);
        }
    }
    let centroids = (0..REGIONS).map(|_| (0..STATES).map(|_| random.random_range(-1.6..1.6)).collect()).collect();
    let functions: Vec<Expr> = names.iter().map(|name| Expr::column(name.as_str())).collect();
    let triangle = |n: usize| n * (n + 1) / 2;
    let diagonal =
        |n: usize| -> Vec<f64> { (0..n).flat_map(|i| (0..=i).map(move |j| if i == j { 1.0 } else { 0.0 })).collect() };
    let mut partition = Partition::whole();
    partition.specification = format!("kmeans:{REGIONS}");
    partition.columns = functions[..STATES].to_vec();
    partition.centre = (0..STATES).map(|_| random.random_range(-0.1..0.1)).collect();
    partition.scale = (0..STATES).map(|_| random.random_range(0.8..1.2)).collect();
    partition.rule = Rule::voronoi(centroids);
    let seen = (0..REGIONS)
        .map(|region| RegionSummary {
            name: region.to_string(),
            rows: 100,
            mean: vec![0.0; COLUMNS],
            covariance: diagonal(COLUMNS),
            range: vec![[-1e3, 1e3]; COLUMNS],
            residual_covariance: vec![0.0; triangle(STATES)],
            rank: COLUMNS,
            condition: 1.0,
            confounded: Vec::new(),
        })
        .collect();
    let columns = names
        .iter()
        .enumerate()
        .map(|(i, name)| ModelColumn {
            name: name.clone(),
            source: name.clone(),
            unit: None,
            role: if i < STATES { Role::State } else { Role::Input },
            angle: false,
            rotation: None,
        })
        .collect();
    let training = Training {
        target_mean: vec![0.0; STATES],
        target_covariance: diagonal(STATES),
        target_deviation: vec![1.0; STATES],
        state_covariance: diagonal(STATES),
        ..Training::default()
    };
    let mut model = Model::new("bench", columns, DT, training);
    model.libraries = vec![functions];
    model.add_partition(partition, seen);
    for (i, (coefficients, constants)) in coefficients.into_iter().zip(constants).enumerate() {
        let name = format!("f{i}");
        model.equations.push(Equation {
            subject: names[i].clone(),
            prediction: Prediction::Derivative,
            right: Expr::column(name.as_str()),
            target: Some(Expr::column(names[i].as_str())),
            unit: None,
        });
        model.latents.push(Latent {
            beyond: Vec::new(),
            name,
            library: 0,
            partition: 0,
            map: AffineMap { constants, coefficients }.into(),
        });
    }
    model
}
