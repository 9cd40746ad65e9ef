//! Progress on a terminal.

mod heartbeat;

use std::{
    io::{IsTerminal, Write},
    sync::{
        Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    time::Duration,
};

use fleetfoot::stats::expected_seconds;
use fleetfoot::{Progress, Work};
use heartbeat::Heartbeat;
use indicatif::{ProgressBar, ProgressStyle};

use crate::report::tell;

/// How long a job may take in a pipe before it tells what it is at.
const PATIENCE: Duration = Duration::from_secs(10);

/// Less than this takes no such time on any machine, and none is measured.
const LEAST_OPERATIONS: f64 = 1e8;

/// A bar on standard error when that is a terminal; in a pipe, of long jobs alone, a line once in a while.
pub(crate) struct Bar {
    quiet: bool,
    bar: Option<ProgressBar>,
    heartbeat: Mutex<Option<Heartbeat>>,
    done: AtomicUsize,
}

impl Bar {
    pub(crate) fn new(quiet: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::new(0);
            if let Ok(style) = ProgressStyle::with_template("{msg:>12} [{bar:40}] {percent:>3}% {eta}") {
                bar.set_style(style.progress_chars("=> "));
            }
            bar
        });
        // A reader that has closed the pipe wants no more, which is no error.
        let tell = |line: &str| drop(writeln!(std::io::stderr(), "fleetfoot: {line}"));
        let heartbeat = (!quiet && bar.is_none()).then(|| Heartbeat::start(PATIENCE, tell));
        Self { quiet, bar, heartbeat: Mutex::new(heartbeat), done: AtomicUsize::new(0) }
    }

    pub(crate) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        self.heartbeat.lock().unwrap_or_else(PoisonError::into_inner).take();
    }

    fn with_heartbeat(&self, tell: impl FnOnce(&Heartbeat)) {
        if let Some(heartbeat) = &*self.heartbeat.lock().unwrap_or_else(PoisonError::into_inner) {
            tell(heartbeat);
        }
    }
}

impl Progress for Bar {
    fn advance(&self, units: usize, total: usize) {
        let done = self.done.fetch_add(units, Ordering::Relaxed) + units;
        // A stage without a name of its own begins anew.
        if done > total {
            self.done.store(units, Ordering::Relaxed);
        }
        if let Some(bar) = &self.bar {
            bar.set_length(total as u64);
            bar.set_position(done.min(total) as u64);
        }
        self.with_heartbeat(|heartbeat| heartbeat.advance(done.min(total), total));
    }

    fn cancelled(&self) -> bool {
        crate::signals::stop().is_set()
    }

    fn stage(&self, name: &str) {
        self.done.store(0, Ordering::Relaxed);
        if let Some(bar) = &self.bar {
            bar.set_message(name.to_owned());
        }
        self.with_heartbeat(|heartbeat| heartbeat.stage(name));
    }

    fn expect(&self, work: Work) {
        let note = if self.quiet { None } else { long(work) };
        match (note, &self.bar) {
            (Some(note), Some(bar)) => bar.suspend(|| tell(format!("note: {note}"))),
            (Some(note), None) => tell(format!("note: {note}")),
            (None, _) => {}
        }
    }
}

/// About how long work takes on this machine, and what makes it shorter, where a person would wonder.
pub(crate) fn long(work: Work) -> Option<String> {
    if work.operations < LEAST_OPERATIONS {
        return None;
    }
    let threads = fleetfoot::thread_count().clamp(1, work.parts.max(1));
    let seconds = expected_seconds(work.operations) / threads as f64;
    (seconds > PATIENCE.as_secs_f64()).then(|| format!("this takes about {}; {}", in_words(seconds), work.mend))
}

/// A duration to about one digit.
fn in_words(seconds: f64) -> String {
    let rounded = |value: f64, word: &str| {
        let unit = 10_f64.powf(value.log10().floor());
        let value = if value < 10.0 { value.round() } else { (value / unit).round() * unit };
        format!("{value:.0} {word}{}", if value == 1.0 { "" } else { "s" })
    };
    match seconds {
        _ if seconds < 60.0 => rounded(seconds, "second"),
        _ if seconds < 3600.0 => rounded(seconds / 60.0, "minute"),
        _ if seconds < 48.0 * 3600.0 => rounded(seconds / 3600.0, "hour"),
        _ => rounded(seconds / 86_400.0, "day"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_work_is_told_and_short_work_is_not() {
        let work = |operations| Work { operations, parts: 3, mend: "fewer folds make it shorter" };
        assert_eq!(long(work(1e6)), None);
        let note = long(work(1e14)).unwrap();
        assert!(note.starts_with("this takes about ") && note.ends_with("; fewer folds make it shorter"), "{note}");
        let words = [12.0, 58.0, 70.0, 640.0, 5000.0, 1e5, 1e6].map(in_words);
        assert_eq!(words, ["10 seconds", "60 seconds", "1 minute", "10 minutes", "1 hour", "30 hours", "10 days"]);
    }
}
