//! A motion-capture system that tracks a body's markers.

use glam::{DQuat, DVec3};
use rand::RngExt;
use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::{Latency, LatencyParameters, check, clock::nanoseconds, streams};
use crate::{ParameterError, Reading};

/// A motion-capture system after II-B and II-D of *Automatic Identification of Dynamic Piecewise Affine Models for a Running Robot*
/// (Buchan, Haldane, Fearing).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MocapParameters {
    /// Seconds between samples.
    pub period: f64,
    /// The tracked point in the body's axes, m.
    pub position: [f64; 3],
    /// Standard deviation of white noise on each coordinate, m.
    pub position_noise: f64,
    /// Standard deviation of white noise about each axis, rad.
    pub orientation_noise: f64,
    /// Missing and wrong samples.
    pub faults: MocapFaultParameters,
    /// From a sample to its arrival at the controller.
    pub latency: LatencyParameters,
}

impl Default for MocapParameters {
    fn default() -> Self {
        Self {
            period: 0.01,
            position: [0.0; 3],
            position_noise: 27e-6,
            orientation_noise: 0.0026,
            faults: MocapFaultParameters::default(),
            latency: LatencyParameters::default(),
        }
    }
}

/// Faults of the tracking.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MocapFaultParameters {
    /// Times a second that markers are lost from view.
    pub dropout_rate: f64,
    /// For how long, on average, s; distributed exponentially. At least one sample is lost.
    pub dropout_length: f64,
    /// Times a second that a sample is wrong: another body is seen in the markers.
    pub outlier_rate: f64,
    /// Distance of a wrong position from the true one, m: smallest and largest, every order of magnitude alike. Its
    /// orientation is any.
    pub outlier_distance: [f64; 2],
}

impl Default for MocapFaultParameters {
    /// The paper's 3-4 wrong samples in two minutes, off by orders of magnitude. It gives no dropouts: here 30 ms, once in ten seconds.
    fn default() -> Self {
        Self { dropout_rate: 0.1, dropout_length: 0.03, outlier_rate: 3.5 / 120.0, outlier_distance: [0.5, 50.0] }
    }
}

impl MocapFaultParameters {
    /// Tracking that never fails.
    pub fn none() -> Self {
        Self { dropout_rate: 0.0, outlier_rate: 0.0, ..Self::default() }
    }

    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check::within("dropout_rate", self.dropout_rate, 0.0..=1e3)?;
        check::within("dropout_length", self.dropout_length, 0.0..=3600.0)?;
        check::within("outlier_rate", self.outlier_rate, 0.0..=1e3)?;
        let [near, far] = self.outlier_distance;
        check::positive("outlier_distance[0]", near, 1e6)?;
        check::within("outlier_distance[1]", far, near..=1e6)
    }
}

impl MocapParameters {
    /// Checks every parameter.
    ///
    /// # Errors
    /// The first parameter that is out of its range.
    pub fn validate(&self) -> Result<(), ParameterError> {
        check::positive("period", self.period, 1.0)?;
        check::position("position", self.position)?;
        check::within("position_noise", self.position_noise, 0.0..=100.0)?;
        check::within("orientation_noise", self.orientation_noise, 0.0..=1.0)?;
        self.faults.validate().map_err(|error| error.within("faults"))?;
        self.latency.validate().map_err(|error| error.within("latency"))
    }
}

/// Sample of the system at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MocapFrame {
    /// When it arrives at the controller: true time, ns since the run's beginning.
    pub arrival: i64,
    /// The body; `None` where too few of its markers are in view.
    pub pose: Option<MocapPose>,
}

/// Pose of a body as the system sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MocapPose {
    /// Of the tracked point in the world, m.
    pub position: DVec3,
    /// Body to world.
    pub orientation: DQuat,
    /// True for a wrong pose. Logs do not hold this: it is for tests of outlier detection.
    pub outlier: bool,
}

impl MocapPose {
    /// As a message.
    pub fn reading(&self) -> Reading<'static> {
        Reading::Pose { position: self.position, orientation: self.orientation }
    }
}

/// A motion-capture system that tracks one body.
#[derive(Debug, Clone)]
pub struct Mocap {
    parameters: MocapParameters,
    /// Chances that a sample begins a dropout, and that it is wrong.
    chances: [f64; 2],
    /// True time at which the markers are seen again, ns.
    seen_again: i64,
    latency: Latency,
    noise: Pcg64,
    dropouts: Pcg64,
    outliers: Pcg64,
}

impl Mocap {
    /// A system whose parameters have passed [`MocapParameters::validate`]. `sensor` names its streams of random numbers.
    pub fn new(parameters: &MocapParameters, seed: u64, sensor: &str) -> Self {
        let stream = |purpose: &str| streams::stream(seed, &format!("{sensor}/{purpose}"));
        // Of one or more events of a Poisson process within a period.
        let chance = |rate: f64| -(-rate * parameters.period).exp_m1();
        Self {
            chances: [chance(parameters.faults.dropout_rate), chance(parameters.faults.outlier_rate)],
            seen_again: i64::MIN,
            latency: Latency::new(&parameters.latency, seed, sensor),
            noise: stream("noise"),
            dropouts: stream("dropouts"),
            outliers: stream("outliers"),
            parameters: parameters.clone(),
        }
    }

    /// The frame at a true time, ns since the run's beginning, of a body at `position` (m) turned by `orientation` (body to world); to be
    /// called once a period.
    pub fn sample(&mut self, time: i64, position: DVec3, orientation: DQuat) -> MocapFrame {
        // Draws do not depend on losses, so that the remaining samples are the same with and without dropouts.
        let position = position + orientation * DVec3::from_array(self.parameters.position);
        let noise: [f64; 6] = std::array::from_fn(|_| streams::normal(&mut self.noise));
        let moved = self.parameters.position_noise * DVec3::new(noise[0], noise[1], noise[2]);
        let turned = self.parameters.orientation_noise * DVec3::new(noise[3], noise[4], noise[5]);
        let (position, orientation) = (position + moved, orientation * DQuat::from_scaled_axis(turned));
        let wrong = self.outlier();
        let arrival = self.latency.arrival(time);
        let pose = (!self.is_lost(time)).then(|| match wrong {
            Some((offset, orientation)) => MocapPose { position: position + offset, orientation, outlier: true },
            None => MocapPose { position, orientation, outlier: false },
        });
        MocapFrame { arrival, pose }
    }

    fn is_lost(&mut self, time: i64) -> bool {
        if time < self.seen_again {
            return true;
        }
        let lost = self.dropouts.random::<f64>() < self.chances[0];
        if lost {
            let uniform: f64 = self.dropouts.random();
            let length = -(-uniform).ln_1p() * self.parameters.faults.dropout_length;
            self.seen_again = time.saturating_add(nanoseconds(length));
        }
        lost
    }

    /// Offset and attitude of a wrong sample.
    fn outlier(&mut self) -> Option<(DVec3, DQuat)> {
        if self.outliers.random::<f64>() >= self.chances[1] {
            return None;
        }
        let [near, far] = self.parameters.faults.outlier_distance;
        let distance = near * (far / near).powf(self.outliers.random());
        let mut normals = || streams::normal(&mut self.outliers);
        let direction = DVec3::new(normals(), normals(), normals()).try_normalize().unwrap_or(DVec3::X);
        let attitude = DQuat::from_xyzw(normals(), normals(), normals(), normals());
        let attitude = if attitude.length_squared() > 1e-12 { attitude.normalize() } else { DQuat::IDENTITY };
        Some((distance * direction, attitude))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: i64 = 10_000_000;

    fn at(index: i64) -> (DVec3, DQuat) {
        let turn = index as f64 * 0.01;
        (
            DVec3::new(0.1 * turn.sin(), 0.05, 0.02),
            DQuat::from_rotation_z(0.3 * turn.cos()) * DQuat::from_rotation_x(0.1),
        )
    }

    fn samples(parameters: &MocapParameters, seed: u64, count: i64) -> Vec<Option<MocapPose>> {
        parameters.validate().unwrap();
        let mut mocap = Mocap::new(parameters, seed, "mocap");
        (0..count).map(|index| mocap.sample(index * PERIOD, at(index).0, at(index).1).pose).collect()
    }

    #[test]
    fn noise_has_its_deviations() {
        const SAMPLES: i64 = 20_000;
        let parameters = MocapParameters {
            position: [0.02, 0.0, 0.01],
            faults: MocapFaultParameters::none(),
            ..MocapParameters::default()
        };
        let (mut moved, mut turned) = (0.0, 0.0);
        for (index, sample) in (0..).zip(samples(&parameters, 1, SAMPLES)) {
            let (sample, (position, orientation)) = (sample.unwrap(), at(index));
            let point = position + orientation * DVec3::from_array(parameters.position);
            moved += (sample.position - point).length_squared();
            turned += (orientation.inverse() * sample.orientation).to_scaled_axis().length_squared();
            assert!((sample.orientation.length() - 1.0).abs() < 1e-12);
        }
        let count = 3.0 * SAMPLES as f64;
        for (sum, deviation) in [(moved, 27e-6), (turned, 0.0026f64)] {
            let ratio = sum / count / deviation.powi(2);
            assert!((ratio - 1.0).abs() < 5.0 * (2.0 / count).sqrt(), "{ratio}");
        }
    }

    /// Bursts alternate with sight: a burst of exponential length L loses `1 / (1 - exp(-T / L))` samples on average, sight lasts `1 / chance`.
    #[test]
    fn dropouts_come_at_their_rate_and_length() {
        let faults = MocapFaultParameters { dropout_rate: 0.5, dropout_length: 0.08, ..MocapFaultParameters::none() };
        let parameters = MocapParameters { faults, ..MocapParameters::default() };
        let lost: Vec<bool> = samples(&parameters, 2, 400_000).iter().map(Option::is_none).collect();
        let chance = 1.0 - (-0.5f64 * 0.01).exp();
        let mean_length = 1.0 / (1.0 - (-0.01f64 / 0.08).exp());
        let missing = lost.iter().filter(|&&lost| lost).count() as f64;
        let bursts = lost.windows(2).filter(|pair| !pair[0] && pair[1]).count() as f64;
        // Bursts that follow one another at once are seen as one.
        let seen = (lost.len() as f64 - missing) * chance;
        assert!((bursts - seen).abs() < 5.0 * seen.sqrt(), "{bursts} {seen}");
        let expected = mean_length / (1.0 - chance);
        assert!(
            (missing / bursts - expected).abs() < 5.0 * expected / bursts.sqrt(),
            "{} {expected}",
            missing / bursts
        );
    }

    #[test]
    fn outliers_come_at_their_rate_and_are_far_off() {
        const SAMPLES: i64 = 200_000;
        const RATE: f64 = 2.0;
        let faults = MocapFaultParameters { outlier_rate: RATE, ..MocapFaultParameters::default() };
        let parameters = MocapParameters { faults, ..MocapParameters::default() };
        let readings = samples(&parameters, 3, SAMPLES);
        let (mut outliers, mut near, mut seen) = (0f64, 0f64, 0f64);
        for (index, sample) in (0..).zip(&readings).filter_map(|(index, sample)| sample.map(|sample| (index, sample))) {
            let distance = (sample.position - at(index).0).length();
            seen += 1.0;
            if sample.outlier {
                outliers += 1.0;
                near += f64::from(distance < 5.0);
                assert!((0.499..50.01).contains(&distance), "{distance}");
            } else {
                assert!(distance < 1e-3, "{distance}");
            }
        }
        // Two in one period are seen as one; every order of magnitude is alike.
        let expected = seen * (1.0 - (-0.01 * RATE).exp());
        assert!((outliers - expected).abs() < 5.0 * expected.sqrt(), "{outliers} {expected}");
        assert!((near / outliers - 0.5).abs() < 5.0 * 0.5 / outliers.sqrt(), "{near} of {outliers}");
    }

    #[test]
    fn faults_leave_other_samples_unchanged() {
        let clean = MocapParameters { faults: MocapFaultParameters::none(), ..MocapParameters::default() };
        let faults = MocapFaultParameters { dropout_rate: 2.0, outlier_rate: 2.0, ..MocapFaultParameters::default() };
        let faulty = samples(&MocapParameters { faults, ..MocapParameters::default() }, 4, 5000);
        let (mut lost, mut wrong) = (0, 0);
        for (clean, faulty) in samples(&clean, 4, 5000).iter().zip(&faulty) {
            match faulty {
                None => lost += 1,
                Some(sample) if sample.outlier => wrong += 1,
                sample => assert_eq!(clean, sample),
            }
        }
        assert!(lost > 100 && wrong > 50, "{lost} {wrong}");
    }

    #[test]
    fn arrivals_are_late_and_in_order() {
        let mut mocap = Mocap::new(&MocapParameters::default(), 5, "mocap");
        let mut last = 0;
        for index in 0..20_000 {
            let arrival = mocap.sample(index * PERIOD, at(index).0, at(index).1).arrival;
            let delay = arrival - index * PERIOD;
            assert!((2_000_000..=30_000_000).contains(&delay) && arrival >= last, "{delay}");
            last = arrival;
        }
    }

    #[test]
    fn bad_mocap_parameters_are_refused() {
        let faults = MocapFaultParameters { outlier_distance: [1.0, 0.5], ..MocapFaultParameters::default() };
        let error = MocapParameters { faults, ..MocapParameters::default() }.validate().unwrap_err();
        assert_eq!((error.name.as_str(), error.value.as_str()), ("faults.outlier_distance[1]", "0.5"));
        let latency = LatencyParameters { mean: -1.0, ..LatencyParameters::default() };
        let error = MocapParameters { latency, ..MocapParameters::default() }.validate().unwrap_err();
        assert_eq!(error.name, "latency.mean");
    }
}
