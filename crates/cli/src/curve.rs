//! Two curves of characters: what was measured, and what was simulated.

/// Cells of the picture.
const COLUMNS: usize = 72;
const ROWS: usize = 13;

/// Values of two curves at the same times, evenly spread.
pub(crate) struct Curves<'a> {
    /// Title above the curve.
    pub(crate) title: &'a str,
    /// Drawn by points.
    pub(crate) measured: Vec<f64>,
    /// Drawn by circles, over the others.
    pub(crate) simulated: Vec<f64>,
    /// Label below the curve.
    pub(crate) below: String,
}

impl Curves<'_> {
    /// The picture as text.
    pub(crate) fn text(&self) -> String {
        let finite = self.measured.iter().chain(&self.simulated).copied().filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), value| (l.min(value), h.max(value)));
        if low > high {
            return format!("{}: nothing to show", self.title);
        }
        let row = |value: f64| match high > low {
            true => ((high - value) / (high - low) * (ROWS - 1) as f64).round() as usize,
            false => ROWS / 2,
        };
        let mut cells = vec![[' '; COLUMNS]; ROWS];
        for (values, mark) in [(&self.measured, '.'), (&self.simulated, 'o')] {
            for column in 0..COLUMNS {
                let at = column * values.len().saturating_sub(1) / (COLUMNS - 1);
                if let Some(value) = values.get(at).filter(|value| value.is_finite()) {
                    cells[row(*value)][column] = mark;
                }
            }
        }
        let label = |at: usize| match at {
            0 => format!("{high:8.1}"),
            at if at == ROWS - 1 => format!("{low:8.1}"),
            _ => " ".repeat(8),
        };
        let lines = cells
            .iter()
            .enumerate()
            .map(|(at, cells)| format!("{} | {}", label(at), cells.iter().collect::<String>()).trim_end().to_owned());
        let drawn: Vec<String> = lines.collect();
        format!("{}\n{}\n{:>8} +{}\n{:>10} {}", self.title, drawn.join("\n"), "", "-".repeat(COLUMNS), "", self.below)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_go_from_their_least_to_their_greatest_value() {
        let measured: Vec<f64> = (0..=100).map(f64::from).collect();
        let simulated = measured.iter().map(|value| 100.0 - value).collect();
        let text = Curves { title: "t", measured, simulated, below: "0 to 1 s".into() }.text();
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines.len(), ROWS + 3);
        assert!(lines[1].starts_with("   100.0 | o") && lines[1].ends_with('.'), "{text}");
        assert!(lines[ROWS].starts_with("     0.0 | .") && lines[ROWS].ends_with('o'), "{text}");
        let flat = Curves { title: "t", measured: vec![f64::NAN], simulated: vec![2.0], below: String::new() }.text();
        assert!(flat.contains('o'), "{flat}");
    }
}
