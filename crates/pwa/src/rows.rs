//! The rows of an identification: one set of columns that holds everything the passes need.

use fleetfoot_data::{Column, Halo, Source};
use fleetfoot_library::Expr;
use fleetfoot_model::Role;
use fleetfoot_stats::{
    Preconditioner,
    scan::{self, Columns},
};

use crate::{Error, Options, Problem};

/// Groups of columns, in their order.
const REGRESSORS: usize = 0;
const TARGETS: usize = 1;
const STATES: usize = 2;
const PARTITION: usize = 3;
const LABELS: usize = 4;
const PHASE: usize = 5;

/// Layout of the columns of the rows.
pub(crate) struct Rows {
    /// Regressors, targets, states, partition columns, labels, the phase where there is one, and the weight.
    pub(crate) columns: Columns,
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
    pub(crate) fn compile(problem: &Problem, options: &Options, source: &dyn Source) -> Result<Self, Error> {
        let targets: Vec<Expr> = problem.equations.iter().filter_map(|equation| equation.target.clone()).collect();
        if targets.is_empty() {
            return Err(Error::NothingToFit);
        }
        let states: Vec<Expr> =
            problem.columns.iter().filter(|c| c.role == Role::State).map(|c| Expr::column(c.name.as_str())).collect();
        let mut labels: Vec<String> = options.partitions.iter().filter_map(|p| p.label().map(str::to_owned)).collect();
        labels.sort();
        labels.dedup();
        let of_labels: Vec<Expr> = labels.iter().map(|name| Expr::column(name.as_str())).collect();
        let phase: Vec<Expr> = options.phase.iter().map(|phase| phase.column.clone()).collect();
        let groups: [&[Expr]; 6] =
            [&problem.library, &targets, &states, &problem.partition_columns, &of_labels, &phase];
        Ok(Self {
            columns: Columns::compile(&groups, problem.weight.as_ref(), source)?,
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
        self.columns.halo()
    }

    /// Coordinates of regressors and targets, from a pilot sample of the rows.
    pub(crate) fn coordinates(&self, source: &dyn Source) -> Result<Preconditioner, Error> {
        let pilot = self.columns.pilot::<Error>(REGRESSORS..TARGETS + 1, source)?;
        Ok(Preconditioner::of_pilot(&pilot, self.regressors))
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
}

/// The complete rows of one tile.
pub(crate) struct Tile<'t>(scan::Tile<'t>);

impl<'t> Tile<'t> {
    /// The columns of a tile by their names.
    pub(crate) fn new(columns: &scan::Tile<'t>) -> Self {
        Self(*columns)
    }

    pub(crate) fn len(&self) -> usize {
        self.0.len()
    }

    /// The core rows of the block that they are.
    pub(crate) fn index(&self) -> &'t [usize] {
        self.0.index()
    }

    /// Regressors and targets, column-major.
    pub(crate) fn regression(&self) -> &'t [f64] {
        self.0.values(REGRESSORS..TARGETS + 1)
    }

    /// Targets, then states.
    pub(crate) fn scales(&self) -> Vec<&'t [f64]> {
        self.0.columns(TARGETS..STATES + 1)
    }

    pub(crate) fn targets(&self) -> Vec<&'t [f64]> {
        self.0.columns(TARGETS..TARGETS + 1)
    }

    pub(crate) fn regressors(&self) -> Vec<&'t [f64]> {
        self.0.columns(REGRESSORS..REGRESSORS + 1)
    }

    pub(crate) fn partition_columns(&self) -> Vec<&'t [f64]> {
        self.0.columns(PARTITION..PARTITION + 1)
    }

    pub(crate) fn labels(&self) -> Vec<&'t [f64]> {
        self.0.columns(LABELS..LABELS + 1)
    }

    /// The phase, where there is one.
    pub(crate) fn phase(&self) -> Option<&'t [f64]> {
        self.0.columns(PHASE..PHASE + 1).pop()
    }

    /// Partition columns, regressors, targets, the weight where there are weights, labels.
    pub(crate) fn example(&self) -> Vec<&'t [f64]> {
        let regression = self.0.columns(REGRESSORS..TARGETS + 1);
        self.partition_columns().into_iter().chain(regression).chain(self.weights()).chain(self.labels()).collect()
    }

    /// Partition columns, and a label if there is one.
    pub(crate) fn places(&self, label: Option<usize>) -> Vec<&'t [f64]> {
        let label = label.map(|label| self.labels()[label]);
        self.partition_columns().into_iter().chain(label).collect()
    }

    pub(crate) fn weights(&self) -> Option<&'t [f64]> {
        self.0.weights()
    }
}
