//! Position of a row in a repeating motion: a gait's phase, or its label.

use std::{collections::BTreeSet, f64::consts::PI};

use fleetfoot_data::Column;
use fleetfoot_library::Expr;
use fleetfoot_model::PhaseBins;

use crate::{Error, labels::limit_labels};

/// A column along which regions are counted, and from stride to stride.
#[derive(Debug, Clone, PartialEq)]
pub struct Phase {
    /// As the user wrote it.
    pub specification: String,
    /// Its value in a row.
    pub column: Expr,
    /// Kind of its values.
    pub kind: PhaseKind,
}

/// Kind of a phase's values.
#[derive(Debug, Clone, PartialEq)]
pub enum PhaseKind {
    /// They come round.
    Cyclic {
        /// Equal bins of a period.
        bins: usize,
        /// The period; `None`: 1 where all values are in [0, 1], else 2 pi where they are in [-pi, 2 pi].
        period: Option<f64>,
    },
    /// Labels, which this column names.
    Labels(Column),
}

/// Largest relative excess over a period that counts as rounding.
const ROUNDED: f64 = 1e-6;

/// The values that a phase takes.
#[derive(Debug, Clone)]
pub(crate) struct Seen {
    low: f64,
    high: f64,
    labels: Option<BTreeSet<u64>>,
}

impl Seen {
    pub(crate) fn new(phase: &Phase) -> Self {
        let labels = matches!(phase.kind, PhaseKind::Labels(_)).then(BTreeSet::new);
        Self { low: f64::INFINITY, high: f64::NEG_INFINITY, labels }
    }

    /// Takes in some rows.
    ///
    /// # Errors
    /// More values than labels have.
    pub(crate) fn add(&mut self, values: &[f64], phase: &Phase) -> Result<(), Error> {
        let mut last = None;
        for &value in values {
            (self.low, self.high) = (self.low.min(value), self.high.max(value));
            if let (Some(labels), true) = (&mut self.labels, last != Some(value)) {
                labels.insert((value + 0.0).to_bits());
                last = Some(value);
            }
        }
        self.labels.as_ref().map_or(Ok(()), |labels| limit_labels(&phase.column.to_string(), labels))
    }

    /// Merges the values of other rows.
    ///
    /// # Errors
    /// More values than labels have.
    pub(crate) fn merge(&mut self, other: Self, phase: &Phase) -> Result<(), Error> {
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
        if let (Some(labels), Some(more)) = (&mut self.labels, other.labels) {
            labels.extend(more);
            limit_labels(&phase.column.to_string(), labels)?;
        }
        Ok(())
    }

    /// Bins of the values.
    ///
    /// # Errors
    /// The values are no phase.
    pub(crate) fn scale(&self, phase: &Phase) -> Result<Scale, Error> {
        match &phase.kind {
            PhaseKind::Labels(column) => {
                let mut values: Vec<f64> = self.labels.iter().flatten().map(|&bits| f64::from_bits(bits)).collect();
                values.sort_by(f64::total_cmp);
                let names = values.iter().map(|&value| column.label(value)).collect();
                Ok(Scale::Labels { values, names })
            }
            &PhaseKind::Cyclic { bins, period } => {
                let within = |low: f64, high: f64| self.low >= low - ROUNDED && self.high <= high + ROUNDED;
                let guessed = period.or_else(|| within(0.0, 1.0).then_some(1.0));
                let guessed = guessed.or_else(|| within(-PI, 2.0 * PI).then_some(2.0 * PI));
                let not = || Error::NoPhase { column: phase.column.to_string(), low: self.low, high: self.high };
                Ok(Scale::Cyclic { period: guessed.ok_or_else(not)?, bins })
            }
        }
    }
}

/// Bins of a phase's values.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Scale {
    Cyclic { period: f64, bins: usize },
    Labels { values: Vec<f64>, names: Vec<String> },
}

impl Scale {
    pub(crate) fn bins(&self) -> PhaseBins {
        match self {
            &Self::Cyclic { period, bins } => PhaseBins::Cyclic { period, count: bins },
            Self::Labels { names, .. } => PhaseBins::Labels(names.clone()),
        }
    }

    pub(crate) fn count(&self) -> usize {
        match self {
            Self::Cyclic { bins, .. } => *bins,
            Self::Labels { values, .. } => values.len(),
        }
    }

    /// The bin of a value.
    pub(crate) fn bin(&self, value: f64) -> usize {
        match self {
            Self::Cyclic { period, bins } => {
                ((value.rem_euclid(*period) / period * *bins as f64) as usize).min(bins - 1)
            }
            Self::Labels { values, .. } => values.partition_point(|&label| label < value).min(values.len() - 1),
        }
    }

    /// Number of strides that begin between two neighbouring rows. It is 1 if the phase wraps (the shorter way round)
    /// or enters the first label, and -1 if it wraps back.
    pub(crate) fn turn(&self, before: f64, after: f64) -> i64 {
        match self {
            Self::Cyclic { period, .. } => {
                let rise = after.rem_euclid(*period) - before.rem_euclid(*period);
                i64::from(rise < -0.5 * period) - i64::from(rise > 0.5 * period)
            }
            Self::Labels { .. } => i64::from(self.bin(after) == 0 && self.bin(before) != 0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn phase(kind: PhaseKind) -> Phase {
        Phase { specification: "q".into(), column: Expr::column("q"), kind }
    }

    fn scale(values: &[f64], period: Option<f64>) -> Result<Scale, Error> {
        let phase = phase(PhaseKind::Cyclic { bins: 4, period });
        let (one, two) = values.split_at(values.len() / 2);
        let (mut seen, mut more) = (Seen::new(&phase), Seen::new(&phase));
        seen.add(one, &phase)?;
        more.add(two, &phase)?;
        seen.merge(more, &phase)?;
        seen.scale(&phase)
    }

    #[test]
    fn period_follows_from_values_or_option() {
        let period = |values: &[f64]| match scale(values, None).unwrap() {
            Scale::Cyclic { period, .. } => period,
            Scale::Labels { .. } => f64::NAN,
        };
        assert_eq!(period(&[0.0, 0.4, 0.999]), 1.0);
        assert_eq!([period(&[0.0, 0.4, 6.2]), period(&[-3.1, 0.4, 3.1])], [2.0 * PI; 2]);
        assert_eq!(scale(&[40.0, 3.0], Some(2.0 * PI)).unwrap(), Scale::Cyclic { period: 2.0 * PI, bins: 4 });
        let error = scale(&[0.0, 12.5], None).unwrap_err().to_string();
        assert!(["`q`", "12.5", "angle", "labels:"].iter().all(|part| error.contains(part)), "{error}");
    }

    #[test]
    fn bins_and_turns() {
        let scale = Scale::Cyclic { period: 2.0 * PI, bins: 4 };
        assert_eq!([0.0, 1.6, 3.2, 4.8, 6.3, -0.1, -1e-300].map(|value| scale.bin(value)), [0, 1, 2, 3, 0, 3, 3]);
        // Unwound angles and wound ones tell the same.
        for (before, after, turns) in
            [(6.2, 0.1, 1), (6.2, 6.4, 1), (0.1, 6.2, -1), (-0.1, 0.1, 1), (1.0, 3.0, 0), (9.0, 9.2, 0)]
        {
            assert_eq!(scale.turn(before, after), turns, "{before} {after}");
        }
        let labels = Scale::Labels { values: vec![1.0, 4.0, 9.0], names: vec![] };
        assert_eq!([1.0, 4.0, 9.0].map(|value| labels.bin(value)), [0, 1, 2]);
        assert_eq!([labels.turn(9.0, 1.0), labels.turn(1.0, 1.0), labels.turn(1.0, 4.0)], [1, 0, 0]);
    }

    #[test]
    fn labels_are_named() {
        let of = phase(PhaseKind::Labels(Column {
            kind: fleetfoot_data::ColumnKind::Category(vec!["air".into(), "ground".into()]),
            ..Column::float("q")
        }));
        let mut seen = Seen::new(&of);
        seen.add(&[1.0, 1.0, 0.0, -0.0], &of).unwrap();
        assert_eq!(seen.scale(&of).unwrap().bins(), PhaseBins::Labels(vec!["air".into(), "ground".into()]));
        let many: Vec<f64> = (0..2000).map(f64::from).collect();
        assert!(matches!(Seen::new(&of).add(&many, &of), Err(Error::TooManyLabels { .. })));
    }
}
