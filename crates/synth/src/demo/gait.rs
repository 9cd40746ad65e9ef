//! Gait of a hexapod at each speed of its belt (Fig. 5 of Buchan, Haldane, Fearing, "Automatic Identification of
//! Dynamic Piecewise Affine Models for a Running Robot"). Stride frequency, and the speed over the belt beside the
//! prediction of equation (2) without slip.

use std::{
    f64::consts::{FRAC_PI_4, PI, TAU},
    path::PathBuf,
};

use fleetfoot_control::controller::DifferentialDrive;
use fleetfoot_data::{Halo, Progress, Source};
use fleetfoot_fit::Error;
use fleetfoot_recipe::Recipe;
use fleetfoot_stats::{Grid, Moments, reduce};
use serde::Serialize;

use super::view;

/// Bins of the leg phase.
pub const PHASE_BINS: usize = 24;
/// Rows of a chunk.
const CHUNK_ROWS: usize = 65_536;

/// Gait of one run.
#[derive(Debug, Clone, Serialize)]
#[non_exhaustive]
pub struct Gait {
    /// The episode's name.
    #[serde(rename = "run")]
    pub name: String,
    /// Rows.
    pub rows: u64,
    /// Mean speed of the belt, m/s.
    pub belt_speed: f64,
    /// Mean stride frequency of the two sides, Hz: a stride is a turn of the crank.
    pub stride_frequency: f64,
    /// Mean forward speed over the belt, m/s.
    pub speed: f64,
    /// Mean prediction of equation (2) from the cranks' rates, m/s.
    pub no_slip_speed: f64,
    /// Rows by leg phase, [`PHASE_BINS`] bins of `[-pi, pi)`.
    pub phases: Vec<u64>,
    /// Circular mean of the leg phase, rad.
    pub mean_phase: f64,
    /// Length of the mean of exp(i phase): 0 when all phases are as likely, 1 when there is only one.
    pub concentration: f64,
    /// Share of the rows whose phase is within pi / 4 of the alternating tripod's, 0. Evenly spread phases have a share of 1/4.
    pub tripod: f64,
}

/// The phase of a bin's centre, rad.
pub fn phase_of(bin: usize) -> f64 {
    (bin as f64 + 0.5) * TAU / PHASE_BINS as f64 - PI
}

/// The columns that it needs, over the names of the recipe. The leg phase is `alpha_l - alpha_r + pi`; 0 is the alternating tripod (III-A).
const COLUMNS: [(&str, &str, &str); 7] = [
    ("belt_speed", "belt_speed", "m/s"),
    ("speed", "vx + belt_speed*cos(yaw)", "m/s"),
    ("left", "alpha_l_rate", "rad/s"),
    ("right", "alpha_r_rate", "rad/s"),
    ("phase", "wrap(alpha_l - alpha_r + pi)", "rad"),
    ("cosine", "cos(alpha_l - alpha_r + pi)", "1"),
    ("sine", "sin(alpha_l - alpha_r + pi)", "1"),
];

struct Part {
    moments: Moments,
    phases: Vec<u64>,
    near: u64,
}

impl Part {
    fn new() -> Self {
        Self { moments: Moments::new(COLUMNS.len()), phases: vec![0; PHASE_BINS], near: 0 }
    }

    fn add(&mut self, columns: &[Vec<f64>; COLUMNS.len()]) {
        for &phase in &columns[4] {
            let bin = ((phase + PI) / TAU * PHASE_BINS as f64) as usize;
            self.phases[bin.min(PHASE_BINS - 1)] += 1;
            self.near += u64::from(phase.abs() <= FRAC_PI_4);
        }
        self.moments.merge(&Moments::of_columns(&columns.each_ref().map(Vec::as_slice)));
    }

    fn merge(&mut self, other: &Self) {
        self.moments.merge(&other.moments);
        self.phases.iter_mut().zip(&other.phases).for_each(|(a, b)| *a += b);
        self.near += other.near;
    }

    fn gait(&self, name: &str, drive: &DifferentialDrive) -> Gait {
        let [belt_speed, speed, left, right, _, cosine, sine] = std::array::from_fn(|i| self.moments.mean[i]);
        Gait {
            name: name.to_owned(),
            rows: self.moments.rows,
            belt_speed,
            stride_frequency: 0.5 * (left + right) / TAU,
            speed,
            no_slip_speed: drive.velocity([left, right])[0],
            phases: self.phases.clone(),
            mean_phase: sine.atan2(cosine),
            concentration: sine.hypot(cosine),
            tripod: self.near as f64 / self.moments.rows as f64,
        }
    }
}

/// Measures the gait of every run, in the order of belt speeds. The recipe names the hexapod's truth; `drive` is the
/// drive model of the robot's program.
///
/// # Errors
/// Logs that lack a needed column, and those of reading.
pub fn gaits(
    recipe: &Recipe,
    drive: &DifferentialDrive,
    files: &[PathBuf],
    progress: &dyn Progress,
) -> Result<Vec<Gait>, Error> {
    let columns: Result<Vec<_>, Error> =
        COLUMNS.iter().map(|(name, text, unit)| view::column(recipe, name, text, unit, *name == "phase")).collect();
    let model = view::columns_only(recipe, "gait", columns?);
    let dataset = view::open(&model, files, progress)?;
    let source = dataset.view()?;
    progress.stage("gait");
    let chunks = Grid { chunk_rows: CHUNK_ROWS }.chunks(source.episodes());
    let mut parts: Vec<Part> = source.episodes().iter().map(|_| Part::new()).collect();
    reduce(
        &source,
        &chunks,
        Halo::default(),
        progress,
        Part::new,
        |part, _, block, rows| {
            let complete: Vec<usize> =
                rows.filter(|&row| (0..COLUMNS.len()).all(|column| block.core(column)[row].is_finite())).collect();
            part.add(&std::array::from_fn(|column| complete.iter().map(|&row| block.core(column)[row]).collect()));
            Ok::<_, Error>(())
        },
        |chunk, part| {
            parts[chunk.episode].merge(&part);
            Ok(())
        },
    )?;
    let mut gaits: Vec<Gait> = source
        .episodes()
        .iter()
        .zip(&parts)
        .filter(|(_, part)| part.moments.rows > 0)
        .map(|(episode, part)| part.gait(&episode.name, drive))
        .collect();
    gaits.sort_by(|a, b| a.belt_speed.total_cmp(&b.belt_speed).then_with(|| a.name.cmp(&b.name)));
    Ok(gaits)
}
