//! A stop that reaches into a piece of work.
//!
//! Scans check [`Progress::cancelled`](crate::Progress) between their pieces. A dense solve is one piece, however long
//! it takes. Its loops call [`checkpoint`], which takes no argument and gives no error, so that the signatures of
//! solvers stay free of it. Once the stop is set a checkpoint unwinds (as a panic does, but without its message) to
//! [`stoppable`], which began the work. Solvers own their outputs, so half-done results are never seen.

use std::{
    cell::RefCell,
    panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
    sync::{
        Arc,
        atomic::{AtomicBool, Ordering},
    },
};

thread_local! {
    static CURRENT: RefCell<Option<Stop>> = const { RefCell::new(None) };
}

/// The user stopped the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("stopped")]
pub struct Cancelled;

/// Request to stop work; all clones are one.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Ends the work that runs under it.
    pub fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Returns true once the stop is set.
    pub fn is_set(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// Runs `work`, which ends at its next [`checkpoint`] once `stop` is set, on whatever threads behind the doors it runs.
///
/// # Errors
/// When it ended so.
pub fn stoppable<R>(stop: &Stop, work: impl FnOnce() -> R) -> Result<R, Cancelled> {
    until_stopped(|| under(Some(stop), work))
}

/// Runs a part of a work whose owner has something to put in order when the work is stopped: the unwinding ends here.
///
/// # Errors
/// When the part ended at a [`checkpoint`].
pub fn until_stopped<R>(work: impl FnOnce() -> R) -> Result<R, Cancelled> {
    catch_unwind(AssertUnwindSafe(work)).map_err(|payload| match payload.downcast::<Cancelled>() {
        Ok(cancelled) => *cancelled,
        Err(panic) => resume_unwind(panic),
    })
}

/// Runs work to its end, even if the work around it is stopped: it saves the complete part.
pub fn unstoppable<R>(work: impl FnOnce() -> R) -> R {
    under(None, work)
}

/// A place where long work may end: called once in every sweep, block or column that takes about a millisecond or more.
pub fn checkpoint() {
    if CURRENT.with_borrow(|stop| stop.as_ref().is_some_and(Stop::is_set)) {
        resume_unwind(Box::new(Cancelled));
    }
}

/// The stop that this thread's work runs under.
pub(crate) fn current() -> Option<Stop> {
    CURRENT.with_borrow(Clone::clone)
}

/// Runs a part of a work on this thread, under the stop of the whole.
pub(crate) fn under<R>(stop: Option<&Stop>, work: impl FnOnce() -> R) -> R {
    /// Puts the stop of the work around it back, however the part ends.
    struct Restore(Option<Stop>);
    impl Drop for Restore {
        fn drop(&mut self) {
            CURRENT.set(self.0.take());
        }
    }
    let _restore = Restore(CURRENT.replace(stop.cloned()));
    work()
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use super::*;
    use crate::{Silent, Threads, parallel_all, parallel_map, with_threads};

    fn endless() {
        let start = Instant::now();
        while start.elapsed() < Duration::from_secs(60) {
            checkpoint();
        }
        panic!("nobody stopped it");
    }

    #[test]
    fn work_ends_at_a_checkpoint_on_every_thread() {
        for threads in [1, 3] {
            let stop = Stop::default();
            let outcome = with_threads(threads, || {
                stoppable(&stop, || {
                    parallel_map(8, &Silent, |i| {
                        if i == 5 {
                            stop.set();
                        } else {
                            // Pieces that start a reduction of their own hear of it too.
                            parallel_map(2, &Silent, |_| {
                                if i > 5 {
                                    endless();
                                }
                                Ok::<_, Cancelled>(())
                            })?;
                        }
                        Ok::<_, Cancelled>(())
                    })
                })
            });
            assert!(matches!(outcome, Err(Cancelled) | Ok(Err(Cancelled))));
        }
    }

    #[test]
    fn incomplete_results_are_discarded() {
        let stop = Stop::default();
        let outcome = stoppable(&stop, || {
            parallel_all(1000, |i| {
                if i == 3 {
                    stop.set();
                }
            })
            .len()
        });
        assert_eq!(outcome, Err(Cancelled));
        assert_eq!(stoppable(&Stop::default(), || parallel_all(5, |i| i * i)), Ok(vec![0, 1, 4, 9, 16]));
    }

    #[test]
    fn a_kept_pool_is_usable_after_a_stop() {
        let (threads, stop) = (Threads::new(2).unwrap(), Stop::default());
        let (period, work) = (Duration::from_millis(1), || stoppable(&stop, endless));
        assert_eq!(threads.run(work, period, || stop.set()), Err(Cancelled));
        let free = || stoppable(&Stop::default(), || parallel_map(100, &Silent, Ok::<_, Cancelled>).unwrap().len());
        assert_eq!(threads.run(free, period, || ()), Ok(100));
    }

    #[test]
    fn complete_pieces_are_kept_after_a_stop() {
        let stop = Stop::default();
        let kept = stoppable(&stop, || {
            let ended = until_stopped(|| {
                stop.set();
                checkpoint();
            });
            let kept = unstoppable(|| {
                checkpoint();
                parallel_all(5, |i| i).len()
            });
            (ended, kept)
        });
        assert_eq!(kept, Ok((Err(Cancelled), 5)));
        assert_eq!(stoppable(&stop, checkpoint), Err(Cancelled));
    }

    #[test]
    fn only_stops_end_work_and_panics_propagate() {
        checkpoint();
        let stop = Stop::default();
        assert_eq!(stoppable(&stop, || 3), Ok(3));
        let mistake = catch_unwind(AssertUnwindSafe(|| stoppable(&stop, || panic!("a mistake"))));
        assert_eq!(mistake.unwrap_err().downcast_ref::<&str>(), Some(&"a mistake"));
        stop.set();
        checkpoint();
        assert_eq!(stoppable(&stop, checkpoint), Err(Cancelled));
        checkpoint();
    }
}
