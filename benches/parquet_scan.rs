//! Scanning a Parquet file through `Source::read` beside a bare decode of the same columns, with the same threads.
//!
//! The file holds 100 million rows (`FLEETFOOT_BENCH_ROWS`) of 20 columns like those of a robot: slow and fast oscillations that the columns share, and noise,
//! in row groups of a million rows. It is written once into `FLEETFOOT_BENCH_DIR` (else a temporary folder), uncompressed unless `FLEETFOOT_BENCH_ZSTD` is set.
//! Bias: the file is in the page cache where it fits; both sides read it the same way, in alternation, and the faster run of each counts.
//! The limit of both is the memory's speed, and with compression the decompressor's.

use std::{
    error::Error,
    fs::File,
    path::{Path, PathBuf},
    time::Instant,
};

use fleetfoot::{FitRequest, Input, InputTable, Pwa, Recipe, State, fit};
use fleetfoot_benches::peak_rss_mib;
use fleetfoot_data::{Cancelled, Halo, Silent, Source, parallel_fold, thread_count};
use fleetfoot_log::{Selection, open};
use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};
use parquet::arrow::arrow_reader::{ArrowReaderMetadata, ArrowReaderOptions, ParquetRecordBatchReaderBuilder};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const COLUMNS: usize = 20;
const CHUNK: usize = 65_536;
const REPEATS: usize = 3;
/// Oscillations that the columns share.
const SOURCES: usize = 6;

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

fn main() -> Result<()> {
    let rows: usize = std::env::var("FLEETFOOT_BENCH_ROWS")
        .ok()
        .and_then(|rows| rows.replace('_', "").parse().ok())
        .unwrap_or(100_000_000);
    let compress = std::env::var_os("FLEETFOOT_BENCH_ZSTD").is_some();
    let temporary = tempfile::tempdir()?;
    let folder = std::env::var_os("FLEETFOOT_BENCH_DIR").map_or_else(|| temporary.path().to_path_buf(), PathBuf::from);
    let path = folder.join(format!("scan-{rows}{}.parquet", if compress { "-zstd" } else { "" }));
    if !path.exists() {
        let start = Instant::now();
        write(&path, rows, compress)?;
        println!("written {} in {:.1} s", path.display(), start.elapsed().as_secs_f64());
    }
    let size = std::fs::metadata(&path)?.len();
    println!("{rows} rows x {COLUMNS} columns, {:.2} GB, {} threads", size as f64 * 1e-9, thread_count());

    let names: Vec<String> = (0..COLUMNS).map(|c| format!("x{c}")).collect();
    let start = Instant::now();
    let source = open(&[&path], &Selection::new(names))?;
    let opened = start.elapsed().as_secs_f64();
    println!("open (stamps, episodes, identity)  {opened:8.2} s   peak {:6.0} MiB", peak_rss_mib());

    let (fit, ()) = timed(|| full_fit(&path))?;
    let peak = peak_rss_mib();
    println!("full fit, kmeans:10, three passes  {fit:8.2} s   peak {peak:6.0} MiB");
    if peak >= 1024.0 {
        return Err(format!("the fit took {peak:.0} MiB, more than a GiB").into());
    }

    let (mut scan, mut bare) = (f64::INFINITY, f64::INFINITY);
    for repeat in 0..REPEATS {
        let (seconds, sum) = timed(|| scan_source(&source))?;
        scan = scan.min(seconds);
        if repeat == 0 {
            println!("first scan                         {seconds:8.2} s   peak {:6.0} MiB", peak_rss_mib());
        }
        let (seconds, expected) = timed(|| decode_bare(&path))?;
        bare = bare.min(seconds);
        // The sums run over other pieces, so they agree but for rounding.
        if (sum - expected).abs() > 1e-9 * rows as f64 {
            return Err(format!("the scan sums to {sum}, the bare decode to {expected}").into());
        }
    }
    let gigabytes = (8 * rows * (COLUMNS + 1)) as f64 * 1e-9;
    println!("bare decode                        {bare:8.2} s   {:6.2} GB/s", gigabytes / bare);
    println!(
        "Source::read in chunks of {CHUNK}    {scan:8.2} s   {:6.2} GB/s   ratio {:.2}",
        gigabytes / scan,
        scan / bare
    );
    println!("full fit over bare decode                              ratio {:.1}", fit / bare);
    Ok(())
}

/// The main job on the file: 16 states, 4 inputs, derivatives by central differences, ten regions clustered on a sample that fits the memory.
fn full_fit(path: &Path) -> Result<()> {
    let mut recipe = Recipe::default();
    for c in 0..COLUMNS {
        if c < 16 {
            recipe.states.insert(format!("x{c}"), State::default());
        } else {
            recipe.inputs.insert(format!("x{c}"), Input::Table(InputTable::default()));
        }
    }
    recipe.model.partition = Some("kmeans:10".into());
    recipe.pwa.folds = Some(0);
    recipe.pwa.iterations = Some(25);
    let fitted = fit::<Pwa>(&recipe, &FitRequest::default(), &[path.to_path_buf()], &Silent)?;
    let identification = &fitted.report.identification;
    // The oscillations are smooth: their rates follow from the states but for the noise on both.
    let regions: u64 = identification.model.summaries[0].regions.iter().map(|region| region.rows).sum();
    if regions != identification.rows || !identification.candidates[0].r2.iter().all(|r2| *r2 > 0.0 && *r2 <= 1.0) {
        return Err(format!(
            "{regions} of {} rows in regions, R2 {:?}",
            identification.rows, identification.candidates[0].r2
        )
        .into());
    }
    Ok(())
}

fn timed<R>(work: impl FnOnce() -> Result<R>) -> Result<(f64, R)> {
    let start = Instant::now();
    let result = work()?;
    Ok((start.elapsed().as_secs_f64(), result))
}

/// Reads all chunks in order with all threads; the sum of the first column.
fn scan_source(source: &dyn Source) -> Result<f64> {
    let mut chunks = Vec::new();
    for (episode, info) in source.episodes().iter().enumerate() {
        chunks.extend((0..info.rows).step_by(CHUNK).map(|from| (episode, from..(from + CHUNK).min(info.rows))));
    }
    let mut total = 0.0;
    parallel_fold(
        chunks.len(),
        &Silent,
        |i| {
            let (episode, rows) = chunks[i].clone();
            let block = source.read(episode, rows, Halo { before: 2, after: 2 })?;
            Ok::<f64, fleetfoot_data::Error>(block.core(0).iter().sum())
        },
        |sum| {
            total += sum;
            Ok(())
        },
    )?;
    Ok(total)
}

/// Decodes all row groups with all threads; the sum of the first column after the stamps.
fn decode_bare(path: &Path) -> Result<f64> {
    struct Failed(String);
    impl From<Cancelled> for Failed {
        fn from(_: Cancelled) -> Self {
            Self("stopped".into())
        }
    }
    let metadata = ArrowReaderMetadata::load(&File::open(path)?, ArrowReaderOptions::new())?;
    let group_sum = |group: usize| -> Result<f64> {
        let reader = ParquetRecordBatchReaderBuilder::new_with_metadata(File::open(path)?, metadata.clone())
            .with_row_groups(vec![group])
            .with_batch_size(CHUNK)
            .build()?;
        let mut sum = 0.0;
        for batch in reader {
            let batch = batch?;
            let column = batch
                .column(1)
                .as_any()
                .downcast_ref::<arrow_array::Float64Array>()
                .ok_or("not a column of doubles")?;
            sum += column.values().iter().sum::<f64>();
        }
        Ok(sum)
    };
    let mut total = 0.0;
    let groups = metadata.metadata().num_row_groups();
    parallel_fold(
        groups,
        &Silent,
        |group| group_sum(group).map_err(|error| Failed(error.to_string())),
        |sum| {
            total += sum;
            Ok(())
        },
    )
    .map_err(|Failed(reason)| reason)?;
    Ok(total)
}

/// Writes the file, a few thousand rows at a time.
fn write(path: &Path, rows: usize, compress: bool) -> Result<()> {
    let mut columns = vec![WriteColumn::new("t", WriteKind::Stamp)];
    columns.extend((0..COLUMNS).map(|c| WriteColumn::new(format!("x{c}"), WriteKind::Float).with_unit("m/s")));
    let options = WriteOptions { compress, row_group_rows: 1 << 20, ..WriteOptions::default() };
    let mut writer = ParquetWriter::create(path, columns, &options)?;
    let mut random = Pcg64::seed_from_u64(7);
    let mixing: Vec<[f64; SOURCES]> =
        (0..COLUMNS).map(|_| std::array::from_fn(|_| random.random_range(-1.0..1.0))).collect();
    // Rotations by a fixed angle a row: oscillations without a sine a row.
    let turns: [(f64, f64); SOURCES] = std::array::from_fn(|k| (0.002 * 2.3f64.powi(k as i32)).sin_cos());
    let mut phases = [(1.0f64, 0.0f64); SOURCES];
    let mut values = vec![Vec::new(); COLUMNS];
    let mut stamps = Vec::with_capacity(CHUNK);
    let mut row = 0;
    while row < rows {
        let count = CHUNK.min(rows - row);
        values.iter_mut().for_each(Vec::clear);
        stamps.clear();
        for i in 0..count {
            for ((x, y), (sine, cosine)) in phases.iter_mut().zip(turns) {
                (*x, *y) = (*x * cosine - *y * sine, *x * sine + *y * cosine);
            }
            stamps.push((row + i) as i64 * 1_000_000);
            for (column, weights) in values.iter_mut().zip(&mixing) {
                let smooth: f64 = weights.iter().zip(phases).map(|(weight, (x, _))| weight * x).sum();
                column.push(smooth + random.random_range(-0.05..0.05));
            }
        }
        let mut all = vec![Values::Integer(&stamps)];
        all.extend(values.iter().map(|column| Values::Float(column)));
        writer.write(&all)?;
        row += count;
    }
    writer.finish()?;
    Ok(())
}
