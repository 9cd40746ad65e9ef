//! Training: Adam over mini-batches, then L-BFGS over all rows, the output layer solved exactly; rows that do not train say when to stop.

use fleetfoot_data::{Progress, mix};

use crate::{Error, Output, Samples, Shape, Statistic, adam::Adam, descent, slope, statistic};

/// Ridges of the features' weights that are compared on the rows that do not train.
const RIDGES: [f64; 8] = [1e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 1e-1];

/// Options of training: its length and its steps.
#[derive(Debug, Clone, PartialEq)]
pub struct Training {
    /// Passes over the rows by Adam at most.
    pub epochs: usize,
    /// Passes, and steps of L-BFGS, without improvement before training stops.
    pub patience: usize,
    /// Learning rate of Adam at the beginning; it falls to nothing along half a cosine.
    pub rate: f64,
    /// Tiles of a mini-batch.
    pub batch: usize,
    /// Steps of L-BFGS at most.
    pub steps: usize,
    /// Seed of the first weights and of the order of the batches.
    pub seed: u64,
}

impl Default for Training {
    fn default() -> Self {
        Self { epochs: 60, patience: 15, rate: 5e-3, batch: 1, steps: 100, seed: 0 }
    }
}

/// A trained network.
#[derive(Debug, Clone, PartialEq)]
pub struct Trained {
    /// The numbers of the hidden layers.
    pub parameters: Vec<f64>,
    /// Ridge of the features' weights in the output layer.
    pub ridge: f64,
    /// Mean squared error on the rows that say when to stop, in units of the targets' variance. They had a say in it: it is no error of rows that were not seen.
    pub loss: f64,
    /// The same of the linear map.
    pub linear: f64,
    /// Passes by Adam, and steps of L-BFGS, that were done.
    pub done: (usize, usize),
}

/// The best so far.
struct Best<'a> {
    shape: &'a Shape,
    samples: [&'a Samples; 2],
    progress: &'a dyn Progress,
    trained: Trained,
    since: usize,
}

impl Best<'_> {
    fn sums(&self, parameters: &[f64]) -> Result<[Statistic; 2], Error> {
        let of = |samples| statistic(self.shape, parameters, samples, self.progress);
        Ok([of(self.samples[0])?, of(self.samples[1])?])
    }

    /// Solves the output layer and keeps the hidden layers if they are better on the rows that do not train.
    fn see(&mut self, parameters: &[f64]) -> Result<(Output, f64), Error> {
        let [fitted, held] = self.sums(parameters)?;
        let mut least: Option<(Output, f64, f64)> = None;
        for ridge in RIDGES {
            let Ok(output) = fitted.solve(ridge) else { continue };
            let loss = held.error(&output);
            if loss.is_finite() && least.as_ref().is_none_or(|(_, _, best)| loss < *best) {
                least = Some((output, ridge, loss));
            }
        }
        let (output, ridge, loss) = least.ok_or(Error::Diverged)?;
        self.since += 1;
        if loss < self.trained.loss {
            // A small improvement is kept, but does not prolong the training.
            if loss < self.trained.loss * (1.0 - 1e-4) {
                self.since = 0;
            }
            (self.trained.loss, self.trained.ridge) = (loss, ridge);
            self.trained.parameters = parameters.to_vec();
        }
        Ok((output, ridge))
    }
}

/// Trains the hidden layers on `fitted`; `held` are rows that do not train: they choose the ridge and the end of training.
///
/// # Errors
/// Too few rows; a shape that does not fit the samples; the work was stopped.
pub fn train(
    shape: &Shape,
    fitted: &Samples,
    held: &Samples,
    training: &Training,
    progress: &dyn Progress,
) -> Result<Trained, Error> {
    shape.check()?;
    if (shape.inputs, fitted.targets) != (fitted.inputs, held.targets) || fitted.inputs != held.inputs {
        return Err(Error::Shape(format!("a network of {} inputs for rows of {}", shape.inputs, fitted.inputs)));
    }
    let least = fitted.inputs + 2;
    for (rows, least) in [(fitted.rows, least), (held.rows, 1)] {
        if rows < least {
            return Err(Error::TooFewRows { rows, least });
        }
    }
    let mut parameters = shape.initial(training.seed);
    let trained =
        Trained { parameters: parameters.clone(), ridge: 0.0, loss: f64::INFINITY, linear: 0.0, done: (0, 0) };
    let mut best = Best { shape, samples: [fitted, held], progress, trained, since: 0 };
    let [sums, held_sums] = best.sums(&parameters)?;
    best.trained.linear = held_sums.linear().error(&sums.linear().solve(0.0)?);
    let (mut output, _) = best.see(&parameters)?;
    adam(&mut best, &mut parameters, &mut output, training)?;
    polish(&mut best, training)?;
    Ok(best.trained)
}

/// Adam over mini-batches: the hidden layers and the weights of their features move, the linear map stays; after each pass the output layer is solved anew.
fn adam(best: &mut Best<'_>, parameters: &mut [f64], output: &mut Output, training: &Training) -> Result<(), Error> {
    let (shape, fitted) = (best.shape, best.samples[0]);
    let (head, targets) = (1 + fitted.inputs, fitted.targets);
    let mut optimiser = Adam::new(shape.parameters() + shape.features() * targets);
    let batch = training.batch.max(1);
    for epoch in 0..training.epochs {
        let rate = training.rate * 0.5 * (1.0 + (std::f64::consts::PI * epoch as f64 / training.epochs as f64).cos());
        for tiles in shuffled(fitted.tiles(), mix(training.seed).wrapping_add(epoch as u64)).chunks(batch) {
            let slopes = slope(shape, parameters, output, (fitted, tiles), best.progress)?;
            let rows: usize = tiles.iter().map(|&tile| fitted.tile(tile).2).sum();
            let gradient = slopes.hidden.iter().chain(&slopes.weights).map(|entry| entry / rows as f64);
            let weights =
                output.0.col_iter_mut().flat_map(|column| column.subrows_mut(head, shape.features()).iter_mut());
            optimiser.step(rate, parameters.iter_mut().chain(weights), gradient);
        }
        best.trained.done.0 = epoch + 1;
        match best.see(parameters) {
            Ok((solved, _)) => *output = solved,
            // A diverging training stops at its best state.
            Err(Error::Diverged) => break,
            Err(error) => return Err(error),
        }
        if best.since > training.patience {
            break;
        }
    }
    Ok(())
}

/// L-BFGS on what the output layer leaves of all rows, with the ridge of the best network so far.
fn polish(best: &mut Best<'_>, training: &Training) -> Result<(), Error> {
    let (shape, fitted, progress) = (best.shape, best.samples[0], best.progress);
    let (ridge, tiles) = (best.trained.ridge, (0..fitted.tiles()).collect::<Vec<_>>());
    let rows = fitted.rows as f64;
    let evaluate = |parameters: &[f64]| {
        let Ok(output) = statistic(shape, parameters, fitted, progress)?.solve(ridge) else { return Ok(None) };
        let slopes = slope(shape, parameters, &output, (fitted, &tiles), progress)?;
        let weights = output.0.as_ref().subrows(1 + fitted.inputs, shape.features()).squared_norm_l2();
        let value = slopes.loss / rows + 0.5 * ridge * weights;
        // The output layer is the best one: the gradient by it is zero (envelope theorem).
        let gradient = slopes.hidden.into_iter().map(|entry| entry / rows).collect();
        Ok(value.is_finite().then_some((value, gradient)))
    };
    best.since = 0;
    let start = best.trained.parameters.clone();
    let after = |parameters: &[f64]| {
        best.trained.done.1 += 1;
        match best.see(parameters) {
            Err(Error::Diverged) => Ok(false),
            other => other.map(|_| best.since <= training.patience),
        }
    };
    descent::descend(start, training.steps, evaluate, after)
}

/// `0..count` in an order that the key decides.
fn shuffled(count: usize, key: u64) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    let key = mix(key);
    order.sort_by_key(|&at| (mix(key.wrapping_add(at as u64)), at));
    order
}
