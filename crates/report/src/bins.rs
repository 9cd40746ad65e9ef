//! Values in bins: what is drawn of many rows is as long as there are bins.

/// Bins of equal width along an axis; in each the number, mean and extremes of the values whose places fall into it.
///
/// The order of the values does not matter but for the rounding of the means, and bins of parts merge.
///
/// ```
/// use fleetfoot_report::Bins;
///
/// let mut bins = Bins::new(0.0, 10.0, 5);
/// for row in 0..1000 {
///     bins.add(0.01 * f64::from(row), f64::from(row));
/// }
/// assert_eq!((bins.counts()[0], bins.lows()[0], bins.highs()[0], bins.means()[0]), (200, 0.0, 199.0, 99.5));
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Bins {
    low: f64,
    width: f64,
    bins: Vec<Bin>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Bin {
    count: u64,
    sum: f64,
    low: f64,
    high: f64,
}

const EMPTY: Bin = Bin { count: 0, sum: 0.0, low: f64::INFINITY, high: f64::NEG_INFINITY };

impl Bins {
    /// So many bins from `low` to `high`; at least one.
    pub fn new(low: f64, high: f64, count: usize) -> Self {
        let count = count.max(1);
        Self { low, width: (high - low) / count as f64, bins: vec![EMPTY; count] }
    }

    /// Adds a value at a place. Places outside go to the first or the last bin; what is not finite is left out.
    pub fn add(&mut self, place: f64, value: f64) {
        if !(place.is_finite() && value.is_finite()) {
            return;
        }
        let share = (place - self.low) / self.width;
        let last = self.bins.len() - 1;
        // Of a single place the width is zero, and everything is in the first bin.
        let at = if share.is_finite() { (share.max(0.0) as usize).min(last) } else { 0 };
        let bin = &mut self.bins[at];
        *bin = Bin { count: bin.count + 1, sum: bin.sum + value, low: bin.low.min(value), high: bin.high.max(value) };
    }

    /// Adds what is in other bins of the same places.
    pub fn merge(&mut self, other: &Self) {
        for (own, other) in self.bins.iter_mut().zip(&other.bins) {
            own.count += other.count;
            own.sum += other.sum;
            own.low = own.low.min(other.low);
            own.high = own.high.max(other.high);
        }
    }

    /// The middle of every bin.
    pub fn places(&self) -> Vec<f64> {
        (0..self.bins.len()).map(|bin| self.low + (bin as f64 + 0.5) * self.width).collect()
    }

    /// Values in every bin.
    pub fn counts(&self) -> Vec<u64> {
        self.bins.iter().map(|bin| bin.count).collect()
    }

    /// The mean in every bin; NaN of an empty one.
    pub fn means(&self) -> Vec<f64> {
        self.bins.iter().map(|bin| bin.sum / bin.count as f64).collect()
    }

    /// The least value in every bin; NaN of an empty one.
    pub fn lows(&self) -> Vec<f64> {
        self.bins.iter().map(|bin| if bin.count > 0 { bin.low } else { f64::NAN }).collect()
    }

    /// The largest value in every bin; NaN of an empty one.
    pub fn highs(&self) -> Vec<f64> {
        self.bins.iter().map(|bin| if bin.count > 0 { bin.high } else { f64::NAN }).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::Bins;

    proptest! {
        #[test]
        fn bins_of_parts_are_the_bins_of_the_whole(values in prop::collection::vec((-1.0f64..11.0, -1000i32..1000), 0..200), cut in 0usize..200) {
            let of = |values: &[(f64, i32)]| {
                let mut bins = Bins::new(0.0, 10.0, 7);
                values.iter().for_each(|&(place, value)| bins.add(place, f64::from(value)));
                bins
            };
            let (first, second) = values.split_at(cut.min(values.len()));
            let mut merged = of(first);
            merged.merge(&of(second));
            // Sums of whole numbers are exact in any order.
            prop_assert_eq!(merged.clone(), of(&values));
            prop_assert_eq!(merged.counts().iter().sum::<u64>(), values.len() as u64);
        }
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let mut bins = Bins::new(0.0, 0.0, 3);
        bins.add(0.0, 1.0);
        bins.add(f64::NAN, 1.0);
        bins.add(0.0, f64::INFINITY);
        assert_eq!(bins.counts(), [1, 0, 0]);
        assert!(bins.means()[1].is_nan() && bins.lows()[2].is_nan());
    }
}
