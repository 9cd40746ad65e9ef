//! Partitions of the rows that share the second pass, and their kinds.

use fleetfoot_model::{Partition, Rule};

use crate::{
    PartitionNote, Specification,
    continuous::Ties,
    lattice::{Lattice, Tree},
    refined::Open,
};

/// One kind of partition: made on all rows, and on the training rows of every fold.
pub(crate) struct Candidate {
    pub(crate) specification: Specification,
    /// Index of the partition made on all rows.
    pub(crate) full: usize,
    /// Index of the partition for each fold; the same as `full` where the partition does not depend on the rows.
    pub(crate) by_fold: Vec<usize>,
    /// Free numbers of maps that meet at borders: of all rows, then of every fold. Empty if maps need not meet.
    pub(crate) ties: Vec<Ties>,
    /// Objective of a refinement on all rows, after every pass; empty for other kinds.
    pub(crate) objective: Vec<f64>,
}

impl Candidate {
    /// Free numbers of maps that meet at borders, on the rows that train for `held`.
    pub(crate) fn ties(&self, held: Option<u16>) -> Option<&Ties> {
        let offset = held.map_or(0, |held| 1 + usize::from(held));
        self.ties.get(offset).or(self.ties.first())
    }
}

/// All partitions that share the second pass.
pub(crate) struct Segmentation {
    pub(crate) partitions: Vec<Partition>,
    /// Label column (index into [`Rows::labels`](crate::rows::Rows::labels)) of each partition that has one.
    pub(crate) labels: Vec<Option<usize>>,
    pub(crate) candidates: Vec<Candidate>,
    /// Of each partition, the training set that it was made on: all rows, then those of every fold.
    pub(crate) sets: Vec<usize>,
    /// The cells of all partitions that are joined of cells, of every training set; none where nothing is joined.
    pub(crate) lattices: Vec<Lattice>,
    /// Borders that a pass over all rows draws, and the partitions that have them.
    pub(crate) open: Vec<(usize, Open)>,
    /// Notes for the user.
    pub(crate) notes: Vec<PartitionNote>,
}

impl Segmentation {
    /// No partitions yet, but that of one region, and cells.
    pub(crate) fn of_cells(lattices: Vec<Lattice>) -> Self {
        Self {
            partitions: vec![Partition::whole()],
            labels: vec![None],
            candidates: Vec::new(),
            sets: vec![0],
            lattices,
            open: Vec::new(),
            notes: Vec::new(),
        }
    }

    /// Joins the cells of all partitions that are joined of cells; the trees are that of all rows and those of every fold.
    pub(crate) fn join(&mut self, trees: &[Tree]) {
        for candidate in &self.candidates {
            let Some(k) = candidate.specification.joined() else { continue };
            for (at, tree) in std::iter::once(&candidate.full).chain(&candidate.by_fold).zip(trees) {
                if let Rule::Joined { regions, .. } = &mut self.partitions[*at].rule {
                    *regions = tree.regions(k);
                }
            }
        }
    }
}
