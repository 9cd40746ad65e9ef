//! Columns into text, row by row; the file appears whole or not at all.

use std::{
    borrow::Cow,
    io::{self, BufWriter, Write},
    path::{Path, PathBuf},
};

use crate::{
    atomic::AtomicFile,
    destination::check_outputs,
    error::Error,
    write_column::{WriteColumn, WriteKind},
    writer::{Values, check_names},
};

/// Writes delimited text: commas, or tabs for `*.tsv`. Numbers have as many digits as give the same number again, and
/// missing values are empty cells. Stamps are nanoseconds (their column is called `time_ns`, as `open` of `log` and
/// other readers understand it). An apostrophe stands before names and words that a spreadsheet would take for a
/// formula. Dropping it before [`CsvWriter::finish`] leaves no file.
#[derive(Debug)]
pub struct CsvWriter {
    path: PathBuf,
    columns: Vec<WriteColumn>,
    writer: csv::Writer<BufWriter<AtomicFile>>,
}

impl CsvWriter {
    /// Begins a file.
    ///
    /// # Errors
    /// A target that is one of the inputs, a folder or in a folder that is not there; two columns of one name.
    pub fn create(path: impl Into<PathBuf>, columns: Vec<WriteColumn>, inputs: &[PathBuf]) -> Result<Self, Error> {
        let path = path.into();
        check_outputs(&[&path], inputs)?;
        check_names(&path, &columns)?;
        let tabs = path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("tsv"));
        let file = BufWriter::new(AtomicFile::create(&path)?);
        let mut writer = csv::WriterBuilder::new().delimiter(if tabs { b'\t' } else { b',' }).from_writer(file);
        let name = |column: &WriteColumn| match column.kind {
            WriteKind::Stamp => no_formula(&column.name).into_owned() + "_ns",
            _ => no_formula(&column.name).into_owned(),
        };
        writer.write_record(columns.iter().map(name)).map_err(|problem| write_error(&path, problem))?;
        Ok(Self { path, columns, writer })
    }

    /// Appends rows: one slice a column, in the order of the columns, all of one length.
    ///
    /// # Errors
    /// Values that do not fit the columns; refusals of the system.
    pub fn write(&mut self, values: &[Values<'_>]) -> Result<(), Error> {
        let bad = |problem: String| Error::BadBatch { path: self.path.clone(), problem };
        if values.len() != self.columns.len() {
            return Err(bad(format!("{} columns of values for {} columns", values.len(), self.columns.len())));
        }
        let rows = values.first().map_or(0, length);
        for (column, values) in self.columns.iter().zip(values) {
            if length(values) != rows {
                return Err(bad(format!(
                    "column `{}` has {} values, the first has {rows}",
                    column.name,
                    length(values)
                )));
            }
            if !fits(column.kind, values) {
                return Err(bad(format!(
                    "column `{}` is {:?}, the values are of another kind",
                    column.name, column.kind
                )));
            }
        }
        let mut cell = String::new();
        for row in 0..rows {
            for values in values {
                cell.clear();
                text(values, row, &mut cell);
                self.writer.write_field(&cell).map_err(|problem| write_error(&self.path, problem))?;
            }
            self.writer.write_record(None::<&[u8]>).map_err(|problem| write_error(&self.path, problem))?;
        }
        Ok(())
    }

    /// Completes the file and gives it its name.
    ///
    /// # Errors
    /// A refusal of the system; there is then no file.
    pub fn finish(self) -> Result<(), Error> {
        let Self { path, writer, .. } = self;
        let error = |source: io::Error| Error::Io { path: path.clone(), action: "write", source };
        let mut buffer = writer.into_inner().map_err(|problem| error(io::Error::other(problem.to_string())))?;
        buffer.flush().map_err(error)?;
        let file = buffer.into_inner().map_err(|problem| error(io::Error::other(problem.to_string())))?;
        file.commit()
    }
}

fn length(values: &Values<'_>) -> usize {
    match values {
        Values::Float(values) => values.len(),
        Values::Integer(values) => values.len(),
        Values::Boolean(values) => values.len(),
        Values::Text(values) => values.len(),
    }
}

fn fits(kind: WriteKind, values: &Values<'_>) -> bool {
    matches!(
        (kind, values),
        (WriteKind::Float, Values::Float(_))
            | (WriteKind::Integer | WriteKind::Stamp, Values::Integer(_))
            | (WriteKind::Boolean, Values::Boolean(_))
            | (WriteKind::Text, Values::Text(_))
    )
}

fn text(values: &Values<'_>, row: usize, cell: &mut String) {
    match values {
        Values::Float(values) if values[row].is_nan() => {}
        // `{:?}` gives the shortest digits that read back, with an exponent where the number is far from 1.
        Values::Float(values) => *cell += &format!("{:?}", values[row]),
        Values::Integer(values) => *cell += &values[row].to_string(),
        Values::Boolean(values) => *cell += if values[row] { "true" } else { "false" },
        Values::Text(values) => *cell += &no_formula(values[row]),
    }
}

/// Words that no spreadsheet takes for a formula: an apostrophe stands before those that begin like one (OWASP, *CSV Injection*).
fn no_formula(text: &str) -> Cow<'_, str> {
    let is_minus = text.starts_with('-') && text.len() > 1 && text.parse::<f64>().is_err();
    if is_minus || text.starts_with(['=', '+', '@', '\t', '\r']) { format!("'{text}").into() } else { text.into() }
}

fn write_error(path: &Path, problem: csv::Error) -> Error {
    let source = match problem.into_kind() {
        csv::ErrorKind::Io(source) => source,
        other => io::Error::other(format!("{other:?}")),
    };
    Error::Io { path: path.into(), action: "write", source }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_spreadsheet_takes_words_for_a_formula() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("out.csv");
        let columns = ["=1+1", "@t", "x"].map(|name| WriteColumn::new(name, WriteKind::Text));
        let mut writer = CsvWriter::create(&path, columns.into(), &[]).unwrap();
        let cells: [&[&str]; 3] = [&["+cmd", "a=b"], &["\t=2", "-"], &["\r=3", "-1.5"]];
        writer.write(&cells.map(Values::Text)).unwrap();
        writer.finish().unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        assert_eq!(text, "'=1+1,'@t,x\n'+cmd,'\t=2,\"'\r=3\"\na=b,-,-1.5\n");
        assert_eq!(
            (no_formula("-2+3"), no_formula("-cmd|' /C calc'!A0")),
            ("'-2+3".into(), "'-cmd|' /C calc'!A0".into())
        );
    }

    #[test]
    fn the_inputs_and_equal_names_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("in.csv");
        std::fs::write(&path, "t,x\n0,1\n").unwrap();
        let column = || WriteColumn::new("x", WriteKind::Float);
        let message = CsvWriter::create(&path, vec![column()], std::slice::from_ref(&path)).unwrap_err().to_string();
        assert!(message.contains("in.csv"), "{message}");
        let other = folder.path().join("out.csv");
        let message = CsvWriter::create(&other, vec![column(), column()], &[]).unwrap_err().to_string();
        assert!(message.contains("two columns named `x`"), "{message}");
    }
}
