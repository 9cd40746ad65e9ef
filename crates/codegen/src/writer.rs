//! Text of C in the making: lines, indented by the blocks that they stand in.

use std::fmt::{Arguments, Display, Write};

/// The head of a branch, and its body.
pub(crate) type Branch<'a> = (&'a str, &'a dyn Fn(&mut Writer));

/// Code that grows line by line. `writeln!(writer, ...)` writes one line.
#[derive(Debug, Default)]
pub(crate) struct Writer {
    text: String,
    depth: usize,
}

impl Writer {
    /// Writes a line with a line break, for `writeln!`.
    pub(crate) fn write_fmt(&mut self, line: Arguments<'_>) {
        self.indent();
        // A string takes everything.
        let _ = self.text.write_fmt(line);
    }

    fn indent(&mut self) {
        self.text.extend(std::iter::repeat_n("    ", self.depth));
    }

    /// An empty line.
    pub(crate) fn blank(&mut self) {
        self.text.push('\n');
    }

    /// A comment on a line.
    pub(crate) fn comment(&mut self, text: &str) {
        writeln!(self, "/* {text} */");
    }

    /// A function: its head, then its body in braces on separate lines.
    pub(crate) fn function(&mut self, head: &str, body: impl FnOnce(&mut Self)) {
        writeln!(self, "{head}");
        self.scope(body);
    }

    /// Braces without a head.
    pub(crate) fn scope(&mut self, body: impl FnOnce(&mut Self)) {
        writeln!(self, "{{");
        self.inner(body);
        writeln!(self, "}}");
    }

    /// A statement with a body, such as a condition.
    pub(crate) fn block(&mut self, head: Arguments<'_>, body: impl FnOnce(&mut Self)) {
        writeln!(self, "{head} {{");
        self.inner(body);
        writeln!(self, "}}");
    }

    /// A condition, further ones and the last alternative, each with its body: `if (...)`, `else if (...)`, `else`.
    pub(crate) fn branches(&mut self, branches: &[Branch<'_>]) {
        for (place, (head, body)) in branches.iter().enumerate() {
            let close = if place > 0 { "} " } else { "" };
            writeln!(self, "{close}{head} {{");
            self.inner(body);
        }
        writeln!(self, "}}");
    }

    /// A loop over `index` from 0 to `count` - 1.
    pub(crate) fn each(&mut self, index: &str, count: impl Display, body: impl FnOnce(&mut Self)) {
        self.range(index, 0, count, body);
    }

    /// A loop over `index` from `first` to `end` - 1.
    pub(crate) fn range(&mut self, index: &str, first: impl Display, end: impl Display, body: impl FnOnce(&mut Self)) {
        self.block(format_args!("for (size_t {index} = {first}; {index} < {end}; ++{index})"), body);
    }

    /// A loop over `index` from 0 to `last`.
    pub(crate) fn through(&mut self, index: &str, last: impl Display, body: impl FnOnce(&mut Self)) {
        self.block(format_args!("for (size_t {index} = 0; {index} <= {last}; ++{index})"), body);
    }

    fn inner(&mut self, body: impl FnOnce(&mut Self)) {
        self.depth += 1;
        body(self);
        self.depth -= 1;
    }

    /// The written text.
    pub(crate) fn into_text(self) -> String {
        self.text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_indent_their_lines() {
        let mut w = Writer::default();
        w.comment("The sum.");
        w.function("int sum(int n)", |w| {
            writeln!(w, "int v = {};", 0);
            w.range("i", "1", 3, |w| {
                w.branches(&[
                    ("if (n > 0)", &|w| w.through("j", "i", |w| writeln!(w, "++v;"))),
                    ("else", &|w| w.scope(|_| ())),
                ]);
            });
        });
        w.blank();
        let text = "/* The sum. */\nint sum(int n)\n{\n    int v = 0;\n    for (size_t i = 1; i < 3; ++i) {\n        if (n > 0) {\n            \
                    for (size_t j = 0; j <= i; ++j) {\n                ++v;\n            }\n        } else {\n            {\n            }\n        }\n    }\n}\n\n";
        assert_eq!(w.into_text(), text);
    }
}
