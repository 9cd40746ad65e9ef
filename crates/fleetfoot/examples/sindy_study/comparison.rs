//! The table: every system with exact derivatives, with differences, and with noise, beside the peer.

use super::{
    Failure,
    candidates::Candidates,
    fit::Prepared,
    judge::{Verdict, terms},
    peer::Peer,
    recordings::{self, Recorded},
    systems::System,
};

/// What is known of the states: their exact derivatives, or central differences of states with noise of a share of their standard deviations.
pub(crate) const DATA: [(&str, Option<f64>); 5] = [
    ("exact derivatives", None),
    ("differences", Some(0.0)),
    ("0.1 % noise", Some(0.001)),
    ("1 %", Some(0.01)),
    ("10 %", Some(0.1)),
];

/// pysindy's own threshold and ridge.
pub(crate) const THRESHOLD: f64 = 0.1;
const RIDGE: f64 = 0.05;

/// Thresholds that are tried: 13 from 0.01 to 1, six a decade, pysindy's own among them.
pub(crate) fn thresholds() -> Vec<f64> {
    (0..13).map(|k| if k == 6 { THRESHOLD } else { 0.01 * 10_f64.powf(f64::from(k) / 6.0) }).collect()
}

/// One recording of one system.
pub(crate) struct Case {
    pub(crate) system: &'static str,
    pub(crate) data: &'static str,
    /// STLSQ at pysindy's threshold.
    pub(crate) fixed: Verdict,
    /// STLSQ at the thresholds that held-out episodes choose, equation by equation: the fewest terms within one standard error of the least error.
    pub(crate) chosen: Verdict,
    /// The ensemble at pysindy's threshold.
    pub(crate) ensemble: Verdict,
    pub(crate) peer: Option<Beside>,
    /// STLSQ at every threshold.
    coefficients: Vec<Vec<Vec<f64>>>,
    truth: Vec<Vec<f64>>,
}

/// The peer's answers beside ours.
pub(crate) struct Beside {
    /// At its own threshold, and at the best of all, which only who knows the truth can tell.
    pub(crate) fixed: Verdict,
    pub(crate) best: Verdict,
    /// Thresholds at which all equations have the same terms, and the largest difference of their coefficients there, relative to the largest
    /// coefficient.
    pub(crate) same: usize,
    pub(crate) apart: f64,
}

/// All cases, and the peer's version or why it was not run.
pub(crate) struct Study {
    pub(crate) cases: Vec<Case>,
    pub(crate) peer: Result<String, String>,
}

/// Records and fits systems; the seed is that of where recordings begin, of the noise, and of the ensemble.
pub(crate) fn run(seed: u64, systems: &'static [System], beside_peer: bool) -> Result<Study, Failure> {
    let folder = tempfile::tempdir()?;
    let mut peer = Peer::new(folder.path());
    let mut cases = Vec::new();
    for system in systems {
        let candidates = Candidates::new(system.states, system.features)?;
        let clean = recordings::record(system, seed)?;
        for (data, noise) in DATA {
            let recorded = noise.map_or_else(|| clean.clone(), |level| clean.noisy(level, seed));
            if beside_peer {
                peer.push(&recorded, system.features, &candidates, &thresholds(), RIDGE)?;
            }
            cases.push(fit(system, data, &recorded, &candidates, seed)?);
        }
    }
    let answer = if beside_peer { peer.run() } else { Err("it was not asked for".into()) };
    let peer = match answer {
        Err(reason) => Err(reason.to_string()),
        Ok(output) => {
            for (case, theirs) in cases.iter_mut().zip(&output.cases) {
                case.peer = Some(Beside::new(case, theirs));
            }
            Ok(output.version)
        }
    };
    Ok(Study { cases, peer })
}

fn fit(
    system: &'static System,
    data: &'static str,
    recorded: &Recorded,
    candidates: &Candidates,
    seed: u64,
) -> Result<Case, Failure> {
    let truth = system.equations.iter().map(|terms| candidates.coefficients(system.states, terms));
    let truth: Vec<Vec<f64>> = truth.collect::<Result<_, _>>()?;
    let prepared = Prepared::new(system.states, recorded, candidates)?;
    let coefficients = prepared.stlsq(&thresholds(), RIDGE)?;
    let (fixed, _) = verdicts(&coefficients, &truth);
    let chosen = Verdict::new(&prepared.chosen(&thresholds(), RIDGE)?, &truth);
    let ensemble = Verdict::new(&prepared.ensemble(THRESHOLD, RIDGE, seed)?, &truth);
    Ok(Case { system: system.name, data, fixed, chosen, ensemble, peer: None, coefficients, truth })
}

/// At pysindy's threshold, and the best.
fn verdicts(coefficients: &[Vec<Vec<f64>>], truth: &[Vec<f64>]) -> (Verdict, Verdict) {
    let all: Vec<Verdict> = coefficients.iter().map(|equations| Verdict::new(equations, truth)).collect();
    let fixed = thresholds().iter().position(|&threshold| threshold == THRESHOLD).map_or(all[0], |at| all[at]);
    (fixed, all.iter().fold(fixed, |best, next| if next.is_better_than(&best) { *next } else { best }))
}

impl Beside {
    fn new(case: &Case, theirs: &[Vec<Vec<f64>>]) -> Self {
        let (fixed, best) = verdicts(theirs, &case.truth);
        let (mut same, mut apart) = (0, 0.0_f64);
        for (ours, theirs) in case.coefficients.iter().zip(theirs) {
            let pairs = || ours.iter().flatten().zip(theirs.iter().flatten());
            if ours.iter().zip(theirs).all(|(a, b)| terms(a) == terms(b)) {
                same += 1;
                let scale = pairs().fold(f64::MIN_POSITIVE, |scale, (a, b)| scale.max(a.abs()).max(b.abs()));
                apart = pairs().fold(apart, |apart, (a, b)| apart.max((a - b).abs() / scale));
            }
        }
        Self { fixed, best, same, apart }
    }
}
