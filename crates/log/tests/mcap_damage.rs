//! A robot's log of half a megabyte, cut and changed everywhere, through the public interface. There is never a panic,
//! a hang, an invented value or memory beyond bounds, and losses are reported.

use std::{
    alloc::{GlobalAlloc, Layout, System},
    collections::BTreeMap,
    fs,
    io::{Seek, SeekFrom, Write},
    path::{Path, PathBuf},
    sync::{
        Mutex, MutexGuard, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    time::{Duration, Instant},
};

#[path = "all/ulog_writer.rs"]
mod ulog_writer;

use fleetfoot_data::{Halo, Silent, Source};
use fleetfoot_log::{Error, Messages, Selection, Stamp, TimeSpec, inspect_values, open};
use fleetfoot_message::write::{Float64, Header, Imu, JointState, Odometry, Pose, Time, Twist};
use fleetfoot_output::{McapOptions, McapWriter};

/// Bytes that the process holds, and the most since it was last asked.
struct Counting;

static HELD: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator with the arguments that it came with; the counters are no part of its answers.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let held = HELD.fetch_add(layout.size(), Ordering::Relaxed) + layout.size();
        PEAK.fetch_max(held, Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        HELD.fetch_sub(layout.size(), Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Bytes that a reading may hold at any time, on top of the test's own.
const MOST: usize = 64 << 20;
/// Returns true if the sweeps have their full size, which takes minutes (`make test-all`).
fn full() -> bool {
    std::env::var_os("FLEETFOOT_SWEEPS").is_some_and(|size| size == "full")
}

/// A test may take this long; a hang takes longer.
const LONGEST: Duration = Duration::from_secs(20);

/// One test at a time, so that the counters are about it.
fn alone() -> MutexGuard<'static, ()> {
    static TURN: Mutex<()> = Mutex::new(());
    TURN.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Runs `work` and returns its result; it must hold little memory and end soon.
fn bounded<T>(what: &str, work: impl FnOnce() -> T) -> T {
    let before = HELD.load(Ordering::Relaxed);
    PEAK.store(before, Ordering::Relaxed);
    let begun = Instant::now();
    let answer = work();
    let peak = PEAK.load(Ordering::Relaxed).saturating_sub(before);
    assert!(peak < MOST, "{what}: {peak} bytes were held");
    assert!(begun.elapsed() < LONGEST, "{what}: {:?}", begun.elapsed());
    answer
}

const SECOND: i64 = 1_000_000_000;
const START: i64 = 1_780_000_000 * SECOND;
/// Fields to read of each topic: from the beginning to the end of the messages.
const WANTED: [(&str, &[&str]); 5] = [
    ("/cmd_vel", &["linear.x", "angular.z"]),
    ("/imu", &["header.stamp.nanosec", "orientation.w", "linear_acceleration_covariance[8]"]),
    ("/joint_states", &["position[left]", "velocity[1]", "effort[right]"]),
    ("/odom", &["pose.pose.position.x", "pose.covariance[7]", "twist.covariance[35]"]),
    ("/voltage", &["data"]),
];

/// Writes messages of five topics; noise keeps the compression from making the file small.
fn write(path: &Path, messages: i64, compress: bool) {
    let options = McapOptions { compress, chunk_bytes: 16 << 10, ..McapOptions::default() };
    let mut writer = McapWriter::create(path, &options).unwrap();
    let channels = (
        writer.channel::<Imu<'_>>("/imu").unwrap(),
        writer.channel::<Odometry<'_>>("/odom").unwrap(),
        writer.channel::<JointState<'_>>("/joint_states").unwrap(),
        writer.channel::<Twist>("/cmd_vel").unwrap(),
        writer.channel::<Float64>("/voltage").unwrap(),
    );
    let mut random = Random(7);
    let mut noise = || random.below(1 << 52) as f64 / (1_u64 << 52) as f64;
    for k in 0..messages {
        let at = START + k * 5_000_000;
        let header = Header { stamp: Time::from_nanoseconds(at).unwrap(), frame_id: "base_link" };
        match k % 10 {
            0 | 3 | 5 | 8 => {
                let mut imu = Imu { header, ..Imu::default() };
                imu.orientation = [(); 4].map(|()| noise());
                imu.linear_acceleration_covariance = [(); 9].map(|()| noise());
                writer.write(channels.0, at, at, &imu).unwrap();
            }
            1 | 6 => {
                let pose = Pose { position: [(); 3].map(|()| noise()), ..Pose::default() };
                let odometry =
                    Odometry { header, pose, pose_covariance: [(); 36].map(|()| noise()), ..Odometry::default() };
                writer.write(channels.1, at, at, &odometry).unwrap();
            }
            2 | 7 => {
                let values = [noise(), noise()];
                let names = ["left", "right"];
                let joints = JointState { header, name: &names, position: &values, velocity: &values, effort: &values };
                writer.write(channels.2, at, at, &joints).unwrap();
            }
            4 => writer.write(channels.3, at, at, &Twist { linear: [noise(); 3], angular: [noise(); 3] }).unwrap(),
            _ => writer.write(channels.4, at, at, &Float64 { data: noise() }).unwrap(),
        }
    }
    writer.finish().unwrap();
}

/// Numbers without a pattern (Marsaglia's xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % limit
    }
}

/// Stamps and values of a message, by bits.
type Row = (i64, i64, Vec<u64>);
/// Those of some topics.
type Rows = BTreeMap<&'static str, Vec<Row>>;

/// The topics to read in turn `turn`: one of them, as every chunk holds all, and now and then each.
fn in_turn(turn: usize) -> &'static [(&'static str, &'static [&'static str])] {
    if turn.is_multiple_of(16) { &WANTED } else { std::slice::from_ref(&WANTED[turn % WANTED.len()]) }
}

/// The messages of these topics that can be read, in file order.
fn read(path: &Path, wanted: &'static [(&'static str, &'static [&'static str])]) -> Result<Rows, Error> {
    let log = Messages::open(path)?;
    let mut by_topic = BTreeMap::new();
    for &(topic, fields) in wanted {
        let mut rows = Vec::new();
        let outcome = log.read(topic, fields, &Silent, |row| {
            rows.push((row.log_time, row.publish_time, row.values.iter().map(|value| value.to_bits()).collect()));
            Ok(())
        });
        if outcome.is_ok() {
            by_topic.insert(topic, rows);
        }
    }
    Ok(by_topic)
}

fn total(rows: &Rows) -> usize {
    rows.values().map(Vec::len).sum()
}

/// Every row is one of the truth, in its order.
fn is_part(part: &Rows, truth: &Rows) -> bool {
    part.iter().all(|(topic, rows)| {
        let mut left = truth[topic].iter();
        rows.iter().all(|row| left.any(|row_left| row_left == row))
    })
}

/// Returns true if the notes of `info --values` report damage or doubtful data; an error counts as a report.
fn tells(path: &Path) -> bool {
    match inspect_values(path, &Silent) {
        Ok(info) => !info.notes.is_empty() || info.topics.iter().any(|topic| topic.problem.is_some()),
        Err(_) => true,
    }
}

/// The log as a recording: only its errors and bounds are looked at.
fn record(path: &Path) {
    let mut selection = Selection::new(["/odom.pose.pose.position.x", "/imu.orientation.w", "/cmd_vel.linear.x"]);
    selection.join.stamp = Some(Stamp::Log);
    if let Err(problem) = open(&[path], &selection) {
        assert!(problem.to_string().contains("run.mcap"), "{problem}");
    }
}

fn scrap() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.mcap");
    (folder, path)
}

#[test]
fn truncated_files_are_read_to_the_cut() {
    let _turn = alone();
    let (_folder, path) = scrap();
    write(&path, 3200, true);
    let truth = read(&path, &WANTED).unwrap();
    assert_eq!((total(&truth), truth.len()), (3200, 5));
    let bytes = fs::read(&path).unwrap();
    assert!((450_000..650_000).contains(&bytes.len()), "{}", bytes.len());
    // Records end at irregular places: a stride without a common divisor with them meets their heads, bodies and ends.
    let (near, stride) = if full() { (2000, 1) } else { (300, 331) };
    let near_the_ends = |length: &usize| *length < near || bytes.len() - length <= near;
    let lengths = (0..bytes.len()).rev().filter(|length| near_the_ends(length) || length.is_multiple_of(stride));
    let file = fs::File::options().write(true).open(&path).unwrap();
    let mut before: BTreeMap<&str, usize> = truth.iter().map(|(topic, rows)| (*topic, rows.len())).collect();
    let (mut partial, mut refused, mut cuts) = (0, 0, 0);
    for (turn, length) in lengths.enumerate() {
        file.set_len(length as u64).unwrap();
        cuts += 1;
        let Ok(content) = bounded(&format!("cut at {length}"), || read(&path, in_turn(turn))) else {
            assert!(length < 8, "a file of {length} bytes is refused");
            refused += 1;
            continue;
        };
        for (&topic, rows) in &content {
            assert!(truth[topic].starts_with(rows), "cut at {length}: {topic}");
            assert!(rows.len() <= before[topic], "cut at {length}: {topic} has more messages than in a longer file");
            before.insert(topic, rows.len());
            partial += usize::from(!rows.is_empty() && rows.len() < truth[topic].len());
        }
        // Telling all fields takes longer than reading some.
        if turn.is_multiple_of(48) {
            let is_reported = bounded(&format!("told of {length}"), || tells(&path));
            assert!(
                is_reported || total(&content) == 3200,
                "cut at {length}: {} messages, and no word about it",
                total(&content)
            );
            bounded(&format!("recording of {length}"), || record(&path));
        }
    }
    assert!(refused == 8 && partial > cuts / 2, "{refused} refused, {partial} read in part of {cuts} cuts");
}

/// Changes single bytes: `changes` times one, in place and back.
fn change_bytes(compress: bool, changes: usize, seed: u64) {
    let _turn = alone();
    let (_folder, path) = scrap();
    write(&path, if compress { 3200 } else { 1250 }, compress);
    let truth = read(&path, &WANTED).unwrap();
    let bytes = fs::read(&path).unwrap();
    assert!((400_000..650_000).contains(&bytes.len()), "{}", bytes.len());
    let mut file = fs::File::options().write(true).open(&path).unwrap();
    let mut set = |place: usize, byte: u8| {
        file.seek(SeekFrom::Start(place as u64)).unwrap();
        file.write_all(&[byte]).unwrap();
    };
    let mut random = Random(seed);
    let (mut lost, mut whole, mut silent) = (0, 0, Vec::new());
    for turn in 0..changes {
        let (place, mask) = (random.below(bytes.len() as u64) as usize, 1 + random.below(255) as u8);
        let what = format!("byte {place} changed by {mask:#04x}");
        set(place, bytes[place] ^ mask);
        let wanted = in_turn(turn);
        let content = bounded(&what, || read(&path, wanted)).unwrap_or_default();
        assert!(is_part(&content, &truth), "{what}: invented values");
        if wanted.iter().all(|(topic, _)| content.get(topic).map(Vec::len) == Some(truth[topic].len())) {
            whole += 1;
        } else {
            lost += 1;
            if lost % 48 == 0 && !bounded(&what, || tells(&path)) {
                silent.push(what.clone());
            }
        }
        if turn.is_multiple_of(96) {
            bounded(&what, || record(&path));
        }
        set(place, bytes[place]);
    }
    eprintln!("{changes} changes (compressed: {compress}): {lost} lost messages, {whole} did not");
    assert_eq!(silent, [""; 0], "no word about what is lost");
    assert!(lost > changes / 2, "{lost} of {changes}");
    assert_eq!(fs::read(&path).unwrap(), bytes);
}

#[test]
fn changed_bytes_of_compressed_chunks_invent_nothing() {
    change_bytes(true, if full() { 6000 } else { 800 }, 11);
}

#[test]
fn changed_bytes_of_plain_chunks_are_caught_by_their_checksums() {
    change_bytes(false, if full() { 4000 } else { 800 }, 12);
}

/// Fields of the recordings that the package rosbags wrote (`tests/peers/write_rosbags.py`, 60 rows).
const ROSBAGS: [(&str, &[&str]); 2] = [
    ("/imu", &["header.frame_id", "angular_velocity.x", "linear_acceleration_covariance[8]"]),
    ("/state", &["values[5]", "fixed[2]", "large", "points[0].z"]),
];

/// Fields wanted of each topic, for a sweep.
type Wanted = &'static [(&'static str, &'static [&'static str])];

/// ROS 1 bags and databases of rosbag2: each cut, and each with changed bytes, everywhere. There are no checksums but those of lz4 and bz2, so
/// that a changed number is a number; a cut file gives the messages before the cut.
#[test]
fn bags_and_databases_keep_sound_messages() {
    for name in ["none.bag", "lz4.bag", "bz2.bag", "plain.db3", "packed.db3"] {
        sweep(name, &ROSBAGS, 72, |_, _| false);
    }
}

/// Fields of the logs of ArduPilot that `tests/peers/write_dataflash.py` wrote (60 rows).
const DATAFLASH: [(&str, &[&str]); 4] = [
    ("/IMU", &["TimeUS", "GyrZ", "AHz"]),
    ("/IMU.1", &["AccX"]),
    ("/GPS.1", &["Lat", "GMS", "U"]),
    ("/MSG", &["Message"]),
];

/// As bags; a cut between two messages is no damage that a file without an index could tell.
#[test]
fn ardupilot_logs_keep_sound_messages() {
    sweep("flight.bin", &DATAFLASH, 125, |bytes, at| bytes[at..].starts_with(&[0xa3, 0x95]));
    sweep("flight.log", &DATAFLASH, 125, |bytes, at| bytes[at - 1] == b'\n');
}

/// Fields of the log of WPILib that `tests/peers/write_wpilog.py` wrote (60 rows).
const WPILOG: [(&str, &[&str]); 5] = [
    ("/drive/speed", &["value"]),
    ("/wheels", &["value[2]"]),
    ("/NT:/pose", &["translation.y", "rotation.turns"]),
    ("/modules", &["value[3].encoder", "value[0].drive"]),
    ("/names", &["value[1]"]),
];

/// As bags; a cut between two records is no damage that a file without an index could tell.
#[test]
fn wpilib_logs_keep_sound_messages() {
    sweep("robot.wpilog", &WPILOG, 246, |bytes, wanted| {
        let number = |at: usize, size: usize| (0..size).rev().fold(0, |all, k| all << 8 | usize::from(bytes[at + k]));
        let mut at = 12 + number(8, 4);
        while at < wanted {
            let head = usize::from(bytes[at]);
            let (entry, size, time) = ((head & 3) + 1, (head >> 2 & 3) + 1, (head >> 4 & 7) + 1);
            at += 1 + entry + size + time + number(at + 1 + entry, size);
        }
        at == wanted
    });
}

/// Cuts and changes a file everywhere, of which `messages` are wanted in all. `between`: whether a file that is cut at a place ends between two
/// messages.
fn sweep(name: &str, wanted: Wanted, messages: usize, between: fn(&[u8], usize) -> bool) {
    let _turn = alone();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    let bytes = fs::read(fixtures.join(name)).unwrap();
    fs::write(&path, &bytes).unwrap();
    let truth = read(&path, wanted).unwrap();
    assert_eq!((total(&truth), truth.len()), (messages, wanted.len()), "{name}");
    let turns: usize = if full() { 2000 } else { 200 };
    let mut random = Random(5);
    let (mut partial, mut silent) = (0, Vec::new());
    for turn in 0..turns {
        let length = if turn == 0 { bytes.len() - 1 } else { 16 + random.below(bytes.len() as u64 - 16) as usize };
        fs::write(&path, &bytes[..length]).unwrap();
        let what = format!("{name} cut at {length}");
        // A file without tables or connections is refused.
        if let Ok(content) = bounded(&what, || read(&path, wanted)) {
            assert!(is_part(&content, &truth), "{what}: invented values");
            partial += usize::from(total(&content) > 0);
            let lost = total(&content) < messages && !between(&bytes, length);
            if lost && turn.is_multiple_of(8) && !bounded(&what, || tells(&path)) {
                silent.push(what);
            }
        }
    }
    let mut changed = 0;
    for turn in 0..turns {
        let mut bytes = bytes.clone();
        for _ in 0..1 + turn % 4 * 10 {
            let at = 16 + random.below(bytes.len() as u64 - 16) as usize;
            bytes[at] ^= 1 + random.below(255) as u8;
        }
        fs::write(&path, &bytes).unwrap();
        let what = format!("{name}, change {turn}");
        let content = bounded(&what, || read(&path, wanted)).unwrap_or_default();
        // Messages of one topic can come to another one.
        assert!(content.values().all(|rows| rows.len() <= messages + 3), "{what}: invented messages");
        changed += usize::from(content != truth);
        if turn.is_multiple_of(8) {
            bounded(&what, || inspect_values(&path, &Silent).map(drop).unwrap_or_default());
        }
    }
    eprintln!("{name}: {partial} of {turns} cuts read in part, {changed} of {turns} changes noticed in the rows");
    assert_eq!(silent, [""; 0], "no word about what is lost");
    assert!(partial > turns / 20, "{name}: {partial} of {turns} cuts were read in part");
}

/// Columns by their names, their values by bits.
type Table = BTreeMap<String, Vec<u64>>;

/// The columns of a table that can be read, and what its notes tell.
fn read_table(path: &Path) -> Result<(Table, Vec<String>), Error> {
    let info = inspect_values(path, &Silent)?;
    let names = info.columns.iter().filter(|column| column.unsupported.is_none()).map(|column| column.name.clone());
    let names: Vec<String> = names.take(64).collect();
    let time = TimeSpec::Uniform { dt_seconds: 1.0 };
    let recording = open(&[path], &Selection { time, ..Selection::new(names.clone()) })?;
    let block = recording.read(0, 0..recording.episodes()[0].rows, Halo::default()).unwrap();
    let bits = |place: usize| block.column(place).iter().map(|value| value.to_bits()).collect();
    Ok((names.into_iter().enumerate().map(|(place, name)| (name, bits(place))).collect(), info.notes))
}

/// Arrays of NumPy and MATLAB that `tests/peers/write_arrays.py` wrote (40 rows), cut and changed everywhere. Archives have checksums, so that what
/// they give is the truth; a cut array gives its first rows.
#[test]
fn arrays_keep_sound_rows() {
    let _turn = alone();
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data/arrays");
    let folder = tempfile::tempdir().unwrap();
    for name in ["plain.npy", "fortran.npy", "fields.npy", "stored.npz", "deflated.npz", "plain.mat", "packed.mat"] {
        let path = folder.path().join(name);
        let bytes = fs::read(fixtures.join(name)).unwrap();
        fs::write(&path, &bytes).unwrap();
        let (truth, _) = read_table(&path).unwrap();
        let turns: usize = if full() { 2000 } else { 200 };
        let mut random = Random(5);
        let mut partial = 0;
        for _ in 0..turns {
            let length = 1 + random.below(bytes.len() as u64 - 1) as usize;
            fs::write(&path, &bytes[..length]).unwrap();
            let what = format!("{name} cut at {length}");
            if let Ok((columns_read, notes)) = bounded(&what, || read_table(&path)) {
                assert!(
                    columns_read.iter().all(|(column, column_read)| truth[column].starts_with(column_read)),
                    "{what}: invented values"
                );
                // MATLAB's variables follow each other without a count: a cut between two is no damage that could be told.
                assert!(
                    columns_read == truth || !notes.is_empty() || name.ends_with(".mat"),
                    "{what}: no word about it"
                );
                partial += 1;
            }
        }
        let mut changed = 0;
        for turn in 0..turns {
            let mut bytes = bytes.clone();
            for _ in 0..1 + turn % 4 * 10 {
                let at = random.below(bytes.len() as u64) as usize;
                bytes[at] ^= 1 + random.below(255) as u8;
            }
            fs::write(&path, &bytes).unwrap();
            let what = format!("{name}, change {turn}");
            let Ok((columns_read, _)) = bounded(&what, || read_table(&path)) else { continue };
            changed += usize::from(columns_read != truth);
            let same = |(column, column_read): (&String, &Vec<u64>)| {
                truth.get(column).is_none_or(|truth| truth == column_read)
            };
            assert!(columns_read.iter().all(same) || !name.ends_with(".npz"), "{what}: invented values");
        }
        eprintln!("{name}: {partial} of {turns} cuts read in part, {changed} of {turns} changes in the rows");
        assert!(partial > 0 || !name.starts_with("plain"), "{name}: no cut was read in part");
    }
}

/// As a recording, as messages and as what `info --values` tells.
fn read_ulog(path: &Path) {
    let _ = open(&[path], &Selection::new(["/gyro.rate[0]", "/a.b[0].x[0]"]));
    let _ = inspect_values(path, &Silent);
    let Ok(log) = Messages::open(path) else { return };
    for topic in log.topics().unwrap() {
        let _ = log.columns(&topic.name, None, &Silent);
    }
}

#[test]
fn ulogs_that_lie_take_no_memory() {
    let _turn = alone();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("run.ulg");
    let mut log = ulog_writer::flight(400);
    log.format("a:uint64_t timestamp;b[4000000000] b;").format("b:double[4000000000] x;").subscribe(0, 60_000, "a");
    // Thousands of subscriptions, each of a format that uses one whose fields are many.
    let fields: String = (0..4000).map(|field| format!("uint8_t a{field};")).collect();
    log.format(&format!("long:{fields}"));
    for id in 1000..9000_u16 {
        log.format(&format!("f{id}:uint64_t timestamp;long x;")).subscribe(1, id, &format!("f{id}"));
    }
    log.data(60_000, &[&[0; 64]]).data(8999, &[&[0; 4008]]).sync().sync().sync();
    fs::write(&path, &log.bytes).unwrap();
    bounded("a file of definitions that lie", || read_ulog(&path));
    // Flags, lengths and texts of nonsense behind a sound beginning.
    let mut random = Random(3);
    for turn in 0..if full() { 400 } else { 40 } {
        let mut bytes = ulog_writer::flight(200).bytes;
        for _ in 0..30 {
            let at = 16 + random.below(bytes.len() as u64 - 16) as usize;
            bytes[at] = random.below(256) as u8;
        }
        fs::write(&path, &bytes).unwrap();
        bounded(&format!("nonsense {turn}"), || read_ulog(&path));
    }
}
