//! Rotations among the columns of a model: groups of columns that are one rotation together.

use crate::{Column, Model, RotationKind, RotationPart};

/// A rotation among columns.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rotation {
    /// Its name.
    pub name: String,
    /// Representation of the rotation.
    pub kind: RotationKind,
    /// Index of each part among the columns, in the order of [`RotationKind::letters`].
    pub columns: Vec<usize>,
}

/// The rotations among some columns, in the order of their first columns; groups of which a part is missing are left out.
pub fn rotations<'a>(columns: impl IntoIterator<Item = &'a Column>) -> Vec<Rotation> {
    let mut rotations: Vec<Rotation> = Vec::new();
    for (index, column) in columns.into_iter().enumerate() {
        let Some(RotationPart { group, kind, part }) = &column.rotation else { continue };
        let at = rotations.iter().position(|known| known.name == *group).unwrap_or_else(|| {
            rotations.push(Rotation { name: group.clone(), kind: *kind, columns: vec![usize::MAX; kind.parts()] });
            rotations.len() - 1
        });
        if let Some(place) = rotations[at].columns.get_mut(*part) {
            *place = index;
        }
    }
    rotations.retain(|rotation| !rotation.columns.contains(&usize::MAX));
    rotations
}

impl Model {
    /// The rotations among its columns.
    pub fn rotations(&self) -> Vec<Rotation> {
        rotations(&self.columns)
    }

    /// Those whose parts are all among some of its columns, with the places of the parts there.
    pub fn rotations_among<N: AsRef<str>>(&self, names: &[N]) -> Vec<(RotationKind, Vec<usize>)> {
        let place = |&column: &usize| names.iter().position(|name| *name.as_ref() == *self.columns[column].name);
        let of =
            |rotation: Rotation| Some((rotation.kind, rotation.columns.iter().map(place).collect::<Option<Vec<_>>>()?));
        self.rotations().into_iter().filter_map(of).collect()
    }
}
