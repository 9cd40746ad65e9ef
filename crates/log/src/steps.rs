//! The median of a stream of positive steps, in bounded memory.

/// Steps up to this many are kept and their median is exact.
const EXACT: usize = 1 << 16;
/// Leading bits of a step that choose its bin: the median of a longer stream is within 1 / 4096 of the truth.
const BITS: u32 = 12;

/// Pauses between bursts that make a pattern.
const FEWEST_BURSTS: f64 = 3.0;

/// Collects steps between stamps, nanoseconds.
#[derive(Debug, Default)]
pub(crate) struct Steps {
    exact: Vec<u64>,
    /// One page of `2^BITS` bins for each power of two that occurs.
    pages: Vec<Option<Box<[Bin]>>>,
    count: u64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Bin {
    count: u64,
    /// Sum of the steps, less the bin's lower edge each: the mean of a bin of equal steps is that step.
    excess: f64,
}

impl Steps {
    /// Adds a step.
    pub(crate) fn push(&mut self, step: u64) {
        self.count += 1;
        if self.count <= EXACT as u64 {
            self.exact.push(step);
            return;
        }
        if !self.exact.is_empty() {
            for step in std::mem::take(&mut self.exact) {
                self.bin(step);
            }
        }
        self.bin(step);
    }

    fn bin(&mut self, step: u64) {
        let page = (u64::BITS - step.leading_zeros()).saturating_sub(BITS) as usize;
        let slot = (step >> page) as usize;
        if self.pages.len() <= page {
            self.pages.resize_with(page + 1, || None);
        }
        let bins = self.pages[page].get_or_insert_with(|| vec![Bin::default(); 1 << BITS].into_boxed_slice());
        bins[slot].count += 1;
        bins[slot].excess += (step - ((slot as u64) << page)) as f64;
    }

    /// The typical step of messages that join others: the median, or the mean where that is longer than two medians, as at least three
    /// steps are, or the period of bursts.
    ///
    /// Messages come in bursts where the mean step is longer than five medians, and at least three steps are. The period of bursts is the median of these
    /// longer steps. Steps beyond fifty mean steps are pauses and do not count.
    pub(crate) fn period(&mut self) -> Option<u64> {
        self.typical(1.0)
    }

    /// The same of rows that episodes are made of: messages that take longer than a twentieth of the period of their bursts are runs of their own.
    pub(crate) fn row_period(&mut self) -> Option<u64> {
        self.typical(0.05)
    }

    /// The typical step; bursts last at most such a share of their period.
    fn typical(&mut self, share: f64) -> Option<u64> {
        let median = self.median()?;
        let mean_below = |distribution: &Self, most: f64| {
            let (mut sum, mut count) = (0.0, 0.0);
            distribution.each(|step, times| {
                if step <= most {
                    (sum, count) = (sum + step * times, count + times);
                }
            });
            sum / count
        };
        let mean = mean_below(self, f64::INFINITY);
        let mean = mean_below(self, 50.0 * mean);
        let longer_than = |distribution: &Self, least: f64| {
            let mut long = Vec::new();
            distribution.each(|step, times| {
                if step > least && step <= 50.0 * mean {
                    long.push((step, times));
                }
            });
            let count: f64 = long.iter().map(|(_, times)| times).sum();
            (long, count)
        };
        let median_step = median as f64;
        let is_even = mean.is_nan() || mean <= 2.0 * median_step;
        if is_even || longer_than(self, 2.0 * median_step).1 < FEWEST_BURSTS {
            return Some(median);
        }
        let (long, count) = longer_than(self, 5.0 * median_step);
        if mean <= 5.0 * median_step || count < FEWEST_BURSTS {
            return Some(mean as u64);
        }
        let mut below = 0.0;
        let period = long.into_iter().find(|(_, times)| {
            below += times;
            below > count / 2.0
        });
        let period = period.map_or(mean, |(step, _)| step);
        // As many short steps as there are for each long one.
        let burst = (self.count as f64 - count) / count * median_step;
        Some(if burst <= share * period { mean.max(period) as u64 } else { mean as u64 })
    }

    /// Every step that was kept, and of a longer stream the mean of every bin, with how many there are; in their order after [`Steps::median`].
    fn each(&self, mut work: impl FnMut(f64, f64)) {
        self.exact.iter().for_each(|&step| work(step as f64, 1.0));
        for (page, bins) in self.pages.iter().enumerate() {
            for (slot, bin) in bins.iter().flat_map(|bins| bins.iter()).enumerate().filter(|(_, bin)| bin.count > 0) {
                work(((slot as u64) << page) as f64 + bin.excess / bin.count as f64, bin.count as f64);
            }
        }
    }

    /// The upper median; `None` without steps.
    pub(crate) fn median(&mut self) -> Option<u64> {
        let rank = self.count / 2;
        if self.count <= EXACT as u64 {
            self.exact.sort_unstable();
            return self.exact.get(rank as usize).copied();
        }
        let mut below = 0;
        for (page, bins) in self.pages.iter().enumerate() {
            for (slot, bin) in bins.iter().flat_map(|bins| bins.iter()).enumerate() {
                below += bin.count;
                if below > rank {
                    return Some(((slot as u64) << page) + (bin.excess / bin.count as f64).round() as u64);
                }
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn median(steps: impl IntoIterator<Item = u64>) -> Option<u64> {
        let mut all = Steps::default();
        steps.into_iter().for_each(|step| all.push(step));
        all.median()
    }

    #[test]
    fn only_bursts_have_a_period() {
        let period = |steps: Vec<u64>| {
            let mut all = Steps::default();
            steps.into_iter().for_each(|step| all.push(step));
            all.period()
        };
        // Six messages 4 us apart every second, in short and in long logs.
        for rounds in [4, 20_000] {
            let steps = (0..6 * rounds).map(|i| if i % 6 == 5 { 1_000_000_000 } else { 4_000 }).collect();
            let period_there = period(steps).unwrap();
            assert!((period_there as f64 / 1e9 - 1.0).abs() < 1e-3, "{period_there}");
        }
        // 100 Hz with an hour's pause, and with a tenth of the messages lost.
        assert_eq!(
            period((0..1000).map(|i| if i == 500 { 3_600_000_000_000 } else { 10_000_000 }).collect()),
            Some(10_000_000)
        );
        assert_eq!(
            period((0..1000).map(|i| if i % 9 == 8 { 20_000_000 } else { 10_000_000 }).collect()),
            Some(10_000_000)
        );
    }

    #[test]
    fn uneven_messages_have_their_mean_step() {
        let steps = |steps: &[u64]| {
            let mut all = Steps::default();
            (0..100).for_each(|_| steps.iter().for_each(|&step| all.push(step)));
            (all.period(), all.row_period())
        };
        // Four messages 10 ms apart, then 80 ms nothing.
        assert_eq!(steps(&[10, 10, 10, 80]), (Some(27), Some(27)));
        // Six at once every second; six over a quarter of a second, which are rows of their own.
        assert_eq!(steps(&[1, 1, 1, 1, 1, 10_000]), (Some(10_000), Some(10_000)));
        assert_eq!(steps(&[50, 50, 50, 50, 50, 10_000]), (Some(10_000), Some(10_000)));
        assert_eq!(steps(&[250, 250, 250, 250, 250, 10_000]), (Some(10_000), Some(1875)));
        // Runs of a hundred rows are parted, those of four are not.
        let mut runs = vec![10; 99];
        runs.push(1000);
        assert_eq!(steps(&runs), (Some(10), Some(10)));
    }

    #[test]
    fn equal_steps_are_exact_at_any_length() {
        assert_eq!(median([]), None);
        assert_eq!(median([7]), Some(7));
        assert_eq!(median((0..300_000).map(|_| 1_000_003)), Some(1_000_003));
        assert_eq!(median((0..300_000).map(|_| 3)), Some(3));
        assert_eq!(median((0..100_000).map(|_| (1 << 40) | 12_345)), Some((1 << 40) | 12_345));
    }

    #[test]
    fn long_streams_are_near_the_sorted_median() {
        let steps: Vec<u64> =
            (0..200_001u64).map(|i| 900_000 + i.wrapping_mul(0x9E37_79B9_7F4A_7C15) % 200_000).collect();
        let mut sorted = steps.clone();
        sorted.sort_unstable();
        let exact = sorted[steps.len() / 2] as f64;
        let streamed = median(steps).unwrap() as f64;
        assert!((streamed / exact - 1.0).abs() < 1.0 / 4096.0, "{streamed} {exact}");
    }
}
