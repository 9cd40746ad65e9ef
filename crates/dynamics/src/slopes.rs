//! Exact derivatives of a compiled model's right sides, row by row.

use fleetfoot_library::{Expr, Leaf, Program, Scratch};
use fleetfoot_model::{Equation, Model};

use crate::{
    Error,
    compiled::{Compiled, Latents, Workspace},
    kernel::{LANES, padded},
};

/// A column at a row: its index, and how many rows back in time.
pub(crate) type Reading = (usize, i32);

/// The derivatives of right sides with respect to columns, at their own row or earlier ones, compiled.
///
/// Within the region of a row; time is held.
pub(crate) struct Slopes {
    features: Program,
    /// Of every output of `features`: the group of latents, the function in it, and the variable.
    feature_entries: Vec<(usize, usize, usize)>,
    rights: Program,
    /// Of every output of `rights`: the right side, and the variable of the derivative.
    right_entries: Vec<(usize, Variable)>,
    sides: usize,
    variables: usize,
    latents: usize,
}

/// Variable by which a right side is differentiated.
#[derive(Debug, Clone, Copy)]
enum Variable {
    /// A column, by its number among the variables.
    Column(usize),
    /// A latent, by its number in the model.
    Latent(usize),
}

/// Derivatives at some rows.
#[derive(Debug, Clone, Default)]
pub(crate) struct SlopeRows {
    /// With respect to the variables, through the latents too: rows x right sides x variables.
    pub(crate) total: Vec<f64>,
    /// With respect to the latents: rows x right sides x latents.
    pub(crate) by_latents: Vec<f64>,
}

impl Slopes {
    /// Differentiates right sides (`None`: of no equation, all derivatives are zero) with respect to `variables`. `model` is the one that was compiled.
    ///
    /// # Errors
    /// [`Error::UnknownColumn`].
    pub(crate) fn new(
        model: &Model,
        compiled: &Compiled,
        sides: &[Option<&Equation>],
        variables: &[Reading],
    ) -> Result<Self, Error> {
        let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
        let with_latents: Vec<&str> =
            columns.iter().copied().chain(model.latents.iter().map(|latent| latent.name.as_str())).collect();
        let is_zero = |slope: &Expr| slope.as_number() == Some(0.0);
        let (mut slopes, mut feature_entries) = (Vec::new(), Vec::new());
        for (at, group) in compiled.groups.iter().enumerate() {
            for (j, &function) in group.kept.iter().enumerate() {
                for (variable, &reading) in variables.iter().enumerate() {
                    let slope = derivative(&model.libraries[group.library][function], &columns, reading);
                    if !is_zero(&slope) {
                        slopes.push(slope);
                        feature_entries.push((at, j, variable));
                    }
                }
            }
        }
        let (mut right_slopes, mut right_entries) = (Vec::new(), Vec::new());
        for (row, equation) in sides.iter().enumerate() {
            let Some(equation) = equation else { continue };
            let derivatives = variables.iter().map(|&reading| derivative(&equation.right, &columns, reading));
            let latents = model.latents.iter().map(|latent| equation.right.derivative(&latent.name));
            let derivatives = derivatives.enumerate().map(|(i, slope)| (slope, Variable::Column(i)));
            let latents = latents.enumerate().map(|(i, slope)| (slope, Variable::Latent(i)));
            for (slope, variable) in derivatives.chain(latents).filter(|(slope, _)| !is_zero(slope)) {
                right_slopes.push(slope);
                right_entries.push((row, variable));
            }
        }
        Ok(Self {
            features: Program::compile(&slopes, &columns)?,
            feature_entries,
            rights: Program::compile(&right_slopes, &with_latents)?,
            right_entries,
            sides: sides.len(),
            variables: variables.len(),
            latents: model.latents.len(),
        })
    }

    /// The right sides that read latents: side, latent; ascending.
    pub(crate) fn readers(&self) -> Vec<(usize, usize)> {
        let latent = |&(side, variable): &(usize, Variable)| match variable {
            Variable::Latent(latent) => Some((side, latent)),
            Variable::Column(_) => None,
        };
        let mut readers: Vec<(usize, usize)> = self.right_entries.iter().filter_map(latent).collect();
        readers.sort_unstable();
        readers.dedup();
        readers
    }

    /// The derivatives at `rows` rows, after [`Compiled::evaluate`] with the same leaves into `workspace`.
    pub(crate) fn evaluate<'a>(
        &self,
        compiled: &Compiled,
        rows: usize,
        leaf: &dyn Fn(Leaf) -> &'a [f64],
        workspace: &Workspace,
    ) -> SlopeRows {
        let (sides, width, latents) = (self.sides, self.variables, self.latents);
        let features = run(&self.features, compiled, rows, leaf, workspace);
        let rights = run(&self.rights, compiled, rows, leaf, workspace);
        let stride = padded(rows) + LANES;
        let mut out =
            SlopeRows { total: vec![0.0; rows * sides * width], by_latents: vec![0.0; rows * sides * latents] };
        let mut of_latents = vec![0.0; latents * width];
        // Of a group with a basis, or with slopes outside of ranges, which change from row to row; the others are those of the matrix. A row without a region has no derivatives.
        let changes = |group: &Latents| !group.is_affine() || group.beyond.is_some();
        let functions = |group: &Latents| changes(group).then(|| vec![0.0; group.kept.len() * group.width]);
        let mut by_functions: Vec<Option<Vec<f64>>> = compiled.groups.iter().map(functions).collect();
        let region =
            |group: &Latents, b: usize| workspace.regions.get(group.regions).map_or(0, |regions| regions[b] as usize);
        for b in 0..rows {
            of_latents.fill(0.0);
            for (group, slopes) in compiled.groups.iter().zip(&mut by_functions) {
                if let Some(slopes) = slopes {
                    group.slopes(region(group, b), b, workspace, slopes);
                }
            }
            for (entry, &(at, j, variable)) in self.feature_entries.iter().enumerate() {
                let group = &compiled.groups[at];
                let first = (region(group, b) * group.features.len() + j) * group.width;
                for (o, &slot) in group.slots.iter().enumerate() {
                    let coefficient = match &by_functions[at] {
                        Some(slopes) => slopes[j * group.width + o],
                        None => group.matrices.get(first + o).copied().unwrap_or(f64::NAN),
                    };
                    of_latents[slot * width + variable] += coefficient * features[entry * stride + b];
                }
            }
            let slopes = &mut out.total[b * sides * width..][..sides * width];
            let by_latents = &mut out.by_latents[b * sides * latents..][..sides * latents];
            for (entry, &(row, variable)) in self.right_entries.iter().enumerate() {
                let slope = rights[entry * stride + b];
                match variable {
                    Variable::Column(variable) => slopes[row * width + variable] += slope,
                    Variable::Latent(slot) => {
                        by_latents[row * latents + slot] += slope;
                        for variable in 0..width {
                            slopes[row * width + variable] += slope * of_latents[slot * width + variable];
                        }
                    }
                }
            }
        }
        out
    }
}

/// The derivative with respect to a column at a row: where that is an earlier one, the expression is moved there and back.
fn derivative(expression: &Expr, columns: &[&str], (column, lag): Reading) -> Expr {
    match lag {
        0 => expression.derivative(columns[column]),
        lag => expression.shifted(-lag).derivative(columns[column]).shifted(lag),
    }
}

/// The outputs of a program over columns and latents.
fn run<'a>(
    program: &Program,
    compiled: &Compiled,
    rows: usize,
    leaf: &dyn Fn(Leaf) -> &'a [f64],
    workspace: &Workspace,
) -> Vec<f64> {
    let stride = padded(rows) + LANES;
    let read = |&read_leaf: &Leaf| match read_leaf {
        Leaf::Column { column, .. } => {
            compiled.latent(column, workspace).map_or_else(|| leaf(read_leaf), |v| &v[..rows])
        }
        Leaf::Time { .. } => leaf(read_leaf),
    };
    let leaves: Vec<&[f64]> = program.leaves().iter().map(read).collect();
    let mut out = vec![0.0; program.outputs() * stride];
    program.evaluate(&leaves, rows, &mut out, stride, &mut Scratch::default());
    out
}
