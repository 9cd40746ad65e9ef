//! Estimates of the noise from residuals.
//!
//! A kind of noise with separate residuals has the variance squares over redundancy. White noise and the uncertainty
//! between readings share their residuals: a step of scoring estimates both. In it a residual counts for either by the
//! square of its share of the variance (restricted likelihood: Harville, "Maximum likelihood approaches to variance
//! component estimation and to related problems", Journal of the American Statistical Association 72, 1977).

use super::{BodyNoise, ImuNoise};

/// Squares of deviations by which noise changes at most between two rounds.
const GREATEST_CHANGE: f64 = 1e4;

/// Residuals that count for axes being alike.
const ALIKE: f64 = 3.0;

/// The ratio of variances that is no change any more.
const SAME: f64 = 1.002;

/// The share of what is known of a variance that is no change any more.
const UNCERTAIN: f64 = 0.05;

/// The least ratio of a variance to the one before where two kinds are told apart.
const LEAST_RATIO: f64 = 0.2;

/// Number of kinds of noise that are estimated one by one: position and attitude, the walks of both biases.
pub(super) const SINGLE: usize = 4;

/// The logarithm of a variance's ratio by which it goes ahead at most in a round.
const FARTHEST: f64 = 1.5;

/// Residuals that what is expected of a walk counts for: few seconds tell nothing of it.
const EXPECTED: f64 = 1.0;

/// Sums over a group of residuals: squares as they count, how many, and the trace of what the unknowns took of them.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Share {
    pub(super) squares: f64,
    pub(super) count: f64,
    pub(super) taken: f64,
}

impl Share {
    pub(super) fn add(&mut self, other: &Self) {
        self.squares += other.squares;
        self.count += other.count;
        self.taken += other.taken;
    }

    /// The variance of weight one of this group: squares over its redundancy (Foerstner, "Ein Verfahren zur Schaetzung von Varianz- und Kovarianzkomponenten", 1979; a fixed point is the maximum of the
    /// restricted likelihood). One where nothing is left over to tell.
    pub(super) fn variance(&self) -> f64 {
        let redundancy = self.redundancy();
        if redundancy < 1.0 || self.squares <= 0.0 {
            return 1.0;
        }
        (self.squares / redundancy).clamp(1.0 / GREATEST_CHANGE, GREATEST_CHANGE)
    }

    /// Redundancy: number of residuals less the part that the unknowns explain.
    fn redundancy(&self) -> f64 {
        (self.count - self.taken).max(0.0)
    }

    /// The same where a deviation of so many present ones is expected: as if one more residual, which nothing explains, were of that size.
    fn expecting(&self, ratio: f64) -> f64 {
        ((self.squares + EXPECTED * ratio * ratio) / (self.redundancy() + EXPECTED))
            .clamp(1.0 / GREATEST_CHANGE, GREATEST_CHANGE)
    }
}

/// Sums over residuals whose variance is in part white noise and in part what is missed between readings, of which this is an axis: how much they tell of either and of both together, and by how much they are too great for either.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Split {
    white: f64,
    both: f64,
    missed: f64,
    white_left: f64,
    missed_left: f64,
}

impl Split {
    pub(super) fn residual(&mut self, part: f64, square: f64, taken: f64) {
        let (white, free) = (1.0 - part, 1.0 - taken);
        self.add(&Self {
            white: white * white * free,
            both: white * part * free,
            missed: part * part * free,
            white_left: white * (square - free),
            missed_left: part * (square - free),
        });
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.white += other.white;
        self.both += other.both;
        self.missed += other.missed;
        self.white_left += other.white_left;
        self.missed_left += other.missed_left;
    }

    /// The variance of weight one of white noise alone, as [`Share::variance`].
    fn variance(&self) -> f64 {
        Share { squares: self.white_left + self.white, count: self.white, taken: 0.0 }.variance()
    }

    /// The same where so many residuals of this variance are expected beside it.
    fn expecting(mut self, variance: f64) -> Self {
        self.white += ALIKE;
        self.white_left += ALIKE * (variance - 1.0);
        self
    }

    /// The variances of weight one of white noise about three axes of these densities and of what is missed about all of them, by a step of scoring: of one kind alone it is that of [`Split::variance`]. Axes are expected to be as noisy as
    /// their readings, and where these tell nothing, alike: poses may tell next to nothing of what a good gyroscope misses.
    fn variances(axes: &[Self; 3], densities: &[f64; 3], priors: &[Option<f64>; 3]) -> ([f64; 3], f64) {
        let alike = (densities.iter().map(|density| density.ln()).sum::<f64>() / 3.0).exp();
        let mut axes = *axes;
        for ((axis, density), prior) in axes.iter_mut().zip(densities).zip(priors) {
            *axis = axis.expecting((prior.unwrap_or(alike) / density).powi(2));
        }
        let all: f64 = axes.iter().map(|axis| axis.missed).sum();
        // The missed part's equation once those of the axes are solved.
        let (mut missed, mut left) = (all, axes.iter().map(|axis| axis.missed_left).sum::<f64>());
        for axis in &axes {
            missed -= axis.both * axis.both / axis.white;
            left -= axis.both * axis.white_left / axis.white;
        }
        if all < 1.0 || missed < 1e-3 * all {
            return (axes.each_ref().map(Self::variance), 1.0);
        }
        let missed = (left / missed).clamp(-FARTHEST, FARTHEST);
        (axes.each_ref().map(|axis| ratio((axis.white_left - axis.both * missed) / axis.white)), ratio(missed))
    }
}

/// A variance that is this share greater; a share that would make it negative makes it small.
fn ratio(share: f64) -> f64 {
    (1.0 + share).clamp(LEAST_RATIO, GREATEST_CHANGE)
}

/// Sums over residuals, by kind of noise.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Shares {
    /// Of rates and forces about each axis; without an accelerometer forces are the jerk.
    pub(super) inertial: [[Split; 3]; 2],
    /// Of position and attitude.
    pub(super) pose: [Share; 2],
    /// Of the biases of gyroscope and accelerometer.
    pub(super) walk: [Share; 2],
}

impl Shares {
    pub(super) fn add(&mut self, other: &Self) {
        for (split, other) in self.inertial.as_flattened_mut().iter_mut().zip(other.inertial.as_flattened()) {
            split.add(other);
        }
        let splits = self.pose.iter_mut().chain(&mut self.walk);
        splits.zip(other.pose.iter().chain(&other.walk)).for_each(|(split, other)| split.add(other));
    }

    /// Takes the noise for what residuals say it is. The kinds that are told one by one go on as far as the changes of this round and the last, of which the logarithms are `changes`, will come to if they go on shrinking as they do
    /// (Aitken). The greatest change, in those that are none any more: what is told by few residuals need not be told to the last digit.
    pub(super) fn take(&self, noise: &mut BodyNoise, sought: &Sought, changes: &mut [f64; SINGLE]) -> f64 {
        let BodyNoise { imu, position, attitude, jerk } = noise;
        let mut most: f64 = 0.0;
        let mut take = |noise: &mut f64, variance: f64, weight: f64, ahead: Option<usize>| {
            // A variance that so many residuals tell is known to a share of the root of 2 by their number.
            most = most.max(variance.ln().abs() / (UNCERTAIN * (2.0 / weight.max(1.0)).sqrt()).max(SAME.ln()));
            let whole = match ahead {
                Some(kind) => ahead_of(variance.ln(), &mut changes[kind]),
                None => variance.ln(),
            };
            *noise *= (0.5 * whole).exp();
        };
        let [rate, force] = &self.inertial;
        let (white, missed) = Split::variances(rate, &imu.gyro, &sought.densities[0]);
        for ((density, variance), split) in imu.gyro.iter_mut().zip(white).zip(rate) {
            take(density, variance, split.white + ALIKE, None);
        }
        let missed_weight = |axes: &[Split; 3]| axes.iter().map(|axis| axis.missed).sum();
        take(&mut imu.missed[0], missed, missed_weight(rate), None);
        if sought.has_forces {
            let (white, missed) = Split::variances(force, &imu.accelerometer, &sought.densities[1]);
            for ((density, variance), split) in imu.accelerometer.iter_mut().zip(white).zip(force) {
                take(density, variance, split.white + ALIKE, None);
            }
            take(&mut imu.missed[1], missed, missed_weight(force), None);
        } else {
            let mut all = Split::default();
            force.iter().for_each(|split| all.add(split));
            take(jerk, all.variance(), all.white, None);
        }
        take(position, self.pose[0].variance(), self.pose[0].redundancy(), Some(0));
        take(attitude, self.pose[1].variance(), self.pose[1].redundancy(), Some(1));
        let walks = [
            (&mut imu.gyro_walk, sought.expected.gyro_walk),
            (&mut imu.accelerometer_walk, sought.expected.accelerometer_walk),
        ];
        for (which, (walk, expected)) in walks.into_iter().enumerate() {
            if sought.walks[which] && (which == 0 || sought.has_forces) {
                let variance = self.walk[which].expecting(expected / *walk);
                take(walk, variance, self.walk[which].redundancy(), Some(2 + which));
            }
        }
        most
    }
}

/// Kinds of noise to estimate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sought {
    /// True if there is an accelerometer.
    pub(super) has_forces: bool,
    /// True if the walk of the gyroscope, and of the accelerometer, is estimated; and the expected walks.
    pub(super) walks: [bool; 2],
    pub(super) expected: ImuNoise,
    /// Densities that the readings of rate and force determine.
    pub(super) densities: [[Option<f64>; 3]; 2],
}

/// Limit of a sequence of changes that shrink by the ratio of this change to the last. After an extrapolation the ratio
/// is unknown, and `last` is then zero.
fn ahead_of(change: f64, last: &mut f64) -> f64 {
    if change * *last > 0.0 && change.abs() < last.abs() {
        let whole = change / (1.0 - change / *last);
        *last = 0.0;
        return whole.clamp(-FARTHEST.max(change.abs()), FARTHEST.max(change.abs()));
    }
    *last = change;
    change
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::mix;

    use super::*;

    /// A standard normal number (Box and Muller).
    fn normal(at: u64) -> f64 {
        let uniform = |at: u64| (mix(mix(7).wrapping_add(at)) >> 11) as f64 / (1u64 << 53) as f64;
        (-2.0 * (1.0 - uniform(2 * at)).ln()).sqrt() * (std::f64::consts::TAU * uniform(2 * at + 1)).cos()
    }

    /// Residuals of white noise, of which axes have more or less, and of what is missed here and there: both are found from afar, each axis to 5 % (1,500 or more residuals that are hardly of the other kind), and neither moves any more.
    #[test]
    fn white_and_missed_noise_are_estimated_separately() {
        let (truth, missed_truth) = ([1.0_f64, 2.0, 0.5], 0.7_f64);
        let jumps = |row: u64| [0.0, 0.0, 0.5, 4.0][(row / 3) as usize % 4];
        let residual = |row: u64| {
            let (deviation, jump) = (truth[row as usize % 3], missed_truth * missed_truth * jumps(row));
            normal(row) * (deviation * deviation + jump).sqrt()
        };
        let (mut densities, mut missed) = ([10.0; 3], 1.0);
        let mut last = ([0.0; 3], 0.0);
        for _ in 0..40 {
            let mut axes = [Split::default(); 3];
            for row in 0..12_000 {
                let (axis, jump) = (row as usize % 3, missed * missed * jumps(row));
                let variance = densities[axis] * densities[axis] + jump;
                axes[axis].residual(jump / variance, residual(row).powi(2) / variance, 0.0);
            }
            last = Split::variances(&axes, &densities, &[None; 3]);
            densities.iter_mut().zip(last.0).for_each(|(density, variance)| *density *= variance.sqrt());
            missed *= last.1.sqrt();
        }
        assert!(last.0.iter().chain([&last.1]).all(|variance| (variance - 1.0).abs() < 1e-6), "{last:?}");
        for axis in 0..3 {
            assert!((densities[axis] / truth[axis] - 1.0).abs() < 0.05, "{densities:?}");
        }
        assert!((missed / missed_truth - 1.0).abs() < 0.05, "{missed}");
    }

    /// Of axes of which nothing is told each is thought to be as the mean of all, and a walk to be what is expected.
    #[test]
    fn noise_without_residuals_takes_the_mean_of_the_axes() {
        let mut densities = [1.0, 4.0, 2.0];
        for _ in 0..30 {
            let (white, missed) = Split::variances(&[Split::default(); 3], &densities, &[None; 3]);
            densities.iter_mut().zip(white).for_each(|(density, variance)| *density *= variance.sqrt());
            assert!(missed == 1.0);
        }
        assert!(densities.iter().all(|density| (density - 2.0).abs() < 1e-9), "{densities:?}");
        // But for those whose readings tell it.
        for _ in 0..30 {
            let (white, _) = Split::variances(&[Split::default(); 3], &densities, &[Some(7.0), None, None]);
            densities.iter_mut().zip(white).for_each(|(density, variance)| *density *= variance.sqrt());
        }
        assert!((densities[0] - 7.0).abs() < 1e-6, "{densities:?}");
        assert!((Share::default().expecting(3.0) - 9.0).abs() < 1e-12);
    }

    /// Changes that shrink by half each time come to twice the first.
    #[test]
    fn evenly_shrinking_steps_are_extrapolated() {
        let mut last = 0.0;
        assert!(ahead_of(0.4, &mut last) == 0.4 && last == 0.4);
        assert!((ahead_of(0.2, &mut last) - 0.4).abs() < 1e-15 && last == 0.0);
        assert!(ahead_of(-0.1, &mut last) == -0.1 && ahead_of(0.05, &mut last) == 0.05);
    }
}
