//! Passes over tiles: the sums that the output layer is solved from, and the gradient of the hidden layers.

use faer::{Accum, MatMut, MatRef, Par, linalg::matmul::matmul};
use fleetfoot_data::{Progress, parallel_fold};

use crate::{Error, Output, Samples, Shape, Statistic, layers::Hidden, samples::TILE};

/// Tiles that are summed in one piece by one thread.
const PIECE: usize = 8;

/// The squared error of some tiles and its gradient.
#[derive(Debug, Clone, PartialEq)]
pub struct Slope {
    /// Sum of squared errors over rows and targets, halved.
    pub loss: f64,
    /// Its derivatives by the parameters of the hidden layers.
    pub hidden: Vec<f64>,
    /// Its derivatives by the weights of the features in the output layer (features x targets, the features of a target together).
    pub weights: Vec<f64>,
}

/// Only whether to stop: a pass is no stage of the work that is shown.
struct Quiet<'a>(&'a dyn Progress);

impl Progress for Quiet<'_> {
    fn advance(&self, _: usize, _: usize) {}

    fn cancelled(&self) -> bool {
        self.0.cancelled()
    }
}

/// Folds pieces of tiles in their order, on all threads.
fn pieces<R: Send>(
    tiles: &[usize],
    progress: &dyn Progress,
    work: impl Fn(&[usize]) -> R + Sync,
    mut fold: impl FnMut(R) + Send,
) -> Result<(), Error> {
    let piece = |at: usize| Ok(work(&tiles[at * PIECE..((at + 1) * PIECE).min(tiles.len())]));
    if tiles.len() <= PIECE {
        if progress.cancelled() {
            return Err(Error::Cancelled);
        }
        fold(work(tiles));
        return Ok(());
    }
    parallel_fold(tiles.len().div_ceil(PIECE), &Quiet(progress), piece, |part| {
        fold(part);
        Ok::<_, Error>(())
    })
}

/// The sums of all rows with the features of these hidden layers.
///
/// # Errors
/// The work was stopped.
pub fn statistic(
    shape: &Shape,
    parameters: &[f64],
    samples: &Samples,
    progress: &dyn Progress,
) -> Result<Statistic, Error> {
    let (inputs, features, targets) = (samples.inputs, shape.features(), samples.targets);
    let of = |tiles: &[usize]| {
        let mut sums = Statistic::new(inputs, features, targets);
        let mut layers = Hidden::new(shape);
        let mut columns = vec![0.0; (1 + inputs + features + targets) * TILE];
        for &tile in tiles {
            let (x, y, rows) = samples.tile(tile);
            layers.forward(parameters, x);
            let (ones, rest) = columns.split_at_mut(TILE);
            let (x_columns, rest) = rest.split_at_mut(inputs * TILE);
            let (feature_columns, y_columns) = rest.split_at_mut(features * TILE);
            ones.fill(0.0);
            ones[..rows].fill(1.0);
            x_columns.copy_from_slice(x);
            feature_columns.copy_from_slice(layers.features());
            feature_columns.chunks_exact_mut(TILE).for_each(|column| column[rows..].fill(0.0));
            y_columns.copy_from_slice(y);
            sums.add(&columns, rows);
        }
        sums
    };
    let mut all = Statistic::new(inputs, features, targets);
    let tiles: Vec<usize> = (0..samples.tiles()).collect();
    pieces(&tiles, progress, of, |part| all.merge(&part))?;
    Ok(all)
}

/// The squared error of some tiles with a given output layer, and its gradient.
///
/// # Errors
/// The work was stopped.
pub fn slope(
    shape: &Shape,
    parameters: &[f64],
    output: &Output,
    (samples, tiles): (&Samples, &[usize]),
    progress: &dyn Progress,
) -> Result<Slope, Error> {
    let (inputs, features, targets) = (samples.inputs, shape.features(), samples.targets);
    let count = shape.parameters();
    let output = output.0.as_ref();
    let weights = output.subrows(1 + inputs, features);
    let zero = || Slope { loss: 0.0, hidden: vec![0.0; count], weights: vec![0.0; features * targets] };
    let of = |tiles: &[usize]| {
        let mut sum = zero();
        let mut layers = Hidden::new(shape);
        let (mut errors, mut slopes) = (vec![0.0; targets * TILE], vec![0.0; features * TILE]);
        for &tile in tiles {
            let (x, y, rows) = samples.tile(tile);
            layers.forward(parameters, x);
            for (t, (column, y)) in errors.chunks_exact_mut(TILE).zip(y.chunks_exact(TILE)).enumerate() {
                column.iter_mut().zip(y).for_each(|(error, y)| *error = output[(0, t)] - y);
            }
            let inputs_matrix = MatRef::from_column_major_slice(x, TILE, inputs);
            let features_matrix = MatRef::from_column_major_slice(layers.features(), TILE, features);
            let mut residuals = MatMut::from_column_major_slice_mut(&mut errors, TILE, targets);
            matmul(residuals.as_mut(), Accum::Add, inputs_matrix, output.subrows(1, inputs), 1.0, Par::Seq);
            matmul(residuals.as_mut(), Accum::Add, features_matrix, weights, 1.0, Par::Seq);
            errors.chunks_exact_mut(TILE).for_each(|column| column[rows..].fill(0.0));
            sum.loss += 0.5 * errors.iter().map(|error| error * error).sum::<f64>();
            let residuals = MatRef::from_column_major_slice(&errors, TILE, targets);
            let to = MatMut::from_column_major_slice_mut(&mut sum.weights, features, targets);
            matmul(to, Accum::Add, features_matrix.transpose(), residuals, 1.0, Par::Seq);
            let to = MatMut::from_column_major_slice_mut(&mut slopes, TILE, features);
            matmul(to, Accum::Replace, residuals, weights.transpose(), 1.0, Par::Seq);
            layers.backward(parameters, x, &slopes, &mut sum.hidden);
        }
        sum
    };
    let mut all = zero();
    pieces(tiles, progress, of, |part: Slope| {
        all.loss += part.loss;
        all.hidden.iter_mut().zip(&part.hidden).for_each(|(sum, value)| *sum += value);
        all.weights.iter_mut().zip(&part.weights).for_each(|(sum, value)| *sum += value);
    })?;
    Ok(all)
}
