//! The least and greatest values of columns over rows.

use pulp::NullaryFnOnce;

/// Values that are compared at once.
const LANES: usize = 32;
/// Those of them whose extremes stay in registers, where there are sixteen of four values.
const HALF: usize = LANES / 2;

/// Least and greatest value of every column in every region of a partition (regions x columns).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RegionRanges(pub Vec<Vec<[f64; 2]>>);

impl RegionRanges {
    /// Of no values.
    pub const EMPTY: [f64; 2] = [f64::INFINITY, f64::NEG_INFINITY];

    /// No rows, of so many regions and columns.
    pub fn new(regions: usize, columns: usize) -> Self {
        Self(vec![vec![Self::EMPTY; columns]; regions])
    }

    /// Adds rows, whose values are finite, to their regions, those beyond the last to none; without `regions` all to the first.
    pub fn add(&mut self, columns: &[&[f64]], regions: Option<&[u32]>) {
        let Some(regions) = regions else {
            return extremes(columns, &mut self.0[0]);
        };
        for (column, values) in columns.iter().enumerate() {
            for (&region, &value) in regions.iter().zip(*values) {
                if let Some(ranges) = self.0.get_mut(region as usize) {
                    let range = &mut ranges[column];
                    // Seldom true, so cheaper than writing every time.
                    if value < range[0] {
                        range[0] = value;
                    }
                    if value > range[1] {
                        range[1] = value;
                    }
                }
            }
        }
    }

    /// Adds other rows of the same regions and columns.
    pub fn merge(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(all, some)| widen(all, some));
    }
}

/// Widens ranges by those of other rows.
pub fn widen(ranges: &mut [[f64; 2]], others: &[[f64; 2]]) {
    ranges.iter_mut().zip(others).for_each(|(all, some)| *all = [all[0].min(some[0]), all[1].max(some[1])]);
}

/// Widens the range of every column by its values, which are finite.
pub fn extremes(columns: &[&[f64]], ranges: &mut [[f64; 2]]) {
    fleetfoot_data::arch().dispatch(Extremes { columns, ranges });
}

struct Extremes<'a> {
    columns: &'a [&'a [f64]],
    ranges: &'a mut [[f64; 2]],
}

impl NullaryFnOnce for Extremes<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        self.ranges.iter_mut().zip(self.columns).for_each(|(range, column)| *range = extreme(*range, column));
    }
}

/// A range widened by finite values, several lanes at a time: the order of comparisons does not matter. To be inlined into what carries the target features.
#[inline(always)]
pub fn extreme(range: [f64; 2], values: &[f64]) -> [f64; 2] {
    let (mut least, mut most) = ([range[0]; LANES], [range[1]; LANES]);
    let (whole, rest) = values.as_chunks::<LANES>();
    for from in [0, HALF] {
        let (least, most) = (&mut least[from..from + HALF], &mut most[from..from + HALF]);
        for values in whole {
            let values = &values[from..from + HALF];
            for i in 0..HALF {
                least[i] = if values[i] < least[i] { values[i] } else { least[i] };
                most[i] = if values[i] > most[i] { values[i] } else { most[i] };
            }
        }
    }
    let least = least.iter().chain(rest).fold(range[0], |least, &value| least.min(value));
    let most = most.iter().chain(rest).fold(range[1], |most, &value| most.max(value));
    [least, most]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_match_rows_of_each_region() {
        let column: Vec<f64> = (0..100).map(|i| f64::from((i * 37) % 101) - 50.0).collect();
        let regions: Vec<u32> = (0..100).map(|i| [0, 1, u32::MAX][i % 3]).collect();
        let mut ranges = RegionRanges::new(2, 1);
        ranges.add(&[&column[..40]], Some(&regions[..40]));
        let mut rest = RegionRanges::new(2, 1);
        rest.add(&[&column[40..]], Some(&regions[40..]));
        ranges.merge(&rest);
        let of = |region: u32| {
            let values = || column.iter().zip(&regions).filter(|(_, label)| **label == region).map(|(value, _)| *value);
            [values().fold(f64::INFINITY, f64::min), values().fold(f64::NEG_INFINITY, f64::max)]
        };
        assert_eq!(ranges, RegionRanges(vec![vec![of(0)], vec![of(1)]]));
        let mut whole = RegionRanges::new(1, 1);
        whole.add(&[&column], None);
        assert_eq!(whole.0[0][0], [-50.0, 50.0]);
    }
}
