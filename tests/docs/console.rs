//! Blocks `console`: the commands of a page, run one after the other in a separate folder, and their output compared
//! with the page.
//!
//! `$ ` begins a command, `> ` continues it; its standard output follows. A line `...` stands for any lines, `[..]` for
//! any text within a line, and `? 1` as the last line for the exit code. Without following lines, the output is neither
//! shown nor compared.

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
    /// The index of the first line of its output, from 0 in the page, and those lines.
    at: usize,
    output: Vec<String>,
    code: i32,
}

/// Difference between a page and the output of its command.
pub(crate) struct Difference {
    command: String,
    at: usize,
    shown: Vec<String>,
    actual: Vec<String>,
}

/// Result of a page's commands.
#[derive(Default)]
pub(crate) struct Ran {
    pub(crate) commands: usize,
    pub(crate) differences: Vec<Difference>,
    pub(crate) problems: Vec<String>,
}

impl Difference {
    pub(crate) fn description(&self, page: &Path) -> String {
        let (shown, actual) = (self.shown.join("\n"), self.actual.join("\n"));
        format!("{}:{}: $ {}\n--- shown\n{shown}\n--- said\n{actual}", page.display(), self.at, self.command)
    }
}

/// The page's text with the present output of its commands.
pub(crate) fn corrected(text: &str, differences: &[Difference]) -> String {
    let mut lines: Vec<&str> = text.lines().collect();
    for difference in differences.iter().rev() {
        let shown = difference.at..difference.at + difference.shown.len();
        lines.splice(shown, difference.actual.iter().map(String::as_str));
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
            let (actual, talk) = (String::from_utf8_lossy(&stdout), String::from_utf8_lossy(&stderr));
            if status.code() != Some(shown.code) {
                let place = format!("{}:{}", page.display(), shown.at);
                ran.problems.push(format!("{place}: $ {} ended with {status}\n{actual}{talk}", shown.command));
                return ran;
            }
            let actual: Vec<String> = actual.trim_end().lines().map(|line| line.trim_end().to_owned()).collect();
            if !shown.output.is_empty() && !matches(&shown.output, &actual) {
                ran.differences.push(Difference { command: shown.command, at: shown.at, shown: shown.output, actual });
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
    let binaries = Path::new(env!("CARGO_BIN_EXE_fleetfoot")).parent().expect("it is in a folder").to_owned();
    let path = env::var_os("PATH").unwrap_or_default();
    let path = env::join_paths(std::iter::once(binaries).chain(env::split_paths(&path))).expect("a path");
    Command::new("sh").args(["-ec", line]).current_dir(folder).env("PATH", path).output().expect("sh runs")
}

/// Returns true if lines are as shown.
fn matches<A: AsRef<str>, B: AsRef<str>>(shown: &[A], actual: &[B]) -> bool {
    match shown.split_first() {
        None => actual.is_empty(),
        Some((first, rest)) if first.as_ref().trim() == "..." => {
            (0..=actual.len()).any(|skipped| matches(rest, &actual[skipped..]))
        }
        Some((first, rest)) => actual
            .split_first()
            .is_some_and(|(line, after)| matches_line(first.as_ref(), line.as_ref()) && matches(rest, after)),
    }
}

/// Returns true if a line is as shown. `[..]` stands for any text, and a run of blanks for another one. Numbers are the
/// same to a unit of their last digit, since other instruction sets round otherwise.
fn matches_line(shown: &str, actual: &str) -> bool {
    let (shown, actual) = (shown.trim_end(), actual.trim_end());
    shown == actual || matches_from((shown, 0), (actual, 0))
}

/// The same from a place of each line on.
fn matches_from((shown, at): (&str, usize), (actual, from): (&str, usize)) -> bool {
    let (left, right) = (&shown[at..], &actual[from..]);
    if let Some(after) = left.strip_prefix("[..]") {
        let at = shown.len() - after.len();
        return (from..=actual.len())
            .filter(|&from| actual.is_char_boundary(from))
            .any(|from| matches_from((shown, at), (actual, from)));
    }
    if let (Some(one), Some(other)) = (number(shown, at), number(actual, from)) {
        return same_number(one, other) && matches_from((shown, at + one.len()), (actual, from + other.len()));
    }
    match (left.chars().next(), right.chars().next()) {
        (None, None) => true,
        (Some(' '), Some(' ')) => {
            let blanks = |line: &str| line.len() - line.trim_start_matches(' ').len();
            matches_from((shown, at + blanks(left)), (actual, from + blanks(right)))
        }
        (Some(one), Some(other)) if one == other => {
            matches_from((shown, at + one.len_utf8()), (actual, from + other.len_utf8()))
        }
        _ => false,
    }
}

/// The number that begins at a place of a line: digits with a point or an exponent or neither. It is not a part of a
/// name, a version or a hash.
fn number(line: &str, at: usize) -> Option<&str> {
    let in_name = |c: char| c.is_alphanumeric() || c == '_' || c == '.';
    if line[..at].chars().next_back().is_some_and(in_name) {
        return None;
    }
    let digits = |text: &str| text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
    let text = &line[at..];
    let mut end = digits(text);
    if end == 0 {
        return None;
    }
    if let Some(fraction) = text[end..].strip_prefix('.').map(digits).filter(|&length| length > 0) {
        end += 1 + fraction;
    }
    if let Some(exponent) = text[end..].strip_prefix('e') {
        let sign = usize::from(exponent.starts_with(['-', '+']));
        let length = digits(&exponent[sign..]);
        end += if length > 0 { 1 + sign + length } else { 0 };
    }
    let mut after = text[end..].chars();
    let goes_on = match after.next() {
        Some('.') => after.next().is_some_and(in_name),
        Some(c) => in_name(c) && c != '.',
        None => false,
    };
    let is_open = ["[..]", ".[..]"].iter().any(|open| text[end..].starts_with(open));
    (!goes_on && !is_open).then(|| &text[..end])
}

/// Returns true if two numbers differ by at most a unit of the last digit of the one with more digits. Counts, which
/// have neither point nor exponent, are equal.
fn same_number(one: &str, other: &str) -> bool {
    if one == other {
        return true;
    }
    let unit = unit(one).min(unit(other));
    let value = |text: &str| text.parse::<f64>().unwrap_or(f64::NAN);
    unit < 1.0 && (value(one) - value(other)).abs() <= 1.000_001 * unit.max(LEAST_UNIT)
}

/// Doubles are printed with up to seventeen digits, of which the last ones are rounding.
const LEAST_UNIT: f64 = 1e-12;

/// A unit of the last digit of a number; 1 of a count.
fn unit(number: &str) -> f64 {
    let (mantissa, exponent) = number.split_once('e').unwrap_or((number, "0"));
    let fraction = mantissa.split_once('.').map_or(0, |(_, digits)| digits.len() as i32);
    10f64.powi(exponent.parse::<i32>().unwrap_or(0) - fraction)
}

#[test]
fn numbers_match_to_their_last_digit() {
    for (shown, actual) in [
        ("       0       2          35424        3", "       0       2        35423.9        3"),
        ("loss 0.115 +- 0.005", "loss 0.116 +- 0.005"),
        ("4.0000000000000004 m", "3.9999999999999996 m"),
        ("1.2346e-5", "1.2345e-5"),
        ("to [..] of 2.51", "to 3e-16 of 2.50"),
        ("  f_y = -0.782373 + 0.792377*y", "  f_y = -0.782372 + 0.792377*y"),
    ] {
        assert!(matches_line(shown, actual), "{shown} | {actual}");
    }
    for (shown, actual) in [
        ("399 rows", "400 rows"),
        ("loss 0.115", "loss 0.117"),
        ("-0.5", "0.5"),
        ("fleetfoot 0.1.0", "fleetfoot 0.2.0"),
        ("f_y1.5", "f_y1.6"),
        ("35424", "35422.9"),
        ("1e-5", "2e-6"),
        ("a 1", "a1"),
    ] {
        assert!(!matches_line(shown, actual), "{shown} | {actual}");
    }
}

#[test]
fn differences_are_corrected() {
    let text = "a\n\n```console\n$ printf 'one\\ntwo\\nthree\\n'\none\n...\n$ echo 4.25 s\n4.[..] s\n$ echo a && \\\n> exit 3\na\n? 3\n$ echo right\nwrong\n$ true\n```\n";
    let ran = run(Path::new("page.md"), &super::blocks(text));
    assert!(ran.problems.is_empty(), "{:?}", ran.problems);
    assert_eq!((ran.commands, ran.differences.len()), (5, 1));
    assert!(
        ran.differences[0]
            .description(Path::new("page.md"))
            .contains("page.md:13: $ echo right\n--- shown\nwrong\n--- said\nright")
    );
    let corrected = corrected(text, &ran.differences);
    assert_eq!(corrected, text.replace("wrong", "right"));
    assert!(run(Path::new("page.md"), &super::blocks(&corrected)).differences.is_empty());
    let failing = run(Path::new("page.md"), &super::blocks("```console\n$ false\n```\n"));
    assert!(failing.problems[0].contains("page.md:2: $ false ended with"), "{:?}", failing.problems);
}
