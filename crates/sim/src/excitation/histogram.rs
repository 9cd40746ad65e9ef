//! Counts of visits over a box of bins.

use super::nonuniformity;

/// One side of a histogram's box: `bins` equal bins over `[low, high)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    /// In the unit of what is counted.
    pub low: f64,
    /// In the unit of what is counted.
    pub high: f64,
    /// At least 1.
    pub bins: usize,
}

impl Axis {
    /// The bin that a value falls into; the upper end belongs to the last one.
    pub fn bin(&self, value: f64) -> Option<usize> {
        if !(self.low..=self.high).contains(&value) {
            return None;
        }
        Some(
            ((self.bins as f64 * (value - self.low) / (self.high - self.low)) as usize)
                .min(self.bins.saturating_sub(1)),
        )
    }

    /// The lower and the upper end of a bin.
    pub fn edges(&self, bin: usize) -> [f64; 2] {
        [bin, bin + 1].map(|edge| self.low + (self.high - self.low) * edge as f64 / self.bins as f64)
    }
}

/// Counts of samples in each bin of a box, one axis for each of their values. Its size does not grow with the samples,
/// and histograms over the same axes merge.
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    axes: Vec<Axis>,
    counts: Vec<u64>,
    outside: u64,
}

impl Histogram {
    /// Without a visit. It keeps the product of the axes' bins as numbers.
    pub fn new(axes: impl IntoIterator<Item = Axis>) -> Self {
        let axes: Vec<Axis> = axes.into_iter().collect();
        let bins = axes.iter().map(|axis| axis.bins).product();
        Self { axes, counts: vec![0; bins], outside: 0 }
    }

    /// Counts a sample, one value an axis.
    pub fn add(&mut self, sample: &[f64]) {
        let bin = self
            .axes
            .iter()
            .zip(sample)
            .try_fold(0, |index, (axis, &value)| Some(index * axis.bins + axis.bin(value)?));
        match bin.and_then(|bin| self.counts.get_mut(bin)) {
            Some(count) => *count += 1,
            None => self.outside += 1,
        }
    }

    /// Adds the counts of another histogram; false, and nothing is added, if it has other axes.
    pub fn merge(&mut self, other: &Self) -> bool {
        if self.axes != other.axes {
            return false;
        }
        self.counts.iter_mut().zip(&other.counts).for_each(|(count, more)| *count += more);
        self.outside += other.outside;
        true
    }

    /// Its axes.
    pub fn axes(&self) -> &[Axis] {
        &self.axes
    }

    /// Visits of each bin; the last axis runs fastest.
    pub fn counts(&self) -> &[u64] {
        &self.counts
    }

    /// Samples that fell into no bin.
    pub fn outside(&self) -> u64 {
        self.outside
    }

    /// [`nonuniformity`] of the visits; NaN without one.
    pub fn nonuniformity(&self) -> f64 {
        nonuniformity(self.counts.iter().map(|&count| count as f64))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_fall_into_their_bins() {
        let axis = Axis { low: -1.0, high: 1.0, bins: 4 };
        assert_eq!(
            [-1.0, -0.5001, -0.5, 0.99, 1.0, 1.01, -1.01, f64::NAN].map(|x| axis.bin(x)),
            [Some(0), Some(0), Some(1), Some(3), Some(3), None, None, None]
        );
        assert_eq!(axis.edges(1), [-0.5, 0.0]);
        let mut plane = Histogram::new([axis, Axis { low: 0.0, high: 3.0, bins: 3 }]);
        plane.add(&[0.7, 1.5]);
        plane.add(&[0.7, 7.0]);
        assert_eq!(plane.counts()[3 * 3 + 1], 1);
        assert_eq!((plane.counts().iter().sum::<u64>(), plane.outside()), (1, 1));
        let mut double = plane.clone();
        assert!(double.merge(&plane));
        assert_eq!((double.counts()[10], double.outside()), (2, 2));
        assert!(!double.merge(&Histogram::new([axis])));
    }
}
