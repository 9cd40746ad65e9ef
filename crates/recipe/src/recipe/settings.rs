//! Settings of a method, one type per method: a section of the recipe, the flags of its command, arguments in Python.
//!
//! A flag or an argument overrides the recipe, and the recipe the default, entry by entry: [`Recipe::say`] is that rule.

use fleetfoot_data::setting::Section;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize, de::DeserializeOwned};

use super::Recipe;
use crate::error::Error;

/// Section of a recipe with the settings of a method: optional entries, each the flag of the same name with hyphens.
pub trait Settings: clap::Args + Clone + std::fmt::Debug + PartialEq + Default + Serialize + DeserializeOwned {
    /// Name in the recipe.
    const SECTION: &'static str;
    /// Names of the entries.
    const ENTRIES: &'static [&'static str];

    /// The section of a recipe.
    fn of(recipe: &mut Recipe) -> &mut Self;

    /// Entries of this section, and those of `below` where this section has none.
    fn over(self, below: Self) -> Self;

    /// Removes from a recipe the entries that contradict this section: a number of terms, if this section has a
    /// threshold.
    fn remove_contradictions(&self, recipe: &mut Recipe);
}

impl Recipe {
    /// Puts explicit entries above those of the recipe.
    pub fn override_with<S: Settings>(&mut self, overrides: S) {
        overrides.remove_contradictions(self);
        let settings = std::mem::take(S::of(self));
        *S::of(self) = overrides.over(settings);
    }

    /// Puts all method sections of another recipe above those of this one.
    pub fn override_all(&mut self, overrides: &Self) {
        self.override_with(overrides.pwa.clone());
        self.override_with(overrides.sparse.clone());
        self.override_with(overrides.sindy.clone());
        self.override_with(overrides.narx.clone());
        self.override_with(overrides.network.clone());
        self.override_with(overrides.estimate.clone());
        self.override_with(overrides.control.clone());
        self.override_with(overrides.filter.clone());
        self.override_with(overrides.prepare.clone());
        self.override_with(overrides.resimulate.clone());
        self.override_with(overrides.auto.clone());
    }
}

/// Declares the settings of a method: the name of the section, the rule that removes contradictions, and the entries
/// with their flags.
macro_rules! settings {
    (
        $section:ident, $contradictions:expr;
        $(#[$about:meta])*
        pub struct $name:ident {
            $($(#[$meta:meta])* pub $entry:ident: $kind:ident,)*
        }
    ) => {
        $(#[$about])*
        #[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema, clap::Args)]
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

            fn remove_contradictions(&self, recipe: &mut $crate::Recipe) {
                let remove: fn(&Self, &mut $crate::Recipe) = $contradictions;
                remove(self, recipe);
            }
        }
    };
}
pub(crate) use settings;

/// A seed; 0 if none is given.
///
/// # Errors
/// A seed that a recipe cannot hold.
pub fn seed(section: &str, seed: Option<u64>) -> Result<u64, Error> {
    match seed.unwrap_or(0) {
        seed if i64::try_from(seed).is_ok() => Ok(seed),
        seed => {
            Err(Error::value(format!("{}: write a number up to {}", Section(section).entry("seed").is(seed), i64::MAX)))
        }
    }
}

/// A number, or `"auto"` to choose it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected a number or \"auto\"")]
pub enum Tunable {
    /// Given number.
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
