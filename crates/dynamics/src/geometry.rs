//! Geometry of states: on a line, on a circle, or several of them together as a rotation. It gives the difference of
//! two states, and brings back a state after a step of time.

use std::ops::Range;

use fleetfoot_data::packed;
use fleetfoot_model::{Model, RotationKind};

use crate::angle::wrap;

/// A state's place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A real number.
    Line,
    /// An angle, in (-pi, pi].
    Circle,
    /// A part of a rotation: which one, which part.
    Rotation {
        /// Index among the groups.
        group: usize,
        /// Place among the parts of the group.
        part: usize,
    },
}

/// States that are a rotation together.
#[derive(Debug, Clone)]
pub struct Group {
    /// The name of the rotation.
    pub name: String,
    /// Representation of the rotation by its parts.
    pub kind: RotationKind,
    /// Place of each part among the states.
    pub places: Vec<usize>,
}

/// The most parts that a rotation has.
const PARTS: usize = 4;

/// The geometry of some states.
#[derive(Debug, Clone, Default)]
pub struct Geometry {
    /// The place of each state.
    pub shapes: Vec<Shape>,
    /// The rotations among them.
    pub groups: Vec<Group>,
}

impl Geometry {
    /// Geometry of the states in these columns of a model; an index beyond them is no column.
    pub fn new(model: &Model, columns: &[usize]) -> Self {
        let shape = |&column: &usize| match model.columns.get(column).is_some_and(|column| column.angle) {
            true => Shape::Circle,
            false => Shape::Line,
        };
        let mut geometry = Self { shapes: columns.iter().map(shape).collect(), groups: Vec::new() };
        for rotation in model.rotations() {
            let place = |part: &usize| columns.iter().position(|column| column == part);
            let Some(places) = rotation.columns.iter().map(place).collect::<Option<Vec<_>>>() else { continue };
            let group = geometry.groups.len();
            places.iter().enumerate().for_each(|(part, &s)| geometry.shapes[s] = Shape::Rotation { group, part });
            geometry.groups.push(Group { name: rotation.name, kind: rotation.kind, places });
        }
        geometry
    }

    /// The group of a state that is part of a rotation, and which part it is.
    pub fn group(&self, state: usize) -> Option<(&Group, usize)> {
        match self.shapes[state] {
            Shape::Rotation { group, part } => Some((&self.groups[group], part)),
            _ => None,
        }
    }

    /// Neutral value of an unknown state: 0, or 1 for a quaternion's first part.
    pub fn neutral(&self, state: usize) -> f64 {
        match self.group(state) {
            Some((Group { kind: RotationKind::Quaternion, .. }, 0)) => 1.0,
            _ => 0.0,
        }
    }

    /// `a - b` of a state. That of an angle is in (-pi, pi]; of a rotation a is written as near to b as it can be.
    #[inline(always)]
    pub fn difference(&self, state: usize, a: impl Fn(usize) -> f64, b: impl Fn(usize) -> f64) -> f64 {
        match self.shapes[state] {
            Shape::Line => a(state) - b(state),
            Shape::Circle => wrap(a(state) - b(state)),
            Shape::Rotation { group, part } => self.groups[group].nearest(&a, &b)[part] - b(state),
        }
    }

    /// Values of some states, each rotation written as near to `mean` as it can be. If parts are missing, the available
    /// parts of a quaternion decide.
    pub fn aligned(&self, states: &[usize], values: &[f64], mean: &[f64]) -> Vec<f64> {
        let mut aligned = values.to_vec();
        for Group { kind, places, .. } in &self.groups {
            // A quantity that is measured twice is aligned twice.
            let there: Vec<usize> =
                (0..states.len()).filter(|&k| places.contains(&states[k]) && values[k].is_finite()).collect();
            match kind {
                RotationKind::Quaternion => {
                    let along: f64 = there.iter().map(|&k| values[k] * mean[states[k]]).sum();
                    there.iter().filter(|_| along < 0.0).for_each(|&k| aligned[k] = -values[k]);
                }
                RotationKind::Vector => {
                    let place = |place: &usize| there.iter().copied().find(|&k| states[k] == *place);
                    let Some(indices) = places.iter().map(place).collect::<Option<Vec<_>>>() else { continue };
                    let mut parts: Vec<f64> = indices.iter().map(|&k| values[k]).collect();
                    kind.nearest(&mut parts, &places.iter().map(|&place| mean[place]).collect::<Vec<_>>());
                    indices.iter().zip(parts).for_each(|(&k, part)| aligned[k] = part);
                }
            }
        }
        aligned
    }

    /// Brings a mean back to rotations, and their covariance (n x n) with it.
    pub fn retract_distribution(&self, mean: &mut [f64], covariance: &mut [f64]) {
        let n = mean.len();
        for Group { kind, places, .. } in &self.groups {
            let before: Vec<f64> = places.iter().map(|&place| mean[place]).collect();
            let jacobian = kind.retraction_derivative(&before);
            let parts = places.len();
            let turned = |old: &[f64], i: usize| -> f64 { (0..parts).map(|k| jacobian[i * parts + k] * old[k]).sum() };
            for other in 0..n {
                let old: Vec<f64> = places.iter().map(|&place| covariance[place * n + other]).collect();
                (0..parts).for_each(|i| covariance[places[i] * n + other] = turned(&old, i));
            }
            for other in 0..n {
                let old: Vec<f64> = places.iter().map(|&place| covariance[other * n + place]).collect();
                (0..parts).for_each(|i| covariance[other * n + places[i]] = turned(&old, i));
            }
            // Symmetric to the bit.
            for i in 0..n {
                (0..i).for_each(|j| covariance[j * n + i] = covariance[i * n + j]);
            }
        }
        self.retract(mean, |s| s);
    }

    /// Rotations of a prior mean: no rotation at all if nothing is known.
    pub fn begin(&self, mean: &mut [f64]) {
        for group in &self.groups {
            if group.places.iter().any(|&place| mean[place] != 0.0) {
                continue;
            }
            group.places.iter().for_each(|&place| mean[place] = self.neutral(place));
        }
        self.retract(mean, |s| s);
    }

    /// The angle of a state in (-pi, pi]; any other as it is.
    #[inline(always)]
    pub fn wrapped(&self, state: usize, value: f64) -> f64 {
        if self.shapes[state] == Shape::Circle { wrap(value) } else { value }
    }

    /// Brings rotations back that a step has made; value `s` stands at `at(s)`.
    #[inline(always)]
    pub fn retract(&self, values: &mut [f64], at: impl Fn(usize) -> usize) {
        for Group { kind, places, .. } in &self.groups {
            let mut buffer = [0.0; PARTS];
            let rotation = &mut buffer[..places.len()];
            rotation.iter_mut().zip(places).for_each(|(part, &place)| *part = values[at(place)]);
            kind.retract(rotation);
            rotation.iter().zip(places).for_each(|(part, &place)| values[at(place)] = *part);
        }
    }
}

impl Group {
    /// The parts of a vector of states.
    pub fn of(&self, x: impl Fn(usize) -> f64) -> Vec<f64> {
        self.places.iter().map(|&place| x(place)).collect()
    }

    fn nearest(&self, a: impl Fn(usize) -> f64, b: impl Fn(usize) -> f64) -> Vec<f64> {
        let mut parts = self.of(a);
        self.kind.nearest(&mut parts, &self.of(b));
        parts
    }

    /// Log(b^-1 a), rad in the body's axes.
    pub fn rotation(&self, a: impl Fn(usize) -> f64, b: impl Fn(usize) -> f64) -> [f64; 3] {
        self.kind.difference(&self.of(a), &self.of(b))
    }
}

/// A part of the vector of errors: a state, or a rotation by its angle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Component {
    /// A state.
    State(usize),
    /// A rotation, by its index among the groups: three entries of the vector.
    Group(usize),
}

impl Geometry {
    /// The states, every rotation once in the place of its first part.
    pub fn components(&self) -> Vec<Component> {
        let mut components = Vec::new();
        for (state, shape) in self.shapes.iter().enumerate() {
            let component = match *shape {
                Shape::Rotation { group, .. } => Component::Group(group),
                _ => Component::State(state),
            };
            if !components.contains(&component) {
                components.push(component);
            }
        }
        components
    }

    /// The covariance of errors, packed, from that of the states in training (`state`: entry of two of them) and their
    /// means. In the order of `components`, each rotation by the three parts of its rotation vector. For a rotation
    /// that is not far from its mean m the vector is `turning(m) (q - m)`.
    pub fn covariance(
        &self,
        components: &[Component],
        state: impl Fn(usize, usize) -> f64,
        mean: impl Fn(usize) -> f64,
    ) -> Vec<f64> {
        // Every error as a sum of states, each with its factor.
        let mut rows: Vec<Vec<(usize, f64)>> = Vec::new();
        for component in components {
            match *component {
                Component::State(state) => rows.push(vec![(state, 1.0)]),
                Component::Group(group) => {
                    let group = &self.groups[group];
                    let (mut centre, parts) = (group.of(&mean), group.places.len());
                    group.kind.retract(&mut centre);
                    let turning = group.kind.turning(&centre);
                    rows.extend(
                        turning
                            .chunks_exact(parts)
                            .map(|row| group.places.iter().copied().zip(row.iter().copied()).collect()),
                    );
                }
            }
        }
        let sum = |a: &[(usize, f64)], b: &[(usize, f64)]| -> f64 {
            if let ([(a, _)], [(b, _)]) = (a, b) {
                return state(*a, *b);
            }
            a.iter()
                .flat_map(|(i, x)| b.iter().map(move |(j, y)| (i, x, j, y)))
                .map(|(i, x, j, y)| x * y * state(*i, *j))
                .sum()
        };
        let mut packed_sums = vec![0.0; rows.len() * (rows.len() + 1) / 2];
        for i in 0..rows.len() {
            for j in 0..=i {
                packed_sums[packed(i, j)] = sum(&rows[i], &rows[j]);
            }
        }
        packed_sums
    }
}

/// The entries of each component in the vector of errors: one of a state, three of a rotation.
pub fn parts(components: &[Component]) -> Vec<Range<usize>> {
    let mut from = 0;
    let span = |component: &Component| {
        let length = if matches!(component, Component::Group(_)) { 3 } else { 1 };
        from += length;
        from - length..from
    };
    components.iter().map(span).collect()
}
