//! Logs of a robot with known truth, for the demonstration.

use std::path::{Path, PathBuf};

use fleetfoot_data::{Halo, Source};
use fleetfoot_log::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};
use fleetfoot_sim::DiffDrive;

use crate::Error;

/// Runs to fit on, and runs to score on.
const TRAINING_RUNS: u64 = 10;
const HELD_OUT_RUNS: u64 = 3;
/// Seconds of a run.
const DURATION: f64 = 120.0;

/// What was generated.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct DemoFiles {
    /// Logs to fit on.
    pub training: Vec<PathBuf>,
    /// Logs to score on.
    pub held_out: Vec<PathBuf>,
    /// The recipe for them.
    pub recipe: PathBuf,
    /// The robot that made them.
    pub robot: DiffDrive,
}

const RECIPE: &str = r#"# A wheeled robot with two motors: where it is follows from speed and heading; how speed and yaw rate change is fitted.
[states]
x = { known = "v*cos(yaw)", regressor = false }
y = { known = "v*sin(yaw)", regressor = false }
yaw = { known = "w", regressor = false, kind = "angle" }
v = {}
w = {}
[inputs]
left = "left"
right = "right"
[time]
column = "t"
[model]
partition = "null,average,zscore:1.5,kmeans:2,4,8,16,32"
partition_on = ["v", "w"]
"#;

/// Writes logs, one Parquet file a run, and a recipe into `folder`.
pub fn generate(folder: &Path, seed: u64) -> Result<DemoFiles, Error> {
    let io = |path: &Path| {
        let path = path.to_owned();
        move |source| Error::Write { path, source }
    };
    std::fs::create_dir_all(folder).map_err(io(folder))?;
    let robot = DiffDrive::default();
    let mut files = Vec::new();
    for run in 0..TRAINING_RUNS + HELD_OUT_RUNS {
        let path = folder.join(if run < TRAINING_RUNS {
            format!("train_{run:02}.parquet")
        } else {
            format!("test_{:02}.parquet", run - TRAINING_RUNS)
        });
        write_run(&robot.run(DURATION, seed.wrapping_mul(1_000).wrapping_add(run)), &path)?;
        files.push(path);
    }
    let recipe = folder.join("robot.toml");
    fleetfoot_log::write_atomic(&recipe, RECIPE.as_bytes())?;
    let held_out = files.split_off(TRAINING_RUNS as usize);
    Ok(DemoFiles { training: files, held_out, recipe, robot })
}

fn write_run(run: &dyn Source, path: &Path) -> Result<(), Error> {
    let mut columns = vec![WriteColumn::new("t", WriteKind::Stamp)];
    columns.extend(run.columns().iter().map(|column| {
        let written = WriteColumn::new(&column.name, WriteKind::Float);
        column.unit.iter().fold(written, |written, unit| written.with_unit(unit))
    }));
    let mut writer = ParquetWriter::create(path, columns, &WriteOptions::default())?;
    let block = run.read(0, 0..run.episodes()[0].rows, Halo::default())?;
    let mut values = vec![Values::Integer(block.stamps())];
    values.extend((0..run.columns().len()).map(|column| Values::Float(block.core(column))));
    writer.write(&values)?;
    writer.finish()?;
    Ok(())
}
