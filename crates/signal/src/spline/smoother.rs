//! One pass over the rows and back: the filter, its likelihood, the smoother.

use super::{
    chain::Chain,
    filter::{Belief, Innovation, Posterior},
    head::{Eliminated, Information},
    link::{Beliefs, Links, PIECE},
};

/// Rows whose beliefs are held at a time, and rows between the beliefs that are kept on the way out: on the way back all stretches but the last are filtered once more, so that what is
/// held does not grow with the rows. Twelve megabytes of the quintic spline; most records are shorter, and filtered once.
const STRETCH: usize = 1 << 17;

/// Rows of a channel, scaled: stamps in units of the median step, values about zero.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rows<'a> {
    pub(super) times: &'a [f64],
    /// NaN where nothing was measured.
    pub(super) values: &'a [f64],
    /// 1 for every row where not given.
    pub(super) weights: Option<&'a [f64]>,
}

/// Measurements in the order of their times, scaled so that steps, values and weights are near one.
pub(crate) trait Sequence<const M: usize>: Copy {
    /// Number of rows.
    fn rows(&self) -> usize;

    /// The time from the row before to this one; 0 where both are of one instant.
    fn step_to(&self, row: usize) -> f64;

    /// Updates the belief with the measurement of the row, if there is one.
    fn learn(&self, row: usize, belief: &mut Belief<M>) -> Option<Innovation>;

    /// The same as long as not all of the state is known. Whether anything was measured.
    fn begin(&self, row: usize, known: &mut Information<M>) -> bool;

    /// Returns true if this many measurements determine the state.
    fn is_begun(&self, measured: usize, known: &Information<M>) -> bool;
}

/// Residuals of a channel under the smoother.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Residuals {
    /// Weighted sum of squared residuals.
    pub(super) squares: f64,
    /// Trace of the hat matrix.
    pub(super) freedom: f64,
}

impl Rows<'_> {
    /// Measurement of a row, and its weight.
    #[inline]
    pub(super) fn measured(&self, row: usize) -> Option<(f64, f64)> {
        let (value, weight) = (self.values[row], self.weights.map_or(1.0, |weights| weights[row]));
        (weight > 0.0 && !value.is_nan()).then_some((value, weight))
    }

    /// Adds what a row's state leaves of its measurement.
    #[inline]
    pub(super) fn add<const M: usize>(&self, residuals: &mut Residuals, row: usize, state: &Posterior<M>) {
        if let Some((value, weight)) = self.measured(row) {
            residuals.squares += weight * (value - state.mean[0]) * (value - state.mean[0]);
            residuals.freedom += weight * state.covariance[0][0];
        }
    }
}

impl<const M: usize> Sequence<M> for Rows<'_> {
    #[inline]
    fn rows(&self) -> usize {
        self.times.len()
    }

    #[inline]
    fn step_to(&self, row: usize) -> f64 {
        self.times[row] - self.times[row - 1]
    }

    #[inline]
    fn learn(&self, row: usize, belief: &mut Belief<M>) -> Option<Innovation> {
        self.measured(row).map(|(value, weight)| belief.measure(value, 1.0 / weight))
    }

    fn begin(&self, row: usize, known: &mut Information<M>) -> bool {
        let seen = self.measured(row);
        if let Some((value, weight)) = seen {
            known.measure(&std::array::from_fn(|i| f64::from(i == 0)), value, weight);
        }
        seen.is_some()
    }

    fn is_begun(&self, measured: usize, _: &Information<M>) -> bool {
        measured == M
    }
}

/// The first rows, done.
pub(super) struct Start<const M: usize> {
    /// The states of the rows before `row`, each given the next.
    eliminated: Vec<Eliminated<M>>,
    /// The row of the M-th measurement.
    pub(super) row: usize,
    pub(super) belief: Belief<M>,
    /// Sum of squares by which the first measurements contradict each other.
    pub(super) squares: f64,
}

/// Beliefs that the forward pass keeps for the backward pass.
struct Kept<const M: usize> {
    /// The beliefs of every [`STRETCH`]-th row from the start on.
    beliefs: Vec<Belief<M>>,
    /// The beliefs of all rows of the last stretch.
    stretch: Beliefs<M>,
    /// The least value of the objective.
    squares: f64,
}

/// Measurements under a prior, of which there are enough to determine the state.
pub(crate) struct Smoother<S, const M: usize> {
    rows: S,
    chain: Chain<M>,
}

impl<S: Sequence<M>, const M: usize> Smoother<S, M> {
    pub(crate) fn new(rows: S, lambda: f64) -> Self {
        Self { rows, chain: Chain::new(1.0 / lambda) }
    }

    /// Returns true if the measurements determine the state.
    pub(crate) fn is_determined(&self) -> bool {
        let (mut known, mut measured) = (Information::<M>::default(), 0);
        for row in 0..self.rows.rows() {
            if row > 0 {
                known.step(&self.chain.step(self.rows.step_to(row)));
            }
            measured += usize::from(self.rows.begin(row, &mut known));
            if self.rows.is_begun(measured, &known) {
                return true;
            }
        }
        false
    }

    pub(super) fn start(&self) -> Start<M> {
        let mut known = Information::<M>::default();
        let mut eliminated = Vec::new();
        let (mut measured, mut row) = (0, 0);
        loop {
            measured += usize::from(self.rows.begin(row, &mut known));
            if self.rows.is_begun(measured, &known) {
                return Start { eliminated, row, belief: known.belief(), squares: known.squares };
            }
            row += 1;
            eliminated.push(known.step(&self.chain.step(self.rows.step_to(row))));
        }
    }

    /// The belief of `row` from that of the row before, and what was measured beside what it expected.
    #[inline(always)]
    fn advance(&self, belief: &Belief<M>, row: usize) -> (Belief<M>, Option<Innovation>) {
        let dt = self.rows.step_to(row);
        // Of one instant no step is made.
        let mut next = if dt > 0.0 { belief.predicted(&self.chain.step(dt)) } else { *belief };
        let innovation = self.rows.learn(row, &mut next);
        (next, innovation)
    }

    /// Hands out the state of every row given all measurements, from the last row to the first.
    /// The least value of the objective.
    pub(crate) fn smooth(&self, mut emit: impl FnMut(usize, &Posterior<M>)) -> f64 {
        let start = self.start();
        let Kept { beliefs: kept, mut stretch, squares } = self.kept(&start);
        let mut state: Option<Posterior<M>> = None;
        for (at, belief) in kept.iter().enumerate().rev() {
            let first = start.row + at * STRETCH;
            if at + 1 < kept.len() {
                self.filter_again(belief, first, &mut stretch);
            }
            self.back(&stretch, first, &mut state, &mut emit);
        }
        for (row, eliminated) in start.eliminated.iter().enumerate().rev() {
            let smoothed = state.map(|next| eliminated.smoothed(&next));
            if let Some(smoothed) = &smoothed {
                emit(row, smoothed);
            }
            state = smoothed;
        }
        squares
    }

    /// Hands out the state of every row given the measurements up to it, from the first row that these determine on.
    pub(crate) fn filter(&self, mut emit: impl FnMut(usize, &Posterior<M>)) {
        let Start { row: first, mut belief, .. } = self.start();
        emit(first, &belief.posterior());
        for row in first + 1..self.rows.rows() {
            belief = self.advance(&belief, row).0;
            emit(row, &belief.posterior());
        }
    }

    /// Goes back over a stretch from the state of the row after it.
    fn back(
        &self,
        stretch: &Beliefs<M>,
        first: usize,
        state: &mut Option<Posterior<M>>,
        emit: &mut impl FnMut(usize, &Posterior<M>),
    ) {
        let (mut steps, mut links) = ([0.0; PIECE], Links::new());
        for from in (0..stretch.rows()).step_by(PIECE).rev() {
            let mut rest = PIECE.min(stretch.rows() - from);
            let mut next = match *state {
                Some(next) => next,
                None => {
                    rest -= 1;
                    let last = stretch.get(from + rest).posterior();
                    emit(first + from + rest, &last);
                    last
                }
            };
            for (at, step) in steps[..rest].iter_mut().enumerate() {
                *step = self.rows.step_to(first + from + at + 1);
            }
            links.make(&self.chain, stretch, from, &steps);
            for at in (0..rest).rev() {
                // Of one instant there is one state.
                if steps[at] > 0.0 {
                    let step = self.chain.step(steps[at]);
                    next = links.get(at).smoothed(&step.forward(&stretch.mean(from + at)), &step, &next);
                }
                emit(first + from + at, &next);
            }
            *state = Some(next);
        }
    }

    /// The beliefs of every [`STRETCH`]-th row from the start on, and all of the last stretch.
    fn kept(&self, start: &Start<M>) -> Kept<M> {
        let (mut belief, mut squares) = (start.belief, start.squares);
        let (mut kept, mut stretch) = (vec![belief], Beliefs::new(STRETCH.min(self.rows.rows())));
        stretch.push(&belief);
        for row in start.row + 1..self.rows.rows() {
            let innovation;
            (belief, innovation) = self.advance(&belief, row);
            squares += innovation.map_or(0.0, Innovation::square);
            if (row - start.row).is_multiple_of(STRETCH) {
                kept.push(belief);
                stretch.clear();
            }
            stretch.push(&belief);
        }
        Kept { beliefs: kept, stretch, squares }
    }

    /// The beliefs of the rows from `first` up to the next that was kept.
    fn filter_again(&self, belief: &Belief<M>, first: usize, stretch: &mut Beliefs<M>) {
        stretch.clear();
        stretch.push(belief);
        let mut belief = *belief;
        for row in first + 1..(first + STRETCH).min(self.rows.rows()) {
            belief = self.advance(&belief, row).0;
            stretch.push(&belief);
        }
    }
}
