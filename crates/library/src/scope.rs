//! Scopes: the names that an expression's text may use, and their meanings.

use std::{
    collections::{BTreeMap, BTreeSet},
    sync::Arc,
};

use fleetfoot_data::nearest;

use crate::{Expr, ParseErrorKind, Quaternion};

/// The names that stand for something: the columns of a recording and the aliases of a recipe.
///
/// An alias hides a column of the same name. Text that a program wrote (a printed expression) is therefore read in a scope
/// without aliases.
#[derive(Debug, Clone, Default)]
pub struct Scope {
    /// Every name is a column.
    pub(crate) open: bool,
    /// The text is a filter's name, in which inner filters already stand as their columns are called.
    of_name: bool,
    pub(crate) columns: BTreeSet<Arc<str>>,
    pub(crate) aliases: BTreeMap<String, Expr>,
    /// Aliases of the common beginning of a vector's or a quaternion's fields.
    pub(crate) groups: BTreeMap<String, String>,
    /// Names of rotations whose columns need not be called like them.
    pub(crate) rotations: BTreeMap<String, Quaternion>,
    /// Aliases whose text has not been read yet, while they are defined together.
    pub(crate) pending: BTreeSet<String>,
    /// The alias whose text is being read: in it, its own name is a column.
    pub(crate) defining: Option<String>,
}

/// Separators between a vector's name and its component's.
pub(crate) const SEPARATORS: [&str; 3] = [".", "_", ""];

impl Scope {
    /// A recording's columns, no aliases.
    pub fn new<N: AsRef<str>>(columns: impl IntoIterator<Item = N>) -> Self {
        Self { columns: columns.into_iter().map(|name| Arc::from(name.as_ref())).collect(), ..Self::default() }
    }

    /// Takes every name for a column: for text whose recording is not at hand, such as a model's.
    pub fn open() -> Self {
        Self { open: true, ..Self::default() }
    }

    /// For the text of a filter's name.
    pub(crate) fn of_name() -> Self {
        Self { of_name: true, ..Self::open() }
    }

    pub(crate) fn is_of_name(&self) -> bool {
        self.of_name
    }

    /// Gives an expression a name.
    pub fn define(&mut self, name: impl Into<String>, expr: Expr) {
        let name = name.into();
        self.groups.remove(&name);
        self.aliases.insert(name, expr);
    }

    /// Gives a rotation a name, by which `rotate(name, v)`, `yaw(name)` and the like speak of it.
    pub fn define_rotation(&mut self, name: impl Into<String>, rotation: Quaternion) {
        self.rotations.insert(name.into(), rotation);
    }

    /// Expression that a name stands for.
    ///
    /// # Errors
    /// [`ParseErrorKind::UnknownName`] with the nearest names.
    pub fn resolve(&self, name: &str) -> Result<Expr, ParseErrorKind> {
        match self.find(name)? {
            Some(expr) => Ok(expr),
            None => Err(ParseErrorKind::UnknownName { name: name.to_owned(), nearest: nearest(name, self.names()) }),
        }
    }

    /// The components of a vector, by the common beginning of their names: `v.x`, `v_x` or `vx`.
    pub(crate) fn components<const N: usize>(
        &self,
        prefix: &str,
        letters: [&str; N],
    ) -> Result<[Expr; N], ParseErrorKind> {
        self.check_pending(prefix)?;
        let prefix = self.groups.get(prefix).map_or(prefix, String::as_str);
        for separator in SEPARATORS {
            let mut components = Vec::with_capacity(N);
            for letter in letters {
                let Some(expr) = self.find(&format!("{prefix}{separator}{letter}"))? else {
                    break;
                };
                components.push(expr);
            }
            if let Ok(components) = components.try_into() {
                return Ok(components);
            }
        }
        Err(ParseErrorKind::NoComponents {
            prefix: prefix.to_owned(),
            components: letters.join(", "),
            nearest: nearest(&format!("{prefix}.x"), self.names()),
        })
    }

    fn find(&self, name: &str) -> Result<Option<Expr>, ParseErrorKind> {
        if self.defining.as_deref() != Some(name) {
            self.check_pending(name)?;
            if let Some(expr) = self.aliases.get(name) {
                return Ok(Some(expr.clone()));
            }
        }
        if self.open || self.columns.contains(name) {
            return Ok(Some(Expr::column(name)));
        }
        // A field of an alias that names a vector.
        let Some((head, field)) = name.rsplit_once('.') else {
            return Ok(None);
        };
        if self.defining.as_deref() != Some(head) {
            self.check_pending(head)?;
        }
        Ok(self.groups.get(head).and_then(|prefix| {
            let mut candidates = SEPARATORS.iter().map(|separator| format!("{prefix}{separator}{field}"));
            candidates.find(|candidate| self.columns.contains(candidate.as_str())).map(Expr::column)
        }))
    }

    fn check_pending(&self, name: &str) -> Result<(), ParseErrorKind> {
        if self.defining.as_deref() != Some(name) && self.pending.contains(name) {
            return Err(ParseErrorKind::Circular { name: name.to_owned() });
        }
        Ok(())
    }

    /// All names, aliases first.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let aliases = self.aliases.keys().chain(self.groups.keys()).map(String::as_str);
        aliases.chain(self.columns.iter().map(|name| &**name))
    }
}
