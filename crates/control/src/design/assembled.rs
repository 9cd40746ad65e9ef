//! A designed regulator as plain data.

use super::{
    coordinates::Of,
    lqr::{Design, SetPoint},
    setpoint::Rest,
};
use crate::controller::{
    DrivenInput, MeasuredColumn, RegionChoice, RegionLaw, RegulatedRotation, RegulatedState, Regulator,
};

impl Design<'_> {
    /// The regulator of the laws about a set point.
    pub(super) fn regulator(&self, rest: &Rest, laws: Vec<RegionLaw>, partition: Option<RegionChoice>) -> Regulator {
        let pieces = self.pieces;
        let limits = |name: &String| {
            let given = self.options.limits.iter().find(|(limited, ..)| limited == name);
            given.map_or((f64::MIN, f64::MAX), |&(_, lowest, highest)| (lowest, highest))
        };
        let angle = |state: usize| pieces.whole.model().columns[pieces.whole.state_column(state)].angle;
        Regulator {
            period: self.period,
            states: self
                .kept
                .iter()
                .filter_map(|&at| match self.coordinates.of[at].of {
                    Of::State(s) => Some(RegulatedState {
                        name: pieces.states[s].clone(),
                        at: rest.x[s],
                        size: pieces.size(s),
                        angle: angle(s),
                    }),
                    Of::Turn { .. } => None,
                })
                .collect(),
            rotations: self.rotations(rest),
            inputs: self
                .driven
                .iter()
                .map(|&i| {
                    let (lowest, highest) = limits(&pieces.inputs[i]);
                    DrivenInput { name: pieces.inputs[i].clone(), lowest, highest }
                })
                .collect(),
            measured: self
                .measured
                .iter()
                .map(|&i| MeasuredColumn {
                    name: pieces.inputs[i].clone(),
                    at: rest.u[i],
                    size: pieces.size(pieces.states.len() + i),
                })
                .collect(),
            integrated: self.weights.integrated.iter().map(|&(state, _)| state).collect(),
            partition,
            laws,
            prediction: None,
        }
    }

    /// The rotations that are kept.
    fn rotations(&self, rest: &Rest) -> Vec<RegulatedRotation> {
        let kept: Vec<_> = self.kept.iter().map(|&at| &self.coordinates.of[at]).collect();
        let one = |(at, group): (usize, &fleetfoot_dynamics::geometry::Group)| {
            let turns = kept.iter().filter(|coordinate| matches!(coordinate.of, Of::Turn { group, .. } if group == at));
            let size: Vec<f64> = turns.map(|coordinate| coordinate.size).collect();
            Some(RegulatedRotation {
                name: group.name.clone(),
                kind: group.kind,
                columns: group.places.iter().map(|&place| self.pieces.states[place].clone()).collect(),
                at: self.coordinates.parts(at, &rest.x),
                size: size.try_into().ok()?,
            })
        };
        self.coordinates.groups.iter().enumerate().filter_map(one).collect()
    }

    /// The set point by names.
    pub(super) fn summary_of(&self, rest: &Rest, region: Option<usize>) -> SetPoint {
        let named = |names: &[String], values: &[f64]| names.iter().cloned().zip(values.iter().copied()).collect();
        SetPoint {
            states: named(&self.pieces.states, &rest.x),
            inputs: named(&self.pieces.inputs, &rest.u),
            region: if self.pieces.regions.len() > 1 { region } else { None },
            drift: self.kept.iter().map(|&at| (self.coordinates.of[at].name.clone(), rest.drift[at])).collect(),
            at_rest: rest.holds(),
        }
    }
}
