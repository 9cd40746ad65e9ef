//! Files of arrays: NumPy's `.npy` and `.npz`, MATLAB's `.mat` of version 5 (up to `save -v7`).
//!
//! Formats: <https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html>, PKWARE's APPNOTE 6.3 and MathWorks' "MAT-File Format". A column is
//! an array, or a part of one, with as many values as most others of the file; what has another length is left out, with a note. Arrays are read
//! where they lie in the mapped file; packed ones in an unnamed temporary file. From there on they are a table in memory.

mod columns;
mod literal;
mod mat;
mod npy;
mod npz;
mod number;
mod table;
#[cfg(test)]
mod tests;

use std::{path::Path, sync::Arc};

use fleetfoot_data::Column;

use crate::{
    Compression, Error, Format, MemoryTable, Selection, TimeSpec,
    container::{Kind, Map},
    memory,
    opened::Opened,
    time_column::{Agreed, Clock},
};
use table::ArrayTable;

/// Description of a file that needs no values.
pub(crate) struct Description {
    /// Columns, each with why it cannot be read, if so.
    pub columns: Vec<(Column, Result<(), String>)>,
    pub clock: Option<Clock>,
    pub rows: usize,
    pub notes: Vec<String>,
}

/// Describes a file.
pub(crate) fn describe(path: &Path, format: Format) -> Result<Description, Error> {
    let table = read(path, format)?;
    let columns = table.columns().iter().cloned().zip(table.problems()).collect();
    let clock = memory::clock(&table, &TimeSpec::Auto);
    Ok(Description { columns, clock, rows: table.rows(), notes: table.notes().to_vec() })
}

/// Opens the selected columns of a file.
pub(crate) fn open(path: &Path, format: Format, selection: &Selection, agreed: &Agreed) -> Result<Opened, Error> {
    let table = read(path, format)?;
    let notes = table.notes().to_vec();
    let table: Arc<dyn MemoryTable> = Arc::new(table);
    let mut opened = memory::open(&table, selection, agreed)?;
    opened.notes.splice(0..0, notes);
    Ok(opened)
}

/// The clock of a file, as far as its first rows tell; `None` where it has none.
pub(crate) fn clock(path: &Path, format: Format, spec: &TimeSpec) -> Result<Option<Clock>, Error> {
    Ok(memory::clock(&read(path, format)?, spec))
}

fn read(path: &Path, format: Format) -> Result<ArrayTable, Error> {
    match format {
        Format::Npy => {
            let map = Map::open(path, Compression::None, Kind { name: "NumPy (.npy)", magic: npy::MAGIC })?;
            npy::table(path, Arc::new(map))
        }
        Format::Npz => {
            let map = Map::open(path, Compression::None, Kind { name: "NumPy (.npz)", magic: npz::MAGIC })?;
            npz::table(path, Arc::new(map))
        }
        _ => {
            let kind = Kind { name: "MATLAB (.mat)", magic: mat::MAGIC };
            let map = Map::open(path, Compression::None, Kind { magic: b"", ..kind })?;
            match () {
                () if map.starts_with(mat::MAGIC) => mat::table(path, Arc::new(map)),
                () if map.starts_with(mat::HDF5.0) || map.starts_with(mat::HDF5.1) => Err(mat::refused(path)),
                () => Err(map.refused(path, kind)),
            }
        }
    }
}
