//! Joints: sensors at different rates, against dense least squares and against the truth of a simulated chain.

use fleetfoot_data::with_threads;
use fleetfoot_signal::{
    Estimate, Loss, SignalError,
    fuse::Prior,
    joint::{FusedJoint, JointOptions, JointRecord, JointRun, JointSensor, Quantity, fuse_joint},
};
use nalgebra::{DMatrix, DVector};
use proptest::prelude::*;

use crate::common::{distance, normal};

/// Steps of the simulated chain, s.
const STEP: f64 = 1e-3;

/// Readings of a sensor.
#[derive(Debug, Clone, Default)]
struct Readings {
    times: Vec<f64>,
    values: Vec<f64>,
}

impl Readings {
    fn record(&self) -> JointRecord<'_> {
        JointRecord { times: &self.times, values: &self.values }
    }

    /// The truth at every n-th step from `first` on, stamped `late` steps later, with noise.
    fn of(truth: &[[f64; 3]], k: usize, [first, every, late]: [usize; 3], noise: f64, seed: u64) -> Self {
        let rows = (first..truth.len() - late).step_by(every);
        let times = rows.clone().map(|row| STEP * (row + late) as f64).collect();
        let values = rows.map(|row| truth[row][k] + noise * normal(seed, row as u64)).collect();
        Self { times, values }
    }
}

/// A chain whose jerk is white noise of density `jerk`, by its exact increments (the root of their covariance in closed form).
fn chain(steps: usize, jerk: f64, seed: u64) -> Vec<[f64; 3]> {
    let (h, q) = (STEP, jerk);
    // L L' = Q, the covariance of the integrated Wiener process over a step.
    let (l11, l21, l31) =
        (h.powf(2.5) / 20.0_f64.sqrt(), h.powf(1.5) * 20.0_f64.sqrt() / 8.0, h.sqrt() * 20.0_f64.sqrt() / 6.0);
    let l22 = h.powf(1.5) / 48.0_f64.sqrt();
    let l32 = (h * h / 2.0 - l31 * l21) / l22;
    let l33 = (h - l31 * l31 - l32 * l32).sqrt();
    let mut state = [0.3, -0.5, 1.0];
    (0..steps as u64)
        .map(|step| {
            let before = state;
            let e = [0, 1, 2].map(|k| q * normal(seed + k, step));
            state = [
                before[0] + h * before[1] + 0.5 * h * h * before[2] + l11 * e[0],
                before[1] + h * before[2] + l21 * e[0] + l22 * e[1],
                before[2] + l31 * e[0] + l32 * e[1] + l33 * e[2],
            ];
            before
        })
        .collect()
}

const JERK: f64 = 200.0;
const NOISE: [f64; 2] = [2e-3, 0.1];

/// An encoder at 500 Hz, and a tachometer at 200 Hz that is stamped 7 ms late.
fn recorded(seconds: f64, seed: u64) -> (Vec<[f64; 3]>, [Readings; 2]) {
    let truth = chain((seconds / STEP) as usize, JERK, 10 * seed);
    let encoder = Readings::of(&truth, 0, [0, 2, 0], NOISE[0], 10 * seed + 5);
    let tachometer = Readings::of(&truth, 1, [1, 5, 7], NOISE[1], 10 * seed + 6);
    (truth, [encoder, tachometer])
}

fn run<'a>(readings: &'a [Readings], at: &'a [f64]) -> JointRun<'a> {
    JointRun { records: readings.iter().map(Readings::record).collect(), at }
}

fn both() -> Vec<JointSensor> {
    vec![JointSensor::new(Quantity::Position), JointSensor::new(Quantity::Rate)]
}

/// All is given.
fn given() -> JointOptions {
    let mut sensors = both();
    for (sensor, noise) in sensors.iter_mut().zip(NOISE) {
        sensor.noise = Some(noise);
    }
    sensors[1].delay = 0.007.into();
    JointOptions { jerk: Some(JERK), ..JointOptions::new(sensors) }
}

/// The delay is sought, and how noisy what is.
fn sought() -> JointOptions {
    let mut sensors = both();
    sensors[1].delay = Prior { value: 0.0, deviation: f64::INFINITY };
    JointOptions::new(sensors)
}

fn instants(seconds: f64) -> Vec<f64> {
    (0..(seconds / 0.01) as usize - 2).map(|row| 0.01 * row as f64 + 0.0033).collect()
}

/// A reading of the dense problem: instant, slopes of position, rate and acceleration, value, deviation, and slopes of the constants.
type DenseReading = (f64, [f64; 3], f64, f64, Vec<f64>);

/// The same problem over all states at once: instants of readings and of what is wanted, and the constants, by one factorisation.
struct Dense {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
    instants: Vec<f64>,
}

impl Dense {
    fn new(readings: &[DenseReading], wanted: &[f64], constants: usize) -> Self {
        let mut instants: Vec<f64> = readings.iter().map(|reading| reading.0).chain(wanted.iter().copied()).collect();
        instants.sort_by(f64::total_cmp);
        instants.dedup();
        let n = instants.len();
        let mut rows: Vec<(Vec<(usize, f64)>, f64)> = Vec::new();
        for i in 0..n - 1 {
            let h = instants[i + 1] - instants[i];
            let q = DMatrix::from_row_slice(
                3,
                3,
                &[
                    h.powi(5) / 20.0,
                    h.powi(4) / 8.0,
                    h.powi(3) / 6.0,
                    h.powi(4) / 8.0,
                    h.powi(3) / 3.0,
                    h * h / 2.0,
                    h.powi(3) / 6.0,
                    h * h / 2.0,
                    h,
                ],
            ) * (JERK * JERK);
            let back = q.cholesky().unwrap().l().try_inverse().unwrap();
            let f = DMatrix::from_row_slice(3, 3, &[1.0, h, 0.5 * h * h, 0.0, 1.0, h, 0.0, 0.0, 1.0]);
            let from = -&back * f;
            for row in 0..3 {
                let slopes = (0..3).flat_map(|j| [(3 * i + j, from[(row, j)]), (3 * i + 3 + j, back[(row, j)])]);
                rows.push((slopes.collect(), 0.0));
            }
        }
        for (instant, slopes, value, deviation, of_constants) in readings {
            let at = instants.iter().position(|instant_of_row| instant_of_row == instant).unwrap();
            let mut row: Vec<(usize, f64)> = (0..3).map(|j| (3 * at + j, slopes[j] / deviation)).collect();
            row.extend(of_constants.iter().enumerate().map(|(j, slope)| (3 * n + j, slope / deviation)));
            rows.push((row, value / deviation));
        }
        let mut matrix = DMatrix::zeros(rows.len(), 3 * n + constants);
        for (i, (row, _)) in rows.iter().enumerate() {
            row.iter().for_each(|&(j, slope)| matrix[(i, j)] += slope);
        }
        let right = DVector::from_iterator(rows.len(), rows.iter().map(|row| row.1));
        let factor = matrix.qr();
        let r = factor.r();
        let mean = r.solve_upper_triangular(&(factor.q().transpose() * right)).unwrap();
        let inverse = r.solve_upper_triangular(&DMatrix::identity(r.nrows(), r.nrows())).unwrap();
        Self { mean, covariance: &inverse * inverse.transpose(), instants }
    }

    fn at(&self, instant: f64, k: usize) -> (f64, f64) {
        let row = 3 * self.instants.iter().position(|stamp| *stamp == instant).unwrap() + k;
        (self.mean[row], self.covariance[(row, row)].sqrt())
    }
}

/// Rows for the dense solution; constants are the delay and the bias of the tachometer, whose slopes with respect to the delay are `slopes`.
fn dense_rows(readings: &[Readings], delay: f64, slopes: &[f64]) -> Vec<DenseReading> {
    let [encoder, tachometer] = readings else { panic!("two sensors") };
    let of_encoder = encoder.times.iter().zip(&encoder.values);
    let of_encoder = of_encoder.map(|(&t, &y)| (t, [1.0, 0.0, 0.0], y, NOISE[0], vec![0.0, 0.0]));
    let of_tachometer = tachometer.times.iter().zip(&tachometer.values).zip(slopes);
    let of_tachometer =
        of_tachometer.map(|((&t, &y), &slope)| (t - delay, [0.0, 1.0, 0.0], y, NOISE[1], vec![-slope, 1.0]));
    of_encoder.chain(of_tachometer).collect()
}

/// States, their deviations, and those of delay and bias are those of one dense factorisation, to 1e-8: its own columns have a condition near 1e6.
#[test]
fn states_and_constants_match_dense_least_squares() {
    let (_, readings) = recorded(0.25, 3);
    let wanted = instants(0.25);
    let mut options = given();
    let unknown = |value: f64| Prior { value, deviation: f64::INFINITY };
    (options.sensors[1].delay, options.sensors[1].bias) = (unknown(0.005), unknown(0.0));
    let fused = fuse_joint(&[run(&readings, &wanted)], &options).unwrap();
    let [delay, bias] = [fused.sensors[1].delay, fused.sensors[1].bias];
    assert!(fused.converged && delay.deviation > 0.0 && bias.deviation > 0.0, "{fused:?}");
    // At the delay that was found: the states alone tell the slopes, then all together.
    let biased = |rows: Vec<DenseReading>| -> Vec<_> {
        rows.into_iter().map(|(t, h, y, s, c)| (t, h, y - if h[1] > 0.0 { bias.value } else { 0.0 }, s, c)).collect()
    };
    let none = vec![0.0; readings[1].times.len()];
    let alone: Vec<_> = biased(dense_rows(&readings, delay.value, &none))
        .into_iter()
        .map(|(t, h, y, s, _)| (t, h, y, s, Vec::new()))
        .collect();
    let alone = Dense::new(&alone, &wanted, 0);
    let slopes: Vec<f64> = readings[1].times.iter().map(|t| alone.at(t - delay.value, 2).0).collect();
    let dense = Dense::new(&biased(dense_rows(&readings, delay.value, &slopes)), &wanted, 2);
    let constants = 3 * dense.instants.len();
    for (at, parameter) in [delay, bias].into_iter().enumerate() {
        let deviation = dense.covariance[(constants + at, constants + at)].sqrt();
        assert!((parameter.deviation / deviation - 1.0).abs() < 1e-6, "{at}: {parameter:?} {deviation}");
        // The step that is left is a thousandth of a deviation at most.
        assert!(dense.mean[constants + at].abs() < 1e-3 * deviation, "{at}: {}", dense.mean[constants + at]);
    }
    for k in 0..3 {
        let (mean, _): (Vec<f64>, Vec<f64>) = wanted.iter().map(|&t| alone.at(t, k)).unzip();
        let (_, deviation): (Vec<f64>, Vec<f64>) = wanted.iter().map(|&t| dense.at(t, k)).unzip();
        let (of_mean, of_deviation) =
            (distance(&fused.runs[0].derivatives[k], &mean), distance(&fused.runs[0].deviations[k], &deviation));
        assert!(of_mean < 1e-8 && of_deviation < 1e-7, "{k}: {of_mean:e} {of_deviation:e}");
    }
    // With nothing sought the deviations are as exact.
    let mut options = given();
    options.sensors[1].delay = delay.value.into();
    options.sensors[1].bias = bias.value.into();
    let fused = fuse_joint(&[run(&readings, &wanted)], &options).unwrap();
    for k in 0..3 {
        let (_, deviation): (Vec<f64>, Vec<f64>) = wanted.iter().map(|&t| alone.at(t, k)).unzip();
        assert!(distance(&fused.runs[0].deviations[k], &deviation) < 1e-8, "{k}");
    }
}

/// Errors over their deviations at instants: squares.
fn scores(fused: &FusedJoint, truth: &[[f64; 3]], k: usize, at: &[f64]) -> Vec<f64> {
    let states = &fused.runs[0];
    let score = |(row, t): (usize, &f64)| {
        let exact = truth[(t / STEP).round() as usize][k];
        ((states.derivatives[k][row] - exact) / states.deviations[k][row]).powi(2)
    };
    at.iter().enumerate().map(score).collect()
}

/// Noise of the sensors and of the jerk is found to a tenth, the delay within its deviation, in every seed.
#[test]
fn noise_and_delay_are_estimated_from_readings() {
    for seed in 1..=4 {
        let (_, readings) = recorded(20.0, seed);
        let fused = fuse_joint(&[run(&readings, &[])], &sought()).unwrap();
        let ratios = [fused.sensors[0].noise / NOISE[0], fused.sensors[1].noise / NOISE[1], fused.jerk / JERK];
        let delay = fused.sensors[1].delay;
        eprintln!("{seed}: {ratios:.3?} delay {:.5} ({:.5}) in {} rounds", delay.value, delay.deviation, fused.rounds);
        assert!(fused.converged && ratios.iter().all(|ratio| (ratio - 1.0).abs() < 0.1), "{seed}: {ratios:?}");
        assert!((delay.value - 0.007).abs() < 3.5 * delay.deviation && delay.deviation < 2e-3, "{seed}: {delay:?}");
        assert!(fused.correlations.iter().all(|pair| pair.correlation.abs() < 0.1), "{:?}", fused.correlations);
    }
}

/// Over forty seeds, squared errors in units of their variances lie in the 95 % band of their law nine tenths of the time (Bar-Shalom, Li, Kirubarajan, 2001, section 5.4), for position, rate and acceleration.
#[test]
fn errors_are_as_large_as_stated() {
    const RUNS: usize = 40;
    let at: Vec<f64> = (10..190).map(|row| 0.01 * f64::from(row)).collect();
    let mut sums = vec![[0.0; 3]; at.len()];
    for seed in 0..RUNS as u64 {
        let (truth, readings) = recorded(2.0, 100 + seed);
        let mut options = given();
        options.sensors[1].delay = Prior { value: 0.0, deviation: f64::INFINITY };
        let fused = fuse_joint(&[run(&readings, &at)], &options).unwrap();
        for k in 0..3 {
            for (sum, score) in sums.iter_mut().zip(scores(&fused, &truth, k, &at)) {
                sum[k] += score;
            }
        }
    }
    // 2.5 % and 97.5 % of chi squared with 40 degrees of freedom.
    for k in 0..3 {
        let inside = sums.iter().filter(|sum| 24.433 < sum[k] && sum[k] < 59.342).count();
        assert!(inside as f64 >= 0.9 * sums.len() as f64, "derivative {k}: {inside} of {}", sums.len());
    }
}

/// A rate that was computed from the encoder errs with it, and two sensors do not.
#[test]
fn rate_derived_from_the_same_encoder_is_noted() {
    let (truth, _) = recorded(10.0, 7);
    let encoder = Readings::of(&truth, 0, [0, 5, 0], NOISE[0], 71);
    let tachometer = Readings::of(&truth, 1, [0, 5, 0], NOISE[1], 72);
    let (t, y) = (&encoder.times, &encoder.values);
    let last = t.len() - 1;
    let difference = |row: usize, before: usize, after: usize| {
        let (a, b) = (row.saturating_sub(before), (row + after).min(last).max(row.saturating_sub(before) + 1));
        (y[b] - y[a]) / (t[b] - t[a])
    };
    let mut filtered = vec![0.0; t.len()];
    for row in 1..t.len() {
        filtered[row] = filtered[row - 1] + 0.3 * (difference(row, 1, 0) - filtered[row - 1]);
    }
    let rates = [
        (0..=last).map(|row| difference(row, 1, 0)).collect(),
        (0..=last).map(|row| difference(row, 1, 1)).collect(),
        filtered,
    ];
    for (at, values) in rates.into_iter().enumerate() {
        let readings = [encoder.clone(), Readings { times: t.clone(), values }];
        let fused = fuse_joint(&[run(&readings, &[])], &sought()).unwrap();
        eprintln!("{at}: {:?}", fused.correlations);
        assert!(fused.correlations[0].correlation.abs() > 0.35, "{at}: {:?}", fused.correlations);
    }
    let fused = fuse_joint(&[run(&[encoder, tachometer], &[])], &sought()).unwrap();
    eprintln!("{:?}", fused.correlations);
    assert!(fused.correlations[0].correlation.abs() < 0.15, "{:?}", fused.correlations);
}

/// An encoder's steps are an error like any other, but for readings in a row that share one: at rest a position is known to a step's deviation, and no better for being read often.
#[test]
fn encoder_steps_count_as_quantised() {
    let step = 0.01;
    let quantised = |readings: &Readings| Readings {
        times: readings.times.clone(),
        values: readings.values.iter().map(|value| (value / step).round() * step).collect(),
    };
    let mut sensor = JointSensor::new(Quantity::Position);
    sensor.resolution = step;
    let at: Vec<f64> = (10..190).map(|row| 0.01 * f64::from(row)).collect();
    let mut sums = [0.0; 3];
    for seed in 0..10 {
        let truth = chain(2000, JERK, 900 + 10 * seed);
        let readings = quantised(&Readings::of(&truth, 0, [0, 2, 0], 1e-3, 950 + seed));
        let fused = fuse_joint(&[run(&[readings], &at)], &JointOptions::new(vec![sensor])).unwrap();
        for (k, sum) in sums.iter_mut().enumerate() {
            *sum += scores(&fused, &truth, k, &at).iter().sum::<f64>() / (10 * at.len()) as f64;
        }
    }
    eprintln!("scores {sums:?}");
    assert!(sums.iter().all(|sum| (0.1..1.5).contains(sum)), "{sums:?}");
    let times: Vec<f64> = (0..2000).map(|row| 1e-3 * f64::from(row)).collect();
    let values = times.iter().map(|t| if *t < 1.0 { 0.37 } else { 0.38 }).collect();
    let rest = [Readings { times, values }];
    let mut options = JointOptions::new(vec![JointSensor { noise: Some(1e-5), ..sensor }]);
    options.jerk = Some(1e-3);
    let fused = fuse_joint(&[run(&rest, &[0.5])], &options).unwrap();
    let deviation = fused.runs[0].deviations[0][0];
    assert!(deviation > 0.3 * step / 12.0_f64.sqrt(), "{deviation}");
}

/// A reading that is the mean of a window stands for its middle, and a position is curved within it.
#[test]
fn window_means_are_modelled() {
    let (rate, window) = (20.0_f64, 0.02);
    let mean = |t: f64, f: fn(f64) -> f64| (f(rate * t) - f(rate * (t - window))) / (rate * window);
    let times: Vec<f64> = (0..2000).map(|row| 1e-3 * f64::from(row)).collect();
    let positions: Vec<f64> =
        times.iter().zip(0..).map(|(&t, row)| -mean(t, f64::cos) + 1e-4 * normal(1, row)).collect();
    let rates: Vec<f64> =
        times.iter().zip(0..).map(|(&t, row)| rate * mean(t, f64::sin) + 1e-2 * normal(2, row)).collect();
    let readings = [(positions, Quantity::Position), (rates, Quantity::Rate)];
    let at: Vec<f64> = (30..170).map(|row| 0.01 * f64::from(row)).collect();
    let worst = |window: f64| {
        let (sensors, readings_of): (Vec<JointSensor>, Vec<Readings>) = readings
            .iter()
            .map(|(values, quantity)| {
                let series = Readings { times: times.clone(), values: values.clone() };
                (JointSensor { average: window, ..JointSensor::new(*quantity) }, series)
            })
            .unzip();
        let fused = fuse_joint(&[run(&readings_of, &at)], &JointOptions::new(sensors)).unwrap();
        let error = |(t, value): (&f64, &f64)| (value - (rate * t).sin()).abs();
        at.iter().zip(&fused.runs[0].derivatives[0]).map(error).fold(0.0, f64::max)
    };
    // A window of 0.02 s is 10 ms late, or 0.2 rad of the oscillation; its mean is 0.7 % less.
    let (taken, ignored) = (worst(window), worst(0.0));
    assert!(taken < 5e-4 && ignored > 0.1, "{taken} {ignored}");
}

/// Gross errors are left out, or count little; what is left is as if they were not there.
#[test]
fn gross_errors_leave_no_trace() {
    let (truth, mut readings) = recorded(4.0, 9);
    let wrong: Vec<usize> = (50..1900).step_by(97).collect();
    wrong.iter().for_each(|&row| readings[0].values[row] += if row % 2 == 0 { 1.0 } else { -0.4 });
    let at: Vec<f64> = (10..390).map(|row| 0.01 * f64::from(row)).collect();
    for (loss, gate) in [(Loss::Huber(4.0), 10.0), (Loss::Student(4.0), 0.0)] {
        let options = JointOptions { loss, gate, ..sought() };
        let fused = fuse_joint(&[run(&readings, &at)], &options).unwrap();
        if gate > 0.0 {
            eprintln!("{:?} jerk {} {} rounds {}", fused.sensors, fused.jerk, fused.rounds, fused.converged);
            assert_eq!(fused.runs[0].rejected[0], wrong);
            assert!((fused.sensors[0].noise / NOISE[0] - 1.0).abs() < 0.1, "{}", fused.sensors[0].noise);
        }
        let mean = scores(&fused, &truth, 0, &at).iter().sum::<f64>() / at.len() as f64;
        eprintln!("{loss:?}: {mean} {} {} rounds", fused.sensors[0].noise, fused.rounds);
        assert!(fused.converged && (0.4..1.8).contains(&mean), "{loss:?}: {mean}");
    }
}

/// Errors of Student's law: noise is the scale of the law.
#[test]
fn the_noise_of_heavy_tails_is_their_scale() {
    let truth = chain(30_000, JERK, 77);
    let mut readings = Readings::of(&truth, 0, [0, 2, 0], 0.0, 1);
    for (value, row) in readings.values.iter_mut().zip(0..) {
        let freedom: f64 = (0..4).map(|k| normal(200 + k, row).powi(2)).sum();
        *value += NOISE[0] * normal(300, row) / (freedom / 4.0).sqrt();
    }
    let sensors = vec![JointSensor::new(Quantity::Position)];
    let options = JointOptions { loss: Loss::Student(4.0), gate: 0.0, ..JointOptions::new(sensors) };
    let fused = fuse_joint(&[run(&[readings], &[])], &options).unwrap();
    let ratio = fused.sensors[0].noise / NOISE[0];
    assert!(fused.converged && (ratio - 1.0).abs() < 0.1, "{ratio}");
}

/// Runs share noise and constants; a run that says nothing is left without states.
#[test]
fn runs_share_the_constants() {
    let recordings: Vec<_> = (20..24).map(|seed| recorded(2.0, seed).1).collect();
    let at = instants(2.0);
    let silent = [Readings::default(), Readings::default()];
    let mut runs: Vec<JointRun<'_>> = recordings.iter().map(|readings| run(readings, &at)).collect();
    runs.push(run(&silent, &at));
    let fuse = |threads| with_threads(threads, || fuse_joint(&runs, &sought()).unwrap());
    let all = fuse(1);
    assert!(all.runs[4].derivatives[0].iter().all(|value| value.is_nan()));
    assert!(all.runs[3].derivatives[2].iter().all(|value| value.is_finite()));
    // With the noise given, what runs say of the delay adds up: each is linearised about its own states, which moves slopes by some percents.
    let mut options = given();
    options.sensors[1].delay = Prior { value: 0.0, deviation: f64::INFINITY };
    let information = |runs: &[JointRun<'_>]| fuse_joint(runs, &options).unwrap().sensors[1].delay.deviation.powi(-2);
    let alone: f64 = (0..4).map(|at| information(&runs[at..=at])).sum();
    assert!((information(&runs) / alone - 1.0).abs() < 0.05, "{} {alone}", information(&runs));
    for threads in [2, 7] {
        let other = fuse(threads);
        assert!(
            other.runs[..4] == all.runs[..4]
                && other.sensors == all.sensors
                && other.jerk.to_bits() == all.jerk.to_bits()
        );
    }
}

#[test]
fn inputs_that_cannot_be_fused_are_refused() {
    let (_, readings) = recorded(1.0, 4);
    let unknown = Prior { value: 0.0, deviation: f64::INFINITY };
    let words = |change: &dyn Fn(&mut JointOptions), readings: &[Readings]| {
        let mut options = sought();
        change(&mut options);
        fuse_joint(&[run(readings, &[])], &options).unwrap_err().to_string()
    };
    for (message, expected) in [
        (words(&|options| options.sensors[0].bias = unknown, &readings), "no sensor measures the position"),
        (words(&|options| options.sensors[0].delay = unknown, &readings), "relative to another sensor"),
        (words(&|options| options.sensors[0].resolution = -1.0, &readings), "the resolution of a sensor = -1"),
        (words(&|options| options.sensors[1].noise = Some(0.0), &readings), "the noise of a sensor = 0"),
        (words(&|options| options.loss = Loss::Student(f64::NAN), &readings), "Student's loss"),
        (words(&|options| options.sensors.clear(), &readings), "the number of sensors"),
    ] {
        assert!(message.contains(expected), "{message}");
    }
    let stuck =
        |readings: &Readings, value: f64| Readings { values: vec![value; readings.values.len()], ..readings.clone() };
    let stuck = [stuck(&readings[0], 5.0), stuck(&readings[1], 0.0)];
    let message = words(&|options| *options = JointOptions::new(both()), &stuck);
    assert!(message.contains("all the same"), "{message}");
    // A rest tells no delay, and half a second is a clock's offset.
    let rest = |readings: &Readings, size: f64| Readings {
        values: (0..readings.values.len()).map(|row| size * normal(5, row as u64)).collect(),
        ..readings.clone()
    };
    let still = [rest(&readings[0], 1e-3), rest(&readings[1], 0.1)];
    let result = fuse_joint(&[run(&still, &[])], &sought());
    assert!(result.as_ref().is_err() || result.unwrap().sensors[1].delay.deviation > 5e-3);
    let mut early = readings.clone();
    early[1].times.iter_mut().for_each(|time| *time += 0.4);
    let apart = fuse_joint(&[run(&early, &[])], &sought()).unwrap();
    assert!(apart.sensors[1].noise > 3.0 * apart.sensors[1].alone, "{apart:?}");
    let mut bad = readings.clone();
    bad[0].values[7] = f64::NAN;
    assert!(matches!(fuse_joint(&[run(&bad, &[])], &sought()), Err(SignalError::NotFinite { row: 7, .. })));
    assert!(matches!(
        fuse_joint(&[run(&readings[..1], &[])], &sought()),
        Err(SignalError::Length { count: 1, expected: 2, .. })
    ));
}

/// A rate of the other sign contradicts every position: that is told, and was an end of the program where no reading was left.
#[test]
fn rate_with_the_wrong_sign_is_noted() {
    let (w, size, phase) = ([0.7, 2.3, 5.1], [1.0, 0.5, 0.1], [0.3, 1.1, 2.0]);
    let motion = |t: f64| (0..3).map(|k| size[k] * f64::sin(w[k] * t + phase[k])).sum::<f64>();
    let rate = |t: f64| (0..3).map(|k| size[k] * w[k] * f64::cos(w[k] * t + phase[k])).sum::<f64>();
    let stamps = |rows: u32, period: f64| -> Vec<f64> { (0..rows).map(|row| period * f64::from(row)).collect() };
    let (often, seldom) = (stamps(30_000, 0.002), stamps(6000, 0.01));
    for seed in 0..3 {
        let positions: Vec<f64> =
            seldom.iter().zip(0..).map(|(t, row)| motion(*t) + 2e-3 * normal(50 + seed, row)).collect();
        let rates: Vec<f64> = often.iter().zip(0..).map(|(t, row)| -rate(*t) + 0.02 * normal(60 + seed, row)).collect();
        let records =
            vec![JointRecord { times: &seldom, values: &positions }, JointRecord { times: &often, values: &rates }];
        let options = JointOptions::new([Quantity::Position, Quantity::Rate].map(JointSensor::new).to_vec());
        match fuse_joint(&[JointRun { records, at: &[] }], &options) {
            Err(SignalError::NotFused { problem }) => {
                assert!(problem.contains("check clocks, signs and units"), "{problem}")
            }
            Err(other) => panic!("{other}"),
            // Numbers that the command reports.
            Ok(fused) => assert!(fused.sensors.iter().any(|sensor| sensor.noise > 3.0 * sensor.alone), "{fused:?}"),
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]

    /// Units of position and time, the origin of both and the order of the sensors are nobody's business.
    #[test]
    fn units_origins_and_order_do_not_matter(
        seed in 0u64..1000,
        size in 1e-3..1e3_f64,
        unit in 1e-2..1e2_f64,
        origins in (-10.0..10.0_f64, -100.0..100.0_f64),
        reversed in any::<bool>(),
    ) {
        let (_, readings) = recorded(1.0, 2000 + seed);
        let at = instants(1.0);
        let mut options = given();
        options.sensors[1].delay = Prior { value: 0.004, deviation: 0.02 };
        options.sensors[1].bias = Prior { value: 0.0, deviation: 1.0 };
        let fused = fuse_joint(&[run(&readings, &at)], &options).unwrap();
        let time = |t: &f64| unit * (t + origins.0);
        let mut other = readings.clone();
        for (k, readings) in other.iter_mut().enumerate() {
            readings.times = readings.times.iter().map(time).collect();
            readings.values = readings.values.iter().map(|y| if k == 0 { size * (y + origins.1) } else { size * y / unit }).collect();
        }
        let moved: Vec<f64> = at.iter().map(time).collect();
        let mut changed = options.clone();
        changed.jerk = Some(JERK * size / unit.powf(2.5));
        for (k, sensor) in changed.sensors.iter_mut().enumerate() {
            let unit_of = if k == 0 { size } else { size / unit };
            sensor.noise = sensor.noise.map(|noise| noise * unit_of);
            sensor.delay = Prior { value: sensor.delay.value * unit, deviation: sensor.delay.deviation * unit };
            sensor.bias = Prior { value: sensor.bias.value * unit_of, deviation: sensor.bias.deviation * unit_of };
        }
        if reversed {
            other.reverse();
            changed.sensors.reverse();
        }
        // A delay of more than 0.1 s would be refused as that of a clock.
        prop_assume!(unit < 3.0);
        let rescaled = fuse_joint(&[run(&other, &moved)], &changed).unwrap();
        for k in 0..3 {
            let back = |value: &f64| value / size * unit.powi(k as i32) - if k == 0 { origins.1 } else { 0.0 };
            let values: Vec<f64> = rescaled.runs[0].derivatives[k].iter().map(back).collect();
            let deviations: Vec<f64> = rescaled.runs[0].deviations[k].iter().map(|deviation| deviation / size * unit.powi(k as i32)).collect();
            // The iteration ends within a thousandth of a deviation.
            let apart = values.iter().zip(&fused.runs[0].derivatives[k]).zip(&fused.runs[0].deviations[k]);
            prop_assert!(apart.map(|((a, b), s)| (a - b).abs() / s).fold(0.0, f64::max) < 5e-3);
            prop_assert!(distance(&deviations, &fused.runs[0].deviations[k]) < 1e-3);
        }
    }
}

/// A filter's state at an instant equals that of a smoother without later readings, and so do the deviations. Before
/// the third reading the filter has no state.
#[test]
fn filter_equals_smoother_at_the_last_reading() {
    let (_, readings) = recorded(1.0, 8);
    let wanted = instants(1.0);
    let options = JointOptions { gate: 0.0, loss: Loss::Huber(1e9), ..given() };
    let filtered = JointOptions { estimate: Estimate::Filter, ..options.clone() };
    let filtered = fuse_joint(&[run(&readings, &wanted)], &filtered).unwrap();
    let filtered_run = &filtered.runs[0];
    assert!(filtered_run.derivatives[0][0].is_nan() && filtered_run.derivatives[0][10].is_finite());
    let delays = [0.0, 0.007];
    for at in [10, 25, 60, wanted.len() - 1] {
        let until = |(series, delay): (&Readings, f64)| {
            let count = series.times.iter().filter(|&&time| time - delay <= wanted[at]).count();
            Readings { times: series.times[..count].to_vec(), values: series.values[..count].to_vec() }
        };
        let read: Vec<Readings> = readings.iter().zip(delays).map(until).collect();
        let smoothed = fuse_joint(&[run(&read, &wanted[..=at])], &options).unwrap();
        for k in 0..3 {
            let (value, last) = (&filtered_run.derivatives[k][at], smoothed.runs[0].derivatives[k][at]);
            let [filtered_deviation, deviation] = [filtered_run.deviations[k][at], smoothed.runs[0].deviations[k][at]];
            assert!((value - last).abs() < 1e-7 * deviation, "{k} at {at}: {value} {last} +- {deviation}");
            assert!((filtered_deviation / deviation - 1.0).abs() < 1e-8, "{filtered_deviation} {deviation}");
        }
    }
}
