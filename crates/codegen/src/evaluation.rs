//! Some equations of a model taken apart: functions, regions, latents, right sides, and their derivatives.

use fleetfoot_library::{Expr, Leaf, Program, StraightLine, UnknownColumn};
use fleetfoot_model::{Basis, Equation, LatentGroup, Model, RegionSummary, Rule, partitions_in_use};

use crate::ExportError;

/// Stages that equations need, in the order of computation.
pub(crate) struct Evaluation {
    /// The functions in use, group by group, then the columns of the partitions. Behind the functions of a group stand zeros in the place of its basis functions
    /// ([`Evaluation::is_basis`]).
    pub(crate) features: StraightLine,
    /// The same as expressions.
    pub(crate) expressions: Vec<Expr>,
    pub(crate) partitions: Vec<Cells>,
    pub(crate) groups: Vec<Group>,
    /// Right sides over the columns and, behind them, the model's latents.
    pub(crate) rights: StraightLine,
    /// The same as expressions.
    pub(crate) right_sides: Vec<Expr>,
    /// Index among `partitions` of the one whose regions are given; `None` where there is but one region.
    pub(crate) reported: Option<usize>,
    /// Place of each of the model's latents among those in use.
    pub(crate) slots: Vec<Option<usize>>,
}

/// A partition in use with more than one region.
pub(crate) struct Cells {
    pub(crate) partition: usize,
    /// Place of its first column among the features.
    pub(crate) first: usize,
    pub(crate) centre: Vec<f64>,
    pub(crate) scale: Vec<f64>,
    pub(crate) rule: Rule,
}

/// Latents that share a library, a partition and a basis.
pub(crate) struct Group {
    /// Index into [`Evaluation::partitions`]; `None` for one region.
    pub(crate) cells: Option<usize>,
    pub(crate) regions: usize,
    /// Place of its first function among the features.
    pub(crate) first: usize,
    /// Number of functions in use.
    pub(crate) functions: usize,
    /// Place of the first latent among those in use.
    pub(crate) slot: usize,
    pub(crate) names: Vec<String>,
    /// Regions x latents.
    pub(crate) constants: Vec<f64>,
    /// Regions x latents x features: functions in use, then basis functions.
    pub(crate) coefficients: Vec<f64>,
    /// The basis, and the places of its inputs among the functions in use.
    pub(crate) basis: Option<(Basis, Vec<usize>)>,
    /// Regions x functions: smallest and largest value in training.
    pub(crate) ranges: Option<Vec<[f64; 2]>>,
    /// Latents x functions: coefficients outside of the ranges of a region. `None` where a region's own hold everywhere.
    pub(crate) beyond: Option<Vec<f64>>,
}

impl Group {
    /// The latents of a group, the first at `slot` among those in use; its functions begin at `first` among the features.
    fn new(model: &Model, group: &LatentGroup, slot: usize, first: usize) -> Self {
        let LatentGroup { library, partition, latents, functions, basis } = group;
        let all = model.libraries[*library].len();
        let basis_functions = all..all + basis.as_ref().map_or(0, Basis::count);
        let features: Vec<usize> = functions.iter().copied().chain(basis_functions).collect();
        let regions = model.partitions[*partition].rule.count();
        let (mut constants, mut coefficients) = (Vec::new(), Vec::new());
        for region in 0..regions {
            for &latent in latents {
                let map = &model.latents[latent].map;
                constants.push(map.constant(region));
                coefficients.extend(features.iter().map(|&j| map.coefficient(region, j)));
            }
        }
        Self {
            cells: None,
            regions,
            first,
            functions: functions.len(),
            slot,
            names: latents.iter().map(|&latent| model.latents[latent].name.clone()).collect(),
            basis: basis.clone().map(|basis| (basis, group.inputs())),
            ranges: ranges(model, *library, *partition, functions),
            beyond: beyond(model, latents, functions),
            constants,
            coefficients,
        }
    }

    pub(crate) fn latents(&self) -> usize {
        self.names.len()
    }

    /// Number of features: functions in use, then basis functions.
    pub(crate) fn width(&self) -> usize {
        self.functions + self.basis.as_ref().map_or(0, |(basis, _)| basis.count())
    }

    /// Non-zero coefficients of a latent in a region: feature, value.
    pub(crate) fn terms(&self, region: usize, latent: usize) -> impl Iterator<Item = (usize, f64)> {
        let from = (region * self.latents() + latent) * self.width();
        self.coefficients[from..from + self.width()]
            .iter()
            .copied()
            .enumerate()
            .filter(|(_, coefficient)| *coefficient != 0.0)
    }

    /// Returns true if so many coefficients are zero that storing the others with their places is shorter.
    pub(crate) fn is_sparse(&self) -> bool {
        self.basis.is_none()
            && self.beyond.is_none()
            && 2 * self.coefficients.iter().filter(|&&coefficient| coefficient != 0.0).count() < self.coefficients.len()
    }
}

impl Evaluation {
    pub(crate) fn new(model: &Model, equations: &[&Equation]) -> Result<Self, ExportError> {
        let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
        let names: Vec<&str> =
            columns.iter().copied().chain(model.latents.iter().map(|latent| latent.name.as_str())).collect();
        let right_sides: Vec<Expr> = equations.iter().map(|equation| equation.right.clone()).collect();
        let mut expressions = Vec::new();
        let members = model.latent_groups::<ExportError>(&names, equations, None)?;
        let used = partitions_in_use(&members);
        let (mut groups, mut slot) = (Vec::with_capacity(members.len()), 0);
        for group in &members {
            groups.push(Group::new(model, group, slot, expressions.len()));
            slot += group.latents.len();
            expressions.extend(group.functions.iter().map(|&j| model.libraries[group.library][j].clone()));
            let basis_count = group.basis.as_ref().map_or(0, Basis::count);
            expressions.extend(std::iter::repeat_n(Expr::number(0.0), basis_count));
        }
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
        let mut slots = vec![None; model.latents.len()];
        for (group, member) in groups.iter_mut().zip(&members) {
            group.cells = partitions.iter().position(|cells| cells.partition == member.partition);
            member.latents.iter().enumerate().for_each(|(at, &latent)| slots[latent] = Some(group.slot + at));
        }
        let first = model.latents.first().map(|latent| latent.partition);
        // The engine's choice: the partition of the first latent, else the first in use.
        let used_first = first.filter(|partition| members.iter().any(|group| group.partition == *partition));
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

    /// Leaves that read the model's columns.
    pub(crate) fn column_leaves(&self, columns: usize) -> impl Iterator<Item = Leaf> {
        let is_column = move |leaf: &Leaf| !matches!(leaf, Leaf::Column { column, .. } if *column >= columns);
        self.features.leaves.iter().chain(&self.rights.leaves).copied().filter(is_column)
    }

    /// Returns true if a feature is a basis function, which a loop computes.
    pub(crate) fn is_basis(&self, feature: usize) -> bool {
        self.groups.iter().any(|group| (group.first + group.functions..group.first + group.width()).contains(&feature))
    }

    /// Number of latents in use.
    pub(crate) fn latents(&self) -> usize {
        self.groups.iter().map(Group::latents).sum()
    }
}

pub(crate) fn program(expressions: &[Expr], names: &[&str]) -> Result<StraightLine, UnknownColumn> {
    Ok(Program::compile(expressions, names)?.straight_line())
}

/// The coefficients of some latents outside of the ranges of their regions, where they have any.
fn beyond(model: &Model, latents: &[usize], kept: &[usize]) -> Option<Vec<f64>> {
    let has = latents.iter().any(|&latent| !model.latents[latent].beyond.is_empty()) && !kept.is_empty();
    let of = |&latent: &usize| {
        kept.iter().map(move |&j| model.latents[latent].beyond.get(j).copied().unwrap_or(0.0)).collect::<Vec<_>>()
    };
    has.then(|| latents.iter().flat_map(of).collect())
}

/// The training ranges of some functions; `None` where the partition does not describe this library.
fn ranges(model: &Model, library: usize, partition: usize, kept: &[usize]) -> Option<Vec<[f64; 2]>> {
    let owner = model.latents.iter().find(|latent| latent.partition == partition)?;
    let regions: &[RegionSummary] = &model.summaries[partition].regions;
    (owner.library == library && !regions.is_empty() && !kept.is_empty())
        .then(|| regions.iter().flat_map(|region| kept.iter().map(|&j| region.range[j])).collect())
}
