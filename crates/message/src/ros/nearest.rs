//! The name that is spelled most like another.

/// The nearest of `names` by edit distance, unless all are further than half of `name`.
pub(super) fn nearest<'a>(name: &str, names: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    // A schema decides how long its names are; the distance takes the product of two lengths.
    const LONGEST: usize = 128;
    let fits = |name: &str| name.len() <= LONGEST;
    let candidates = names.filter(|other| fits(other) && fits(name)).map(|other| (distance(name, other), other));
    candidates.min().filter(|(distance, _)| *distance <= name.len().div_ceil(2)).map(|(_, other)| other)
}

/// The Levenshtein distance of two texts in bytes, one row of the table at a time.
fn distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.bytes().enumerate() {
        let mut diagonal = i;
        let mut left = i + 1;
        for (cell, y) in row.iter_mut().skip(1).zip(b.bytes()) {
            let best = (*cell + 1).min(left + 1).min(diagonal + usize::from(!x.eq_ignore_ascii_case(&y)));
            diagonal = std::mem::replace(cell, best);
            left = best;
        }
        if let Some(first) = row.first_mut() {
            *first = i + 1;
        }
    }
    row.last().copied().unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn misspelled_names_are_recognised() {
        assert_eq!(distance("kitten", "sitting"), 3);
        assert_eq!(distance("", "abc"), 3);
        let names = ["position", "orientation", "header"];
        assert_eq!(nearest("positon", names.into_iter()), Some("position"));
        assert_eq!(nearest("Header", names.into_iter()), Some("header"));
        assert_eq!(nearest("zzz", names.into_iter()), None);
    }
}
