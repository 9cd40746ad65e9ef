//! Small models and recordings with known answers.

#![allow(dead_code)] // Every test file uses its own part.

use std::sync::Arc;

use fleetfoot_data::{Column as DataColumn, MemorySource, packed};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{
    AffineMap, Basis, BasisMap, Column, Equation, Gaussian, Latent, Model, Partition, Prediction, RegionSummary, Role,
    Rule, Training,
};

/// A column of a model.
pub(crate) fn column(name: &str, role: Role, angle: bool) -> Column {
    Column { angle, ..Column::new(name, role) }
}

/// An expression over any names.
pub(crate) fn parse(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).unwrap()
}

/// A source with one uniform episode per entry of `episodes` (columns x rows).
pub(crate) fn source(names: &[&str], dt: f64, episodes: Vec<Vec<Vec<f64>>>) -> MemorySource {
    let mut source = MemorySource::new(names.iter().map(|name| DataColumn::float(*name)).collect());
    for (i, values) in episodes.into_iter().enumerate() {
        source.push_uniform(format!("episode{i}"), dt, values);
    }
    source
}

/// Region summary of a model of `functions` functions and `targets` targets, as training might give it: unit
/// covariances, wide ranges.
pub(crate) fn region(name: &str, functions: usize, targets: usize) -> RegionSummary {
    RegionSummary {
        name: name.into(),
        rows: 100,
        mean: vec![0.0; functions],
        covariance: identity(functions, 1.0),
        range: vec![[-1e6, 1e6]; functions],
        residual_covariance: identity(targets, 1.0),
        rank: functions,
        condition: 1.0,
        confounded: Vec::new(),
    }
}

/// A packed multiple of the identity.
pub(crate) fn identity(n: usize, value: f64) -> Vec<f64> {
    let mut packed_values = vec![0.0; n * (n + 1) / 2];
    for i in 0..n {
        packed_values[packed(i, i)] = value;
    }
    packed_values
}

/// A fitted equation: subject, prediction, target and, per region, constant and coefficients.
pub(crate) type Fitted<'a> = (&'a str, Prediction, &'a str, Vec<(f64, Vec<f64>)>);

/// A model of one library and one partition; `given` lists subject, prediction and right side.
pub(crate) fn model(
    columns: Vec<Column>,
    library: &[&str],
    partition: Partition,
    fitted: Vec<Fitted<'_>>,
    given: &[(&str, Prediction, &str)],
) -> Model {
    let states = columns.iter().filter(|column| column.role == Role::State).count();
    let targets = fitted.len();
    let training = Training {
        target_mean: vec![0.0; targets],
        target_covariance: identity(targets, 1.0),
        target_deviation: vec![1.0; targets],
        state_covariance: identity(states, 1.0),
        ..Training::default()
    };
    let regions = partition.rule.count();
    let seen = (0..regions).map(|i| region(&i.to_string(), library.len(), targets)).collect();
    let mut model = Model::new("test", columns, 0.01, training);
    model.libraries = vec![library.iter().map(|text| parse(text)).collect()];
    model.add_partition(partition, seen);
    for (subject, prediction, target, maps) in fitted {
        assert_eq!(maps.len(), regions);
        let name = format!("latent_{subject}");
        model.equations.push(Equation {
            subject: subject.into(),
            prediction,
            right: Expr::column(name.as_str()),
            target: Some(parse(target)),
            unit: None,
        });
        let (constants, coefficients) = maps.into_iter().unzip();
        model.latents.push(Latent {
            beyond: Vec::new(),
            name,
            library: 0,
            partition: 0,
            map: AffineMap { constants, coefficients }.into(),
        });
    }
    for (subject, prediction, right) in given {
        let right = parse(right);
        model.equations.push(Equation {
            subject: (*subject).into(),
            prediction: *prediction,
            right,
            target: None,
            unit: None,
        });
    }
    model.validate().unwrap();
    model
}

/// A model with radial functions of some functions of its one library beside them; weights and centres from the seed.
pub(crate) fn with_radial(mut model: Model, inputs: &[usize], seed: u64) -> Model {
    let number = |at: usize| noise(seed + 5000 + at as u64);
    let radial = Arc::new(Gaussian {
        inputs: inputs.to_vec(),
        centres: (0..4).map(|k| (0..inputs.len()).map(|i| number(10 * k + i)).collect()).collect(),
        scale: (0..inputs.len()).map(|i| 0.8 + 0.3 * i as f64).collect(),
        width: 0.7,
    });
    for (at, latent) in model.latents.iter_mut().enumerate() {
        let affine = latent.affine().unwrap().clone();
        let row = |region: usize| (0..4).map(|k| 0.3 * number(100 + 40 * at + 4 * region + k)).collect();
        let weights = (0..latent.map.regions()).map(row).collect();
        latent.map = BasisMap { affine, basis: Basis::Gaussian(radial.clone()), weights }.into();
    }
    model.validate().unwrap();
    model
}

/// A model that goes on by other slopes outside of these ranges of all functions and regions; slopes from the seed.
pub(crate) fn with_beyond(mut model: Model, range: [f64; 2], seed: u64) -> Model {
    for region in model.summaries.iter_mut().flat_map(|summary| &mut summary.regions) {
        region.range.fill(range);
    }
    for (at, latent) in model.latents.iter_mut().enumerate() {
        let slope = |j: usize| 0.5 * noise(seed + 7000 + 50 * at as u64 + j as u64);
        latent.beyond = (0..latent.map.features()).map(slope).collect();
    }
    model.validate().unwrap();
    model
}

/// A partition by a rule on standardised columns.
pub(crate) fn partition(columns: &[&str], centre: &[f64], scale: &[f64], rule: Rule) -> Partition {
    let mut partition = Partition::whole();
    partition.columns = columns.iter().map(|text| parse(text)).collect();
    partition.centre = centre.to_vec();
    partition.scale = scale.to_vec();
    partition.rule = rule;
    partition
}

/// Pseudo-random numbers in [-1, 1), from a key.
pub(crate) fn noise(key: u64) -> f64 {
    let mut z = key.wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    (z ^ (z >> 31)) as i64 as f64 / i64::MAX as f64
}

/// A random hybrid model: `states` states, `inputs` inputs, `regions` Voronoi regions, and two episodes of a recording for it.
pub(crate) fn random_hybrid(states: usize, inputs: usize, regions: usize, rows: usize) -> (Model, MemorySource) {
    let names: Vec<String> = (0..states).map(|i| format!("x{i}")).chain((0..inputs).map(|i| format!("u{i}"))).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let columns =
        (0..names.len()).map(|i| column(names[i], if i < states { Role::State } else { Role::Input }, false)).collect();
    let centroids: Vec<Vec<f64>> =
        (0..regions).map(|r| (0..states).map(|j| 1.5 * noise((r * 100 + j) as u64)).collect()).collect();
    let partition = partition(
        &names[..states],
        &(0..states).map(|j| 0.1 * noise(5000 + j as u64)).collect::<Vec<_>>(),
        &(0..states).map(|j| 0.8 + 0.3 * noise(6000 + j as u64)).collect::<Vec<_>>(),
        Rule::voronoi(centroids),
    );
    let fitted = (0..states)
        .map(|i| {
            let maps = (0..regions)
                .map(|r| {
                    let coefficients: Vec<f64> = (0..names.len())
                        .map(|j| 2.0 * noise((10_000 + r * 1000 + i * 40 + j) as u64) - if i == j { 3.0 } else { 0.0 })
                        .collect();
                    (6.0 * noise((900_000 + r * 100 + i) as u64), coefficients)
                })
                .collect();
            (names[i], Prediction::Derivative, "1", maps)
        })
        .collect();
    let mut model = model(columns, &names, partition, fitted, &[]);
    for equation in &mut model.equations {
        equation.target = Some(parse(&format!("forward({})", equation.subject)));
    }
    let episode = |e: usize| -> Vec<Vec<f64>> {
        (0..names.len())
            .map(|j| {
                (0..rows).map(|k| 1.2 * ((k as f64) * (0.03 + 0.005 * j as f64) + (e * 7 + j) as f64).sin()).collect()
            })
            .collect()
    };
    let source = source(&names, 0.01, vec![episode(0), episode(1)]);
    (model, source)
}
