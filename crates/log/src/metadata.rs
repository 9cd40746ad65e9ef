//! Metadata of a file beside its rows: keys and values.

use std::{collections::BTreeMap, path::Path};

use fleetfoot_data::Silent;

use crate::{Error, Format, containers, parquet};

/// The key-value metadata of a file; empty where there are none.
///
/// Of a Parquet file what `WriteOptions::metadata` of the crate `output` was; of MCAP the records named `fleetfoot`, what `McapOptions::metadata`
/// was; of ULog what its writer told of itself (`sys_name`, `ver_sw`, ...), parameters (`parameter.NAME`), their changes (`changed.NAME`) and their
/// defaults (`default.system.NAME`, `default.setup.NAME`).
///
/// # Errors
/// A file of another format, one that cannot be read, and a damaged one.
pub fn metadata(path: impl AsRef<Path>) -> Result<BTreeMap<String, String>, Error> {
    let path = path.as_ref();
    match Format::of(path) {
        Some(Format::Parquet) => parquet::metadata(path),
        Some(format) if format.is_log() => Ok(containers::open(path, format, &[], &Silent)?.metadata()),
        _ => Err(Error::UnknownFormat { path: path.into() }),
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_output::{McapOptions, McapWriter, ParquetWriter, WriteColumn, WriteKind, WriteOptions};

    use super::*;

    #[test]
    fn written_metadata_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let pairs = BTreeMap::from([("world".to_owned(), "a = 1\n".to_owned()), ("run".to_owned(), "3".to_owned())]);
        let path = folder.path().join("a.mcap");
        let options = McapOptions { metadata: pairs.clone(), ..McapOptions::default() };
        McapWriter::create(&path, &options).unwrap().finish().unwrap();
        assert_eq!(metadata(&path).unwrap(), pairs);
        McapWriter::create(&path, &McapOptions::default()).unwrap().finish().unwrap();
        assert!(metadata(&path).unwrap().is_empty());

        let path = folder.path().join("a.parquet");
        let options = WriteOptions { metadata: pairs.clone(), ..WriteOptions::default() };
        let columns = vec![WriteColumn::new("x", WriteKind::Float)];
        ParquetWriter::create(&path, columns, &options).unwrap().finish().unwrap();
        let values = metadata(&path).unwrap();
        assert!(pairs.iter().all(|(key, value)| values.get(key) == Some(value)), "{values:?}");

        for name in ["a.mcap", "a.parquet"] {
            std::fs::write(folder.path().join(name), b"short").unwrap();
            assert!(metadata(folder.path().join(name)).unwrap_err().to_string().contains(name));
        }
        assert!(metadata(folder.path().join("a.csv")).is_err());
    }
}
