//! The body of a recipe: its readings and poses in the form for fusion, and the report of the fusion.

use std::path::{Path, PathBuf};

use fleetfoot_dataset::Error;
use fleetfoot_signal::{
    Spline,
    fuse::{BodyRun, BodyState, BodyTrack, Fused, ImuRecord, PoseRecord, fuse_from},
    hangs,
};

use super::{
    super::{BodyReport, Places, RejectedPoses, channel::median_step},
    kept::Kept,
    rows::LogRows,
    sensors::Sensors,
};

/// Deviation of a quaternion's length from one above which a note warns.
const LENGTH: f64 = 0.01;

/// The square of the length of a quaternion below which it is none.
const NONE: f64 = 1e-6;

/// A bias of an accelerometer, m/s^2, and of a gyroscope, rad/s, that no sensor has which works.
const BIASES: [f64; 2] = [1.0, 0.3];

/// Ratio of the readings' noise beside the poses to their noise alone above which a note says that they contradict each
/// other.
const NOISIER: f64 = 20.0;

/// The poses of a log, in seconds after the first of its readings.
pub(super) struct Poses {
    stamps: Vec<f64>,
    positions: Vec<[f64; 3]>,
    attitudes: Vec<[f64; 4]>,
}

impl Poses {
    /// `seen` has positions as its vectors, and the parts of quaternions as its columns. Each pose is the mean of so
    /// many seconds before its stamp. A camera that does not see the body sends no pose: a quaternion of zeros, or the
    /// last pose until it sees the body elsewhere. Such poses are left out, with a note in `notes`.
    pub(super) fn new(seen: LogRows, epoch: i64, average: f64, notes: &mut Vec<String>) -> Self {
        let (log, rows) = (seen.log.display(), seen.times.len());
        let apart = (seen.epoch - epoch) as f64 * 1e-9 - 0.5 * average;
        let part = |row: usize| -> [f64; 4] { std::array::from_fn(|i| seen.columns[i][row]) };
        let attitudes: Vec<[f64; 4]> = (0..rows).map(part).collect();
        let positions = seen.vectors.into_iter().next().unwrap_or_default();
        let squares: Vec<f64> =
            attitudes.iter().map(|parts| parts.iter().map(|part| part * part).sum::<f64>()).collect();
        let is_none = |row: usize| squares[row] < NONE;
        let mut hung = vec![false; rows];
        for axis in 0..3 {
            let along_axis: Vec<f64> = positions.iter().map(|position| position[axis]).collect();
            // The first of equal poses was measured; an axis along which the body hardly moves may repeat itself alone.
            let again = hangs(&along_axis).into_iter().flat_map(|run| run.skip(1));
            again.filter(|&row| positions[row] == positions[row - 1]).for_each(|row| hung[row] = true);
        }
        let count = |is: &dyn Fn(usize) -> bool| (0..rows).filter(|&row| is(row)).count();
        let (none, stuck) = (count(&is_none), count(&|row| hung[row] && !is_none(row)));
        if none > 0 {
            notes.push(format!(
                "{log}: {none} poses have a quaternion of zeros (the body was not seen) and are left out"
            ));
        }
        if stuck > 0 {
            notes.push(format!(
                "{log}: {stuck} poses repeat the previous pose until a jump (the body was not seen) and are left out"
            ));
        }
        let kept = |row: &usize| !is_none(*row) && !hung[*row];
        let lengths: Vec<f64> = (0..rows).filter(kept).map(|row| squares[row].sqrt()).collect();
        let off = lengths.iter().filter(|length| (*length - 1.0).abs() > LENGTH).count();
        if off > 0 {
            let low = lengths.iter().copied().fold(f64::INFINITY, f64::min);
            let high = lengths.iter().copied().fold(0.0, f64::max);
            notes.push(format!(
                "{log}: quaternions of {off} poses are not of length 1 ({low:.3} to {high:.3}) and are normalised: check that the channels are x, y, z, w"
            ));
        }
        Self {
            stamps: (0..rows).filter(kept).map(|row| seen.times[row] + apart).collect(),
            positions: (0..rows).filter(kept).map(|row| positions[row]).collect(),
            attitudes: (0..rows).filter(kept).map(|row| attitudes[row]).collect(),
        }
    }
}

/// Notes about fused values that no body and no sensor can have. Units, signs or frames are then wrong, and so is the
/// written motion.
pub(super) fn doubts(fused: &Fused, rows: &[LogRows], sensors: &Sensors) -> Vec<String> {
    let mut doubts = Vec::new();
    let states = || fused.tracks.iter().flat_map(|track| &track.states);
    // Lower bounds of biases.
    let bias = |of: fn(&BodyState) -> [f64; 3], deviation: usize| {
        let least = |state: &BodyState| {
            let axes = of(state).into_iter().zip(&state.deviations[deviation..]);
            axes.map(|(bias, deviation)| bias.abs() - 3.0 * deviation).fold(0.0, f64::max)
        };
        states().map(least).fold(0.0, f64::max)
    };
    let force = if sensors.has_forces() { bias(|state| state.accelerometer_bias, 12) } else { 0.0 };
    if force > BIASES[0] {
        doubts.push(format!(
            "the estimated bias of the accelerometer is {force:.1} m/s^2 or more: check that its channels are the specific force in m/s^2 (at rest 9.8 upward, gravity included)"
        ));
    }
    let rate = bias(|state| state.gyro_bias, 9);
    if rate > BIASES[1] {
        doubts.push(format!(
            "the estimated bias of the gyroscope is {rate:.2} rad/s or more: check that its channels are in rad/s, and that the poses' quaternions are x, y, z, w from the markers' frame to the world"
        ));
    }
    let noise = &fused.noise.imu;
    let is_determined =
        |axis: &usize| sensors.options.fit_noise && fused.noise_deviations.imu.scatter[0][*axis].is_finite();
    // A density as the readings have it, of the log that is read least often.
    let period = rows.iter().map(|rows| median_step(&rows.times)).fold(0.0, f64::max);
    let noisier = |axis: usize| noise.gyro[axis] / (noise.scatter[0][axis] * period.sqrt());
    let most = (0..3).filter(is_determined).map(noisier).fold(0.0, f64::max);
    if most > NOISIER {
        doubts.push(format!(
            "compared with the poses the gyroscope is {most:.0} times as noisy as its readings alone: check its unit (rad/s), the order of the poses' quaternion (x, y, z, w) and its direction (the markers' frame to the world), the mounting, and the clocks"
        ));
    }
    doubts
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

/// Seconds after which states share a hundredth of a measurement. A position is under the noise of the force,
/// integrated twice, or of the jerk, three times. An attitude is under that of the rate, integrated once.
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
    let (constants, noise, stated) = (&fused.constants, &fused.noise, &fused.noise_deviations);
    let known = |deviation: f64| deviation.is_finite().then_some(deviation);
    let fitted = sensors.options.fit_noise;
    // Estimates from readings have a deviation; bounds have none.
    let reading = |of: fn(f64, f64) -> f64| {
        let axis = |which: usize, axis: usize| {
            let deviation = known(stated.imu.scatter[which][axis]).filter(|_| fitted)?;
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
        lever: constants.lever.map(|axis| axis.value),
        lever_deviation: constants.lever.map(|axis| axis.deviation),
        mounting: constants.mounting,
        mounting_deviation: constants.mounting_deviations,
        // Nothing is 0, and not -0.
        delay: 0.0 - constants.offset.value,
        delay_deviation: constants.offset.deviation,
        gravity: constants.gravity,
        gravity_deviation: constants.gravity_deviations,
        accelerometer: sensors.has_forces(),
        jerk: (!sensors.has_forces()).then_some(noise.jerk),
        jerk_deviation: known(stated.jerk).filter(|_| !sensors.has_forces()),
        imu_noise: [noise.imu.gyro, noise.imu.accelerometer],
        imu_noise_deviation: [stated.imu.gyro.map(known), stated.imu.accelerometer.map(known)],
        reading_noise: reading(|value, _| value),
        reading_noise_deviation: reading(|_, deviation| deviation),
        imu_walk: [noise.imu.gyro_walk, noise.imu.accelerometer_walk],
        imu_walk_deviation: [stated.imu.gyro_walk, stated.imu.accelerometer_walk].map(known),
        imu_missed: noise.imu.missed,
        imu_missed_deviation: stated.imu.missed.map(known),
        pose_noise: [noise.position, noise.attitude],
        pose_noise_deviation: [stated.position, stated.attitude].map(known),
        noise_fitted: fitted,
        poses: poses.iter().map(|run| run.stamps.len()).sum(),
        outside: fused.outside,
        contradicted: fused.contradicted,
        rejected: (0..poses.len()).map(rejected).collect(),
        converged: fused.converged,
    }
}
