//! Training and selection of a network: the words of `[network]`, checked once.

use fleetfoot_learn::{Activation, Training};
use fleetfoot_recipe::{ActivationWord, Effort, Recipe, seed};

use crate::error::Error;

/// Folds where none are asked for.
const FOLDS: u16 = 5;
/// Memory for rows where none is asked for, MiB.
const MEMORY: usize = 512;
/// Passes over the rows that training takes at least: of more rows fewer are taken.
const PASSES: f64 = 30.0;

/// Products of matrices go several times as fast as the factorisations of other methods, and most trainings end before their last pass.
const SHARE: f64 = 0.05;

/// Training and selection of a network.
#[derive(Debug, Clone)]
pub(super) struct NetworkOptions {
    /// Units of the hidden layers; `None`: sizes are tried.
    hidden: Option<Vec<usize>>,
    pub(super) activation: Activation,
    pub(super) effort: Effort,
    pub(super) folds: u16,
    pub(super) seed: u64,
    /// Bytes for rows.
    memory: usize,
}

impl NetworkOptions {
    pub(super) fn new(recipe: &Recipe) -> Result<Self, Error> {
        let section = &recipe.network;
        let activation = match section.activation.unwrap_or_default() {
            ActivationWord::Tanh => Activation::Tanh,
            ActivationWord::Relu => Activation::Relu,
            ActivationWord::Softplus => Activation::Softplus,
        };
        Ok(Self {
            hidden: section.hidden.as_ref().map(|layers| layers.0.clone()),
            activation,
            effort: section.effort.unwrap_or_default(),
            folds: section.folds.unwrap_or(FOLDS),
            seed: seed("network", section.seed)?,
            memory: section.memory.unwrap_or(MEMORY) << 20,
        })
    }

    /// True if the caller sets the size.
    pub(super) fn is_given(&self) -> bool {
        self.hidden.is_some()
    }

    /// Hidden layers to compare, from small to large.
    pub(super) fn sizes(&self) -> Vec<Vec<usize>> {
        let tried: &[&[usize]] = match self.effort {
            Effort::Low => &[&[8], &[16]],
            Effort::Normal => &[&[8], &[16], &[32], &[32, 32]],
            Effort::High => &[&[8], &[16], &[32], &[64], &[32, 32], &[64, 64]],
        };
        match &self.hidden {
            Some(hidden) => vec![hidden.clone()],
            None => tried.iter().map(|hidden| hidden.to_vec()).collect(),
        }
    }

    /// Multiply-adds of one training.
    fn budget(&self) -> f64 {
        match self.effort {
            Effort::Low => 2e9,
            Effort::Normal => 1e10,
            Effort::High => 1e11,
        }
    }

    /// Rows that are taken at most, of so many inputs and targets.
    pub(super) fn most_rows(&self, inputs: usize, targets: usize) -> usize {
        let work = self.sizes().iter().map(|hidden| multiplications(hidden, inputs, targets)).fold(1.0, f64::max);
        // As they were read, and in the tiles of the folds that train at the same time.
        let bytes = 8 * (inputs + 2 * targets) * 4;
        ((self.budget() / (PASSES * work)) as usize).clamp(2_000, (self.memory / bytes.max(1)).max(2_000))
    }

    /// Bytes that rows may take.
    pub(super) fn bytes(&self) -> usize {
        self.memory
    }

    /// Training settings for a number of rows.
    pub(super) fn training(&self, hidden: &[usize], rows: usize, inputs: usize, targets: usize) -> Training {
        let pass = multiplications(hidden, inputs, targets) * rows.max(1) as f64;
        let passes = (self.budget() / pass).clamp(PASSES, 1_000.0);
        // A step of L-BFGS takes the sums, the gradient and the look at held-out rows.
        let (epochs, steps) = ((passes / 3.0) as usize, (passes / 4.0) as usize);
        Training {
            epochs: epochs.min(60),
            patience: 15,
            batch: (rows / 20_000).clamp(1, 16),
            steps: steps.min(200),
            seed: self.seed,
            ..Training::default()
        }
    }

    /// Work of the whole comparison, about, in multiplications of the factorisations that other methods count.
    pub(super) fn work(&self, rows: usize, inputs: usize, targets: usize) -> f64 {
        let of = |hidden: &Vec<usize>| {
            let training = self.training(hidden, rows, inputs, targets);
            let passes = (training.epochs * 2 + training.steps * 3) as f64;
            multiplications(hidden, inputs, targets) * rows as f64 * passes
        };
        self.sizes().iter().map(of).sum::<f64>() * f64::from(self.folds + 1) * SHARE
    }
}

/// Multiply-adds of a row in one pass: sums of the output layer, or values and gradient, whichever is more.
fn multiplications(hidden: &[usize], inputs: usize, targets: usize) -> f64 {
    let (mut before, mut layers) = (inputs, 0);
    for &units in hidden {
        layers += before * units;
        before = units;
    }
    let width = inputs + before + targets + 1;
    (3 * layers).max(layers + width * width) as f64
}
