//! Condition for the rows in use: `where` of a recipe.

use fleetfoot_data::setting::{Entry, TIME_SECTION, WHERE};

use std::ops::Range;

use fleetfoot_data::{Column, ColumnKind, Halo, Progress, Source, Watched, parallel_fold};
use fleetfoot_library::Expr;
use fleetfoot_recipe::{Aliases, Recipe};

use crate::{blocks::blocks, error::Error, view::seen_through};

/// Stretches of rows that are in use: each becomes an episode, with a name and an identity.
const MOST_RUNS: usize = 20_000;
/// The longer ones first: `<` begins `<=`.
const COMPARISONS: [(&str, Comparison); 6] = [
    ("<=", Comparison::AtMost),
    (">=", Comparison::AtLeast),
    ("==", Comparison::Equal),
    ("!=", Comparison::Other),
    ("<", Comparison::Below),
    (">", Comparison::Above),
];

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Comparison {
    Below,
    AtMost,
    Above,
    AtLeast,
    Equal,
    Other,
}

impl Comparison {
    /// Returns true if the comparison holds for a difference of its two sides. For a missing difference it does not
    /// hold.
    fn holds(self, difference: f64) -> bool {
        match self {
            Self::Below => difference < 0.0,
            Self::AtMost => difference <= 0.0,
            Self::Above => difference > 0.0,
            Self::AtLeast => difference >= 0.0,
            Self::Equal => difference == 0.0,
            Self::Other => difference.abs() > 0.0,
        }
    }
}

/// Runs of rows: an episode by number, and rows of it.
type Runs = Vec<(usize, Range<usize>)>;

/// Comparisons that must all hold of a row.
pub(crate) struct Condition {
    text: String,
    /// The left side minus the right one; with words, the left side alone, and the word.
    comparisons: Vec<(Expr, Comparison, Option<String>)>,
}

/// The recipe's condition for the rows in use; `None` if all rows are used.
pub(crate) fn stated(recipe: &Recipe) -> Option<&str> {
    recipe.time.only.as_deref().map(str::trim).filter(|text| *text != "all")
}

/// Refuses a condition beside a statistic, but that of its scan.
///
/// # Errors
/// Rows are needed: the rows of a statistic were chosen when it was scanned.
pub fn refuse_other_rows(recipe: &Recipe, scanned: &Recipe) -> Result<(), Error> {
    if recipe.time.only.is_none() || stated(recipe) == stated(scanned) {
        return Ok(());
    }
    let (wanted, there) = (stated(recipe).unwrap_or("all"), stated(scanned).unwrap_or("all"));
    Err(Error::needs_rows(format!(
        "{entry}: the statistic was scanned with another condition (where = \"{there}\"): scan the logs again, or fit them without a statistic",
        entry = TIME_SECTION.entry("where").is(format_args!("\"{wanted}\""))
    )))
}

impl Condition {
    /// Reads `where` of a recipe: comparisons between expressions over its columns and fields, joined by `and`. `None` where all rows are used.
    ///
    /// # Errors
    /// A text that is no comparison, with the syntax of one; unknown names.
    pub(crate) fn of(recipe: &Recipe, fields: &[Column]) -> Result<Option<Self>, Error> {
        let Some(text) = stated(recipe) else { return Ok(None) };
        let aliases = Aliases::of_recipe(recipe, fields)?;
        let mut comparisons = Vec::new();
        for part in joined_by_and(text) {
            let (sides, signs) = sides(part);
            if signs.is_empty() || sides.iter().any(|side| side.trim().is_empty()) {
                return Err(Error::value(format!(
                    "{entry}: `{}` is not a comparison; write, for example, where = \"armed > 0 and 2 < time() < 60\", or where = \"all\"",
                    part.trim(),
                    entry = TIME_SECTION.entry("where").is(format_args!("\"{text}\""))
                )));
            }
            for (pair, sign) in sides.windows(2).zip(signs) {
                comparisons.push(compared(pair[0].trim(), sign, pair[1].trim(), &aliases, text)?);
            }
        }
        Ok(Some(Self { text: text.to_owned(), comparisons }))
    }

    /// The entry of the recipe, for messages.
    fn entry(&self) -> Entry {
        TIME_SECTION.entry("where").is(format_args!("\"{}\"", self.text))
    }

    /// The fields that it reads.
    pub(crate) fn sources(&self) -> impl Iterator<Item = String> + '_ {
        self.comparisons.iter().flat_map(|(expression, ..)| expression.sources()).map(|name| name.to_string())
    }

    /// The runs of rows of which it holds, and what to say of them.
    ///
    /// # Errors
    /// Those of reading; a word that no row has; no row at all.
    pub(crate) fn runs(&self, source: &dyn Source, progress: &dyn Progress) -> Result<(Runs, String), Error> {
        let name = |at: usize| Column::float(format!("side {at}"));
        let columns: Vec<(Column, Expr)> =
            self.comparisons.iter().enumerate().map(|(at, (expression, ..))| (name(at), expression.clone())).collect();
        let codes = self.codes(source)?;
        let view = seen_through(Box::new(Watched::new(source, None)), &columns)?;
        let pieces = blocks(&view);
        let mut runs = Runs::new();
        progress.stage("rows in use");
        parallel_fold(
            pieces.len(),
            progress,
            |piece| {
                let (episode, rows) = pieces[piece].clone();
                let block = view.read(episode, rows.clone(), Halo::default())?;
                let holds = |row: usize| {
                    let mut compared = self.comparisons.iter().zip(&codes).enumerate();
                    compared.all(|(at, ((_, comparison, _), code))| comparison.holds(block.core(at)[row] - code))
                };
                Ok::<_, Error>((episode, rows.start, (0..rows.len()).map(holds).collect::<Vec<bool>>()))
            },
            |(episode, first, used)| {
                for (row, _) in used.iter().enumerate().filter(|(_, used)| **used) {
                    let row = first + row;
                    match runs.last_mut() {
                        Some((last, run)) if *last == episode && run.end == row => run.end = row + 1,
                        _ => runs.push((episode, row..row + 1)),
                    }
                }
                Ok(())
            },
        )?;
        let (used, all): (usize, usize) = (runs.iter().map(|(_, run)| run.len()).sum(), view.rows());
        if used == 0 {
            let problem = format!(
                "none of the {all} rows satisfies `{}`: change the condition ({TIME_SECTION} where, {WHERE})",
                self.text
            );
            return Err(Error::too_few_rows(0, 1, problem));
        }
        if runs.len() > MOST_RUNS {
            return Err(Error::value(format!(
                "{}: it holds in {} stretches of {:.1} rows on average, and each would be an episode: compare something smoother, as in lag1(v, 0.5)",
                self.entry(),
                runs.len(),
                used as f64 / runs.len() as f64
            )));
        }
        let stretches = if runs.len() == 1 { "one stretch".to_owned() } else { format!("{} stretches", runs.len()) };
        Ok((runs, format!("where {}: {used} of {all} rows, in {stretches}", self.text)))
    }

    /// The code of every word among the names of its column, 0 of numbers.
    fn codes(&self, source: &dyn Source) -> Result<Vec<f64>, Error> {
        let code = |(expression, _, word): &(Expr, Comparison, Option<String>)| {
            let Some(word) = word else {
                let text = |name: &std::sync::Arc<str>| {
                    let column = source.column_index(name).map(|at| &source.columns()[at].kind);
                    matches!(column, Some(ColumnKind::Category(_)))
                };
                return match expression.sources().into_iter().find(text) {
                    Some(name) => Err(Error::value(format!(
                        "{}: `{name}` has words and no numbers: compare it with one, as in {name} == 'auto'",
                        self.entry()
                    ))),
                    None => Ok(0.0),
                };
            };
            let column = expression.as_column().and_then(|name| source.column_index(name));
            let names = match column.map(|at| &source.columns()[at].kind) {
                Some(ColumnKind::Category(names)) => names,
                _ => {
                    return Err(Error::value(format!(
                        "{}: `{expression}` has numbers and no words: compare it with a number",
                        self.entry()
                    )));
                }
            };
            // A word that these logs do not have is equal to none of theirs.
            Ok(names.iter().position(|name| name == word).map_or(-1.0, |code| code as f64))
        };
        self.comparisons.iter().map(code).collect()
    }
}

/// One comparison: a difference, or a column and a word.
fn compared(
    left: &str,
    comparison: Comparison,
    right: &str,
    aliases: &Aliases<'_>,
    text: &str,
) -> Result<(Expr, Comparison, Option<String>), Error> {
    let place = TIME_SECTION.entry("where").is(format_args!("\"{text}\"")).to_string();
    let quoted = |side: &str| {
        let inner = |mark: char| side.strip_prefix(mark)?.strip_suffix(mark).map(str::to_owned);
        inner('\'').or_else(|| inner('"'))
    };
    if let Some(word) = quoted(right) {
        let column = aliases.parse(left, &place)?;
        if column.as_column().is_none() || !matches!(comparison, Comparison::Equal | Comparison::Other) {
            return Err(Error::value(format!("{place}: a word is compared with a column, by == or !=")));
        }
        return Ok((column, comparison, Some(word)));
    }
    let difference = aliases.parse(&format!("({left}) - ({right})"), &place)?;
    Ok((difference, comparison, None))
}

/// The places of a text that are outside of backticks, quotes and parentheses.
fn outside(text: &str) -> impl Iterator<Item = usize> + '_ {
    let (mut within, mut depth) = (None::<char>, 0_i32);
    text.char_indices().filter_map(move |(at, character)| {
        match (within, character) {
            (Some(mark), _) if mark == character => within = None,
            (Some(_), _) => {}
            (None, '`' | '\'' | '"') => within = Some(character),
            (None, '(') => depth += 1,
            (None, ')') => depth -= 1,
            (None, _) if depth == 0 => return Some(at),
            (None, _) => {}
        }
        None
    })
}

/// The parts between `and`, or `&&`.
fn joined_by_and(text: &str) -> Vec<&str> {
    let (mut parts, mut first) = (Vec::new(), 0);
    for at in outside(text) {
        let joins = [" and ", "&&"].into_iter().find(|word| text[at..].starts_with(word));
        if let (Some(word), true) = (joins, at >= first) {
            parts.push(&text[first..at]);
            first = at + word.len();
        }
    }
    parts.push(&text[first..]);
    parts
}

/// The sides of comparisons one after the other, and the comparisons between them.
fn sides(text: &str) -> (Vec<&str>, Vec<Comparison>) {
    let (mut sides, mut signs, mut first) = (Vec::new(), Vec::new(), 0);
    for at in outside(text) {
        let sign = COMPARISONS.into_iter().find(|(sign, _)| text[at..].starts_with(sign));
        if let (Some((sign, comparison)), true) = (sign, at >= first) {
            sides.push(&text[first..at]);
            signs.push(comparison);
            first = at + sign.len();
        }
    }
    sides.push(&text[first..]);
    (sides, signs)
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::{MemorySource, Silent};

    use super::*;

    fn source() -> MemorySource {
        let mode = ColumnKind::Category(vec!["auto".into(), "manual".into()]);
        let columns =
            vec![Column::float("t"), Column::float("v [m/s]"), Column { name: "mode".into(), unit: None, kind: mode }];
        let mut source = MemorySource::new(columns);
        let t: Vec<f64> = (0..10).map(f64::from).collect();
        let v = t.iter().map(|t| if *t == 4.0 { f64::NAN } else { t - 5.0 }).collect();
        source.push_uniform("a", 1.0, vec![t, v, (0..10).map(|row| f64::from(u8::from(row > 2))).collect()]);
        source.push_uniform("b", 1.0, vec![vec![3.0, 100.0], vec![1.0, 1.0], vec![0.0, f64::NAN]]);
        source
    }

    fn runs(text: &str) -> Result<Vec<(usize, Range<usize>)>, String> {
        let recipe =
            Recipe::parse(&format!("[columns]\nspeed = \"abs(`v [m/s]`)\"\n[time]\nwhere = '''{text}'''\n"), "r")
                .unwrap();
        let source = source();
        let condition = Condition::of(&recipe, source.columns()).map_err(|error| error.to_string())?.ok_or("all")?;
        Ok(condition.runs(&source, &Silent).map_err(|error| error.to_string())?.0)
    }

    #[test]
    fn rows_are_used_where_all_comparisons_hold() {
        assert_eq!(runs("t > 2 and t <= 6"), Ok(vec![(0, 3..7), (1, 0..1)]));
        assert_eq!(
            runs("2 < t <= 6 && speed >= 0"),
            Ok(vec![(0, 3..4), (0, 5..7), (1, 0..1)]),
            "a missing value is not used"
        );
        assert_eq!(runs("speed != 5"), Ok(vec![(0, 1..4), (0, 5..10), (1, 0..2)]));
        assert_eq!(runs("max(t, time()) == 3"), Ok(vec![(0, 3..4), (1, 0..1)]));
        assert_eq!(runs("`v [m/s]` > 3"), Ok(vec![(0, 9..10)]));
        assert_eq!(runs("mode == 'auto'"), Ok(vec![(0, 0..3), (1, 0..1)]));
        assert_eq!(runs("mode != \"auto\" and t < 5"), Ok(vec![(0, 3..5)]));
        assert_eq!(runs("lag(t, 1) >= 8"), Ok(vec![(0, 9..10)]), "the row before an episode is missing");
        assert_eq!(runs("lag1(t, 1e-9) > 7"), Ok(vec![(0, 9..10)]));
        assert_eq!(runs(" all "), Err("all".into()));
    }

    #[test]
    fn invalid_conditions_are_refused() {
        for (text, words) in [
            ("t", "`t` is not a comparison"),
            ("t > ", "is not a comparison"),
            ("tt > 3", "did you mean `t`"),
            ("t == 'auto'", "has numbers and no words"),
            ("mode > 'auto'", "by == or !="),
            ("mode > 0", "has words and no numbers"),
            ("t > 1e9", "none of the 12 rows satisfies"),
            ("mode == 'automatic'", "none of the 12 rows satisfies"),
        ] {
            let error = runs(text).unwrap_err();
            assert!(error.contains(words), "{text}: {error}");
        }
    }
}
