//! Rotations among the states of a recipe. One section for all columns of a rotation is written out as a state for
//! each, whose equations are the kinematics.

use fleetfoot_data::Column as DataColumn;
use fleetfoot_data::setting::STATES_SECTION;
use fleetfoot_library::{Expr, Quaternion, rotation_vector_rates};
use fleetfoot_model::{Column, RotationKind, RotationPart, rotations};
use indexmap::IndexMap;

use crate::{
    error::Error,
    recipe::{Frame, Kind, State},
};

/// Separators between a rotation's name and its part's.
const SEPARATORS: [&str; 3] = [".", "_", ""];

impl Kind {
    /// Representation of a rotation of this kind; `None` if it is no rotation.
    pub fn rotation(self) -> Option<RotationKind> {
        match self {
            Self::Quaternion => Some(RotationKind::Quaternion),
            Self::RotationVector => Some(RotationKind::Vector),
            Self::Linear | Self::Angle => None,
        }
    }
}

impl State {
    /// Returns true if its equation is given: `known`, or the kinematics of a rotation.
    pub fn is_given(&self) -> bool {
        self.known.is_some() || self.kind.and_then(Kind::rotation).is_some()
    }

    /// Its part in a rotation; `None` for a single state, and for a rotation that is not written out yet.
    pub fn rotation_part(&self) -> Option<RotationPart> {
        let kind = self.kind?.rotation()?;
        let (group, letter) = self.part.as_deref()?.rsplit_once('.')?;
        let part = kind.letters().iter().position(|place_letter| *place_letter == letter)?;
        Some(RotationPart { group: group.to_owned(), kind, part })
    }

    /// Writes a rotation out: a state for each of its parts; `None` for any other state. `aliases` and `fields` are the
    /// possible names of its columns.
    ///
    /// # Errors
    /// Columns that are not there or whose order is unknown, no rates, settings that a rotation cannot have.
    pub(crate) fn parts(
        &self,
        name: &str,
        aliases: &IndexMap<String, String>,
        fields: &[DataColumn],
    ) -> Result<Option<Vec<(String, State)>>, Error> {
        let place = STATES_SECTION.entry(name).to_string();
        let Some(kind) = self.kind.and_then(Kind::rotation) else {
            let entries = [
                ("columns", self.columns.is_some()),
                ("order", self.order.is_some()),
                ("rate", self.rate.is_some()),
                ("frame", self.frame.is_some()),
                ("part", self.part.is_some()),
            ];
            return match entries.iter().find(|(_, is_set)| *is_set) {
                Some((key, _)) => Err(Error::conflict(format!(
                    "{place} {key}: only rotations have it; write `kind = \"quaternion\"` or `kind = \"rotation-vector\"` beside it, or leave it out"
                ))),
                None => Ok(None),
            };
        };
        if self.part.is_some() {
            return match self.rotation_part() {
                Some(_) if self.known.is_some() => Ok(None),
                _ => Err(Error::value(format!(
                    "{place} part: a part is written as NAME.{}, beside its `known`; a rotation whose columns are named in one section needs none",
                    kind.letters()[0]
                ))),
            };
        }
        self.refuse_state_entries(&place)?;
        let columns = self.columns_of(name, kind, &place, aliases, fields)?;
        let names: Vec<String> = columns.iter().map(|(name, _)| name.clone()).collect();
        let known = self.kinematics(kind, &names, &place, aliases, fields)?;
        let part = |((at, (part_name, column)), known): ((usize, (String, Option<String>)), String)| {
            let state = State {
                column,
                known: Some(known),
                kind: self.kind,
                part: Some(format!("{name}.{}", kind.letters()[at])),
                regressor: Some(self.regressor.unwrap_or(false)),
                ..State::default()
            };
            (part_name, state)
        };
        Ok(Some(columns.into_iter().enumerate().zip(known).map(part).collect()))
    }

    fn refuse_state_entries(&self, place: &str) -> Result<(), Error> {
        let entries = [
            ("derivative", self.derivative.is_some()),
            ("known", self.known.is_some()),
            ("equation", self.equation.is_some()),
            ("nominal", self.nominal.is_some()),
            ("library", self.library.is_some()),
            ("fixed", !self.fixed.is_empty()),
            ("unit", self.unit.is_some()),
        ];
        match entries.iter().find(|(_, is_set)| *is_set) {
            Some((key, _)) => Err(Error::conflict(format!(
                "{place} {key}: the equations of a rotation are its kinematics, given its `rate`; leave `{key}` out, and fit the equations of the rates"
            ))),
            None => Ok(()),
        }
    }

    /// Name and source of every part's state; no source where the name is that of a field or an alias.
    fn columns_of(
        &self,
        name: &str,
        kind: RotationKind,
        place: &str,
        aliases: &IndexMap<String, String>,
        fields: &[DataColumn],
    ) -> Result<Vec<(String, Option<String>)>, Error> {
        let letters = kind.letters();
        if let Some(columns) = &self.columns {
            if self.column.is_some() {
                return Err(Error::conflict(format!("{place}: it has both `column` and `columns`; keep one of them")));
            }
            if columns.len() != letters.len() {
                return Err(Error::value(format!(
                    "{place} columns: {} columns; a {} has {}, {}",
                    columns.len(),
                    kind.word(),
                    letters.len(),
                    letters.join(", ")
                )));
            }
            let order = self.order_of(columns, kind, place)?;
            let named = |letter: &&str| {
                let at = order.iter().position(|given| given == letter).unwrap_or_default();
                (columns[at].clone(), None)
            };
            return Ok(letters.iter().map(named).collect());
        }
        if self.order.is_some() {
            return Err(Error::conflict(format!("{place} order: it needs `columns`, which are missing")));
        }
        // The common beginning of the parts' names, itself or by an alias.
        let stem = self.column.as_deref().unwrap_or(name).trim();
        let beginning = aliases.get(stem).map_or(stem, String::as_str).trim();
        let is_known = |text: &String| aliases.contains_key(text) || fields.iter().any(|field| field.name == *text);
        for separator in SEPARATORS {
            let texts: Vec<String> = letters.iter().map(|letter| format!("{beginning}{separator}{letter}")).collect();
            if texts.iter().all(is_known) {
                let given = |(letter, text): (&&str, String)| match beginning == name {
                    true => (text, None),
                    false => (format!("{name}.{letter}"), Some(text)),
                };
                return Ok(letters.iter().zip(texts).map(given).collect());
            }
        }
        Err(Error::unknown(
            stem,
            format!(
                "{place}: no columns `{beginning}.{}` and so on; name the {} of it: `columns = [...]`, or their common beginning: `column = \"/odom.pose.pose.orientation\"`",
                letters[0],
                letters.len()
            ),
        ))
    }

    /// The letter of every column: by `order`, else their last ones.
    fn order_of(&self, columns: &[String], kind: RotationKind, place: &str) -> Result<Vec<String>, Error> {
        let letters = kind.letters();
        let is_order = |order: &[String]| letters.iter().all(|letter| order.iter().any(|given| given == letter));
        if let Some(text) = &self.order {
            let order: Vec<String> = text.chars().map(String::from).collect();
            return match order.len() == letters.len() && is_order(&order) {
                true => Ok(order),
                false => Err(Error::value(format!(
                    "{place} order = \"{text}\": write the letters {} in the order of the columns{}",
                    letters.join(", "),
                    if kind == RotationKind::Quaternion { ", \"wxyz\" or \"xyzw\"" } else { "" }
                ))),
            };
        }
        let last =
            |name: &String| name.chars().last().map(|letter| letter.to_lowercase().to_string()).unwrap_or_default();
        let order: Vec<String> = columns.iter().map(last).collect();
        if is_order(&order) {
            return Ok(order);
        }
        match kind {
            RotationKind::Vector => Ok(letters.iter().map(|letter| (*letter).to_owned()).collect()),
            RotationKind::Quaternion => Err(Error::missing(format!(
                "{place}: the names of its columns do not end in w, x, y and z, and their order is not known; write `order = \"wxyz\"` or `order = \"xyzw\"`"
            ))),
        }
    }

    /// The right sides of the parts.
    fn kinematics(
        &self,
        kind: RotationKind,
        names: &[String],
        place: &str,
        aliases: &IndexMap<String, String>,
        fields: &[DataColumn],
    ) -> Result<Vec<String>, Error> {
        let Some(rate) = self.rate.as_ref().filter(|rate| rate.len() == 3) else {
            return Err(Error::missing(format!(
                "{place}: a rotation needs its three rates, rad/s: `rate = [\"wx\", \"wy\", \"wz\"]`, states, inputs or expressions, about the axes of the body, or with `frame = \"world\"` of the world"
            )));
        };
        // Rates are put in as text, which says the same wherever names are read.
        let stands_for = |i: usize| Expr::column(format!("\u{1}{i}"));
        let rates: [Expr; 3] = std::array::from_fn(stands_for);
        let world = self.frame == Some(Frame::World);
        let axis = |at: usize| Expr::column(names[at].as_str());
        let sides: Vec<Expr> = match kind {
            RotationKind::Quaternion => {
                Quaternion::new(axis(1), axis(2), axis(3), axis(0)).rates(&rates, world).to_vec()
            }
            RotationKind::Vector => rotation_vector_rates(&[axis(0), axis(1), axis(2)], &rates, world).to_vec(),
        };
        let with_rates = |side: Expr| {
            let mut text = side.to_string();
            for (i, rate) in rate.iter().enumerate() {
                let rate = rate.trim();
                let is_name = aliases.contains_key(rate) || fields.iter().any(|field| field.name == rate);
                let written = if is_name { Expr::column(rate).to_string() } else { format!("({rate})") };
                text = text.replace(&stands_for(i).to_string(), &written);
            }
            text
        };
        Ok(sides.into_iter().map(with_rates).collect())
    }
}

/// The rotations among columns by name, as quaternions over these.
pub fn named_rotations(columns: &[Column]) -> Vec<(String, Quaternion)> {
    let of = |rotation: fleetfoot_model::Rotation| {
        let part = |at: usize| Expr::column(columns[rotation.columns[at]].name.as_str());
        let quaternion = match rotation.kind {
            RotationKind::Quaternion => Quaternion::new(part(1), part(2), part(3), part(0)),
            RotationKind::Vector => Quaternion::of_vector(&[part(0), part(1), part(2)]),
        };
        (rotation.name, quaternion)
    };
    rotations(columns).into_iter().map(of).collect()
}
