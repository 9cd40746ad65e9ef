//! The page of all commands, `docs/reference/cli.md`: made from the arguments, and held against them.

use std::{
    collections::{HashMap, HashSet},
    fmt::Write,
    fs,
    path::Path,
};

use clap::{Arg, Command, CommandFactory};

use crate::{args::Cli, help};

/// Text above the commands.
const HEAD: &str = "\
# Commands

This page lists all commands and options; `fleetfoot COMMAND --help` prints the same text.

[Conventions](conventions.md) describe data, outputs and exit codes; the [glossary](glossary.md) explains the terms.
";

/// Commands that share an option from which on it stands once, above them.
const SHARED: usize = 3;

/// Options by the text of their item, with the number of commands that have them.
type Counts = HashMap<String, usize>;

/// The page.
fn page() -> String {
    let mut command = help::grouped(Cli::command()).disable_help_subcommand(true);
    command.build();
    let mut counts = Counts::new();
    for leaf in leaves(&command) {
        for option in of_command(leaf).filter(|option| !option.is_positional()) {
            *counts.entry(item(option)).or_default() += 1;
        }
    }
    let mut text = format!("{HEAD}\n## Every command\n\n");
    listed(&mut text, command.get_arguments().filter(|argument| argument.is_global_set()), &Counts::new());
    text.push_str("\n## Options of several commands\n\nThe commands below name them, without their text.\n\n");
    let mut seen = HashSet::new();
    let first = leaves(&command).into_iter().flat_map(of_command).filter(|option| {
        let item = item(option);
        counts.get(&item).is_some_and(|count| *count >= SHARED) && seen.insert(item)
    });
    let mut shared: Vec<&Arg> = first.collect();
    shared.sort_by_key(|option| help::group(option));
    listed(&mut text, shared.into_iter(), &Counts::new());
    for leaf in leaves(&command) {
        section(&mut text, leaf, &counts);
    }
    text
}

/// The commands without subcommands, in their order.
fn leaves(command: &Command) -> Vec<&Command> {
    let visible = command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set());
    visible.flat_map(|sub| if sub.has_subcommands() { leaves(sub) } else { vec![sub] }).collect()
}

/// The options and arguments of one command that are shown.
fn of_command(command: &Command) -> impl Iterator<Item = &Arg> {
    command.get_arguments().filter(|argument| !argument.is_global_set() && is_shown(argument))
}

fn is_shown(argument: &Arg) -> bool {
    !argument.is_hide_set() && !["help", "version"].contains(&argument.get_id().as_str())
}

fn section(text: &mut String, command: &Command, counts: &Counts) {
    let name = command.get_display_name().unwrap_or(command.get_name()).replace('-', " ");
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let usage = command.clone().render_usage().to_string();
    let usage = usage.strip_prefix("Usage: ").unwrap_or(&usage);
    let _ = write!(text, "\n## {name}\n\n{about}.\n\n```text\n{usage}\n```\n\n", about = about.trim_end_matches('.'));
    listed(text, of_command(command), counts);
    if let Some(examples) = command.get_after_help() {
        let lines: Vec<String> =
            examples.to_string().lines().filter_map(|line| line.strip_prefix("  ")).map(str::to_owned).collect();
        let _ = write!(text, "\n```text\n{}\n```\n", lines.join("\n"));
    }
}

/// An item an argument, below the headings of their groups; those that several commands share by their names alone.
fn listed<'a>(text: &mut String, arguments: impl Iterator<Item = &'a Arg>, counts: &Counts) {
    let arguments: Vec<&Arg> = arguments.filter(|argument| is_shown(argument)).collect();
    for group in arguments.chunk_by(|a, b| help::heading(a) == help::heading(b)) {
        if let Some(heading) = help::heading(group[0]) {
            let above = if text.ends_with("\n\n") { "" } else { "\n" };
            let _ = write!(text, "{above}**{heading}**\n\n");
        }
        let (shared, others): (Vec<&Arg>, Vec<&Arg>) =
            group.iter().partition(|option| counts.get(&item(option)).is_some_and(|count| *count >= SHARED));
        for option in others {
            let _ = writeln!(text, "{}", wrapped(&item(option)));
        }
        if !shared.is_empty() {
            let names: Vec<String> = shared.iter().map(|option| format!("`{}`", written(option))).collect();
            let _ = writeln!(
                text,
                "{}",
                wrapped(&format!("- [As above](#options-of-several-commands): {}.", names.join(", ")))
            );
        }
    }
}

/// The item of an argument: name, meaning, possible values, default.
fn item(argument: &Arg) -> String {
    let help = argument.get_long_help().or(argument.get_help()).map(ToString::to_string).unwrap_or_default();
    let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
    let help = help.trim_end_matches('.');
    let stop = if help.ends_with(".)") { "" } else { "." };
    format!("- `{}`: {help}{stop}{}", written(argument), values(argument))
}

/// Characters of a line at most.
const WIDTH: usize = 120;

/// An item of a list on lines of [`WIDTH`]; names in backticks stay whole.
fn wrapped(item: &str) -> String {
    let (mut text, mut width, mut open) = (String::new(), 0, false);
    let mut words: Vec<String> = Vec::new();
    for word in item.split(' ') {
        match words.last_mut().filter(|_| open) {
            Some(last) => last.extend([" ", word]),
            None => words.push(word.to_owned()),
        }
        open ^= word.matches('`').count() % 2 == 1;
    }
    for word in words {
        let length = word.chars().count();
        if width > 0 && width + 1 + length > WIDTH {
            text.push_str("\n ");
            width = 1;
        }
        if width > 0 {
            text.push(' ');
            width += 1;
        }
        text.push_str(&word);
        width += length;
    }
    text
}

/// `-o, --output <MODEL>`.
fn written(argument: &Arg) -> String {
    let value = || argument.get_value_names().unwrap_or_default().first().map_or("", |name| name.as_str()).to_owned();
    if argument.is_positional() {
        return value();
    }
    let short = argument.get_short().map_or_else(String::new, |short| format!("-{short}, "));
    let long = argument.get_long().map_or_else(String::new, |long| format!("--{long}"));
    let value = match argument.get_action().takes_values() {
        // Options with an optional value take it behind `=` alone: a word behind a space would be the next argument.
        true if argument.is_require_equals_set() => format!("[={}]", value()),
        true => format!(" {}", value()),
        false => String::new(),
    };
    format!("{short}{long}{value}")
}

/// The possible values and the default.
fn values(argument: &Arg) -> String {
    let mut text = String::new();
    let possible = argument.get_possible_values();
    if argument.get_action().takes_values() && !possible.is_empty() {
        let all: Vec<String> = possible
            .iter()
            .map(|value| {
                let help = value.get_help().map(|help| format!(" ({})", help.to_string().trim_end_matches('.')));
                format!("`{}`{}", value.get_name(), help.unwrap_or_default())
            })
            .collect();
        let _ = write!(text, " One of {}.", all.join(", "));
    }
    let default = argument.get_default_values().first().filter(|_| !argument.is_hide_default_value_set());
    if let Some(default) = default.filter(|_| argument.get_action().takes_values()) {
        let _ = write!(text, " Default: `{}`.", default.to_string_lossy());
    }
    text
}

#[test]
fn reference_page_lists_accepted_values() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/reference/cli.md");
    let page = page();
    if std::env::var("FLEETFOOT_DOCS").is_ok_and(|word| word == "overwrite") {
        fs::write(&path, &page).expect("the page can be written");
    }
    let written = fs::read_to_string(&path).unwrap_or_default();
    let differing = written.lines().zip(page.lines()).find(|(written, made)| written != made);
    assert!(
        written == page,
        "docs/reference/cli.md is out of date at {differing:?}: FLEETFOOT_DOCS=overwrite cargo test -p fleetfoot-cli reference"
    );
}
