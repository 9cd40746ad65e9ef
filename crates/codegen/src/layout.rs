//! Line breaks in long lists of numbers.

/// Values in rows of `row`, each row on separate lines, separated by commas.
pub(crate) fn rows(values: &[String], row: usize, out: &mut String) {
    for row in values.chunks(row.max(1)) {
        let mut line = String::from("   ");
        for value in row {
            if line.len() + value.len() > 116 {
                *out += &line;
                out.push('\n');
                line = String::from("   ");
            }
            line.push(' ');
            line += value;
            line.push(',');
        }
        *out += &line;
        out.push('\n');
    }
}
