//! Sums of a channel from one pass over its rows: moments, ends of the range, runs of one value, values far from both neighbours.

use std::ops::Range;

/// Distance from both neighbours, in usual steps, from which on a value is far from them, while the neighbours are near
/// to each other.
const FAR: f64 = 20.0;
const NEIGHBOURS: f64 = 0.3;
/// Distance from both neighbours, in spans of the channel, from which on one value is a fault.
pub(crate) const EXTREME: f64 = 5.0;

/// Usual motion of a channel, from a sample; NaN where it has no two values.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Usual {
    /// Step from row to row.
    pub(crate) step: f64,
    /// Width of the range without the outermost values.
    pub(crate) span: f64,
}

/// A value far from both neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Farthest {
    /// Distance from the nearer neighbour.
    pub(crate) distance: f64,
    pub(crate) value: f64,
    pub(crate) episode: usize,
    /// Row of the episode.
    pub(crate) row: usize,
}

/// Rows at an end of the range, in runs of three and more.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct AtEnd {
    pub(crate) rows: u64,
    /// Runs with other values before and after them. A rest before or after the motion is none.
    pub(crate) visits: u64,
    /// Sum of the steps that lead to these runs.
    pub(crate) entries: f64,
}

/// Consecutive rows of one value.
#[derive(Debug, Clone, Copy)]
struct Run {
    value: f64,
    rows: u64,
    /// The step to it; NaN where no other value is before it.
    entry: f64,
}

impl Run {
    const NONE: Self = Self { value: f64::NAN, rows: 0, entry: f64::NAN };
}

/// Sums of a channel, in the order of its rows.
#[derive(Debug, Clone)]
pub(crate) struct Sums {
    pub(crate) rows: u64,
    pub(crate) missing: u64,
    pub(crate) mean: f64,
    squares: f64,
    pub(crate) least: f64,
    pub(crate) most: f64,
    pub(crate) at_least: AtEnd,
    pub(crate) at_most: AtEnd,
    /// Rows in which the value changes.
    pub(crate) changes: u64,
    /// The smallest change between two rows.
    pub(crate) step: f64,
    /// The longest run of one value.
    pub(crate) longest: u64,
    /// Values that are far from both neighbours, and those of them that are extreme.
    pub(crate) far: u64,
    pub(crate) extreme: u64,
    pub(crate) farthest: Option<Farthest>,
    /// The run at the end of the sums.
    run: Run,
}

impl Default for Sums {
    fn default() -> Self {
        Self {
            rows: 0,
            missing: 0,
            mean: 0.0,
            squares: 0.0,
            least: f64::INFINITY,
            most: f64::NEG_INFINITY,
            at_least: AtEnd::default(),
            at_most: AtEnd::default(),
            changes: 0,
            step: f64::INFINITY,
            longest: 0,
            far: 0,
            extreme: 0,
            farthest: None,
            run: Run::NONE,
        }
    }
}

impl Sums {
    /// Adds the rows of a tile; `all` has the neighbours and begins at the row `first` of the episode, `core` is the
    /// range of the rows.
    pub(crate) fn add(&mut self, all: &[f64], core: Range<usize>, usual: Usual, (episode, first): (usize, usize)) {
        for at in core {
            let value = all[at];
            if !value.is_finite() {
                self.missing += 1;
                self.end_run(false);
                continue;
            }
            self.rows += 1;
            let delta = value - self.mean;
            self.mean += delta / self.rows as f64;
            self.squares += delta * (value - self.mean);
            if value < self.least {
                (self.least, self.at_least) = (value, AtEnd::default());
            }
            if value > self.most {
                (self.most, self.at_most) = (value, AtEnd::default());
            }
            let before = at.checked_sub(1).map_or(f64::NAN, |at| all[at]);
            let after = all.get(at + 1).copied().unwrap_or(f64::NAN);
            let [back, ahead] = [value - before, value - after];
            let entry = if back == 0.0 { f64::NAN } else { back.abs() };
            if entry.is_finite() {
                self.changes += 1;
                self.step = self.step.min(entry);
            }
            let distance = back.abs().min(ahead.abs());
            if back * ahead > 0.0 && (before - after).abs() < NEIGHBOURS * distance {
                self.add_far(Farthest { distance, value, episode, row: first + at }, usual);
            }
            if value == self.run.value {
                self.run.rows += 1;
            } else {
                self.end_run(true);
                self.run = Run { value, rows: 1, entry };
            }
        }
    }

    /// Counts a value beside two neighbours that are near to each other.
    fn add_far(&mut self, candidate: Farthest, usual: Usual) {
        let is_far = usual.step > 0.0 && candidate.distance > FAR * usual.step;
        // Held inputs have no usual step: their values are measured by the span alone.
        let is_extreme = usual.span > 0.0 && candidate.distance > EXTREME * usual.span && (is_far || usual.step == 0.0);
        self.far += u64::from(is_far);
        self.extreme += u64::from(is_extreme);
        if is_far || is_extreme {
            self.keep_farthest(Some(candidate));
        }
    }

    /// Of equals the first.
    fn keep_farthest(&mut self, candidate: Option<Farthest>) {
        let distance = |farthest: &Option<Farthest>| farthest.map_or(0.0, |farthest| farthest.distance);
        if distance(&candidate) > distance(&self.farthest) {
            self.farthest = candidate;
        }
    }

    /// Counts the run that ends; `left` is true if another value follows it.
    fn end_run(&mut self, left: bool) {
        let Run { value, rows, entry } = std::mem::replace(&mut self.run, Run::NONE);
        self.longest = self.longest.max(rows);
        for (end, at_end) in [(self.least, &mut self.at_least), (self.most, &mut self.at_most)] {
            if rows >= 3 && value == end {
                at_end.rows += rows;
                if entry.is_finite() && left {
                    at_end.visits += 1;
                    at_end.entries += entry;
                }
            }
        }
    }

    /// Merges the sums behind.
    pub(crate) fn merge(&mut self, mut other: Self) {
        other.end_run(false);
        let rows = (self.rows + other.rows).max(1) as f64;
        let delta = other.mean - self.mean;
        self.squares += other.squares + delta * delta * self.rows as f64 * other.rows as f64 / rows;
        self.mean += delta * other.rows as f64 / rows;
        let end = |ours: f64, at_end: AtEnd, other: f64, others: AtEnd| match ours.total_cmp(&other) {
            std::cmp::Ordering::Equal => AtEnd {
                rows: at_end.rows + others.rows,
                visits: at_end.visits + others.visits,
                entries: at_end.entries + others.entries,
            },
            std::cmp::Ordering::Less => at_end,
            std::cmp::Ordering::Greater => others,
        };
        self.at_least = end(self.least, self.at_least, other.least, other.at_least);
        self.at_most = end(-self.most, self.at_most, -other.most, other.at_most);
        (self.least, self.most) = (self.least.min(other.least), self.most.max(other.most));
        self.rows += other.rows;
        self.missing += other.missing;
        self.changes += other.changes;
        self.step = self.step.min(other.step);
        self.longest = self.longest.max(other.longest);
        self.far += other.far;
        self.extreme += other.extreme;
        self.keep_farthest(other.farthest);
    }

    pub(crate) fn deviation(&self) -> f64 {
        if self.rows == 0 { f64::NAN } else { (self.squares / self.rows as f64).sqrt() }
    }

    pub(crate) fn moves(&self) -> f64 {
        self.changes as f64 / self.rows.max(1) as f64
    }

    /// Returns true if the channel has one value in all rows.
    pub(crate) fn is_dead(&self) -> bool {
        self.rows > 0 && self.least == self.most
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn summed(values: &[f64], cuts: &[usize]) -> Sums {
        let mut sum = Sums::default();
        let mut from = 0;
        for &to in cuts.iter().chain([&values.len()]) {
            let mut part = Sums::default();
            part.add(values, from..to, Usual { step: 0.01, span: 1.0 }, (0, 0));
            sum.merge(part);
            from = to;
        }
        sum
    }

    proptest! {
        /// Counts and moments do not depend on where chunks end; runs are those of a chunk.
        #[test]
        fn chunks_do_not_matter(values in proptest::collection::vec(-9i8..9, 2..60), cut in 1usize..59) {
            let values: Vec<f64> = values.into_iter().map(f64::from).collect();
            let cut = cut.min(values.len() - 1);
            let (whole, parts) = (summed(&values, &[]), summed(&values, &[cut]));
            prop_assert_eq!((whole.rows, whole.changes), (parts.rows, parts.changes));
            prop_assert_eq!((whole.far, whole.extreme), (parts.far, parts.extreme));
            prop_assert_eq!(whole.farthest, parts.farthest);
            prop_assert_eq!((whole.least, whole.most, whole.step), (parts.least, parts.most, parts.step));
            prop_assert!((whole.mean - parts.mean).abs() < 1e-12 && (whole.squares - parts.squares).abs() < 1e-9);
            prop_assert!(parts.longest <= whole.longest && 2 * parts.longest >= whole.longest);
        }
    }

    #[test]
    fn visits_have_values_on_both_sides() {
        // A rest before the motion, a visit of the most value, and one that lasts until the end.
        let mut values = vec![0.0; 5];
        values.extend([1.0, 2.0, 2.0, 2.0, 1.0, 2.0, 2.0, 2.0, 2.0]);
        let sums = summed(&values, &[]);
        assert_eq!((sums.at_least.rows, sums.at_least.visits), (5, 0));
        assert_eq!((sums.at_most.rows, sums.at_most.visits, sums.at_most.entries), (7, 1, 1.0));
    }
}
