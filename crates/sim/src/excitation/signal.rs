//! Signals, sample by sample.

use rand_pcg::Pcg64;

use super::inverse_sampling::InverseSamplingSignal;
use super::multisine::MultisineSignal;
use super::pink::PinkSignal;
use super::prbs::PrbsSignal;
use super::random_steps::RandomStepsSignal;
use super::random_walk::RandomWalkSignal;
use super::{Chirp, Excitation, OrnsteinUhlenbeck, Sine};

impl Excitation {
    /// The signal, sampled every `dt` seconds: [`Signal::new`].
    pub fn signal(&self, dt: f64, random: Pcg64) -> Signal {
        Signal::new(self, dt, random)
    }
}

/// The signal of one channel, sampled at a fixed period. It owns its random numbers.
#[derive(Debug, Clone)]
pub struct Signal {
    generator: Generator,
    random: Pcg64,
    dt: f64,
    /// Samples given so far: times are products, so that they do not drift.
    count: u64,
}

#[derive(Debug, Clone)]
enum Generator {
    None,
    Sine(Sine),
    Multisine(MultisineSignal),
    Chirp(Chirp),
    Prbs(PrbsSignal),
    OrnsteinUhlenbeck { offset: f64, process: OrnsteinUhlenbeck },
    Pink(PinkSignal),
    RandomWalk(RandomWalkSignal),
    RandomSteps(RandomStepsSignal),
    InverseSampling(InverseSamplingSignal),
}

impl Signal {
    /// Sampled every `dt` seconds, with a stream of random numbers of its own. The parameters should have passed
    /// [`Excitation::validate`]; others give a signal of no use, but do no harm.
    pub fn new(excitation: &Excitation, dt: f64, mut random: Pcg64) -> Self {
        let generator = match excitation {
            Excitation::None => Generator::None,
            Excitation::Sine(parameters) => Generator::Sine(parameters.clone()),
            Excitation::Multisine(parameters) => Generator::Multisine(MultisineSignal::new(parameters, &mut random)),
            Excitation::Chirp(parameters) => Generator::Chirp(parameters.clone()),
            Excitation::Prbs(parameters) => Generator::Prbs(PrbsSignal::new(parameters, dt, &mut random)),
            Excitation::OrnsteinUhlenbeck(parameters) => Generator::OrnsteinUhlenbeck {
                offset: parameters.offset,
                process: OrnsteinUhlenbeck::new(parameters.deviation, parameters.correlation, dt, &mut random),
            },
            Excitation::Pink(parameters) => Generator::Pink(PinkSignal::new(parameters, dt, &mut random)),
            Excitation::RandomWalk(parameters) => {
                Generator::RandomWalk(RandomWalkSignal::new(parameters, dt, &mut random))
            }
            Excitation::RandomSteps(parameters) => Generator::RandomSteps(RandomStepsSignal::new(parameters, dt)),
            Excitation::InverseSampling(parameters) => {
                Generator::InverseSampling(InverseSamplingSignal::new(parameters, dt))
            }
        };
        Self { generator, random, dt, count: 0 }
    }

    /// Levels that a signal of held levels has drawn so far; 0 for the others.
    pub fn levels(&self) -> u64 {
        match &self.generator {
            Generator::Prbs(signal) => signal.levels(),
            Generator::RandomSteps(signal) => signal.levels(),
            Generator::InverseSampling(signal) => signal.levels(),
            _ => 0,
        }
    }

    /// The next sample, in the channel's unit; the first is that of time 0. `state` is what the channel drives as it is now, in
    /// the same unit: inverse sampling alone looks at it.
    pub fn next(&mut self, state: f64) -> f64 {
        let t = self.count as f64 * self.dt;
        self.count += 1;
        let random = &mut self.random;
        match &mut self.generator {
            Generator::None => 0.0,
            Generator::Sine(sine) => sine.value(t),
            Generator::Multisine(signal) => signal.value(t),
            Generator::Chirp(chirp) => chirp.value(t),
            Generator::Prbs(signal) => signal.next(),
            Generator::OrnsteinUhlenbeck { offset, process } => *offset + process.next(random),
            Generator::Pink(signal) => signal.next(random),
            Generator::RandomWalk(signal) => signal.next(random),
            Generator::RandomSteps(signal) => signal.next(random),
            Generator::InverseSampling(signal) => signal.next(state, random),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    fn samples(kind: &str, seed: u64) -> Vec<u64> {
        let excitation = Excitation::over(kind, -0.4, 1.2).unwrap();
        let mut signal = Signal::new(&excitation, 0.01, Pcg64::seed_from_u64(seed));
        let mut state = 0.0;
        let mut sample = || {
            let value = signal.next(state);
            assert!((-1.5..2.3).contains(&value), "{kind}: {value}");
            state += 0.02 * (value - state);
            value.to_bits()
        };
        (0..20_000).map(|_| sample()).collect()
    }

    #[test]
    fn the_seed_decides_every_bit() {
        for kind in Excitation::KINDS {
            assert_eq!(samples(kind, 7), samples(kind, 7));
            let fixed = ["none", "sine", "chirp"].contains(&kind);
            assert_eq!(samples(kind, 7) == samples(kind, 8), fixed, "{kind}");
        }
    }
}
