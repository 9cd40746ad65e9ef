//! Page buffers that are used again: a fresh one would be zeroed and mapped for every page.

use std::sync::{Arc, Mutex, PoisonError};

use bytes::Bytes;

/// Bytes that wait to be used again at most.
const LIMIT: usize = 64 << 20;

/// Buffers that wait to be used again.
#[derive(Debug, Default)]
pub(super) struct Buffers {
    idle: Mutex<Vec<Vec<u8>>>,
}

impl Buffers {
    /// `length` bytes of some content, filled by `fill`.
    pub(super) fn filled<E>(
        self: &Arc<Self>,
        length: usize,
        fill: impl FnOnce(&mut [u8]) -> Result<(), E>,
    ) -> Result<Bytes, E> {
        let mut buffer = Lent { bytes: self.take(length), home: self.clone() };
        fill(&mut buffer.bytes[..length])?;
        Ok(Bytes::from_owner(buffer).slice(..length))
    }

    fn take(&self, length: usize) -> Vec<u8> {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        // The smallest that is large enough, and not far too large.
        let fits = idle.iter().enumerate().filter(|(_, buffer)| (length..=4 * length).contains(&buffer.len()));
        match fits.min_by_key(|(_, buffer)| buffer.len()).map(|(at, _)| at) {
            Some(at) => idle.swap_remove(at),
            None => {
                drop(idle);
                vec![0; length]
            }
        }
    }

    fn give(&self, buffer: Vec<u8>) {
        let mut idle = self.idle.lock().unwrap_or_else(PoisonError::into_inner);
        let held: usize = idle.iter().map(Vec::len).sum();
        if held + buffer.len() <= LIMIT && idle.len() < 256 {
            idle.push(buffer);
        }
    }
}

/// A buffer that returns to where it came from.
struct Lent {
    bytes: Vec<u8>,
    home: Arc<Buffers>,
}

impl AsRef<[u8]> for Lent {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
    }
}

impl Drop for Lent {
    fn drop(&mut self) {
        self.home.give(std::mem::take(&mut self.bytes));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn buffers_are_used_again_and_never_show_old_bytes() {
        let buffers = Arc::new(Buffers::default());
        let fill = |value: u8| {
            move |bytes: &mut [u8]| {
                bytes.fill(value);
                Ok::<_, ()>(())
            }
        };
        let first = buffers.filled(100, fill(1)).unwrap();
        let second = buffers.filled(100, fill(2)).unwrap();
        assert!(first.iter().all(|&byte| byte == 1) && second.iter().all(|&byte| byte == 2));
        drop(first);
        let third = buffers.filled(60, fill(3)).unwrap();
        assert_eq!(&third[..], [3; 60]);
        assert!(buffers.idle.lock().unwrap().is_empty(), "the first buffer was taken again");
        assert!(buffers.filled(10, |_| Err(())).is_err());
        drop((second, third));
        assert_eq!(buffers.idle.lock().unwrap().len(), 3);
    }
}
