//! Blocks of messages, unpacked into memory that threads keep and share within bounds.

use std::{
    cell::Cell,
    io::Read,
    sync::{Condvar, Mutex, PoisonError},
};

use bzip2::read::BzDecoder;
use lz4_flex::frame::FrameDecoder;
use zstd::zstd_safe::{DCtx, get_error_name};

/// Largest unpacked block, bytes: writers make blocks of a megabyte or so.
const MAX_BLOCK: u64 = 1 << 30;

/// A block that grows to more than this and by more than [`MAX_RATIO`] is no log: zeros can be packed into next to nothing.
const FREE_GROWTH: u64 = 64 << 20;

/// Beyond [`FREE_GROWTH`], how many times its size a block may grow: robots' logs shrink by 2 to 50.
const MAX_RATIO: u64 = 1000;

/// Bytes that all blocks of more than [`FREE_GROWTH`] take together while they are read: others wait. One that takes more is read alone.
const LARGE: u64 = 512 << 20;

/// Bytes that a thread keeps for its next block.
const KEPT: usize = 64 << 20;

/// Packings of blocks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Packing {
    /// A frame of Zstandard.
    Zstd,
    /// A frame of LZ4.
    Lz4,
    /// A stream of bzip2.
    Bzip2,
}

/// Memory and decoders of a thread, kept from block to block.
#[derive(Default)]
struct Scratch {
    bytes: Vec<u8>,
    zstd: Option<DCtx<'static>>,
}

/// Bytes of large blocks that are being read.
static TAKEN: Mutex<u64> = Mutex::new(0);
static GIVEN_BACK: Condvar = Condvar::new();

/// Room for a large block, until it is dropped.
struct Room(u64);

impl Room {
    /// Waits until there is room for so many bytes. A thread that has some, whose callback reads another block, does not wait: it would wait for itself.
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
    /// Bytes of large blocks that this thread reads.
    static HELD: Cell<u64> = const { Cell::new(0) };
    // Taken while in use: work that a callback starts on the same thread gets its own.
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

/// Unpacks a block that its head says to have `size` bytes, and hands it on; `use_bytes` checks whether it really has them.
///
/// # Errors
/// A size that no log has, data that cannot be unpacked, the errors of `use_bytes`: each in words that begin with "a chunk".
pub(crate) fn with_unpacked<R>(
    packing: Packing,
    data: &[u8],
    size: u64,
    use_bytes: impl FnOnce(&[u8]) -> Result<R, String>,
) -> Result<R, String> {
    let _room = Room::wait(size.min(MAX_BLOCK));
    let mut scratch = SCRATCH.take().unwrap_or_default();
    let answer = scratch.unpack(packing, data, size).and_then(|()| use_bytes(&scratch.bytes));
    if scratch.bytes.capacity() > KEPT {
        scratch.bytes = Vec::new();
    }
    SCRATCH.set(Some(scratch));
    answer
}

impl Scratch {
    /// Fills `bytes` with an unpacked block.
    fn unpack(&mut self, packing: Packing, data: &[u8], size: u64) -> Result<(), String> {
        if size > MAX_BLOCK {
            return Err(format!("a chunk that says it has {size} bytes, more than {MAX_BLOCK}"));
        }
        let packed = data.len() as u64;
        if size > FREE_GROWTH && size / MAX_RATIO > packed {
            return Err(format!("a chunk that unpacks from {packed} to {size} bytes, which no log does"));
        }
        let size = usize::try_from(size).map_err(|_| "a chunk that is too large")?;
        self.bytes.clear();
        match packing {
            Packing::Zstd => self.zstd(data, size),
            Packing::Lz4 => self.stream(FrameDecoder::new(data), "lz4", data.len(), size),
            Packing::Bzip2 => self.stream(BzDecoder::new(data), "bzip2", data.len(), size),
        }
    }

    /// In one go, which needs no window and no second copy. The room grows with the bytes that were really unpacked, never at once to the
    /// size that the head names; a block that packs unusually well is begun again with more room, which the thread then keeps.
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

    /// One byte more than `size` at most, so that a block that is longer than its head says is noticed.
    fn stream(&mut self, decoder: impl Read, name: &str, packed: usize, size: usize) -> Result<(), String> {
        let room = packed.saturating_mul(8).max(1 << 16).min(size);
        self.bytes.try_reserve(room).map_err(|_| "no memory for a chunk")?;
        let read = decoder.take((size as u64).saturating_add(1)).read_to_end(&mut self.bytes);
        read.map(|_| ()).map_err(|error| format!("a chunk that {name} cannot decompress ({error})"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_blocks_wait_without_deadlock() {
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
        let _room = Room::wait(MAX_BLOCK);
        let _another = Room::wait(MAX_BLOCK);
        assert!(Room::wait(FREE_GROWTH).is_none());
    }

    #[test]
    fn decompression_bombs_are_refused_early() {
        let data = zstd::bulk::compress(&vec![0; 80 << 20], 1).unwrap();
        assert!(data.len() < 80_000, "{}", data.len());
        let mut scratch = Scratch::default();
        let why = scratch.unpack(Packing::Zstd, &data, 80 << 20).unwrap_err();
        assert!(why.contains("no log") && scratch.bytes.capacity() == 0, "{why}");
        // One that lies about its size never gets more room than it asked for.
        assert!(scratch.unpack(Packing::Zstd, &data, 1 << 20).is_err());
        assert!(scratch.bytes.capacity() <= 1 << 20);
    }
}
