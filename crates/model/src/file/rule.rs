//! Rules of partitions as text.

use std::sync::Arc;

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::{Real, Reals, floats, reals, rows};
use crate::{Branch, Cut, Rule, Tree, UnseenLabel};

#[derive(Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub(super) enum RuleText {
    Whole,
    Ball { radius: Real },
    Box { half: Real },
    Linear { weights: Vec<Reals>, offsets: Reals },
    Joined { cells: Box<RuleText>, regions: Vec<u32> },
    Tree { cuts: Vec<CutText> },
    Labels { values: Reals, names: Vec<String>, rules: Vec<RuleText>, pool_unseen: bool },
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CutText {
    column: usize,
    threshold: Real,
    below: BranchText,
    above: BranchText,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum BranchText {
    Cut(usize),
    Region(u32),
}

impl From<&Rule> for RuleText {
    fn from(rule: &Rule) -> Self {
        match rule {
            Rule::Whole => RuleText::Whole,
            Rule::Ball { radius } => RuleText::Ball { radius: Real(*radius) },
            Rule::Box { half } => RuleText::Box { half: Real(*half) },
            Rule::Linear { weights, offsets } => RuleText::Linear { weights: rows(weights), offsets: reals(offsets) },
            Rule::Joined { cells, regions } => {
                RuleText::Joined { cells: Box::new(RuleText::from(cells.as_ref())), regions: regions.clone() }
            }
            Rule::Tree(tree) => RuleText::Tree { cuts: tree.cuts.iter().map(CutText::from).collect() },
            Rule::Labels { values, names, rules, unseen } => RuleText::Labels {
                values: reals(values),
                names: names.clone(),
                rules: rules.iter().map(RuleText::from).collect(),
                pool_unseen: *unseen == UnseenLabel::Pool,
            },
        }
    }
}

impl RuleText {
    pub(super) fn into_rule(self) -> Rule {
        match self {
            RuleText::Whole => Rule::Whole,
            RuleText::Ball { radius } => Rule::Ball { radius: radius.0 },
            RuleText::Box { half } => Rule::Box { half: half.0 },
            RuleText::Linear { weights, offsets } => {
                Rule::Linear { weights: weights.into_iter().map(floats).collect(), offsets: floats(offsets) }
            }
            RuleText::Joined { cells, regions } => Rule::Joined { cells: Arc::new(cells.into_rule()), regions },
            RuleText::Tree { cuts } => Rule::Tree(Tree { cuts: cuts.into_iter().map(CutText::into_cut).collect() }),
            RuleText::Labels { values, names, rules, pool_unseen } => Rule::Labels {
                values: floats(values),
                names,
                rules: rules.into_iter().map(RuleText::into_rule).collect(),
                unseen: if pool_unseen { UnseenLabel::Pool } else { UnseenLabel::Refuse },
            },
        }
    }
}

impl From<&Cut> for CutText {
    fn from(cut: &Cut) -> Self {
        let branch = |branch| match branch {
            Branch::Cut(cut) => BranchText::Cut(cut),
            Branch::Region(region) => BranchText::Region(region),
        };
        let (below, above) = (branch(cut.below), branch(cut.above));
        Self { column: cut.column, threshold: Real(cut.threshold), below, above }
    }
}

impl CutText {
    fn into_cut(self) -> Cut {
        let branch = |branch| match branch {
            BranchText::Cut(cut) => Branch::Cut(cut),
            BranchText::Region(region) => Branch::Region(region),
        };
        let (below, above) = (branch(self.below), branch(self.above));
        Cut { column: self.column, threshold: self.threshold.0, below, above }
    }
}

/// Inside of other files: the same text as in a model's.
impl Serialize for Rule {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        RuleText::from(self).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Rule {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        RuleText::deserialize(deserializer).map(RuleText::into_rule)
    }
}
