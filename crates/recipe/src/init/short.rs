//! Short names for long fields.

use std::collections::BTreeMap;

use fleetfoot_data::Column;

/// For each field the shortest end of its name that no other field shares, as one word.
pub(super) fn short_names(fields: &[&Column]) -> Vec<String> {
    let parts: Vec<Vec<&str>> = fields
        .iter()
        .map(|field| field.name.split(['/', '.', '[', ']']).filter(|part| !part.is_empty()).collect())
        .collect();
    let word = |parts: &[&str], count: usize| {
        let joined = parts[parts.len().saturating_sub(count)..].join("_");
        joined.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect::<String>()
    };
    let mut names: Vec<String> = vec![String::new(); fields.len()];
    for count in 1..=parts.iter().map(Vec::len).max().unwrap_or(0) {
        let mut uses: BTreeMap<String, usize> = BTreeMap::new();
        parts.iter().for_each(|parts| *uses.entry(word(parts, count)).or_default() += 1);
        for (name, parts) in names.iter_mut().zip(&parts).filter(|(name, _)| name.is_empty()) {
            let candidate = word(parts, count);
            // A letter alone says too little, and is what an odometry's states are called.
            if (uses[&candidate] == 1 && candidate.len() > 1) || count >= parts.len() {
                *name = candidate;
            }
        }
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn short_names_are_the_shortest_that_differ() {
        let columns = ["/a.linear.x", "/a.angular.x", "/b.position[left]"].map(Column::float);
        assert_eq!(short_names(&columns.iter().collect::<Vec<_>>()), ["linear_x", "angular_x", "left"]);
    }
}
