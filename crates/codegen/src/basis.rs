//! Basis functions in code: loops over constant tables.

use fleetfoot_library::Unary;
use fleetfoot_model::{Basis, Gaussian};

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
            Some((Basis::Gaussian(own), inputs)) => self.radial(index, group, own, inputs),
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
            Some((Basis::Gaussian(own), inputs)) => {
                self.radial_slopes((index, group), (own, inputs), entries, variables)
            }
        }
    }

    fn radial_tables(&mut self, index: usize, own: &Gaussian, inputs: &[usize]) -> RadialTables {
        let centres = own.centres.iter().flatten().copied().collect();
        let inverse = own.scale.iter().map(|scale| 1.0 / scale).collect();
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
    fn radial(&mut self, index: usize, group: &Group, own: &Gaussian, inputs: &[usize]) -> Vec<Statement> {
        let tables = self.radial_tables(index, own, inputs);
        let count = inputs.len();
        let square = vec![
            Statement::Let("part".into(), part(group, &tables, count)),
            Statement::Add(Place::Local("square".into()), Real::local("part").times(Real::local("part"))),
        ];
        let value = Real::unary(Unary::Exp, Real::Number(-own.factor()).times(Real::local("square")));
        let body = vec![
            Statement::Variable("square".into(), Real::Number(0.0)),
            Statement::each("j", count, square),
            Statement::set("q", Index::local("i").plus(group.first + group.functions), value),
        ];
        vec![Statement::each("i", own.count(), body)]
    }

    fn radial_slopes(
        &mut self,
        (index, group): (usize, &Group),
        (own, inputs): (&Gaussian, &[usize]),
        (entries, first): (&[(usize, usize)], usize),
        variables: usize,
    ) -> Vec<Statement> {
        let tables = self.radial_tables(index, own, inputs);
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
        let weight = Real::Number(-2.0 * own.factor()).times(phi).times(Real::at(&coefficients, coefficient));
        let body = vec![
            Statement::Let("weight".into(), weight),
            Statement::each("e", used.len(), vec![Statement::Add(Place::at("g", to), value)]),
        ];
        vec![Statement::each("n", group.latents(), vec![Statement::each("i", own.count(), body)])]
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
