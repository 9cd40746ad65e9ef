//! Short names for the columns of a recipe: none twice, and each can stand in an expression as it is.

use std::collections::{BTreeSet, HashMap};

/// The reserved words of expressions.
const RESERVED: [&str; 3] = ["pi", "inf", "nan"];

/// Names that are given away.
#[derive(Debug, Default)]
pub(super) struct Names {
    taken: BTreeSet<String>,
    /// The number behind a word from which on free ones are looked for.
    next: HashMap<String, usize>,
}

impl Names {
    /// Names that stand for something else already.
    pub(super) fn besides<'a>(taken: impl IntoIterator<Item = &'a str>) -> Self {
        Self { taken: taken.into_iter().map(str::to_owned).collect(), next: HashMap::new() }
    }

    /// A free name as similar to `wanted` as possible: letters, digits and `_`, not a digit first, with a number behind
    /// it if it is taken.
    pub(super) fn take(&mut self, wanted: &str) -> String {
        let word: String = wanted.trim().chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
        let word = match word.trim_end_matches('_') {
            "" => "c".to_owned(),
            word if word.starts_with(|c: char| c.is_numeric()) => format!("_{word}"),
            word => word.to_owned(),
        };
        let next = self.next.entry(word.clone()).or_insert(1);
        loop {
            let name = if *next == 1 { word.clone() } else { format!("{word}_{next}") };
            *next += 1;
            if !RESERVED.contains(&name.as_str()) && self.taken.insert(name.clone()) {
                return name;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_words() {
        let mut names = Names::besides(["yaw"]);
        let taken = ["yaw", "yaw", "v [m/s]", "2nd", "pi", "", "a.b", "a_b"].map(|wanted| names.take(wanted));
        assert_eq!(taken, ["yaw_2", "yaw_3", "v__m_s", "_2nd", "pi_2", "c", "a_b", "a_b_2"]);
    }
}
