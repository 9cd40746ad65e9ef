//! Recorded rotations as models read them: of unit length, and written in one way.

use fleetfoot_data::setting::WHERE;

use std::{ops::Range, path::PathBuf};

use fleetfoot_data::{Block, Column, Episode, Error as DataError, Halo, ScalarBuffer, Source};
use fleetfoot_library::{Expr, View};
use fleetfoot_log::Recording;
use fleetfoot_model::{Column as ModelColumn, RotationKind, rotations};

use crate::labels::Labelled;

/// Largest deviation of a recorded quaternion's length from 1: larger than rounding to single precision or to
/// thousandths, smaller than for four unrelated numbers.
const TOLERANCE: f64 = 0.01;

/// A recorded quaternion that is no rotation.
#[derive(Debug, thiserror::Error)]
#[error(
    "{}: row {} of {episode}: the quaternion {rotation} is ({}), of length {length:.4} instead of 1; look for a wrong column or unit, or leave such rows out: {}",
    file.display(), row + 1, parts.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "), WHERE.to(condition)
)]
pub struct NoRotation {
    /// The file.
    pub file: PathBuf,
    /// The episode's name.
    pub episode: String,
    /// The row of the episode, from 0.
    pub row: usize,
    /// The rotation's name.
    pub rotation: String,
    /// Recorded components w, x, y, z.
    pub parts: Vec<f64>,
    /// Its length.
    pub length: f64,
    /// A condition that holds of rotations alone.
    pub condition: String,
}

/// A rotation among the columns of a dataset.
#[derive(Debug, Clone)]
pub(crate) struct Recorded {
    name: String,
    kind: RotationKind,
    /// The names of its parts.
    parts: Vec<String>,
}

impl Recorded {
    /// Those among a model's columns.
    pub(crate) fn among(columns: &[ModelColumn]) -> Vec<Self> {
        let of = |rotation: fleetfoot_model::Rotation| Self {
            name: rotation.name,
            kind: rotation.kind,
            parts: rotation.columns.iter().map(|&column| columns[column].name.clone()).collect(),
        };
        rotations(columns).into_iter().map(of).collect()
    }
}

/// The columns of a dataset as a [`View`] shows them, with rotations of unit length. A row where a part is missing
/// misses all.
pub struct UnitRotations<'a> {
    pub(crate) view: View<'a>,
    source: &'a Labelled<Recording>,
    /// Expressions that make the columns.
    aliases: &'a [(Column, Expr)],
    /// The rotation, and the place of every part among the columns.
    rotations: Vec<(&'a Recorded, Vec<usize>)>,
}

impl<'a> UnitRotations<'a> {
    pub(crate) fn new(
        view: View<'a>,
        rotations: &'a [Recorded],
        source: &'a Labelled<Recording>,
        aliases: &'a [(Column, Expr)],
    ) -> Self {
        let place = |name: &String| view.columns().iter().position(|column| column.name == *name);
        let rotations = rotations.iter().filter_map(|recorded| {
            let places = recorded.parts.iter().map(place).collect::<Option<Vec<_>>>()?;
            Some((recorded, places))
        });
        let rotations = rotations.collect();
        Self { view, source, aliases, rotations }
    }

    /// Settles a rotation in a block.
    fn settle(
        &self,
        recorded: &Recorded,
        places: &[usize],
        episode: usize,
        block: &mut Block,
    ) -> Result<(), DataError> {
        let mut columns: Vec<Vec<f64>> = places.iter().map(|&place| block.columns[place].to_vec()).collect();
        let mut parts = vec![0.0; places.len()];
        for row in 0..block.time.len() {
            parts.iter_mut().zip(&columns).for_each(|(part, column)| *part = column[row]);
            let length = parts.iter().map(|part| part * part).sum::<f64>().sqrt();
            if recorded.kind == RotationKind::Quaternion && (length - 1.0).abs() > TOLERANCE {
                return Err(self.refusal(recorded, (episode, block.first + row - block.before), (parts, length)));
            }
            if length.is_nan() {
                columns.iter_mut().for_each(|column| column[row] = f64::NAN);
                continue;
            }
            recorded.kind.settle(&mut parts);
            columns.iter_mut().zip(&parts).for_each(|(column, part)| column[row] = *part);
        }
        for (&place, column) in places.iter().zip(columns) {
            block.columns[place] = ScalarBuffer::from(column);
        }
        Ok(())
    }

    /// The rotations among the columns: how they are written, and the place of every part.
    pub fn rotations(&self) -> impl Iterator<Item = (RotationKind, &[usize])> {
        self.rotations.iter().map(|(recorded, places)| (recorded.kind, places.as_slice()))
    }

    /// Writes every rotation of a block as near as it can be to the one in the row before, so that curves go through its parts.
    pub fn turn_on(&self, block: &mut Block) {
        for (kind, places) in self.rotations() {
            let mut columns: Vec<Vec<f64>> = places.iter().map(|&place| block.columns[place].to_vec()).collect();
            kind.turn_on(&mut columns);
            for (&place, column) in places.iter().zip(columns) {
                block.columns[place] = ScalarBuffer::from(column);
            }
        }
    }

    fn refusal(
        &self,
        recorded: &Recorded,
        (episode, row): (usize, usize),
        (parts, length): (Vec<f64>, f64),
    ) -> DataError {
        let source = |name: &String| {
            let alias = self.aliases.iter().find(|(column, _)| column.name == *name);
            alias.map_or_else(|| name.clone(), |(_, expression)| expression.to_string())
        };
        let squares: Vec<String> = recorded.parts.iter().map(|name| format!("({})^2", source(name))).collect();
        let refusal = NoRotation {
            file: self.source.inner().origin(episode).to_owned(),
            episode: self.episodes()[episode].name.clone(),
            row,
            rotation: recorded.name.clone(),
            parts,
            length,
            condition: format!("0.99 < {} < 1.01", squares.join(" + ")),
        };
        DataError::Read(Box::new(refusal))
    }
}

impl Source for UnitRotations<'_> {
    fn columns(&self) -> &[Column] {
        self.view.columns()
    }

    fn episodes(&self) -> &[Episode] {
        self.view.episodes()
    }

    fn read(&self, episode: usize, rows: Range<usize>, halo: Halo) -> Result<Block, DataError> {
        let mut block = self.view.read(episode, rows, halo)?;
        for (recorded, places) in &self.rotations {
            self.settle(recorded, places, episode, &mut block)?;
        }
        Ok(block)
    }
}
