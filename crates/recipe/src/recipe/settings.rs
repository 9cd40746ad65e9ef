//! How a method goes, in one type a method: a section of the recipe, the flags of its command, arguments in Python.
//!
//! What is said explicitly (a flag, an argument) stands above the recipe, and the recipe above the default, entry by entry: [`Recipe::say`] is that rule.

use fleetfoot_data::setting::Section;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::Recipe;
use crate::error::Error;

/// The section of a recipe that says how a method goes: entries that may be left out, each the flag of the same name with hyphens.
pub trait Settings: clap::Args + Clone + std::fmt::Debug + PartialEq + Default + Serialize + DeserializeOwned {
    /// Its name in the recipe.
    const SECTION: &'static str;
    /// The names of its entries.
    const ENTRIES: &'static [&'static str];

    /// The recipe's own section.
    fn of(recipe: &mut Recipe) -> &mut Self;

    /// What is said here, and what `below` says where nothing is said here.
    fn over(self, below: Self) -> Self;

    /// Takes out of a recipe what contradicts what is said here: a number of terms, where here is a threshold.
    fn silence(&self, recipe: &mut Recipe);
}

impl Recipe {
    /// Says something explicitly: it stands above what the recipe said so far.
    pub fn say<S: Settings>(&mut self, said: S) {
        said.silence(self);
        let own = std::mem::take(S::of(self));
        *S::of(self) = said.over(own);
    }

    /// Says everything that the methods' sections of another recipe say.
    pub fn say_all(&mut self, said: &Self) {
        self.say(said.pwa.clone());
        self.say(said.sparse.clone());
        self.say(said.sindy.clone());
        self.say(said.narx.clone());
        self.say(said.network.clone());
        self.say(said.estimate.clone());
        self.say(said.control.clone());
        self.say(said.filter.clone());
        self.say(said.prepare.clone());
        self.say(said.resimulate.clone());
        self.say(said.auto.clone());
    }
}

/// Declares the settings of a method: the name of the section, what is silenced by what is said, and the entries with their flags.
macro_rules! settings {
    (
        $section:ident, $silence:expr;
        $(#[$about:meta])*
        pub struct $name:ident {
            $($(#[$meta:meta])* pub $entry:ident: $kind:ident,)*
        }
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize, clap::Args)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $(
                $(#[$meta])*
                #[serde(skip_serializing_if = "Option::is_none")]
                pub $entry: Option<$kind>,
            )*
        }

        impl $crate::Settings for $name {
            const SECTION: &'static str = stringify!($section);
            const ENTRIES: &'static [&'static str] = &[$(stringify!($entry)),*];

            fn of(recipe: &mut $crate::Recipe) -> &mut Self {
                &mut recipe.$section
            }

            fn over(self, below: Self) -> Self {
                Self { $($entry: self.$entry.or(below.$entry),)* }
            }

            fn silence(&self, recipe: &mut $crate::Recipe) {
                let silence: fn(&Self, &mut $crate::Recipe) = $silence;
                silence(self, recipe);
            }
        }
    };
}
pub(crate) use settings;

/// A seed, 0 where none is said.
///
/// # Errors
/// One that a recipe cannot hold.
pub fn seed(section: &str, seed: Option<u64>) -> Result<u64, Error> {
    match seed.unwrap_or(0) {
        seed if i64::try_from(seed).is_ok() => Ok(seed),
        seed => {
            Err(Error::value(format!("{}: write a number up to {}", Section(section).entry("seed").is(seed), i64::MAX)))
        }
    }
}

/// A number, or `"auto"`: it is chosen.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number or \"auto\"")]
pub enum Tunable {
    /// This one.
    Number(f64),
    /// `auto`.
    Word(String),
}

impl std::str::FromStr for Tunable {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(text.parse().map_or_else(|_| Self::Word(text.to_owned()), Self::Number))
    }
}

impl std::fmt::Display for Tunable {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(value) => value.fmt(f),
            Self::Word(word) => f.write_str(word),
        }
    }
}
