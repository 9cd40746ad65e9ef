//! Scans that were stopped.

use std::sync::atomic::{AtomicUsize, Ordering};

use fleetfoot_data::Progress;

use super::{
    super::target::{partial, scan_in_groups},
    *,
};

/// Stops a scan after some chunks.
struct StopAfter {
    chunks: AtomicUsize,
    limit: usize,
    scanning: AtomicUsize,
}

impl StopAfter {
    fn new(limit: usize) -> Self {
        Self { chunks: AtomicUsize::new(0), limit, scanning: AtomicUsize::new(0) }
    }
}

impl Progress for StopAfter {
    fn advance(&self, units: usize, _total: usize) {
        self.chunks.fetch_add(units * self.scanning.load(Ordering::Relaxed), Ordering::Relaxed);
    }

    fn cancelled(&self) -> bool {
        self.chunks.load(Ordering::Relaxed) >= self.limit
    }

    fn stage(&self, name: &str) {
        self.scanning.store(usize::from(name == "scan"), Ordering::Relaxed);
    }
}

fn target(output: PathBuf) -> ScanTarget {
    ScanTarget { output, ..ScanTarget::default() }
}

/// A scan that keeps its progress after every file.
fn run(target: &ScanTarget, files: &[PathBuf], progress: &dyn Progress) -> Result<ScanOutcome, Error> {
    scan_in_groups(target, &recipe(), &options(), &files.into(), progress, Some(1))
}

#[test]
fn a_stopped_scan_goes_on_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 3);
    let whole = target(folder.path().join("whole.stats"));
    run(&whole, &files, &Silent).unwrap();
    let expected = fs::read(&whole.output).unwrap();
    for limit in [4, 7, 18] {
        let target = target(folder.path().join(format!("stopped_{limit}.stats")));
        let partial = partial(&target.output);
        let mut stops = 0;
        // Stopped again and again, a little further each time.
        let outcome = loop {
            match run(&target, &files, &StopAfter::new(limit)) {
                Ok(outcome) => break outcome,
                Err(Error::Paused { path }) => {
                    assert_eq!(path, partial);
                    let kept = StatisticFile::read(&partial).unwrap();
                    assert!(kept.is_partial() && !kept.episodes.is_empty() && !target.output.exists());
                    stops += 1;
                    assert!(stops < 20, "no progress");
                }
                Err(error) => panic!("{error}"),
            }
        };
        assert!(stops > 0 && outcome.resumed);
        assert_eq!(fs::read(&target.output).unwrap(), expected, "stopped every {limit} chunks");
        assert!(!partial.exists());
    }
}

/// Leaves a partial file.
fn stopped(target: &ScanTarget, files: &[PathBuf]) {
    let error = run(target, files, &StopAfter::new(12)).unwrap_err();
    assert!(matches!(error, Error::Paused { .. }), "{error}");
    assert!(error.to_string().contains("run the same command again"));
}

#[test]
fn an_append_goes_on_too() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 3);
    let target = ScanTarget { append: true, ..target(folder.path().join("run.stats")) };
    run(&target, &files[..2], &Silent).unwrap();
    let base = StatisticFile::read(&target.output).unwrap();
    let before = fs::read(&target.output).unwrap();
    stopped(&target, &files);
    assert_eq!(fs::read(&target.output).unwrap(), before, "the output is whole at every moment");
    let outcome = run(&target, &files, &Silent).unwrap();
    assert!(outcome.resumed);
    assert_eq!(outcome.before, Some(before.len() as u64));
    assert_eq!(fs::read(&target.output).unwrap(), bytes(&scanned(&files, Some(base.without_rows()))));
}

#[test]
fn a_partial_file_of_another_command_is_not_resumed() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 3);
    let target = target(folder.path().join("run.stats"));
    stopped(&target, &files);
    let message = run(&target, &files[1..], &Silent).unwrap_err().to_string();
    assert!(message.contains("run.stats.partial") && message.contains("--force"), "{message}");
    let forced = ScanTarget { force: true, ..target.clone() };
    run(&forced, &files[1..], &Silent).unwrap();
    assert_eq!(fs::read(&target.output).unwrap(), bytes(&scanned(&files[1..], None)));
    assert!(!partial(&target.output).exists());
    // An output that exists.
    let message = run(&target, &files, &Silent).unwrap_err().to_string();
    assert!(message.contains("run.stats exists already") && message.contains("--append"), "{message}");
}

#[test]
fn a_partial_file_can_be_appended_to_as_a_statistic() {
    let folder = tempfile::tempdir().unwrap();
    let files = fleet(folder.path(), &[1, 2, 3], 3);
    let first = target(folder.path().join("first.stats"));
    stopped(&first, &files);
    let append = ScanTarget { append: true, ..target(folder.path().join("second.stats")) };
    fs::rename(partial(&first.output), &append.output).unwrap();
    run(&append, &files, &Silent).unwrap();
    run(&first, &files, &Silent).unwrap();
    assert_eq!(fs::read(&append.output).unwrap(), fs::read(&first.output).unwrap());
}
