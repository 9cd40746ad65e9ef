//! Metadata records.

use std::{collections::BTreeMap, path::Path};

use mcap::{MAGIC, records::op};

use super::{
    map::Map,
    record::{Fields, sound_record_at},
};
use crate::{Compression, Error};

/// The pairs of all metadata records of a name; a later record's value of a key stands.
///
/// Hops over the records of the data section up to the first damage: the index of metadata is optional.
pub(crate) fn metadata(path: &Path, compression: Compression, name: &str) -> Result<BTreeMap<String, String>, Error> {
    let map = Map::open(path, compression)?;
    let mut pairs = BTreeMap::new();
    let mut at = MAGIC.len();
    while let Ok(record) = sound_record_at(&map, at) {
        match record.opcode {
            op::DATA_END => break,
            op::METADATA => pairs.extend(named(record.body, name).unwrap_or_default()),
            _ => {}
        }
        at = record.end();
    }
    Ok(pairs)
}

/// The pairs of a record if it has this name and is sound.
fn named(body: &[u8], name: &str) -> Option<BTreeMap<String, String>> {
    let mut fields = Fields(body);
    if fields.bytes()? != name.as_bytes() {
        return None;
    }
    let mut entries = Fields(fields.bytes()?);
    let mut pairs = BTreeMap::new();
    while !entries.0.is_empty() {
        let mut text = || String::from_utf8(entries.bytes()?.to_vec()).ok();
        pairs.insert(text()?, text()?);
    }
    Some(pairs)
}
