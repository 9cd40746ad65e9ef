//! Ordered parallel work: the door to the threads for independent pieces, with progress and cancellation.
//!
//! Results come back in the order of the pieces, whoever computed them, so that nothing downstream can depend on the number of threads.

use std::{
    cell::RefCell,
    sync::{
        Arc, Mutex, PoisonError,
        atomic::{AtomicUsize, Ordering},
    },
};

use crate::{Cancelled, stop};

/// Receiver of progress, which may stop the work.
pub trait Progress: Sync {
    /// `units` more pieces are done, of `total` in this stage.
    fn advance(&self, units: usize, total: usize);

    /// Returns true if the work should stop at the next piece.
    fn cancelled(&self) -> bool {
        false
    }

    /// A new stage begins.
    fn stage(&self, _name: &str) {}

    /// Announces the work ahead: called once, before the longest stages.
    fn expect(&self, _work: Work) {}
}

/// Work that lies ahead, by a rough count: the same input has the same count on every machine.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Work {
    /// Multiplications, about.
    pub operations: f64,
    /// Parts of it that threads can do at the same time.
    pub parts: usize,
    /// Remedy that makes it less, as a clause: `fewer folds make it shorter`.
    pub mend: String,
}

/// Progress without output.
#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl Progress for Silent {
    fn advance(&self, _units: usize, _total: usize) {}
}

/// Prefixes every stage with its context: `scan, fold 2 of 5`.
pub struct Stages<'a> {
    progress: &'a dyn Progress,
    of: String,
}

impl<'a> Stages<'a> {
    /// Stages of this.
    pub fn new(progress: &'a dyn Progress, of: impl Into<String>) -> Self {
        Self { progress, of: of.into() }
    }

    /// Stages of a fold, which is counted from 0.
    pub fn fold(progress: &'a dyn Progress, fold: usize, folds: usize) -> Self {
        Self::new(progress, format!("fold {} of {folds}", fold + 1))
    }
}

impl Progress for Stages<'_> {
    fn advance(&self, units: usize, total: usize) {
        self.progress.advance(units, total);
    }

    fn cancelled(&self) -> bool {
        self.progress.cancelled()
    }

    fn stage(&self, name: &str) {
        self.progress.stage(&format!("{name}, {}", self.of));
    }

    fn expect(&self, work: Work) {
        self.progress.expect(work);
    }
}

/// Threads that the two doors use here.
pub fn thread_count() -> usize {
    rayon::current_num_threads()
}

/// Runs `work` with `threads` threads behind the doors (0: as many as there are cores).
pub fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
        Ok(pool) => pool.install(work),
        // No threads to be had: the answer is the same with the ones there are.
        Err(_) => work(),
    }
}

/// Threads that are kept between pieces of work.
#[derive(Debug)]
pub struct Threads(rayon::ThreadPool);

impl Threads {
    /// Starts `count` threads (0: as many as there are cores).
    ///
    /// # Errors
    /// When the system gives no threads.
    pub fn new(count: usize) -> std::io::Result<Self> {
        rayon::ThreadPoolBuilder::new().num_threads(count).build().map(Self).map_err(std::io::Error::other)
    }

    /// Runs `work` with these threads behind the doors, while the caller's thread calls `watch` every `period`, and once at the end.
    ///
    /// # Panics
    /// With the payload of a panic in `work`.
    pub fn run<R: Send>(
        &self,
        work: impl FnOnce() -> R + Send,
        period: std::time::Duration,
        mut watch: impl FnMut(),
    ) -> R {
        use std::{
            panic::{AssertUnwindSafe, catch_unwind, resume_unwind},
            sync::mpsc::{RecvTimeoutError, channel},
        };
        let (done, wait) = channel();
        let answer = self.0.in_place_scope(|scope| {
            scope.spawn(move |_| {
                // Nobody waits for it only when the caller's thread is unwinding itself.
                let _ = done.send(catch_unwind(AssertUnwindSafe(work)));
            });
            loop {
                let answer = wait.recv_timeout(period);
                watch();
                if !matches!(answer, Err(RecvTimeoutError::Timeout)) {
                    return answer;
                }
            }
        });
        match answer {
            Ok(Ok(result)) => result,
            Ok(Err(panic)) => resume_unwind(panic),
            Err(gone) => resume_unwind(Box::new(gone.to_string())),
        }
    }
}

/// `work(0), work(1), ... work(count - 1)`, in order, computed in parallel. The first error in order wins.
pub fn parallel_map<R, E>(
    count: usize,
    progress: &dyn Progress,
    work: impl Fn(usize) -> Result<R, E> + Sync,
) -> Result<Vec<R>, E>
where
    R: Send,
    E: Send + From<Cancelled>,
{
    let mut results = Vec::with_capacity(count);
    parallel_fold(count, progress, work, |result| {
        results.push(result);
        Ok(())
    })?;
    Ok(results)
}

/// [`parallel_map`] of work that cannot fail. A stop unwinds, as at a [`checkpoint`](crate::checkpoint): a part of the results is none.
pub fn parallel_all<R: Send>(count: usize, work: impl Fn(usize) -> R + Sync) -> Vec<R> {
    match parallel_map(count, &Silent, |i| Ok::<_, Cancelled>(work(i))) {
        Ok(results) => results,
        Err(cancelled) => std::panic::resume_unwind(Box::new(cancelled)),
    }
}

/// Calls `work` with the number and the values of every piece of `size` values (the last may be shorter). Pieces are
/// written in place, and the results of `work` come in their order. Within a piece of other parallel work all threads
/// are taken while pieces of that wait to begin. The calling thread then does the work alone; once no piece waits, idle
/// threads join it.
pub fn parallel_pieces<T: Send, R: Send>(
    values: &mut [T],
    size: usize,
    work: impl Fn(usize, &mut [T]) -> R + Sync,
) -> Vec<R> {
    let size = size.max(1);
    let taken = INSIDE.with_borrow(|inside| inside.as_ref().is_some_and(|work| work.waits()));
    if taken || values.len() <= size {
        return values.chunks_mut(size).enumerate().map(|(i, piece)| work(i, piece)).collect();
    }
    let pieces: Vec<Mutex<&mut [T]>> = values.chunks_mut(size).map(Mutex::new).collect();
    parallel_all(pieces.len(), |i| {
        let mut piece = pieces[i].lock().unwrap_or_else(PoisonError::into_inner);
        work(i, &mut piece)
    })
}

/// Parallel work, and the work that it is a piece's of.
struct Begun {
    /// Pieces that have not begun.
    waiting: AtomicUsize,
    around: Option<Arc<Begun>>,
}

impl Begun {
    fn waits(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) > 0 || self.around.as_ref().is_some_and(|around| around.waits())
    }
}

thread_local! {
    /// The work of which this thread computes a piece.
    static INSIDE: RefCell<Option<Arc<Begun>>> = const { RefCell::new(None) };
}

/// Computes a piece.
fn inside<R>(of: &Arc<Begun>, work: impl FnOnce() -> R) -> R {
    /// Restores the previous value, however the piece ends.
    struct Restore(Option<Arc<Begun>>);
    impl Drop for Restore {
        fn drop(&mut self) {
            INSIDE.set(self.0.take());
        }
    }
    of.waiting.fetch_sub(1, Ordering::Relaxed);
    let _restore = Restore(INSIDE.replace(Some(of.clone())));
    work()
}

/// Computes `work(i)` in parallel and hands the results to `fold` in the order of `i`.
///
/// At most a few results per thread are held at any time: while one wave is folded, the next is computed.
pub fn parallel_fold<R, E>(
    count: usize,
    progress: &dyn Progress,
    work: impl Fn(usize) -> Result<R, E> + Sync,
    mut fold: impl FnMut(R) -> Result<(), E> + Send,
) -> Result<(), E>
where
    R: Send,
    E: Send + From<Cancelled>,
{
    let (wave, stop) = (wave(count), stop::current());
    let begun = Arc::new(Begun { waiting: AtomicUsize::new(count), around: INSIDE.with_borrow(Clone::clone) });
    // A wave is computed into one half while the other half is folded.
    let slots: Vec<Mutex<Option<Result<R, E>>>> = (0..(2 * wave).min(count)).map(|_| Mutex::new(None)).collect();
    let slot = |i: usize| slots[i % (2 * wave)].lock().unwrap_or_else(PoisonError::into_inner);
    let mut outcome = Ok(());
    in_waves(
        count,
        wave,
        &|i| {
            let stopped = progress.cancelled() || stop.as_ref().is_some_and(stop::Stop::is_set);
            let result = if stopped {
                Err(Cancelled.into())
            } else {
                let result = stop::under(stop.as_ref(), || inside(&begun, || work(i)));
                progress.advance(1, count);
                result
            };
            *slot(i) = Some(result);
        },
        &mut |i| {
            if let Some(result) = slot(i).take() {
                outcome = result.and_then(&mut fold);
            }
            outcome.is_ok()
        },
    );
    outcome
}

/// Pieces that are computed before the first of them is folded: several a thread, as they differ in work.
fn wave(count: usize) -> usize {
    if count <= 4096 { 2 * rayon::current_num_threads() } else { 8 * rayon::current_num_threads() }
}

/// Calls `compute` with every number below `count` on all threads, and `fold` with each in order, a wave behind, until
/// it returns false.
///
/// Not generic, so that the threads' machinery is compiled here once and not with each of its hundred uses.
fn in_waves(count: usize, wave: usize, compute: &(dyn Fn(usize) + Sync), fold: &mut (dyn FnMut(usize) -> bool + Send)) {
    use rayon::prelude::*;
    let run = |from: usize| {
        // Pieces begin in their order, whichever thread is free, so that those under way are neighbours:
        // a reader that goes on where the piece before ended finds its decoder there.
        let next = AtomicUsize::new(from);
        let pieces = from..(from + wave).min(count);
        pieces.into_par_iter().with_max_len(1).for_each(|_| compute(next.fetch_add(1, Ordering::Relaxed)));
    };
    run(0);
    let mut from = 0;
    while from < count {
        let following = (from + wave).min(count);
        let (goes_on, ()) = rayon::join(|| (from..following).all(&mut *fold), || run(following));
        if !goes_on {
            return;
        }
        from = following;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicUsize, Ordering};

    #[test]
    fn results_come_in_order_on_any_number_of_threads() {
        for threads in [1, 2, 7] {
            let squares = with_threads(threads, || parallel_map(1000, &Silent, |i| Ok::<_, Cancelled>(i * i)));
            assert_eq!(squares.unwrap(), (0..1000).map(|i| i * i).collect::<Vec<_>>());
        }
        assert!(parallel_map(0, &Silent, Ok::<_, Cancelled>).unwrap().is_empty());
    }

    #[test]
    fn pieces_are_written_where_they_lie() {
        for threads in [1, 3] {
            let (written, nested) = with_threads(threads, || {
                let fill = |values: &mut [usize]| {
                    parallel_pieces(values, 7, |i, piece| {
                        piece.iter_mut().enumerate().for_each(|(k, value)| *value = 7 * i + k);
                        piece.len()
                    })
                };
                let mut written = vec![0; 100];
                assert_eq!(fill(&mut written), [vec![7; 14], vec![2]].concat());
                let nested = parallel_all(5, |_| {
                    let mut values = vec![0; 20];
                    fill(&mut values);
                    values
                });
                (written, nested)
            });
            assert_eq!(written, (0..100).collect::<Vec<_>>());
            assert!(nested.iter().all(|values| *values == (0..20).collect::<Vec<_>>()));
        }
        assert!(parallel_pieces(&mut [0_u8; 0], 0, |_, _| ()).is_empty());
    }

    #[test]
    fn inner_pieces_are_shared_once_no_outer_piece_waits() {
        let waits = || INSIDE.with_borrow(|inside| inside.as_ref().map(|work| work.waits()));
        with_threads(1, || {
            assert_eq!(waits(), None);
            // Of the outer pieces the last one alone may share, and of its inner ones the last.
            let sums = parallel_all(2, |_| (waits(), parallel_all(2, |_| waits())));
            let alone = (Some(true), vec![Some(true); 2]);
            assert_eq!(sums, [alone, (Some(false), vec![Some(true), Some(false)])]);
            assert_eq!(waits(), None);
        });
        let nested = |threads| {
            with_threads(threads, || {
                parallel_all(3, |_| {
                    let mut values = vec![0; 1000];
                    parallel_pieces(&mut values, 10, |i, piece| piece.fill(i));
                    values
                })
            })
        };
        assert!([2, 7].into_iter().all(|threads| nested(threads) == nested(1)));
    }

    #[test]
    fn the_first_error_in_order_wins_and_stops() {
        #[derive(Debug, PartialEq)]
        struct Bad(usize);
        impl From<Cancelled> for Bad {
            fn from(_: Cancelled) -> Self {
                Bad(usize::MAX)
            }
        }
        let done = AtomicUsize::new(0);
        let result = parallel_map(100_000, &Silent, |i| {
            done.fetch_add(1, Ordering::Relaxed);
            if i % 10 == 7 { Err(Bad(i)) } else { Ok(i) }
        });
        assert_eq!(result, Err(Bad(7)));
        assert!(done.load(Ordering::Relaxed) < 1000);
    }

    #[test]
    fn kept_threads_work_while_the_caller_watches() {
        let threads = Threads::new(3).unwrap();
        let mut watched = 0;
        let period = std::time::Duration::from_millis(1);
        let work = || {
            std::thread::sleep(20 * period);
            parallel_map(1000, &Silent, Ok::<_, Cancelled>).map(|all| (all.len(), thread_count()))
        };
        assert_eq!(threads.run(work, period, || watched += 1), Ok((1000, 3)));
        assert!(watched > 1, "{watched}");
        let panic =
            std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| threads.run(|| panic!("no"), period, || ())));
        assert_eq!(panic.unwrap_err().downcast_ref::<&str>(), Some(&"no"));
        assert_eq!(threads.run(|| 1, period, || ()), 1, "a panic leaves the threads usable");
    }

    #[test]
    fn cancelling_stops() {
        struct Stop;
        impl Progress for Stop {
            fn advance(&self, _: usize, _: usize) {}
            fn cancelled(&self) -> bool {
                true
            }
        }
        assert_eq!(parallel_map(10, &Stop, Ok::<usize, Cancelled>), Err(Cancelled));
    }
}
