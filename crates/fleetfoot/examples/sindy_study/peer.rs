//! pysindy on the same data, run by `peer.py` beside this file.

use std::{
    fs,
    path::{Path, PathBuf},
    process::Command,
};

use serde::Serialize;

use super::{
    Failure,
    candidates::{Candidates, Features},
    recordings::Recorded,
};

/// What the peer is asked: least squares with thresholds on one recording.
#[derive(Debug, Serialize)]
struct Case {
    folder: String,
    states: usize,
    inputs: usize,
    degree: u32,
    trigonometric: bool,
    period: f64,
    episodes: Vec<usize>,
    derivatives: bool,
    functions: usize,
    thresholds: Vec<f64>,
    ridge: f64,
}

/// The cases of one run of the peer: it starts slowly.
#[derive(Debug, Serialize)]
pub(crate) struct Peer {
    #[serde(skip)]
    folder: PathBuf,
    cases: Vec<Case>,
}

/// What a run of the peer found: of every case, of every threshold, the coefficients of every equation.
pub(crate) struct PeerFound {
    pub(crate) version: String,
    pub(crate) cases: Vec<Vec<Vec<Vec<f64>>>>,
}

impl Peer {
    /// A peer whose files go to a folder, which exists.
    pub(crate) fn new(folder: &Path) -> Self {
        Self { folder: folder.to_owned(), cases: Vec::new() }
    }

    /// Adds a recording: one fit for every threshold, with the given ridge.
    pub(crate) fn push(
        &mut self,
        recorded: &Recorded,
        features: Features,
        candidates: &Candidates,
        thresholds: &[f64],
        ridge: f64,
    ) -> Result<(), Failure> {
        let name = format!("case-{}", self.cases.len());
        let folder = self.folder.join(&name);
        fs::create_dir_all(&folder)?;
        write(&folder.join("states.f64"), &row_major(&recorded.states))?;
        if let Some(derivatives) = &recorded.derivatives {
            write(&folder.join("derivatives.f64"), &row_major(derivatives))?;
        }
        write(&folder.join("probe.f64"), &candidates.probe.concat())?;
        write(&folder.join("functions.f64"), &candidates.values.concat())?;
        self.cases.push(Case {
            folder: name,
            states: recorded.targets(),
            inputs: recorded.states[0].len() - recorded.targets(),
            degree: features.degree,
            trigonometric: features.trigonometric,
            period: recorded.period,
            episodes: recorded.states.iter().map(|columns| columns[0].len()).collect(),
            derivatives: recorded.derivatives.is_some(),
            functions: candidates.len(),
            thresholds: thresholds.to_vec(),
            ridge,
        });
        Ok(())
    }

    /// Runs the peer: the Python that `FLEETFOOT_PYTHON` names, else `python3`.
    ///
    /// # Errors
    /// The reason when it cannot run here.
    pub(crate) fn run(&self) -> Result<PeerFound, Failure> {
        fs::write(self.folder.join("request.toml"), toml::to_string(self)?)?;
        let python = std::env::var("FLEETFOOT_PYTHON").unwrap_or_else(|_| "python3".into());
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/sindy_study/peer.py");
        let output = Command::new(&python).arg(script).arg(&self.folder).output();
        let output = output.map_err(|error| format!("{python}: {error}"))?;
        if !output.status.success() {
            let talk = String::from_utf8_lossy(&output.stderr);
            return Err(talk.lines().last().unwrap_or("pysindy failed without a word").into());
        }
        let version = String::from_utf8_lossy(&output.stdout).lines().last().unwrap_or_default().trim().to_owned();
        let cases = self.cases.iter().map(|case| {
            let values = read(&self.folder.join(&case.folder).join("coefficients.f64"))?;
            let expected = case.thresholds.len() * case.states * case.functions;
            if values.len() != expected {
                return Err(
                    format!("pysindy gave {} coefficients for {}, not {expected}", values.len(), case.folder).into()
                );
            }
            let equations: Vec<Vec<f64>> = values.chunks_exact(case.functions).map(<[f64]>::to_vec).collect();
            Ok(equations.chunks_exact(case.states).map(<[_]>::to_vec).collect())
        });
        Ok(PeerFound { version, cases: cases.collect::<Result<_, Failure>>()? })
    }
}

/// Row after row, all states of a row together.
fn row_major(episodes: &[Vec<Vec<f64>>]) -> Vec<f64> {
    let rows =
        |columns: &[Vec<f64>]| (0..columns[0].len()).flat_map(|row| columns.iter().map(move |c| c[row])).collect();
    episodes.iter().flat_map(|columns| -> Vec<f64> { rows(columns) }).collect()
}

fn write(path: &Path, values: &[f64]) -> std::io::Result<()> {
    fs::write(path, values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>())
}

fn read(path: &Path) -> Result<Vec<f64>, Failure> {
    let bytes = fs::read(path)?;
    let (values, []) = bytes.as_chunks::<8>() else { return Err(format!("{}: a torn file", path.display()).into()) };
    Ok(values.iter().map(|value| f64::from_le_bytes(*value)).collect())
}
