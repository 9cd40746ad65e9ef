//! Basis functions in code: loops over constant tables.

use fleetfoot_library::{Binary, Unary};
use fleetfoot_model::{Activation, Basis, DenseLayer, Gaussian, Network};

use crate::{
    code::{Index, Place, Real, Statement, TABLE, Values},
    evaluation::Group,
    lower::Lowering,
};

/// Names of the tables of radial functions.
struct RadialTables {
    centres: String,
    scale: String,
    /// Places of the inputs among the functions of the group.
    inputs: String,
}

impl Lowering<'_> {
    /// The basis functions of a group, behind its functions among the features.
    pub(crate) fn basis(&mut self, index: usize, group: &Group) -> Vec<Statement> {
        match &group.basis {
            None => Vec::new(),
            Some((Basis::Gaussian(gaussian), inputs)) => self.radial(index, group, gaussian, inputs),
            Some((Basis::Network(network), inputs)) => self.network(index, group, network, inputs),
            Some((Basis::Recurrent(cell), inputs)) => self.recurrent(index, group, cell, inputs),
        }
    }

    /// Adds the derivatives of the latents through the basis to the array `g`. `entries`: function of the group and variable of every slope, of which the first
    /// stands in the array `d` at the index given.
    pub(crate) fn slopes_of_basis(
        &mut self,
        index: usize,
        group: &Group,
        entries: (&[(usize, usize)], usize),
        variables: usize,
    ) -> Vec<Statement> {
        match &group.basis {
            None => Vec::new(),
            Some((Basis::Gaussian(gaussian), inputs)) => {
                self.radial_slopes((index, group), (gaussian, inputs), entries, variables)
            }
            Some((Basis::Network(network), inputs)) => {
                self.network_slopes((index, group), (network, inputs), entries, variables)
            }
            Some((Basis::Recurrent(cell), inputs)) => {
                self.recurrent_slopes((index, group), (cell, inputs), entries, variables)
            }
        }
    }

    fn radial_tables(&mut self, index: usize, gaussian: &Gaussian, inputs: &[usize]) -> RadialTables {
        let centres = gaussian.centres.iter().flatten().copied().collect();
        let inverse = gaussian.scale.iter().map(|scale| 1.0 / scale).collect();
        let comment = "Centres of the radial functions, one row a function.";
        RadialTables {
            centres: self.reals("centres", index, comment, inputs.len(), centres),
            scale: self.reals(
                "inverse_width",
                index,
                "One over the scale of each input of the radial functions.",
                8,
                inverse,
            ),
            inputs: self.table(
                "inputs",
                index,
                "Inputs of the radial functions.",
                12,
                Values::Indices(inputs.to_vec()),
            ),
        }
    }

    /// `exp(-factor sum_j ((x_j - c_j)/s_j)^2)` for every centre.
    fn radial(&mut self, index: usize, group: &Group, gaussian: &Gaussian, inputs: &[usize]) -> Vec<Statement> {
        let tables = self.radial_tables(index, gaussian, inputs);
        let count = inputs.len();
        let square = vec![
            Statement::Let("part".into(), part(group, &tables, count)),
            Statement::Add(Place::Local("square".into()), Real::local("part").times(Real::local("part"))),
        ];
        let value = Real::unary(Unary::Exp, Real::Number(-gaussian.factor()).times(Real::local("square")));
        let body = vec![
            Statement::Variable("square".into(), Real::Number(0.0)),
            Statement::each("j", count, square),
            Statement::set("q", Index::local("i").plus(group.first + group.functions), value),
        ];
        vec![Statement::each("i", gaussian.count(), body)]
    }

    /// Tables of a layer: weights, one row a unit, and biases.
    fn layer_tables(&mut self, index: usize, at: usize, layer: &DenseLayer) -> [String; 2] {
        let weights = layer.weights.iter().flatten().copied().collect();
        let before = layer.weights.first().map_or(1, Vec::len);
        let what = |what: &str| format!("layer{}_{what}", at + 1);
        [
            self.reals(&what("weights"), index, "Weights of a hidden layer, one row a unit.", before, weights),
            self.reals(&what("biases"), index, "Biases of its units.", 8, layer.biases.clone()),
        ]
    }

    /// Units of all hidden layers: those of the last one among the features, the others in arrays.
    fn network(&mut self, index: usize, group: &Group, network: &Network, inputs: &[usize]) -> Vec<Statement> {
        let places = Values::Indices(inputs.to_vec());
        let places = self.table("inputs", index, "Inputs of the network.", 12, places);
        let centre =
            self.reals("input_centre", index, "Centre of each input of the network.", 8, network.centre.clone());
        let inverse = network.scale.iter().map(|scale| 1.0 / scale).collect();
        let inverse = self.reals("input_inverse_scale", index, "One over the scale of each.", 8, inverse);
        let j = || Index::local("j");
        let x = Real::at("q", Index::table(&places, j()).plus(group.first));
        let standardised = x.minus(Real::at(&centre, j())).times(Real::at(&inverse, j()));
        let mut before = format!("units{index}_0");
        let mut body = vec![
            Statement::Array(before.clone(), inputs.len()),
            Statement::each("j", inputs.len(), vec![Statement::set(&before, j(), standardised)]),
        ];
        for (at, layer) in network.layers.iter().enumerate() {
            let [weights, biases] = self.layer_tables(index, at, layer);
            let (units, width) = (layer.biases.len(), layer.weights.first().map_or(0, Vec::len));
            let i = || Index::local("i");
            let term = Real::at(&weights, i().times(width).plus(j())).times(Real::at(&before, j()));
            let value = activated(network.activation, Real::local("sum"));
            let is_last = at + 1 == network.layers.len();
            let name = format!("units{index}_{}", at + 1);
            let set = match is_last {
                true => Statement::set("q", i().plus(group.first + group.functions), value),
                false => Statement::set(&name, i(), value),
            };
            if !is_last {
                body.push(Statement::Array(name.clone(), units));
            }
            let unit = vec![
                Statement::Variable("sum".into(), Real::at(&biases, i())),
                Statement::each("j", width, vec![Statement::Add(Place::Local("sum".into()), term)]),
                set,
            ];
            body.push(Statement::each("i", units, unit));
            before = name;
        }
        body
    }

    fn network_slopes(
        &mut self,
        (index, group): (usize, &Group),
        (network, inputs): (&Network, &[usize]),
        (entries, first): (&[(usize, usize)], usize),
        variables: usize,
    ) -> Vec<Statement> {
        let place = |&(function, _): &(usize, usize)| inputs.iter().position(|&input| input == function);
        let used: Vec<(usize, usize, usize)> =
            (entries.iter().enumerate()).filter_map(|(at, entry)| Some((first + at, place(entry)?, entry.1))).collect();
        if used.is_empty() {
            return Vec::new();
        }
        let mut table = |what: &str, comment: &str, of: fn(&(usize, usize, usize)) -> usize| {
            self.table(what, index, comment, 12, Values::Indices(used.iter().map(of).collect()))
        };
        let slope = table("network_slope", "Slopes of the inputs of the network.", |used| used.0);
        let input = table("network_input", "Input of each of them.", |used| used.1);
        let variable = table("network_variable", "Variable of each of them.", |used| used.2);
        let inverse = network.scale.iter().map(|scale| 1.0 / scale).collect();
        let inverse = self.reals("input_inverse_scale", index, "One over the scale of each.", 8, inverse);
        let (i, j) = (|| Index::local("i"), || Index::local("j"));
        let row = Self::group_region(group).times(group.latents()).plus(Index::local("n"));
        let coefficient = row.times(group.width()).plus(i()).plus(group.functions);
        let coefficients = format!("{TABLE}{}coefficients{index}", self.tag);
        let by = |layer: usize| format!("by_units{index}_{layer}");
        let unit = |layer: usize| match layer == network.layers.len() {
            true => Real::at("q", i().plus(group.first + group.functions)),
            false => Real::at(&format!("units{index}_{layer}"), i()),
        };
        let count = network.layers.len();
        let last = Real::at(&coefficients, coefficient).times(slope_of(network.activation, unit(count)));
        let mut body = vec![
            Statement::Array(by(count), network.count()),
            Statement::each("i", network.count(), vec![Statement::set(&by(count), i(), last)]),
        ];
        for (at, layer) in network.layers.iter().enumerate().rev() {
            let [weights, _] = self.layer_tables(index, at, layer);
            let (units, width) = (layer.biases.len(), layer.weights.first().map_or(0, Vec::len));
            let term = Real::at(&weights, i().times(width).plus(j())).times(Real::at(&by(at + 1), i()));
            body.push(Statement::Array(by(at), width));
            let each = vec![Statement::add(&by(at), j(), term)];
            body.push(Statement::each("i", units, vec![Statement::each("j", width, each)]));
            if at > 0 {
                let chained = Real::at(&by(at), i()).times(slope_of(network.activation, unit(at)));
                body.push(Statement::each("i", width, vec![Statement::set(&by(at), i(), chained)]));
            }
        }
        let at = Index::table(&input, Index::local("e"));
        let value = Real::at(&by(0), at.clone())
            .times(Real::at(&inverse, at))
            .times(Real::at("d", Index::table(&slope, Index::local("e"))));
        let to = Index::local("n").times(variables).plus(group.slot * variables);
        let to = to.plus(Index::table(&variable, Index::local("e")));
        body.push(Statement::each("e", used.len(), vec![Statement::Add(Place::at("g", to), value)]));
        vec![Statement::each("n", group.latents(), body)]
    }

    fn radial_slopes(
        &mut self,
        (index, group): (usize, &Group),
        (gaussian, inputs): (&Gaussian, &[usize]),
        (entries, first): (&[(usize, usize)], usize),
        variables: usize,
    ) -> Vec<Statement> {
        let tables = self.radial_tables(index, gaussian, inputs);
        let place = |&(function, _): &(usize, usize)| inputs.iter().position(|&input| input == function);
        let used: Vec<(usize, usize, usize)> =
            (entries.iter().enumerate()).filter_map(|(at, entry)| Some((first + at, place(entry)?, entry.1))).collect();
        if used.is_empty() {
            return Vec::new();
        }
        let mut table = |what: &str, comment: &str, of: fn(&(usize, usize, usize)) -> usize| {
            self.table(what, index, comment, 12, Values::Indices(used.iter().map(of).collect()))
        };
        let slope = table("radial_slope", "Slopes of the inputs of the radial functions.", |used| used.0);
        let input = table("radial_input", "Input of each of them.", |used| used.1);
        let variable = table("radial_variable", "Variable of each of them.", |used| used.2);
        let entry = || Index::local("e");
        let j = Index::table(&input, entry());
        let value = Real::local("weight")
            .times(part_of(group, &tables, inputs.len(), &j))
            .times(Real::at(&tables.scale, j.clone()))
            .times(Real::at("d", Index::table(&slope, entry())));
        let to = Index::local("n").times(variables).plus(group.slot * variables).plus(Index::table(&variable, entry()));
        let row = Self::group_region(group).times(group.latents()).plus(Index::local("n"));
        let coefficient = row.times(group.width()).plus(Index::local("i")).plus(group.functions);
        let coefficients = format!("{TABLE}{}coefficients{index}", self.tag);
        let phi = Real::at("q", Index::local("i").plus(group.first + group.functions));
        let weight = Real::Number(-2.0 * gaussian.factor()).times(phi).times(Real::at(&coefficients, coefficient));
        let body = vec![
            Statement::Let("weight".into(), weight),
            Statement::each("e", used.len(), vec![Statement::Add(Place::at("g", to), value)]),
        ];
        vec![Statement::each("n", group.latents(), vec![Statement::each("i", gaussian.count(), body)])]
    }
}

/// `(x_j - c_ij)/s_j`.
fn part(group: &Group, tables: &RadialTables, inputs: usize) -> Real {
    part_of(group, tables, inputs, &Index::local("j"))
}

fn part_of(group: &Group, tables: &RadialTables, inputs: usize, j: &Index) -> Real {
    let x = Real::at("q", Index::table(&tables.inputs, j.clone()).plus(group.first));
    let centre = Real::at(&tables.centres, Index::local("i").times(inputs).plus(j.clone()));
    x.minus(centre).times(Real::at(&tables.scale, j.clone()))
}

/// The value of a unit from its sum.
fn activated(activation: Activation, sum: Real) -> Real {
    match activation {
        Activation::Tanh => Real::unary(Unary::Tanh, sum),
        Activation::Relu => Real::binary(Binary::Max, sum, Real::Number(0.0)),
        Activation::Softplus => {
            let tail = Real::unary(Unary::Exp, Real::unary(Unary::Neg, Real::unary(Unary::Abs, sum.clone())));
            let tail = Real::unary(Unary::Log, Real::Number(1.0).plus(tail));
            Real::binary(Binary::Max, sum, Real::Number(0.0)).plus(tail)
        }
    }
}

/// The derivative of a unit by its sum, from its value.
fn slope_of(activation: Activation, value: Real) -> Real {
    match activation {
        Activation::Tanh => Real::Number(1.0).minus(value.clone().times(value)),
        Activation::Relu => Real::unary(Unary::Step, value),
        Activation::Softplus => Real::Number(1.0).minus(Real::unary(Unary::Exp, Real::unary(Unary::Neg, value))),
    }
}
