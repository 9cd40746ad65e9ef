//! Bounds of the whole numbers of settings, equal for flags, entries of a recipe and arguments of Python.

use std::ops::RangeInclusive;

use clap::{Command, builder::RangedU64ValueParser, error::ErrorKind};
use fleetfoot_data::setting::Section;

use super::{Recipe, settings::Settings};

/// Parser of a whole number within bounds, which its error message names. Numbers beyond them make endless jobs or
/// overflow addresses.
pub fn whole<T: TryFrom<u64> + Clone + Send + Sync>(allowed: RangeInclusive<u64>) -> RangedU64ValueParser<T> {
    RangedU64ValueParser::new().range(allowed)
}

impl Recipe {
    /// Refuses a number that its flag refuses.
    pub(super) fn check_bounds(&self) -> Result<(), String> {
        check("pwa", &self.pwa)?;
        check("sparse", &self.sparse)?;
        check("sindy", &self.sindy)?;
        check("narx", &self.narx)?;
        check("network", &self.network)?;
        check("estimate", &self.estimate)?;
        check("control", &self.control)?;
        check("filter", &self.filter)?;
        check("prepare", &self.prepare)?;
        check("resimulate", &self.resimulate)?;
        check("auto", &self.auto)?;
        self.channels.iter().try_for_each(|(name, bounds)| check(&format!("channels.{name}"), bounds))
    }
}

/// Checks every whole number of a section by its flag.
fn check<S: Settings>(place: &str, section: &S) -> Result<(), String> {
    let Ok(entries) = toml::Table::try_from(section) else { return Ok(()) };
    let numbers = entries.iter().filter_map(|(entry, value)| Some((entry, value.as_integer()?)));
    for (entry, number) in numbers {
        let flags = S::augment_args(Command::new("settings").no_binary_name(true));
        let flag = format!("--{}={number}", entry.replace('_', "-"));
        if let Err(refused) = flags.try_get_matches_from([flag])
            && refused.kind() == ErrorKind::ValueValidation
        {
            let reason = std::error::Error::source(&refused).map_or_else(String::new, |reason| format!(": {reason}"));
            return Err(format!("{}{reason}", Section(place).entry(entry).is(number)));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recipe_has_the_bounds_of_the_flags() {
        for (text, words) in [
            ("[prepare]\nhampel = 4294967296\n", ["[prepare] hampel", "0..=10000"]),
            ("[channels.v]\nhampel = 4294967296\n", ["[channels.v] hampel", "0..=10000"]),
            ("[pwa]\nrestarts = 100000000\n", ["[pwa] restarts", "0..=1000"]),
            ("[pwa]\nfolds = 101\n", ["[pwa] folds", "0..=100"]),
            ("[narx]\nlags_out = 1000000000\n", ["[narx] lags_out", "0..=1000"]),
        ] {
            let error = Recipe::parse(text, "robot.toml").unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)) && error.contains("robot.toml"), "{error}");
        }
        Recipe::parse("[prepare]\nhampel = 7\n[pwa]\nrestarts = 10\nfolds = 5\npurge = 1\n", "robot.toml").unwrap();
    }
}
