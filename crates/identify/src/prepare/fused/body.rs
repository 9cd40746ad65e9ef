//! The body of a recipe: its readings and poses as fusion wants them, and what fusion found.

use std::path::{Path, PathBuf};

use fleetfoot_signal::{
    Spline,
    fuse::{BodyRun, BodyTrack, Fused, ImuRecord, PoseRecord, fuse_from},
};

use super::{
    super::{BodyReport, Places, RejectedPoses},
    kept::Kept,
    rows::LogRows,
    sensors::Sensors,
};
use crate::Error;

/// The poses of a log, in seconds after the first of its readings.
pub(super) struct Poses {
    stamps: Vec<f64>,
    positions: Vec<[f64; 3]>,
    attitudes: Vec<[f64; 4]>,
}

impl Poses {
    /// `seen` has positions as its vectors, and the parts of quaternions as its columns; each pose is the mean of so many seconds before its stamp.
    pub(super) fn new(seen: LogRows, epoch: i64, average: f64) -> Self {
        let apart = (seen.epoch - epoch) as f64 * 1e-9 - 0.5 * average;
        let part = |row: usize| std::array::from_fn(|i| seen.columns[i][row]);
        Self {
            attitudes: (0..seen.times.len()).map(part).collect(),
            stamps: seen.times.into_iter().map(|time| time + apart).collect(),
            positions: seen.vectors.into_iter().next().unwrap_or_default(),
        }
    }
}

/// The readings of a log, which are means over so many seconds.
pub(super) fn imu(rows: &LogRows, averages: [f64; 2]) -> ImuRecord<'_> {
    let forces = rows.vectors.get(1).map_or(&[][..], Vec::as_slice);
    ImuRecord { times: &rows.times, rates: &rows.vectors[0], forces, averages }
}

/// Fuses the body of all logs.
pub(super) fn fused(rows: &[LogRows], poses: &[Poses], sensors: &Sensors, kept: &mut Kept) -> Result<Fused, Error> {
    let records: Vec<BodyRun<'_>> = (0..rows.len())
        .map(|at| {
            let Poses { stamps, positions, attitudes } = &poses[at];
            BodyRun { imu: imu(&rows[at], sensors.averages), poses: PoseRecord { times: stamps, positions, attitudes } }
        })
        .collect();
    let error =
        |log: &Path, source| Error::Signal { episode: log.display().to_string(), channel: "[body]".into(), source };
    for (rows, record) in rows.iter().zip(&records) {
        record.check().map_err(|source| error(&rows.log, source))?;
    }
    let all = if let [rows] = rows { rows.log.clone() } else { PathBuf::from("all logs") };
    fuse_from(&records, &sensors.options, kept).map_err(|source| error(&all, source))
}

/// Seconds after which states share a hundredth of a measurement: a position under the noise of the force, integrated twice, or of the jerk, three times, an attitude under that of the rate, integrated once.
pub(super) fn smoothed(fused: &Fused, poses: &[Poses], accelerometer: bool) -> f64 {
    let rows: usize = poses.iter().map(|run| run.stamps.len()).sum();
    let seconds: f64 = poses.iter().filter_map(|run| Some(run.stamps.last()? - run.stamps.first()?)).sum();
    let (period, noise) = (seconds / rows.max(1) as f64, &fused.noise);
    let least = |axes: &[f64; 3]| axes.iter().copied().fold(f64::INFINITY, f64::min);
    let (spline, force) = match accelerometer {
        true => (Spline::Cubic, least(&noise.imu.accelerometer)),
        false => (Spline::Quintic, noise.jerk),
    };
    let position = spline.correlation_rows((noise.position / force).powi(2), period, 1.0) * period;
    position.max(100.0_f64.ln() * noise.attitude / least(&noise.imu.gyro) * period.sqrt())
}

pub(super) fn report(fused: &Fused, rows: &[LogRows], poses: &[Poses], sensors: &Sensors) -> BodyReport {
    let (own, noise, stated) = (&fused.constants, &fused.noise, &fused.noise_deviations);
    let told = |deviation: f64| deviation.is_finite().then_some(deviation);
    let fitted = sensors.options.fit_noise;
    // What readings tell of themselves has a deviation; what is a bound has none.
    let reading = |of: fn(f64, f64) -> f64| {
        let axis = |which: usize, axis: usize| {
            let deviation = told(stated.imu.scatter[which][axis]).filter(|_| fitted)?;
            Some(of(noise.imu.scatter[which][axis], deviation))
        };
        [0, 1].map(|which| [0, 1, 2].map(|at| axis(which, at)))
    };
    let rejected = |at: usize| {
        let places = |of: fn(&BodyTrack) -> &Vec<usize>| {
            let tracks = fused.tracks.iter().filter(|track| track.run == at);
            Places::of(&tracks.flat_map(of).copied().collect::<Vec<_>>(), &poses[at].stamps)
        };
        RejectedPoses {
            log: rows[at].log.display().to_string(),
            positions: places(|track| &track.positions_rejected),
            attitudes: places(|track| &track.attitudes_rejected),
        }
    };
    BodyReport {
        lever: own.lever.map(|axis| axis.value),
        lever_deviation: own.lever.map(|axis| axis.deviation),
        mounting: own.mounting,
        mounting_deviation: own.mounting_deviations,
        // Nothing is 0, and not -0.
        delay: 0.0 - own.offset.value,
        delay_deviation: own.offset.deviation,
        gravity: own.gravity,
        gravity_deviation: own.gravity_deviations,
        accelerometer: sensors.has_forces(),
        jerk: (!sensors.has_forces()).then_some(noise.jerk),
        jerk_deviation: told(stated.jerk).filter(|_| !sensors.has_forces()),
        imu_noise: [noise.imu.gyro, noise.imu.accelerometer],
        imu_noise_deviation: [stated.imu.gyro.map(told), stated.imu.accelerometer.map(told)],
        reading_noise: reading(|value, _| value),
        reading_noise_deviation: reading(|_, deviation| deviation),
        imu_walk: [noise.imu.gyro_walk, noise.imu.accelerometer_walk],
        imu_walk_deviation: [stated.imu.gyro_walk, stated.imu.accelerometer_walk].map(told),
        imu_missed: noise.imu.missed,
        imu_missed_deviation: stated.imu.missed.map(told),
        pose_noise: [noise.position, noise.attitude],
        pose_noise_deviation: [stated.position, stated.attitude].map(told),
        noise_fitted: fitted,
        poses: poses.iter().map(|run| run.stamps.len()).sum(),
        outside: fused.outside,
        contradicted: fused.contradicted,
        rejected: (0..poses.len()).map(rejected).collect(),
        converged: fused.converged,
    }
}
