//! Names that a misspelt one may have meant.

/// Longer names are not compared: the distance takes quadratic time, and a file decides how long its names are.
const LONGEST: usize = 128;

/// Up to three of `candidates` that resemble `name`, the most alike first.
///
/// Alike is a Damerau-Levenshtein similarity of one half or more, or equality without case, or one that ends with the other.
pub fn nearest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let wanted = name.to_lowercase();
    if wanted.is_empty() || wanted.len() > LONGEST {
        return Vec::new();
    }
    let mut alike: Vec<(f64, &str)> = candidates
        .into_iter()
        .filter(|candidate| !candidate.is_empty() && candidate.len() <= LONGEST)
        .map(|candidate| (similarity(&wanted, &candidate.to_lowercase()), candidate))
        .filter(|&(similarity, _)| similarity >= 0.5)
        .collect();
    alike.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(b.1)));
    alike.dedup_by(|a, b| a.1 == b.1);
    alike.into_iter().take(3).map(|(_, candidate)| candidate.to_owned()).collect()
}

/// The one of `candidates` that resembles `name` most, by the rule of [`nearest`].
pub fn nearest_one<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<String> {
    nearest(name, candidates).into_iter().next()
}

/// Suggestion of such names in a message: "; did you mean `a`, `b`?". Empty without names.
pub fn did_you_mean(names: &[String]) -> String {
    if names.is_empty() { String::new() } else { format!("; did you mean `{}`?", names.join("`, `")) }
}

fn similarity(wanted: &str, candidate: &str) -> f64 {
    let edit = strsim::normalized_damerau_levenshtein(wanted, candidate);
    // A field's last part is what people remember of it.
    let tail =
        (wanted.len() > 1 && candidate.ends_with(wanted)) || (candidate.len() > 1 && wanted.ends_with(candidate));
    if tail { edit.max(0.75) } else { edit }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_of_messages_are_recognised() {
        let fields = ["position", "orientation", "header"];
        assert_eq!(nearest_one("positon", fields).as_deref(), Some("position"));
        assert_eq!(nearest_one("Header", fields).as_deref(), Some("header"));
        assert_eq!(nearest_one("zzz", fields), None);
        assert_eq!(did_you_mean(&nearest("hedder", fields)), "; did you mean `header`?");
        assert_eq!(did_you_mean(&[]), "");
    }

    #[test]
    fn only_close_names_are_suggested() {
        let columns = ["vx", "vy", "Yaw", "motor_current", "/odom.twist.linear.x"];
        assert_eq!(nearest("yaw", columns), ["Yaw"]);
        assert_eq!(nearest("motor_curent", columns), ["motor_current"]);
        assert_eq!(nearest("linear.x", columns), ["/odom.twist.linear.x"]);
        assert_eq!(nearest_one("motor_curent", columns).as_deref(), Some("motor_current"));
        assert!(nearest("temperature", columns).is_empty());
        assert!(nearest(&"a".repeat(1_000_000), columns).is_empty());
    }
}
