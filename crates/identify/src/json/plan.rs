//! What would be read, told before it is.

use serde::{Serialize, Serializer};

/// The decoded columns of robots' logs: their bytes, and whether the cache has them already.
#[derive(Serialize)]
pub(super) struct Decoded {
    decoded_bytes: Option<u64>,
    cached: Option<bool>,
}

impl From<Option<(u64, bool)>> for Decoded {
    fn from(decoded: Option<(u64, bool)>) -> Self {
        Self { decoded_bytes: decoded.map(|(bytes, _)| bytes), cached: decoded.map(|(_, cached)| cached) }
    }
}

pub(crate) fn decoded<S: Serializer>(decoded: &Option<(u64, bool)>, serializer: S) -> Result<S::Ok, S::Error> {
    Decoded::from(*decoded).serialize(serializer)
}
