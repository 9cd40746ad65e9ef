//! Training and selection of a network: the words of `[network]`, checked once.

use fleetfoot_data::setting::{ACTIVATION, CELL, HIDDEN};
use fleetfoot_learn::{Activation, Cell, Shape, Training, Window};
use fleetfoot_recipe::{ActivationWord, CellWord, Effort, HiddenLayers, Recipe, seed};

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
    /// The recurrent cell in place of hidden layers.
    pub(super) cell: Option<Cell>,
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
        let word = section.cell.unwrap_or_default();
        let cell = match word {
            CellWord::None => None,
            CellWord::Rnn => Some(Cell::Rnn),
            CellWord::Gru => Some(Cell::Gru),
            CellWord::Lstm => Some(Cell::Lstm),
        };
        if let Some(cell) = cell {
            check_cell(cell, section.hidden.as_ref(), activation)?;
        }
        Ok(Self {
            cell,
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

    /// Hidden layers to compare, from small to large; a cell is one layer.
    pub(super) fn sizes(&self) -> Vec<Vec<usize>> {
        let tried: &[&[usize]] = match self.effort {
            Effort::Low => &[&[8], &[16]],
            Effort::Normal => &[&[8], &[16], &[32], &[32, 32]],
            Effort::High => &[&[8], &[16], &[32], &[64], &[32, 32], &[64, 64]],
        };
        match &self.hidden {
            Some(hidden) => vec![hidden.clone()],
            None => {
                let fits = |hidden: &&&[usize]| self.cell.is_none() || hidden.len() == 1;
                tried.iter().filter(fits).map(|hidden| hidden.to_vec()).collect()
            }
        }
    }

    /// A network of about this size, before its functions are known: of so many inputs in so many rows.
    pub(super) fn planned(&self, hidden: &[usize], (inputs, rows): (usize, usize)) -> Shape {
        let columns = (inputs / rows.max(1)).max(1);
        let window = self.cell.map(|cell| Window { cell, steps: vec![(0..columns).collect(); rows] });
        Shape { inputs, hidden: hidden.to_vec(), activation: self.activation, window }
    }

    /// Multiply-adds of one training.
    fn budget(&self) -> f64 {
        match self.effort {
            Effort::Low => 2e9,
            Effort::Normal => 1e10,
            Effort::High => 1e11,
        }
    }

    /// Samples that are taken at most, of so many inputs in so many rows, and of so many targets.
    pub(super) fn most_rows(&self, inputs: (usize, usize), targets: usize) -> usize {
        let of = |hidden: &Vec<usize>| multiplications(&self.planned(hidden, inputs), targets);
        let work = self.sizes().iter().map(of).fold(1.0, f64::max);
        // As they were read, and in the tiles of the folds that train at the same time.
        let bytes = 8 * (inputs.0 + 2 * targets) * 4;
        ((self.budget() / (PASSES * work)) as usize).clamp(2_000, (self.memory / bytes.max(1)).max(2_000))
    }

    /// Bytes that rows may take.
    pub(super) fn bytes(&self) -> usize {
        self.memory
    }

    /// Training settings for a number of rows.
    pub(super) fn training(&self, shape: &Shape, rows: usize, targets: usize) -> Training {
        let pass = multiplications(shape, targets) * rows.max(1) as f64;
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
    pub(super) fn work(&self, rows: usize, inputs: (usize, usize), targets: usize) -> f64 {
        let of = |hidden: &Vec<usize>| {
            let shape = self.planned(hidden, inputs);
            let training = self.training(&shape, rows, targets);
            let passes = (training.epochs * 2 + training.steps * 3) as f64;
            multiplications(&shape, targets) * rows as f64 * passes
        };
        self.sizes().iter().map(of).sum::<f64>() * f64::from(self.folds + 1) * SHARE
    }
}

/// Refuses settings of hidden layers that a cell does not have.
fn check_cell(cell: Cell, hidden: Option<&HiddenLayers>, activation: Activation) -> Result<(), Error> {
    let cell = CELL.to(super::basis::cell(cell).name());
    if activation != Activation::Tanh {
        return Err(Error::conflict(format!("{cell}: the cell has its own functions; remove {ACTIVATION}")));
    }
    match hidden {
        Some(hidden) if hidden.0.len() > 1 => Err(Error::conflict(format!(
            "{}: {cell} is one layer; write one number of units, such as {}",
            HIDDEN.to(hidden),
            HIDDEN.to(hidden.0[0])
        ))),
        _ => Ok(()),
    }
}

/// Multiply-adds of a row in one pass: sums of the output layer, or values and gradient, whichever is more.
fn multiplications(shape: &Shape, targets: usize) -> f64 {
    let layers = shape.products();
    let width = shape.inputs + shape.features() + targets + 1;
    (3 * layers).max(layers + width * width) as f64
}
