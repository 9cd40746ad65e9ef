//! Motion between two instants as an inertial sensor measures it, summed once for all candidate states.
//!
//! Forster, Carlone, Dellaert, Scaramuzza, "On-manifold preintegration for real-time visual-inertial odometry", IEEE
//! Transactions on Robotics 33(1), 2017, sections V and VI. Between its stamps the sensor is interpolated by cubic
//! curves, and means are held over their windows. Each step uses the rotation in its middle, which is of second order
//! in the step. The noise is white in continuous time, so that its covariance is positive however short the interval
//! is.

use nalgebra::SMatrix;

use super::rotation::{Matrix, Rotation, Vector, exp, normalised, right_jacobian};
use super::{ImuNoise, ImuRecord};

/// Covariance of rotation, velocity and position.
pub(super) type Covariance = SMatrix<f64, 9, 9>;

/// The motion between two instants in the frame of the first, without gravity, and how it depends on the biases.
#[derive(Debug, Clone)]
pub(super) struct Preintegrated {
    /// Seconds.
    pub(super) dt: f64,
    /// The turn.
    pub(super) rotation: Rotation,
    /// The change of velocity, m/s.
    pub(super) velocity: Vector,
    /// Displacement by the specific force, m.
    pub(super) position: Vector,
    /// Slopes with respect to the biases of gyroscope (g) and accelerometer (a).
    pub(super) rotation_g: Matrix,
    pub(super) velocity_g: Matrix,
    pub(super) velocity_a: Matrix,
    pub(super) position_g: Matrix,
    pub(super) position_a: Matrix,
    /// Covariance of the noise of rotation (in the last frame), velocity, position.
    pub(super) covariance: Covariance,
    /// Its Cholesky factor.
    pub(super) root: Covariance,
    /// Part of the variances of turn and velocity that comes from motion between readings.
    pub(super) missed: [Vector; 2],
}

/// Angular rate and specific force.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    pub(super) rate: Vector,
    pub(super) force: Vector,
}

/// Mean periods within which the window of a mean lies if the means are held over their windows: those of longer windows overlap.
const TILED: f64 = 1.5;

/// Deviations of a jump by noise alone, squared, from which on something happened between two readings.
const JUMPS: f64 = 9.0;

/// Readings from which on their differences tell how they scatter.
const FEWEST: usize = 100;

/// The size that a quarter of standard normal numbers do not reach.
const QUARTILE: f64 = 0.318_639_4;

/// The variance of a jump beside the slopes on either side, in those of the four readings that tell it: (1/2, 3/2, 3/2, 1/2).
const FOUR: f64 = 5.0;

impl ImuRecord<'_> {
    /// The sample whose step to the next one holds `t`; the first and the last step go on beyond the ends.
    fn step_at(&self, t: f64) -> usize {
        self.times.partition_point(|&time| time <= t).clamp(1, self.times.len() - 1) - 1
    }

    /// Returns true if there is an accelerometer.
    pub(super) fn has_forces(&self) -> bool {
        !self.forces.is_empty()
    }

    /// Returns true if readings are means over windows of so many seconds that follow one another.
    fn is_held(&self, average: f64) -> bool {
        let span = self.times[self.times.len() - 1] - self.times[0];
        average > 0.0 && average * (self.times.len() - 1) as f64 <= TILED * span
    }

    /// For rates and for forces: true if motion between two readings is unmeasured.
    pub(super) fn misses(&self) -> [bool; 2] {
        self.averages.map(|average| !self.is_held(average))
    }

    /// The share of the step after sample `k` that has passed at `t`, the step that holds it sought from `k` on.
    fn share(&self, mut k: usize, t: f64) -> (usize, f64) {
        while k + 2 < self.times.len() && self.times[k + 1] < t {
            k += 1;
        }
        (k, ((t - self.times[k]) / (self.times[k + 1] - self.times[k])).clamp(0.0, 1.0))
    }

    /// The value at `t`, a moment of the step after sample `k`: interpolated between the middles of what readings are means of, and held beyond the ends of the record.
    fn interpolated(&self, values: &[[f64; 3]], average: f64, k: usize, t: f64) -> Vector {
        let (k, share) = self.share(k, t + 0.5 * average);
        let (a, b) = (Vector::from(values[k]), Vector::from(values[k + 1]));
        a + share * (b - a)
    }

    /// The mean from `from` to `to`, within the step after sample `k`, of the cubic curve through the readings whose slopes are those of the parabolas through three of them: a step's error is of fourth order, where the middle's is of second.
    fn curved(&self, values: &[[f64; 3]], k: usize, from: f64, to: f64) -> Vector {
        let (width, [a, b]) = (self.times[k + 1] - self.times[k], [k, k + 1].map(|row| Vector::from(values[row])));
        let chord = b - a;
        // Differences of the slopes at both ends from that of the chord.
        let bend = |row: usize| {
            if row == 0 || row + 1 == self.times.len() {
                Vector::zeros()
            } else {
                self.slope(values, row) * width - chord
            }
        };
        let (first, last) = (bend(k), bend(k + 1));
        let [u, v] = [from, to].map(|t| (t - self.times[k]) / width);
        // Simpson's rule is exact for a cubic.
        let at = |u: f64| {
            let u = u.clamp(0.0, 1.0);
            (first * (1.0 - u) - last * u) * (u * (1.0 - u))
        };
        let middle = (0.5 * (u + v)).clamp(0.0, 1.0);
        a + chord * middle + (at(u) + at(middle) * 4.0 + at(v)) / 6.0
    }

    /// The slope at a sample within the record: that of the parabola through it and its neighbours.
    fn slope(&self, values: &[[f64; 3]], row: usize) -> Vector {
        let step = |k: usize| {
            let width = self.times[k + 1] - self.times[k];
            (width, (Vector::from(values[k + 1]) - Vector::from(values[k])) / width)
        };
        let ((before, left), (after, right)) = (step(row - 1), step(row));
        (left * after + right * before) / (before + after)
    }

    /// The mean over the step after sample `k`: the reading at its end is that of the window before it, and before the window the two readings are all that is known.
    fn held(&self, values: &[[f64; 3]], average: f64, k: usize) -> Vector {
        let share = (average / (self.times[k + 1] - self.times[k])).min(1.0);
        let (a, b) = (Vector::from(values[k]), Vector::from(values[k + 1]));
        0.5 * (1.0 - share) * a + 0.5 * (1.0 + share) * b
    }

    /// The reading at `t`.
    pub(super) fn at(&self, t: f64) -> Reading {
        let k = self.step_at(t);
        let of = |values: &[[f64; 3]], average: f64| self.interpolated(values, average, k, t);
        let force = if self.has_forces() { of(self.forces, self.averages[1]) } else { Vector::zeros() };
        Reading { rate: of(self.rates, self.averages[0]), force }
    }

    /// Steps from `from` to `to`, cut at the stamps: the samples before them, their lengths, and the readings that stand for them.
    fn steps(&self, from: f64, to: f64) -> impl Iterator<Item = (usize, f64, Reading)> {
        let held = self.averages.map(|average| self.is_held(average));
        let (mut k, mut t) = (self.step_at(from), from);
        std::iter::from_fn(move || {
            if t >= to {
                return None;
            }
            let end = if k + 2 < self.times.len() { self.times[k + 1].min(to) } else { to };
            let of = |which: usize, values: &[[f64; 3]]| match self.averages[which] {
                0.0 => self.curved(values, k, t, end),
                average if held[which] => self.held(values, average, k),
                average => self.interpolated(values, average, k, 0.5 * (t + end)),
            };
            let force = if self.has_forces() { of(1, self.forces) } else { Vector::zeros() };
            let step = (k, end - t, Reading { rate: of(0, self.rates), force });
            (k, t) = (k + 1, end);
            Some(step)
        })
    }

    /// Jump between neighbours in the step after sample `k`, beyond the slopes on either side.
    fn jump(&self, values: &[[f64; 3]], k: usize) -> Vector {
        let width = |k: usize| self.times[k + 1] - self.times[k];
        let change = |k: usize| (Vector::from(values[k + 1]) - Vector::from(values[k])) / width(k);
        let last = self.times.len() - 2;
        let (before, after) =
            (if k > 0 { k - 1 } else { last.min(k + 1) }, if k < last { k + 1 } else { k.saturating_sub(1) });
        (change(k) - 0.5 * (change(before) + change(after))) * width(k)
    }

    /// The squares of jumps, an axis, as far as noise of readings, which has no more than these variances, does not make them.
    fn jumps(&self, values: &[[f64; 3]], variances: &[f64; 3], k: usize) -> Vector {
        let jump = self.jump(values, k);
        Vector::from_fn(|axis, _| (jump[axis] * jump[axis] - JUMPS * FOUR * variances[axis]).max(0.0))
    }

    /// Readings of rates (0) or forces (1).
    fn values(&self, which: usize) -> &[[f64; 3]] {
        if which == 0 { self.rates } else { self.forces }
    }

    /// The densities, squared, of what rates and forces miss in the step after sample `k`.
    fn missed(&self, noise: &ImuNoise, k: usize) -> [Vector; 2] {
        let width = self.times[k + 1] - self.times[k];
        [0, 1].map(|which| match noise.missed[which] > 0.0 && !self.values(which).is_empty() {
            true => {
                let jumps = self.jumps(self.values(which), &noise.greatest(which, width), k);
                jumps * (noise.missed[which].powi(2) * width / 12.0)
            }
            false => Vector::zeros(),
        })
    }

    /// The variances of the errors of rate and force that [`Self::at`] tells, biases aside: noise of neighbours, and where between them a jump was.
    pub(super) fn variances(&self, noise: &ImuNoise, t: f64) -> [Vector; 2] {
        let first = self.step_at(t);
        [0, 1].map(|which| {
            if self.values(which).is_empty() {
                return Vector::zeros();
            }
            let (k, share) = self.share(first, t + 0.5 * self.averages[which]);
            let width = self.times[k + 1] - self.times[k];
            let white = Vector::from(noise.variances(which, width)) * (share * share + (1.0 - share) * (1.0 - share));
            if noise.missed[which] == 0.0 {
                return white;
            }
            let jumps = self.jumps(self.values(which), &noise.greatest(which, width), k);
            white + jumps * (noise.missed[which].powi(2) * share * (1.0 - share))
        })
    }

    /// Deviations that single readings of rate and force do not exceed: where nothing happens neighbours differ by their noise alone, and whatever happens makes the lower quartile of the differences no smaller.
    pub(super) fn scatter(&self) -> [[f64; 3]; 2] {
        let rows = self.times.len();
        [0, 1].map(|which| {
            std::array::from_fn(|axis| {
                if self.values(which).is_empty() || rows < FEWEST {
                    return f64::INFINITY;
                }
                let jump = |k: usize| self.jump(self.values(which), k)[axis].abs();
                let mut jumps: Vec<f64> = (1..rows - 2).map(jump).collect();
                let at = jumps.len() / 4;
                let (_, quartile, _) = jumps.select_nth_unstable_by(at, f64::total_cmp);
                // Values that are rounded may not differ at all, and tell nothing then.
                if *quartile > 0.0 { *quartile / (QUARTILE * FOUR.sqrt()) } else { f64::INFINITY }
            })
        })
    }
}

/// The Cholesky factor of the covariance of a motion, which is positive, as its noise is.
fn root(covariance: &Covariance) -> Covariance {
    let mut root = *covariance;
    for i in 0..9 {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| root[(i, k)] * root[(j, k)]).sum();
            let rest = root[(i, j)] - known;
            root[(i, j)] = if i == j { rest.max(f64::MIN_POSITIVE).sqrt() } else { rest / root[(j, j)] };
        }
    }
    root
}

impl Preintegrated {
    /// Nothing yet.
    fn none() -> Self {
        Self {
            dt: 0.0,
            rotation: Rotation::identity(),
            velocity: Vector::zeros(),
            position: Vector::zeros(),
            rotation_g: Matrix::zeros(),
            velocity_g: Matrix::zeros(),
            velocity_a: Matrix::zeros(),
            position_g: Matrix::zeros(),
            position_a: Matrix::zeros(),
            covariance: Covariance::zeros(),
            root: Covariance::zeros(),
            missed: [Vector::zeros(); 2],
        }
    }

    /// Motion that the sensor measures from `from` to `to`, less these biases of gyroscope and accelerometer.
    pub(super) fn new(imu: &ImuRecord<'_>, from: f64, to: f64, biases: &[Vector; 2], noise: &ImuNoise) -> Self {
        let mut sum = Self::none();
        let misses = noise.missed.iter().any(|&missed| missed > 0.0);
        for (k, dt, reading) in imu.steps(from, to) {
            let missed = if misses { imu.missed(noise, k) } else { [Vector::zeros(); 2] };
            sum.step(dt, &(reading.rate - biases[0]), &(reading.force - biases[1]), noise, &missed);
        }
        sum.rotation = normalised(&sum.rotation);
        sum.root = root(&sum.covariance);
        sum
    }

    fn step(&mut self, dt: f64, rate: &Vector, force: &Vector, noise: &ImuNoise, missed: &[Vector; 2]) {
        let turn = rate * dt;
        let half = 0.5 * turn;
        let (whole_turn, half_turn) = (exp(&turn), exp(&half));
        let back = whole_turn.inverse().to_rotation_matrix().into_inner();
        // The middle of the step, and its slope with respect to the gyroscope's bias.
        let middle = (self.rotation * half_turn).to_rotation_matrix().into_inner();
        let middle_g = half_turn.inverse().to_rotation_matrix() * self.rotation_g - right_jacobian(&half) * (0.5 * dt);
        let (push, turned) = (middle * force, middle * force.cross_matrix());
        self.propagate(dt, &back, &turned);
        self.scatter(dt, &middle, noise, missed);
        let by_rate = turned * middle_g;
        self.position += self.velocity * dt + push * (0.5 * dt * dt);
        self.position_g += self.velocity_g * dt - by_rate * (0.5 * dt * dt);
        self.position_a += self.velocity_a * dt - middle * (0.5 * dt * dt);
        self.velocity += push * dt;
        self.velocity_g -= by_rate * dt;
        self.velocity_a -= middle * dt;
        self.rotation_g = back * self.rotation_g - right_jacobian(&turn) * dt;
        self.rotation *= whole_turn;
        self.dt += dt;
    }

    /// A P A' over a step.
    fn propagate(&mut self, dt: f64, back: &Matrix, turned: &Matrix) {
        let (v, p) = (turned * -dt, turned * (-0.5 * dt * dt));
        // A changes three rows at a time: the whole product would be four times the work.
        let advance = |half: &Covariance| {
            let rows = |from: usize| half.fixed_view::<3, 9>(from, 0).into_owned();
            let (turn, velocity, position) = (rows(0), rows(3), rows(6));
            let mut next = Covariance::zeros();
            next.fixed_view_mut::<3, 9>(0, 0).copy_from(&(back * turn));
            next.fixed_view_mut::<3, 9>(3, 0).copy_from(&(velocity + v * turn));
            next.fixed_view_mut::<3, 9>(6, 0).copy_from(&(position + velocity * dt + p * turn));
            next
        };
        self.covariance = advance(&advance(&self.covariance).transpose());
    }

    /// Q of a step: noise of the rate turns, that of the force is integrated once and twice; so is what is missed, of these densities (squared) an axis.
    fn scatter(&mut self, dt: f64, middle: &Matrix, noise: &ImuNoise, [turned, pushed]: &[Vector; 2]) {
        let white = |densities: &[f64; 3]| Vector::from(densities.map(|density| density * density));
        let (rate, force) = ((white(&noise.gyro) + turned) * dt, (white(&noise.accelerometer) + pushed) * dt);
        for axis in 0..3 {
            self.covariance[(axis, axis)] += rate[axis];
        }
        let across = |variances: &Vector| middle * Matrix::from_diagonal(variances) * middle.transpose();
        let covariance =
            if force[0] == force[1] && force[1] == force[2] { Matrix::from_diagonal(&force) } else { across(&force) };
        for (row, column, share) in [(3, 3, 1.0), (3, 6, 0.5 * dt), (6, 3, 0.5 * dt), (6, 6, dt * dt / 3.0)] {
            let mut block = self.covariance.fixed_view_mut::<3, 3>(row, column);
            block += covariance * share;
        }
        self.missed[0] += turned * dt;
        if pushed.max() > 0.0 {
            self.missed[1] += across(&(pushed * dt)).diagonal();
        }
    }

    /// The part of the variance of a turn (0) or a change of velocity (1) along an axis that is missed between readings.
    pub(super) fn missed_part(&self, which: usize, axis: usize) -> f64 {
        self.missed[which][axis] / self.covariance[(3 * which + axis, 3 * which + axis)]
    }

    /// Turn, change of velocity and displacement when the biases are these much greater.
    pub(super) fn corrected(&self, gyro: &Vector, accelerometer: &Vector) -> (Rotation, Vector, Vector) {
        let rotation = self.rotation * exp(&(self.rotation_g * gyro));
        let velocity = self.velocity + self.velocity_g * gyro + self.velocity_a * accelerometer;
        let position = self.position + self.position_g * gyro + self.position_a * accelerometer;
        (rotation, velocity, position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fuse::rotation::log;

    const NOISE: ImuNoise = ImuNoise::even(1e-3, 1e-2, 1e-3, 1e-2);

    fn sum(imu: &ImuRecord<'_>, from: f64, to: f64) -> Preintegrated {
        Preintegrated::new(imu, from, to, &[Vector::zeros(); 2], &NOISE)
    }

    /// Means over windows that follow one another sum to what they are means of, whatever happens within; of windows that leave gaps these are bridged by both readings, and of an overlap nothing is held.
    #[test]
    fn averaged_readings_sum_to_the_integral() {
        let times: Vec<f64> = (0..50).map(|row| 0.01 * f64::from(row)).collect();
        let forces: Vec<[f64; 3]> =
            (0..50).map(|row| [if row % 7 == 3 { 80.0 } else { 0.1 * f64::from(row) }, 0.0, 1.0]).collect();
        let rates = vec![[0.0; 3]; 50];
        let with = |average: f64| ImuRecord { times: &times, rates: &rates, forces: &forces, averages: [0.0, average] };
        let sums: f64 = forces[11..=30].iter().map(|force| 0.01 * force[0]).sum();
        let mean = sum(&with(0.01), times[10], times[30]).velocity[0];
        assert!((mean - sums).abs() < 1e-12, "{mean} {sums}");
        // A window of a half: a quarter of the reading before, three quarters of the one after.
        let half: f64 = (11..=30).map(|row| 0.01 * (0.25 * forces[row - 1][0] + 0.75 * forces[row][0])).sum();
        assert!((sum(&with(0.005), times[10], times[30]).velocity[0] - half).abs() < 1e-12);
        assert_eq!(with(0.005).misses(), [true, false]);
        assert_eq!(with(0.02).misses(), [true, true]);
        // Moments of means are the middles of their windows.
        let line: Vec<[f64; 3]> = times.iter().map(|t| [t - 0.01, 0.0, 0.0]).collect();
        let imu = ImuRecord { forces: &line, averages: [0.0, 0.02], ..with(0.02) };
        assert!((imu.at(0.2345).force[0] - 0.2345).abs() < 1e-12);
        assert!((sum(&imu, 0.2, 0.31).velocity[0] - 0.5 * (0.31_f64.powi(2) - 0.04)).abs() < 1e-12);
    }

    /// Rates that follow a parabola, at uneven stamps, are integrated exactly between any two instants.
    #[test]
    fn rates_are_integrated_along_curves() {
        let times: Vec<f64> = (0..60).map(|row| 0.01 * f64::from(row) + 0.003 * f64::from(row % 3)).collect();
        let rate = |t: f64| 0.5 - 2.0 * t + 9.0 * t * t;
        let angle = |t: f64| 0.5 * t - t * t + 3.0 * t * t * t;
        let rates: Vec<[f64; 3]> = times.iter().map(|&t| [0.0, 0.0, rate(t)]).collect();
        let imu = ImuRecord { times: &times, rates: &rates, forces: &[], averages: [0.0; 2] };
        for (from, to) in [(0.05, 0.3), (0.123, 0.1234), (0.2001, 0.4777)] {
            let turned = log(&sum(&imu, from, to).rotation).z;
            assert!((turned - (angle(to) - angle(from))).abs() < 1e-13, "{from} {to}");
        }
    }

    /// The uncertainty of rates grows where they jump, and only there; noise is no jump.
    #[test]
    fn rate_uncertainty_grows_where_readings_jump() {
        let times: Vec<f64> = (0..400).map(|row| 0.01 * f64::from(row)).collect();
        let scattered = |row: u64| 0.01 * ((fleetfoot_data::mix(row) >> 11) as f64 / (1u64 << 52) as f64 - 1.0);
        let rates: Vec<[f64; 3]> = (0..400)
            .map(|row| [if row < 200 { 0.0 } else { 3.0 } + scattered(row), scattered(1000 + row), 0.0])
            .collect();
        let imu = ImuRecord { times: &times, rates: &rates, forces: &[], averages: [0.0; 2] };
        let scatter = imu.scatter();
        // Uniform noise of 0.01 either way deviates by 0.0058; what is always the same tells nothing.
        assert!(
            (scatter[0][1] / 0.01 * 3.0_f64.sqrt() - 1.0).abs() < 0.25 && scatter[0][2].is_infinite(),
            "{scatter:?}"
        );
        let noise = ImuNoise { missed: [1.0, 0.0], scatter, ..NOISE };
        let missed = |from: f64, to: f64| Preintegrated::new(&imu, from, to, &[Vector::zeros(); 2], &noise).missed[0];
        assert!(missed(0.5, 1.5) == Vector::zeros());
        // The jump's own step, and half of it in those on either side.
        let expected = 1.5 * 9.0 * 1e-4 / 12.0;
        let variance = missed(1.9, 2.1);
        assert!((variance[0] / expected - 1.0).abs() < 0.02 && variance[1] == 0.0, "{variance} {expected}");
    }
}
