//! Memory that a call needs: checked as a whole before it starts, because an allocation that fails ends the process.

/// A result needs more memory than the system gives this process.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{what} needs {} of memory, more than the system gives this process; {mend}", size(*bytes))]
pub struct OutOfMemory {
    /// The result or table that needs the memory.
    pub what: String,
    /// Bytes.
    pub bytes: usize,
    /// The advice at the end of the message.
    pub mend: String,
}

/// Asks the system for so many bytes and gives them back untouched: limits of the process (`ulimit -v`, a job's) answer at once.
///
/// # Errors
/// Returns [`OutOfMemory`] with the purpose of the memory and a remedy.
pub fn ensure_memory(bytes: usize, what: &str, mend: &str) -> Result<(), OutOfMemory> {
    match Vec::<u8>::new().try_reserve_exact(bytes) {
        Ok(()) => Ok(()),
        Err(_) => Err(OutOfMemory { what: what.to_owned(), bytes, mend: mend.to_owned() }),
    }
}

/// Room for so many more values, without an end of the process where there is none.
///
/// # Errors
/// [`OutOfMemory`], as of [`ensure_memory`].
pub fn reserve<T>(values: &mut Vec<T>, more: usize, what: &str, mend: &str) -> Result<(), OutOfMemory> {
    values.try_reserve(more).map_err(|_| OutOfMemory {
        what: what.to_owned(),
        bytes: (values.len().saturating_add(more)).saturating_mul(size_of::<T>()),
        mend: mend.to_owned(),
    })
}

fn size(bytes: usize) -> String {
    match bytes {
        0..1_000_000 => format!("{bytes} bytes"),
        1_000_000..1_000_000_000 => format!("{:.0} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_beyond_the_memory_are_refused_with_their_size() {
        assert_eq!(ensure_memory(1 << 20, "a table", "give fewer rows"), Ok(()));
        for bytes in [1 << 50, usize::MAX] {
            let error = ensure_memory(bytes, "a table", "give fewer rows").unwrap_err().to_string();
            assert!(error.starts_with("a table needs ") && error.contains(" GB of memory"), "{error}");
            assert!(error.ends_with("; give fewer rows"), "{error}");
        }
    }
}
