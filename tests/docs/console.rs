//! Blocks `console`: the commands of a page, run one after the other in a folder of their own, and what they print held against what the page shows.
//!
//! `$ ` begins a command, `> ` goes on with it; what follows is its standard output. A line `...` stands for any lines, `[..]` for anything within a line, and
//! `? 1` as the last line for the exit code. Where nothing follows, the output is not shown, and not compared.

use std::{
    env, fs,
    path::Path,
    process::{Command, Output},
};

use super::page::Block;
use crate::outside::data;

/// A command of a page.
#[derive(Debug, PartialEq, Eq)]
struct Shown {
    command: String,
    /// The index of the first line of what it prints, from 0 in the page, and those lines.
    at: usize,
    output: Vec<String>,
    code: i32,
}

/// What a page shows, and what was said.
pub(crate) struct Difference {
    command: String,
    at: usize,
    shown: Vec<String>,
    said: Vec<String>,
}

/// What came of a page's commands.
#[derive(Default)]
pub(crate) struct Ran {
    pub(crate) commands: usize,
    pub(crate) differences: Vec<Difference>,
    pub(crate) problems: Vec<String>,
}

impl Difference {
    pub(crate) fn told(&self, page: &Path) -> String {
        let (shown, said) = (self.shown.join("\n"), self.said.join("\n"));
        format!("{}:{}: $ {}\n--- shown\n{shown}\n--- said\n{said}", page.display(), self.at, self.command)
    }
}

/// The page's text with what its commands say now.
pub(crate) fn corrected(text: &str, differences: &[Difference]) -> String {
    let mut lines: Vec<&str> = text.lines().collect();
    for difference in differences.iter().rev() {
        let shown = difference.at..difference.at + difference.shown.len();
        lines.splice(shown, difference.said.iter().map(String::as_str));
    }
    lines.join("\n") + "\n"
}

fn commands(block: &Block) -> Vec<Shown> {
    let mut commands: Vec<Shown> = Vec::new();
    for (offset, line) in block.lines.iter().enumerate() {
        // The fence is line `block.line` from 1, so what it holds begins at that index from 0.
        let at = block.line + offset;
        if let Some(command) = line.strip_prefix("$ ") {
            commands.push(Shown { command: command.to_owned(), at: at + 1, output: Vec::new(), code: 0 });
        } else if let Some(last) = commands.last_mut() {
            match line.strip_prefix("> ").filter(|_| last.output.is_empty()) {
                Some(more) => {
                    last.command = format!("{}\n{more}", last.command);
                    last.at = at + 1;
                }
                None => last.output.push(line.clone()),
            }
        }
    }
    for shown in &mut commands {
        if let Some(code) = shown.output.last().and_then(|line| line.strip_prefix("? ")?.parse().ok()) {
            shown.code = code;
            shown.output.pop();
        }
    }
    commands
}

/// Runs the blocks of a page in their order.
pub(crate) fn run(page: &Path, blocks: &[Block]) -> Ran {
    let mut ran = Ran::default();
    let folder = tempfile::tempdir().expect("a folder");
    for block in blocks {
        if let Some(name) = &block.file {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().expect("it is below the folder")).expect("its folder");
            fs::write(path, block.text()).expect("the block is written");
        }
        if block.kind != "console" {
            continue;
        }
        // Without the recordings, what follows in the page has nothing to go on.
        if !block.needs.iter().all(|name| recording(folder.path(), name)) {
            return ran;
        }
        for shown in commands(block) {
            ran.commands += 1;
            let Output { status, stdout, stderr } = shell(folder.path(), &shown.command);
            let (said, talk) = (String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
            if status.code() != Some(shown.code) {
                let place = format!("{}:{}", page.display(), shown.at);
                ran.problems.push(format!("{place}: $ {} ended with {status}\n{said}{talk}", shown.command));
                return ran;
            }
            let said: Vec<String> = said.trim_end().lines().map(|line| line.trim_end().to_owned()).collect();
            if !shown.output.is_empty() && !matches(&shown.output, &said) {
                ran.differences.push(Difference { command: shown.command, at: shown.at, shown: shown.output, said });
            }
        }
    }
    ran
}

/// Puts a recording into the folder; whether there is one.
fn recording(folder: &Path, name: &str) -> bool {
    let Some(file) = data(name) else { return false };
    let place = folder.join(file.file_name().expect("a recording has a name"));
    if !place.exists() {
        fs::copy(&file, &place).expect("the recording is copied");
    }
    true
}

/// Runs a line with the command that is tested as `fleetfoot`.
fn shell(folder: &Path, line: &str) -> Output {
    let own = Path::new(env!("CARGO_BIN_EXE_fleetfoot")).parent().expect("it is in a folder").to_owned();
    let path = env::var_os("PATH").unwrap_or_default();
    let path = env::join_paths(std::iter::once(own).chain(env::split_paths(&path))).expect("a path");
    Command::new("sh").args(["-ec", line]).current_dir(folder).env("PATH", path).output().expect("sh runs")
}

/// Whether lines are as shown.
fn matches<A: AsRef<str>, B: AsRef<str>>(shown: &[A], said: &[B]) -> bool {
    match shown.split_first() {
        None => said.is_empty(),
        Some((first, rest)) if first.as_ref().trim() == "..." => {
            (0..=said.len()).any(|skipped| matches(rest, &said[skipped..]))
        }
        Some((first, rest)) => said
            .split_first()
            .is_some_and(|(line, after)| matches_line(first.as_ref(), line.as_ref()) && matches(rest, after)),
    }
}

fn matches_line(shown: &str, said: &str) -> bool {
    match shown.split_once("[..]") {
        None => shortened(shown.trim_end()) == shortened(said),
        Some((before, after)) => said.strip_prefix(before).is_some_and(|rest| {
            (0..=rest.len()).filter(|&at| rest.is_char_boundary(at)).any(|at| matches_line(after, &rest[at..]))
        }),
    }
}

/// A line whose numbers have twelve digits after the point at most: the last ones of a double are other ones on another processor.
fn shortened(line: &str) -> String {
    let mut after = None;
    line.chars()
        .filter(|c| {
            after = match (c, after) {
                ('.', _) => Some(0),
                ('0'..='9', Some(digits)) => Some(digits + 1),
                _ => None,
            };
            after.is_none_or(|digits| digits <= 12)
        })
        .collect()
}

#[test]
fn what_differs_is_found_and_corrected() {
    let text = "a\n\n```console\n$ printf 'one\\ntwo\\nthree\\n'\none\n...\n$ echo 4.25 s\n4.[..] s\n$ echo a && \\\n> exit 3\na\n? 3\n$ echo right\nwrong\n$ true\n```\n";
    let ran = run(Path::new("page.md"), &super::blocks(text));
    assert!(ran.problems.is_empty(), "{:?}", ran.problems);
    assert_eq!((ran.commands, ran.differences.len()), (5, 1));
    assert!(
        ran.differences[0]
            .told(Path::new("page.md"))
            .contains("page.md:13: $ echo right\n--- shown\nwrong\n--- said\nright")
    );
    let corrected = corrected(text, &ran.differences);
    assert_eq!(corrected, text.replace("wrong", "right"));
    assert!(run(Path::new("page.md"), &super::blocks(&corrected)).differences.is_empty());
    let failing = run(Path::new("page.md"), &super::blocks("```console\n$ false\n```\n"));
    assert!(failing.problems[0].contains("page.md:2: $ false ended with"), "{:?}", failing.problems);
}
