//! Values inside a network: affine combinations of its inputs and of the units of a hidden layer.

use fleetfoot_model::{Activation, DenseLayer, Recurrent};

/// Matrix by rows.
pub(super) type Rows = Vec<Vec<f64>>;

/// Elementwise operation with a row of constants, which stands on the right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Elementwise {
    Add,
    Sub,
    Mul,
    Div,
}

/// Part of a combination that reads the inputs x.
#[derive(Debug, Clone, PartialEq)]
enum Inputs {
    /// None is read.
    None,
    /// `(x - centre)/scale`, one value an input, scales positive.
    Standardised { centre: Vec<f64>, scale: Vec<f64> },
    /// `W x`.
    Plain(Rows),
    /// `W (x - centre)/scale` with the centre and scale of [`Hidden`].
    Framed(Rows),
}

/// `c + (inputs) + B h` with the units h of the hidden layer `depth`; one value a column of the network's tensor.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Combination {
    pub(super) constants: Vec<f64>,
    inputs: Inputs,
    depth: usize,
    units: Rows,
}

/// Hidden layers so far.
#[derive(Debug, Default)]
pub(super) struct Hidden {
    /// Centre and scale by which the network standardises its inputs.
    pub(super) frame: Option<(Vec<f64>, Vec<f64>)>,
    /// True if the first layer reads the standardised inputs.
    pub(super) is_framed: bool,
    pub(super) activation: Option<Activation>,
    pub(super) layers: Vec<DenseLayer>,
    /// The recurrent cell that stands in place of layers.
    pub(super) cell: Option<Recurrent>,
}

impl Hidden {
    /// Layers so far; a cell is one.
    fn depth(&self) -> usize {
        if self.cell.is_some() { 1 } else { self.layers.len() }
    }
}

/// Columns of the steps that a cell reads.
pub(super) struct Window {
    /// Input of every step and column, step by step.
    pub(super) inputs: Vec<usize>,
    /// Centre and scale of every column, and 1, or -1 if the network has it negative.
    pub(super) centre: Vec<f64>,
    pub(super) scale: Vec<f64>,
    pub(super) signs: Vec<f64>,
}

impl Combination {
    /// The inputs themselves.
    pub(super) fn inputs(count: usize) -> Self {
        let inputs = Inputs::Standardised { centre: vec![0.0; count], scale: vec![1.0; count] };
        Self { constants: vec![0.0; count], inputs, depth: 0, units: Vec::new() }
    }

    /// The units of the first hidden layer.
    pub(super) fn units(count: usize) -> Self {
        let units = (0..count).map(|i| (0..count).map(|k| f64::from(i == k)).collect()).collect();
        Self { constants: vec![0.0; count], inputs: Inputs::None, depth: 1, units }
    }

    /// Its values as columns of steps, each a scaled and shifted input.
    ///
    /// # Errors
    /// Another combination, or another scale or shift in another step, in words.
    pub(super) fn window(self, columns: usize, hidden: &Hidden) -> Result<Window, String> {
        let mixed = "a column of its steps is no single input; only standardised inputs are read";
        let plain = self.plain(&hidden.frame);
        let Inputs::Plain(weights) = &plain.inputs else { return Err(mixed.into()) };
        let single = |row: &Vec<f64>| {
            let mut read = row.iter().copied().enumerate().filter(|(_, weight)| *weight != 0.0);
            read.next().filter(|_| read.next().is_none())
        };
        let read: Option<Vec<(usize, f64)>> = weights.iter().map(single).collect();
        let read = read.filter(|_| plain.units.is_empty()).ok_or(mixed)?;
        let (first, constants) = (&read[..columns], &plain.constants[..columns]);
        let is_shared = read.chunks(columns).zip(plain.constants.chunks(columns)).all(|(step, others)| {
            others == constants && step.iter().zip(first).all(|((_, weight), (_, known))| weight == known)
        });
        if !is_shared {
            return Err("its steps are standardised differently; use one centre and scale of a column".into());
        }
        Ok(Window {
            inputs: read.iter().map(|(input, _)| *input).collect(),
            centre: first.iter().zip(constants).map(|((_, weight), constant)| -constant / weight).collect(),
            scale: first.iter().map(|(_, weight)| 1.0 / weight.abs()).collect(),
            signs: first.iter().map(|(_, weight)| weight.signum()).collect(),
        })
    }

    /// Number of values.
    pub(super) fn width(&self) -> usize {
        self.constants.len()
    }

    /// Numbers that it holds.
    pub(super) fn numbers(&self) -> usize {
        let matrix = |rows: &Rows| rows.iter().map(Vec::len).sum::<usize>();
        let inputs = match &self.inputs {
            Inputs::None => 0,
            Inputs::Standardised { centre, .. } => 2 * centre.len(),
            Inputs::Plain(weights) | Inputs::Framed(weights) => matrix(weights),
        };
        self.width() + inputs + matrix(&self.units)
    }

    /// An operation with a row of constants, one a value.
    pub(super) fn with_row(mut self, operation: Elementwise, row: &[f64]) -> Self {
        if let Inputs::Standardised { centre, scale } = &mut self.inputs {
            let places = centre.iter_mut().zip(scale.iter_mut()).zip(row);
            match operation {
                Elementwise::Add => places.for_each(|((centre, scale), value)| *centre -= value * *scale),
                Elementwise::Sub => places.for_each(|((centre, scale), value)| *centre += value * *scale),
                Elementwise::Mul if row.iter().all(|value| *value > 0.0) => {
                    places.for_each(|((_, scale), value)| *scale /= value);
                }
                Elementwise::Div if row.iter().all(|value| *value > 0.0) => {
                    places.for_each(|((_, scale), value)| *scale *= value);
                }
                Elementwise::Mul | Elementwise::Div => return self.plain(&None).with_row(operation, row),
            }
            return self;
        }
        match operation {
            Elementwise::Add => self.constants.iter_mut().zip(row).for_each(|(constant, value)| *constant += value),
            Elementwise::Sub => self.constants.iter_mut().zip(row).for_each(|(constant, value)| *constant -= value),
            Elementwise::Mul => self.each_row(|at, weight| *weight *= row[at]),
            Elementwise::Div => self.each_row(|at, weight| *weight /= row[at]),
        }
        self
    }

    /// Changes all numbers of a value: its constant and its weights.
    fn each_row(&mut self, change: impl Fn(usize, &mut f64)) {
        let matrices = match &mut self.inputs {
            Inputs::Plain(weights) | Inputs::Framed(weights) => Some(weights),
            Inputs::None | Inputs::Standardised { .. } => None,
        };
        for rows in matrices.into_iter().chain([&mut self.units]) {
            rows.iter_mut().enumerate().for_each(|(at, row)| row.iter_mut().for_each(|weight| change(at, weight)));
        }
        self.constants.iter_mut().enumerate().for_each(|(at, constant)| change(at, constant));
    }

    /// Its values times a matrix of as many rows.
    pub(super) fn times(self, matrix: &Rows, hidden: &mut Hidden) -> Self {
        let columns = matrix.first().map_or(0, Vec::len);
        let (mut constants, inputs) = (combined(&[self.constants], matrix).swap_remove(0), self.inputs);
        let inputs = match inputs {
            Inputs::None => Inputs::None,
            Inputs::Plain(weights) => Inputs::Plain(product(matrix, &weights)),
            Inputs::Framed(weights) => Inputs::Framed(product(matrix, &weights)),
            Inputs::Standardised { centre, scale } => {
                let transposed: Rows = (0..columns).map(|k| matrix.iter().map(|row| row[k]).collect()).collect();
                let is_plain = centre.iter().all(|value| *value == 0.0) && scale.iter().all(|value| *value == 1.0);
                let frame = (centre, scale);
                if is_plain {
                    Inputs::Plain(transposed)
                } else if *hidden.frame.get_or_insert_with(|| frame.clone()) == frame {
                    Inputs::Framed(transposed)
                } else {
                    Inputs::Plain(unframed(transposed, &frame, &mut constants))
                }
            }
        };
        Self { constants, inputs, depth: self.depth, units: product(matrix, &self.units) }
    }

    /// The same values with weights of the inputs themselves.
    fn plain(mut self, frame: &Option<(Vec<f64>, Vec<f64>)>) -> Self {
        self.inputs = match self.inputs {
            Inputs::Standardised { centre, scale } => {
                let identity =
                    (0..scale.len()).map(|i| (0..scale.len()).map(|j| f64::from(i == j)).collect()).collect();
                Inputs::Plain(unframed(identity, &(centre, scale), &mut self.constants))
            }
            Inputs::Framed(weights) => match frame {
                Some(frame) => Inputs::Plain(unframed(weights, frame, &mut self.constants)),
                None => Inputs::Plain(weights),
            },
            other => other,
        };
        self
    }

    /// The sum with another combination, which `sign` multiplies.
    ///
    /// # Errors
    /// Units of two hidden layers, in words.
    pub(super) fn plus(self, sign: f64, other: Self, hidden: &Hidden) -> Result<Self, String> {
        let (mut sum, mut other) = match (&self.inputs, &other.inputs) {
            (Inputs::Framed(_), Inputs::Framed(_)) => (self, other),
            _ => (self.plain(&hidden.frame), other.plain(&hidden.frame)),
        };
        if sign < 0.0 {
            other.each_row(|_, weight| *weight = -*weight);
        }
        match (sum.units.is_empty(), other.units.is_empty()) {
            (_, true) => {}
            (true, false) => (sum.depth, sum.units) = (other.depth, other.units),
            (false, false) if sum.depth == other.depth => add(&mut sum.units, &other.units),
            (false, false) => {
                return Err("it adds units of two hidden layers; only the inputs and the last hidden layer may be \
                            added to the outputs"
                    .into());
            }
        }
        match (&mut sum.inputs, other.inputs) {
            (Inputs::Plain(weights), Inputs::Plain(others)) | (Inputs::Framed(weights), Inputs::Framed(others)) => {
                add(weights, &others);
            }
            (Inputs::None, others) => sum.inputs = others,
            _ => {}
        }
        sum.constants.iter_mut().zip(&other.constants).for_each(|(constant, value)| *constant += value);
        Ok(sum)
    }

    /// The activations of its values, which become the next hidden layer. A sigmoid is a scaled tanh:
    /// `1/(1 + exp(-z)) = (1 + tanh(z/2))/2`.
    ///
    /// # Errors
    /// A layer beside another one, or with another activation, or that reads the inputs again; in words.
    pub(super) fn activated(
        self,
        activation: Activation,
        is_sigmoid: bool,
        hidden: &mut Hidden,
    ) -> Result<Self, String> {
        if *hidden.activation.get_or_insert(activation) != activation {
            return Err(
                "its activation differs from that of the layers before it; export a network of one activation".into()
            );
        }
        if hidden.cell.is_some() {
            return Err("it stands beside or behind a recurrent cell, whose state only the outputs may read".into());
        }
        let mut sums = match &self.inputs {
            Inputs::Standardised { .. } => self.plain(&None),
            _ => self,
        };
        if is_sigmoid {
            sums.each_row(|_, weight| *weight /= 2.0);
        }
        let weights = match (sums.inputs, sums.units.is_empty()) {
            (Inputs::None, false) if sums.depth == hidden.layers.len() => sums.units,
            (Inputs::Plain(weights), true) if hidden.layers.is_empty() => weights,
            (Inputs::Framed(weights), true) if hidden.layers.is_empty() => {
                hidden.is_framed = true;
                weights
            }
            (Inputs::None, true) => return Err("it reads constants alone".into()),
            (_, true) => return Err("it stands beside another hidden layer; layers must follow one another".into()),
            (Inputs::None, false) => return Err("it reads a hidden layer before the last one".into()),
            (_, false) => {
                return Err("it reads the inputs and a hidden layer; only the outputs may read both".into());
            }
        };
        let units = sums.constants.len();
        hidden.layers.push(DenseLayer { weights, biases: sums.constants });
        let (constant, weight) = if is_sigmoid { (0.5, 0.5) } else { (0.0, 1.0) };
        let identity = |i: usize| (0..units).map(|k| if i == k { weight } else { 0.0 }).collect();
        Ok(Self {
            constants: vec![constant; units],
            inputs: Inputs::None,
            depth: hidden.layers.len(),
            units: (0..units).map(identity).collect(),
        })
    }

    /// Constants, weights of the inputs (values x inputs) and of the last hidden layer's units (values x units).
    ///
    /// # Errors
    /// It reads another hidden layer; in words.
    pub(super) fn parts(self, inputs: usize, hidden: &Hidden) -> Result<(Vec<f64>, Rows, Rows), String> {
        let plain = self.plain(&hidden.frame);
        let depth = hidden.depth();
        if depth > 0 && (plain.units.is_empty() || plain.depth != depth) {
            return Err("the output does not read the last hidden layer".into());
        }
        let linear = match plain.inputs {
            Inputs::Plain(weights) => weights,
            _ => vec![vec![0.0; inputs]; plain.constants.len()],
        };
        Ok((plain.constants, linear, plain.units))
    }
}

/// `W (x - centre)/scale` as weights of x; the constants take the rest.
fn unframed(mut weights: Rows, (centre, scale): &(Vec<f64>, Vec<f64>), constants: &mut [f64]) -> Rows {
    for (row, constant) in weights.iter_mut().zip(constants) {
        for (weight, (centre, scale)) in row.iter_mut().zip(centre.iter().zip(scale)) {
            *weight /= scale;
            *constant -= *weight * centre;
        }
    }
    weights
}

/// Rows of values times a matrix: rows x columns of the matrix.
fn combined(rows: &[Vec<f64>], matrix: &Rows) -> Rows {
    let columns = matrix.first().map_or(0, Vec::len);
    let combine = |row: &Vec<f64>| {
        let mut sums = vec![0.0; columns];
        for (value, weights) in row.iter().zip(matrix) {
            sums.iter_mut().zip(weights).for_each(|(sum, weight)| *sum += value * weight);
        }
        sums
    };
    rows.iter().map(combine).collect()
}

/// The transposed matrix times weights, values x features; empty for none.
fn product(matrix: &Rows, weights: &Rows) -> Rows {
    let columns = if weights.is_empty() { 0 } else { matrix.first().map_or(0, Vec::len) };
    let transposed: Rows = (0..columns).map(|k| matrix.iter().map(|row| row[k]).collect()).collect();
    combined(&transposed, weights)
}

fn add(sum: &mut Rows, others: &Rows) {
    let pairs = sum.iter_mut().zip(others).flat_map(|(row, others)| row.iter_mut().zip(others));
    pairs.for_each(|(sum, value)| *sum += value);
}
