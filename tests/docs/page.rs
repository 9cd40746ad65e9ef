//! The fenced blocks of a page.

/// A fenced block.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Block {
    /// The first word behind the fence.
    pub(crate) kind: String,
    /// The file that it is, in the folder in which the page's commands run.
    pub(crate) file: Option<String>,
    /// Recordings, or packages of Python, that it needs from outside the checkout.
    pub(crate) needs: Vec<String>,
    /// The number of its fence's line, from 1.
    pub(crate) line: usize,
    /// Its lines, without the fence's indentation.
    pub(crate) lines: Vec<String>,
}

impl Block {
    pub(crate) fn text(&self) -> String {
        self.lines.iter().map(|line| format!("{line}\n")).collect()
    }
}

/// The value of a comment `<!-- key: value -->`.
fn comment<'a>(line: &'a str, key: &str) -> Option<&'a str> {
    line.trim().strip_prefix("<!--")?.strip_suffix("-->")?.trim().strip_prefix(key)?.strip_prefix(':').map(str::trim)
}

/// The fenced blocks of a page. Comments right above a fence give its file and its needs.
pub(crate) fn blocks(text: &str) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut above: Vec<&str> = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        let fence: String = line.trim_start().chars().take_while(|&character| character == '`').collect();
        if fence.len() < 3 {
            if !line.trim().starts_with("<!--") {
                above.clear();
            }
            above.push(line);
            continue;
        }
        let indentation = line.len() - line.trim_start().len();
        let inner: Vec<String> = lines
            .by_ref()
            .map(|(_, line)| line)
            .take_while(|line| line.trim() != fence)
            .map(|line| line.get(indentation..).unwrap_or(line.trim_start()).to_owned())
            .collect();
        let values = |key: &'static str| above.iter().filter_map(move |line| comment(line, key)).map(str::to_owned);
        blocks.push(Block {
            kind: line.trim().trim_start_matches('`').split_whitespace().next().unwrap_or_default().to_owned(),
            file: values("file").next(),
            needs: values("needs").collect(),
            line: number + 1,
            lines: inner,
        });
        above.clear();
    }
    blocks
}

#[test]
fn blocks_keep_kind_file_and_needs() {
    let text = "a\n\n<!-- file: robot.toml -->\n```toml\n[states]\n```\n- b\n\n  <!-- needs: emps.csv -->\n  ```console\n  $ a\n    b\n  ```\n```\n```\n";
    let parsed = blocks(text);
    let kinds: Vec<&str> = parsed.iter().map(|block| block.kind.as_str()).collect();
    assert_eq!(kinds, ["toml", "console", ""]);
    assert_eq!((parsed[0].file.as_deref(), parsed[0].line), (Some("robot.toml"), 4));
    assert_eq!((parsed[1].needs.as_slice(), parsed[1].line), (&["emps.csv".to_owned()][..], 10));
    assert_eq!(parsed[1].lines, ["$ a", "  b"]);
    assert!(parsed[2].file.is_none() && parsed[2].needs.is_empty());
}
