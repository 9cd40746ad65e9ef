//! Parameters of the signal that drives a channel.

use serde::{Deserialize, Serialize};

use super::{Chirp, InverseSampling, Multisine, OrnsteinUhlenbeckNoise, Pink, Prbs, RandomSteps, RandomWalk, Sine};
use crate::ParameterError;

/// Signal that drives one channel. Levels are in the channel's unit (m/s, rad/s, V), frequencies in Hz, times in s.
///
/// In a world file: `excitation.v = { kind = "multisine", deviation = 0.3, lowest = 0.1, highest = 3.0, count = 20 }`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "kebab-case")]
#[non_exhaustive]
pub enum Excitation {
    /// 0 all the time.
    #[default]
    None,
    /// A sine.
    Sine(Sine),
    /// A sum of sines of one amplitude, equally spaced in frequency.
    Multisine(Multisine),
    /// A sine whose frequency sweeps up and down.
    Chirp(Chirp),
    /// A pseudo-random binary sequence of maximum length.
    Prbs(Prbs),
    /// Gaussian noise with an exponential autocorrelation.
    OrnsteinUhlenbeck(OrnsteinUhlenbeckNoise),
    /// Gaussian noise whose power density falls as 1/f over a band.
    Pink(Pink),
    /// A random walk between two reflecting levels.
    RandomWalk(RandomWalk),
    /// Levels drawn uniformly and held.
    RandomSteps(RandomSteps),
    /// Levels drawn where the channel's state has been least.
    InverseSampling(InverseSampling),
}

impl Excitation {
    /// The kinds as a world file spells them, in the order of the variants.
    pub const KINDS: [&str; 10] = [
        "none",
        "sine",
        "multisine",
        "chirp",
        "prbs",
        "ornstein-uhlenbeck",
        "pink",
        "random-walk",
        "random-steps",
        "inverse-sampling",
    ];

    /// This kind's default over a channel's range: bounded signals fill `[low, high]`; those with a long tail have a standard
    /// deviation of a fifth of the range, so that what drives the channel should saturate them there.
    ///
    /// # Errors
    /// A kind that is not in [`Excitation::KINDS`].
    pub fn over(kind: &str, low: f64, high: f64) -> Result<Self, ParameterError> {
        let offset = (low + high) / 2.0;
        let amplitude = (high - low) / 2.0;
        let deviation = (high - low) / 5.0;
        Ok(match kind {
            "none" => Self::None,
            "sine" => Self::Sine(Sine { offset, amplitude, ..Sine::default() }),
            "multisine" => Self::Multisine(Multisine { offset, deviation, ..Multisine::default() }),
            "chirp" => Self::Chirp(Chirp { offset, amplitude, ..Chirp::default() }),
            "prbs" => Self::Prbs(Prbs { offset, amplitude, ..Prbs::default() }),
            "ornstein-uhlenbeck" => Self::OrnsteinUhlenbeck(OrnsteinUhlenbeckNoise {
                offset,
                deviation,
                ..OrnsteinUhlenbeckNoise::default()
            }),
            "pink" => Self::Pink(Pink { offset, deviation, ..Pink::default() }),
            "random-walk" => Self::RandomWalk(RandomWalk { low, high, rate: amplitude / 2.0 }),
            "random-steps" => Self::RandomSteps(RandomSteps { low, high, ..RandomSteps::default() }),
            "inverse-sampling" => Self::InverseSampling(InverseSampling { low, high, ..InverseSampling::default() }),
            _ => return Err(ParameterError::new("excitation", kind, format!("one of {}", Self::KINDS.join(", ")))),
        })
    }

    /// The kind as a world file spells it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Sine(_) => "sine",
            Self::Multisine(_) => "multisine",
            Self::Chirp(_) => "chirp",
            Self::Prbs(_) => "prbs",
            Self::OrnsteinUhlenbeck(_) => "ornstein-uhlenbeck",
            Self::Pink(_) => "pink",
            Self::RandomWalk(_) => "random-walk",
            Self::RandomSteps(_) => "random-steps",
            Self::InverseSampling(_) => "inverse-sampling",
        }
    }

    /// Checks that the parameters make a signal when sampled every `dt` seconds.
    ///
    /// # Errors
    /// The first invalid parameter, with its allowed values.
    pub fn validate(&self, dt: f64) -> Result<(), ParameterError> {
        match self {
            Self::None => Ok(()),
            Self::Sine(parameters) => parameters.validate(dt),
            Self::Multisine(parameters) => parameters.validate(dt),
            Self::Chirp(parameters) => parameters.validate(dt),
            Self::Prbs(parameters) => parameters.validate(dt),
            Self::OrnsteinUhlenbeck(parameters) => parameters.validate(),
            Self::Pink(parameters) => parameters.validate(dt),
            Self::RandomWalk(parameters) => parameters.validate(),
            Self::RandomSteps(parameters) => parameters.validate(dt),
            Self::InverseSampling(parameters) => parameters.validate(dt),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn world_file_holds_valid_defaults() {
        #[derive(Debug, PartialEq, Serialize, Deserialize)]
        struct World {
            v: Excitation,
        }
        for kind in Excitation::KINDS {
            let v = Excitation::over(kind, -0.5, 1.5).unwrap();
            assert_eq!(v.kind(), kind);
            v.validate(0.01).unwrap();
            let text = toml::to_string(&World { v: v.clone() }).unwrap();
            assert_eq!(toml::from_str::<World>(&text).unwrap().v, v, "{text}");
            let bare: World = toml::from_str(&format!("v = {{ kind = \"{kind}\" }}")).unwrap();
            bare.v.validate(0.01).unwrap();
            assert_eq!(bare.v.kind(), kind);
        }
        let error = toml::from_str::<World>("v = { kind = \"sine\", amplitud = 1.0 }").unwrap_err().to_string();
        assert!(error.contains("amplitud"), "{error}");
        assert!(Excitation::over("white", 0.0, 1.0).is_err());
    }

    #[test]
    fn errors_name_parameter_value_and_range() {
        let excitation = Excitation::Sine(Sine { frequency: 60.0, ..Sine::default() });
        let error = excitation.validate(0.01).unwrap_err().within("excitation.w").to_string();
        for part in ["excitation.w.frequency", "60", "50"] {
            assert!(error.contains(part), "{error}");
        }
        let bad = [
            Excitation::Sine(Sine { amplitude: f64::NAN, ..Sine::default() }),
            Excitation::Multisine(Multisine { count: 0, ..Multisine::default() }),
            Excitation::Multisine(Multisine { lowest: 5.0, highest: 1.0, ..Multisine::default() }),
            Excitation::Chirp(Chirp { lowest: 0.0, ..Chirp::default() }),
            Excitation::Prbs(Prbs { order: 1, ..Prbs::default() }),
            Excitation::Prbs(Prbs { clock: 0.001, ..Prbs::default() }),
            Excitation::OrnsteinUhlenbeck(OrnsteinUhlenbeckNoise { correlation: 0.0, ..Default::default() }),
            Excitation::Pink(Pink { highest: 80.0, ..Pink::default() }),
            Excitation::RandomWalk(RandomWalk { low: 1.0, high: 1.0, ..RandomWalk::default() }),
            Excitation::RandomSteps(RandomSteps { longest: 0.1, ..RandomSteps::default() }),
            Excitation::InverseSampling(InverseSampling { bins: 1, ..InverseSampling::default() }),
        ];
        for excitation in bad {
            assert!(excitation.validate(0.01).is_err(), "{excitation:?}");
        }
    }
}
