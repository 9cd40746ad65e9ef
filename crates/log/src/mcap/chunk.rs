//! The records of a piece, decompressed.

use std::{
    cell::Cell,
    io::Read,
    sync::{Condvar, Mutex, PoisonError},
};

use lz4_flex::frame::FrameDecoder;
use zstd::zstd_safe::{DCtx, get_error_name};

use super::{
    layout::{Piece, PieceKind},
    record::Chunk,
};

/// A chunk that says it is larger is refused: writers make chunks of a megabyte or so.
const MAX_CHUNK: u64 = 1 << 30;

/// A chunk that grows to more than this and by more than [`MAX_RATIO`] is no log: zeros can be packed into next to nothing.
const FREE_GROWTH: u64 = 64 << 20;

/// Beyond [`FREE_GROWTH`], how many times its size a chunk may grow: robots' logs shrink by 2 to 50.
const MAX_RATIO: u64 = 1000;

/// Bytes that all chunks of more than [`FREE_GROWTH`] take together while they are read: others wait. One that takes more is read alone.
const LARGE: u64 = 512 << 20;

/// Bytes that a thread keeps for its next chunk.
const KEPT: usize = 64 << 20;

/// Readable compressions of chunks, for messages.
pub(super) const KNOWN: &str = "zstd, lz4 or nothing";

/// Returns true if chunks compressed in this way can be read.
pub(super) fn is_known(compression: &[u8]) -> bool {
    matches!(compression, b"" | b"zstd" | b"lz4")
}

/// Buffers and decompressors of a thread, kept from chunk to chunk.
#[derive(Default)]
struct Scratch {
    bytes: Vec<u8>,
    zstd: Option<DCtx<'static>>,
}

/// Bytes of large chunks that are being read.
static TAKEN: Mutex<u64> = Mutex::new(0);
static GIVEN_BACK: Condvar = Condvar::new();

/// Room for a large chunk, until it is dropped.
struct Room(u64);

impl Room {
    /// Waits until there is room for so many bytes. A thread that has some, whose callback reads another chunk, does not wait: it would wait for itself.
    fn wait(bytes: u64) -> Option<Self> {
        if bytes <= FREE_GROWTH {
            return None;
        }
        let mut taken = TAKEN.lock().unwrap_or_else(PoisonError::into_inner);
        while HELD.get() == 0 && *taken > 0 && *taken + bytes > LARGE {
            taken = GIVEN_BACK.wait(taken).unwrap_or_else(PoisonError::into_inner);
        }
        *taken += bytes;
        HELD.set(HELD.get() + bytes);
        Some(Self(bytes))
    }
}

impl Drop for Room {
    fn drop(&mut self) {
        *TAKEN.lock().unwrap_or_else(PoisonError::into_inner) -= self.0;
        HELD.set(HELD.get() - self.0);
        GIVEN_BACK.notify_all();
    }
}

thread_local! {
    /// Bytes of large chunks that this thread reads.
    static HELD: Cell<u64> = const { Cell::new(0) };
    // Taken while in use: work that a callback starts on the same thread gets its own.
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

/// Hands the records of a piece to `use_records`, or says why the piece is lost.
pub(super) fn with_records<R>(file: &[u8], piece: &Piece, use_records: impl FnOnce(&[u8]) -> R) -> Result<R, String> {
    let bytes = file.get(piece.bytes.clone()).ok_or("it leaves the file")?;
    if piece.kind == PieceKind::Records {
        return Ok(use_records(bytes));
    }
    let chunk = Chunk::parse(bytes).ok_or("a chunk whose lengths do not fit")?;
    if chunk.compression.is_empty() {
        check(&chunk, chunk.data)?;
        return Ok(use_records(chunk.data));
    }
    let _room = Room::wait(chunk.uncompressed_size.min(MAX_CHUNK));
    let mut scratch = SCRATCH.take().unwrap_or_default();
    let answer = scratch.decompress(&chunk).and_then(|()| {
        check(&chunk, &scratch.bytes)?;
        Ok(use_records(&scratch.bytes))
    });
    if scratch.bytes.capacity() > KEPT {
        scratch.bytes = Vec::new();
    }
    SCRATCH.set(Some(scratch));
    answer
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

impl Scratch {
    /// Fills `bytes` with the records of a chunk.
    fn decompress(&mut self, chunk: &Chunk<'_>) -> Result<(), String> {
        if chunk.uncompressed_size > MAX_CHUNK {
            return Err(format!("a chunk that says it has {} bytes, more than {MAX_CHUNK}", chunk.uncompressed_size));
        }
        let size = chunk.data.len() as u64;
        if chunk.uncompressed_size > FREE_GROWTH && chunk.uncompressed_size / MAX_RATIO > size {
            return Err(format!(
                "a chunk that unpacks from {size} to {} bytes, which no log does",
                chunk.uncompressed_size
            ));
        }
        let size = usize::try_from(chunk.uncompressed_size).map_err(|_| "a chunk that is too large")?;
        self.bytes.clear();
        match chunk.compression {
            b"zstd" => self.zstd(chunk.data, size),
            b"lz4" => self.lz4(chunk.data, size),
            other => Err(format!("a chunk compressed by `{}`", String::from_utf8_lossy(other))),
        }
    }

    /// In one go, which needs no window and no second copy. The room grows with what was really decompressed, never at once to what the
    /// chunk says it has; a chunk that compresses unusually well is begun again with more room, which the thread then keeps.
    fn zstd(&mut self, data: &[u8], size: usize) -> Result<(), String> {
        let context = match &mut self.zstd {
            Some(context) => context,
            none => none.insert(DCtx::try_create().ok_or("no memory for zstd")?),
        };
        let mut room = self.bytes.capacity().max(data.len().saturating_mul(8)).max(1 << 16).min(size);
        loop {
            self.bytes.clear();
            self.bytes.try_reserve_exact(room).map_err(|_| "no memory for a chunk")?;
            match context.decompress(&mut self.bytes, data) {
                Ok(_) => return Ok(()),
                Err(code) if get_error_name(code).contains("too small") && room < size => {
                    room = room.saturating_mul(4).min(size);
                }
                Err(code) => return Err(format!("a chunk that zstd cannot decompress ({})", get_error_name(code))),
            }
        }
    }

    fn lz4(&mut self, data: &[u8], size: usize) -> Result<(), String> {
        let room = data.len().saturating_mul(8).max(1 << 16).min(size);
        self.bytes.try_reserve(room).map_err(|_| "no memory for a chunk")?;
        let decoder = FrameDecoder::new(data);
        let read = decoder.take((size as u64).saturating_add(1)).read_to_end(&mut self.bytes);
        read.map(|_| ()).map_err(|error| format!("a chunk that lz4 cannot decompress ({error})"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_chunks_wait_for_room_and_a_thread_never_for_itself() {
        use std::sync::atomic::{AtomicU64, Ordering};
        let (now, most) = (AtomicU64::new(0), AtomicU64::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    let bytes = 200 << 20;
                    let _room = Room::wait(bytes);
                    most.fetch_max(now.fetch_add(bytes, Ordering::SeqCst) + bytes, Ordering::SeqCst);
                    std::thread::sleep(std::time::Duration::from_millis(5));
                    now.fetch_sub(bytes, Ordering::SeqCst);
                });
            }
        });
        assert!(most.into_inner() <= LARGE);
        let _room = Room::wait(MAX_CHUNK);
        let _another = Room::wait(MAX_CHUNK);
        assert!(Room::wait(FREE_GROWTH).is_none());
    }

    #[test]
    fn a_chunk_that_is_a_bomb_is_refused_without_unpacking_it() {
        let data = zstd::bulk::compress(&vec![0; 80 << 20], 1).unwrap();
        assert!(data.len() < 80_000, "{}", data.len());
        let chunk = |size: u64| Chunk {
            log_times: 0..=1,
            uncompressed_size: size,
            crc: 0,
            compression: b"zstd",
            data: &data,
            fills_its_record: true,
        };
        let mut scratch = Scratch::default();
        let why = scratch.decompress(&chunk(80 << 20)).unwrap_err();
        assert!(why.contains("no log") && scratch.bytes.capacity() == 0, "{why}");
        // One that lies about its size never gets more room than it asked for.
        assert!(scratch.decompress(&chunk(1 << 20)).is_err());
        assert!(scratch.bytes.capacity() <= 1 << 20);
    }
}
