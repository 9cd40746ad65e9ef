//! References drawn in inverse proportion to the visits of the state.

use rand_pcg::Pcg64;
use serde::{Deserialize, Serialize};

use super::check::{hold, interval, samples, that, time};
use super::{Axis, Histogram, uniform};
use crate::ParameterError;
use crate::parameter_error::positive;

/// References drawn with a probability inverse to the visits of the channel's state: Towards Sim-to-Real via Real-to-Sim,
/// section 6.1, `p_inv(x) = 1 / p(x)`, normalised, over the bins of a histogram; uniform inside a bin.
///
/// The histogram is of the states that were reached, not of the references: what the robot or its walls do not let it
/// follow is asked for again.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct InverseSampling {
    /// Of the references and of the histogram, in the channel's unit.
    pub low: f64,
    /// Of the references and of the histogram, in the channel's unit.
    pub high: f64,
    /// Bins of the histogram.
    pub bins: usize,
    /// Hold of a reference, s.
    pub shortest: f64,
    /// Hold of a reference, s.
    pub longest: f64,
    /// Time between two computations of the probabilities, s; they are uniform before the first.
    pub resampling: f64,
    /// Time that each bin counts as visited before the start, s: without it a bin without a visit would take everything.
    pub prior: f64,
}

impl Default for InverseSampling {
    fn default() -> Self {
        Self { low: -1.0, high: 1.0, bins: 20, shortest: 0.5, longest: 2.0, resampling: 5.0, prior: 0.5 }
    }
}

impl InverseSampling {
    pub(super) fn validate(&self, dt: f64) -> Result<(), ParameterError> {
        interval(self.low, self.high)?;
        that((2..=100_000).contains(&self.bins), "bins", self.bins, "2 to 100000")?;
        hold(self.shortest, self.longest, dt)?;
        time("resampling", self.resampling, dt)?;
        positive("prior", self.prior)
    }
}

#[derive(Debug, Clone)]
pub(super) struct InverseSamplingSignal {
    hold: [f64; 2],
    dt: f64,
    visits: Histogram,
    /// Of every bin, in visits.
    prior: f64,
    /// Running sums of the bins' unnormalised probabilities.
    cumulative: Vec<f64>,
    resampling: u64,
    until_resampling: u64,
    value: f64,
    left: u64,
    levels: u64,
}

impl InverseSamplingSignal {
    pub(super) fn new(parameters: &InverseSampling, dt: f64) -> Self {
        let bins = parameters.bins.max(1);
        let resampling = samples(parameters.resampling, dt);
        Self {
            hold: [parameters.shortest, parameters.longest],
            dt,
            visits: Histogram::new([Axis { low: parameters.low, high: parameters.high, bins }]),
            prior: parameters.prior / dt,
            cumulative: (1..=bins).map(|bin| bin as f64).collect(),
            resampling,
            until_resampling: resampling,
            value: 0.0,
            left: 0,
            levels: 0,
        }
    }

    pub(super) fn levels(&self) -> u64 {
        self.levels
    }

    /// Counts the state as visited, and gives the reference.
    pub(super) fn next(&mut self, state: f64, random: &mut Pcg64) -> f64 {
        self.visits.add(&[state]);
        self.until_resampling -= 1;
        if self.until_resampling == 0 {
            self.until_resampling = self.resampling;
            self.resample();
        }
        if self.left == 0 {
            self.value = self.draw(random);
            self.levels += 1;
            self.left = samples(uniform(self.hold[0], self.hold[1], random), self.dt);
        }
        self.left -= 1;
        self.value
    }

    /// The probabilities from the visits so far. Their common factor is left out.
    fn resample(&mut self) {
        let mut sum = 0.0;
        for (cumulative, &visits) in self.cumulative.iter_mut().zip(self.visits.counts()) {
            sum += 1.0 / (visits as f64 + self.prior);
            *cumulative = sum;
        }
    }

    fn draw(&self, random: &mut Pcg64) -> f64 {
        let target = uniform(0.0, self.cumulative.last().copied().unwrap_or(0.0), random);
        let last = self.cumulative.len().saturating_sub(1);
        let bin = self.cumulative.partition_point(|&cumulative| cumulative <= target).min(last);
        let [low, high] = self.visits.axes()[0].edges(bin);
        uniform(low, high, random)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::excitation::{Excitation, RandomSteps, RandomWalk, Signal};
    use rand::SeedableRng;

    #[test]
    fn references_are_drawn_inversely_to_the_visits() {
        let parameters =
            InverseSampling { bins: 4, resampling: 10.0, prior: 1e-9, longest: 0.5, ..InverseSampling::default() };
        let mut random = Pcg64::seed_from_u64(1);
        let mut signal = InverseSamplingSignal::new(&parameters, 0.01);
        // Visits in the proportions 1 : 2 : 3 : 4, a thousand samples up to the first computation.
        for k in 0..1000 {
            let bin = [0, 1, 1, 2, 2, 2, 3, 3, 3, 3][k % 10];
            signal.next(-0.75 + 0.5 * f64::from(bin), &mut random);
        }
        let weights = [1.0, 1.0 / 2.0, 1.0 / 3.0, 1.0 / 4.0];
        let mut drawn = Histogram::new([Axis { low: -1.0, high: 1.0, bins: 4 }]);
        (0..100_000).for_each(|_| drawn.add(&[signal.draw(&mut random)]));
        for (bin, weight) in weights.iter().enumerate() {
            let expected = 1e5 * weight / weights.iter().sum::<f64>();
            let count = drawn.counts()[bin] as f64;
            assert!((count - expected).abs() < 5.0 * expected.sqrt(), "{bin}: {count} {expected}");
        }
    }

    /// Non-uniformity of the states of a slow follower: first order with a time constant of 0.8 s, its acceleration limited.
    fn states(excitation: &Excitation, seed: u64) -> f64 {
        const DT: f64 = 0.01;
        excitation.validate(DT).unwrap();
        let mut signal = Signal::new(excitation, DT, Pcg64::seed_from_u64(seed));
        let mut visits = Histogram::new([Axis { low: -1.0, high: 1.0, bins: 20 }]);
        let mut state = 0.0;
        for _ in 0..200_000 {
            let reference = signal.next(state);
            state += DT * ((reference - state) / 0.8f64).clamp(-1.5, 1.5);
            visits.add(&[state]);
        }
        visits.nonuniformity()
    }

    #[test]
    fn states_are_visited_more_uniformly_than_by_random_references() {
        let mean = |excitation: Excitation| (0..6).map(|seed| states(&excitation, seed)).sum::<f64>() / 6.0;
        let inverse = mean(Excitation::InverseSampling(InverseSampling::default()));
        let steps = mean(Excitation::RandomSteps(RandomSteps::default()));
        let walk = mean(Excitation::RandomWalk(RandomWalk::default()));
        assert!(inverse < 0.5 * steps && inverse < 0.7 * walk, "{inverse} {steps} {walk}");
    }
}
