//! A sign of life in a pipe: what a long job is at, told once in a while.

use std::{
    sync::{
        Arc, Condvar, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
    thread::JoinHandle,
    time::{Duration, Instant},
};

/// The longest silence.
const LONGEST: Duration = Duration::from_secs(60);

/// Tells the stage of a job after a while, and then at intervals that double up to a minute. Dropped, it is silent.
pub(super) struct Heartbeat {
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
}

struct Shared {
    stage: Mutex<String>,
    done: AtomicUsize,
    total: AtomicUsize,
    stopped: Mutex<bool>,
    wake: Condvar,
}

impl Heartbeat {
    /// `tell` gets a line after `first`, when the job is not done by then. Where no thread can be had there are no signs.
    pub(super) fn start(first: Duration, tell: impl Fn(&str) + Send + 'static) -> Self {
        let shared = Arc::new(Shared {
            stage: Mutex::new(String::new()),
            done: AtomicUsize::new(0),
            total: AtomicUsize::new(0),
            stopped: Mutex::new(false),
            wake: Condvar::new(),
        });
        let thread_shared = Arc::clone(&shared);
        let thread =
            std::thread::Builder::new().name("heartbeat".into()).spawn(move || thread_shared.beat(first, &tell)).ok();
        Self { shared, thread }
    }

    /// A new stage begins.
    pub(super) fn stage(&self, name: &str) {
        name.clone_into(&mut self.shared.stage.lock().unwrap_or_else(PoisonError::into_inner));
        self.advance(0, 0);
    }

    /// So many pieces of the stage are done.
    pub(super) fn advance(&self, done: usize, total: usize) {
        self.shared.done.store(done, Ordering::Relaxed);
        self.shared.total.store(total, Ordering::Relaxed);
    }
}

impl Drop for Heartbeat {
    fn drop(&mut self) {
        *self.shared.stopped.lock().unwrap_or_else(PoisonError::into_inner) = true;
        self.shared.wake.notify_all();
        if let Some(thread) = self.thread.take() {
            // A thread that died had nothing more to say.
            let _ = thread.join();
        }
    }
}

impl Shared {
    fn beat(&self, first: Duration, tell: &dyn Fn(&str)) {
        let (begin, mut wait) = (Instant::now(), first);
        let mut next = begin + wait;
        let mut stopped = self.stopped.lock().unwrap_or_else(PoisonError::into_inner);
        while !*stopped {
            let now = Instant::now();
            if now >= next {
                tell(&self.line(now - begin));
                wait = (wait * 2).min(LONGEST.max(first));
                next = now + wait;
            }
            let left = next.saturating_duration_since(Instant::now());
            stopped = self.wake.wait_timeout(stopped, left).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn line(&self, since: Duration) -> String {
        let stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        let (done, total) = (self.done.load(Ordering::Relaxed), self.total.load(Ordering::Relaxed));
        let stage = if stage.is_empty() { "working" } else { stage.as_str() };
        let share = (100 * done.min(total))
            .checked_div(total)
            .map_or_else(String::new, |share| format!(", {share} % of this stage"));
        format!("{stage}{share} ({:.0} s so far)", since.as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    #[test]
    fn only_long_stages_are_reported() {
        let (to, from) = channel();
        let heartbeat = Heartbeat::start(Duration::from_millis(20), move |line| {
            let _ = to.send(line.to_owned());
        });
        heartbeat.stage("models of the folds");
        heartbeat.advance(3, 10);
        let line = from.recv_timeout(Duration::from_secs(30)).unwrap();
        assert!(line.starts_with("models of the folds, 30 % of this stage ("), "{line}");
        assert!(from.recv_timeout(Duration::from_secs(30)).is_ok(), "and again");
        drop(heartbeat);
        let (to, from) = channel();
        drop(Heartbeat::start(Duration::from_secs(3600), move |line| {
            let _ = to.send(line.to_owned());
        }));
        assert!(from.recv().is_err(), "it is stopped at once, and says nothing");
    }
}
