//! Values in bins: the length of a drawing is the number of bins, for any number of rows.

/// Bins of equal width along an axis; in each the number, mean, deviation and extremes of the values whose places fall into it.
///
/// The width is a power of two and the edges are its multiples. It is the smallest width with at most the allowed
/// number of bins. The range of the places need not be known beforehand, the order of the values matters only for the
/// rounding of the means, and bins of parts merge.
///
/// ```
/// use fleetfoot_report::Bins;
///
/// let mut bins = Bins::new(8);
/// for row in 0..1000 {
///     bins.add(0.01 * f64::from(row), f64::from(row));
/// }
/// assert_eq!((bins.width(), bins.counts().len()), (2.0, 5));
/// assert_eq!((bins.counts()[0], bins.lows()[0], bins.highs()[0], bins.means()[0]), (200, 0.0, 199.0, 99.5));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Bins {
    most: usize,
    width: f64,
    /// One over the width: a power of two as well, so that its products are the quotients.
    inverse: f64,
    /// Places over the width have this index in the first bin.
    first: i64,
    /// From the first to the last that has a value.
    bins: Vec<Bin>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Bin {
    count: u64,
    sum: f64,
    squares: f64,
    low: f64,
    high: f64,
}

const EMPTY: Bin = Bin { count: 0, sum: 0.0, squares: 0.0, low: f64::INFINITY, high: f64::NEG_INFINITY };

/// The finest width, 2^-1000, and the largest index of a bin: beyond it the edges were rounded.
const FINEST: f64 = f64::from_bits(23 << 52);
const LAST: i64 = 1 << 51;

impl Bin {
    fn with(self, other: Self) -> Self {
        Self {
            count: self.count + other.count,
            sum: self.sum + other.sum,
            squares: self.squares + other.squares,
            low: self.low.min(other.low),
            high: self.high.max(other.high),
        }
    }
}

impl Bins {
    /// So many bins at most; at least four, which the numbers of both signs need.
    pub fn new(most: usize) -> Self {
        Self { most: most.max(4), width: FINEST, inverse: 1.0 / FINEST, first: 0, bins: Vec::new() }
    }

    /// Adds a value at a place; one that is not finite is left out.
    pub fn add(&mut self, place: f64, value: f64) {
        if !(place.is_finite() && value.is_finite()) {
            return;
        }
        let bin = Bin { count: 1, sum: value, squares: value * value, low: value, high: value };
        let at = self.index(place).wrapping_sub(self.first);
        match usize::try_from(at).ok().and_then(|at| self.bins.get_mut(at)) {
            Some(known) => *known = known.with(bin),
            None => self.reach(place, bin),
        }
    }

    /// Adds a value at a place that no bin has.
    fn reach(&mut self, place: f64, bin: Bin) {
        while !self.has_room(self.index(place), self.index(place)) {
            self.coarsen();
        }
        let at = self.index(place);
        self.extend(at, at);
        let total = &mut self.bins[(at - self.first) as usize];
        *total = total.with(bin);
    }

    fn index(&self, place: f64) -> i64 {
        let share = place * self.inverse;
        // A value just below zero may be so small that its share is none.
        if share == 0.0 && place < 0.0 {
            return -1;
        }
        // The floor; its function is a call where the machine's instructions are the oldest.
        let towards_zero = share as i64;
        towards_zero.saturating_sub(i64::from((towards_zero as f64) > share))
    }

    fn last(&self) -> i64 {
        self.first + self.bins.len() as i64 - 1
    }

    /// Returns true if bins from one index to another can stand beside the present ones.
    fn has_room(&self, from: i64, to: i64) -> bool {
        let (from, to) = if self.bins.is_empty() { (from, to) } else { (from.min(self.first), to.max(self.last())) };
        // A sum of squares of whole numbers this large still fits.
        from > -LAST && to < LAST && to - from < self.most as i64
    }

    /// Empty bins up to these indices.
    fn extend(&mut self, from: i64, to: i64) {
        if self.bins.is_empty() {
            (self.first, self.bins) = (from, vec![EMPTY]);
        }
        let before = (self.first - from).max(0);
        self.bins.splice(0..0, std::iter::repeat_n(EMPTY, before as usize));
        self.first -= before;
        let after = (to - self.last()).max(0) as usize;
        self.bins.extend(std::iter::repeat_n(EMPTY, after));
    }

    /// Bins of twice the width.
    fn coarsen(&mut self) {
        let first = self.first.div_euclid(2);
        let mut bins =
            vec![EMPTY; if self.bins.is_empty() { 0 } else { (self.last().div_euclid(2) - first + 1) as usize }];
        for (at, &bin) in self.bins.iter().enumerate() {
            let into = &mut bins[((self.first + at as i64).div_euclid(2) - first) as usize];
            *into = into.with(bin);
        }
        (self.first, self.bins) = (first, bins);
        (self.width, self.inverse) = (2.0 * self.width, 0.5 * self.inverse);
    }

    /// The same values in bins of at least a width; one that is a power of two is met.
    pub fn coarser(mut self, width: f64) -> Self {
        while !self.bins.is_empty() && self.width < width {
            self.coarsen();
        }
        self
    }

    /// Merges other bins.
    pub fn merge(&mut self, other: &Self) {
        if other.bins.is_empty() {
            return;
        }
        let mut other = other.clone().coarser(self.width);
        while self.width < other.width || !self.has_room(other.first, other.last()) {
            self.coarsen();
            other = other.coarser(self.width);
        }
        self.extend(other.first, other.last());
        for (at, &bin) in other.bins.iter().enumerate() {
            let total = &mut self.bins[(other.first - self.first) as usize + at];
            *total = total.with(bin);
        }
    }

    /// Width of a bin.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// The middle of every bin.
    pub fn places(&self) -> Vec<f64> {
        (0..self.bins.len()).map(|bin| (self.first as f64 + bin as f64 + 0.5) * self.width).collect()
    }

    /// Values in every bin.
    pub fn counts(&self) -> Vec<u64> {
        self.bins.iter().map(|bin| bin.count).collect()
    }

    /// The mean in every bin; NaN of an empty one.
    pub fn means(&self) -> Vec<f64> {
        self.bins.iter().map(|bin| bin.sum / bin.count as f64).collect()
    }

    /// The standard deviation in every bin (divisor: values); NaN of an empty one.
    pub fn deviations(&self) -> Vec<f64> {
        self.bins.iter().map(|bin| spread(bin).sqrt() / (bin.count as f64).sqrt()).collect()
    }

    /// The least value in every bin; NaN of an empty one.
    pub fn lows(&self) -> Vec<f64> {
        self.bins.iter().map(|bin| if bin.count > 0 { bin.low } else { f64::NAN }).collect()
    }

    /// The largest value in every bin; NaN of an empty one.
    pub fn highs(&self) -> Vec<f64> {
        self.bins.iter().map(|bin| if bin.count > 0 { bin.high } else { f64::NAN }).collect()
    }

    /// The standard deviation of all values (divisor: values); NaN without one.
    pub fn deviation(&self) -> f64 {
        let all = self.bins.iter().fold(EMPTY, |all, bin| all.with(*bin));
        (spread(&all) / all.count as f64).sqrt()
    }

    /// The share of the values' variance that the means of the bins explain, less the share by chance for independent
    /// values (Kelley's epsilon squared, 1935). NaN if it is not known.
    pub fn explained(&self) -> f64 {
        let filled = self.bins.iter().filter(|bin| bin.count > 0);
        let (groups, all) = filled.clone().fold((0.0, EMPTY), |(groups, all), bin| (groups + 1.0, all.with(*bin)));
        let within: f64 = filled.map(spread).sum();
        let free = all.count as f64 - groups;
        1.0 - within / free * (all.count as f64 - 1.0) / spread(&all)
    }
}

/// The sum of squares about the mean.
fn spread(bin: &Bin) -> f64 {
    (bin.squares - bin.sum * bin.sum / bin.count as f64).max(0.0)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::{Bins, FINEST};

    fn of(values: &[(f64, i32)]) -> Bins {
        let mut bins = Bins::new(7);
        values.iter().for_each(|&(place, value)| bins.add(place, f64::from(value)));
        bins
    }

    fn any_place() -> impl Strategy<Value = f64> {
        prop_oneof![6 => -10.0..10.0f64, 2 => any::<f64>(), 1 => prop::sample::select(vec![0.0, -0.0, 1e-320, 5.0, 1e300])]
    }

    proptest! {
        #[test]
        fn bins_of_parts_are_the_bins_of_the_whole(values in prop::collection::vec((any_place(), -1000i32..1000), 0..60), cut in 0usize..60) {
            let whole = of(&values);
            let (first, second) = values.split_at(cut.min(values.len()));
            let (mut merged, mut turned) = (of(first), of(second));
            merged.merge(&of(second));
            turned.merge(&of(first));
            // Sums of whole numbers are exact in any order.
            prop_assert_eq!(&merged, &whole);
            prop_assert_eq!(&turned, &whole);
            let finite = values.iter().filter(|(place, _)| place.is_finite()).count();
            prop_assert_eq!(whole.counts().iter().sum::<u64>(), finite as u64);
            prop_assert!(whole.counts().len() <= 7);
        }
    }

    #[test]
    fn width_is_the_smallest_sufficient() {
        let bins = of(&[(3.0, 1), (3.5, 1), (6.9, 2)]);
        assert_eq!((bins.width(), bins.counts()), (1.0, vec![2, 0, 0, 1]));
        assert_eq!(bins.places(), [3.5, 4.5, 5.5, 6.5]);
        assert_eq!(bins.coarser(2.0).counts(), [2, 0, 1]);
        assert_eq!(FINEST, 2f64.powi(-1000));
    }

    #[test]
    fn non_finite_values_are_left_out() {
        let mut bins = Bins::new(3);
        bins.add(5.0, 1.0);
        bins.add(f64::NAN, 1.0);
        bins.add(0.0, f64::INFINITY);
        assert_eq!(bins.counts(), [1]);
        assert!((bins.places()[0] - 5.0).abs() < 1e-12, "a place alone has a bin as fine as its digits");
        assert!(of(&[(0.0, 1), (3.0, 1), (6.0, 1)]).means()[1].is_nan());
    }

    #[test]
    fn only_different_means_explain() {
        let rows = || (0..4000).map(|row| (f64::from(row % 40), f64::from((row * 7919) % 101)));
        let mut noise = Bins::new(40);
        rows().for_each(|(place, value)| noise.add(place, value));
        assert!(noise.explained().abs() < 0.02, "{}", noise.explained());
        let mut bias = Bins::new(40);
        rows().for_each(|(place, value)| bias.add(place, value + 1000.0 * place));
        assert!(bias.explained() > 0.99);
        assert!((bias.deviations()[3] - noise.deviations()[3]).abs() < 1e-6);
        assert!(Bins::new(4).explained().is_nan());
    }
}
