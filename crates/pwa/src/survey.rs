//! The first pass: moments of the partition columns for every fold, the labels, the rows for k-means, and those on
//! which regions are refined.
//!
//! While the partition columns of all rows fit the memory budget, all are kept and the clustering is exact; beyond it a sample is ([`Kept`]).

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Range,
};

use fleetfoot_data::{Episode, EpisodeId, Progress, Source};
use fleetfoot_stats::{
    Chunk, Concentration, Fold, Gram, Key, Moments, Stats,
    scan::{Place, RowCounts, scan},
};

use crate::{
    Error, Options, Specification,
    cuts::{Cuts, rows_of},
    kept::{Kept, Share},
    labels::limit_labels,
    phase::Seen,
    rows::{Rows, Tile},
};

/// The share of the rows that counts as few. Chunks of short logs are a larger one, and the first tenth of a decay
/// holds most of its variance.
const FEW: f64 = 0.02;

/// Rows that regions are refined on, at most. They determine separators and maps far better than needed, and all rows
/// fit the maps in the end.
const EXAMPLES: usize = 1 << 16;

/// Bytes of a row that regions are refined on: as read, and as it is worked on.
pub(crate) fn example_bytes(partition_columns: usize, dimension: usize) -> usize {
    16 * (partition_columns + 1) + 32 * dimension
}

/// Rows that regions are refined on, of so many.
pub(crate) fn examples(rows: usize, bytes: usize, memory: usize) -> usize {
    rows.min(EXAMPLES).min(memory / bytes.max(1))
}

/// Bytes of a row that is kept for k-means: it is held twice for a while, as read and standardised for one fold.
pub(crate) fn kept_bytes(partition_columns: usize, labels: usize) -> usize {
    16 * (partition_columns + labels)
}

/// Result of the first pass.
pub(crate) struct Survey {
    /// Moments of the partition columns over all rows, whatever the folds.
    all: Option<Moments>,
    /// The same by place in cross-validation.
    moments: BTreeMap<Fold, Moments>,
    /// Different values of each label column, ascending.
    pub(crate) labels: Vec<Vec<f64>>,
    /// The rows that k-means will cluster: partition columns, then labels.
    pub(crate) kept: Kept,
    /// The rows for the refinement of regions, for cells and for borders ([`Tile::example`]).
    pub(crate) examples: Kept,
    /// True if more memory would give more of them.
    pub(crate) examples_lack_memory: bool,
    /// The values of the phase, where there is one.
    pub(crate) phase: Option<Seen>,
    /// Moments of targets, then states, over all rows.
    pub(crate) scales: Gram,
    /// The targets' own by chunk.
    targets: Stats,
    /// Counts of the rows: complete, at borders, incomplete.
    pub(crate) counts: RowCounts,
}

struct Part {
    moments: Option<Moments>,
    labels: Vec<BTreeSet<u64>>,
    phase: Option<Seen>,
    pieces: Vec<Piece>,
}

/// The rows of a part that lie in one chunk of the folds.
struct Piece {
    /// The place of that chunk.
    chunk: usize,
    moments: Moments,
    scales: Gram,
    kept: Vec<Vec<f64>>,
    examples: Vec<Vec<f64>>,
}

impl Survey {
    /// Reads all rows once, in chunks that do not know of folds.
    pub(crate) fn scan(
        rows: &Rows,
        source: &dyn Source,
        (chunks, cuts): (&[Chunk], &Cuts<'_>),
        options: &Options,
        progress: &dyn Progress,
    ) -> Result<Self, Error> {
        let shares = Shares::new(rows, source.rows(), options);
        let mut survey = Self {
            all: None,
            moments: BTreeMap::new(),
            labels: Vec::new(),
            phase: options.phase.as_ref().map(Seen::new),
            kept: Kept::new(rows.partition + rows.labels.len()),
            examples: Kept::new(rows.example_columns()),
            examples_lack_memory: shares.short,
            scales: Gram::new(rows.targets + rows.states),
            targets: Stats::new(""),
            counts: RowCounts::default(),
        };
        let mut labels = vec![BTreeSet::new(); rows.labels.len()];
        scan(
            &rows.columns,
            source,
            chunks,
            progress,
            || Part::new(rows, options),
            |part, place, tile| {
                let tile = Tile::new(tile);
                part.add(rows, &tile, place, &shares, cuts);
                if let (Some(seen), Some(phase), Some(values)) = (&mut part.phase, &options.phase, tile.phase()) {
                    seen.add(values, phase)?;
                }
                part.labels.iter().zip(&rows.labels).try_for_each(|(seen, column)| limit_labels(column, seen))
            },
            |chunk, counts, part| {
                survey.counts.add(counts);
                for ((column, all), seen) in rows.labels.iter().zip(&mut labels).zip(part.labels) {
                    all.extend(seen);
                    limit_labels(column, all)?;
                }
                if let (Some(all), Some(seen), Some(phase)) = (&mut survey.phase, part.phase, &options.phase) {
                    all.merge(seen, phase)?;
                }
                if let Some(moments) = part.moments {
                    survey.all.get_or_insert_with(|| Moments::new(rows.partition)).merge(&moments);
                }
                let (episode, targets) = (source.episodes()[chunk.episode].id, (0..rows.targets).collect::<Vec<_>>());
                for Piece { chunk, moments, scales, kept, examples } in part.pieces {
                    let Chunk { index: chunk, fold, .. } = cuts.chunks[chunk];
                    survey.scales.merge(&scales);
                    survey.targets.add(Key { episode, chunk, fold, partition: 0, region: 0 }, scales.select(&targets));
                    survey.moments.entry(fold).or_insert_with(|| Moments::new(rows.partition)).merge(&moments);
                    survey.kept.append(fold, kept);
                    survey.examples.append(fold, examples);
                }
                Ok::<_, Error>(())
            },
        )?;
        survey.labels = labels
            .into_iter()
            .map(|values| {
                let mut values: Vec<f64> = values.into_iter().map(f64::from_bits).collect();
                values.sort_by(f64::total_cmp);
                values
            })
            .collect();
        Ok(survey)
    }

    /// For every target the few rows that hold most of its variance, where they do.
    pub(crate) fn concentrated(&self, episodes: &[Episode], chunks: &[Chunk]) -> Vec<Option<Concentration>> {
        let rows: BTreeMap<(EpisodeId, u64), &Range<usize>> =
            chunks.iter().map(|chunk| ((episodes[chunk.episode].id, chunk.index.into()), &chunk.rows)).collect();
        // Counted in chunks, which folds cut to several lengths.
        let in_rows = |mut concentration: Concentration| {
            let (episode, stretch) = &concentration.place;
            let (first, last) = (rows.get(&(*episode, stretch.start))?, rows.get(&(*episode, stretch.end - 1))?);
            concentration.place.1 = first.start as u64..last.end as u64;
            (concentration.rows <= FEW).then_some(concentration)
        };
        let targets = self.targets.iter().next().map_or(0, |(_, gram)| gram.dimension());
        (0..targets).map(|target| Concentration::of(&self.targets, target, 1).and_then(in_rows)).collect()
    }

    /// Moments of the rows that train the model tested on `held` (all rows without it).
    pub(crate) fn training_moments(&self, held: Option<u16>) -> Option<Moments> {
        let Some(held) = held else { return self.all.clone() };
        let mut selected = self.moments.iter().filter(|(fold, _)| fold.trains(held)).map(|(_, moments)| moments);
        let mut total = selected.next()?.clone();
        selected.for_each(|moments| total.merge(moments));
        Some(total)
    }
}

/// Shares of the rows that are kept, by use.
struct Shares {
    kept: Share,
    examples: Share,
    /// True if the memory limits the examples.
    short: bool,
}

impl Shares {
    fn new(rows: &Rows, count: usize, options: &Options) -> Self {
        let memory = options.memory;
        let any = |wanted: fn(&Specification) -> bool| options.partitions.iter().any(wanted);
        let bytes = kept_bytes(rows.partition, rows.labels.len());
        let kept =
            if any(Specification::is_clustered) { memory as f64 / (count.max(1) * bytes.max(1)) as f64 } else { 0.0 };
        let few = examples(count, example_bytes(rows.partition + rows.labels.len(), rows.dimension()), memory);
        let short = few < examples(count, 0, memory);
        let share =
            if any(Specification::fits_targets) || options.continuous { few as f64 / count.max(1) as f64 } else { 0.0 };
        Self { kept: Share::new(kept), examples: Share::new(share), short }
    }
}

impl Part {
    fn new(rows: &Rows, options: &Options) -> Self {
        Self {
            moments: None,
            labels: vec![BTreeSet::new(); rows.labels.len()],
            phase: options.phase.as_ref().map(Seen::new),
            pieces: Vec::new(),
        }
    }

    fn add(&mut self, rows: &Rows, tile: &Tile<'_>, place: Place<'_>, shares: &Shares, cuts: &Cuts<'_>) {
        let columns = tile.partition_columns();
        self.moments.get_or_insert_with(|| Moments::new(rows.partition)).merge(&Moments::of_columns(&columns));
        let labels = tile.labels();
        for (label, seen) in labels.iter().zip(&mut self.labels) {
            let mut last = None;
            for &value in *label {
                if last != Some(value) {
                    seen.insert((value + 0.0).to_bits());
                    last = Some(value);
                }
            }
        }
        let (scales, weights, example) = (tile.scales(), tile.weights(), tile.example());
        let kept: Vec<&[f64]> = columns.iter().copied().chain(labels).collect();
        for (chunk, range) in cuts.pieces(place.chunk, place.first, tile.index()) {
            let piece = match self.pieces.iter().position(|piece| piece.chunk == chunk) {
                Some(known) => &mut self.pieces[known],
                None => {
                    self.pieces.push(Piece::new(rows, chunk));
                    let last = self.pieces.len() - 1;
                    &mut self.pieces[last]
                }
            };
            let of = |columns| rows_of(columns, &range);
            piece.scales.merge(&Gram::of_columns(&of(&scales), weights.map(|weights| &weights[range.clone()])));
            piece.moments.merge(&Moments::of_columns(&of(&columns)));
            let place = (place.episode, place.first, &tile.index()[range.clone()]);
            shares.kept.keep(&mut piece.kept, &of(&kept), place);
            shares.examples.keep(&mut piece.examples, &of(&example), place);
        }
    }
}

impl Piece {
    fn new(rows: &Rows, chunk: usize) -> Self {
        Self {
            chunk,
            moments: Moments::new(rows.partition),
            scales: Gram::new(rows.targets + rows.states),
            kept: vec![Vec::new(); rows.partition + rows.labels.len()],
            examples: vec![Vec::new(); rows.example_columns()],
        }
    }
}
