//! The page of all commands, `docs/reference/cli.md`: made from the arguments, and held against them.

use std::{fmt::Write, fs, path::Path};

use clap::{Arg, Command, CommandFactory};

use crate::{args::Cli, help};

/// Text above the commands.
const HEAD: &str = "\
# Commands

This page lists all commands and options; `fleetfoot COMMAND --help` prints the same text. `fleetfoot completions SHELL`
prints completions for bash, zsh, fish, elvish and PowerShell, and `fleetfoot man` writes manual pages.

Results go to standard output, progress and notes to standard error. The exit code is 0, 1 (error in the data or the
fit), 2 (error in the arguments) or 130 (stopped). The [glossary](glossary.md) explains the terms.
";

/// The page.
fn page() -> String {
    let mut command = help::grouped(Cli::command()).disable_help_subcommand(true);
    command.build();
    let mut text = format!("{HEAD}\n## Every command\n\n");
    let of_all = |argument: &&Arg| argument.is_global_set();
    listed(&mut text, command.get_arguments().filter(of_all));
    sections(&mut text, &command);
    text
}

/// The sections of the commands below one, those of their own commands behind each.
fn sections(text: &mut String, command: &Command) {
    for subcommand in command.get_subcommands().filter(|subcommand| !subcommand.is_hide_set()) {
        if subcommand.has_subcommands() {
            sections(text, subcommand);
        } else {
            section(text, subcommand);
        }
    }
}

fn section(text: &mut String, command: &Command) {
    let name = command.get_display_name().unwrap_or(command.get_name()).replace('-', " ");
    let about = command.get_about().map(ToString::to_string).unwrap_or_default();
    let usage = command.clone().render_usage().to_string();
    let usage = usage.strip_prefix("Usage: ").unwrap_or(&usage);
    let _ = write!(text, "\n## {name}\n\n{about}.\n\n```text\n{usage}\n```\n\n", about = about.trim_end_matches('.'));
    listed(text, command.get_arguments().filter(|argument| !argument.is_global_set()));
    if let Some(examples) = command.get_after_help() {
        let lines: Vec<String> =
            examples.to_string().lines().filter_map(|line| line.strip_prefix("  ")).map(str::to_owned).collect();
        let _ = write!(text, "\n```text\n{}\n```\n", lines.join("\n"));
    }
}

/// An item an argument, below the headings of their groups: name, meaning, possible values, default.
fn listed<'a>(text: &mut String, arguments: impl Iterator<Item = &'a Arg>) {
    let mut heading = None;
    for argument in
        arguments.filter(|option| !option.is_hide_set() && !["help", "version"].contains(&option.get_id().as_str()))
    {
        let group = help::heading(argument);
        if let Some(group) = group.filter(|_| group != heading) {
            let above = if text.ends_with("\n\n") { "" } else { "\n" };
            let _ = write!(text, "{above}**{group}**\n\n");
        }
        heading = group;
        let help = argument.get_long_help().or(argument.get_help()).map(ToString::to_string).unwrap_or_default();
        let help = help.split_whitespace().collect::<Vec<_>>().join(" ");
        let help = help.trim_end_matches('.');
        let stop = if help.ends_with(".)") { "" } else { "." };
        let item = format!("- `{}`: {help}{stop}{}", written(argument), values(argument));
        let _ = writeln!(text, "{}", wrapped(&item));
    }
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
        // What may stand without a value takes it behind `=` alone: a word behind a space would be the next argument.
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
fn the_page_of_all_commands_tells_what_they_accept() {
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
