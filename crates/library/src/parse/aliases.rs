//! A recipe's aliases: names for expressions that may use each other.

use std::collections::BTreeMap;

use super::is_bare_name;
use crate::{Expr, ParseError, ParseErrorKind, Scope, scope::SEPARATORS};

impl Scope {
    /// Reads a recipe's aliases, `(name, text)` in any order; they may use each other.
    ///
    /// A text that is a column's whole name is that column, whatever characters it has. A text that is the common beginning
    /// of vector fields (`/imu.orientation`, for `/imu.orientation.x` and so on) names the vector or the quaternion. In
    /// its own text an alias is the column of that name.
    ///
    /// # Errors
    /// A text that does not parse, with the alias named; aliases that need each other in a circle. The scope stays as it was.
    pub fn define_all<N: AsRef<str>, T: AsRef<str>>(
        &mut self,
        aliases: impl IntoIterator<Item = (N, T)>,
    ) -> Result<(), ParseError> {
        let texts: BTreeMap<String, String> =
            aliases.into_iter().map(|(name, text)| (name.as_ref().to_owned(), text.as_ref().to_owned())).collect();
        let mut scope = self.clone();
        scope.pending = texts.keys().cloned().collect();
        for name in texts.keys() {
            let mut stack = vec![name.clone()];
            while let Some(name) = stack.last().cloned() {
                if !scope.pending.contains(&name) {
                    stack.pop();
                    continue;
                }
                scope.defining = Some(name.clone());
                match scope.define_text(&name, &texts[&name]) {
                    Ok(()) => {
                        scope.pending.remove(&name);
                    }
                    // Not read yet: that one first.
                    Err(error) => match error.kind() {
                        ParseErrorKind::Circular { name: other } if !stack.contains(other) => stack.push(other.clone()),
                        _ => return Err(error.in_alias(name)),
                    },
                }
            }
        }
        scope.defining = None;
        *self = scope;
        Ok(())
    }

    fn define_text(&mut self, name: &str, text: &str) -> Result<(), ParseError> {
        let whole = text.trim();
        if self.columns.contains(whole) {
            self.define(name, Expr::column(whole));
        } else if is_bare_name(whole)
            && !self.open
            && !self.aliases.contains_key(whole)
            && !self.pending.contains(whole)
            && SEPARATORS.iter().any(|separator| self.columns.contains(format!("{whole}{separator}x").as_str()))
        {
            self.aliases.remove(name);
            self.groups.insert(name.to_owned(), whole.to_owned());
        } else {
            let expr = Expr::parse(text, self)?;
            self.define(name, expr);
        }
        Ok(())
    }
}
