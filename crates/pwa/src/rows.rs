//! The rows of an identification: one design that holds everything the passes need.

use std::ops::Range;

use fleetfoot_data::{Block, Column, Halo, Source};
use fleetfoot_library::{Design, DesignRows, Expr};
use fleetfoot_model::Role;

use crate::{Error, Problem, Specification};

/// The columns of the design, in this order: regressors, targets, states, partition columns, labels, weight.
pub(crate) struct Rows {
    design: Design,
    /// Number of regressors.
    pub(crate) regressors: usize,
    /// Number of targets.
    pub(crate) targets: usize,
    /// Number of states.
    pub(crate) states: usize,
    /// Number of partition columns.
    pub(crate) partition: usize,
    /// Label columns.
    pub(crate) labels: Vec<String>,
    /// The same, as the source describes them.
    pub(crate) label_columns: Vec<Column>,
    weighted: bool,
}

impl Rows {
    pub(crate) fn compile(problem: &Problem, partitions: &[Specification], source: &dyn Source) -> Result<Self, Error> {
        let targets: Vec<&Expr> = problem.equations.iter().filter_map(|equation| equation.target.as_ref()).collect();
        if targets.is_empty() {
            return Err(Error::NothingToFit);
        }
        let states: Vec<Expr> =
            problem.columns.iter().filter(|c| c.role == Role::State).map(|c| Expr::column(c.name.as_str())).collect();
        let mut labels: Vec<String> = partitions.iter().filter_map(|p| p.label().map(str::to_owned)).collect();
        labels.sort();
        labels.dedup();
        let expressions: Vec<Expr> = problem
            .library
            .iter()
            .chain(targets.iter().copied())
            .chain(&states)
            .chain(&problem.partition_columns)
            .cloned()
            .chain(labels.iter().map(|name| Expr::column(name.as_str())))
            .chain(problem.weight.clone())
            .collect();
        let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
        Ok(Self {
            design: Design::compile(&expressions, &names)?,
            regressors: problem.library.len(),
            targets: targets.len(),
            states: states.len(),
            partition: problem.partition_columns.len(),
            label_columns: labels
                .iter()
                .map(|name| {
                    source.column_index(name).map_or_else(|| Column::float(name), |c| source.columns()[c].clone())
                })
                .collect(),
            labels,
            weighted: problem.weight.is_some(),
        })
    }

    pub(crate) fn halo(&self) -> Halo {
        self.design.halo()
    }

    /// Evaluates a tile; refuses negative weights and values whose squares overflow.
    pub(crate) fn evaluate<'t>(
        &'t self,
        block: &Block,
        episode: &str,
        tile: Range<usize>,
        out: &'t mut DesignRows,
    ) -> Result<Tile<'t>, Error> {
        self.design.evaluate_for_squares(block, episode, tile, out)?;
        let tile = Tile { rows: self, values: out };
        if let Some(weights) = tile.weights()
            && let Some(at) = weights.iter().position(|&weight| weight < 0.0)
        {
            return Err(Error::NegativeWeight {
                episode: episode.to_owned(),
                row: block.first + tile.values.index[at],
                value: weights[at],
            });
        }
        Ok(tile)
    }

    /// Number of columns of regressors and targets.
    pub(crate) fn dimension(&self) -> usize {
        self.regressors + self.targets
    }

    /// Number of columns of a row that regions are refined on.
    pub(crate) fn example_columns(&self) -> usize {
        self.example_width() + self.labels.len()
    }

    /// The same without the labels, which come last.
    pub(crate) fn example_width(&self) -> usize {
        self.partition + self.dimension() + usize::from(self.weighted)
    }

    /// Index of the first partition column.
    fn first_partition(&self) -> usize {
        self.dimension() + self.states
    }
}

/// The complete rows of one tile.
pub(crate) struct Tile<'t> {
    rows: &'t Rows,
    pub(crate) values: &'t DesignRows,
}

impl Tile<'_> {
    pub(crate) fn len(&self) -> usize {
        self.values.rows()
    }

    /// Regressors and targets, column-major.
    pub(crate) fn regression(&self) -> &[f64] {
        &self.values.values[..self.rows.dimension() * self.len()]
    }

    /// Targets and states, column-major.
    pub(crate) fn scales(&self) -> &[f64] {
        &self.values.values[self.rows.regressors * self.len()..self.rows.first_partition() * self.len()]
    }

    pub(crate) fn target(&self, target: usize) -> &[f64] {
        self.values.output(self.rows.regressors + target)
    }

    pub(crate) fn regressor(&self, regressor: usize) -> &[f64] {
        self.values.output(regressor)
    }

    pub(crate) fn partition_columns(&self) -> Vec<&[f64]> {
        (0..self.rows.partition).map(|c| self.values.output(self.rows.first_partition() + c)).collect()
    }

    /// Partition columns, regressors, targets, the weight where there are weights, labels.
    pub(crate) fn example(&self) -> Vec<&[f64]> {
        let regression = self.regression().chunks_exact(self.len().max(1));
        let labels = (0..self.rows.labels.len()).map(|label| self.label(label));
        self.partition_columns().into_iter().chain(regression).chain(self.weights()).chain(labels).collect()
    }

    pub(crate) fn label(&self, label: usize) -> &[f64] {
        self.values.output(self.rows.first_partition() + self.rows.partition + label)
    }

    pub(crate) fn weights(&self) -> Option<&[f64]> {
        let last = self.rows.first_partition() + self.rows.partition + self.rows.labels.len();
        self.rows.weighted.then(|| self.values.output(last))
    }
}
