//! The records of a piece, decompressed.

use super::{
    layout::{Piece, PieceKind},
    record::Chunk,
};
use crate::container::{Packing, with_unpacked};

/// Readable compressions of chunks, for messages.
pub(super) const KNOWN: &str = "zstd, lz4 or nothing";

/// Returns true if chunks compressed in this way can be read.
pub(super) fn is_known(compression: &[u8]) -> bool {
    compression.is_empty() || packing(compression).is_some()
}

fn packing(compression: &[u8]) -> Option<Packing> {
    match compression {
        b"zstd" => Some(Packing::Zstd),
        b"lz4" => Some(Packing::Lz4),
        _ => None,
    }
}

/// Hands the records of a piece to `use_records`, or says why the piece is lost.
pub(super) fn with_records<R>(file: &[u8], piece: &Piece, use_records: impl FnOnce(&[u8]) -> R) -> Result<R, String> {
    let bytes = file.get(piece.bytes.clone()).ok_or("it leaves the file")?;
    if piece.kind == PieceKind::Records {
        return Ok(use_records(bytes));
    }
    let chunk = Chunk::parse(bytes).ok_or("a chunk whose lengths do not fit")?;
    let use_checked = |records: &[u8]| {
        check(&chunk, records)?;
        Ok(use_records(records))
    };
    if chunk.compression.is_empty() {
        return use_checked(chunk.data);
    }
    let packing = packing(chunk.compression)
        .ok_or_else(|| format!("a chunk compressed by `{}`", String::from_utf8_lossy(chunk.compression)))?;
    with_unpacked(packing, chunk.data, chunk.uncompressed_size, use_checked)
}

fn check(chunk: &Chunk<'_>, records: &[u8]) -> Result<(), String> {
    if records.len() as u64 != chunk.uncompressed_size {
        return Err(format!("a chunk of {} bytes where its head says {}", records.len(), chunk.uncompressed_size));
    }
    if chunk.crc != 0 && crc32fast::hash(records) != chunk.crc {
        return Err("a chunk whose checksum is wrong".into());
    }
    Ok(())
}
