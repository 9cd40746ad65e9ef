//! Parts of the models of tests: numbers by counting, and a builder.

use std::sync::Arc;

use fleetfoot_data::mix;
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{
    Activation, AffineMap, Basis, BasisMap, Cell, Column, DenseLayer, Equation, Gaussian, Latent, Model, Network,
    Partition, Prediction, Recurrent, RegionSummary, Role, Rule, Training,
};

/// Numbers by counting.
pub(crate) struct Draw {
    seed: u64,
    count: u64,
}

impl Draw {
    pub(crate) fn new(seed: u64) -> Self {
        Self { seed: mix(seed), count: 0 }
    }

    /// Uniform in [-1, 1).
    pub(crate) fn value(&mut self) -> f64 {
        self.count += 1;
        (mix(self.seed.wrapping_add(self.count)) >> 11) as f64 * (2.0 / 9_007_199_254_740_992.0) - 1.0
    }

    pub(crate) fn values(&mut self, count: usize) -> Vec<f64> {
        (0..count).map(|_| self.value()).collect()
    }
}

/// Collects the parts of a model.
pub(crate) struct Maker {
    pub(crate) model: Model,
    draw: Draw,
    labels: Vec<String>,
}

impl Maker {
    /// `columns`: name and role, an angle where a `~` stands in front of the name.
    pub(crate) fn new(seed: u64, method: &str, columns: &[(&str, Role)]) -> Self {
        let columns = columns
            .iter()
            .map(|(name, role)| Column {
                name: name.trim_start_matches('~').into(),
                source: format!("`raw {name}`"),
                unit: Some("m/s²".into()),
                role: *role,
                angle: name.starts_with('~'),
                rotation: None,
            })
            .collect();
        let training = Training { version: "0.1.0".into(), rows: 400, seed, ..Training::default() };
        Self { model: Model::new(method, columns, 0.02, training), draw: Draw::new(seed), labels: Vec::new() }
    }

    pub(crate) fn parse(&self, text: &str) -> Expr {
        let names = self.model.columns.iter().map(|column| column.name.clone());
        let latents = self.model.latents.iter().map(|latent| latent.name.clone());
        Expr::parse(text, &Scope::new(names.chain(latents))).unwrap_or_else(|error| panic!("{text}: {error}"))
    }

    pub(crate) fn library(&mut self, functions: &[&str]) -> usize {
        let functions = functions.iter().map(|text| self.parse(text)).collect();
        self.model.libraries.push(functions);
        self.model.libraries.len() - 1
    }

    pub(crate) fn partition(&mut self, specification: &str, columns: &[&str], rule: Rule) -> usize {
        let labels = matches!(rule, Rule::Labels { .. });
        if let (true, Some(label)) = (labels, columns.last()) {
            self.labels.push((*label).to_owned());
        }
        let count = columns.len();
        let plain = |i: usize| labels && i + 1 == count;
        let scale = (0..count).map(|i| if plain(i) { 1.0 } else { 0.5 + 0.2 * i as f64 }).collect();
        let centre = (0..count).map(|i| if plain(i) { 0.0 } else { 0.05 * i as f64 - 0.1 }).collect();
        let columns = columns.iter().map(|text| self.parse(text)).collect();
        let partition = Partition {
            specification: specification.into(),
            columns,
            centre,
            scale,
            rule,
            transitions: None,
            phases: None,
            pairs: Vec::new(),
            lattice: None,
            correlation: None,
        };
        self.model.add_partition(partition, Vec::new())
    }

    /// Random centroids.
    pub(crate) fn voronoi(&mut self, count: usize, columns: usize) -> Rule {
        Rule::voronoi((0..count).map(|_| self.draw.values(columns).iter().map(|v| 2.0 * v).collect()).collect())
    }

    /// Random linear separators.
    pub(crate) fn separators(&mut self, count: usize, columns: usize) -> Rule {
        Rule::Linear {
            weights: (0..count).map(|_| self.draw.values(columns)).collect(),
            offsets: self.draw.values(count),
        }
    }

    /// A latent with random coefficients, of which about `share` are not zero.
    pub(crate) fn latent(&mut self, name: &str, library: usize, partition: usize, share: f64) {
        let regions = self.model.partitions[partition].rule.count();
        let functions = self.model.libraries[library].len();
        let mut coefficients = Vec::new();
        for _ in 0..regions {
            let row = (0..functions).map(|_| (self.draw.value(), self.draw.value()));
            coefficients.push(row.map(|(keep, value)| if keep.abs() < share { value } else { 0.0 }).collect());
        }
        let constants = self.draw.values(regions);
        self.model.latents.push(Latent {
            beyond: Vec::new(),
            name: name.into(),
            library,
            partition,
            map: AffineMap { constants, coefficients }.into(),
        });
    }

    /// Gives all latents so far the same radial functions of some functions of their library, with random weights.
    pub(crate) fn radial(&mut self, inputs: &[usize], count: usize) {
        let radial = Arc::new(Gaussian {
            inputs: inputs.to_vec(),
            centres: (0..count).map(|_| self.draw.values(inputs.len())).collect(),
            scale: (0..inputs.len()).map(|i| 0.6 + 0.2 * i as f64).collect(),
            width: 0.9,
        });
        for latent in &mut self.model.latents {
            let affine = latent.affine().expect("an affine latent").clone();
            let weights = (0..latent.map.regions()).map(|_| self.draw.values(count)).collect();
            latent.map = BasisMap { affine, basis: Basis::Gaussian(radial.clone()), weights }.into();
        }
    }

    /// Gives all latents so far the same network over some functions of their library, with random numbers.
    pub(crate) fn network(&mut self, inputs: &[usize], hidden: &[usize], activation: Activation) {
        let mut before = inputs.len();
        let layers = hidden.iter().map(|&units| {
            let weights = (0..units).map(|_| self.draw.values(before)).collect();
            before = units;
            DenseLayer { weights, biases: self.draw.values(units) }
        });
        let network = Network {
            layers: layers.collect(),
            inputs: inputs.to_vec(),
            centre: self.draw.values(inputs.len()),
            scale: (0..inputs.len()).map(|i| 0.6 + 0.2 * i as f64).collect(),
            activation,
        };
        self.basis(&Basis::Network(Arc::new(network)));
    }

    /// Gives all latents so far the same cell over some functions of their library, step by step, with random numbers.
    pub(crate) fn recurrent(&mut self, steps: &[&[usize]], units: usize, cell: Cell) {
        let columns = steps[0].len();
        let rows = cell.gates() * units;
        let mut matrix = |width: usize| (0..rows).map(|_| self.draw.values(width)).collect::<Vec<_>>();
        let (input_weights, state_weights) = (matrix(columns), matrix(units));
        let basis = Basis::Recurrent(Arc::new(Recurrent {
            cell,
            inputs: steps.concat(),
            centre: self.draw.values(columns),
            scale: (0..columns).map(|i| 0.6 + 0.2 * i as f64).collect(),
            input_weights,
            state_weights,
            biases: self.draw.values(rows),
            state_biases: self.draw.values(if cell == Cell::Gru { units } else { 0 }),
        }));
        self.basis(&basis);
    }

    /// Gives all latents so far a basis, with random weights.
    fn basis(&mut self, basis: &Basis) {
        for latent in &mut self.model.latents {
            let affine = latent.affine().expect("an affine latent").clone();
            let weights = (0..latent.map.regions()).map(|_| self.draw.values(basis.count())).collect();
            latent.map = BasisMap { affine, basis: basis.clone(), weights }.into();
        }
    }

    /// An equation; one with a latent in it is fitted.
    pub(crate) fn equation(&mut self, subject: &str, prediction: Prediction, right: &str) {
        let right = self.parse(right);
        let fitted = right.columns().iter().any(|name| self.model.latents.iter().any(|l| *l.name == **name));
        let target = fitted.then(|| Expr::column(subject));
        self.model.equations.push(Equation { subject: subject.into(), prediction, right, target, unit: None });
    }

    /// Fills in the training statistics: ranges of the functions over random rows.
    pub(crate) fn finish(mut self) -> Model {
        let fitted = self.model.fitted().count();
        let states = self.model.columns.iter().filter(|column| column.role == Role::State).count();
        let triangle = |n: usize| n * (n + 1) / 2;
        self.model.training.target_mean = vec![0.0; fitted];
        self.model.training.target_covariance = vec![0.0; triangle(fitted)];
        self.model.training.target_deviation = vec![1.0; fitted];
        self.model.training.state_covariance = vec![0.0; triangle(states)];
        for index in 0..self.model.partitions.len() {
            let owner = self.model.latents.iter().find(|latent| latent.partition == index);
            let library = owner.map_or_else(Vec::new, |owner| self.model.libraries[owner.library].clone());
            let partition = self.model.partitions[index].clone();
            let n = library.len();
            let count = partition.rule.count();
            let mut rows = vec![0u64; count];
            let mut ranges = vec![vec![[f64::INFINITY, f64::NEG_INFINITY]; n]; count];
            for row in 0..400 {
                let mut draw = Draw::new(1000 * index as u64 + row);
                let base: Vec<f64> = draw.values(self.model.columns.len());
                let value = |name: &str, lag: i32| {
                    let column = self.model.column(name).unwrap_or(0);
                    let x = 1.2 * (base[column] + 0.1 * f64::from(lag));
                    if self.labels.iter().any(|label| label == name) { (base[column] * 2.0).round() } else { x }
                };
                let of = |expr: &Expr| expr.value(value, |lag| f64::from(row as u32) * 0.02 - 0.02 * f64::from(lag));
                let z: Vec<f64> = partition
                    .columns
                    .iter()
                    .zip(partition.centre.iter().zip(&partition.scale))
                    .map(|(column, (centre, scale))| (of(column) - centre) / scale)
                    .collect();
                let Some(region) = partition.rule.assign_row(&z) else { continue };
                rows[region as usize] += 1;
                for (range, function) in ranges[region as usize].iter_mut().zip(&library) {
                    let value = of(function);
                    if value.is_finite() {
                        *range = [range[0].min(value), range[1].max(value)];
                    }
                }
            }
            self.model.summaries[index].regions = rows
                .into_iter()
                .zip(ranges)
                .enumerate()
                .map(|(i, (rows, range))| RegionSummary {
                    name: format!("{i}"),
                    rows,
                    mean: vec![0.0; n],
                    covariance: vec![0.0; triangle(n)],
                    range,
                    residual_covariance: vec![0.0; triangle(fitted)],
                    rank: n,
                    condition: 1.0,
                    confounded: Vec::new(),
                })
                .collect();
        }
        if let Err(problem) = self.model.validate() {
            panic!("{}: {problem}", self.model.method);
        }
        self.model
    }
}
