//! The numbers that a regulator keeps: one for a state, and three for a rotation. These three are the vector that turns
//! its set point into it, rad about the axes of the body.
//!
//! About a point x a small error e of a rotation changes its parts by `E e`, and a change dx of the parts is the error
//! `T dx`, with `T E = 1`. So a step `x+ = A x + B u + c` becomes `e+ = T A E e + T B u + ...`. Changes of a quaternion
//! along its length are no motion. They are not in it, and no mode of it has to be reached by an input.

use faer::Mat;
use fleetfoot_data::nearest;
use fleetfoot_dynamics::geometry::{Component, Group};
use fleetfoot_model::{Model, RotationKind};

use super::Named;
use crate::{
    control_error::ControlError,
    named::finite,
    pieces::{Affine, Pieces},
};

/// Axes of a body.
const AXES: [&str; 3] = ["x", "y", "z"];

/// Largest deviation from 1 of the length of a quaternion that a user writes down.
const UNIT: f64 = 1e-3;

/// One number.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Coordinate {
    pub(super) name: String,
    /// Its standard deviation in training, 1 where that is not known.
    pub(super) size: f64,
    pub(super) of: Of,
}

/// Subject of the number.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Of {
    /// A state.
    State(usize),
    /// The turn of a rotation about an axis.
    Turn { group: usize, axis: usize },
}

/// All of them: states that are no parts of rotations in their order, then the rotations.
pub(super) struct Coordinates<'a> {
    pub(super) of: Vec<Coordinate>,
    pub(super) groups: &'a [Group],
    states: &'a [String],
}

impl<'a> Coordinates<'a> {
    pub(super) fn new(pieces: &'a Pieces, model: &Model) -> Self {
        let geometry = pieces.whole.geometry();
        let linear = (0..pieces.states.len()).filter(|&state| geometry.group(state).is_none());
        let mut of: Vec<Coordinate> = linear
            .map(|state| Coordinate {
                name: pieces.states[state].clone(),
                size: pieces.size(state),
                of: Of::State(state),
            })
            .collect();
        for (at, group) in geometry.groups.iter().enumerate() {
            let sizes = turns(pieces, model, at);
            of.extend((0..3).map(|axis| Coordinate {
                name: format!("{} about {}", group.name, AXES[axis]),
                size: sizes[axis],
                of: Of::Turn { group: at, axis },
            }));
        }
        Self { of, groups: &geometry.groups, states: &pieces.states }
    }

    pub(super) fn len(&self) -> usize {
        self.of.len()
    }

    /// The parts of a rotation in a vector of states.
    pub(super) fn parts(&self, group: usize, x: &[f64]) -> Vec<f64> {
        self.groups[group].of(|place| x[place])
    }

    /// The coordinates of a state about itself: rotations are off by nothing.
    pub(super) fn values(&self, x: &[f64]) -> Vec<f64> {
        let value = |coordinate: &Coordinate| if let Of::State(state) = coordinate.of { x[state] } else { 0.0 };
        self.of.iter().map(value).collect()
    }

    /// A state's own of some values of the states; 0 of a turn.
    pub(super) fn of_state(&self, at: usize, values: &[f64]) -> f64 {
        if let Of::State(state) = self.of[at].of { values[state] } else { 0.0 }
    }

    /// The state that is off `x` by these changes.
    pub(super) fn moved(&self, x: &[f64], change: &[f64]) -> Vec<f64> {
        let (mut moved, mut turned) = (x.to_vec(), vec![[0.0; 3]; self.groups.len()]);
        for (coordinate, change) in self.of.iter().zip(change) {
            match coordinate.of {
                Of::State(state) => moved[state] += change,
                Of::Turn { group, axis } => turned[group][axis] = *change,
            }
        }
        for (at, turn) in turned.into_iter().enumerate().filter(|(_, turn)| *turn != [0.0; 3]) {
            let group = &self.groups[at];
            let mut parts = group.kind.moved(&self.parts(at, x), turn);
            group.kind.retract(&mut parts);
            group.places.iter().zip(parts).for_each(|(&place, part)| moved[place] = part);
        }
        moved
    }

    /// Derivatives, or next states, about `x` in these coordinates, of the submodel that is `affine` there.
    pub(super) fn reduced(&self, affine: &Affine, x: &[f64], continuous: bool) -> Affine {
        let n = x.len();
        let (mut to, mut from) = (Mat::<f64>::zeros(self.len(), n), Mat::<f64>::zeros(n, self.len()));
        for (row, coordinate) in self.of.iter().enumerate() {
            match coordinate.of {
                Of::State(state) => (to[(row, state)], from[(state, row)]) = (1.0, 1.0),
                Of::Turn { group, axis } => {
                    let Group { kind, places, .. } = &self.groups[group];
                    let parts = self.parts(group, x);
                    let (turning, turned) = (kind.turning(&parts), kind.turned(&parts));
                    for (at, &place) in places.iter().enumerate() {
                        to[(row, place)] = turning[axis * places.len() + at];
                        from[(place, row)] = turned[3 * at + axis];
                    }
                }
            }
        }
        // Rotations stand where they are, and are off by nothing there.
        let is_part = |state: usize| self.groups.iter().any(|group| group.places.contains(&state));
        let fixed = Mat::from_fn(n, 1, |state, _| if is_part(state) { x[state] } else { 0.0 });
        let mut left = &affine.a * &fixed + Mat::from_fn(n, 1, |state, _| affine.c[state]);
        if !continuous {
            left -= &fixed;
        }
        let c = &to * left;
        Affine { a: &to * &affine.a * &from, b: &to * &affine.b, c: (0..self.len()).map(|row| c[(row, 0)]).collect() }
    }

    /// Places among `kept` (places of coordinates) that a name stands for: one, or all three of a rotation.
    pub(super) fn find(
        &self,
        of: &'static str,
        kind: &'static str,
        name: &str,
        kept: &[usize],
    ) -> Result<Vec<usize>, ControlError> {
        let is_of = |coordinate: &Coordinate| match coordinate.of {
            Of::Turn { group, .. } => coordinate.name == name || self.groups[group].name == name,
            Of::State(_) => coordinate.name == name,
        };
        let matches: Vec<usize> = (0..kept.len()).filter(|&at| is_of(&self.of[kept[at]])).collect();
        if !matches.is_empty() {
            return Ok(matches);
        }
        let mut names: Vec<&str> = Vec::new();
        for coordinate in kept.iter().map(|&at| &self.of[at]) {
            let known = match coordinate.of {
                Of::Turn { group, .. } => &self.groups[group].name,
                Of::State(_) => &coordinate.name,
            };
            if !names.contains(&known.as_str()) {
                names.push(known);
            }
        }
        Err(ControlError::Unknown { of, kind, name: name.to_owned(), hint: hint(name, &names) })
    }

    /// Places of the coordinates that are not free. A rotation is kept or free as a whole, by its name or by those of
    /// all of its parts.
    pub(super) fn kept(&self, free: &[String]) -> Result<Vec<usize>, ControlError> {
        let mut is_free = vec![false; self.len()];
        let all: Vec<usize> = (0..self.len()).collect();
        for name in free {
            let Some(group) = self.group_of_part(name) else {
                self.find("free", "state", name, &all)?.into_iter().for_each(|at| is_free[at] = true);
                continue;
            };
            let Group { name: rotation, places, .. } = &self.groups[group];
            let missing = places.iter().map(|&place| &self.states[place]).find(|part| !free.contains(part));
            if missing.is_some() {
                return Err(ControlError::HalfRotation { of: "free", rotation: rotation.clone() });
            }
            self.find("free", "state", rotation, &all)?.into_iter().for_each(|at| is_free[at] = true);
        }
        let whole = |group: usize| {
            let of_group =
                (0..self.len()).filter(|&at| matches!(self.of[at].of, Of::Turn { group: other, .. } if other == group));
            let free: Vec<bool> = of_group.map(|at| is_free[at]).collect();
            free.iter().all(|is_free| *is_free) || !free.contains(&true)
        };
        match (0..self.groups.len()).find(|&group| !whole(group)) {
            Some(group) => Err(ControlError::HalfRotation { of: "free", rotation: self.groups[group].name.clone() }),
            None => Ok((0..self.len()).filter(|&at| !is_free[at]).collect()),
        }
    }

    fn group_of_part(&self, name: &str) -> Option<usize> {
        let state = self.states.iter().position(|known| known == name)?;
        self.groups.iter().position(|group| group.places.contains(&state))
    }

    /// Sets states to their values in a set point, and marks the coordinates that it gives. A rotation is given by all
    /// of its parts, or by `roll(NAME)`, `pitch(NAME)` and `yaw(NAME)`, rad, of Rz(yaw) Ry(pitch) Rx(roll). Entries of
    /// other names are returned.
    pub(super) fn given(&self, setpoint: &[Named], x: &mut [f64]) -> Result<(Vec<bool>, Vec<Named>), ControlError> {
        let (mut given, mut rest) = (vec![false; self.len()], Vec::new());
        let mut turns: Vec<Turned> = vec![Turned::default(); self.groups.len()];
        for (name, value) in setpoint {
            finite("setpoint", name, *value)?;
            if let Some((group, angle)) = self.angle(name) {
                turns[group].angles[angle] = Some(*value);
            } else if let Some(group) = self.group_of_part(name) {
                let part = self.groups[group].places.iter().position(|&place| self.states[place] == *name);
                turns[group].parts[part.unwrap_or_default()] = Some(*value);
            } else if let Some(at) =
                self.of.iter().position(|coordinate| coordinate.name == *name && matches!(coordinate.of, Of::State(_)))
            {
                given[at] = true;
                if let Of::State(state) = self.of[at].of {
                    x[state] = *value;
                }
            } else {
                rest.push((name.clone(), *value));
            }
        }
        for (at, turned) in turns.into_iter().enumerate() {
            let group = &self.groups[at];
            let Some(parts) = turned.parts(group)? else { continue };
            group.places.iter().zip(parts).for_each(|(&place, part)| x[place] = part);
            for (coordinate, given) in self.of.iter().zip(&mut given) {
                *given |= matches!(coordinate.of, Of::Turn { group, .. } if group == at);
            }
        }
        Ok((given, rest))
    }

    /// `yaw(attitude)`: of which rotation, and which of roll, pitch and yaw.
    fn angle(&self, name: &str) -> Option<(usize, usize)> {
        let (angle, rest) = name.split_once('(')?;
        let angle = ["roll", "pitch", "yaw"].iter().position(|axis| *axis == angle.trim())?;
        let rotation = rest.strip_suffix(')')?.trim();
        Some((self.groups.iter().position(|group| group.name == rotation)?, angle))
    }
}

/// Suggestion for an unknown name.
fn hint(name: &str, known: &[&str]) -> String {
    match nearest(name, known.iter().copied()).as_slice() {
        [] => format!("there is {}", known.join(", ")),
        similar => format!("did you mean {}?", similar.join(", ")),
    }
}

/// Values given for a rotation.
#[derive(Debug, Clone, Copy, Default)]
struct Turned {
    parts: [Option<f64>; 4],
    angles: [Option<f64>; 3],
}

impl Turned {
    /// The parts of the given rotation; `None` if none is given.
    fn parts(&self, group: &Group) -> Result<Option<Vec<f64>>, ControlError> {
        let half = || ControlError::HalfRotation { of: "setpoint", rotation: group.name.clone() };
        let (parts, angles) = (&self.parts[..group.places.len()], &self.angles);
        let count_given = |values: &[Option<f64>]| values.iter().flatten().count();
        match (count_given(parts), count_given(angles)) {
            (0, 0) => Ok(None),
            (count, 0) if count == parts.len() => {
                let mut given_parts: Vec<f64> = parts.iter().flatten().copied().collect();
                let length = given_parts.iter().map(|part| part * part).sum::<f64>().sqrt();
                if group.kind == RotationKind::Quaternion && (length - 1.0).abs() > UNIT {
                    return Err(ControlError::Value {
                        of: "setpoint",
                        name: format!("the length of {}", group.name),
                        value: length,
                        allowed: "1, of a quaternion",
                    });
                }
                group.kind.retract(&mut given_parts);
                Ok(Some(given_parts))
            }
            (0, 3) => {
                let given_angles = angles.map(Option::unwrap_or_default);
                let neutral: Vec<f64> =
                    (0..parts.len()).map(|part| if parts.len() == 4 && part == 0 { 1.0 } else { 0.0 }).collect();
                // About the axes of the body, one after the other: yaw, pitch, roll.
                let turn = |attitude: &[f64], axis: usize, angle: f64| {
                    let mut phi = [0.0; 3];
                    phi[axis] = angle;
                    group.kind.moved(attitude, phi)
                };
                let mut attitude =
                    turn(&turn(&turn(&neutral, 2, given_angles[2]), 1, given_angles[1]), 0, given_angles[0]);
                group.kind.retract(&mut attitude);
                Ok(Some(attitude))
            }
            _ => Err(half()),
        }
    }
}

/// The standard deviations of the turns of a rotation in training, rad about the axes of the body at their mean; 1 if
/// they are unknown.
fn turns(pieces: &Pieces, model: &Model, group: usize) -> [f64; 3] {
    let (geometry, training) = (pieces.whole.geometry(), &model.training);
    let places = &geometry.groups[group].places;
    let order = |state: usize| pieces.whole.state_order(state).unwrap_or_default();
    let known =
        !training.state_covariance.is_empty() && places.iter().all(|&place| pieces.whole.state_order(place).is_some());
    let components = [Component::Group(group)];
    let covariance = match known {
        true => geometry.covariance(
            &components,
            |i, j| training.state_covariance[fleetfoot_data::packed(order(i), order(j))],
            |state| training.state_mean.get(order(state)).copied().unwrap_or_else(|| geometry.neutral(state)),
        ),
        false => vec![0.0; 6],
    };
    std::array::from_fn(|axis| {
        let variance: f64 = covariance[fleetfoot_data::packed(axis, axis)];
        if variance.is_finite() && variance > 0.0 { variance.sqrt() } else { 1.0 }
    })
}
