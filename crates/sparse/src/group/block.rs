//! One group in correlation form, in units in which its penalty is round: `v_j = omega_j delta_j`, gradients divided by omega_j.

use super::norm::critical;
use crate::{
    kernel::norm,
    penalty::{Sign, Weights},
};

/// The columns of a group that take part, and what lambda is multiplied with.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Block {
    /// Ascending.
    pub(super) columns: Vec<usize>,
    /// omega_j; 1 where nothing is penalised.
    pub(super) units: Vec<f64>,
    pub(super) signs: Vec<Sign>,
    /// Weight of the absolute values.
    l1: f64,
    /// Weight of the norm.
    group: f64,
}

/// A block at one lambda: `l1 sum |v_i| + group |v|` under sign constraints.
#[derive(Debug, Clone, Copy)]
pub(super) struct Rule<'a> {
    pub(super) units: &'a [f64],
    pub(super) signs: &'a [Sign],
    pub(super) l1: f64,
    pub(super) group: f64,
}

/// The blocks of a problem: groups, and columns that are not penalised one by one. `of` names the group of every column, `group` the weight of its norm.
pub(super) fn blocks(weights: &Weights, of: &[usize], group: &[f64], l1_ratio: f64) -> Vec<Block> {
    let mut members: Vec<Vec<usize>> = vec![Vec::new(); group.len()];
    let mut blocks = Vec::new();
    for (j, &g) in of.iter().enumerate().filter(|(j, _)| weights.used(*j)) {
        let penalised = weights.omega[j] > 0.0 && (l1_ratio > 0.0 || group[g] > 0.0);
        if !penalised {
            blocks.push(Block::of(weights, vec![j], 0.0, 0.0));
        } else if l1_ratio == 1.0 || group[g] == 0.0 {
            // Without its norm a group is its columns.
            blocks.push(Block::of(weights, vec![j], l1_ratio, 0.0));
        } else {
            members[g].push(j);
        }
    }
    let groups = members.into_iter().zip(group).filter(|(columns, _)| !columns.is_empty());
    blocks.extend(groups.map(|(columns, weight)| Block::of(weights, columns, l1_ratio, (1.0 - l1_ratio) * weight)));
    blocks.sort_by_key(|block| block.columns[0]);
    blocks
}

impl Block {
    fn of(weights: &Weights, columns: Vec<usize>, l1: f64, group: f64) -> Self {
        let free = l1 == 0.0 && group == 0.0;
        let units = columns.iter().map(|&j| if free { 1.0 } else { weights.omega[j] }).collect();
        let signs = columns.iter().map(|&j| weights.signs[j]).collect();
        Self { columns, units, signs, l1, group }
    }

    /// Its columns and their units.
    pub(super) fn members(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.columns.iter().copied().zip(self.units.iter().copied())
    }

    /// Returns true if the block is penalised at all.
    pub(super) fn penalised(&self) -> bool {
        self.l1 > 0.0 || self.group > 0.0
    }

    pub(super) fn at(&self, lambda: f64) -> Rule<'_> {
        let at = |weight: f64| if weight == 0.0 { 0.0 } else { lambda * weight };
        Rule { units: &self.units, signs: &self.signs, l1: at(self.l1), group: at(self.group) }
    }

    /// The least lambda at which these gradients (all columns, correlation form) leave the block at zero. What is not above its `noise` is none.
    pub(super) fn critical(&self, gradient: &[f64], noise: impl Fn(usize) -> f64) -> f64 {
        let push = |at: usize| {
            let j = self.columns[at];
            let push = push(self.signs[at], gradient[j]);
            if push > noise(j) { push / self.units[at] } else { 0.0 }
        };
        critical((0..self.columns.len()).map(push), self.l1, self.group)
    }

    /// The entries of a vector over all columns, coefficients in the units of the block.
    pub(super) fn coefficients(&self, delta: &[f64]) -> Vec<f64> {
        self.columns.iter().zip(&self.units).map(|(&j, unit)| delta[j] * unit).collect()
    }

    /// The entries of the gradients of all columns, in the units of the block.
    pub(super) fn gradients(&self, gradient: &[f64]) -> Vec<f64> {
        self.columns.iter().zip(&self.units).map(|(&j, unit)| gradient[j] / unit).collect()
    }
}

/// Size of a gradient's push on a coefficient from zero into its allowed range.
fn push(sign: Sign, gradient: f64) -> f64 {
    sign.sides().iter().map(|side| side * gradient).fold(0.0, f64::max)
}

impl Rule<'_> {
    /// A gradient beyond the absolute values' part, on its side; zero where there is nothing beyond.
    pub(super) fn beyond(&self, at: usize, gradient: f64) -> f64 {
        (push(self.signs[at], gradient) - self.l1).max(0.0).copysign(gradient)
    }

    /// Returns true if the gradients leave all coefficients at zero.
    pub(super) fn holds(&self, gradient: &[f64]) -> bool {
        norm(gradient.iter().enumerate().map(|(at, &c)| self.beyond(at, c))) <= self.group
    }

    /// The penalty.
    pub(super) fn value(&self, v: &[f64]) -> f64 {
        let sum: f64 = v.iter().map(|v| v.abs()).sum();
        self.l1 * sum + if self.group > 0.0 { self.group * norm(v.iter().copied()) } else { 0.0 }
    }

    /// The gradients nearest to these (of a zero block: along themselves) that belong to a minimiser with these coefficients.
    pub(super) fn goals(&self, v: &[f64], gradient: &[f64]) -> Vec<f64> {
        let length = norm(v.iter().copied());
        let beyond = |at: usize| self.beyond(at, gradient[at]);
        let goal = |at: usize| match v[at] {
            0.0 => gradient[at] - beyond(at),
            value => self.l1 * value.signum() + if self.group > 0.0 { self.group * (value / length) } else { 0.0 },
        };
        let mut goals: Vec<f64> = (0..v.len()).map(goal).collect();
        if length == 0.0 && self.group > 0.0 {
            let reach = norm((0..v.len()).map(beyond));
            let share = if reach > self.group { self.group / reach } else { 1.0 };
            goals.iter_mut().enumerate().for_each(|(at, goal)| *goal += share * beyond(at));
            if share == 1.0 {
                goals.copy_from_slice(gradient);
            }
        }
        goals
    }

    /// The violation of the optimality conditions as a correlation: length of what the gradients are from their goals. Infinite when a sign is broken.
    pub(super) fn violation(&self, v: &[f64], gradient: &[f64]) -> f64 {
        if v.iter().zip(self.signs).any(|(&value, sign)| !sign.allows(value)) {
            return f64::INFINITY;
        }
        let goals = self.goals(v, gradient);
        norm((0..v.len()).map(|at| self.units[at] * (gradient[at] - goals[at])))
    }
}
