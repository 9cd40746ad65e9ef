//! From coefficients to a model: one latent an equation, over the functions that any of them has, in one region or several.

use std::collections::BTreeSet;

use faer::Mat;
use fleetfoot_model::{
    AffineMap, Column, Latent, Model, Partition, RegionSummary, Role, TrainedEpisode, Training, auxiliary_columns,
};
use fleetfoot_sums::{structured::Spread, system::SystemScan};

use crate::equations::EquationTask;

/// Parts of a model beside its coefficients.
#[derive(Debug, Clone, Default)]
pub struct Provenance {
    /// The method: `sindy stlsq`.
    pub method: String,
    /// The recipe with all flags applied, TOML.
    pub recipe: String,
    /// Seed of everything random.
    pub seed: u64,
    /// Sampling period, seconds.
    pub step: f64,
    /// The episodes used.
    pub episodes: Vec<TrainedEpisode>,
}

impl EquationTask {
    /// The model with these coefficients: one matrix a region, candidates x fitted equations, raw units; `partition` as it was scanned, `None` for one region.
    ///
    /// Functions that no equation has in any region are left out of the model.
    ///
    /// # Panics
    /// When there is not one matrix a region, or the shapes are not those of the task.
    pub fn model(
        &self,
        scan: &SystemScan,
        partition: Option<&Partition>,
        coefficients: &[Mat<f64>],
        provenance: Provenance,
    ) -> Model {
        let first = usize::from(self.constant);
        let fitted = self.fitted.len();
        self.assembled(scan, partition, coefficients, provenance, |region, name, used, b| {
            let functions = Mat::from_fn(self.functions.len(), fitted, |j, t| b[(first + j, t)]);
            let constants: Vec<f64> = (0..fitted).map(|t| self.constant_of(b, t)).collect();
            let spread = Spread::of(&scan.root(region).select(used), 0..used.len(), 1.0);
            let ranges = scan.ranges(region);
            RegionSummary {
                name,
                rows: scan.rows(region),
                mean: spread.mean,
                covariance: spread.covariance,
                range: used.iter().map(|&j| ranges[j]).collect(),
                residual_covariance: scan.residual_covariance(region, functions.as_ref(), &constants),
                rank: spread.rank,
                condition: spread.condition,
                confounded: spread.confounded,
            }
        })
    }

    /// [`EquationTask::model`] for one simulation, without the statistics of its regions, which take longer than many
    /// simulations.
    ///
    /// # Panics
    /// As that.
    pub fn trial(
        &self,
        scan: &SystemScan,
        partition: Option<&Partition>,
        coefficients: &[Mat<f64>],
        provenance: Provenance,
    ) -> Model {
        let targets = self.fitted.len();
        self.assembled(scan, partition, coefficients, provenance, |_, name, used, _| RegionSummary {
            name,
            rows: 0,
            mean: vec![f64::NAN; used.len()],
            covariance: vec![f64::NAN; used.len() * (used.len() + 1) / 2],
            range: vec![[f64::NEG_INFINITY, f64::INFINITY]; used.len()],
            residual_covariance: vec![f64::NAN; fleetfoot_data::packed_row(targets)],
            rank: used.len(),
            condition: f64::NAN,
            confounded: Vec::new(),
        })
    }

    /// A model with all candidates in its library, every coefficient zero, as the start of a search.
    pub fn open(&self, scan: &SystemScan, provenance: Provenance) -> Model {
        let all: Vec<usize> = (0..self.functions.len()).collect();
        let mut model = self.trial(scan, None, &[Mat::zeros(self.candidates(), self.fitted.len())], provenance);
        model.columns = self.model_columns(&all, &Partition::whole());
        model.libraries = vec![self.functions.clone()];
        for latent in &mut model.latents {
            let constants = vec![latent.map.constant(0)];
            latent.map = AffineMap { constants, coefficients: vec![vec![0.0; all.len()]] }.into();
        }
        for region in model.summaries.iter_mut().flat_map(|summary| &mut summary.regions) {
            region.mean = vec![f64::NAN; all.len()];
            region.covariance = vec![f64::NAN; all.len() * (all.len() + 1) / 2];
            region.range = vec![[f64::NEG_INFINITY, f64::INFINITY]; all.len()];
            region.rank = all.len();
        }
        model
    }

    fn constant_of(&self, coefficients: &Mat<f64>, equation: usize) -> f64 {
        if self.constant { coefficients[(0, equation)] } else { 0.0 }
    }

    /// A model whose regions are described by their index, name, functions in use and coefficients.
    fn assembled(
        &self,
        scan: &SystemScan,
        partition: Option<&Partition>,
        coefficients: &[Mat<f64>],
        provenance: Provenance,
        describe: impl Fn(usize, String, &[usize], &Mat<f64>) -> RegionSummary,
    ) -> Model {
        assert_eq!(coefficients.len(), scan.regions(), "one matrix a region");
        let first = usize::from(self.constant);
        let fitted = self.fitted.len();
        let used: Vec<usize> = (0..self.functions.len())
            .filter(|j| coefficients.iter().any(|b| (0..fitted).any(|t| b[(first + j, t)] != 0.0)))
            .collect();
        let used = self.with_inputs(used);
        let partition = partition.cloned().unwrap_or_else(Partition::whole);
        let regions = coefficients
            .iter()
            .enumerate()
            .map(|(region, b)| describe(region, partition.region_name(region), &used, b));
        let regions = regions.collect();
        let latents = self.fitted.iter().enumerate().map(|(t, equation)| Latent {
            beyond: Vec::new(),
            name: equation.latent.clone(),
            library: 0,
            partition: 0,
            map: AffineMap {
                constants: coefficients.iter().map(|b| self.constant_of(b, t)).collect(),
                coefficients: coefficients.iter().map(|b| used.iter().map(|j| b[(first + j, t)]).collect()).collect(),
            }
            .into(),
        });
        let columns = self.model_columns(&used, &partition);
        let states = columns.iter().filter(|column| column.role == Role::State).count();
        let training = training(scan, fitted, states, &provenance);
        let mut model = Model::new(provenance.method, columns, provenance.step, training);
        model.latents = latents.collect();
        model.libraries = vec![used.iter().map(|&j| self.functions[j].clone()).collect()];
        model.add_partition(partition, regions);
        model.equations.clone_from(&self.equations);
        if let Some(radial) = &self.radial {
            radial.gather(&mut model);
        }
        model
    }

    /// Functions in use, ascending, and those that radial functions among them are functions of.
    fn with_inputs(&self, mut used: Vec<usize>) -> Vec<usize> {
        let Some(radial) = &self.radial else { return used };
        let first = self.functions.len() - radial.centres.len();
        if used.iter().any(|&j| j >= first) {
            used.extend(
                self.functions
                    .iter()
                    .enumerate()
                    .filter(|(_, function)| radial.inputs.contains(function))
                    .map(|(j, _)| j),
            );
            used.sort_unstable();
            used.dedup();
        }
        used
    }

    /// States, and the other columns of the model.
    fn model_columns(&self, used: &[usize], partition: &Partition) -> Vec<Column> {
        let functions = used.iter().map(|&j| &self.functions[j]);
        let sides = self.equations.iter().flat_map(|equation| std::iter::once(&equation.right).chain(&equation.target));
        let spoken = functions.chain(sides).chain(&partition.columns).flat_map(fleetfoot_library::Expr::columns);
        let mut names: BTreeSet<String> = spoken.map(|name| name.to_string()).collect();
        names.extend(self.equations.iter().map(|equation| equation.subject.clone()));
        let kept = |column: &&Column| column.role != Role::Auxiliary || names.contains(&column.name);
        let spoken: Vec<Column> = self.columns.iter().filter(kept).cloned().collect();
        // Sources of these columns in a simulation keep the names of this model.
        let sources: Vec<String> =
            auxiliary_columns(&spoken, &self.equations).into_iter().map(|column| column.source).collect();
        let kept = |column: &&Column| kept(column) || sources.contains(&column.source);
        self.columns.iter().filter(kept).cloned().collect()
    }
}

/// Facts over all training rows.
fn training(scan: &SystemScan, fitted: usize, states: usize, provenance: &Provenance) -> Training {
    let also = scan.also();
    Training {
        version: env!("CARGO_PKG_VERSION").into(),
        recipe: provenance.recipe.clone(),
        seed: provenance.seed,
        rows: (0..scan.regions()).map(|region| scan.rows(region)).sum(),
        episodes: provenance.episodes.clone(),
        target_mean: also.mean[..fitted].to_vec(),
        target_covariance: also.covariance(0..fitted),
        // An absolute error is no quadratic question: a statistic does not know it.
        target_deviation: vec![f64::NAN; fitted],
        state_covariance: also.covariance(fitted..fitted + states),
        state_mean: also.mean[fitted..fitted + states].to_vec(),
        ..Training::default()
    }
}
