//! Names of fields inside a message.

use std::{fmt, str::FromStr, sync::Arc};

/// A way from a message to one of its numbers.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct FieldPath {
    /// From the outside in.
    pub steps: Vec<Step>,
}

/// One step of a [`FieldPath`].
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Step {
    /// A field of a struct: `.name`.
    Field(Arc<str>),
    /// An element by its place: `[4]`.
    Index(usize),
    /// An element by its name: `[left_crank]`.
    Key(String),
}

/// A text that is no path.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is not a field: {problem}")]
pub struct PathError {
    /// The text.
    pub text: String,
    /// Description of the problem.
    pub problem: &'static str,
}

impl FromStr for FieldPath {
    type Err = PathError;

    /// Reads `a.b[4].c[left]`. What stands in brackets is a place when it is all digits, else a name, which goes on to the next `]`.
    fn from_str(text: &str) -> Result<Self, PathError> {
        let error = |problem| PathError { text: text.to_owned(), problem };
        let mut steps = Vec::new();
        let mut rest = text;
        while !rest.is_empty() {
            if let Some(inside) = rest.strip_prefix('[') {
                let (name, after) = inside.split_once(']').ok_or_else(|| error("a bracket is not closed"))?;
                if name.is_empty() {
                    return Err(error("nothing stands in the brackets"));
                }
                let place = name.bytes().all(|byte| byte.is_ascii_digit()).then(|| name.parse().ok()).flatten();
                steps.push(place.map_or_else(|| Step::Key(name.to_owned()), Step::Index));
                rest = after;
            } else {
                let word = if steps.is_empty() {
                    rest
                } else {
                    rest.strip_prefix('.').ok_or_else(|| error("a dot is missing"))?
                };
                let end = word.find(['.', '[', ']']).unwrap_or(word.len());
                if end == 0 {
                    return Err(error("a name is missing"));
                }
                steps.push(Step::Field(Arc::from(&word[..end])));
                rest = &word[end..];
            }
        }
        if steps.is_empty() { Err(error("it is empty")) } else { Ok(Self { steps }) }
    }
}

impl fmt::Display for FieldPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, step) in self.steps.iter().enumerate() {
            match step {
                Step::Field(name) if place == 0 => write!(f, "{name}")?,
                Step::Field(name) => write!(f, ".{name}")?,
                Step::Index(index) => write!(f, "[{index}]")?,
                Step::Key(key) => write!(f, "[{key}]")?,
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_read_and_written() {
        for text in ["twist.linear.x", "covariance[4]", "transforms[base.link/0].transform.rotation.w", "a[1][2].b"] {
            assert_eq!(text.parse::<FieldPath>().unwrap().to_string(), text);
        }
        let path: FieldPath = "position[left]".parse().unwrap();
        assert_eq!(path.steps, [Step::Field("position".into()), Step::Key("left".into())]);
        for text in ["", ".", "a..b", "a[", "a[]", "a]", "a[1]b", "[1", "a."] {
            assert!(text.parse::<FieldPath>().is_err(), "{text}");
        }
    }
}
