//! State of a body's fusion, in a hidden file of the output folder: a killed preparation goes on from there.

use std::{
    fs,
    path::PathBuf,
    time::{Duration, Instant},
};

use fleetfoot_output::write_atomic;
use fleetfoot_signal::fuse::Checkpoint;

/// The name of the file.
pub(super) const NAME: &str = ".fusing";

/// Time of fusion between two writes of the file, in multiples of the time of a write.
const REST: u32 = 20;

/// The file, which goes with the preparation unless that is killed or stopped.
pub(super) struct Kept {
    path: PathBuf,
    /// When the file was written last, and how long that took.
    last: Option<(Instant, Duration)>,
}

impl Kept {
    pub(super) fn new(path: PathBuf) -> Self {
        Self { path, last: None }
    }
}

impl Checkpoint for Kept {
    fn load(&mut self) -> Option<Vec<u8>> {
        fs::read(&self.path).ok()
    }

    fn save(&mut self, state: &[u8]) {
        if self.last.is_some_and(|(end, took)| end.elapsed() < REST * took) {
            return;
        }
        let begin = Instant::now();
        // A file that cannot be written is a fusion that is begun anew after a kill, and nothing worse.
        let _ = write_atomic(&self.path, state);
        self.last = Some((Instant::now(), begin.elapsed()));
    }
}

impl Drop for Kept {
    fn drop(&mut self) {
        // Work that is stopped unwinds, and who stops a preparation may want to go on with it.
        if std::thread::panicking() {
            return;
        }
        // It is not there where one round was enough.
        let _ = fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use std::panic::{AssertUnwindSafe, catch_unwind};

    use super::*;

    #[test]
    fn checkpoint_survives_a_stop_and_is_removed_at_the_end() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(NAME);
        let stopped = catch_unwind(AssertUnwindSafe(|| {
            let mut kept = Kept::new(path.clone());
            assert!(kept.load().is_none());
            kept.save(b"one");
            // It took a minute, and so much work has not been done since.
            kept.last = Some((Instant::now(), Duration::from_secs(60)));
            kept.save(b"two");
            std::panic::resume_unwind(Box::new(()));
        }));
        assert!(stopped.is_err());
        let mut kept = Kept::new(path.clone());
        assert_eq!(kept.load().unwrap(), b"one");
        kept.last = Some((Instant::now(), Duration::ZERO));
        kept.save(b"three");
        assert_eq!(fs::read(&path).unwrap(), b"three");
        drop(kept);
        assert!(!path.exists());
    }
}
