//! A robot's log, decoded: beside the Python package, and beside plain decompression of its chunks.
//!
//! The log holds 300,000 Imu messages (`FLEETFOOT_BENCH_MESSAGES`; 10 million are 3.5 GB of records) at 1 kHz in zstd
//! chunks. [`McapWriter`] writes it once into `FLEETFOOT_BENCH_DIR` (else a temporary folder), and beside it a log
//! three times as long. `FLEETFOOT_BENCH_FILE` names a ready log instead. The numbers lie on the grid of a 16-bit
//! converter with noise in the low bits, so that the log compresses as a recorded one does. Constants would decompress
//! at the speed of the memory, and hide the decoder.
//!
//! Bias: the files are in the page cache if they fit. All sides read the same bytes in alternation, and the fastest run
//! of each counts. No reader can be faster than the decompressor: its time is the limit of everything else in the
//! table. The Python package is timed from the file to objects, ours from the file to all 37 numbers and three stamps
//! in a buffer of the caller. The values must be equal bit by bit. Memory is measured in a separate process for each
//! file. The resident part of a mapped file belongs to the page cache, which the system takes back at will. It is
//! counted apart from the memory that the process requested.

use std::{
    cell::RefCell,
    error::Error,
    fs::File,
    ops::Range,
    path::{Path, PathBuf},
    process::Command,
    sync::atomic::{AtomicBool, AtomicU64, Ordering},
    time::{Duration, Instant},
};

use fleetfoot_benches::{peak_rss_mib, peer, read_f64};
use fleetfoot_data::{Cancelled, Halo, Silent, Source, parallel_fold, parallel_map, thread_count, with_threads};
use fleetfoot_log::{Messages, Selection, inspect, open};
use fleetfoot_message::write::{Header, Imu, Time};
use fleetfoot_output::{McapOptions, McapWriter};
use mcap::{
    Summary, parse_record,
    records::{ChunkHeader, Record, op},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const TOPIC: &str = "/imu";
/// Nanoseconds.
const START: i64 = 1_760_000_000_000_000_000;
const PERIOD: i64 = 1_000_000;
/// Steps of a converter with 16 bits for +-2000 degrees a second, and for +-16 g.
const RATE_STEP: f64 = 4000.0 / 65_536.0 * std::f64::consts::PI / 180.0;
const ACCELERATION_STEP: f64 = 32.0 * 9.80665 / 65_536.0;
/// Messages that the peer decodes at most: its rate does not depend on how many there are.
const PEER_MESSAGES: usize = 20_000;
const CHUNK: usize = 65_536;

type Result<T> = std::result::Result<T, Box<dyn Error + Send + Sync>>;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    if let [_, job, path] = &arguments[..]
        && job == "memory"
    {
        return memory_job(Path::new(path));
    }
    let messages: usize = std::env::var("FLEETFOOT_BENCH_MESSAGES")
        .ok()
        .and_then(|messages| messages.replace('_', "").parse().ok())
        .unwrap_or(300_000);
    let temporary = tempfile::tempdir()?;
    let folder = std::env::var_os("FLEETFOOT_BENCH_DIR").map_or_else(|| temporary.path().to_path_buf(), PathBuf::from);
    let file = std::env::var_os("FLEETFOOT_BENCH_FILE").map(PathBuf::from);
    let path = match &file {
        Some(path) => path.clone(),
        None => written(&folder, messages)?,
    };
    let log = Log::open(path)?;
    println!(
        "{} messages, {:.3} GB of records in {:.3} GB, {} chunks; {} threads",
        log.messages,
        log.gigabytes(),
        std::fs::metadata(&log.path)?.len() as f64 * 1e-9,
        log.chunks.len(),
        thread_count()
    );
    let repeats = if log.messages > 2_000_000 { 2 } else { 5 };
    time_inspect(&log, repeats)?;
    against_peer(&log, temporary.path(), repeats)?;
    let mut counts = vec![1, thread_count()];
    counts.dedup();
    for threads in counts {
        against_decompression(&log, threads, repeats)?;
    }
    tell_memory(&log.path)?;
    if file.is_none() {
        tell_memory(&written(&folder, 3 * messages)?)?;
    }
    Ok(())
}

/// The 37 numbers of an Imu message, in the order of its definition.
fn fields() -> Vec<String> {
    let mut fields = Vec::new();
    for (name, parts) in [("orientation", "xyzw"), ("angular_velocity", "xyz"), ("linear_acceleration", "xyz")] {
        fields.extend(parts.chars().map(|part| format!("{name}.{part}")));
        fields.extend((0..9).map(|place| format!("{name}_covariance[{place}]")));
    }
    fields
}

/// The six numbers that a fit wants of it.
fn rates_and_accelerations() -> Vec<String> {
    fields().into_iter().filter(|field| field.starts_with(['a', 'l']) && field.contains('.')).collect()
}

/// A log with the places of its chunks, which whoever decompresses plainly is given for nothing.
struct Log {
    path: PathBuf,
    bytes: memmap2::Mmap,
    chunks: Vec<(ChunkHeader, Range<usize>)>,
    messages: u64,
}

impl Log {
    fn open(path: PathBuf) -> Result<Self> {
        let file = File::open(&path)?;
        // SAFETY: nobody writes to the file while the bench runs.
        let bytes = unsafe { memmap2::Mmap::map(&file) }?;
        let summary = Summary::read(&bytes)?.ok_or("a log without a summary")?;
        let mut chunks = Vec::new();
        for index in &summary.chunk_indexes {
            // Behind the opcode and the length of the record.
            let start = usize::try_from(index.chunk_start_offset)? + 9;
            let end = usize::try_from(index.chunk_start_offset + index.chunk_length)?;
            let Record::Chunk { header, data } = parse_record(op::CHUNK, &bytes[start..end])? else {
                return Err("an index that points to no chunk".into());
            };
            chunks.push((header, end - data.len()..end));
        }
        let messages = summary.stats.map_or(0, |statistics| statistics.message_count);
        Ok(Self { path, bytes, chunks, messages })
    }

    /// Of the records when they are not compressed.
    fn gigabytes(&self) -> f64 {
        self.chunks.iter().map(|(header, _)| header.uncompressed_size as f64).sum::<f64>() * 1e-9
    }

    /// Decompresses all chunks, each thread with one context into one buffer: the lower bound of reading the log.
    fn decompress(&self) -> Result<u64> {
        struct Scratch {
            context: zstd::bulk::Decompressor<'static>,
            bytes: Vec<u8>,
        }
        thread_local! {
            static SCRATCH: RefCell<Option<Scratch>> = const { RefCell::new(None) };
        }
        let lengths = parallel_map(self.chunks.len(), &Silent, |i| {
            let (header, place) = &self.chunks[i];
            let data = &self.bytes[place.clone()];
            if header.compression.is_empty() {
                // To look at it once is the least.
                std::hint::black_box(data.iter().fold(0_u8, |all, &byte| all ^ byte));
                return Ok::<_, Failed>(data.len() as u64);
            }
            SCRATCH.with_borrow_mut(|scratch| {
                let new = || Ok(Scratch { context: zstd::bulk::Decompressor::new()?, bytes: Vec::new() });
                let scratch = match scratch {
                    Some(scratch) => scratch,
                    none => none.insert(new().map_err(|error: std::io::Error| Failed(error.to_string()))?),
                };
                scratch.bytes.clear();
                scratch.bytes.reserve(header.uncompressed_size as usize);
                let length = scratch.context.decompress_to_buffer(data, &mut scratch.bytes);
                Ok(length.map_err(|error| Failed(error.to_string()))? as u64)
            })
        });
        Ok(lengths.map_err(|Failed(reason)| reason)?.iter().sum())
    }
}

/// Failure of a piece of parallel work.
struct Failed(String);

impl From<Cancelled> for Failed {
    fn from(_: Cancelled) -> Self {
        Self("stopped".into())
    }
}

/// The summary alone, as `fleetfoot info` reads it.
fn time_inspect(log: &Log, repeats: usize) -> Result<()> {
    let mut best = f64::INFINITY;
    for _ in 0..repeats {
        let start = Instant::now();
        let info = inspect(&log.path)?;
        best = best.min(start.elapsed().as_secs_f64());
        let counted = info.topics.iter().find(|topic| topic.name == TOPIC).and_then(|topic| topic.messages);
        if counted != Some(log.messages) {
            return Err(format!("inspect counts {counted:?} messages of {}", log.messages).into());
        }
    }
    println!("inspect                                    {:9.2} ms", 1e3 * best);
    Ok(())
}

/// All numbers of all messages by one thread, and by the Python package.
fn against_peer(log: &Log, folder: &Path, repeats: usize) -> Result<()> {
    let fields = fields();
    let names: Vec<&str> = fields.iter().map(String::as_str).collect();
    let reader = Messages::open(&log.path)?;
    let (mut best, mut rows) = (f64::INFINITY, Vec::new());
    for _ in 0..repeats {
        rows.clear();
        let (mut seen, mut sum) = (0_usize, 0.0);
        let start = Instant::now();
        let failed = with_threads(1, || {
            reader.read(TOPIC, &names, &Silent, |row| {
                if seen < PEER_MESSAGES {
                    rows.push((row.header_stamp, row.log_time, row.publish_time));
                }
                sum += row.values[15];
                seen += 1;
                Ok(())
            })
        })?;
        best = best.min(start.elapsed().as_secs_f64());
        if failed > 0 || seen as u64 != log.messages || !sum.is_finite() {
            return Err(format!("{seen} of {} messages read, {failed} failed, sum {sum}", log.messages).into());
        }
    }
    let rate = log.messages as f64 / best;
    println!("all 37 numbers, one thread                 {best:9.3} s  {:9.3} million messages/s", 1e-6 * rate);
    let out = folder.join("peer.f64");
    let count = PEER_MESSAGES.to_string();
    match peer("imu_messages.py", &[&log.path, Path::new(&count), &out]) {
        Err(reason) => println!("  mcap-ros2-support                        absent: {reason}"),
        Ok(answer) => {
            let number = |key: &str| answer[key].as_f64().unwrap_or(f64::NAN);
            let theirs = number("messages") / number("seconds");
            let compared =
                compare(&reader, &names, &read_f64(&out)?, answer["first"].as_i64().ok_or("no first time")?)?;
            println!(
                "  mcap-ros2-support {:14}         {:9.3} s  {:9.3} million messages/s   ratio {:.0}   {compared} messages equal",
                answer["version"].as_str().unwrap_or("?"),
                number("seconds"),
                1e-6 * theirs,
                rate / theirs
            );
            if rate < 20.0 * theirs {
                return Err("less than 20 times the Python package".into());
            }
        }
    }
    Ok(())
}

/// Holds the values of the first messages against the peer's, bit by bit; how many there were.
fn compare(reader: &Messages, names: &[&str], theirs: &[f64], first: i64) -> Result<usize> {
    let width = 3 + names.len();
    let mut expected = theirs.chunks_exact(width);
    let (mut compared, mut differing) = (0, 0);
    reader.read(TOPIC, names, &Silent, |row| {
        let Some(theirs) = expected.next() else { return Ok(()) };
        let stamps = [row.header_stamp.unwrap_or(i64::MIN), row.log_time, row.publish_time];
        let same_stamps = stamps.iter().zip(theirs).all(|(stamp, theirs)| stamp.wrapping_sub(first) as f64 == *theirs);
        let same = row.values.iter().zip(&theirs[3..]).all(|(value, theirs)| value.to_bits() == theirs.to_bits());
        compared += 1;
        differing += usize::from(!(same && same_stamps));
        Ok(())
    })?;
    if compared == 0 || compared * width != theirs.len() || differing > 0 {
        return Err(
            format!("{differing} of {compared} messages differ from the peer's {}", theirs.len() / width).into()
        );
    }
    Ok(compared)
}

/// A way through a log; returns its count.
type Way<'a> = &'a (dyn Fn() -> Result<u64> + Sync);

/// Every way to the rows beside plain decompression, in alternation.
fn against_decompression(log: &Log, threads: usize, repeats: usize) -> Result<()> {
    let all = fields();
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    let six = rates_and_accelerations();
    let six: Vec<&str> = six.iter().map(String::as_str).collect();
    let reader = Messages::open(&log.path)?;
    let read = |names: &[&str]| {
        let mut seen = 0_u64;
        reader.read(TOPIC, names, &Silent, |_| {
            seen += 1;
            Ok(())
        })?;
        Ok::<u64, Box<dyn Error + Send + Sync>>(seen)
    };
    let ways: [(&str, Way<'_>, u64); 5] = [
        (
            "plain decompression",
            &|| log.decompress(),
            log.chunks.iter().map(|(header, _)| header.uncompressed_size).sum(),
        ),
        ("Messages::read, 6 numbers", &|| read(&six), log.messages),
        ("Messages::read, 37 numbers", &|| read(&all), log.messages),
        ("open, 6 columns", &|| opened_rows(&log.path, &six), log.messages),
        ("open, 37 columns", &|| opened_rows(&log.path, &all), log.messages),
    ];
    let mut best = [f64::INFINITY; 5];
    for _ in 0..repeats {
        for ((name, work, expected), best) in ways.iter().zip(&mut best) {
            let start = Instant::now();
            let counts = with_threads(threads, work)?;
            *best = best.min(start.elapsed().as_secs_f64());
            if counts != *expected {
                return Err(format!("{name}: {counts} where {expected} are in the file").into());
            }
        }
    }
    for ((name, ..), seconds) in ways.iter().zip(best) {
        println!(
            "{name:30} {threads} threads   {seconds:9.3} s  {:9.2} GB/s   ratio {:5.2}",
            log.gigabytes() / seconds,
            seconds / best[0]
        );
    }
    Ok(())
}

fn selection(names: &[&str]) -> Selection {
    Selection::new(names.iter().map(|name| format!("{TOPIC}.{name}")))
}

fn opened_rows(path: &Path, names: &[&str]) -> Result<u64> {
    let recording = open(&[path], &selection(names))?;
    Ok(recording.episodes().iter().map(|episode| episode.rows as u64).sum())
}

/// Opens a log and passes over its rows once; prints the memory that it took.
fn tell_memory(path: &Path) -> Result<()> {
    let output = Command::new(std::env::current_exe()?).arg("memory").arg(path).output()?;
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned().into());
    }
    print!("{}", String::from_utf8_lossy(&output.stdout));
    Ok(())
}

/// Job that [`tell_memory`] runs in a separate process.
fn memory_job(path: &Path) -> Result<()> {
    let six = rates_and_accelerations();
    let six: Vec<&str> = six.iter().map(String::as_str).collect();
    let (done, peak) = (AtomicBool::new(false), AtomicU64::new(0));
    let before = anonymous_kib();
    let (opened, passed, rows) = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                peak.fetch_max(anonymous_kib(), Ordering::Relaxed);
                std::thread::sleep(Duration::from_millis(2));
            }
        });
        let work = || -> Result<_> {
            let start = Instant::now();
            let recording = open(&[path], &selection(&six))?;
            let opened = start.elapsed().as_secs_f64();
            let rows = pass(&recording)?;
            Ok((opened, start.elapsed().as_secs_f64() - opened, rows))
        };
        let answer = work();
        done.store(true, Ordering::Relaxed);
        answer
    })?;
    println!(
        "open and one pass, 6 columns: {rows:>9} rows  {opened:.2} s + {passed:.2} s   peak {:.0} MiB of memory ({:.0} at the start), {:.0} MiB with the mapped file",
        peak.load(Ordering::Relaxed) as f64 / 1024.0,
        before as f64 / 1024.0,
        peak_rss_mib()
    );
    Ok(())
}

/// Memory of this process that belongs to no file, KiB; 0 if the system does not report it.
fn anonymous_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("RssAnon:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse().ok()).unwrap_or(0)
}

/// Reads all rows in chunks with all threads; how many there were.
fn pass(source: &dyn Source) -> Result<usize> {
    let mut chunks = Vec::new();
    for (episode, info) in source.episodes().iter().enumerate() {
        chunks.extend((0..info.rows).step_by(CHUNK).map(|from| (episode, from..(from + CHUNK).min(info.rows))));
    }
    let (mut rows, mut sum) = (0, 0.0);
    parallel_fold(
        chunks.len(),
        &Silent,
        |i| {
            let (episode, rows) = chunks[i].clone();
            let block = source.read(episode, rows, Halo { before: 2, after: 2 })?;
            Ok::<_, fleetfoot_data::Error>((block.rows, (0..6).map(|c| block.core(c).iter().sum::<f64>()).sum::<f64>()))
        },
        |(read, part)| {
            rows += read;
            sum += part;
            Ok(())
        },
    )?;
    // Gravity alone gives each row about ten.
    if !(sum > 9.0 * rows as f64 && sum < 11.0 * rows as f64) {
        return Err(format!("{rows} rows sum to {sum}").into());
    }
    Ok(rows)
}

/// The log of so many messages in this folder, written when it is not there.
fn written(folder: &Path, messages: usize) -> Result<PathBuf> {
    let path = folder.join(format!("imu-{messages}.mcap"));
    if !path.exists() {
        let start = Instant::now();
        write(&path, messages)?;
        println!("written {} in {:.1} s", path.display(), start.elapsed().as_secs_f64());
    }
    Ok(path)
}

fn write(path: &Path, messages: usize) -> Result<()> {
    let mut writer = McapWriter::create(path, &McapOptions::default())?;
    let channel = writer.channel::<Imu<'_>>(TOPIC)?;
    let mut random = Pcg64::seed_from_u64(7);
    for i in 0..messages {
        let stamp = START + i as i64 * PERIOD;
        let seconds = (stamp - START) as f64 * 1e-9;
        let mut noise = |size: f64| size * (random.random_range(-1.0..1.0) + random.random_range(-1.0..1.0));
        let yaw: f64 = 3.0 * (0.7 * seconds).sin() + noise(1e-4);
        let rate = |true_rate: f64, noise: f64| ((true_rate + noise) / RATE_STEP).round() * RATE_STEP;
        let acceleration = |of: f64, noise: f64| ((of + noise) / ACCELERATION_STEP).round() * ACCELERATION_STEP;
        let message = Imu {
            header: Header { stamp: Time::from_nanoseconds(stamp).ok_or("a stamp beyond 2038")?, frame_id: "imu_link" },
            orientation: [noise(1e-3), noise(1e-3), (0.5 * yaw).sin(), (0.5 * yaw).cos()],
            orientation_covariance: diagonal(1e-6),
            angular_velocity: [0.0, 0.0, 2.1 * (0.7 * seconds).cos()].map(|value| rate(value, noise(0.012))),
            angular_velocity_covariance: diagonal(1e-4),
            linear_acceleration: [0.0, 0.5 * (1.3 * seconds).sin(), 9.80665]
                .map(|value| acceleration(value, noise(0.06))),
            linear_acceleration_covariance: diagonal(2.5e-3),
        };
        let delay = random.random_range(500_000..700_000);
        writer.write(channel, stamp + delay, stamp + 100_000, &message)?;
    }
    writer.finish()?;
    Ok(())
}

fn diagonal(variance: f64) -> [f64; 9] {
    std::array::from_fn(|place| if place % 4 == 0 { variance } else { 0.0 })
}
