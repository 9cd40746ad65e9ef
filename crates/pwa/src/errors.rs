//! The third pass, for errors that are not quadratic: absolute errors and Mahalanobis scores. Each row is predicted by
//! the models that did not see its fold (paper, Table I). The pass also sums the residual covariance of the kept models
//! in each region.

use std::collections::BTreeMap;

use fleetfoot_data::{Progress, Source};
use fleetfoot_stats::{
    Basis, Chunk,
    kernel::padded,
    scan::{Place, scan},
};

use crate::{
    Error,
    assignment::Assigner,
    lagged::{Lagged, Whitening},
    phase::Scale,
    region_model::RegionModel,
    residual::{Maps, Scatter, Sums, by_rows},
    rows::{Rows, Tile},
    segmentation::Segmentation,
    select::Order,
    strides::Step,
    walks::{MOST_REGIONS, Walks},
};

/// Sums of errors over the rows.
pub(crate) struct Errors {
    /// Weight of all rows.
    pub(crate) weight: f64,
    /// Held-out sums of each candidate (in-sample where there are no folds).
    pub(crate) candidates: Vec<Sums>,
    /// Held-out sums of the null model.
    pub(crate) null: Sums,
    /// Weighted sum of |y - mean over all rows|.
    pub(crate) deviation: Vec<f64>,
    /// Scatter of the residuals of each kept model in each of its regions, if no statistic has it.
    pub(crate) residuals: Vec<Option<Scatter>>,
    /// Transitions between regions, of each kept model whose regions fit the dynamics.
    pub(crate) walks: Vec<Option<Walks>>,
    /// Correlation of residuals from row to row, of each kept model for which it is requested.
    pub(crate) lagged: Vec<Option<Lagged>>,
    /// Sums of absolute errors by (episode, fold), in the order of the chunks.
    parts: Vec<((usize, u16), PartErrors)>,
}

/// Sums of absolute errors of a part of the rows, each for all targets (padded).
#[derive(Clone)]
pub(crate) struct PartErrors {
    /// Of the null model.
    pub(crate) null: Vec<f64>,
    /// Of each candidate.
    pub(crate) candidates: Vec<Vec<f64>>,
}

impl PartErrors {
    fn merge(&mut self, other: &Self) {
        let add = |a: &mut Vec<f64>, b: &Vec<f64>| a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
        add(&mut self.null, &other.null);
        self.candidates.iter_mut().zip(&other.candidates).for_each(|(a, b)| add(a, b));
    }
}

impl Errors {
    /// Adds the absolute errors of a chunk to those of its episode and fold: the chunks of one follow each other.
    fn add_part(&mut self, key: (usize, u16), chunk: &Errors) {
        if chunk.weight <= 0.0 {
            return;
        }
        let part = PartErrors {
            null: chunk.null.absolute.clone(),
            candidates: chunk.candidates.iter().map(|sums| sums.absolute.clone()).collect(),
        };
        match self.parts.last_mut() {
            Some((last, known)) if *last == key => known.merge(&part),
            _ => self.parts.push((key, part)),
        }
    }

    /// Parts that intervals compare: whole episodes if no fold cuts them, else the folds.
    pub(crate) fn compared(&self, whole: bool) -> (Basis, Vec<PartErrors>) {
        let mut merged: BTreeMap<usize, PartErrors> = BTreeMap::new();
        let mut order = Vec::new();
        for ((episode, fold), part) in &self.parts {
            let key = if whole { *episode } else { usize::from(*fold) };
            match merged.get_mut(&key) {
                Some(known) => known.merge(part),
                None => {
                    order.push(key);
                    merged.insert(key, part.clone());
                }
            }
        }
        let parts: Vec<PartErrors> = order.iter().filter_map(|key| merged.remove(key)).collect();
        (if whole { Basis::Episodes(parts.len()) } else { Basis::Folds(parts.len()) }, parts)
    }
}

struct Part {
    errors: Errors,
    regions: Vec<u32>,
    x: Vec<f64>,
    y: Vec<f64>,
    residual: Vec<f64>,
}

/// The models of one candidate, laid out for rows.
struct Prepared {
    full: Maps,
    /// Empty folds have none.
    by_fold: Vec<Option<Maps>>,
}

/// Inputs of the pass over the errors.
pub(crate) struct Measure<'a> {
    pub(crate) rows: &'a Rows,
    pub(crate) segmentation: &'a Segmentation,
    pub(crate) orders: &'a [Order],
    /// Indices of the candidates whose models are kept.
    pub(crate) kept: &'a [usize],
    /// True for each kept model whose residual scatter needs the rows.
    pub(crate) scattered: &'a [bool],
    /// Mean of the targets over all rows, and over the training rows of each fold.
    pub(crate) mean: &'a [f64],
    pub(crate) fold_means: &'a [Vec<f64>],
    /// That of the covariance of the targets ([`fleetfoot_stats::Mahalanobis::whitening`]).
    pub(crate) whitening: &'a [f64],
    /// Bins of the phase's values, if there is a phase.
    pub(crate) phase: Option<&'a Scale>,
    /// Whitening of the residuals of each kept model, if their correlation from row to row is requested.
    pub(crate) whitening_by_region: &'a [Option<Whitening>],
}

impl Measure<'_> {
    pub(crate) fn run(&self, source: &dyn Source, chunks: &[Chunk], progress: &dyn Progress) -> Result<Errors, Error> {
        let assigner = Assigner::new(self.segmentation);
        let prepared: Vec<Prepared> = self.orders.iter().map(|order| self.prepare(order)).collect();
        let mut total = self.empty();
        scan(
            &self.rows.columns,
            source,
            chunks,
            progress,
            || Part { errors: self.empty(), regions: Vec::new(), x: Vec::new(), y: Vec::new(), residual: Vec::new() },
            |part, place, tile| {
                self.add(part, &assigner, &prepared, place, &Tile::new(tile));
                Ok::<_, Error>(())
            },
            |chunk, _, part| {
                let errors = part.errors;
                total.add_part((chunk.episode, chunk.fold.held_out), &errors);
                total.weight += errors.weight;
                total.null.merge(&errors.null);
                total.candidates.iter_mut().zip(&errors.candidates).for_each(|(a, b)| a.merge(b));
                total.deviation.iter_mut().zip(&errors.deviation).for_each(|(a, b)| *a += b);
                for (total, scatter) in total.residuals.iter_mut().zip(&errors.residuals) {
                    if let (Some(total), Some(scatter)) = (total, scatter) {
                        total.merge(scatter);
                    }
                }
                for (total, walks) in total.walks.iter_mut().zip(&errors.walks) {
                    if let (Some(total), Some(walks)) = (total, walks) {
                        total.merge(walks, self.phase);
                    }
                }
                for (total, lagged) in total.lagged.iter_mut().zip(&errors.lagged) {
                    if let (Some(total), Some(lagged)) = (total, lagged) {
                        total.merge(lagged);
                    }
                }
                Ok(())
            },
        )?;
        Ok(total)
    }

    fn empty(&self) -> Errors {
        let q = self.rows.targets;
        let scatter = |kept: usize, is_kept: bool| is_kept.then(|| Scatter::new(self.orders[kept].full.len(), q));
        Errors {
            weight: 0.0,
            candidates: vec![Sums::new(q); self.orders.len()],
            null: Sums::new(q),
            deviation: vec![0.0; q],
            residuals: self.kept.iter().zip(self.scattered).map(|(&kept, &is_kept)| scatter(kept, is_kept)).collect(),
            walks: self.kept.iter().map(|&kept| self.walks(kept)).collect(),
            lagged: self
                .whitening_by_region
                .iter()
                .map(|whitening| whitening.as_ref().map(|_| Lagged::new(q)))
                .collect(),
            parts: Vec::new(),
        }
    }

    /// Room for the transitions of a candidate, where they are wanted: other partitions may have regions whose pairs fill the memory.
    fn walks(&self, candidate: usize) -> Option<Walks> {
        let regions = self.orders[candidate].full.len();
        let fits = self.segmentation.candidates[candidate].specification.fits_targets();
        (fits || self.phase.is_some() && regions <= MOST_REGIONS).then(|| Walks::new(regions, self.phase))
    }

    fn prepare(&self, order: &Order) -> Prepared {
        let maps = |models: &[RegionModel]| Maps::new(models, self.rows.regressors, self.rows.targets);
        let by_fold = order.by_fold.iter().map(|models| (!models.is_empty()).then(|| maps(models))).collect();
        Prepared { full: maps(&order.full), by_fold }
    }

    fn add(&self, part: &mut Part, assigner: &Assigner<'_>, prepared: &[Prepared], place: Place<'_>, tile: &Tile<'_>) {
        let (q, n, width) = (self.rows.targets, tile.len(), padded(self.rows.targets));
        let fold = usize::from(place.chunk.fold.held_out);
        let weights = tile.weights();
        let weight = |row: usize| weights.map_or(1.0, |weights| weights[row]);
        let (regressors, targets) = (tile.regressors(), tile.targets());
        by_rows(&regressors, regressors.len(), &mut part.x);
        by_rows(&targets, width, &mut part.y);
        part.errors.weight += (0..n).map(weight).sum::<f64>();
        part.residual.resize(n * width, 0.0);
        let null_mean = self.fold_means.get(fold).map_or(self.mean, Vec::as_slice);
        for (y, residual) in part.y.chunks_exact(width).zip(part.residual.chunks_exact_mut(width)) {
            for (t, &mean) in null_mean.iter().enumerate() {
                residual[t] = y[t] - mean;
            }
            residual[q..].fill(0.0);
        }
        for ((total, target), &mean) in part.errors.deviation.iter_mut().zip(&targets).zip(self.mean) {
            *total += target.iter().enumerate().map(|(row, value)| weight(row) * (value - mean).abs()).sum::<f64>();
        }
        part.errors.null.add(&part.residual, self.whitening, weights);
        let assignment = assigner.on(tile);
        for (candidate, maps) in prepared.iter().enumerate() {
            let partitions = &self.segmentation.candidates[candidate];
            let (partition, maps_used) = match maps.by_fold.get(fold) {
                Some(Some(held_out)) => (partitions.by_fold[fold], held_out),
                _ => (partitions.full, &maps.full),
            };
            assignment.assign(partition, &mut part.regions);
            maps_used.residuals(&part.regions, &part.x, &part.y, &mut part.residual);
            part.errors.candidates[candidate].add(&part.residual, self.whitening, weights);
            let Some(kept) = self.kept.iter().position(|&kept| kept == candidate) else { continue };
            let of_rows = part.errors.residuals[kept].is_some() || part.errors.lagged[kept].is_some();
            if of_rows || part.errors.walks[kept].is_some() {
                if !std::ptr::eq(maps_used, &maps.full) {
                    assignment.assign(partitions.full, &mut part.regions);
                    maps.full.residuals(&part.regions, &part.x, &part.y, &mut part.residual);
                }
                if let Some(scatter) = &mut part.errors.residuals[kept] {
                    scatter.add(&part.regions, &part.residual, weights);
                }
                if let (Some(lagged), Some(whitening)) =
                    (&mut part.errors.lagged[kept], &self.whitening_by_region[kept])
                {
                    let rows = tile.index().iter().map(|row| place.first + row);
                    lagged.extend(whitening, place.chunk.episode, rows, (&part.regions, &part.residual, weights));
                }
                if let Some(walks) = &mut part.errors.walks[kept] {
                    let rows = tile.index().iter().map(|row| place.first + row);
                    walks.extend(place.chunk.episode, rows.clone().zip(part.regions.iter().copied()));
                    if let (Some(scale), Some(phases)) = (self.phase, tile.phase()) {
                        let steps = rows.zip(&part.regions).zip(phases);
                        let steps = steps.map(|((row, &region), &phase)| Step { row, region, phase });
                        walks.along(scale, place.chunk.episode, steps);
                    }
                }
            }
        }
    }
}
