//! Groups of candidate functions that enter together: the setting `groups`, read once.

use std::collections::{BTreeMap, BTreeSet};

use fleetfoot_data::setting::Section;
use fleetfoot_data::{did_you_mean, nearest};
use fleetfoot_library::Expr;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::{error::Error, list::items};

/// Allowed values, for people.
const ALLOWED: &str =
    "signal, term, or lists of signals by name: `legs=q1,q2,arms=q3,q4`, in a recipe also { legs = [\"q1\", \"q2\"] }";

/// Groups as a recipe names them: a word, or lists of signals.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "expected \"signal\", \"term\", or lists: { legs = [\"q1\", \"q2\"] }")]
pub enum GroupWords {
    /// `signal`, `term`, or lists in one text, `legs=q1,q2,arms=q3,q4`.
    Word(String),
    /// Lists of signals or functions by the names of the groups.
    Named(BTreeMap<String, Vec<String>>),
}

impl std::str::FromStr for GroupWords {
    type Err = std::convert::Infallible;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(Self::Word(text.to_owned()))
    }
}

/// Rule of the candidate functions that enter together.
#[derive(Debug, Clone, PartialEq, Eq)]
#[non_exhaustive]
pub enum GroupRule {
    /// All functions of the same signals: a signal with its powers and lags; products are groups of their factors' signals.
    Signal,
    /// A function in all equations that have it.
    Term,
    /// Functions of listed signals, by the names of the groups; of other signals as [`GroupRule::Signal`].
    Named(BTreeMap<String, Vec<String>>),
}

impl GroupRule {
    /// Reads the words of a section of a recipe.
    pub fn new(words: &GroupWords, section: &str) -> Result<Self, Error> {
        let named = match words {
            GroupWords::Word(word) if word == "signal" => return Ok(Self::Signal),
            GroupWords::Word(word) if word == "term" => return Ok(Self::Term),
            GroupWords::Word(text) => lists(text, section)?,
            GroupWords::Named(named) => named.clone(),
        };
        if named.is_empty() {
            return Err(Error::value(format!(
                "{}: no group is given; write {ALLOWED}",
                Section(section).entry("groups")
            )));
        }
        match named.iter().find(|(_, list)| list.iter().all(String::is_empty)) {
            Some((name, _)) => Err(Error::value(format!(
                "{} {name}: the list is empty; name its signals",
                Section(section).entry("groups")
            ))),
            None => Ok(Self::Named(named)),
        }
    }

    /// Functions that enter together, in words.
    pub fn in_words(&self) -> String {
        match self {
            Self::Signal => "the functions of a signal together".to_owned(),
            Self::Term => "a function in all equations together".to_owned(),
            Self::Named(named) => {
                format!("groups {}", named.keys().map(String::as_str).collect::<Vec<_>>().join(", "))
            }
        }
    }

    /// The number of every function's group, in the order of their first functions; functions are given with the latent that they belong to.
    ///
    /// # Errors
    /// A listed name that is neither a signal nor a function; a function in two groups.
    pub fn labels(&self, functions: &[(usize, &Expr)]) -> Result<Vec<usize>, Error> {
        self.check_names(functions)?;
        let mut numbers: BTreeMap<(usize, String), usize> = BTreeMap::new();
        let mut labels = Vec::with_capacity(functions.len());
        for (latent, function) in functions {
            let key = match self {
                Self::Term => (0, function.to_string()),
                Self::Signal => (*latent, signals_key(function)),
                Self::Named(named) => match named_key(named, function)? {
                    Some(name) => (*latent, format!("group {name}")),
                    None => (*latent, signals_key(function)),
                },
            };
            let next = numbers.len();
            labels.push(*numbers.entry(key).or_insert(next));
        }
        Ok(labels)
    }

    /// Every listed name is a signal or a function.
    fn check_names(&self, functions: &[(usize, &Expr)]) -> Result<(), Error> {
        let Self::Named(named) = self else { return Ok(()) };
        let mut known: BTreeSet<String> = functions.iter().map(|(_, function)| function.to_string()).collect();
        known.extend(functions.iter().flat_map(|(_, function)| signals(function)));
        for (name, list) in named {
            if let Some(item) = list.iter().find(|item| !known.contains(*item)) {
                let near = did_you_mean(&nearest(item, known.iter().map(String::as_str)));
                let problem = format!("groups {name}: `{item}` is neither a signal nor a candidate function{near}");
                return Err(Error::unknown(item, problem));
            }
        }
        Ok(())
    }
}

/// Lists in one text, `legs=q1,q2,arms=q3,q4`: an item with a name before an equals sign begins the next one.
fn lists(text: &str, section: &str) -> Result<BTreeMap<String, Vec<String>>, Error> {
    let (mut named, mut last): (BTreeMap<String, Vec<String>>, String) = (BTreeMap::new(), String::new());
    for item in items(text) {
        let begins = beginning(&item);
        if let Some((name, _)) = begins {
            name.clone_into(&mut last);
            if named.insert(last.clone(), Vec::new()).is_some() {
                return Err(Error::value(format!(
                    "{}: the group {name} is there twice; give it one list",
                    Section(section).entry("groups").is(text)
                )));
            }
        }
        let Some(list) = named.get_mut(&last) else {
            return Err(Error::value(format!("{}: write {ALLOWED}", Section(section).entry("groups").is(text))));
        };
        list.push(begins.map_or(item.as_str(), |(_, first)| first).to_owned());
    }
    Ok(named)
}

/// The name of a group and the first of its list, where an item begins one.
fn beginning(item: &str) -> Option<(&str, &str)> {
    let (name, first) = item.split_once('=')?;
    let name = name.trim();
    let plain = |c: char| c.is_alphanumeric() || c == '_' || c == '-';
    (!name.is_empty() && name.chars().all(plain)).then_some((name, first.trim()))
}

/// The signals of a function, in the order of their names; filters and lags are those of their signals.
fn signals(function: &Expr) -> BTreeSet<String> {
    function.sources().iter().map(|name| name.to_string()).collect()
}

/// The same for all functions of the same signals; a function without signals is alone.
fn signals_key(function: &Expr) -> String {
    let signals: Vec<String> = signals(function).into_iter().collect();
    if signals.is_empty() { format!("function {function}") } else { format!("signals {}", signals.join(" ")) }
}

/// The named group that lists a function, or all of its signals.
fn named_key<'a>(named: &'a BTreeMap<String, Vec<String>>, function: &Expr) -> Result<Option<&'a str>, Error> {
    let (text, signals) = (function.to_string(), signals(function));
    let all = |list: &[String]| !signals.is_empty() && signals.iter().all(|signal| list.contains(signal));
    let holds = |list: &[String]| list.contains(&text) || all(list);
    let mut holding = named.iter().filter(|(_, list)| holds(list)).map(|(name, _)| name.as_str());
    match (holding.next(), holding.next()) {
        (Some(one), Some(other)) => Err(Error::conflict(format!(
            "groups {one} and {other} both have `{text}`; a function may be in one group only"
        ))),
        (key, _) => Ok(key),
    }
}

#[cfg(test)]
mod tests {
    use fleetfoot_library::Scope;

    use super::*;

    fn labels(words: &GroupWords, texts: &[(usize, &str)]) -> Result<Vec<usize>, String> {
        let expr = |text: &str| Expr::parse(text, &Scope::open()).unwrap();
        let functions: Vec<(usize, Expr)> = texts.iter().map(|(latent, text)| (*latent, expr(text))).collect();
        let functions: Vec<(usize, &Expr)> = functions.iter().map(|(latent, function)| (*latent, function)).collect();
        let rule = GroupRule::new(words, "sparse").map_err(|error| error.to_string())?;
        rule.labels(&functions).map_err(|error| error.to_string())
    }

    fn word(text: &str) -> GroupWords {
        GroupWords::Word(text.into())
    }

    #[test]
    fn signals_have_their_powers_and_lags() {
        let functions = [(0, "1"), (0, "x"), (0, "y"), (0, "x^2"), (0, "x*y"), (0, "sin(x)"), (0, "y*x^2"), (1, "x")];
        assert_eq!(labels(&word("signal"), &functions), Ok(vec![0, 1, 2, 1, 3, 1, 3, 4]));
        assert_eq!(labels(&word("term"), &functions), Ok(vec![0, 1, 2, 3, 4, 5, 6, 1]));
        let lagged = Expr::lagged("x", 3);
        assert_eq!(signals(&lagged), BTreeSet::from(["x".to_owned()]));
    }

    #[test]
    fn named_groups_hold_the_functions_of_their_signals() {
        let functions = [(0, "1"), (0, "q1"), (0, "q2"), (0, "q1*q2"), (0, "q3"), (0, "q1*q3"), (0, "q3^2")];
        let named = |entries: &[(&str, &[&str])]| {
            let list = |list: &[&str]| list.iter().map(|item| (*item).to_owned()).collect::<Vec<String>>();
            GroupWords::Named(entries.iter().map(|(name, items)| ((*name).to_owned(), list(items))).collect())
        };
        assert_eq!(labels(&named(&[("legs", &["q1", "q2"])]), &functions), Ok(vec![0, 1, 1, 1, 2, 3, 2]));
        assert_eq!(labels(&named(&[("a", &["1", "q3^2"])]), &functions), Ok(vec![0, 1, 2, 3, 4, 5, 0]));
        let message = labels(&named(&[("legs", &["q4"])]), &functions).unwrap_err();
        assert!(message.contains("`q4`") && message.contains("did you mean"), "{message}");
        let message = labels(&named(&[("a", &["q1"]), ("b", &["q1", "q2"])]), &functions).unwrap_err();
        assert!(message.contains("a and b both have `q1`"), "{message}");
        let message = labels(&named(&[("a", &[])]), &functions).unwrap_err();
        assert!(message.contains("empty"), "{message}");
        assert!(labels(&word("leg"), &functions).unwrap_err().contains("signal, term"));
    }

    #[test]
    fn lists_may_stand_in_one_text() {
        let of = |text: &str| GroupRule::new(&word(text), "sparse").map_err(|error| error.to_string());
        let list = |items: &[&str]| items.iter().map(|item| (*item).to_owned()).collect::<Vec<String>>();
        let legs = ("legs".to_owned(), list(&["q1", "max(a, b)"]));
        let arms = ("arms".to_owned(), list(&["q3"]));
        assert_eq!(of("legs=q1, max(a, b)"), Ok(GroupRule::Named(BTreeMap::from([legs.clone()]))));
        assert_eq!(of("legs=q1,max(a, b), arms = q3"), Ok(GroupRule::Named(BTreeMap::from([legs, arms]))));
        for (text, part) in
            [("signals", "signal, term"), ("q1,a=b", "signal, term"), ("a=b,a=c", "twice"), ("a=", "empty")]
        {
            let message = of(text).unwrap_err();
            assert!(message.contains(part) && message.starts_with("[sparse] groups"), "{text}: {message}");
        }
    }
}
