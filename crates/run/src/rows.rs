//! Rows of logs as columns in memory: those of a recipe, or those of a model with its predictions.

use fleetfoot_data::{Column, Halo, Progress, Source, ensure_memory, parallel_fold};
use fleetfoot_dataset::{Dataset, Logs, blocks::blocks};
use fleetfoot_dynamics::{Predicted, Predictor, PredictorWorkspace};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_recipe::Recipe;

/// Rows of logs, in their order, as columns.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct Rows {
    /// Names of the episodes.
    pub episodes: Vec<String>,
    /// The episode of each row.
    pub episode: Vec<u32>,
    /// When each row was measured, nanoseconds on the clock that the recording was read by.
    pub stamps: Vec<i64>,
    /// Seconds since the begin of the row's episode.
    pub seconds: Vec<f64>,
    /// The columns.
    pub columns: Vec<(Column, Vec<f64>)>,
    /// Assumptions and omissions.
    pub notes: Vec<String>,
}

/// Values of a model at rows.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct ModelRows {
    /// The rows, with the model's columns.
    pub rows: Rows,
    /// Names of the targets.
    pub targets: Vec<String>,
    /// True for a target that is an angle, so that errors wrap.
    pub wrapped: Vec<bool>,
    /// Measured targets, one column each; NaN where they cannot be measured.
    pub measured: Vec<Vec<f64>>,
    /// Predictions, one column each; NaN where there is none.
    pub predicted: Vec<Vec<f64>>,
    /// The region of each row in the first latent's partition; `u32::MAX` for none.
    pub region: Vec<u32>,
    /// Episodes that the model was trained on.
    pub in_sample: Vec<String>,
}

/// Reads columns of logs: aliases of the recipe, fields, or expressions over both. Without names: the recipe's states and inputs, else its aliases,
/// else all fields.
///
/// # Errors
/// An unknown name, or no column at all; those of opening and reading.
pub fn read_rows(
    recipe: &Recipe,
    names: Option<&[String]>,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<Rows, Error> {
    let dataset = Dataset::for_columns(recipe, names, logs, progress)?;
    let mut rows = Rows::of(&dataset);
    progress.stage("reading rows");
    let view = dataset.view()?;
    rows.reserve(&view, 0)?;
    let pieces = blocks(&view);
    parallel_fold(
        pieces.len(),
        progress,
        |piece| {
            let (episode, range) = pieces[piece].clone();
            Ok::<_, Error>((episode, view.read(episode, range, Halo::default())?))
        },
        |(episode, block)| {
            rows.add(episode, &block);
            Ok(())
        },
    )?;
    Ok(rows)
}

/// Runs a model on rows and keeps them all: the columns that it sees, measured targets and predictions.
///
/// # Errors
/// Those of opening, reading and of the model.
pub fn model_rows(
    model: &Model,
    changes: &Recipe,
    logs: impl Into<Logs>,
    progress: &dyn Progress,
) -> Result<ModelRows, Error> {
    let dataset = Dataset::for_model(model, changes, logs, progress)?;
    let view = dataset.view()?;
    let names: Vec<&str> = view.columns().iter().map(|column| column.name.as_str()).collect();
    let predictor = Predictor::new(model, &names)?;
    let targets = predictor.names().to_vec();
    let mut out = ModelRows {
        rows: Rows::of(&dataset),
        wrapped: (0..targets.len()).map(|target| predictor.wrapped(target)).collect(),
        measured: vec![Vec::new(); targets.len()],
        predicted: vec![Vec::new(); targets.len()],
        region: Vec::new(),
        in_sample: Vec::new(),
        targets,
    };
    out.rows.reserve(&view, 2 * out.targets.len())?;
    let pieces = blocks(&view);
    progress.stage("predict");
    parallel_fold(
        pieces.len(),
        progress,
        |piece| {
            let (episode, range) = pieces[piece].clone();
            let block = view.read(episode, range, predictor.halo())?;
            let mut predicted = Predicted::default();
            predictor.predict(&block, 0..block.rows, &mut PredictorWorkspace::default(), &mut predicted);
            Ok::<_, Error>((episode, block, predicted))
        },
        |(episode, block, predicted)| {
            out.rows.add(episode, &block);
            for target in 0..out.targets.len() {
                let of = |values| Predicted::equation(values, predicted.rows, target);
                out.measured[target].extend_from_slice(of(&predicted.measured));
                out.predicted[target].extend_from_slice(of(&predicted.predicted));
            }
            out.region.extend_from_slice(&predicted.region);
            Ok(())
        },
    )?;
    out.in_sample = dataset.in_sample(model);
    Ok(out)
}

impl Rows {
    fn of(dataset: &Dataset) -> Self {
        Self {
            episodes: dataset.episodes().iter().map(|episode| episode.name.clone()).collect(),
            notes: dataset.notes().to_vec(),
            ..Self::default()
        }
    }

    /// Columns with room for all rows of a source, beside so many more numbers a row that others keep.
    fn reserve(&mut self, source: &dyn Source, more: usize) -> Result<(), Error> {
        let rows: usize = source.episodes().iter().map(|episode| episode.rows).sum();
        let columns = source.columns();
        // Stamps, seconds and episodes beside the columns, and a column on its way to the caller.
        let numbers = columns.len() + more + 4;
        ensure_memory(
            rows.saturating_mul(8 * numbers),
            &format!("a table of {rows} rows and {} columns", columns.len()),
            "name the columns that are needed, or read the recordings in parts",
        )?;
        self.episode.reserve_exact(rows);
        self.stamps.reserve_exact(rows);
        self.seconds.reserve_exact(rows);
        self.columns = columns.iter().map(|column| (column.clone(), Vec::with_capacity(rows))).collect();
        Ok(())
    }

    fn add(&mut self, episode: usize, block: &fleetfoot_data::Block) {
        self.episode.extend(std::iter::repeat_n(episode as u32, block.rows));
        self.stamps.extend_from_slice(block.stamps());
        self.seconds.extend_from_slice(&block.seconds()[block.before..block.before + block.rows]);
        for (place, (_, values)) in self.columns.iter_mut().enumerate() {
            values.extend_from_slice(block.core(place));
        }
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::Silent;

    use super::*;

    fn csv(rows: usize) -> tempfile::NamedTempFile {
        let file = tempfile::Builder::new().suffix(".csv").tempfile().unwrap();
        let lines: String = (0..rows).map(|row| format!("{},{},{}\n", row as f64 * 0.1, row, 2 * row)).collect();
        std::fs::write(file.path(), format!("t,a,b\n{lines}")).unwrap();
        file
    }

    #[test]
    fn columns_aliases_and_expressions_are_read() {
        let file = csv(5);
        let recipe = Recipe::parse("[columns]\nsum = \"a + b\"\n", "test").unwrap();
        let names = ["sum".to_owned(), "b".to_owned(), "b - a".to_owned()];
        let rows = read_rows(&recipe, Some(&names), &vec![file.path().to_path_buf()], &Silent).unwrap();
        let of = |place: usize| rows.columns[place].1.clone();
        assert_eq!(of(0), [0.0, 3.0, 6.0, 9.0, 12.0]);
        assert_eq!(of(1), [0.0, 2.0, 4.0, 6.0, 8.0]);
        assert_eq!(of(2), [0.0, 1.0, 2.0, 3.0, 4.0]);
        assert_eq!(rows.stamps[1] - rows.stamps[0], 100_000_000);
        let all = read_rows(&Recipe::default(), None, &vec![file.path().to_path_buf()], &Silent).unwrap();
        assert_eq!(all.columns.iter().map(|(column, _)| column.name.as_str()).collect::<Vec<_>>(), ["t", "a", "b"]);
        let unknown = read_rows(&recipe, Some(&["c".to_owned()]), &vec![file.path().to_path_buf()], &Silent);
        assert!(unknown.unwrap_err().to_string().contains('c'));
    }
}
