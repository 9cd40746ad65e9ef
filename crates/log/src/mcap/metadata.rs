//! Metadata records.

use std::collections::BTreeMap;

use super::record::Fields;

/// The pairs of a record if it has this name and is sound.
pub(super) fn pairs(body: &[u8], name: &str) -> Option<BTreeMap<String, String>> {
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
