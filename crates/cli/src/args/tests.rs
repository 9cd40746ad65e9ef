//! Options, settings and their words: one meaning each, the same in flags and recipes.

use clap::{CommandFactory, Parser};
use fleetfoot::{
    AutoSection, EstimateSection, FilterSection, Lags, ModelSection, NarxSection, NetworkSection, PwaSection, Recipe,
    ResimulateSection, Settings, SindySection, SparseSection, data::setting,
};

use super::{Cli, Command, Fit, List};

#[test]
fn lists_split_at_the_commas_between_items() {
    let list: List = "y, lag(y,1),`odd, name`,a[0,1]".parse().unwrap();
    assert_eq!(list.0, ["y", "lag(y,1)", "`odd, name`", "a[0,1]"]);
    assert!("a,,b".parse::<List>().is_err());
}

/// Two values that a flag takes.
fn values(argument: &clap::Arg) -> [String; 2] {
    match argument.get_possible_values().as_slice() {
        [first, second, ..] => [first, second].map(|value| value.get_name().to_owned()),
        _ if argument.get_id() == "objective" => ["steps:2", "steps:3"].map(str::to_owned),
        _ if argument.get_id() == "passive" => ["f:v", "f:v:2"].map(str::to_owned),
        _ => ["2", "3"].map(str::to_owned),
    }
}

/// Every entry of a method's settings is an entry of its section and a flag of its command; the flag stands above the recipe, and the recipe above nothing.
fn walk<S: Settings>(command: &[&str], of: fn(&Command) -> Option<&S>) {
    let arguments_of = S::augment_args(clap::Command::new("settings"));
    let mut fields = Vec::new();
    for argument in arguments_of.get_arguments() {
        let entry = argument.get_id().as_str();
        let flag = |value: &str| -> S {
            let flag = format!("--{}={value}", entry.replace('_', "-"));
            let words = ["fleetfoot"].iter().chain(command).copied().chain(["log.csv", &flag]);
            let cli = Cli::try_parse_from(words);
            let cli = cli.unwrap_or_else(|problem| panic!("{flag}: {problem}"));
            of(&cli.command).unwrap_or_else(|| panic!("{flag}: another method")).clone()
        };
        let [settings, other] = values(argument).map(|value| flag(&value));
        assert!(settings != other && settings != S::default(), "--{entry} changes nothing");
        let mut recipe = Recipe::default();
        *S::of(&mut recipe) = other.clone();
        let text = recipe.to_toml();
        assert!(text.starts_with(&format!("[{}]\n{entry} = ", S::SECTION)), "{entry}: {text}");
        let mut recipe = Recipe::parse(&text, "the recipe").unwrap();
        recipe.override_with(S::default());
        assert_eq!(*S::of(&mut recipe), other, "{entry}: the recipe stands above the default");
        recipe.override_with(settings.clone());
        assert_eq!(*S::of(&mut recipe), settings, "{entry}: the flag stands above the recipe");
        fields.push(entry.to_owned());
    }
    assert_eq!(fields, S::ENTRIES, "[{}]", S::SECTION);
}

#[test]
fn flags_override_recipe_entries() {
    walk::<PwaSection>(&["fit", "pwa"], |command| match command {
        Command::Fit(Fit::Pwa(options)) => Some(&options.pwa),
        _ => None,
    });
    walk::<SparseSection>(&["fit", "sparse"], |command| match command {
        Command::Fit(Fit::Sparse(options)) => Some(&options.sparse),
        _ => None,
    });
    walk::<SindySection>(&["fit", "sindy"], |command| match command {
        Command::Fit(Fit::Sindy(options)) => Some(&options.sindy),
        _ => None,
    });
    walk::<NarxSection>(&["fit", "narx"], |command| match command {
        Command::Fit(Fit::Narx(options)) => Some(&options.narx),
        _ => None,
    });
    walk::<NetworkSection>(&["fit", "network"], |command| match command {
        Command::Fit(Fit::Network(options)) => Some(&options.network),
        _ => None,
    });
    walk::<EstimateSection>(&["fit", "parameters"], |command| match command {
        Command::Fit(Fit::Parameters(options)) => Some(&options.estimate),
        _ => None,
    });
    walk::<FilterSection>(&["filter", "model.json"], |command| match command {
        Command::Filter(options) => Some(&options.section),
        _ => None,
    });
    walk::<AutoSection>(&["auto", "log.csv"], |command| match command {
        Command::Auto(options) => Some(&options.auto),
        _ => None,
    });
    walk::<ResimulateSection>(&["resimulate", "model.json"], |command| match command {
        Command::Resimulate(options) => Some(&options.section),
        _ => None,
    });
}

#[test]
fn partition_methods_share_model_flags() {
    let model = ModelSection {
        predict: Some("next".into()),
        degree: Some(2),
        lags: Some(Lags::rows(1)),
        weight: Some("w".into()),
        partition: Some("average".into()),
        partition_on: Some(vec!["x".into()]),
    };
    let recipe = Recipe { model, ..Recipe::default() };
    let text = recipe.to_toml();
    let entries = text.lines().filter_map(|line| line.split_once(" = ")).map(|(entry, _)| entry.to_owned());
    let entries: Vec<String> = entries.collect();
    assert_eq!(entries.len(), 6, "{text}");
    let mut command = Cli::command();
    let fit = command.find_subcommand_mut("fit").unwrap();
    for method in ["pwa", "sindy", "narx"] {
        let method_command = fit.find_subcommand_mut(method).unwrap();
        for entry in &entries {
            assert!(
                method_command.get_arguments().any(|argument| argument.get_id() == entry.as_str()),
                "{method}: {entry}"
            );
        }
    }
}

#[test]
fn command_line_is_valid_and_described() {
    Cli::command().debug_assert();
    let mut command = Cli::command();
    let fit = command.find_subcommand_mut("fit").unwrap();
    let about = fit.find_subcommand_mut("pwa").unwrap().get_about().unwrap().to_string();
    assert_eq!(about, "A piecewise-affine model");
}

/// Every setting that messages name is a flag, which may stand without a value where the message shows it so.
#[test]
fn settings_in_messages_are_flags() {
    fn flags(command: &clap::Command, known: &mut Vec<(String, bool)>) {
        let bare = |argument: &clap::Arg| argument.get_num_args().is_none_or(|count| count.min_values() == 0);
        let named =
            command.get_arguments().filter_map(|argument| Some((argument.get_long()?.to_owned(), bare(argument))));
        known.extend(named);
        command.get_subcommands().for_each(|sub| flags(sub, known));
    }
    let mut command = Cli::command();
    command.build();
    let mut known = Vec::new();
    flags(&command, &mut known);
    for setting in setting::SETTINGS {
        let flag = (setting.name.replace('_', "-"), setting.kind != setting::Kind::Value);
        assert!(known.contains(&flag), "no command has --{}, where bare is {}", flag.0, flag.1);
    }
}
