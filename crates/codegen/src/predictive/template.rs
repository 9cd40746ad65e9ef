//! Text with words, types and optional lines to be filled in.

/// Values of a template's marks.
pub(super) struct Template {
    /// Names of `%if`, and whether their lines stay.
    pub(super) flags: Vec<(&'static str, bool)>,
    /// Words behind `$`, longer ones before those that they begin with.
    pub(super) words: Vec<(&'static str, String)>,
    /// Replaces `@`.
    pub(super) suffix: &'static str,
}

impl Template {
    /// The text without marks.
    pub(super) fn fill(&self, text: &str) -> String {
        let mut out = String::new();
        // Whether the lines of each open `%if` stay.
        let mut open: Vec<bool> = Vec::new();
        for line in text.lines() {
            if let Some(name) = line.strip_prefix("%if ") {
                open.push(self.flags.iter().any(|(flag, stays)| *flag == name && *stays));
            } else if line == "%else" {
                if let Some(stays) = open.last_mut() {
                    *stays = !*stays;
                }
            } else if line == "%end" {
                open.pop();
            } else if !open.contains(&false) {
                let filled = self.line(line);
                // A line of a word without text is none.
                if line.is_empty() || !filled.is_empty() {
                    out += &filled;
                    out.push('\n');
                }
            }
        }
        out
    }

    fn line(&self, line: &str) -> String {
        let mut line = line.replace('@', self.suffix);
        for (word, value) in &self.words {
            line = line.replace(&format!("${word}"), value);
        }
        line
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_are_filled_and_lines_left_out() {
        let template = Template {
            flags: vec![("loud", true), ("slow", false)],
            words: vec![("pq", "x".into()), ("p", "y".into()), ("none", String::new())],
            suffix: "f",
        };
        let text = "a $pq $p 1.0@;\n%if loud\nb\n%if slow\nc\n%else\nd\n%end\n%end\n%if slow\ne\n%end\n$none\n\ng\n";
        assert_eq!(template.fill(text), "a x y 1.0f;\nb\nd\n\ng\n");
    }
}
