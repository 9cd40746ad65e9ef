//! Logs of a made-up robot, and the columns read from them.

use std::path::{Path, PathBuf};

use fleetfoot_data::{EpisodeId, Halo, Source};
use fleetfoot_log::{Recording, Selection, open};
use fleetfoot_message::write::{Header, Message, Odometry, Pose, Time, Twist, Vector3Stamped};
use fleetfoot_output::{McapOptions, McapWriter};

pub(crate) const SECOND: i64 = 1_000_000_000;
pub(crate) const MILLISECOND: i64 = 1_000_000;
/// 2026-05-28T20:26:40Z
pub(crate) const START: i64 = 1_780_000_000 * SECOND;

/// A log being written in a folder of its own.
pub(crate) struct Log {
    folder: tempfile::TempDir,
    path: PathBuf,
    writer: McapWriter,
}

impl Log {
    pub(crate) fn new() -> Self {
        Self::with_chunks(4096)
    }

    pub(crate) fn with_chunks(chunk_bytes: u64) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("run.mcap");
        let writer = McapWriter::create(&path, &McapOptions { chunk_bytes, ..McapOptions::default() }).unwrap();
        Self { folder, path, writer }
    }

    /// Adds a topic without a message.
    pub(crate) fn announce<M: Message>(&mut self, topic: &str) {
        self.writer.channel::<M>(topic).unwrap();
    }

    pub(crate) fn write<M: Message>(&mut self, topic: &str, log_time: i64, message: &M) {
        let channel = self.writer.channel::<M>(topic).unwrap();
        self.writer.write(channel, log_time, log_time - MILLISECOND, message).unwrap();
    }

    /// Odometry with x = 1 + 2 t, a steady turn of 3 rad/s about z and t as forward speed, t in seconds from `START`.
    pub(crate) fn odometry(&mut self, at: i64, header: i64, log_time: i64) {
        let t = seconds(at);
        let pose = Pose { position: [1.0 + 2.0 * t, 0.0, 0.0], orientation: turned(3.0 * t) };
        let twist = Twist { linear: [t, 0.0, 0.0], angular: [0.0, 0.0, 3.0] };
        let message =
            Odometry { header: stamped(header), child_frame_id: "base_link", pose, twist, ..Odometry::default() };
        self.write("/odom", log_time, &message);
    }

    /// A force of (-4 t, the heading 3 t within (-pi, pi], t squared).
    pub(crate) fn force(&mut self, at: i64, header: i64, log_time: i64) {
        let t = seconds(at);
        self.write(
            "/force",
            log_time,
            &Vector3Stamped { header: stamped(header), vector: [-4.0 * t, wrapped(3.0 * t), t * t] },
        );
    }

    pub(crate) fn command(&mut self, log_time: i64, speed: f64) {
        self.write("/cmd_vel", log_time, &Twist { linear: [speed, 0.0, 0.0], angular: [0.0; 3] });
    }

    /// Four seconds of odometry at 20 Hz and force at 50 Hz, by two clocks: `clock` tells header stamp and log time of a measurement, or none.
    pub(crate) fn drive(&mut self, clock: impl Fn(&str, i64) -> Option<(i64, i64)>) {
        for at in (0..400).map(|k| START + k * 10 * MILLISECOND) {
            if (at - START) % (50 * MILLISECOND) == 0
                && let Some((header, log_time)) = clock("/odom", at)
            {
                self.odometry(at, header, log_time);
            }
            if (at - START) % (20 * MILLISECOND) == 0
                && let Some((header, log_time)) = clock("/force", at)
            {
                self.force(at, header, log_time);
            }
        }
    }

    /// Completes the file.
    pub(crate) fn finish(self) -> Written {
        self.writer.finish().unwrap();
        Written { folder: self.folder, path: self.path }
    }
}

/// A log on disk.
pub(crate) struct Written {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) path: PathBuf,
}

impl Written {
    pub(crate) fn open(&self, selection: &Selection) -> Recording {
        open(&[&self.path], selection).unwrap_or_else(|problem| panic!("{problem}"))
    }

    pub(crate) fn refusal(&self, selection: &Selection) -> String {
        let message = open(&[&self.path], selection).map(drop).unwrap_err().to_string();
        assert!(message.contains("run.mcap"), "{message}");
        message
    }
}

/// The usual log: header stamps and log times of 2026.
pub(crate) fn usual() -> Written {
    let mut log = Log::new();
    log.drive(|_, at| Some((at, at + 2 * MILLISECOND)));
    log.finish()
}

/// An episode with its values: one vector a column.
#[derive(Debug, Clone)]
pub(crate) struct Rows {
    pub(crate) id: EpisodeId,
    pub(crate) stamps: Vec<i64>,
    pub(crate) columns: Vec<Vec<f64>>,
}

impl PartialEq for Rows {
    /// By bits.
    fn eq(&self, other: &Self) -> bool {
        let bits = |rows: &Self| -> Vec<Vec<u64>> {
            rows.columns.iter().map(|column| column.iter().map(|value| value.to_bits()).collect()).collect()
        };
        (self.id, &self.stamps, bits(self)) == (other.id, &other.stamps, bits(other))
    }
}

pub(crate) fn episodes(recording: &Recording) -> Vec<Rows> {
    let read = |(place, episode): (usize, &fleetfoot_data::Episode)| {
        let block = recording.read(place, 0..episode.rows, Halo::default()).unwrap();
        let columns = (0..recording.columns().len()).map(|column| block.core(column).to_vec()).collect();
        Rows { id: episode.id, stamps: block.stamps().to_vec(), columns }
    };
    recording.episodes().iter().enumerate().map(read).collect()
}

/// The only episode.
pub(crate) fn whole(recording: &Recording) -> Rows {
    let mut episodes = episodes(recording);
    assert_eq!(episodes.len(), 1, "{:?}", recording.notes());
    episodes.remove(0)
}

pub(crate) fn seconds(at: i64) -> f64 {
    (at - START) as f64 / 1e9
}

pub(crate) fn stamped(at: i64) -> Header<'static> {
    Header { stamp: Time::from_nanoseconds(at).unwrap(), frame_id: "odom" }
}

pub(crate) fn turned(yaw: f64) -> [f64; 4] {
    [0.0, 0.0, (yaw / 2.0).sin(), (yaw / 2.0).cos()]
}

pub(crate) fn wrapped(angle: f64) -> f64 {
    angle.sin().atan2(angle.cos())
}

pub(crate) fn near(value: f64, expected: f64) {
    assert!((value - expected).abs() < 1e-9, "{value} instead of {expected}");
}

pub(crate) fn copy(from: &Path, to: &Path) {
    std::fs::copy(from, to).unwrap();
}
