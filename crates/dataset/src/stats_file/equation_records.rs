//! The equations of a statistic, as they stand in the file.

use std::{collections::BTreeMap, sync::Arc};

use fleetfoot_data::EpisodeId;
use fleetfoot_library::{REACHES, Spacing};
use fleetfoot_model::{Branch, Cut, Partition, Rule, Tree, UnseenLabel};
use fleetfoot_stats::scan::{RegionRanges, RowCounts};
use fleetfoot_sums::system::{EpisodeSums, Rate, System, SystemPlan, Weak, WeakTarget};
use fleetfoot_task::{DifferenceErrors, SettledDifference};
use serde::{Deserialize, Serialize};

use super::records::{from_bytes, parse, parse_all, print, print_all, to_bytes};
use crate::statistic_error::StatisticError;

/// All equations: how their derivatives were settled, and the plan of every group.
#[derive(Serialize, Deserialize)]
pub(super) struct EquationsRecord {
    pub(super) differences: Vec<Option<DifferenceRecord>>,
    pub(super) groups: Vec<GroupRecord>,
    /// The windows of every group, where any group has some: they follow the rest, which is alone without them.
    #[serde(skip)]
    pub(super) weak: Vec<Option<WeakRecord>>,
}

impl EquationsRecord {
    /// The bytes of what a statistic has of equations, if it has some.
    pub(super) fn to_bytes(equations: Option<&Self>) -> Vec<u8> {
        let mut bytes = to_bytes(&equations);
        if let Some(weak) = equations.map(|equations| &equations.weak).filter(|weak| weak.iter().any(Option::is_some)) {
            bytes.extend(to_bytes(weak));
        }
        bytes
    }

    /// Reads the bytes of [`EquationsRecord::to_bytes`].
    pub(super) fn from_bytes(bytes: &[u8]) -> Result<Option<Self>, String> {
        let (mut equations, rest) =
            postcard::take_from_bytes::<Option<Self>>(bytes).map_err(|error| error.to_string())?;
        if let (Some(equations), 1..) = (&mut equations, rest.len()) {
            equations.weak = from_bytes(rest)?;
            if equations.weak.len() != equations.groups.len() {
                return Err("there are other windows than groups".into());
            }
        } else if !rest.is_empty() {
            return Err(format!("{} bytes too many", rest.len()));
        }
        Ok(equations)
    }
}

/// Settled difference formula of a derivative.
#[derive(Serialize, Deserialize)]
pub(super) struct DifferenceRecord {
    reach: u8,
    even: bool,
    /// Errors of orders 2, 4 and 6, then truncation and noise of the order used.
    errors: Option<[f64; 5]>,
}

/// The plan of a group as texts.
#[derive(Serialize, Deserialize)]
pub(super) struct GroupRecord {
    chunk_rows: u64,
    functions: Vec<String>,
    targets: Vec<String>,
    also: Vec<String>,
    sampled: Vec<String>,
    weight: Option<String>,
    partition: Option<PartitionRecord>,
    coordinates: Vec<u8>,
}

/// The windows of a group.
#[derive(Serialize, Deserialize)]
pub(super) struct WeakRecord {
    reach: u64,
    accuracy: f64,
    /// For each target: the expression with a rate and true if it is an angle (if there is one), and the expression
    /// that is averaged.
    targets: Vec<(Option<(String, bool)>, String)>,
}

#[derive(Serialize, Deserialize)]
struct PartitionRecord {
    specification: String,
    columns: Vec<String>,
    centre: Vec<f64>,
    scale: Vec<f64>,
    rule: RuleRecord,
}

/// A rule; within labels stand rules without labels, so that nothing is nested deeper.
#[derive(Serialize, Deserialize)]
enum RuleRecord {
    Plain(PlainRule),
    Labels { values: Vec<f64>, names: Vec<String>, rules: Vec<PlainRule>, pool: bool },
}

#[derive(Serialize, Deserialize)]
enum PlainRule {
    Whole,
    Ball(f64),
    Linear(Vec<Vec<f64>>, Vec<f64>),
    /// Weights and offsets of the cells, and the region of each.
    Joined(Vec<Vec<f64>>, Vec<f64>, Vec<u32>),
    /// Of every cut the column, the threshold, and what follows below and above: a cut, or `-1 - region`.
    Tree(Vec<(u32, f64, i64, i64)>),
    Box(f64),
}

/// Counts and ranges of an episode.
#[derive(Serialize, Deserialize)]
pub(super) struct EpisodeSumsRecord {
    id: [u8; 16],
    /// Complete, at the border, incomplete, unassigned.
    counts: [u64; 4],
    ranges: Vec<Vec<[f64; 2]>>,
}

impl DifferenceRecord {
    pub(super) fn new(settled: &SettledDifference) -> Self {
        let numbers = |errors: DifferenceErrors| {
            let [second, fourth, sixth] = errors.by_order;
            [second, fourth, sixth, errors.truncation, errors.noise]
        };
        Self { reach: settled.reach as u8, even: settled.spacing == Spacing::Even, errors: settled.errors.map(numbers) }
    }

    pub(super) fn into_settled(self) -> Result<SettledDifference, String> {
        let reach = usize::from(self.reach);
        if !REACHES.contains(&reach) {
            return Err(format!("a difference over {reach} rows"));
        }
        let errors = |[second, fourth, sixth, truncation, noise]: [f64; 5]| {
            DifferenceErrors::new(2 * reach, [second, fourth, sixth], [truncation, noise])
        };
        let spacing = if self.even { Spacing::Even } else { Spacing::Stamps };
        Ok(SettledDifference { reach, spacing, errors: self.errors.map(errors) })
    }
}

impl WeakRecord {
    pub(super) fn new(weak: &Weak) -> Result<Self, StatisticError> {
        let rate = |rate: &Rate| Ok::<_, StatisticError>((print(&rate.of)?, rate.angle));
        let target = |target: &WeakTarget| Ok((target.rate.as_ref().map(rate).transpose()?, print(&target.mean)?));
        let targets = weak.targets.iter().map(target).collect::<Result<_, StatisticError>>()?;
        Ok(Self { reach: weak.reach as u64, accuracy: weak.accuracy, targets })
    }

    fn into_weak(self) -> Result<Weak, String> {
        let rate = |(of, angle): (String, bool)| Ok::<_, String>(Rate { of: parse(&of)?, angle });
        let target = |(left, mean): (Option<(String, bool)>, String)| {
            Ok::<_, String>(WeakTarget { rate: left.map(rate).transpose()?, mean: parse(&mean)? })
        };
        let targets = self.targets.into_iter().map(target).collect::<Result<_, _>>()?;
        let reach = u32::try_from(self.reach).map_err(|error| error.to_string())? as usize;
        if !(self.accuracy >= 0.0 && self.accuracy.is_finite()) {
            return Err(format!("windows whose integrals err by {}", self.accuracy));
        }
        Ok(Weak { reach, targets, accuracy: self.accuracy })
    }
}

impl GroupRecord {
    pub(super) fn new(plan: &SystemPlan) -> Result<Self, StatisticError> {
        // The weak form stands in a record of its own.
        let System { functions, targets, also, sampled, weight, partition, weak: _ } = &plan.system;
        Ok(Self {
            chunk_rows: plan.chunk_rows as u64,
            functions: print_all(functions)?,
            targets: print_all(targets)?,
            also: print_all(also)?,
            sampled: print_all(sampled)?,
            weight: weight.as_ref().map(print).transpose()?,
            partition: partition.as_ref().map(PartitionRecord::new).transpose()?,
            coordinates: plan.coordinates(),
        })
    }

    /// `weak`: the windows of the group.
    pub(super) fn into_plan(self, weak: Option<WeakRecord>) -> Result<SystemPlan, String> {
        let mut system = System::new(parse_all(&self.functions)?, parse_all(&self.targets)?);
        system.also = parse_all(&self.also)?;
        system.sampled = parse_all(&self.sampled)?;
        system.weight = self.weight.as_deref().map(parse).transpose()?;
        system.partition = self.partition.map(PartitionRecord::into_partition).transpose()?;
        system.weak = weak.map(WeakRecord::into_weak).transpose()?;
        let chunk_rows = usize::try_from(self.chunk_rows).map_err(|error| error.to_string())?;
        SystemPlan::of_coordinates(system, chunk_rows, &self.coordinates).map_err(|error| error.to_string())
    }
}

impl PartitionRecord {
    fn new(partition: &Partition) -> Result<Self, StatisticError> {
        let rule = match &partition.rule {
            Rule::Labels { values, names, rules, unseen } => RuleRecord::Labels {
                values: values.clone(),
                names: names.clone(),
                rules: rules.iter().map(PlainRule::new).collect(),
                pool: *unseen == UnseenLabel::Pool,
            },
            plain => RuleRecord::Plain(PlainRule::new(plain)),
        };
        Ok(Self {
            specification: partition.specification.clone(),
            columns: print_all(&partition.columns)?,
            centre: partition.centre.clone(),
            scale: partition.scale.clone(),
            rule,
        })
    }

    fn into_partition(self) -> Result<Partition, String> {
        let columns = parse_all(&self.columns)?;
        let rule = match self.rule {
            RuleRecord::Plain(rule) => rule.into_rule(columns.len())?,
            RuleRecord::Labels { values, names, rules, pool } => {
                let others = columns.len().checked_sub(1).ok_or("a partition by labels without a column")?;
                if names.len() != values.len() || rules.len() != values.len() {
                    return Err("a partition by labels with other names than values".into());
                }
                let rules = rules.into_iter().map(|rule| rule.into_rule(others)).collect::<Result<_, _>>()?;
                let unseen = if pool { UnseenLabel::Pool } else { UnseenLabel::Refuse };
                Rule::Labels { values, names, rules, unseen }
            }
        };
        let Self { specification, centre, scale, .. } = self;
        Ok(Partition { specification, columns, centre, scale, rule, ..Partition::whole() })
    }
}

impl PlainRule {
    /// Of a rule that has no labels.
    fn new(rule: &Rule) -> Self {
        match rule {
            Rule::Ball { radius } => Self::Ball(*radius),
            Rule::Box { half } => Self::Box(*half),
            Rule::Linear { weights, offsets } => Self::Linear(weights.clone(), offsets.clone()),
            Rule::Joined { cells, regions } => match &**cells {
                Rule::Linear { weights, offsets } => Self::Joined(weights.clone(), offsets.clone(), regions.clone()),
                _ => Self::Whole,
            },
            Rule::Tree(tree) => {
                let record = |cut: &Cut| (cut.column as u32, cut.threshold, cut.below.code(), cut.above.code());
                Self::Tree(tree.cuts.iter().map(record).collect())
            }
            Rule::Whole | Rule::Labels { .. } => Self::Whole,
        }
    }

    fn into_rule(self, columns: usize) -> Result<Rule, String> {
        match self {
            Self::Whole => Ok(Rule::Whole),
            Self::Ball(radius) => Ok(Rule::Ball { radius }),
            Self::Box(half) => Ok(Rule::Box { half }),
            Self::Linear(weights, offsets) => {
                if weights.len() != offsets.len() || weights.iter().any(|row| row.len() != columns) {
                    return Err(format!("a partition over {columns} columns has weights of others"));
                }
                Ok(Rule::Linear { weights, offsets })
            }
            Self::Joined(weights, offsets, regions) => {
                if weights.len() != regions.len() {
                    return Err(format!("{} of {} cells have a region", regions.len(), weights.len()));
                }
                let cells = Arc::new(Self::Linear(weights, offsets).into_rule(columns)?);
                Ok(Rule::Joined { cells, regions })
            }
            Self::Tree(records) => {
                let branch = |code| Branch::of_code(code).ok_or_else(|| format!("no branch is {code}"));
                let cut = |(column, threshold, below, above): (u32, f64, i64, i64)| {
                    let (below, above) = (branch(below)?, branch(above)?);
                    Ok::<_, String>(Cut { column: column as usize, threshold, below, above })
                };
                let tree = Tree { cuts: records.into_iter().map(cut).collect::<Result<_, _>>()? };
                tree.check(columns)?;
                Ok(Rule::Tree(tree))
            }
        }
    }
}

impl EpisodeSumsRecord {
    pub(super) fn all(episodes: &BTreeMap<EpisodeId, EpisodeSums>) -> Vec<Self> {
        let of = |(id, sums): (&EpisodeId, &EpisodeSums)| {
            let RowCounts { complete, at_border, incomplete } = sums.counts;
            let counts = [complete, at_border, incomplete, sums.unassigned];
            Self { id: id.0.to_le_bytes(), counts, ranges: sums.ranges.0.clone() }
        };
        episodes.iter().map(of).collect()
    }

    pub(super) fn into_episodes(records: Vec<Self>) -> BTreeMap<EpisodeId, EpisodeSums> {
        let of = |record: Self| {
            let [complete, at_border, incomplete, unassigned] = record.counts;
            let counts = RowCounts { complete, at_border, incomplete };
            let id = EpisodeId(u128::from_le_bytes(record.id));
            (id, EpisodeSums { counts, unassigned, ranges: RegionRanges(record.ranges) })
        };
        records.into_iter().map(of).collect()
    }
}
