//! Lists of columns with numbers, as settings say them.

use fleetfoot_fit::Error;

/// `a, b`.
pub(super) fn names(text: &str) -> Vec<String> {
    fleetfoot_recipe::items(text).iter().map(|name| plain(name)).collect()
}

fn plain(name: &str) -> String {
    name.trim().trim_matches('`').to_owned()
}

/// A column and the text behind the last `=`.
fn pairs(entry: &str, text: &str, example: &str) -> Result<Vec<(String, String)>, Error> {
    let pair = |item: &String| {
        let (name, value) = item.rsplit_once('=').ok_or_else(|| {
            Error::value(format!("{entry} = \"{text}\": `{}` has no value; write {entry} = \"{example}\"", item.trim()))
        })?;
        Ok((plain(name), value.trim().to_owned()))
    };
    fleetfoot_recipe::items(text).iter().map(pair).collect()
}

/// `V=0.5,alpha=0.01`.
pub(super) fn values(text: &str) -> Result<Vec<(String, f64)>, Error> {
    let number = |(name, value): (String, String)| match value.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok((name, value)),
        _ => Err(Error::value(format!(
            "deviations: `{name}` may be off by {value}, which is no positive number; write for example deviations = \"V=0.5,alpha=0.01\""
        ))),
    };
    pairs("deviations", text, "V=0.5,alpha=0.01")?.into_iter().map(number).collect()
}

/// `N1=0.2..1,alpha=-0.1..0.3`; an end that is left away is open.
pub(super) fn bounds(text: &str) -> Result<Vec<(String, [f64; 2])>, Error> {
    let range = |(name, value): (String, String)| {
        let end = |text: &str, open: f64| if text.is_empty() { Some(open) } else { text.parse::<f64>().ok() };
        let ends = value.split_once("..").map(|(low, high)| (low.trim(), high.trim()));
        let ends = ends.and_then(|(low, high)| Some([end(low, f64::NEG_INFINITY)?, end(high, f64::INFINITY)?]));
        match ends {
            Some([low, high]) if low < high => Ok((name, [low, high])),
            _ => Err(Error::value(format!(
                "bounds: `{name}` lies in {value}, which is no range; write for example bounds = \"N1=0.2..1,alpha=-0.1..0.3\""
            ))),
        }
    };
    pairs("bounds", text, "N1=0.2..1,alpha=-0.1..0.3")?.into_iter().map(range).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_are_read_and_typing_errors_are_refused() {
        assert_eq!(values("V=0.5, `a,b`=1e-2").unwrap(), [("V".to_owned(), 0.5), ("a,b".to_owned(), 0.01)]);
        let open = bounds("N1=0.2..1,alpha=-.1..").unwrap();
        assert_eq!(open, [("N1".to_owned(), [0.2, 1.0]), ("alpha".to_owned(), [-0.1, f64::INFINITY])]);
        for slip in ["V", "V=0..x", "V=2..1", "V=1"] {
            assert!(bounds(slip).unwrap_err().to_string().starts_with("bounds"), "{slip}");
        }
        assert!(values("V=-1").is_err() && values("V").is_err());
        assert_eq!(names("u, `w`"), ["u", "w"]);
    }
}
