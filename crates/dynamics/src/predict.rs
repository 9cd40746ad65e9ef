//! One-step prediction: per row the measured target, the prediction, the region and the distance from the training domain.

use std::ops::Range;

use fleetfoot_data::{Block, Halo};
use fleetfoot_library::{Expr, Leaf, Program, Scratch};
use fleetfoot_model::{Equation, Model, Prediction};

use crate::{
    Domain, Error,
    angle::wrap,
    compiled::{Compiled, Latents, Workspace},
    domain::TrainingDomain,
};

/// Why a row was or was not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RowStatus {
    /// Target and prediction are there.
    #[default]
    Complete,
    /// A lag or a lead of the target or the regressors would cross the border of the episode.
    Border,
    /// A value that the target or the regressors need is missing or not finite.
    Missing,
    /// The row's label was not seen in training.
    NoRegion,
    /// The model gives no finite number for finite values (a division by zero, an overflow).
    NonFinite,
}

/// A model compiled to predict the fitted equations on the rows of a source.
pub struct Predictor {
    compiled: Compiled,
    targets: Program,
    wrapped: Vec<bool>,
    names: Vec<String>,
    /// Groups of latents that have statistics.
    domains: Vec<(usize, TrainingDomain)>,
    /// The first latent's group.
    reported: Option<usize>,
    halo: Halo,
}

/// Predictions of consecutive rows. Values of several equations stand one equation after the other, `rows` each.
#[derive(Debug, Clone, Default)]
pub struct Predicted {
    /// Number of rows.
    pub rows: usize,
    /// Status of each row.
    pub status: Vec<RowStatus>,
    /// Measured targets, equations x rows; NaN where they cannot be measured.
    pub measured: Vec<f64>,
    /// Predictions, equations x rows; there also where only the target is missing, else NaN.
    pub predicted: Vec<f64>,
    /// Measured minus predicted, wrapped to (-pi, pi] for angles.
    pub residual: Vec<f64>,
    /// Region of each row in the first latent's partition; `u32::MAX` for none.
    pub region: Vec<u32>,
    /// Mahalanobis distance of the regressors from their region's mean under the region's covariance, of the latent that is farthest; NaN without a prediction.
    pub distance: Vec<f64>,
    /// The same distance under the covariance of all training rows.
    pub centre_distance: Vec<f64>,
    /// Position of each row relative to the training range.
    pub domain: Vec<Domain>,
}

impl Predicted {
    /// The values of one equation within [`Self::measured`], [`Self::predicted`] or [`Self::residual`].
    pub fn equation(values: &[f64], rows: usize, equation: usize) -> &[f64] {
        &values[equation * rows..(equation + 1) * rows]
    }

    /// Returns true if a row has a finite prediction for every equation; its target need not be measured.
    pub fn is_predicted(&self, row: usize) -> bool {
        let equations = self.predicted.len() / self.rows.max(1);
        (0..equations).all(|equation| self.predicted[equation * self.rows + row].is_finite())
    }

    fn reset(&mut self, rows: usize, equations: usize) {
        self.rows = rows;
        self.status.clear();
        self.status.resize(rows, RowStatus::Border);
        for values in [&mut self.measured, &mut self.predicted, &mut self.residual] {
            values.clear();
            values.resize(rows * equations, f64::NAN);
        }
        for values in [&mut self.distance, &mut self.centre_distance] {
            values.clear();
            values.resize(rows, f64::NAN);
        }
        self.region.clear();
        self.region.resize(rows, u32::MAX);
        self.domain.clear();
        self.domain.resize(rows, Domain::Inside);
    }
}

/// Memory of [`Predictor::predict`], reused from tile to tile.
#[derive(Default)]
pub struct PredictorWorkspace {
    model: Workspace,
    targets: Vec<f64>,
    complete: Vec<bool>,
    features: Vec<f64>,
    place: Vec<f64>,
    scratch: Scratch,
}

impl Predictor {
    /// Compiles the fitted equations of a model for a source with these columns, which are the model's columns in any
    /// order. Columns that only targets read may be absent: these targets are then not measured.
    ///
    /// # Errors
    /// [`Error::NothingFitted`], [`Error::UnknownColumn`], [`Error::Inconsistent`], [`Error::LaggedLatent`].
    pub fn new(model: &Model, source_columns: &[&str]) -> Result<Self, Error> {
        model.validate().map_err(Error::Inconsistent)?;
        let equations: Vec<&Equation> = model.fitted().collect();
        if equations.is_empty() {
            return Err(Error::NothingFitted);
        }
        let first = model.latents.first().map(|latent| latent.library);
        let compiled = Compiled::new(model, source_columns, &equations, first)?;
        // Columns that the source lacks were not measured; the predictions are there all the same.
        let known = |target: &Expr| target.columns().iter().all(|name| source_columns.contains(&&**name));
        let target = |target: &Expr| if known(target) { target.clone() } else { Expr::number(f64::NAN) };
        let targets: Vec<Expr> = equations.iter().filter_map(|equation| equation.target.as_ref()).map(target).collect();
        let targets = Program::compile(&targets, source_columns)?;
        let halo = [compiled.functions.halo(), compiled.rights.halo(), targets.halo()]
            .iter()
            .fold(Halo::default(), |a, b| Halo { before: a.before.max(b.before), after: a.after.max(b.after) });
        let reported = model.latents.first().and_then(|latent| {
            compiled.groups.iter().position(|group| {
                group.library == latent.library && compiled.partitions[group.regions].partition == latent.partition
            })
        });
        let domain = |(at, group): (usize, &Latents)| {
            let partition = compiled.partitions[group.regions].partition;
            Some((at, TrainingDomain::new(model, group.library, partition, &group.kept)?))
        };
        let domains = compiled.groups.iter().enumerate().filter_map(domain).collect();
        Ok(Self {
            targets,
            wrapped: equations.iter().map(|equation| wraps(model, equation)).collect(),
            names: model.outputs(),
            domains,
            reported,
            halo,
            compiled,
        })
    }

    /// Neighbouring rows that must be read along with every range.
    pub fn halo(&self) -> Halo {
        self.halo
    }

    /// The left sides of the fitted equations, in order.
    pub fn names(&self) -> &[String] {
        &self.names
    }

    /// Returns true if the errors of an equation are angles.
    pub fn wrapped(&self, equation: usize) -> bool {
        self.wrapped[equation]
    }

    /// Predicts the core rows `rows` of a block. `out` is overwritten; the same rows give the same bits in any block and tile.
    pub fn predict(&self, block: &Block, rows: Range<usize>, workspace: &mut PredictorWorkspace, out: &mut Predicted) {
        let equations = self.names.len();
        out.reset(rows.len(), equations);
        let measurable = overlap(&rows, &self.targets.valid_rows(block));
        if !measurable.is_empty() {
            let (count, offset) = (measurable.len(), measurable.start - rows.start);
            workspace.targets.resize(count * equations, 0.0);
            self.targets.evaluate_block(
                block,
                measurable.clone(),
                &mut workspace.targets,
                count,
                &mut workspace.scratch,
            );
            for (target, values) in workspace.targets.chunks_exact(count).enumerate() {
                out.measured[target * rows.len() + offset..][..count].copy_from_slice(values);
            }
        }
        let predictable = overlap(&rows, &valid_rows(&self.compiled, block));
        if predictable.is_empty() {
            return;
        }
        self.evaluate(block, &predictable, &mut workspace.model);
        let shift = predictable.start - rows.start;
        self.finite_rows(predictable.len(), workspace);
        for row in 0..predictable.len() {
            let global = predictable.start + row;
            let inside = measurable.contains(&global);
            out.status[shift + row] = self.finish_row(workspace, row, shift + row, inside, out);
        }
        for (group, domain) in &self.domains {
            fleetfoot_data::arch().dispatch(Places {
                group: &self.compiled.groups[*group],
                domain,
                rows: predictable.len(),
                shift,
                workspace,
                out,
            });
        }
    }

    fn evaluate(&self, block: &Block, rows: &Range<usize>, workspace: &mut Workspace) {
        let has_time = |program: &Program| program.leaves().iter().any(|leaf| matches!(leaf, Leaf::Time { .. }));
        let seconds = if has_time(&self.compiled.functions) || has_time(&self.compiled.rights) {
            block.seconds()
        } else {
            Vec::new()
        };
        let shifted = |lag: i32| ((block.before + rows.start) as i64 - i64::from(lag)) as usize;
        let leaf = |leaf: Leaf| match leaf {
            Leaf::Column { column, lag } => &block.column(column)[shifted(lag)..][..rows.len()],
            Leaf::Time { lag } => &seconds[shifted(lag)..][..rows.len()],
        };
        self.compiled.evaluate(rows.len(), &leaf, workspace);
    }

    /// Marks the rows whose functions and partition columns are all finite.
    fn finite_rows(&self, rows: usize, workspace: &mut PredictorWorkspace) {
        workspace.complete.clear();
        workspace.complete.resize(rows, true);
        let outputs = self.compiled.functions.outputs();
        for column in workspace.model.values.chunks_exact(workspace.model.stride).take(outputs) {
            for (complete, value) in workspace.complete.iter_mut().zip(column) {
                *complete &= value.is_finite();
            }
        }
    }

    /// Copies the predictions of a row, and sets its status.
    fn finish_row(
        &self,
        workspace: &PredictorWorkspace,
        row: usize,
        at: usize,
        measurable: bool,
        out: &mut Predicted,
    ) -> RowStatus {
        let model = &workspace.model;
        let border = if measurable { RowStatus::Complete } else { RowStatus::Border };
        if !workspace.complete[row] {
            return if measurable { RowStatus::Missing } else { border };
        }
        if model.regions.iter().any(|regions| regions[row] == u32::MAX) {
            return if measurable { RowStatus::NoRegion } else { border };
        }
        let regions = self.reported.map_or(0, |group| self.compiled.groups[group].regions);
        out.region[at] = model.regions.get(regions).map_or(0, |regions| regions[row]);
        let (mut finite, mut measured) = (true, true);
        for equation in 0..self.names.len() {
            let index = equation * out.rows + at;
            let prediction = model.outputs[equation * model.stride + row];
            let error = out.measured[index] - prediction;
            out.predicted[index] = prediction;
            out.residual[index] = if self.wrapped[equation] { wrap(error) } else { error };
            finite &= prediction.is_finite();
            measured &= out.measured[index].is_finite();
        }
        match (measurable, measured, finite) {
            (false, ..) => RowStatus::Border,
            (_, false, _) => RowStatus::Missing,
            (.., false) => RowStatus::NonFinite,
            _ => RowStatus::Complete,
        }
    }
}

/// Measures the rows' places in the training domain, with the widest vectors of the machine.
struct Places<'a> {
    group: &'a Latents,
    domain: &'a TrainingDomain,
    rows: usize,
    /// Row of `out` that holds the first one.
    shift: usize,
    workspace: &'a mut PredictorWorkspace,
    out: &'a mut Predicted,
}

impl pulp::WithSimd for Places<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, simd: S) {
        let PredictorWorkspace { model, features, place, .. } = self.workspace;
        features.clear();
        features.resize(self.domain.width(), 0.0);
        place.clear();
        place.resize(self.domain.scratch(), 0.0);
        for row in 0..self.rows {
            let at = self.shift + row;
            let region = match model.regions.get(self.group.regions) {
                // A row without a prediction has no place.
                _ if self.out.region[at] == u32::MAX => continue,
                Some(regions) => regions[row] as usize,
                None => 0,
            };
            if region >= self.domain.regions() {
                continue;
            }
            for (j, feature) in features[..self.group.kept.len()].iter_mut().enumerate() {
                *feature = model.values[(self.group.first + j) * model.stride + row];
            }
            let place_in_domain = self.domain.place(simd, region, features, place);
            // A model is as far from its training as the worst of its latents; a maximum leaves NaN behind.
            self.out.distance[at] = self.out.distance[at].max(place_in_domain.distance);
            self.out.centre_distance[at] = self.out.centre_distance[at].max(place_in_domain.centre_distance);
            self.out.domain[at] = self.out.domain[at].max(place_in_domain.domain);
        }
    }
}

/// Core rows whose lags and leads are all within the block.
fn valid_rows(compiled: &Compiled, block: &Block) -> Range<usize> {
    overlap(&compiled.functions.valid_rows(block), &compiled.rights.valid_rows(block))
}

/// Intersection of two ranges; empty if they do not overlap.
pub(crate) fn overlap(a: &Range<usize>, b: &Range<usize>) -> Range<usize> {
    let start = a.start.max(b.start);
    start..a.end.min(b.end).max(start)
}

/// Returns true if the errors of an equation are differences of angles.
pub(crate) fn wraps(model: &Model, equation: &Equation) -> bool {
    equation.prediction != Prediction::Derivative
        && model.column(&equation.subject).is_some_and(|column| model.columns[column].angle)
}
