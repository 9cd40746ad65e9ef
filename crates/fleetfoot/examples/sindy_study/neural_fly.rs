//! The accelerations of a quadrotor in wind by sines and cosines: the table of Neural-Fly's recordings.

use std::{ops::Range, path::Path};

use fleetfoot::{
    Column, Halo, Source,
    library::{Expr, Scope, View, forward_difference},
};

use super::{
    Failure,
    candidates::{Candidates, Features},
    fit,
    peer::Peer,
    recordings::Recorded,
};

/// The recordings of the table with their winds, m/s.
pub(crate) const FILES: [(&str, &str); 4] =
    [("35wind.csv", "4.2"), ("70wind.csv", "8.5"), ("70p20sint.csv", "8.5 + 2.4 sin t"), ("100wind.csv", "12.1")];

/// Velocity (world frame, m/s), and the direction of the thrust times its command: `R e3 T_sp`.
const VARIABLES: [&str; 6] = ["v_x", "v_y", "v_z", "u_x", "u_y", "u_z"];

/// Sine and cosine at frequency one, and no constant: what pysindy's Fourier library has.
const FEATURES: Features = Features { degree: 0, trigonometric: true };

/// pysindy's own settings of its thresholds.
pub(crate) const THRESHOLD: f64 = 0.1;
pub(crate) const RIDGE: f64 = 0.05;

/// One recording: mean squared errors over the three axes, (m/s^2)^2, on the first half, which trains, and on the second.
#[derive(Debug)]
pub(crate) struct Row {
    pub(crate) wind: &'static str,
    pub(crate) least_squares: [f64; 2],
    pub(crate) stlsq: [f64; 2],
    /// pysindy's STLSQ: its errors, and the largest difference of a coefficient from ours.
    pub(crate) peer: Option<([f64; 2], f64)>,
}

/// The two halves of a recording, with the forward difference of the velocity.
struct Halves {
    train: Recorded,
    test: Recorded,
}

/// The table, and the peer's version or why it was not run.
pub(crate) fn table(folder: &Path) -> Result<(Vec<Row>, Result<String, String>), Failure> {
    let candidates = Candidates::new(&VARIABLES, FEATURES)?;
    let workspace = tempfile::tempdir()?;
    let mut peer = Peer::new(workspace.path());
    let mut rows = Vec::new();
    let mut fits = Vec::new();
    for (file, wind) in FILES {
        let halves = read(&folder.join(file))?;
        peer.push(&halves.train, FEATURES, &candidates, &[THRESHOLD], RIDGE)?;
        let problems = fit::Prepared::new(&VARIABLES, &halves.train, &candidates)?;
        let test = fit::Prepared::new(&VARIABLES, &halves.test, &candidates)?;
        let errors = |coefficients: &[Vec<f64>]| {
            [problems.mean_squared_error(coefficients), test.mean_squared_error(coefficients)]
        };
        let stlsq = problems.stlsq(&[THRESHOLD], RIDGE)?.swap_remove(0);
        rows.push(Row { wind, least_squares: errors(&problems.least_squares()?), stlsq: errors(&stlsq), peer: None });
        fits.push((problems, test, stlsq));
    }
    let version = match peer.run() {
        Err(reason) => Err(reason.to_string()),
        Ok(theirs) => {
            for ((row, (train, test, ours)), theirs) in rows.iter_mut().zip(&fits).zip(&theirs.cases) {
                let errors = [train.mean_squared_error(&theirs[0]), test.mean_squared_error(&theirs[0])];
                let apart = ours.iter().flatten().zip(theirs[0].iter().flatten()).map(|(a, b)| (a - b).abs());
                row.peer = Some((errors, apart.fold(0.0, f64::max)));
            }
            Ok(theirs.version)
        }
    };
    Ok((rows, version))
}

/// Prints the table as Markdown.
pub(crate) fn print(rows: &[Row], peer: &Result<String, String>) {
    println!(
        "| wind, m/s | least squares, train / test | STLSQ, train / test | pysindy's STLSQ | coefficients apart |"
    );
    println!("|---|---|---|---|---|");
    for row in rows {
        let [a, b] = row.least_squares;
        let [c, d] = row.stlsq;
        let peer = row.peer.map_or_else(
            || "| |".to_owned(),
            |([train, test], apart)| format!("| {train:.4} / {test:.4} | {apart:.0e} |"),
        );
        println!("| {} | {a:.4} / {b:.4} | {c:.4} / {d:.4} {peer}", row.wind);
    }
    match peer {
        Ok(version) => println!("\npysindy {version}: same library, same data, threshold {THRESHOLD}, ridge {RIDGE}"),
        Err(reason) => println!("\npysindy was not run: {reason} (FLEETFOOT_PYTHON names a Python that has it)"),
    }
}

/// A recording's two halves. Of n rows, n - 1 have a forward difference, and the first half of these trains.
fn read(path: &Path) -> Result<Halves, Failure> {
    let fields = ["v_x", "v_y", "v_z", "R_13", "R_23", "R_33", "T_sp"];
    let recording = fleetfoot::log::open(&[path], &fleetfoot::log::Selection::new(fields))?;
    let scope = Scope::new(fields);
    let thrust = [("u_x", "R_13*T_sp"), ("u_y", "R_23*T_sp"), ("u_z", "R_33*T_sp")];
    let mut columns = Vec::new();
    for name in &fields[..3] {
        columns.push((Column::float(*name), Expr::column(*name)));
    }
    for (name, text) in thrust {
        columns.push((Column::float(name), Expr::parse(text, &scope)?));
    }
    for name in &fields[..3] {
        columns.push((Column::float(format!("d_{name}")), forward_difference(&Expr::column(*name), false)));
    }
    let view = View::new(&recording, &columns)?;
    let [episode] = view.episodes() else {
        return Err(format!("{} has {} episodes, not one", path.display(), view.episodes().len()).into());
    };
    let differences = episode.rows.saturating_sub(1);
    let half = |range: Range<usize>| -> Result<Recorded, Failure> {
        let block = view.read(0, range, Halo::default())?;
        let columns = |which: Range<usize>| which.map(|column| block.core(column).to_vec()).collect();
        Ok(Recorded { period: episode.period, states: vec![columns(0..6)], derivatives: Some(vec![columns(6..9)]) })
    };
    Ok(Halves { train: half(0..differences / 2)?, test: half(differences / 2..differences)? })
}
