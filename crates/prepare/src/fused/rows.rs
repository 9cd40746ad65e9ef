//! The rows of a data set, log by log.

use std::path::PathBuf;

use fleetfoot_data::{Block, Halo, Source};
use fleetfoot_dataset::{Dataset, Error};
use fleetfoot_signal::dejitter;

/// Rows that are read at a time.
const CHUNK: usize = 65_536;

/// Layout of the kept columns of a data set.
#[derive(Debug, Clone, Copy)]
pub(super) struct Layout {
    /// Rows count in which the first so many columns have values.
    pub(super) needed: usize,
    /// The first columns are so many vectors of three.
    pub(super) vectors: usize,
    /// Columns that follow, and are not kept.
    pub(super) skipped: usize,
}

/// The rows of a log, of whatever episodes, where all that is fused was measured.
pub(super) struct LogRows {
    pub(super) log: PathBuf,
    pub(super) name: String,
    pub(super) labels: std::collections::BTreeMap<String, String>,
    /// The first stamp, ns.
    pub(super) epoch: i64,
    /// Seconds after it.
    pub(super) times: Vec<f64>,
    pub(super) vectors: Vec<Vec<[f64; 3]>>,
    pub(super) columns: Vec<Vec<f64>>,
    /// Rows in which one of the columns that are needed is missing.
    pub(super) missing: usize,
}

impl LogRows {
    /// A data set log by log.
    pub(super) fn all(dataset: &Dataset, layout: Layout) -> Result<Vec<Self>, Error> {
        let view = dataset.view()?;
        let columns = view.columns().len() - 3 * layout.vectors - layout.skipped;
        let mut logs: Vec<Self> = Vec::new();
        for (at, episode) in view.episodes().iter().enumerate() {
            for first in (0..episode.rows).step_by(CHUNK) {
                let block = view.read(at, first..episode.rows.min(first + CHUNK), Halo::default())?;
                let log = dataset.origin(at);
                if logs.last().is_none_or(|last| last.log != log) {
                    // Vectors that grow by doubling hold twice what they are for.
                    let of_log =
                        view.episodes().iter().enumerate().skip(at).take_while(|(at, _)| dataset.origin(*at) == log);
                    let rows = of_log.map(|(_, episode)| episode.rows).sum();
                    let name = episode.name.split_once('#').map_or(episode.name.as_str(), |(file, _)| file).to_owned();
                    logs.push(Self {
                        log: log.to_path_buf(),
                        name,
                        labels: episode.labels.clone(),
                        epoch: block.start,
                        times: Vec::with_capacity(rows),
                        vectors: (0..layout.vectors).map(|_| Vec::with_capacity(rows)).collect(),
                        columns: (0..columns).map(|_| Vec::with_capacity(rows)).collect(),
                        missing: 0,
                    });
                }
                if let Some(last) = logs.last_mut() {
                    last.add(&block, layout);
                }
            }
        }
        Ok(logs)
    }

    /// A log in which a sensor of one channel has no reading.
    pub(super) fn silent(of: &Self) -> Self {
        Self {
            log: of.log.clone(),
            name: of.name.clone(),
            labels: of.labels.clone(),
            epoch: of.epoch,
            times: Vec::new(),
            vectors: Vec::new(),
            columns: vec![Vec::new()],
            missing: 0,
        }
    }

    fn add(&mut self, block: &Block, layout: Layout) {
        let since = (block.start - self.epoch) as f64 * 1e-9;
        let columns: Vec<&[f64]> = (0..block.columns.len()).map(|at| block.column(at)).collect();
        let rest = 3 * layout.vectors + layout.skipped;
        for (row, time) in block.seconds().iter().enumerate() {
            if columns[..layout.needed].iter().any(|column| !column[row].is_finite()) {
                self.missing += 1;
                continue;
            }
            self.times.push(since + time);
            for (vector, parts) in self.vectors.iter_mut().zip(columns.chunks_exact(3)) {
                vector.push([parts[0][row], parts[1][row], parts[2][row]]);
            }
            for (values, column) in self.columns.iter_mut().zip(&columns[rest..]) {
                values.push(column[row]);
            }
        }
    }

    /// Puts the stamps on a line through the sample counts.
    pub(super) fn even_out(&mut self) -> Result<(), Error> {
        if self.times.len() > 2 {
            let error = |source| Error::Signal { episode: self.name.clone(), channel: "the stamps".into(), source };
            self.times = dejitter(&self.times).map_err(error)?.times;
        }
        Ok(())
    }
}
