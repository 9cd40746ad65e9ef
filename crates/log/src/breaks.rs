//! Moments at which a log's writer reports lost messages.

/// Such moments, in stamps, sorted.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Breaks(Vec<i64>);

impl Breaks {
    /// Moments on the log's clock as stamps, which are `offset` behind it.
    pub(crate) fn new(moments: &[i64], offset: i64) -> Self {
        Self(moments.iter().map(|moment| moment.saturating_sub(offset)).collect())
    }

    /// The moments.
    pub(crate) fn moments(&self) -> &[i64] {
        &self.0
    }

    /// Returns true if samples were lost between two stamps. A break then lies between them, and the step is longer
    /// than one and a half times `period`, the median of such steps. A channel without messages in between has lost
    /// nothing.
    pub(crate) fn lost(&self, from: i64, to: i64, period: Option<u64>) -> bool {
        let is_long = |period: u64| to.abs_diff(from) > period.saturating_add(period / 2);
        !self.0.is_empty()
            && period.is_some_and(is_long)
            && self.0.get(self.0.partition_point(|&moment| moment < from)).is_some_and(|&moment| moment < to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn breaks_separate_distant_samples() {
        let breaks = Breaks::new(&[1000, 2000], 500);
        assert_eq!(breaks.moments(), [500, 1500]);
        for (from, to, expected) in [
            (490, 506, true),
            (490, 505, false),
            (500, 520, true),
            (480, 500, false),
            (501, 530, false),
            (1490, 1600, true),
            (1600, 1700, false),
        ] {
            assert_eq!(breaks.lost(from, to, Some(10)), expected, "{from} {to}");
        }
        assert!(!breaks.lost(0, 1 << 40, None) && !Breaks::default().lost(0, 1 << 40, Some(1)));
    }
}
