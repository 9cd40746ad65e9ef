//! A model compiled for rows of columns: functions, regions, latents, right sides.

use fleetfoot_library::{Expr, Leaf, Program, Scratch};
use fleetfoot_model::{Basis, Equation, LatentGroup, Model, Rule, partitions_in_use};

use crate::{
    Error,
    kernel::{LANES, affine, padded},
    ranges::Ranges,
};

/// A model's equations as programs over columns.
///
/// Evaluation has three stages. `functions` are the candidate functions in use, then the columns of the partitions.
/// Then come the regions and the latents' affine maps. `rights` are right sides over the columns and, behind them, the
/// latents.
pub(crate) struct Compiled {
    pub(crate) functions: Program,
    pub(crate) rights: Program,
    pub(crate) partitions: Vec<Regions>,
    pub(crate) groups: Vec<Latents>,
    /// Columns of a workspace's values: outputs of `functions`, and basis functions.
    values: usize,
    columns: usize,
    latents: usize,
}

/// A partition in use: where its columns stand among the outputs of `functions`.
pub(crate) struct Regions {
    pub(crate) partition: usize,
    pub(crate) first: usize,
    pub(crate) centre: Vec<f64>,
    pub(crate) scale: Vec<f64>,
    pub(crate) rule: Rule,
}

/// Latents that share a library, a partition and a basis: one affine map of their features per region.
pub(crate) struct Latents {
    /// Index into [`Compiled::partitions`].
    pub(crate) regions: usize,
    /// Index of the library in the model.
    pub(crate) library: usize,
    /// Index of the first function among the outputs of `functions`.
    pub(crate) first: usize,
    /// Functions of the library in use, ascending.
    pub(crate) kept: Vec<usize>,
    /// The features of the latents: the functions in use, then those of the basis.
    pub(crate) features: Vec<usize>,
    /// The basis, and the places of its inputs among the functions in use.
    basis: Option<(Basis, Vec<usize>)>,
    /// Index of the first basis function among the values of a workspace.
    basis_first: usize,
    /// Slots of the latents, in the order of the matrix columns.
    pub(crate) slots: Vec<usize>,
    pub(crate) width: usize,
    /// Per region: features x width.
    pub(crate) matrices: Vec<f64>,
    /// Per region: width.
    pub(crate) constants: Vec<f64>,
    /// Of the functions in use in training, where the partition has statistics of them.
    pub(crate) ranges: Option<Ranges>,
    /// Functions in use x width: the coefficients outside of a region's ranges ([`fleetfoot_model::Latent::beyond`]). `None` where a region's own hold everywhere.
    pub(crate) beyond: Option<Vec<f64>>,
}

/// Memory of [`Compiled::evaluate`], reused from call to call. Column-major with `stride` values a column.
#[derive(Default)]
pub(crate) struct Workspace {
    pub(crate) stride: usize,
    /// Outputs of `functions`, then the values of the groups' bases; the partitions' columns are standardised in place.
    pub(crate) values: Vec<f64>,
    /// One list a partition in use.
    pub(crate) regions: Vec<Vec<u32>>,
    latents: Vec<f64>,
    /// Values of the right sides.
    pub(crate) outputs: Vec<f64>,
    features: Vec<f64>,
    inputs: Vec<f64>,
    row: Vec<f64>,
    excess: Vec<f64>,
    scratch: Scratch,
}

impl Compiled {
    /// Compiles the equations `equations` of a model over columns of these names.
    ///
    /// Functions whose coefficients are all zero are left out, except in library `whole`, if any.
    pub(crate) fn new(
        model: &Model,
        columns: &[&str],
        equations: &[&Equation],
        whole: Option<usize>,
    ) -> Result<Self, Error> {
        let names: Vec<&str> = columns.iter().copied().chain(model.latents.iter().map(|l| l.name.as_str())).collect();
        let right_sides: Vec<Expr> = equations.iter().map(|equation| equation.right.clone()).collect();
        let mut expressions = Vec::new();
        let groups = model.latent_groups::<Error>(&names, equations, whole)?;
        let used = partitions_in_use(&groups);
        let groups = groups
            .into_iter()
            .map(|group| {
                let first = expressions.len();
                expressions.extend(group.functions.iter().map(|&j| model.libraries[group.library][j].clone()));
                let regions = used.iter().position(|&index| index == group.partition).unwrap_or(0);
                Latents::new(model, group, regions, first)
            })
            .collect();
        let partitions = used
            .into_iter()
            .map(|index| {
                let partition = &model.partitions[index];
                let first = expressions.len();
                expressions.extend(partition.columns.iter().cloned());
                Regions {
                    partition: index,
                    first,
                    centre: partition.centre.clone(),
                    scale: partition.scale.clone(),
                    rule: partition.rule.clone(),
                }
            })
            .collect();
        let mut groups: Vec<Latents> = groups;
        let mut values = expressions.len();
        for group in &mut groups {
            group.basis_first = values;
            values += group.features.len() - group.kept.len();
        }
        Ok(Self {
            functions: Program::compile(&expressions, columns)?,
            values,
            rights: Program::compile(&right_sides, &names)?,
            partitions,
            groups,
            columns: columns.len(),
            latents: model.latents.len(),
        })
    }

    /// [`Self::evaluate_within`] no ranges but those that the model keeps.
    pub(crate) fn evaluate<'a>(&self, rows: usize, leaf: &dyn Fn(Leaf) -> &'a [f64], workspace: &mut Workspace) {
        self.evaluate_within(rows, leaf, false, workspace);
    }

    /// Evaluates `rows` rows; `leaf` gives a column (with its lag) or time as a slice of at least that many values.
    ///
    /// The right sides' values are in `workspace.outputs`; they are NaN where a row has no region. With `hold` every affine map
    /// takes a function that is outside of its region's range at the border of it.
    pub(crate) fn evaluate_within<'a>(
        &self,
        rows: usize,
        leaf: &dyn Fn(Leaf) -> &'a [f64],
        hold: bool,
        workspace: &mut Workspace,
    ) {
        // Columns that are a power of two apart would fall on the same cache lines.
        let stride = padded(rows) + LANES;
        workspace.stride = stride;
        workspace.values.resize(self.values * stride, 0.0);
        workspace.outputs.resize(self.rights.outputs() * stride, 0.0);
        workspace.latents.resize(self.latents * stride, 0.0);
        let leaves: Vec<&[f64]> = self.functions.leaves().iter().map(|&l| leaf(l)).collect();
        self.functions.evaluate(&leaves, rows, &mut workspace.values, stride, &mut workspace.scratch);
        self.assign(rows, workspace);
        for group in &self.groups {
            fleetfoot_data::arch().dispatch(EvaluateLatents { group, rows, hold, workspace });
        }
        let leaves: Vec<&[f64]> = self
            .rights
            .leaves()
            .iter()
            .map(|&l| match l {
                Leaf::Column { column, .. } if column >= self.columns => {
                    &workspace.latents[(column - self.columns) * stride..][..rows]
                }
                other => leaf(other),
            })
            .collect();
        self.rights.evaluate(&leaves, rows, &mut workspace.outputs, stride, &mut workspace.scratch);
    }

    /// The values of the latents where they are the same at all rows: they have no functions and one region. NaN for those that nothing reads.
    pub(crate) fn constants(&self) -> Option<Vec<f64>> {
        let mut numbers = vec![f64::NAN; self.latents];
        for group in &self.groups {
            if !group.features.is_empty() || group.constants.len() != group.width {
                return None;
            }
            group.slots.iter().zip(&group.constants).for_each(|(&slot, &value)| numbers[slot] = value);
        }
        Some(numbers)
    }

    /// The values of the latent that stands behind the columns at this index, after [`Self::evaluate`]; `None` for a column.
    pub(crate) fn latent<'a>(&self, column: usize, workspace: &'a Workspace) -> Option<&'a [f64]> {
        let slot = column.checked_sub(self.columns)?;
        workspace.latents.get(slot * workspace.stride..)
    }

    fn assign(&self, rows: usize, workspace: &mut Workspace) {
        workspace.regions.resize_with(self.partitions.len(), Vec::new);
        for (regions, out) in self.partitions.iter().zip(&mut workspace.regions) {
            out.clear();
            out.resize(rows, 0);
            let stride = workspace.stride;
            let values = &mut workspace.values[regions.first * stride..][..regions.centre.len() * stride];
            for ((column, &centre), &scale) in values.chunks_exact_mut(stride).zip(&regions.centre).zip(&regions.scale)
            {
                for value in &mut column[..rows] {
                    *value = (*value - centre) / scale;
                }
            }
            let z: Vec<&[f64]> = values.chunks_exact(stride).map(|column| &column[..rows]).collect();
            regions.rule.assign(&z, out);
        }
    }
}

/// [`Latents::evaluate`] with the widest vectors of the machine.
struct EvaluateLatents<'a> {
    group: &'a Latents,
    rows: usize,
    hold: bool,
    workspace: &'a mut Workspace,
}

impl pulp::WithSimd for EvaluateLatents<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.group.evaluate(self.rows, self.hold, self.workspace);
    }
}

impl Latents {
    /// Returns true if its latents are affine in the functions of the library alone.
    pub(crate) fn is_affine(&self) -> bool {
        self.basis.is_none()
    }

    /// Places of the inputs of the basis among the functions in use.
    fn inputs(&self) -> &[usize] {
        self.basis.as_ref().map_or(&[], |(_, places)| places)
    }

    /// Column of a feature among the values of a workspace.
    pub(crate) fn column(&self, feature: usize) -> usize {
        match feature.checked_sub(self.kept.len()) {
            None => self.first + feature,
            Some(basis_function) => self.basis_first + basis_function,
        }
    }

    /// The derivatives of the latents by the functions in use at a row, in a region: functions x width. NaN in a region that there is not.
    pub(crate) fn slopes(&self, region: usize, row: usize, workspace: &Workspace, out: &mut [f64]) {
        let (width, functions) = (self.width, self.kept.len());
        let Some(matrix) =
            self.matrices.get(region * self.features.len() * width..).filter(|slopes| !slopes.is_empty())
        else {
            out.fill(f64::NAN);
            return;
        };
        out.copy_from_slice(&matrix[..functions * width]);
        let value = |column: usize| workspace.values[column * workspace.stride + row];
        if let (Some(beyond), Some(ranges)) = (&self.beyond, &self.ranges) {
            for j in (0..functions).filter(|&j| ranges.is_outside(region, j, value(self.first + j))) {
                out[j * width..][..width].copy_from_slice(&beyond[j * width..][..width]);
            }
        }
        let Some((basis, places)) = &self.basis else { return };
        let inputs: Vec<f64> = places.iter().map(|&place| value(self.first + place)).collect();
        let values: Vec<f64> = (0..basis.count()).map(|function| value(self.basis_first + function)).collect();
        let mut slopes = vec![0.0; inputs.len()];
        for latent in 0..self.slots.len() {
            let weights: Vec<f64> =
                (functions..self.features.len()).map(|feature| matrix[feature * width + latent]).collect();
            slopes.fill(0.0);
            basis.gradient(&inputs, &values, &weights, &mut slopes);
            places.iter().zip(&slopes).for_each(|(&place, slope)| out[place * width + latent] += slope);
        }
    }

    /// The latents of affine maps in a region, from the functions in use; these are moved to the border of the ranges where the model goes on from there.
    #[inline(always)]
    pub(crate) fn affine(&self, region: usize, functions: &mut [f64], excess: &mut [f64], out: &mut [f64]) {
        let beyond = match (&self.beyond, &self.ranges) {
            (Some(beyond), Some(ranges)) => ranges.split(region, functions, excess).then_some(beyond),
            _ => None,
        };
        let length = functions.len() * self.width;
        let constants = &self.constants[region * self.width..][..self.width];
        affine(&self.matrices[region * length..][..length], constants, functions, out);
        for (slopes, &excess) in beyond.into_iter().flat_map(|beyond| beyond.chunks_exact(self.width)).zip(&*excess) {
            out.iter_mut().zip(slopes).for_each(|(out, slope)| *out = slope.mul_add(excess, *out));
        }
    }

    /// The value of a feature of a row as the maps of its region take it, after [`Compiled::evaluate`].
    pub(crate) fn feature(&self, (region, feature): (usize, usize), row: usize, workspace: &Workspace) -> f64 {
        let value = workspace.values[self.column(feature) * workspace.stride + row];
        match &self.ranges {
            Some(ranges) if self.beyond.is_some() => ranges.held(region, feature, value),
            _ => value,
        }
    }

    #[inline(always)]
    fn evaluate(&self, rows: usize, hold: bool, workspace: &mut Workspace) {
        let Workspace { stride, values, regions, latents, features, inputs, row: out, excess, .. } = workspace;
        let (stride, count) = (*stride, self.features.len());
        features.resize(count, 0.0);
        inputs.resize(self.inputs().len(), 0.0);
        out.resize(self.width, 0.0);
        excess.resize(self.kept.len(), 0.0);
        for row in 0..rows {
            let region = regions[self.regions][row] as usize;
            if region * self.width >= self.constants.len() {
                for &slot in &self.slots {
                    latents[slot * stride + row] = f64::NAN;
                }
                continue;
            }
            let (functions, basis_features) = features.split_at_mut(self.kept.len());
            for (j, feature) in functions.iter_mut().enumerate() {
                *feature = values[(self.first + j) * stride + row];
            }
            if let (true, Some(ranges)) = (hold, &self.ranges) {
                ranges.hold(region, functions);
            } else if self.beyond.is_some() {
                self.affine(region, functions, excess, out);
                self.slots.iter().zip(&*out).for_each(|(&slot, &value)| latents[slot * stride + row] = value);
                continue;
            }
            if let Some((basis, places)) = &self.basis {
                inputs.iter_mut().zip(places).for_each(|(input, &place)| *input = functions[place]);
                basis.evaluate(inputs, basis_features);
                for (k, &value) in basis_features.iter().enumerate() {
                    values[(self.basis_first + k) * stride + row] = value;
                }
            }
            let matrix = &self.matrices[region * count * self.width..][..count * self.width];
            affine(matrix, &self.constants[region * self.width..][..self.width], features, out);
            for (&slot, &value) in self.slots.iter().zip(&*out) {
                latents[slot * stride + row] = value;
            }
        }
    }
}

impl Latents {
    /// The affine maps of a group, whose functions begin at `first` among the outputs; `regions` is the place of its partition among those in use.
    fn new(model: &Model, group: LatentGroup, regions: usize, first: usize) -> Self {
        let (inputs, ranges) = (group.inputs(), Ranges::new(model, &group));
        let LatentGroup { library, partition, latents: slots, functions: kept, basis } = group;
        let functions = model.libraries[library].len();
        let of_group = functions..functions + basis.as_ref().map_or(0, Basis::count);
        let features: Vec<usize> = kept.iter().copied().chain(of_group).collect();
        let count = model.partitions[partition].rule.count();
        let width = padded(slots.len());
        let mut matrices = vec![0.0; count * features.len() * width];
        let mut constants = vec![0.0; count * width];
        for (o, &slot) in slots.iter().enumerate() {
            let latent = &model.latents[slot];
            for region in 0..count {
                constants[region * width + o] = latent.map.constant(region);
                for (j, &feature) in features.iter().enumerate() {
                    matrices[(region * features.len() + j) * width + o] = latent.map.coefficient(region, feature);
                }
            }
        }
        let goes_on = slots.iter().any(|&slot| !model.latents[slot].beyond.is_empty());
        let slopes = |j: &usize| {
            let lines = slots.iter().map(|&slot| model.latents[slot].beyond.get(*j).copied().unwrap_or(0.0));
            lines.chain(std::iter::repeat(0.0)).take(width).collect::<Vec<_>>()
        };
        let beyond = goes_on.then(|| kept.iter().flat_map(slopes).collect());
        let basis = basis.map(|basis| (basis, inputs));
        Self {
            regions,
            library,
            first,
            kept,
            features,
            basis,
            basis_first: 0,
            slots,
            width,
            matrices,
            constants,
            ranges,
            beyond,
        }
    }
}
