//! Columns of a file by their names: one step each, however many there are.

use std::{collections::HashMap, path::Path};

use fleetfoot_data::nearest_one;

use crate::Error;

/// The places of columns by their names.
pub(crate) struct ByName<'a> {
    /// The first column of a name, and how many columns have it.
    places: HashMap<&'a str, (usize, usize)>,
}

impl<'a> ByName<'a> {
    /// Columns in their order.
    pub(crate) fn new(names: impl IntoIterator<Item = &'a str>) -> Self {
        let mut places = HashMap::new();
        for (place, name) in names.into_iter().enumerate() {
            places.entry(name).or_insert((place, 0)).1 += 1;
        }
        Self { places }
    }

    /// The place of a column of the file `path`.
    ///
    /// # Errors
    /// No column, or several columns, of this name.
    pub(crate) fn find(&self, path: &Path, name: &str) -> Result<usize, Error> {
        match self.places.get(name) {
            Some(&(place, 1)) => Ok(place),
            Some(&(_, count)) => Err(Error::AmbiguousColumn { path: path.into(), column: name.into(), count }),
            None => {
                let mut names: Vec<(usize, &str)> =
                    self.places.iter().map(|(&name, &(place, _))| (place, name)).collect();
                names.sort_unstable();
                let nearest = nearest_one(name, names.into_iter().map(|(_, name)| name));
                Err(Error::MissingColumn { path: path.into(), column: name.into(), nearest })
            }
        }
    }
}
