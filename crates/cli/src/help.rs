//! Help that can be scanned: options in groups of one order, and in `-h` the usual options alone.

use clap::{Arg, Command};

/// Groups of options in the order of the help, each with the options that belong to it in every command. The group
/// without a list has the others: those of the command itself.
const GROUPS: [(&str, &str); 6] = [
    (
        "Data",
        "recipe states inputs input angles alias derivative outputs weight time time-unit dt max-gap where stamp base rate rename \
         topic measured sensors truth episodes episode file plane free-run fit",
    ),
    ("Model", ""),
    (
        "Selection",
        "select objective folds purge horizon starts effort restarts seed test-share terms max-terms stability bolasso \
         ensemble inclusion front tried keep-all iterations max-iterations search",
    ),
    ("Checks", "strict dry-run plan influence compare outside unseen-labels no-domain"),
    (
        "Output",
        "output force append export to format title svg csv values regions transitions all-pairs print-world no-truth",
    ),
    ("Run", "threads json quiet explain cache no-cache memory chunk-rows tsqr"),
];

/// Options that `-h` shows; `--help` shows all. A pair is the option of one command.
const USUAL: &str = "recipe states inputs input predict degree lags partition library where output export effort hidden activation cell \
    optimizer threshold parameter to method setpoint q r measured seconds runs speed strict values topic \
    rollout:horizon rollout:starts mpc:horizon mpc:limits mpc:bounds generate:format import:dt";

/// A command whose help has the groups, and the same for the commands below it.
pub(crate) fn grouped(command: Command) -> Command {
    let names: Vec<String> = command.get_subcommands().map(|subcommand| subcommand.get_name().to_owned()).collect();
    let of = command.get_name().to_owned();
    // Help lists groups in the order of their first options.
    let mut sorted: Vec<Arg> = command.get_arguments().map(|argument| placed(argument.clone(), &of)).collect();
    sorted.sort_by_key(|argument| (!argument.is_positional(), group(argument)));
    let mut sorted = sorted.into_iter();
    let command = command.mut_args(|argument| sorted.next().unwrap_or(argument));
    match names.is_empty() {
        true => command.help_template(EXAMPLES_FIRST),
        false => names.into_iter().fold(command, |command, name| command.mut_subcommand(name, grouped)),
    }
}

/// Help with the examples above the options.
const EXAMPLES_FIRST: &str = "{before-help}{about-with-newline}\n{usage-heading} {usage}{after-help}\n\n{all-args}";

/// An option of a command in its group, hidden from `-h` unless it is usual.
fn placed(argument: Arg, command: &str) -> Arg {
    let Some(long) = argument.get_long() else { return argument };
    let is_usual = USUAL.split_whitespace().any(|usual| match usual.split_once(':') {
        Some((of, name)) => of == command && name == long,
        None => usual == long,
    });
    let heading = GROUPS[group(&argument)].0;
    argument.help_heading(heading).hide_short_help(!is_usual)
}

/// Heading of an argument's group; `None` for a positional one.
#[cfg(test)]
pub(crate) fn heading(argument: &Arg) -> Option<&'static str> {
    argument.get_long().map(|_| GROUPS[group(argument)].0)
}

/// Index of the group of an option.
pub(crate) fn group(argument: &Arg) -> usize {
    let is_of = |(_, options): &(&str, &str)| {
        argument.get_long().is_some_and(|long| options.split_whitespace().any(|option| option == long))
    };
    let rest = || GROUPS.iter().position(|(_, options)| options.is_empty()).unwrap_or(0);
    GROUPS.iter().position(is_of).unwrap_or_else(rest)
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;
    use crate::args::Cli;

    /// Lines of a screen.
    const SCREEN: usize = 50;

    fn each(command: &Command, visit: &mut impl FnMut(&Command)) {
        visit(command);
        command.get_subcommands().for_each(|subcommand| each(subcommand, visit));
    }

    #[test]
    fn short_help_fits_on_a_screen() {
        let mut command = grouped(Cli::command());
        command.build();
        each(&command, &mut |command| {
            let short = command.clone().term_width(100).render_help().to_string();
            let name = command.get_display_name().unwrap_or_default().to_owned();
            assert!(short.lines().count() <= SCREEN, "{name}: {} lines\n{short}", short.lines().count());
            let long = command.clone().render_long_help().to_string();
            let place = |group: &(&str, &str)| long.find(&format!("\n{}:\n", group.0));
            let places: Vec<usize> = GROUPS.iter().filter_map(place).collect();
            assert!(places.is_sorted(), "{name}: {places:?}");
        });
    }

    #[test]
    fn every_name_matches_an_option() {
        let mut names = Vec::new();
        each(&grouped(Cli::command()), &mut |command| {
            names.extend(command.get_arguments().filter_map(Arg::get_long).map(str::to_owned));
        });
        let listed = GROUPS.iter().flat_map(|(_, options)| options.split_whitespace()).chain(USUAL.split_whitespace());
        for name in listed {
            let name = name.split_once(':').map_or(name, |(_, name)| name);
            assert!(names.iter().any(|option_name| option_name == name), "--{name}");
        }
    }
}
