//! The clock of a Parquet file: by name, else by the first rows of its columns.

use parquet::errors::ParquetError;

use super::{
    chunk::ChunkDecoder,
    file::{ParquetFile, check_chunks},
    leaf::{Leaf, Meaning, Rule},
};
use crate::{
    Error, TimeSpec, TimeUnit, dates, stamp,
    table::MISSING,
    time_column::{self, Candidate, CandidateKind, Clock},
};

/// Rows looked at.
const SAMPLE: usize = 1000;

/// The clock among all leaves. Values are sampled only where the choice needs them.
pub(super) fn find_clock(file: &ParquetFile, all: &[Leaf], spec: &TimeSpec) -> Option<Clock> {
    time_column::choose(&candidates(file, all), &|column| sample(file, &all[column]), spec)
}

/// The refusal of a file without a clock.
pub(super) fn no_clock(file: &ParquetFile, all: &[Leaf]) -> Error {
    time_column::no_clock(&file.path, &candidates(file, all), &|column| sample(file, &all[column]))
}

fn candidates(file: &ParquetFile, all: &[Leaf]) -> Vec<Candidate> {
    let mut candidates: Vec<Candidate> = all.iter().map(bare_candidate).collect();
    for (candidate, leaf) in candidates.iter_mut().zip(all) {
        // Dates may be texts; a look at the first few tells.
        if leaf.meaning == Meaning::Text && sample_dates(file, leaf) {
            candidate.kind = CandidateKind::Time;
        }
    }
    candidates
}

fn bare_candidate(leaf: &Leaf) -> Candidate {
    let kind = match leaf.meaning {
        Meaning::Float | Meaning::Decimal { .. } => CandidateKind::Float,
        Meaning::Integer { .. } => CandidateKind::Integer,
        Meaning::Time { .. } => CandidateKind::Time,
        _ => CandidateKind::Other,
    };
    Candidate { name: leaf.name.clone(), unit: leaf.unit.clone(), kind }
}

/// The first rows of a leaf; empty when they cannot be read, which the pass over the stamps will tell if it matters.
fn sample(file: &ParquetFile, leaf: &Leaf) -> Vec<f64> {
    let rule = Rule::new(leaf, TimeUnit::Seconds);
    if leaf.meaning == Meaning::Text {
        let mut stamps: Vec<i64> = Vec::new();
        first_rows(file, leaf, |decoder, rows| decoder.read(rows, &rule, &mut stamps));
        return stamps.iter().map(|&stamp| if stamp == MISSING { f64::NAN } else { stamp::seconds(stamp) }).collect();
    }
    let mut values: Vec<f64> = Vec::new();
    first_rows(file, leaf, |decoder, rows| decoder.read(rows, &rule, &mut values));
    values
}

fn sample_dates(file: &ParquetFile, leaf: &Leaf) -> bool {
    let (mut dates, mut others) = (0, 0);
    first_rows(file, leaf, |decoder, rows| {
        decoder.texts(rows.min(8), |text| {
            *if dates::parse_certain(text).is_some() { &mut dates } else { &mut others } += 1
        })
    });
    dates > others
}

fn first_rows(
    file: &ParquetFile,
    leaf: &Leaf,
    work: impl FnOnce(&mut ChunkDecoder, usize) -> Result<(), ParquetError>,
) {
    if file.metadata.num_row_groups() == 0 || check_chunks(file, leaf).is_err() {
        return;
    }
    let rows = SAMPLE.min(file.group_rows(0));
    let Ok(bytes) = file.reopen() else { return };
    if let Ok(mut decoder) = file.decoder(&bytes, leaf.index, 0) {
        // A failure here leaves the sample empty.
        let _ = file.guarded(leaf.index, 0, || work(&mut decoder, rows));
    }
}
