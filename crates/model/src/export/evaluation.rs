//! Some equations of a model taken apart: functions, regions, latents, right sides, and their derivatives.

use std::collections::BTreeMap;

use fleetfoot_library::{Expr, Leaf, Program, StraightLine, UnknownColumn};

use super::ExportError;
use crate::{Equation, Model, Region, Rule};

/// What equations need, stage by stage, in the order in which it is computed.
pub(super) struct Evaluation {
    /// The functions in use, group by group, then the columns of the partitions.
    pub(super) features: StraightLine,
    /// The same as expressions.
    pub(super) expressions: Vec<Expr>,
    pub(super) partitions: Vec<Cells>,
    pub(super) groups: Vec<Group>,
    /// Right sides over the columns and, behind them, the model's latents.
    pub(super) rights: StraightLine,
    /// The same as expressions.
    pub(super) right_sides: Vec<Expr>,
    /// Index among `partitions` of the one whose regions are given; `None` where there is but one region.
    pub(super) reported: Option<usize>,
    /// Place of each of the model's latents among those in use.
    pub(super) slots: Vec<Option<usize>>,
}

/// A partition in use with more than one region.
pub(super) struct Cells {
    pub(super) partition: usize,
    /// Where its columns stand among the features.
    pub(super) first: usize,
    pub(super) centre: Vec<f64>,
    pub(super) scale: Vec<f64>,
    pub(super) rule: Rule,
}

/// Latents that share a library and a partition.
pub(super) struct Group {
    /// Index into [`Evaluation::partitions`]; `None` for one region.
    pub(super) cells: Option<usize>,
    pub(super) regions: usize,
    /// Where its functions stand among the features.
    pub(super) first: usize,
    /// Number of functions in use.
    pub(super) functions: usize,
    /// Place of the first latent among those in use.
    pub(super) slot: usize,
    pub(super) names: Vec<String>,
    /// Regions x latents.
    pub(super) constants: Vec<f64>,
    /// Regions x latents x functions.
    pub(super) coefficients: Vec<f64>,
    /// Regions x functions: smallest and largest value in training.
    pub(super) ranges: Option<Vec<[f64; 2]>>,
}

impl Group {
    pub(super) fn latents(&self) -> usize {
        self.names.len()
    }

    /// Non-zero coefficients of a latent in a region: function, value.
    pub(super) fn terms(&self, region: usize, latent: usize) -> impl Iterator<Item = (usize, f64)> {
        let from = (region * self.latents() + latent) * self.functions;
        self.coefficients[from..from + self.functions]
            .iter()
            .copied()
            .enumerate()
            .filter(|(_, coefficient)| *coefficient != 0.0)
    }

    /// Whether so many coefficients are zero that storing the others with their places is shorter.
    pub(super) fn is_sparse(&self) -> bool {
        2 * self.coefficients.iter().filter(|&&coefficient| coefficient != 0.0).count() < self.coefficients.len()
    }
}

impl Evaluation {
    pub(super) fn new(model: &Model, equations: &[&Equation]) -> Result<Self, ExportError> {
        let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
        let names: Vec<&str> =
            columns.iter().copied().chain(model.latents.iter().map(|latent| latent.name.as_str())).collect();
        let right_sides: Vec<Expr> = equations.iter().map(|equation| equation.right.clone()).collect();
        let needed = needed(model, &names, equations)?;
        let mut expressions = Vec::new();
        let (mut groups, used) = groups(model, &needed, &mut expressions);
        let first_used = used.first().copied();
        let mut partitions = Vec::new();
        for index in used {
            let partition = &model.partitions[index];
            if partition.rule != Rule::Whole {
                partitions.push(Cells {
                    partition: index,
                    first: expressions.len(),
                    centre: partition.centre.clone(),
                    scale: partition.scale.clone(),
                    rule: partition.rule.clone(),
                });
                expressions.extend(partition.columns.iter().cloned());
            }
        }
        for (group, partition) in &mut groups {
            group.cells = partitions.iter().position(|cells| cells.partition == *partition);
        }
        let first = model.latents.first().map(|latent| latent.partition);
        let mut slots = vec![None; model.latents.len()];
        let groups: Vec<Group> = groups.into_iter().map(|(group, _)| group).collect();
        for group in &groups {
            for (at, name) in group.names.iter().enumerate() {
                if let Some(latent) = model.latents.iter().position(|latent| latent.name == *name) {
                    slots[latent] = Some(group.slot + at);
                }
            }
        }
        // The engine's choice: the partition of the first latent, else the first in use.
        let used_first = first.filter(|&p| (0..needed.len()).any(|l| needed[l] && model.latents[l].partition == p));
        let reported = match used_first {
            Some(partition) => partitions.iter().position(|cells| cells.partition == partition),
            None => first_used.and_then(|partition| partitions.iter().position(|cells| cells.partition == partition)),
        };
        Ok(Self {
            features: program(&expressions, &columns)?,
            rights: program(&right_sides, &names)?,
            expressions,
            partitions,
            groups,
            right_sides,
            reported,
            slots,
        })
    }

    /// What is read of the model's columns.
    pub(super) fn column_leaves(&self, columns: usize) -> impl Iterator<Item = Leaf> {
        let is_column = move |leaf: &Leaf| !matches!(leaf, Leaf::Column { column, .. } if *column >= columns);
        self.features.leaves.iter().chain(&self.rights.leaves).copied().filter(is_column)
    }

    /// Number of latents in use.
    pub(super) fn latents(&self) -> usize {
        self.groups.iter().map(Group::latents).sum()
    }
}

pub(super) fn program(expressions: &[Expr], names: &[&str]) -> Result<StraightLine, UnknownColumn> {
    Ok(Program::compile(expressions, names)?.straight_line())
}

/// Which latents the right sides speak of.
fn needed(model: &Model, names: &[&str], equations: &[&Equation]) -> Result<Vec<bool>, ExportError> {
    let columns = model.columns.len();
    let mut needed = vec![false; model.latents.len()];
    for equation in equations {
        let right = Program::compile(std::slice::from_ref(&equation.right), names)?;
        for leaf in right.leaves() {
            if let Leaf::Column { column, lag } = *leaf
                && column >= columns
            {
                if lag != 0 {
                    let latent = names[column].to_owned();
                    return Err(ExportError::LaggedLatent { equation: equation.label(), latent, lag });
                }
                needed[column - columns] = true;
            }
        }
    }
    Ok(needed)
}

/// Groups the needed latents by library and partition, each with its partition's index, and lists the functions that they
/// use. Also gives the partitions in use.
fn groups(model: &Model, needed: &[bool], expressions: &mut Vec<Expr>) -> (Vec<(Group, usize)>, Vec<usize>) {
    let mut members: BTreeMap<(usize, usize), Vec<usize>> = BTreeMap::new();
    for latent in (0..needed.len()).filter(|&latent| needed[latent]) {
        members.entry((model.latents[latent].library, model.latents[latent].partition)).or_default().push(latent);
    }
    let mut used: Vec<usize> = members.keys().map(|key| key.1).collect();
    used.sort_unstable();
    used.dedup();
    let mut slot = 0;
    let groups = members
        .into_iter()
        .map(|((library, partition), latents)| {
            let functions = &model.libraries[library];
            let in_use = |j: usize| {
                latents.iter().any(|&latent| model.latents[latent].coefficients.iter().any(|region| region[j] != 0.0))
            };
            let kept: Vec<usize> = (0..functions.len()).filter(|&j| in_use(j)).collect();
            let first = expressions.len();
            expressions.extend(kept.iter().map(|&j| functions[j].clone()));
            let regions = model.partitions[partition].rule.count();
            let (mut constants, mut coefficients) = (Vec::new(), Vec::new());
            for region in 0..regions {
                for &latent in &latents {
                    constants.push(model.latents[latent].constants[region]);
                    let row = &model.latents[latent].coefficients[region];
                    coefficients.extend(kept.iter().map(|&j| row[j]));
                }
            }
            let names: Vec<String> = latents.iter().map(|&latent| model.latents[latent].name.clone()).collect();
            slot += names.len();
            let group = Group {
                cells: None,
                regions,
                first,
                functions: kept.len(),
                slot: slot - names.len(),
                ranges: ranges(model, library, partition, &kept),
                names,
                constants,
                coefficients,
            };
            (group, partition)
        })
        .collect();
    (groups, used)
}

/// The training ranges of some functions; `None` where the partition does not describe this library.
fn ranges(model: &Model, library: usize, partition: usize, kept: &[usize]) -> Option<Vec<[f64; 2]>> {
    let owner = model.latents.iter().find(|latent| latent.partition == partition)?;
    let regions: &[Region] = &model.partitions[partition].regions;
    (owner.library == library && !regions.is_empty() && !kept.is_empty())
        .then(|| regions.iter().flat_map(|region| kept.iter().map(|&j| region.range[j])).collect())
}
