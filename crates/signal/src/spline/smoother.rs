//! One pass over the rows and back: the filter, its likelihood, the smoother.

use super::{
    chain::Chain,
    filter::{Belief, Innovation, Posterior},
    head::{Eliminated, Information},
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

/// What the filter alone tells of a channel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Likelihood {
    /// Sum of e^2 / v over the innovations: the least value of the spline's objective.
    pub(super) squares: f64,
    /// Sum of log v.
    pub(super) log_variance: f64,
    /// How many innovations: measured rows less the M that determine the start.
    pub(super) count: usize,
}

/// What the smoother tells of a channel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Residuals {
    /// Weighted sum of squared residuals.
    pub(super) squares: f64,
    /// Trace of the hat matrix.
    pub(super) freedom: f64,
}

impl Rows<'_> {
    /// What was measured in a row, and its weight.
    #[inline]
    pub(super) fn measured(&self, row: usize) -> Option<(f64, f64)> {
        let (value, weight) = (self.values[row], self.weights.map_or(1.0, |weights| weights[row]));
        (weight > 0.0 && !value.is_nan()).then_some((value, weight))
    }

    fn step_to(&self, row: usize) -> f64 {
        self.times[row] - self.times[row - 1]
    }
}

/// The first rows, done.
struct Start<const M: usize> {
    /// The states of the rows before `row`, each given the next.
    eliminated: Vec<Eliminated<M>>,
    /// The row of the M-th measurement.
    row: usize,
    belief: Belief<M>,
}

/// A channel under a prior. M measured rows or more.
pub(super) struct Smoother<'a, const M: usize> {
    rows: Rows<'a>,
    chain: Chain<M>,
}

impl<'a, const M: usize> Smoother<'a, M> {
    pub(super) fn new(rows: Rows<'a>, lambda: f64) -> Self {
        Self { rows, chain: Chain::new(lambda) }
    }

    fn start(&self) -> Start<M> {
        let mut known = Information::<M>::default();
        let mut eliminated = Vec::new();
        let (mut measured, mut row) = (0, 0);
        loop {
            if let Some((value, weight)) = self.rows.measured(row) {
                known.measure(value, weight);
                measured += 1;
            }
            if measured == M {
                return Start { eliminated, row, belief: known.belief() };
            }
            row += 1;
            eliminated.push(known.step(&self.chain.step(self.rows.step_to(row))));
        }
    }

    /// The belief of `row` from that of the row before, and what was measured beside what it expected.
    #[inline]
    fn advance(&self, belief: &Belief<M>, row: usize) -> (Belief<M>, Option<Innovation>) {
        let mut next = belief.predicted(&self.chain.step(self.rows.step_to(row)));
        let innovation = self.rows.measured(row).map(|(value, weight)| next.measure(value, 1.0 / weight));
        (next, innovation)
    }

    /// The filter alone.
    pub(super) fn likelihood(&self) -> Likelihood {
        let start = self.start();
        let (mut belief, mut sums) = (start.belief, Likelihood::default());
        for row in start.row + 1..self.rows.times.len() {
            let innovation;
            (belief, innovation) = self.advance(&belief, row);
            if let Some(innovation) = innovation {
                sums.squares += innovation.error * innovation.error / innovation.variance;
                sums.log_variance += innovation.variance.ln();
                sums.count += 1;
            }
        }
        sums
    }

    /// Hands out the state of every row given all measurements, from the last row to the first.
    pub(super) fn smooth(&self, mut emit: impl FnMut(usize, &Posterior<M>)) -> Residuals {
        let start = self.start();
        let (kept, mut stretch) = self.kept(&start);
        let mut residuals = Residuals::default();
        let mut emit = |row: usize, state: &Posterior<M>| {
            if let Some((value, weight)) = self.rows.measured(row) {
                residuals.squares += weight * (value - state.mean[0]) * (value - state.mean[0]);
                residuals.freedom += weight * state.covariance[0][0];
            }
            emit(row, state);
        };
        let mut state: Option<Posterior<M>> = None;
        for (at, belief) in kept.iter().enumerate().rev() {
            let first = start.row + at * STRETCH;
            if at + 1 < kept.len() {
                self.filter_again(belief, first, &mut stretch);
            }
            for (row, belief) in stretch.iter().enumerate().rev().map(|(at, belief)| (first + at, belief)) {
                let own = match &state {
                    None => belief.posterior(),
                    Some(next) => belief.smoothed(&self.chain.step(self.rows.step_to(row + 1)), next),
                };
                emit(row, &own);
                state = Some(own);
            }
        }
        for (row, eliminated) in start.eliminated.iter().enumerate().rev() {
            let own = state.map(|next| eliminated.smoothed(&next));
            if let Some(own) = &own {
                emit(row, own);
            }
            state = own;
        }
        residuals
    }

    /// The beliefs of every [`STRETCH`]-th row from the start on, and all of the last stretch.
    fn kept(&self, start: &Start<M>) -> (Vec<Belief<M>>, Vec<Belief<M>>) {
        let mut belief = start.belief;
        let (mut kept, mut stretch) = (vec![belief], Vec::with_capacity(STRETCH.min(self.rows.times.len())));
        stretch.push(belief);
        for row in start.row + 1..self.rows.times.len() {
            belief = self.advance(&belief, row).0;
            if (row - start.row).is_multiple_of(STRETCH) {
                kept.push(belief);
                stretch.clear();
            }
            stretch.push(belief);
        }
        (kept, stretch)
    }

    /// The beliefs of the rows from `first` up to the next that was kept.
    fn filter_again(&self, belief: &Belief<M>, first: usize, stretch: &mut Vec<Belief<M>>) {
        stretch.clear();
        stretch.push(*belief);
        let mut belief = *belief;
        for row in first + 1..(first + STRETCH).min(self.rows.times.len()) {
            belief = self.advance(&belief, row).0;
            stretch.push(belief);
        }
    }
}
