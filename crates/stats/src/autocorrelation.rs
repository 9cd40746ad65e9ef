//! Autocorrelation of a sequence at chosen lags, in one pass; parts of the sequence can be merged.

/// The autocorrelation of a sequence at chosen lags, with memory of the largest lag alone. Values that are not finite are in no pair.
///
/// ```
/// use fleetfoot_stats::Autocorrelation;
///
/// let mut seen = Autocorrelation::new(&[1, 2]);
/// (0..1000).for_each(|row| seen.push(if row % 2 == 0 { 1.0 } else { -1.0 }));
/// let coefficients = seen.coefficients();
/// assert!((coefficients[0] + 1.0).abs() < 1e-2 && (coefficients[1] - 1.0).abs() < 1e-2);
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Autocorrelation {
    lags: Vec<usize>,
    pairs: Vec<Pairs>,
    /// All values with themselves.
    squares: Pairs,
    /// The first values, as many as the largest lag: what they make pairs with may stand in the part before.
    first: Vec<f64>,
    /// The last values, in a ring as long as the largest lag.
    recent: Vec<f64>,
    next: usize,
}

/// Sums over pairs of values.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Pairs {
    count: f64,
    early: f64,
    late: f64,
    product: f64,
}

impl Pairs {
    fn add(&mut self, early: f64, late: f64) {
        let product = early * late;
        // One test for both: a value that is not finite makes the product so.
        if product.is_finite() {
            self.count += 1.0;
            self.early += early;
            self.late += late;
            self.product += product;
        }
    }

    fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.early += other.early;
        self.late += other.late;
        self.product += other.product;
    }

    fn covariance(&self) -> f64 {
        (self.product - self.early * self.late / self.count) / self.count
    }
}

impl Autocorrelation {
    /// Of these lags, in rows; lags of zero are one.
    pub fn new(lags: &[usize]) -> Self {
        let lags: Vec<usize> = lags.iter().map(|&lag| lag.max(1)).collect();
        let length = lags.iter().copied().max().unwrap_or(1);
        let pairs = vec![Pairs::default(); lags.len()];
        Self { lags, pairs, squares: Pairs::default(), first: Vec::new(), recent: vec![f64::NAN; length], next: 0 }
    }

    /// The next value.
    pub fn push(&mut self, value: f64) {
        let length = self.recent.len();
        self.squares.add(value, value);
        if self.first.len() < length {
            self.first.push(value);
        }
        for (&lag, pairs) in self.lags.iter().zip(&mut self.pairs) {
            let before = self.next + length - lag;
            pairs.add(self.recent[if before >= length { before - length } else { before }], value);
        }
        self.recent[self.next] = value;
        self.next = if self.next + 1 == length { 0 } else { self.next + 1 };
    }

    /// Ends the sequence: what comes next makes no pairs with what was.
    pub fn interrupt(&mut self) {
        // For a part that is appended to another one, values of no pair stand for the end.
        let room = self.recent.len() - self.first.len();
        self.first.extend(std::iter::repeat_n(f64::NAN, room));
        self.recent.fill(f64::NAN);
    }

    /// Takes the values that follow, with the pairs that they make over the seam. `other` has the same lags.
    ///
    /// # Panics
    /// The lags differ.
    pub fn append(&mut self, other: &Self) {
        assert_eq!(self.lags, other.lags, "parts of one sequence have the same lags");
        let length = self.recent.len();
        for (&lag, (pairs, others)) in self.lags.iter().zip(self.pairs.iter_mut().zip(&other.pairs)) {
            for (place, &late) in other.first.iter().enumerate().take(lag) {
                pairs.add(self.recent[(self.next + length + place - lag) % length], late);
            }
            pairs.merge(others);
        }
        self.squares.merge(&other.squares);
        let room = length - self.first.len();
        self.first.extend(other.first.iter().take(room));
        // A whole ring of the other replaces this one's; else it has all of its values among its first ones.
        if other.first.len() == length {
            (self.recent, self.next) = (other.recent.clone(), other.next);
        } else {
            for &value in &other.first {
                self.recent[self.next] = value;
                self.next = if self.next + 1 == length { 0 } else { self.next + 1 };
            }
        }
    }

    /// Pairs at each lag.
    pub fn pairs(&self) -> Vec<u64> {
        self.pairs.iter().map(|pairs| pairs.count as u64).collect()
    }

    /// The covariance of the pairs at each lag over the variance of all values; NaN without pairs, or where the values do not vary.
    pub fn coefficients(&self) -> Vec<f64> {
        let variance = self.squares.covariance();
        let of = |pairs: &Pairs| if variance > 0.0 { pairs.covariance() / variance } else { f64::NAN };
        self.pairs.iter().map(of).collect()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// The covariance of pairs by its definition.
    fn direct(parts: &[Vec<f64>], lag: usize) -> f64 {
        let pairs: Vec<(f64, f64)> = parts
            .iter()
            .flat_map(|part| part.iter().zip(part.iter().skip(lag)))
            .map(|(&a, &b)| (a, b))
            .filter(|(a, b)| a.is_finite() && b.is_finite())
            .collect();
        let n = pairs.len() as f64;
        let (a, b) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
        pairs.iter().map(|p| (p.0 - a) * (p.1 - b)).sum::<f64>() / n
    }

    #[test]
    fn coefficients_match_definition() {
        let wave = |from: usize| (from..from + 90).map(|row| (0.3 * row as f64).sin() + 0.1 * (row % 7) as f64 + 2.0);
        let mut parts: Vec<Vec<f64>> = vec![wave(0).collect(), wave(1000).collect(), vec![5.0]];
        parts[1][17] = f64::NAN;
        let lags = [1, 2, 3, 30, 89, 200];
        let mut seen = Autocorrelation::new(&lags);
        for part in &parts {
            part.iter().for_each(|&value| seen.push(value));
            seen.interrupt();
        }
        let coefficients = seen.coefficients();
        for (place, &lag) in lags.iter().take(4).enumerate() {
            let exact = direct(&parts, lag) / direct(&parts, 0);
            assert!((coefficients[place] - exact).abs() < 1e-12, "lag {lag}: {} {exact}", coefficients[place]);
        }
        assert_eq!(seen.pairs()[..2], [89 + 87, 88 + 86], "a missing value takes two pairs, an end one");
        assert!(coefficients[5].is_nan(), "no pairs");
    }

    proptest! {
        #[test]
        fn parts_are_the_whole(values in prop::collection::vec(prop_oneof![8 => -9i32..9, 1 => Just(100)], 0..60), cuts in prop::collection::vec(0usize..60, 0..4)) {
            let lags = [1, 3, 7];
            let of = |values: &[i32]| {
                let mut part = Autocorrelation::new(&lags);
                for &value in values {
                    // A large one stands for a row after a gap, and a missing value.
                    if value == 100 {
                        part.interrupt();
                    }
                    part.push(if value == 100 { f64::NAN } else { f64::from(value) });
                }
                part
            };
            let (whole, mut joined) = (of(&values), Autocorrelation::new(&lags));
            let mut cuts: Vec<usize> = cuts.iter().map(|&cut| cut.min(values.len())).chain([0, values.len()]).collect();
            cuts.sort_unstable();
            cuts.windows(2).for_each(|ends| joined.append(&of(&values[ends[0]..ends[1]])));
            // Sums of whole numbers are exact in any order.
            prop_assert_eq!((&joined.pairs, &joined.squares), (&whole.pairs, &whole.squares));
            let bits = |values: &[f64]| values.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            prop_assert_eq!(bits(&joined.coefficients()), bits(&whole.coefficients()));
            // The following rows make the same pairs.
            let (mut a, mut b) = (whole, joined);
            (0..20).for_each(|value| [&mut a, &mut b].into_iter().for_each(|one| one.push(f64::from(value))));
            prop_assert_eq!(&a.pairs, &b.pairs);
        }
    }

    #[test]
    fn values_that_do_not_vary_have_none() {
        let mut seen = Autocorrelation::new(&[1]);
        assert!(seen.coefficients()[0].is_nan());
        (0..5).for_each(|_| seen.push(0.0));
        assert!(seen.coefficients()[0].is_nan());
    }
}
