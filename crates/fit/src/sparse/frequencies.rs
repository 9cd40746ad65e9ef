//! Coefficients and selection frequencies as a table in a file.

use std::path::{Path, PathBuf};

use fleetfoot_output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions};

use super::{CandidateReport, SparseReport};
use crate::error::Error;
use crate::method::Fitted;

/// Writes a row for every candidate of every model. Its columns are the value of the label (in a column of the label's
/// name), latent, function, selection frequency, selected or not, coefficient, its standard error, and the coefficient
/// of the lasso. Unknown values are NaN.
///
/// # Errors
/// Those of writing.
pub fn write_frequencies(
    path: &Path,
    label: Option<&str>,
    fitted: &[Fitted<SparseReport>],
    inputs: &[PathBuf],
) -> Result<(), Error> {
    let mut columns: Vec<WriteColumn> = label.iter().map(|label| WriteColumn::new(*label, WriteKind::Text)).collect();
    columns.extend(["latent", "function"].map(|name| WriteColumn::new(name, WriteKind::Text)));
    columns.push(WriteColumn::new("frequency", WriteKind::Float));
    columns.push(WriteColumn::new("selected", WriteKind::Boolean));
    columns.extend(["coefficient", "standard_error", "lasso"].map(|name| WriteColumn::new(name, WriteKind::Float)));
    let options = WriteOptions { inputs: inputs.to_vec(), ..WriteOptions::default() };
    let mut writer = ParquetWriter::create(path, columns, &options)?;
    for solution in fitted {
        let rows: Vec<(&str, &CandidateReport)> = solution
            .report
            .latents
            .iter()
            .flat_map(|latent| latent.candidates.iter().map(|candidate| (latent.name.as_str(), candidate)))
            .collect();
        let number = |of: fn(&CandidateReport) -> f64| rows.iter().map(|(_, row)| of(row)).collect::<Vec<f64>>();
        let values = vec![solution.value.as_deref().unwrap_or_default(); rows.len()];
        let latents: Vec<&str> = rows.iter().map(|(latent, _)| *latent).collect();
        let functions: Vec<&str> = rows.iter().map(|(_, row)| row.function.as_str()).collect();
        let frequency = number(|row| row.frequency.unwrap_or(f64::NAN));
        let selected: Vec<bool> = rows.iter().map(|(_, row)| row.selected).collect();
        let (coefficient, error) = (number(|row| row.coefficient), number(|row| row.standard_error));
        let lasso = number(|row| row.lasso);
        let mut cells = Vec::new();
        if label.is_some() {
            cells.push(Values::Text(&values));
        }
        cells.extend([Values::Text(&latents), Values::Text(&functions), Values::Float(&frequency)]);
        cells.push(Values::Boolean(&selected));
        cells.extend([Values::Float(&coefficient), Values::Float(&error), Values::Float(&lasso)]);
        writer.write(&cells)?;
    }
    Ok(writer.finish()?)
}
