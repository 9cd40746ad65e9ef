//! Heat maps of characters.

/// From few to many. A blank is a cell without a value.
const SHADES: [char; 9] = ['.', ':', '-', '=', '+', '*', '#', '%', '@'];

/// A heat map: `columns` x `rows` values, and what its axes say.
pub(crate) struct HeatMap<'a> {
    /// Quantity that the shades show.
    pub(crate) title: &'a str,
    /// Values by (column, row), rows counted from below; NaN is left blank.
    pub(crate) value: &'a dyn Fn(usize, usize) -> f64,
    pub(crate) columns: usize,
    pub(crate) rows: usize,
    /// Label left of a row.
    pub(crate) row_label: &'a dyn Fn(usize) -> String,
    /// Label below, from the left to the right end.
    pub(crate) below: &'a str,
}

impl HeatMap<'_> {
    /// The map as text, two characters a cell, with its scale.
    pub(crate) fn text(&self) -> String {
        let values = (0..self.columns).flat_map(|column| (0..self.rows).map(move |row| (self.value)(column, row)));
        let (low, high) = values
            .filter(|value| value.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low > high {
            return format!("{}: nothing to show", self.title);
        }
        let shade = |value: f64| match value {
            v if !v.is_finite() => ' ',
            _ if high == low => SHADES[SHADES.len() / 2],
            v => SHADES[(((v - low) / (high - low) * SHADES.len() as f64) as usize).min(SHADES.len() - 1)],
        };
        let labels: Vec<String> = (0..self.rows).map(|row| (self.row_label)(row)).collect();
        let width = labels.iter().map(|label| label.chars().count()).max().unwrap_or(0);
        let mut text = format!("{}\n", self.title);
        for row in (0..self.rows).rev() {
            text.push_str(&format!("{:>width$} |", labels[row]));
            for column in 0..self.columns {
                let shade = shade((self.value)(column, row));
                text.extend([shade, shade]);
            }
            text.push_str("|\n");
        }
        text.push_str(&format!("{:width$}  {}\n", "", self.below));
        let steps: String = SHADES.iter().collect();
        text.push_str(&format!(
            "{:width$}  {} \"{steps}\" {}",
            "",
            crate::table::number(low),
            crate::table::number(high)
        ));
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_value_is_the_darkest_and_rows_go_up() {
        let map = HeatMap {
            title: "t",
            value: &|column, row| if (column, row) == (1, 1) { f64::NAN } else { (column + 2 * row) as f64 },
            columns: 2,
            rows: 2,
            row_label: &|row| row.to_string(),
            below: "a..b",
        };
        assert_eq!(map.text(), "t\n1 |@@  |\n0 |..++|\n   a..b\n   0 \".:-=+*#%@\" 2.000");
        let empty = HeatMap { value: &|_, _| f64::NAN, ..map };
        assert!(empty.text().contains("nothing"));
    }
}
