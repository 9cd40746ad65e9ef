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

use fleetfoot::stats::long_work;
use fleetfoot::{Progress, Work};
use heartbeat::Heartbeat;
use indicatif::{ProgressBar, ProgressStyle};

use crate::report::tell;

/// Time before a long job in a pipe prints its first line of progress.
const PATIENCE: Duration = Duration::from_secs(10);

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
        let note = if self.quiet { None } else { long_work(work) };
        match (note, &self.bar) {
            (Some(note), Some(bar)) => bar.suspend(|| tell(format!("note: {note}"))),
            (Some(note), None) => tell(format!("note: {note}")),
            (None, _) => {}
        }
    }
}
