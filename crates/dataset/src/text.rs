//! Refusal of text as numbers: the codes of a column of words serve labels and conditions alone.

use fleetfoot_data::setting::{EPISODES, PARTITION, WHERE};

use std::{collections::BTreeSet, sync::Arc};

use fleetfoot_data::{Column, ColumnKind, Halo, Source};
use fleetfoot_library::Expr;
use fleetfoot_log::Recording;
use fleetfoot_model::{Column as ModelColumn, Role};

use crate::{blocks::blocks, error::Error, labels::Labelled};

/// Refuses the text columns of `source` that states, inputs, the aliases in `numbers` or any formula would read as numbers.
///
/// # Errors
/// [`Error::TextAsNumber`]; those of reading the rows up to the value that it shows.
pub(crate) fn refuse_text(
    source: &Labelled<Recording>,
    (model, aliases): (&[ModelColumn], &[(Column, Expr)]),
    numbers: &BTreeSet<Arc<str>>,
) -> Result<(), Error> {
    for (column, (alias, expression)) in model.iter().zip(aliases) {
        let is_number =
            column.role != Role::Auxiliary || expression.as_column().is_none() || numbers.contains(alias.name.as_str());
        let Some((field, names)) = text_among(expression, source).filter(|_| is_number) else { continue };
        let use_ = match column.role {
            Role::State => "the state",
            Role::Input => "the input",
            Role::Auxiliary => "the column",
        };
        let what = if alias.name == *field {
            format!("{use_} `{field}`")
        } else {
            format!("{use_} `{}` reads `{field}`, which", alias.name)
        };
        if source.inner().column_index(&field).is_none() {
            return Err(Error::value(format!(
                "{what} is a label of {EPISODES}, and labels are text: tell episodes apart by it ({given_partition}, {given_where}), or write a column of numbers into the logs",
                given_partition = PARTITION.to(format_args!("labels:{field}")),
                given_where = WHERE.to(format_args!("{field} == '...'"))
            )));
        }
        let first = first_word(source, &field, names)?;
        let path = source.inner().origin(first.as_ref().map_or(0, |first| first.episode)).to_path_buf();
        let (place, value) = match &first {
            Some(first) => (format!(" in row {}", first.row + 1), first.word.as_str()),
            None => (String::new(), ""),
        };
        return Err(Error::TextAsNumber {
            path,
            what,
            first: format!("\"{value}\"{place}"),
            mend: mend(&field, value, names),
        });
    }
    Ok(())
}

/// The first field of an expression that holds text, and its words.
pub fn text_among<'s>(expression: &Expr, source: &'s dyn Source) -> Option<(Arc<str>, &'s [String])> {
    expression.sources().into_iter().find_map(|field| match &source.columns()[source.column_index(&field)?].kind {
        ColumnKind::Category(names) => Some((field, names.as_slice())),
        _ => None,
    })
}

/// A value and where it stands.
struct Word {
    episode: usize,
    row: usize,
    word: String,
}

/// The first value that is no number, else the first one: a column of numbers may have one word.
fn first_word(source: &dyn Source, field: &str, names: &[String]) -> Result<Option<Word>, Error> {
    let Some(column) = source.column_index(field) else { return Ok(None) };
    let is_word: Vec<bool> = names.iter().map(|name| name.trim().parse::<f64>().is_err()).collect();
    let any = is_word.contains(&true);
    for (episode, rows) in blocks(source) {
        let block = source.read(episode, rows.clone(), Halo::default())?;
        let shown = |code: f64| code >= 0.0 && is_word.get(code as usize).is_some_and(|word| *word || !any);
        if let Some(at) = block.core(column).iter().position(|&code| shown(code)) {
            let word = names[block.core(column)[at] as usize].clone();
            return Ok(Some(Word { episode, row: rows.start + at, word }));
        }
    }
    Ok(None)
}

/// Remedy for a text column with this value, and with these words in all.
fn mend(field: &str, value: &str, words: &[String]) -> String {
    let value = value.trim();
    let has_numbers = words.iter().any(|word| word.trim().parse::<f64>().is_ok());
    if value.is_empty() {
        return "leave the column out".to_owned();
    }
    if value.parse::<f64>().is_ok() {
        return "these are numbers stored as text: store them as numbers (in pandas: pd.to_numeric)".to_owned();
    }
    let digits = value.trim_start_matches(['+', '-']);
    let is_grouped = digits.starts_with(|first: char| first.is_ascii_digit())
        && digits
            .chars()
            .all(|one| one.is_ascii_digit() || matches!(one, '.' | ',' | '\'' | ' ' | '\u{a0}' | '\u{202f}' | '_'));
    if is_grouped {
        return format!("write numbers with a decimal point and without thousands separators, as in {}", plain(value));
    }
    let number = digits.find(|one: char| !matches!(one, '0'..='9' | '.')).unwrap_or(0);
    if number > 0 && digits[..number].parse::<f64>().is_ok() {
        return format!(
            "write the number alone, and its unit in the column's name: `{field} [{}]`",
            digits[number..].trim()
        );
    }
    if has_numbers || !value.contains(char::is_alphanumeric) {
        return "where a value is missing, leave the cell empty or write nan".to_owned();
    }
    let name = if field.chars().all(|one| one.is_alphanumeric() || one == '_') {
        field.to_owned()
    } else {
        format!("`{field}`")
    };
    format!(
        "use it as a label ({}) or in a condition ({}), or leave it out of the states, inputs and \
         formulas",
        PARTITION.to(format_args!("labels:{field}")),
        WHERE.to(format_args!("{name} == '{value}'"))
    )
}

/// A number in groups, by its last separator a decimal one: `1.000,00` is 1000.00.
fn plain(value: &str) -> String {
    let separators = [',', '.'].into_iter().filter_map(|mark| value.rfind(mark)).collect::<Vec<_>>();
    // One kind of mark that stands several times separates thousands alone.
    let decimal = match separators.as_slice() {
        [only] if value.matches(&value[*only..=*only]).count() > 1 => None,
        marks => marks.iter().max().copied(),
    };
    let kept = value.char_indices().filter_map(|(at, one)| match one {
        _ if Some(at) == decimal => Some('.'),
        '0'..='9' | '+' | '-' => Some(one),
        _ => None,
    });
    kept.collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_text_has_its_mend() {
        let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<_>>();
        for (value, all, part) in [
            ("1.000,00", &["1.000,00", "12,5"][..], "as in 1000.00"),
            ("-1,234.5", &["-1,234.5"], "as in -1234.5"),
            ("1.234.567", &["1.234.567"], "as in 1234567"),
            ("12,5", &["12,5"], "as in 12.5"),
            ("3.5", &["3.5"], "pd.to_numeric"),
            ("12.5 kg", &["12.5 kg"], "`mode [kg]`"),
            ("-", &["-", "3.5"], "write nan"),
            ("bad", &["bad", "3.5"], "write nan"),
            ("auto", &["auto", "manual"], "--where \"mode == 'auto'\""),
            ("", &[], "leave the column out"),
        ] {
            let advice = mend("mode", value, &words(all));
            assert!(advice.contains(part), "{value}: {advice}");
        }
    }
}
