//! Progress on a terminal, and cancellation by Ctrl-C.

use std::{
    io::IsTerminal,
    sync::atomic::{AtomicBool, AtomicUsize, Ordering},
};

use fleetfoot::Progress;
use indicatif::{ProgressBar, ProgressStyle};

static STOP: AtomicBool = AtomicBool::new(false);

/// The first Ctrl-C stops the work at the next piece, so that no half-written file stays behind; the second ends the process.
pub(crate) fn stop_on_interrupt() {
    // Where no handler can be set, Ctrl-C ends the process as usual.
    let _ = ctrlc::set_handler(|| {
        if STOP.swap(true, Ordering::Relaxed) {
            std::process::exit(130);
        }
    });
}

/// Whether the user has stopped the work.
pub(crate) fn stopped() -> bool {
    STOP.load(Ordering::Relaxed)
}

/// A bar on standard error when that is a terminal; silent in a pipe.
pub(crate) struct Bar {
    bar: Option<ProgressBar>,
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
        Self { bar, done: AtomicUsize::new(0) }
    }

    pub(crate) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}

impl Progress for Bar {
    fn advance(&self, units: usize, total: usize) {
        if let Some(bar) = &self.bar {
            let done = self.done.fetch_add(units, Ordering::Relaxed) + units;
            // A stage without a name of its own begins anew.
            if done > total {
                self.done.store(units, Ordering::Relaxed);
            }
            bar.set_length(total as u64);
            bar.set_position(done.min(total) as u64);
        }
    }

    fn cancelled(&self) -> bool {
        STOP.load(Ordering::Relaxed)
    }

    fn stage(&self, name: &str) {
        self.done.store(0, Ordering::Relaxed);
        if let Some(bar) = &self.bar {
            bar.set_message(name.to_owned());
        }
    }
}
