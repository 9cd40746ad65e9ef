//! The third pass, for what is not quadratic: absolute errors and Mahalanobis scores, each row predicted by the models that did not
//! see its fold (paper, Table I), and the residual covariance of the chosen model in each region.

use fleetfoot_data::{Progress, Source};
use fleetfoot_library::DesignRows;
use fleetfoot_stats::{Chunk, reduce};

use crate::{
    Error,
    fit::RegionModel,
    regions::Segmentation,
    rows::{Rows, Tile},
    scan::Assigner,
    select::Order,
};

/// Sums of errors of one candidate.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    /// Weighted sum of absolute errors of each target.
    pub(crate) absolute: Vec<f64>,
    /// Weighted sum of squared errors of each target.
    pub(crate) squared: Vec<f64>,
    /// Weighted sum of Mahalanobis scores of the error vector (equation (10)).
    pub(crate) mahalanobis: f64,
}

/// What the pass found.
pub(crate) struct Errors {
    /// Weight of all rows.
    pub(crate) weight: f64,
    /// Held-out sums of each candidate (in-sample where there are no folds).
    pub(crate) candidates: Vec<Sums>,
    /// Held-out sums of the null model.
    pub(crate) null: Sums,
    /// Weighted sum of |y - mean over all rows|.
    pub(crate) deviation: Vec<f64>,
    /// Weighted scatter of the residuals of the chosen model in each of its regions, packed lower triangle, and weights.
    pub(crate) residuals: Vec<(f64, Vec<f64>)>,
}

impl Sums {
    fn new(targets: usize) -> Self {
        Self { absolute: vec![0.0; targets], squared: vec![0.0; targets], mahalanobis: 0.0 }
    }

    fn merge(&mut self, other: &Self) {
        self.absolute.iter_mut().zip(&other.absolute).for_each(|(a, b)| *a += b);
        self.squared.iter_mut().zip(&other.squared).for_each(|(a, b)| *a += b);
        self.mahalanobis += other.mahalanobis;
    }
}

struct Part {
    errors: Errors,
    scratch: DesignRows,
    regions: Vec<u32>,
    rows: Vec<f64>,
    residual: Vec<f64>,
}

/// What is measured.
pub(crate) struct Measure<'a> {
    pub(crate) rows: &'a Rows,
    pub(crate) segmentation: &'a Segmentation,
    pub(crate) orders: &'a [Order],
    /// Index of the chosen candidate.
    pub(crate) chosen: usize,
    /// Mean of the targets over all rows, and over the training rows of each fold.
    pub(crate) mean: &'a [f64],
    pub(crate) fold_means: &'a [Vec<f64>],
    /// Inverse of the Cholesky factor of the covariance of the targets, q x q lower, by rows.
    pub(crate) whitening: &'a [f64],
}

impl Measure<'_> {
    pub(crate) fn run(&self, source: &dyn Source, chunks: &[Chunk], progress: &dyn Progress) -> Result<Errors, Error> {
        let assigner = Assigner::new(self.segmentation);
        let mut total = self.empty();
        reduce(
            source,
            chunks,
            self.rows.halo(),
            progress,
            || Part {
                errors: self.empty(),
                scratch: DesignRows::default(),
                regions: Vec::new(),
                rows: Vec::new(),
                residual: Vec::new(),
            },
            |part, chunk, block, tile| {
                let mut scratch = std::mem::take(&mut part.scratch);
                let tile = self.rows.evaluate(block, &source.episodes()[chunk.episode].name, tile, &mut scratch)?;
                if tile.len() > 0 {
                    self.add(part, &assigner, chunk, &tile);
                }
                part.scratch = scratch;
                Ok::<_, Error>(())
            },
            |_, part| {
                let errors = part.errors;
                total.weight += errors.weight;
                total.null.merge(&errors.null);
                total.candidates.iter_mut().zip(&errors.candidates).for_each(|(a, b)| a.merge(b));
                total.deviation.iter_mut().zip(&errors.deviation).for_each(|(a, b)| *a += b);
                for ((weight, scatter), (more, other)) in total.residuals.iter_mut().zip(&errors.residuals) {
                    *weight += more;
                    scatter.iter_mut().zip(other).for_each(|(a, b)| *a += b);
                }
                Ok(())
            },
        )?;
        Ok(total)
    }

    fn empty(&self) -> Errors {
        let q = self.rows.targets;
        let regions = self.orders[self.chosen].full.len();
        Errors {
            weight: 0.0,
            candidates: vec![Sums::new(q); self.orders.len()],
            null: Sums::new(q),
            deviation: vec![0.0; q],
            residuals: vec![(0.0, vec![0.0; q * (q + 1) / 2]); regions],
        }
    }

    fn add(&self, part: &mut Part, assigner: &Assigner<'_>, chunk: &Chunk, tile: &Tile<'_>) {
        let (p, q, n) = (self.rows.regressors, self.rows.targets, tile.len());
        let fold = usize::from(chunk.fold.own);
        let weights = tile.weights();
        let weight = |row: usize| weights.map_or(1.0, |weights| weights[row]);
        // Regressors row by row: a prediction reads one row and one region's coefficients.
        part.rows.resize(n * p, 0.0);
        for j in 0..p {
            for (row, &value) in tile.regressor(j).iter().enumerate() {
                part.rows[row * p + j] = value;
            }
        }
        part.errors.weight += (0..n).map(weight).sum::<f64>();
        let null_mean = self.fold_means.get(fold).map_or(self.mean, Vec::as_slice);
        part.residual.resize(n * q, 0.0);
        for t in 0..q {
            for (row, &value) in tile.target(t).iter().enumerate() {
                part.residual[row * q + t] = value - null_mean[t];
                part.errors.deviation[t] += weight(row) * (value - self.mean[t]).abs();
            }
        }
        accumulate(&mut part.errors.null, &part.residual, q, self.whitening, weight);
        for (candidate, order) in self.orders.iter().enumerate() {
            let partitions = &self.segmentation.candidates[candidate];
            let held_out = order.by_fold.get(fold).filter(|models| !models.is_empty());
            let (partition, models) = match held_out {
                Some(models) => (partitions.by_fold[fold], models),
                None => (partitions.full, &order.full),
            };
            assigner.assign(partition, tile, &mut part.regions);
            residuals(models, &part.regions, tile, &part.rows, &mut part.residual);
            accumulate(&mut part.errors.candidates[candidate], &part.residual, q, self.whitening, weight);
            if candidate == self.chosen {
                assigner.assign(partitions.full, tile, &mut part.regions);
                residuals(&order.full, &part.regions, tile, &part.rows, &mut part.residual);
                for (row, error) in part.residual.chunks_exact(q).enumerate() {
                    let region = (part.regions[row] as usize).min(order.full.len() - 1);
                    let (total, scatter) = &mut part.errors.residuals[region];
                    *total += weight(row);
                    for i in 0..q {
                        for j in 0..=i {
                            scatter[i * (i + 1) / 2 + j] += weight(row) * error[i] * error[j];
                        }
                    }
                }
            }
        }
    }
}

/// Residuals of all rows, row by row.
fn residuals(models: &[RegionModel], regions: &[u32], tile: &Tile<'_>, rows: &[f64], out: &mut [f64]) {
    let q = models.first().map_or(0, |model| model.intercept.len());
    let p = rows.len() / tile.len().max(1);
    for t in 0..q {
        let target = tile.target(t);
        // One contiguous column of coefficients per target and region.
        let columns: Vec<&[f64]> = models
            .iter()
            .map(|model| model.coefficients.col(t).try_as_col_major().map_or(&[][..], |column| column.as_slice()))
            .collect();
        for (row, &region) in regions.iter().enumerate() {
            let region = (region as usize).min(models.len() - 1);
            let x = &rows[row * p..(row + 1) * p];
            let predicted: f64 = models[region].intercept[t] + dot(columns[region], x);
            out[row * q + t] = target[row] - predicted;
        }
    }
}

/// Dot product in eight interleaved sums: a fixed order that vectorises.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 8];
    let (a8, a_rest) = a.as_chunks::<8>();
    let (b8, b_rest) = b.as_chunks::<8>();
    for (a, b) in a8.iter().zip(b8) {
        for i in 0..8 {
            sums[i] += a[i] * b[i];
        }
    }
    let tail: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    sums.iter().sum::<f64>() + tail
}

fn accumulate(sums: &mut Sums, residual: &[f64], q: usize, whitening: &[f64], weight: impl Fn(usize) -> f64) {
    for (row, error) in residual.chunks_exact(q).enumerate() {
        let weight = weight(row);
        let mut square = 0.0;
        for i in 0..q {
            sums.absolute[i] += weight * error[i].abs();
            sums.squared[i] += weight * error[i] * error[i];
            let white: f64 = whitening[i * q..=i * q + i].iter().zip(error).map(|(w, e)| w * e).sum();
            square += white * white;
        }
        sums.mahalanobis += weight * square.sqrt();
    }
}
