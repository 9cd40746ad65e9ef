//! Goldens as a text file: an entry a case, a line for each thing that was found in it.
//!
//! ```text
//! platform = linux x86_64 avx512
//!
//! [kmeans]
//! model = blake3:3f0c...
//! f_v in 0 = 1 0.25; v -2.0; lag(u, 1) 3.0
//! ```
//!
//! A line has a name and items: a value, or a label and a value. Numbers are written in the shortest form that reads back to the same bits. Bytes of models hold on
//! one instruction set and one library of elementary functions, which the file names: there every item is compared to the last bit, elsewhere hashes are passed over
//! and numbers have a tolerance.

use std::{fmt::Write, fs, path::PathBuf};

/// Set to write the goldens instead of comparing with them.
const BLESS: &str = "FLEETFOOT_BLESS";

/// Tolerance between platforms, as a share of the largest number of a line. A sum of n numbers of relative rounding u = 1.1e-16 has an error of some
/// `sqrt(n) u` under another order of its terms, 1e-14 for the ten thousand rows of these logs; equations of a condition of up to 1e4 make 1e-10 of it, and two more
/// digits are left for what is computed from coefficients.
/// A region that the training rows of a fold hardly determine makes ten times as much of a held-out loss: 2.6e-8 was seen of 27 functions.
const TOLERANCE: f64 = 1e-7;

/// Numbers below this are rounding of others: models of logs without noise have such errors.
const ROUNDING: f64 = 1e-12;

/// Results of one case.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Entry {
    name: String,
    lines: Vec<(String, String)>,
}

impl Entry {
    /// An entry without lines.
    pub(super) fn new(name: impl Into<String>) -> Self {
        Self { name: name.into(), lines: Vec::new() }
    }

    /// A line of words.
    pub(super) fn words(&mut self, name: &str, text: impl Into<String>) {
        self.lines.push((name.to_owned(), text.into().replace('\n', " ")));
    }

    /// A line of numbers.
    pub(super) fn numbers(&mut self, name: &str, values: impl IntoIterator<Item = f64>) {
        let items: Vec<String> = values.into_iter().map(|value| format!("{value:?}")).collect();
        self.words(name, items.join("; "));
    }

    /// A line of numbers with their labels.
    pub(super) fn labelled(&mut self, name: &str, items: impl IntoIterator<Item = (String, f64)>) {
        let items: Vec<String> = items.into_iter().map(|(label, value)| format!("{label} {value:?}")).collect();
        self.words(name, items.join("; "));
    }

    /// The hash of some bytes.
    pub(super) fn hash(&mut self, name: &str, bytes: &[u8]) {
        self.words(name, format!("{HASH}{}", blake3::hash(bytes).to_hex()));
    }
}

/// Prefix of the value of a hash.
const HASH: &str = "blake3:";

/// Entries, and the platform that they are of.
#[derive(Debug, Clone, PartialEq)]
struct Book {
    platform: String,
    entries: Vec<Entry>,
}

impl Book {
    fn parse(text: &str) -> Self {
        let mut book = Self { platform: String::new(), entries: Vec::new() };
        for line in text.lines().filter(|line| !line.is_empty() && !line.starts_with('#')) {
            let bracketed = line.strip_prefix('[').and_then(|rest| rest.strip_suffix(']'));
            match (bracketed, line.split_once(" = "), book.entries.last_mut()) {
                (Some(name), None, _) => book.entries.push(Entry::new(name)),
                (_, Some((name, value)), Some(entry)) => entry.words(name, value),
                (_, Some((_, value)), None) => value.clone_into(&mut book.platform),
                _ => panic!("neither a case nor a line of one: {line}"),
            }
        }
        book
    }

    fn to_text(&self, about: &str) -> String {
        let mut text = format!("# {about}\n# Written by the tests: {BLESS}=1 writes them again.\n");
        let _ = writeln!(text, "platform = {}", self.platform);
        for entry in &self.entries {
            let _ = writeln!(text, "\n[{}]", entry.name);
            for (name, value) in &entry.lines {
                let _ = writeln!(text, "{name} = {value}");
            }
        }
        text
    }

    /// Differences of `current`, a sentence each.
    fn differences(&self, current: &Self) -> Vec<String> {
        let exact = self.platform == current.platform;
        let mut changes = Vec::new();
        for golden in &self.entries {
            match current.entries.iter().find(|entry| entry.name == golden.name) {
                Some(entry) => differences(golden, entry, exact, &mut changes),
                None => changes.push(format!("[{}] is no case any more", golden.name)),
            }
        }
        let is_new = |entry: &&Entry| !self.entries.iter().any(|golden| golden.name == entry.name);
        changes.extend(current.entries.iter().filter(is_new).map(|entry| format!("[{}] is new", entry.name)));
        changes
    }
}

/// Differences of one case.
fn differences(golden: &Entry, current: &Entry, exact: bool, changes: &mut Vec<String>) {
    for (name, old) in &golden.lines {
        let place = format!("[{}] {name}", golden.name);
        match current.lines.iter().find(|(line, _)| line == name) {
            Some((_, new)) => line_differences(&place, (old, new), exact, changes),
            None => changes.push(format!("{place}: is gone; it was {old}")),
        }
    }
    for (name, new) in &current.lines {
        if !golden.lines.iter().any(|(line, _)| line == name) {
            changes.push(format!("[{}] {name}: is new, {new}", golden.name));
        }
    }
}

fn line_differences(place: &str, (old, new): (&str, &str), exact: bool, changes: &mut Vec<String>) {
    if old == new || (!exact && old.starts_with(HASH) && new.starts_with(HASH)) {
        return;
    }
    let (Some(golden), Some(current)) = (items(old), items(new)) else {
        changes.push(format!("{place}: was {old}, is {new}"));
        return;
    };
    let largest = golden.iter().map(|item| item.value.abs()).filter(|value| value.is_finite()).fold(0.0, f64::max);
    // Elsewhere a term of rounding may be missing, and a number within a name ends otherwise.
    let counts = |item: &&Item| exact || item.label.is_empty() || item.value.abs() > TOLERANCE * largest;
    let golden: Vec<&Item> = golden.iter().filter(counts).collect();
    let current: Vec<&Item> = current.iter().filter(counts).collect();
    let named = |item: &&Item| if exact { item.label.to_owned() } else { rounded(item.label) };
    if !golden.iter().map(named).eq(current.iter().map(named)) {
        changes.push(format!("{place}: other terms\n    was {old}\n    is  {new}"));
        return;
    }
    for (at, (old, new)) in golden.iter().zip(&current).enumerate() {
        let change = (new.value - old.value).abs() / largest;
        // Errors of models without error are rounding on any machine.
        let rounding = !exact && old.value.abs().max(new.value.abs()) < ROUNDING;
        if old.text != new.text && !rounding && (exact || change.is_nan() || change > TOLERANCE) {
            let label = if old.label.is_empty() { format!("number {}", at + 1) } else { old.label.to_owned() };
            changes.push(format!("{place}, {label}: was {}, is {} ({change:.1e} of the line)", old.text, new.text));
        }
    }
}

/// A name with its numbers to nine digits.
fn rounded(label: &str) -> String {
    let of_number = |c: char| c.is_ascii_digit() || c == '.';
    let mut text = String::new();
    let mut rest = label;
    while let Some(begin) = rest.find(|c: char| c.is_ascii_digit()) {
        let length = rest[begin..].find(|c| !of_number(c)).unwrap_or(rest.len() - begin);
        let number = &rest[begin..begin + length];
        text.push_str(&rest[..begin]);
        text.push_str(&number.parse::<f64>().map_or(number.to_owned(), |value| format!("{value:.8e}")));
        rest = &rest[begin + length..];
    }
    text + rest
}

/// A number of a line, and its label.
struct Item<'a> {
    label: &'a str,
    text: &'a str,
    value: f64,
}

/// The numbers of a line; `None` for words.
fn items(line: &str) -> Option<Vec<Item<'_>>> {
    let item = |text: &'_ str| -> Option<(usize, f64)> {
        let at = text.rfind(' ').map_or(0, |at| at + 1);
        Some((at, text[at..].parse().ok()?))
    };
    line.split("; ")
        .map(|text| item(text).map(|(at, value)| Item { label: text[..at].trim_end(), text: &text[at..], value }))
        .collect()
}

/// Platform with equal bytes: operating system (its elementary functions), architecture, the instruction set of the kernels, and that of the processor where
/// third-party libraries choose a wider one.
fn platform() -> String {
    let kernels = fleetfoot::data::instruction_set();
    #[cfg(target_arch = "x86_64")]
    let processor = if std::arch::is_x86_feature_detected!("avx512f") {
        "avx512"
    } else if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma") {
        "avx2"
    } else {
        "scalar"
    };
    #[cfg(not(target_arch = "x86_64"))]
    let processor = kernels;
    let of = if processor == kernels { String::new() } else { format!(" on {processor}") };
    format!("{} {} {kernels}{of}", std::env::consts::OS, std::env::consts::ARCH)
}

/// Holds entries against those of a file, or writes them there where that is asked for.
///
/// # Panics
/// Something is otherwise than it was: case, line and label, old and new, and what to do.
pub(super) fn check(file: &str, about: &str, entries: Vec<Entry>) {
    let current = Book { platform: platform(), entries };
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/goldens").join(file);
    if std::env::var_os(BLESS).is_some_and(|value| !value.is_empty()) {
        fs::write(&path, current.to_text(about)).unwrap_or_else(|problem| panic!("{}: {problem}", path.display()));
        eprintln!("wrote {}", path.display());
        return;
    }
    let text = fs::read_to_string(&path);
    let text = text.unwrap_or_else(|problem| panic!("{}: {problem}; {BLESS}=1 writes it", path.display()));
    let golden = Book::parse(&text);
    let changes = golden.differences(&current);
    assert!(
        changes.is_empty(),
        "{} of {} ({}, here {}):\n  {}\nIf this is meant, write the goldens again: {BLESS}=1 cargo test -p fleetfoot --test all goldens",
        if changes.len() == 1 { "1 difference".to_owned() } else { format!("{} differences", changes.len()) },
        path.display(),
        golden.platform,
        current.platform,
        changes.join("\n  ")
    );
}

fn book(platform: &str, value: f64) -> Book {
    let mut entry = Entry::new("kmeans");
    entry.hash("model", &value.to_le_bytes());
    entry.labelled("f_v in 0", [("1".to_owned(), 0.25), ("lag(u, 1)".to_owned(), value)]);
    entry.numbers("losses", [f64::NAN, 1e-300, 0.1 + 0.2]);
    entry.words("chosen", "kmeans:3, by BIC");
    Book { platform: platform.to_owned(), entries: vec![entry] }
}

#[test]
fn a_book_reads_back() {
    let written = book("here", 3.0);
    assert_eq!(Book::parse(&written.to_text("a title")), written);
    assert!(written.differences(&written.clone()).is_empty());
}

#[test]
fn a_difference_names_case_coefficient_old_and_new() {
    let near = f64::from_bits(3.0_f64.to_bits() + 1);
    let changes = book("here", 3.0).differences(&book("here", near)).join("\n");
    for part in ["[kmeans] model: was blake3:", "[kmeans] f_v in 0, lag(u, 1): was 3.0, is 3.0000000000000004"] {
        assert!(changes.contains(part), "`{part}` is missing from {changes}");
    }
    // Elsewhere rounding is passed over, and no more than that.
    assert!(book("there", 3.0).differences(&book("here", near)).is_empty());
    let changes = book("there", 3.0).differences(&book("here", 3.000_001));
    assert!(changes.len() == 1 && changes[0].contains("lag(u, 1)"), "{changes:?}");
    let mut other = book("here", 3.0);
    other.entries[0].lines[1].1 = "1 0.25; u 3.0".to_owned();
    other.entries[0].lines[3].1 = "average".to_owned();
    let changes = book("there", 3.0).differences(&other).join("\n");
    assert!(changes.contains("other terms") && changes.contains("was kmeans:3, by BIC, is average"), "{changes}");
}
