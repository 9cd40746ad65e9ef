//! Axes: their quantities, the places of values, and the labelled values.

use crate::words::typeset;

/// Axis of a chart.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Axis {
    /// The quantity.
    pub label: String,
    /// Its unit, where it has one.
    pub unit: Option<String>,
    /// Spacing of values.
    pub scale: Scale,
    /// True if zero is on the axis; for linear axes.
    pub zero: bool,
    /// Its ends; those of the values where there are none.
    pub range: Option<[f64; 2]>,
}

/// Spacing of values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// By their differences.
    Linear,
    /// By their ratios; values at or below zero are not drawn.
    Logarithmic,
}

impl Axis {
    /// A linear axis of a quantity; an empty unit, or 1, is left out.
    pub fn of(label: impl Into<String>, unit: impl Into<String>) -> Self {
        let unit = Some(unit.into()).filter(|unit| !unit.is_empty() && unit != "1");
        Self { label: label.into(), unit, scale: Scale::Linear, zero: false, range: None }
    }

    /// With zero on it.
    pub fn with_zero(mut self) -> Self {
        self.zero = true;
        self
    }

    /// With these ends.
    pub fn between(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }

    /// Logarithmic where the values above zero span more than two decades and nothing is below: a linear axis would show the largest alone.
    pub fn spread(mut self, values: impl Iterator<Item = f64>) -> Self {
        let [low, high] = extent(values.filter(|value| *value != 0.0));
        if low > 0.0 && high / low > 100.0 {
            self.scale = Scale::Logarithmic;
        }
        self
    }

    /// The quantity with its unit.
    pub(crate) fn title(&self) -> String {
        match &self.unit {
            Some(unit) => format!("{} [{}]", self.label, crate::words::unit(unit)),
            None => self.label.clone(),
        }
    }

    /// The axis between two places on the drawing, for these values.
    pub(crate) fn ruler(&self, values: impl Iterator<Item = f64>, from: f64, to: f64) -> Ruler {
        let logarithmic = self.scale == Scale::Logarithmic;
        let [mut low, mut high] =
            self.range.unwrap_or_else(|| extent(values.filter(|value| !logarithmic || *value > 0.0)));
        if self.zero && !logarithmic && self.range.is_none() {
            (low, high) = (low.min(0.0), high.max(0.0));
        }
        if !(low.is_finite() && high.is_finite()) || low > high || (logarithmic && low <= 0.0) {
            (low, high) = if logarithmic { (0.1, 10.0) } else { (0.0, 1.0) };
        }
        if low == high {
            let half = if logarithmic { 0.0 } else { 0.5 * low.abs().max(1e-12) };
            (low, high) = if logarithmic { (low / 2.0, high * 2.0) } else { (low - half, high + half) };
        }
        let mut ruler = Ruler { low, high, logarithmic, from, to };
        if self.range.is_none() && !logarithmic {
            ruler.widen(self.zero);
        }
        ruler
    }
}

/// The least and the largest finite value; the first above the second where there is none.
pub(crate) fn extent(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values
        .filter(|value| value.is_finite())
        .fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| [low.min(value), high.max(value)])
}

/// Ruler that places values on a drawing.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Ruler {
    pub(crate) low: f64,
    pub(crate) high: f64,
    logarithmic: bool,
    pub(crate) from: f64,
    pub(crate) to: f64,
}

impl Ruler {
    /// Room beyond the values, so that no mark lies on the frame; an end at zero stays there.
    fn widen(&mut self, zero: bool) {
        let room = 0.04 * (self.high - self.low);
        if !(zero && self.low == 0.0) {
            self.low -= room;
        }
        if !(zero && self.high == 0.0) {
            self.high += room;
        }
    }

    /// The place of a value; `None` for NaN, or a value that has no place on a logarithmic axis.
    pub(crate) fn at(&self, value: f64) -> Option<f64> {
        let share = if self.logarithmic {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        };
        // Far beyond the drawing every place is as good as another, and a short one is easier to read.
        share.is_finite().then(|| self.from + share.clamp(-2.0, 3.0) * (self.to - self.from))
    }

    /// Returns true if a value is beyond the end.
    pub(crate) fn is_beyond(&self, value: f64) -> bool {
        value > self.high
    }

    /// Values to write beside the axis, at most about `most`, with their words.
    pub(crate) fn ticks(&self, most: usize) -> Vec<(f64, String)> {
        let values = if self.logarithmic { self.powers(most) } else { self.steps(most) };
        let step = values.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        values.into_iter().map(|value| (value, self.label(value, step))).collect()
    }

    /// 1, 2 or 5 times a power of ten, of which about so many are on the axis. There are two at least, as one value
    /// alone is no scale.
    fn step(&self, most: usize) -> f64 {
        let step = |most: usize| {
            let rough = (self.high - self.low) / most as f64;
            let power = 10f64.powf(rough.log10().floor());
            let step = [1.0, 2.0, 5.0].map(|factor| factor * power).into_iter().find(|&step| step >= rough * 0.999);
            step.unwrap_or(10.0 * power)
        };
        let inside = |step: &f64| (self.high / step).floor() > (self.low / step).ceil();
        let most = most.max(1);
        (most..most + 4).map(step).find(inside).unwrap_or_else(|| step(most))
    }

    /// Multiples of the step.
    fn steps(&self, most: usize) -> Vec<f64> {
        let step = self.step(most);
        let (first, last) = ((self.low / step).ceil(), (self.high / step).floor());
        if !(0.0..=50.0).contains(&(last - first)) {
            return vec![self.low, self.high];
        }
        (0..=(last - first) as usize).map(|k| (first + k as f64) * step).collect()
    }

    /// Powers of ten; where hardly one is there, twice and five times as well.
    fn powers(&self, most: usize) -> Vec<f64> {
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        let inside = |value: &f64| (self.low * 0.999..=self.high * 1.001).contains(value);
        let tens: Vec<f64> = (first..=last).map(|power| 10f64.powi(power)).filter(inside).collect();
        if tens.len() >= 3 {
            let every = tens.len().div_ceil(most.max(1));
            return tens.into_iter().step_by(every).collect();
        }
        (first..=last).flat_map(|power| [1.0, 2.0, 5.0].map(|f| f * 10f64.powi(power))).filter(inside).collect()
    }

    /// As many decimals as the step between the values needs.
    fn label(&self, value: f64, step: f64) -> String {
        let largest = self.low.abs().max(self.high.abs());
        let plain = if self.logarithmic { (1e-3..1e5).contains(&value) } else { (1e-3..1e5).contains(&largest) };
        if !plain && value == 0.0 {
            return "0".to_owned();
        }
        if !plain {
            let digits =
                if self.logarithmic { 0 } else { (value.abs() / step).log10().ceil().clamp(0.0, 6.0) as usize };
            return typeset(&trimmed(&format!("{value:.digits$e}")));
        }
        let step = if self.logarithmic { value } else { step };
        let decimals = if step.is_finite() { (-step.log10().floor()).clamp(0.0, 9.0) as usize } else { 3 };
        let text = format!("{value:.decimals$}");
        typeset(if text.trim_start_matches('-').parse() == Ok(0.0) { text.trim_start_matches('-') } else { &text })
    }
}

/// Without zeros at the end of the digits before the power of ten.
fn trimmed(text: &str) -> String {
    match text.split_once('e') {
        Some((digits, power)) if digits.contains('.') => {
            format!("{}e{power}", digits.trim_end_matches('0').trim_end_matches('.'))
        }
        _ => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::{Axis, Scale};

    fn ticks(axis: Axis, values: &[f64], most: usize) -> Vec<String> {
        let ruler = axis.ruler(values.iter().copied(), 0.0, 100.0);
        ruler.ticks(most).into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        let axis = || Axis::of("t", "s");
        assert_eq!(ticks(axis().between(0.0, 1.0), &[], 5), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(ticks(axis().between(-3.0, 17.0), &[], 5), ["0", "5", "10", "15"]);
        assert_eq!(ticks(axis().between(-1e-9, 1e-9), &[], 2), ["−1·10⁻⁹", "0", "1·10⁻⁹"]);
        assert_eq!(ticks(axis().between(4000.0, 11_000.0), &[], 1), ["5000", "10000"], "one value is no scale");
        assert_eq!(ticks(axis().between(0.03, 0.45), &[], 1), ["0.2", "0.4"], "nor is none");
        assert_eq!(ticks(axis().between(0.81, 1.02), &[], 2), ["0.9", "1.0"]);
        let mut log = axis().between(0.05, 200.0);
        log.scale = Scale::Logarithmic;
        assert_eq!(ticks(log.clone(), &[], 6), ["0.1", "1", "10", "100"]);
        log.range = Some([8e-6, 0.13]);
        assert_eq!(ticks(log.clone(), &[], 5), ["1·10⁻⁵", "1·10⁻⁴", "0.001", "0.01", "0.1"]);
        assert_eq!(ticks(log.clone(), &[], 3), ["1·10⁻⁵", "0.001", "0.1"]);
        log.range = Some([1.5, 30.0]);
        assert_eq!(ticks(log, &[], 5), ["2", "5", "10", "20"]);
    }

    #[test]
    fn infinite_and_equal_values_have_an_axis() {
        for values in
            [&[][..], &[f64::NAN], &[3.0], &[0.0], &[-1e300, 1e300], &[f64::INFINITY, 1.0], &[1.0, 1.0 + 1e-15]]
        {
            for scale in [Scale::Linear, Scale::Logarithmic] {
                let mut axis = Axis::of("x", "").with_zero();
                axis.scale = scale;
                let ruler = axis.ruler(values.iter().copied(), 0.0, 100.0);
                assert!(ruler.low < ruler.high, "{values:?}");
                assert!(ruler.ticks(5).len() <= 60, "{values:?}");
                assert!(ruler.at(f64::NAN).is_none());
            }
        }
    }
}
