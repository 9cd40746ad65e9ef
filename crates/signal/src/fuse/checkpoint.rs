//! State of a fusion after a round, as bytes: a killed fusion resumes from there, and its answer is the same to the
//! last bit.

use fleetfoot_data::mix;
use nalgebra::Quaternion;

use super::{
    BodyRun, FuseOptions, ImuNoise,
    noise::SINGLE,
    problem::Problem,
    rotation::{Rotation, Vector},
    state::State,
    track::Track,
};

/// Keeps where a fusion stands.
pub trait Checkpoint {
    /// The last saved state, if there is one.
    fn load(&mut self) -> Option<Vec<u8>>;

    /// Keeps this in place of what was kept before.
    fn save(&mut self, state: &[u8]);
}

/// Keeps nothing.
impl Checkpoint for () {
    fn load(&mut self) -> Option<Vec<u8>> {
        None
    }

    fn save(&mut self, _: &[u8]) {}
}

/// The bytes of this version begin so.
const VERSION: f64 = 2.0;

/// Progress of the rounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Progress {
    pub(super) round: usize,
    /// Steps of Gauss and Newton.
    pub(super) steps: usize,
    /// True while nodes still move.
    pub(super) moving: bool,
    /// By how much they moved last, s.
    pub(super) last: f64,
    /// Poses of tracks that were dropped.
    pub(super) contradicted: usize,
    /// Logarithms by which the variances of noise changed last.
    pub(super) changes: [f64; SINGLE],
    /// True once the noise no longer changes.
    pub(super) rested: bool,
}

impl Progress {
    pub(super) const BEGIN: Self = Self {
        round: 0,
        steps: 0,
        moving: true,
        last: f64::INFINITY,
        contradicted: 0,
        changes: [0.0; SINGLE],
        rested: false,
    };
}

/// A hash of all that the answer depends on.
pub(super) fn digest(runs: &[BodyRun<'_>], options: &FuseOptions) -> u64 {
    let mut hash = format!("{options:?}").bytes().fold(0, |hash, byte| mix(hash ^ u64::from(byte)));
    let mut add = |values: &[f64]| {
        hash = mix(hash ^ values.len() as u64);
        values.iter().for_each(|value| hash = mix(hash ^ value.to_bits()));
    };
    for BodyRun { imu, poses } in runs {
        [imu.times, imu.rates.as_flattened(), imu.forces.as_flattened(), &imu.averages].into_iter().for_each(&mut add);
        [poses.times, poses.positions.as_flattened(), poses.attitudes.as_flattened()].into_iter().for_each(&mut add);
    }
    hash
}

/// Numbers of a node.
const NODE: usize = 17;

/// Numbers before the tracks, about.
const HEAD: usize = 64;

/// Words that are written, and their hash.
struct Written {
    bytes: Vec<u8>,
    hash: u64,
}

impl Written {
    fn push(&mut self, word: f64) {
        self.hash = mix(self.hash ^ word.to_bits());
        self.bytes.extend(word.to_le_bytes());
    }

    fn all<'a>(&mut self, words: impl IntoIterator<Item = &'a f64>) {
        words.into_iter().for_each(|word| self.push(*word));
    }
}

/// Bytes of the problem's state.
pub(super) fn write(problem: &Problem<'_>, progress: &Progress, digest: u64) -> Vec<u8> {
    let Progress { round, steps, moving, last, contradicted, changes, rested } = *progress;
    let (border, setting) = (&problem.border, &problem.setting);
    let noise = &setting.noise;
    // Of a long record this is as much as all states: it is made once, and not grown.
    let nodes: usize = problem.tracks.iter().map(Track::nodes).sum();
    let words = HEAD + 9 * problem.tracks.len() + NODE * nodes + 1;
    let mut written = Written { bytes: Vec::with_capacity(8 * words), hash: 0 };
    written.all(&[VERSION, f64::from_bits(digest), round as f64, steps as f64, f64::from(u8::from(moving)), last]);
    written.all([f64::from(u8::from(rested))].iter().chain(&changes));
    written.all(&[contradicted as f64, setting.anchor, noise.position, noise.attitude, noise.jerk]);
    written.all(noise.imu.gyro.iter().chain(&noise.imu.accelerometer));
    written.all(&[noise.imu.gyro_walk, noise.imu.accelerometer_walk]);
    written.all(noise.imu.missed.iter().chain(noise.imu.scatter.as_flattened()));
    written.all(
        border.lever.iter().chain(border.gravity.iter()).chain(border.mounting.coords.iter()).chain([&border.late]),
    );
    written.push(problem.tracks.len() as f64);
    for track in &problem.tracks {
        written.all(&[track.run, track.first, track.nodes()].map(|number| number as f64));
        written.all(track.reference.iter().flatten());
        for (state, used) in track.states.iter().zip(&track.used) {
            let vectors = [&state.position, &state.velocity, &state.gyro, &state.accelerometer];
            written.all(state.attitude.coords.iter().chain(vectors.into_iter().flatten()));
            written.push(f64::from(u8::from(used[0])) + 2.0 * f64::from(u8::from(used[1])));
        }
    }
    let hash = written.hash;
    written.push(f64::from_bits(hash));
    written.bytes
}

/// Words, one after the other.
struct Words<'a>(&'a [u8]);

impl Words<'_> {
    fn next(&mut self) -> Option<f64> {
        let (word, rest) = self.0.split_first_chunk::<8>()?;
        self.0 = rest;
        Some(f64::from_le_bytes(*word))
    }

    fn number(&mut self) -> Option<usize> {
        self.next().map(|word| word as usize)
    }

    fn vector(&mut self) -> Option<Vector> {
        Some(Vector::new(self.next()?, self.next()?, self.next()?))
    }

    /// A rotation to the last bit: what was written had the norm that it had.
    fn rotation(&mut self) -> Option<Rotation> {
        let [i, j, k, w] = [self.next()?, self.next()?, self.next()?, self.next()?];
        Some(Rotation::new_unchecked(Quaternion::new(w, i, j, k)))
    }
}

/// Puts a problem where it stood; `None`, and the problem as it was, where these bytes are of another one, of another version, or damaged.
pub(super) fn restore(problem: &mut Problem<'_>, bytes: &[u8], digest: u64) -> Option<Progress> {
    let (body, sum) = bytes.split_at_checked(bytes.len().checked_sub(8)?)?;
    let mut all = Words(body);
    let checksum = std::iter::from_fn(|| all.next()).fold(0, |hash, word| mix(hash ^ word.to_bits()));
    let mut words = Words(body);
    let is_ours = body.len().is_multiple_of(8) && Words(sum).next()?.to_bits() == checksum;
    if !is_ours || words.next()? != VERSION || words.next()?.to_bits() != digest {
        return None;
    }
    let mut progress = Progress {
        round: words.number()?,
        steps: words.number()?,
        moving: words.next()? > 0.0,
        last: words.next()?,
        rested: words.next()? > 0.0,
        ..Progress::BEGIN
    };
    for change in &mut progress.changes {
        *change = words.next()?;
    }
    progress.contradicted = words.number()?;
    let (mut setting, mut border) = (problem.setting, problem.border);
    setting.anchor = words.next()?;
    [setting.noise.position, setting.noise.attitude, setting.noise.jerk] =
        [words.next()?, words.next()?, words.next()?];
    setting.noise.imu = ImuNoise {
        gyro: words.vector()?.into(),
        accelerometer: words.vector()?.into(),
        gyro_walk: words.next()?,
        accelerometer_walk: words.next()?,
        missed: [words.next()?, words.next()?],
        scatter: [words.vector()?.into(), words.vector()?.into()],
    };
    (border.lever, border.gravity) = (words.vector()?, words.vector()?);
    (border.mounting, border.late) = (words.rotation()?, words.next()?);
    let mut places = Vec::new();
    let count = words.number()?;
    for _ in 0..count {
        let [run, first, nodes] = [words.number()?, words.number()?, words.number()?];
        let is_track = |track: &Track<'_>| track.run == run && track.first == first && track.nodes() == nodes;
        let at = problem.tracks.iter().position(is_track)?;
        places.push((at, Words(words.0)));
        words.0 = words.0.get(8 * (6 + NODE * nodes)..)?;
    }
    (problem.setting, problem.border) = (setting, border);
    let mut kept = vec![false; problem.tracks.len()];
    for (at, mut words) in places {
        kept[at] = true;
        let track = &mut problem.tracks[at];
        track.reference = [words.vector()?, words.vector()?];
        for node in 0..track.nodes() {
            track.states[node] = State {
                attitude: words.rotation()?,
                position: words.vector()?,
                velocity: words.vector()?,
                gyro: words.vector()?,
                accelerometer: words.vector()?,
            };
            let used = words.number()?;
            track.used[node] = [used & 1 > 0, used & 2 > 0];
        }
    }
    let mut kept = kept.into_iter();
    problem.tracks.retain(|_| kept.next().unwrap_or(false));
    problem.sum();
    Some(progress)
}
