//! Fusion of a body and of a joint: an hour at 1 kHz, and the same problems beside GTSAM and filterpy.
//!
//! The hour: readings of an inertial sensor at 1 kHz and poses at 100 Hz, every constant of the body unknown; and an
//! encoder at 1 kHz. There are 24 unknown numbers: 15 of a state (errors of attitude, position, velocity and both
//! biases), and 9 constants (lever, mounting, time offset and the direction of gravity). A body is fused as
//! `fleetfoot prepare` fuses it, with a file of its state after every round. The table has the time of a sweep against
//! the time recorded, and the peak of memory above the records, each in a separate process, on one thread. A sweep is a
//! step of Gauss and Newton over all states, its cost included, or a pass over the readings of a joint. A second
//! process fuses the body on two threads, is killed after its first write, and resumes: its answer is that of the first
//! to the last bit.
//!
//! Limits. A sweep eliminates 15 unknowns a pose from some 36 rows of 40 columns by reflectors, 42,000 multiply-adds,
//! and carries on the rest, 22,000. Of a long record it does so twice, forwards and again between kept nodes on the way
//! back. The ten readings of a pose are summed three times, for the rows of both ways and for the cost, each with a
//! covariance of 9 x 9: 60,000. That is 0.2 million a pose and sweep; the table has the ratio of the time to that of
//! this work at the rate of a core's registers.
//!
//! Peers, on one core: GTSAM's combined factors between the same poses, from the same start, by Gauss and Newton's
//! steps with default elimination; filterpy's filter and smoother of a chain of three. Answers are compared in
//! deviations. Bias: GTSAM's readings are summed before its clock starts, ours within. Its optimisation is timed alone
//! and with the deviations of all states, ours of everything. filterpy works one matrix at a time in Python, as its
//! users do.

use std::{
    error::Error,
    fs,
    path::{Path, PathBuf},
    process::{Command, Stdio},
    time::{Duration, Instant},
};

use fleetfoot_benches::{best_of, cpu_of, cpu_seconds, fma_rate, peak_rss_mib, peer, read_f64, write_f64};
use fleetfoot_data::{mix, with_threads};
use fleetfoot_signal::{
    Loss,
    fuse::{
        BodyNoise, BodyRun, Checkpoint, FuseOptions, Fused, ImuNoise, ImuRecord, PoseRecord, Prior, fuse, fuse_from,
    },
    joint::{FusedJoint, JointOptions, JointRecord, JointRun, JointSensor, Quantity, fuse_joint},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const HOUR: f64 = 3600.0;
const NOISE: BodyNoise =
    BodyNoise { imu: ImuNoise::even(2e-3, 2e-2, 1e-4, 1e-3), position: 1e-3, attitude: 3e-3, jerk: 100.0 };
const GRAVITY: f64 = 9.81;

struct Noise(Pcg64);

impl Noise {
    /// The sum of twelve uniform numbers is normal enough.
    fn next(&mut self) -> f64 {
        (0..12).map(|_| self.0.random::<f64>()).sum::<f64>() - 6.0
    }

    fn three(&mut self, size: f64) -> [f64; 3] {
        [0; 3].map(|_| size * self.next())
    }
}

/// Roll, pitch and yaw, and their rates.
fn angles(t: f64) -> ([f64; 3], [f64; 3]) {
    let axes = [[0.6, 1.7, 0.0], [0.5, 1.1, 1.0], [1.2, 0.7, 0.3]];
    (
        axes.map(|[size, rate, phase]: [f64; 3]| size * (rate * t + phase).sin()),
        axes.map(|[size, rate, phase]| size * rate * (rate * t + phase).cos()),
    )
}

fn attitude(t: f64) -> [f64; 4] {
    let [(sr, cr), (sp, cp), (sy, cy)] = angles(t).0.map(|angle| (0.5 * angle).sin_cos());
    [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy]
}

fn rate(t: f64) -> [f64; 3] {
    let ([roll, pitch, _], [dr, dp, dy]) = angles(t);
    [
        dr - dy * pitch.sin(),
        dp * roll.cos() + dy * roll.sin() * pitch.cos(),
        dy * roll.cos() * pitch.cos() - dp * roll.sin(),
    ]
}

const AXES: [[f64; 3]; 3] = [[1.0, 1.3, 0.2], [0.7, 1.9, 1.4], [0.4, 2.3, 0.9]];

fn turned([x, y, z, w]: [f64; 4], v: [f64; 3]) -> [f64; 3] {
    let cross =
        |a: [f64; 3], b: [f64; 3]| [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let once = cross([x, y, z], v);
    let twice = cross([x, y, z], [0, 1, 2].map(|i| once[i] + w * v[i]));
    [0, 1, 2].map(|i| v[i] + 2.0 * twice[i])
}

/// A body that turns and moves, its readings and poses.
struct Body {
    times: Vec<f64>,
    rates: Vec<[f64; 3]>,
    forces: Vec<[f64; 3]>,
    stamps: Vec<f64>,
    positions: Vec<[f64; 3]>,
    attitudes: Vec<[f64; 4]>,
}

impl Body {
    fn new(seconds: f64) -> Self {
        let (mut noise, rows) = (Noise(Pcg64::seed_from_u64(1)), (1000.0 * seconds) as usize + 1);
        let mut body = Self {
            times: Vec::with_capacity(rows),
            rates: Vec::with_capacity(rows),
            forces: Vec::with_capacity(rows),
            stamps: Vec::with_capacity(rows / 10),
            positions: Vec::with_capacity(rows / 10),
            attitudes: Vec::with_capacity(rows / 10),
        };
        for row in 0..rows {
            let t = 1e-3 * row as f64;
            let [x, y, z, w] = attitude(t);
            let [a, b, c] = AXES.map(|[size, rate, phase]| -size * rate * rate * (rate * t + phase).sin());
            let force = turned([-x, -y, -z, w], [a, b, c + GRAVITY]);
            let (gyro, scattered) = (
                noise.three(NOISE.imu.gyro[0] * 1000.0_f64.sqrt()),
                noise.three(NOISE.imu.accelerometer[0] * 1000.0_f64.sqrt()),
            );
            body.times.push(t);
            body.rates.push([0, 1, 2].map(|i| rate(t)[i] + gyro[i] + [0.02, -0.03, 0.01][i]));
            body.forces.push([0, 1, 2].map(|i| force[i] + scattered[i] + [0.1, -0.2, 0.05][i]));
            let at = t + 0.0043;
            if row % 10 == 5 && at < seconds - 0.1 {
                let (off, e) = (noise.three(NOISE.position), noise.three(0.5 * NOISE.attitude));
                let place = AXES.map(|[size, rate, phase]| size * (rate * at + phase).sin());
                let [x, y, z, w] = attitude(at);
                body.stamps.push(at);
                body.positions.push([0, 1, 2].map(|i| place[i] + off[i]));
                // q (1, e), normalised by whoever reads it.
                body.attitudes.push([
                    x + w * e[0] + y * e[2] - z * e[1],
                    y + w * e[1] + z * e[0] - x * e[2],
                    z + w * e[2] + x * e[1] - y * e[0],
                    w - x * e[0] - y * e[1] - z * e[2],
                ]);
            }
        }
        body
    }

    fn run(&self) -> BodyRun<'_> {
        BodyRun {
            imu: ImuRecord { times: &self.times, rates: &self.rates, forces: &self.forces, averages: [0.0; 2] },
            poses: PoseRecord { times: &self.stamps, positions: &self.positions, attitudes: &self.attitudes },
        }
    }
}

/// A fusion in which all constants are unknown.
fn unknown() -> FuseOptions {
    let deviation = f64::INFINITY;
    FuseOptions {
        noise: NOISE,
        gravity: Prior { value: [0.0, 0.0, -GRAVITY], deviation },
        lever: Prior { value: [0.0; 3], deviation },
        mounting: Prior { value: [0.0, 0.0, 0.0, 1.0], deviation },
        offset: Prior { value: 0.0, deviation: 0.005 },
        ..FuseOptions::default()
    }
}

fn encoder(seconds: f64) -> (Vec<f64>, Vec<f64>) {
    let mut noise = Noise(Pcg64::seed_from_u64(2));
    let times: Vec<f64> = (0..(1000.0 * seconds) as usize).map(|row| 1e-3 * row as f64).collect();
    let values = times.iter().map(|t| (3.0 * t).sin() + 0.4 * (7.1 * t).cos() + 1e-3 * noise.next()).collect();
    (times, values)
}

/// State of a fusion, in a file that is there whole or not at all.
struct Kept(PathBuf);

impl Checkpoint for Kept {
    fn load(&mut self) -> Option<Vec<u8>> {
        fs::read(&self.0).ok()
    }

    fn save(&mut self, state: &[u8]) {
        let beside = self.0.with_extension("new");
        // A file that cannot be written is begun anew after a kill.
        let _ = fs::write(&beside, state).and_then(|()| fs::rename(&beside, &self.0));
    }
}

/// A hash of all numbers of the answer.
fn digest(fused: &Fused) -> u64 {
    format!("{:?}", fused.constants)
        .bytes()
        .map(u64::from)
        .chain(fused.tracks.iter().flat_map(|track| &track.states).flat_map(|state| {
            let parts: [&[f64]; 9] = [
                &state.attitude,
                &state.position,
                &state.velocity,
                &state.gyro_bias,
                &state.accelerometer_bias,
                &state.rate,
                &state.acceleration,
                &state.deviations,
                &state.acceleration_deviations,
            ];
            parts.into_iter().flatten().map(|number| number.to_bits()).collect::<Vec<u64>>()
        }))
        .fold(0, |hash, word| mix(hash ^ word))
}

fn print_sweeps(name: &str, sweeps: usize, whole: f64, cpu: f64, records: f64) {
    let peak = peak_rss_mib();
    println!(
        "{name:<6} {:>6.1} s a sweep ({:.1} s of the processor), {:>5.0} times real time; {sweeps} sweeps and deviations {whole:.0} s; peak {:.0} MiB above the records, which are {records:.0}",
        whole / sweeps as f64,
        cpu / sweeps as f64,
        HOUR * sweeps as f64 / whole,
        peak - records
    );
}

/// An hour of a body, in a separate process: the kept state, and the hash of the answer, are in `folder`.
fn hour_of_body(folder: &Path, threads: usize) -> Result<(), Box<dyn Error>> {
    let body = Body::new(HOUR);
    let (records, before, start) = (peak_rss_mib(), cpu_seconds(), Instant::now());
    let mut kept = Kept(folder.join("kept"));
    let goes_on = kept.0.exists();
    let fused = with_threads(threads, || fuse_from(&[body.run()], &unknown(), &mut kept))?;
    let (whole, cpu) = (start.elapsed().as_secs_f64(), cpu_seconds() - before);
    fs::write(folder.join("answer"), digest(&fused).to_string())?;
    if goes_on {
        println!("       killed and gone on from what was kept, on {threads} threads: {whole:.0} s more");
        return Ok(());
    }
    // The work after the last step equals that of one step.
    print_sweeps("body", fused.steps + 1, whole, cpu, records);
    let (poses, offset) = (fused.tracks[0].states.len(), fused.constants.offset);
    if let Some(rate) = fma_rate() {
        let multiplied = 2e5 * poses as f64 * (fused.steps + 1) as f64;
        println!(
            "       {:.0} times as long as its multiply-adds at the rate of a core's registers",
            cpu * rate / multiplied
        );
    }
    println!("       converged: {}; poses late by {:.2e} s ({:.1e})", fused.converged, offset.value, offset.deviation);
    Ok(())
}

fn hour_of_joint() -> Result<(), Box<dyn Error>> {
    let (times, values) = encoder(HOUR);
    let (records, before, start) = (peak_rss_mib(), cpu_seconds(), Instant::now());
    let record = JointRecord { times: &times, values: &values };
    let options = JointOptions::new(vec![JointSensor::new(Quantity::Position)]);
    let fused = with_threads(1, || fuse_joint(&[JointRun { records: vec![record], at: &times }], &options))?;
    print_sweeps("joint", fused.rounds + 2, start.elapsed().as_secs_f64(), cpu_seconds() - before, records);
    println!("       converged: {}; noise {:.3e}, 1e-3 is true", fused.converged, fused.sensors[0].noise);
    Ok(())
}

/// This program once more, with these arguments.
fn again(arguments: &[&str]) -> std::io::Result<Command> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(arguments);
    Ok(command)
}

fn hours() -> Result<(), Box<dyn Error>> {
    println!("\nan hour at 1 kHz");
    let (whole, parted) = (tempfile::tempdir()?, tempfile::tempdir()?);
    let place = |folder: &tempfile::TempDir| folder.path().display().to_string();
    if !again(&["body", &place(&whole), "1"])?.status()?.success() {
        return Err("the hour of the body failed".into());
    }
    let mut killed = again(&["body", &place(&parted), "2"])?.stdout(Stdio::null()).spawn()?;
    while !parted.path().join("kept").exists() && killed.try_wait()?.is_none() {
        std::thread::sleep(Duration::from_millis(20));
    }
    killed.kill()?;
    killed.wait()?;
    if !again(&["body", &place(&parted), "2"])?.status()?.success() {
        return Err("the hour of the body did not go on".into());
    }
    let answer = |folder: &tempfile::TempDir| fs::read(folder.path().join("answer"));
    if answer(&whole)? != answer(&parted)? {
        return Err("an hour that was killed has another answer".into());
    }
    println!("       and the same answer to the last bit");
    match again(&["joint"])?.status()?.success() {
        true => Ok(()),
        false => Err("the hour of the joint failed".into()),
    }
}

/// The greatest difference of the states, in deviations, of nodes that both have, and that of the deviations, as a share of them.
fn apart(fused: &Fused, reference: &[f64]) -> ([f64; 5], f64) {
    let (mut most, mut deviations) = ([0.0_f64; 5], 0.0_f64);
    for (state, row) in fused.tracks[0].states.iter().zip(reference.chunks_exact(31).skip(fused.tracks[0].first)) {
        for (deviation, theirs) in state.deviations.iter().zip(&row[16..]) {
            deviations = deviations.max((deviation / theirs - 1.0).abs());
        }
        let [x, y, z, w] = state.attitude;
        let q: [f64; 4] = std::array::from_fn(|i| row[i]);
        // Twice the vector part of the rotation from one to the other.
        let sign = if x * q[0] + y * q[1] + z * q[2] + w * q[3] < 0.0 { -2.0 } else { 2.0 };
        let turn = [
            w * q[0] - x * q[3] - y * q[2] + z * q[1],
            w * q[1] - y * q[3] - z * q[0] + x * q[2],
            w * q[2] - z * q[3] - x * q[1] + y * q[0],
        ];
        let parts = [state.position, state.velocity, state.gyro_bias, state.accelerometer_bias];
        for i in 0..3 {
            most[0] = most[0].max((sign * turn[i] / state.deviations[i]).abs());
            for (at, part) in parts.iter().enumerate() {
                most[1 + at] =
                    most[1 + at].max(((part[i] - row[4 + 3 * at + i]) / state.deviations[3 + 3 * at + i]).abs());
            }
        }
    }
    (most, deviations)
}

fn beside_gtsam(folder: &Path) -> Result<(), Box<dyn Error>> {
    const SECONDS: f64 = 30.0;
    let body = Body::new(SECONDS);
    let options = FuseOptions {
        noise: NOISE,
        gravity: [0.0, 0.0, -GRAVITY].into(),
        loss: Loss::Huber(1e6),
        gate: 0.0,
        ..FuseOptions::default()
    };
    let run = || fuse(&[body.run()], &options);
    let ((seconds, fused), processor) = with_threads(1, || (best_of(3, run), cpu_of(run)));
    let fused = fused?;
    println!("\na body of {SECONDS} s, {} poses", fused.tracks[0].states.len());
    println!(
        "fleetfoot          {seconds:>9.3} s, {processor:.3} s of the processor; {} steps, deviations included",
        fused.steps
    );
    for (name, values) in [("rates", &body.rates), ("forces", &body.forces), ("positions", &body.positions)] {
        write_f64(&folder.join(format!("{name}.f64")), &values.concat())?;
    }
    write_f64(&folder.join("attitudes.f64"), &body.attitudes.iter().map(unit).collect::<Vec<_>>().concat())?;
    write_f64(&folder.join("times.f64"), &body.times)?;
    write_f64(&folder.join("stamps.f64"), &body.stamps)?;
    let ImuNoise { gyro, accelerometer, gyro_walk, accelerometer_walk, .. } = NOISE.imu;
    let biases = [options.gyro_bias.deviation, options.accelerometer_bias.deviation];
    let noise = [
        gyro[0],
        accelerometer[0],
        gyro_walk,
        accelerometer_walk,
        NOISE.position,
        NOISE.attitude,
        biases[0],
        biases[1],
        GRAVITY,
    ];
    write_f64(&folder.join("noise.f64"), &noise)?;
    match peer("fusion.py", &[folder, Path::new("gtsam")]) {
        Err(reason) => println!("gtsam              absent: {reason}"),
        Ok(answer) => {
            for (at, content) in ["states", "states and deviations"].into_iter().enumerate() {
                let [theirs, used] = ["seconds", "processor"].map(|of| answer[of][at].as_f64().unwrap_or(f64::NAN));
                println!(
                    "gtsam {:<12} {theirs:>9.3} s, {used:.3} s of the processor; {content}, {} steps, {:.1} times ours, {:.1} by the clock",
                    answer["version"].as_str().unwrap_or_default(),
                    answer["steps"],
                    used / processor,
                    theirs / seconds
                );
            }
            let (apart, deviations) = apart(&fused, &read_f64(&folder.join("found.f64"))?);
            println!(
                "apart, in deviations at most: attitude {:.4}, position {:.4}, velocity {:.4}, biases {:.4} and {:.4}; deviations by {:.2e} of themselves",
                apart[0], apart[1], apart[2], apart[3], apart[4], deviations
            );
            if !apart.iter().all(|apart| *apart < 0.1) {
                return Err("the states are not those of GTSAM".into());
            }
            if deviations > 0.02 {
                return Err("the deviations are not those of GTSAM".into());
            }
        }
    }
    Ok(())
}

fn unit(q: &[f64; 4]) -> [f64; 4] {
    let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
    q.map(|x| x / norm)
}

fn beside_filterpy(folder: &Path) -> Result<(), Box<dyn Error>> {
    let (times, values) = encoder(20.0);
    let (noise, jerk) = (1e-3, 100.0);
    let mut options =
        JointOptions::new(vec![JointSensor { noise: Some(noise), ..JointSensor::new(Quantity::Position) }]);
    (options.jerk, options.loss, options.gate) = (Some(jerk), Loss::Huber(1e6), 0.0);
    let run = || {
        let record = JointRecord { times: &times, values: &values };
        fuse_joint(&[JointRun { records: vec![record], at: &times }], &options)
    };
    let ((seconds, fused), processor) = with_threads(1, || (best_of(3, run), cpu_of(run)));
    let fused: FusedJoint = fused?;
    println!("\na joint of {} readings, noise and jerk given", times.len());
    println!("fleetfoot          {seconds:>9.4} s, {processor:.4} s of the processor; passes: {}", fused.rounds);
    write_f64(&folder.join("values.f64"), &values)?;
    write_f64(&folder.join("noise.f64"), &[1e-3, noise, jerk])?;
    match peer("fusion.py", &[folder, Path::new("filterpy")]) {
        Err(reason) => println!("filterpy           absent: {reason}"),
        Ok(answer) => {
            let [theirs, used] = ["seconds", "processor"].map(|of| answer[of][0].as_f64().unwrap_or(f64::NAN));
            let reference = read_f64(&folder.join("found.f64"))?;
            let states = &fused.runs[0];
            let off = |(row, theirs): (usize, &[f64])| {
                let of = |k: usize| {
                    let (mean, deviation) = (states.derivatives[k][row], states.deviations[k][row]);
                    ((theirs[k] - mean) / deviation).abs().max((theirs[3 + k].sqrt() / deviation - 1.0).abs())
                };
                (0..3).map(of).fold(0.0, f64::max)
            };
            let apart = reference.chunks_exact(6).enumerate().map(off).fold(0.0, f64::max);
            println!(
                "filterpy {:<9} {theirs:>9.4} s, {used:.4} s of the processor; {:.0} times ours, {:.0} by the clock; {apart:.1e} deviations apart at most",
                answer["version"].as_str().unwrap_or_default(),
                used / processor,
                theirs / seconds
            );
            // Its start is a prior of deviations of 10, 100 and 1000.
            if apart > 1e-3 {
                return Err("the states are not those of filterpy".into());
            }
        }
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    match words.iter().map(String::as_str).collect::<Vec<_>>()[..] {
        ["body", folder, threads, ..] => return hour_of_body(Path::new(folder), threads.parse()?),
        ["joint", ..] => return hour_of_joint(),
        _ => {}
    }
    println!("fusion, one core");
    // `cargo bench --bench fusion -- peers` leaves the hours out, `-- hours` the peers.
    let asks = |name: &str| words.iter().any(|word| word == name);
    if !asks("peers") {
        hours()?;
    }
    if asks("hours") {
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    beside_gtsam(folder.path())?;
    beside_filterpy(folder.path())
}
