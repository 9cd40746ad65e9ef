//! From equations to code: functions, regions, latents and right sides, in the order and with the operations of the engine.

use fleetfoot_library::{Argument as Value, Leaf, Statement as Line, StraightLine};
use fleetfoot_model::{Branch, Rule, Tree, UnseenLabel};

use crate::{
    code::{Condition, Function, Index, Kind, Outcome, Parameter, Place, Real, Statement, TABLE, Table, Values},
    evaluation::{Cells, Evaluation, Group},
    options::Precision,
    plan::{Plan, Source},
};

/// Writes the code of one evaluation: its tables, and statements that refer to them.
pub(crate) struct Lowering<'a> {
    pub(crate) plan: &'a Plan<'a>,
    pub(crate) evaluation: &'a Evaluation,
    pub(crate) precision: Precision,
    pub(crate) domain: bool,
    /// In front of the names of tables.
    pub(crate) tag: &'static str,
    pub(crate) tables: Vec<Table>,
}

impl Lowering<'_> {
    /// `code = name(x, u, past, t, f)`: the right sides.
    pub(crate) fn right_sides(&mut self, name: &'static str) -> Function {
        let count = self.evaluation.right_sides.len();
        let mut body = self.regions_and_latents();
        body.extend(self.rights("f"));
        body.extend(self.finish("f", count));
        let mut parameters = self.plan.parameters();
        parameters.push(Parameter { name: "f", kind: Kind::Out(count) });
        Function { name, gives: true, parameters, body }
    }

    /// `code = name(x, u)`: the region, and nothing else.
    pub(crate) fn region_alone(&mut self, name: &'static str) -> Function {
        let mut body = self.regions_and_latents();
        body.extend(self.finish("q", 0).pop());
        Function { name, gives: true, parameters: self.plan.parameters(), body }
    }

    /// Features, regions and latents: arrays `q` and `l`, counters `region..` and `outside`.
    pub(crate) fn regions_and_latents(&mut self) -> Vec<Statement> {
        let evaluation = self.evaluation;
        let mut body = Vec::new();
        let features = evaluation.features.outputs.len();
        if features > 0 {
            body.push(Statement::Array("q".into(), features));
            let (lines, outputs) = straight(&evaluation.features, "s", &|leaf| self.plan.leaf(leaf));
            body.extend(lines);
            let outputs = outputs.into_iter().enumerate().filter(|(at, _)| !evaluation.is_basis(*at));
            body.extend(outputs.map(|(at, value)| Statement::set("q", at, value)));
        }
        if self.bounded() {
            body.push(Statement::Counter("outside".into(), 0.into()));
        }
        for (index, cells) in evaluation.partitions.iter().enumerate() {
            body.extend(self.region(index, cells));
        }
        if evaluation.latents() > 0 {
            body.push(Statement::Array("l".into(), evaluation.latents()));
        }
        for (index, group) in evaluation.groups.iter().enumerate() {
            body.extend(self.check(index, group));
            body.extend(self.basis(index, group));
            body.extend(self.latents(index, group));
        }
        body
    }

    /// Right sides into the array `to`.
    pub(crate) fn rights(&self, to: &str) -> Vec<Statement> {
        let (mut body, outputs) = straight(&self.evaluation.rights, "r", &|leaf| self.leaf(leaf));
        body.extend(outputs.into_iter().enumerate().map(|(at, value)| Statement::set(to, at, value)));
        body
    }

    /// Checks the results and returns the region.
    pub(crate) fn finish(&self, results: &str, count: usize) -> Vec<Statement> {
        let value = Real::at(results, Index::local("i"));
        let check =
            vec![Statement::If(Condition::NotFinite(value), vec![Statement::Return(Outcome::NotFinite)], Vec::new())];
        let region = self.evaluation.reported.map_or_else(|| 0.into(), |index| Index::local(&region_name(index)));
        let outside = self.bounded().then(|| "outside".to_owned());
        vec![Statement::each("i", count, check), Statement::Return(Outcome::Region { region, outside })]
    }

    /// A column, or behind the columns a latent.
    pub(crate) fn leaf(&self, leaf: Leaf) -> Real {
        match leaf {
            Leaf::Column { column, .. } if column >= self.plan.model.columns.len() => {
                let latent = column - self.plan.model.columns.len();
                Real::at("l", self.evaluation.slots[latent].unwrap_or(0))
            }
            other => self.plan.leaf(other),
        }
    }

    fn bounded(&self) -> bool {
        self.domain && self.evaluation.groups.iter().any(|group| group.ranges.is_some())
    }

    pub(crate) fn table(&mut self, what: &str, index: usize, comment: &str, row: usize, values: Values) -> String {
        let name = format!("{TABLE}{}{what}{index}", self.tag);
        // The right sides and their Jacobian use the same tables.
        if self.tables.iter().all(|table| table.name != name) {
            self.tables.push(Table { name: name.clone(), comment: comment.to_owned(), values, row: row.max(1) });
        }
        name
    }

    pub(crate) fn reals(&mut self, what: &str, index: usize, comment: &str, row: usize, values: Vec<f64>) -> String {
        self.table(what, index, comment, row, Values::Reals(values))
    }

    /// Standardises the columns of a partition and finds the region.
    fn region(&mut self, index: usize, cells: &Cells) -> Vec<Statement> {
        let specification = &self.plan.model.partitions[cells.partition].specification;
        let mut body = vec![Statement::Comment(format!("Region of the partition {specification}."))];
        let columns = cells.centre.len();
        let at = Index::local("j").plus(cells.first);
        let not_finite = Condition::NotFinite(Real::at("q", at.clone()));
        let check = Statement::If(not_finite, vec![Statement::Return(Outcome::NotFinite)], Vec::new());
        let as_they_are = cells.centre.iter().all(|&centre| centre == 0.0) && cells.scale.iter().all(|&s| s == 1.0);
        if columns > 0 && as_they_are {
            body.push(Statement::each("j", columns, vec![check]));
        } else if columns > 0 {
            let centre =
                self.reals("centre", index, "Centre of each column of the partition.", 8, cells.centre.clone());
            let inverse = cells.scale.iter().map(|scale| 1.0 / scale).collect();
            let scale = self.reals("inverse_scale", index, "One over the scale of each column.", 8, inverse);
            let (centre, scale) = (Real::at(&centre, Index::local("j")), Real::at(&scale, Index::local("j")));
            let value = Real::at("q", at.clone()).minus(centre).times(scale);
            body.push(Statement::each("j", columns, vec![Statement::set("q", at, value), check]));
        }
        let region = region_name(index);
        let count = cells.rule.count();
        let refuses = matches!(cells.rule, Rule::Labels { unseen: UnseenLabel::Refuse, .. });
        // A label that is not found is of the last region (the pool) or, refused, of the one behind the last.
        let nowhere = match cells.rule {
            Rule::Labels { unseen: UnseenLabel::Pool, .. } => count - 1,
            Rule::Labels { unseen: UnseenLabel::Refuse, .. } => count,
            _ => 0,
        };
        body.push(Statement::Counter(region.clone(), nowhere.into()));
        let mut numbered = index * 1000;
        body.extend(self.rule(&cells.rule, cells.first..cells.first + columns, 0, &region, &mut numbered));
        if refuses {
            let unseen = Condition::Same(Index::local(&region), count.into());
            body.push(Statement::If(unseen, vec![Statement::Return(Outcome::NoRegion)], Vec::new()));
        }
        body
    }

    /// Sets the counter `region` to `base` plus the region of standardised columns, which are the features `place`.
    fn rule(
        &mut self,
        rule: &Rule,
        place: std::ops::Range<usize>,
        base: usize,
        region: &str,
        number: &mut usize,
    ) -> Vec<Statement> {
        // The first rule of a partition finds the counter at 0; those of labels do not.
        let within_label = !number.is_multiple_of(1000);
        *number += 1;
        let (first, columns) = (place.start, place.len());
        let column = || Real::at("q", Index::local("j").plus(first));
        match rule {
            Rule::Whole => vec![Statement::SetCounter(region.to_owned(), base.into())],
            Rule::Ball { radius } => {
                let square = format!("square{number}");
                let sum = Statement::Add(Place::Local(square.clone()), column().times(column()));
                let outside = vec![Statement::SetCounter(region.to_owned(), (base + 1).into())];
                let less = Condition::Less(Real::Number(radius * radius), Real::local(&square));
                let mut body = vec![
                    Statement::Variable(square, Real::Number(0.0)),
                    Statement::each("j", columns, vec![sum]),
                    Statement::If(less, outside, Vec::new()),
                ];
                if within_label {
                    body.insert(0, Statement::SetCounter(region.to_owned(), base.into()));
                }
                body
            }
            Rule::Box { half } => {
                let outside = vec![Statement::SetCounter(region.to_owned(), (base + 1).into())];
                let beyond = Condition::Outside(column(), Real::Number(-half), Real::Number(*half));
                let mut body = vec![Statement::each("j", columns, vec![Statement::If(beyond, outside, Vec::new())])];
                if within_label {
                    body.insert(0, Statement::SetCounter(region.to_owned(), base.into()));
                }
                body
            }
            Rule::Linear { weights, offsets } => {
                let values = weights.iter().flatten().copied().collect();
                let comment = "Weights of the regions, one row a region: the largest score wins.";
                let weights = self.reals("weights", *number, comment, columns, values);
                let offsets = self.reals("offsets", *number, "Offsets of the regions' scores.", 8, offsets.clone());
                let (best, score) = (format!("best{number}"), format!("score{number}"));
                let weight = Real::at(&weights, Index::local("i").times(columns).plus(Index::local("j")));
                let better = vec![
                    Statement::Set(Place::Local(best.clone()), Real::Local(score.clone())),
                    Statement::SetCounter(region.to_owned(), Index::local("i").plus(base)),
                ];
                let count = rule.count();
                let body = vec![
                    Statement::Variable(score.clone(), Real::at(&offsets, Index::local("i"))),
                    Statement::each(
                        "j",
                        columns,
                        vec![Statement::Add(Place::Local(score.clone()), weight.times(column()))],
                    ),
                    Statement::If(Condition::Less(Real::local(&best), Real::Local(score)), better, Vec::new()),
                ];
                let mut body = vec![
                    Statement::Variable(best, Real::Number(-self.precision.largest())),
                    Statement::each("i", count, body),
                ];
                if within_label {
                    body.insert(0, Statement::SetCounter(region.to_owned(), base.into()));
                }
                body
            }
            Rule::Joined { cells, regions } => {
                // The counter holds the cell until the table gives its region.
                let numbers = regions.iter().map(|&region| region as usize + base).collect();
                let table = self.table("joined", *number, "Region of each cell.", 16, Values::Indices(numbers));
                // The cells' rule stands in this one's place: it finds the counter as this one did.
                *number -= 1;
                let mut body = self.rule(cells, place, 0, region, number);
                let joined = Index::table(&table, Index::local(region));
                body.push(Statement::SetCounter(region.to_owned(), joined));
                body
            }
            Rule::Tree(tree) => {
                let known = (!within_label).then_some(base);
                let root = if tree.cuts.is_empty() { Branch::Region(0) } else { Branch::Cut(0) };
                nested(tree, root, (first, base, known), region)
            }
            Rule::Labels { values, rules, .. } => {
                let label = || Real::at("q", first + columns - 1);
                let mut base = base;
                let mut branches = Vec::new();
                for (&value, rule) in values.iter().zip(rules) {
                    branches.push((value, self.rule(rule, first..first + columns - 1, base, region, number)));
                    base += rule.count();
                }
                // if .. else if .. else if ..
                branches.into_iter().rev().fold(Vec::new(), |otherwise, (value, body)| {
                    vec![Statement::If(Condition::Equal(label(), Real::Number(value)), body, otherwise)]
                })
            }
        }
    }

    /// Index of the region of a group's partition.
    pub(crate) fn group_region(group: &Group) -> Index {
        group.cells.map_or_else(|| 0.into(), |cells| Index::local(&region_name(cells)))
    }

    /// Statements that check that the functions are finite and within the training range of their region.
    fn check(&mut self, index: usize, group: &Group) -> Vec<Statement> {
        let functions = group.functions;
        if functions == 0 {
            return Vec::new();
        }
        let value = Real::at("q", Index::local("j").plus(group.first));
        let refuse =
            Statement::If(Condition::NotFinite(value.clone()), vec![Statement::Return(Outcome::NotFinite)], Vec::new());
        let goes_on = group.beyond.is_some();
        let Some(ranges) = group.ranges.as_ref().filter(|_| self.domain || goes_on) else {
            return vec![Statement::each("j", functions, vec![refuse])];
        };
        let bounds = |end: usize| ranges.iter().map(|range| self.precision.bound(range[end], end == 1)).collect();
        let (low, high): (Vec<f64>, Vec<f64>) = (bounds(0), bounds(1));
        let names = group.names.join(", ");
        let low = self.reals("low", index, &format!("Training domain of {names}: smallest values."), functions, low);
        let high = self.reals("high", index, &format!("Training domain of {names}: largest values."), functions, high);
        let at = Self::group_region(group).times(functions).plus(Index::local("j"));
        let (low, high) = (Real::at(&low, at.clone()), Real::at(&high, at));
        let outside = Condition::Outside(value.clone(), low.clone(), high.clone());
        let mut left = vec![refuse];
        if self.domain {
            left.push(Statement::SetCounter("outside".into(), 1.into()));
        }
        if !goes_on {
            return vec![Statement::each("j", functions, vec![Statement::If(outside, left, Vec::new())])];
        }
        // Remainder of a function beside the border of its range; the function itself is held there.
        let excess = excess_name(index);
        let hold = |border: Real| {
            vec![
                Statement::set(&excess, Index::local("j"), value.clone().minus(border.clone())),
                Statement::set("q", Index::local("j").plus(group.first), border),
            ]
        };
        let side = Statement::If(Condition::Less(value.clone(), low.clone()), hold(low.clone()), hold(high.clone()));
        // The range of a region without rows is empty, and holds nothing.
        left.push(Statement::If(Condition::AtLeast(high, low), vec![side], Vec::new()));
        vec![
            Statement::Array(excess, functions),
            Statement::each("j", functions, vec![Statement::If(outside, left, Vec::new())]),
        ]
    }

    /// The latents of a group.
    fn latents(&mut self, index: usize, group: &Group) -> Vec<Statement> {
        if group.regions == 1 && group.basis.is_none() {
            return (0..group.latents())
                .map(|latent| {
                    let term = |(j, value): (usize, f64)| Real::Number(value).times(Real::at("q", group.first + j));
                    let constant = Some(group.constants[latent]).filter(|constant| *constant != 0.0);
                    let mut sum: Vec<Real> = constant.map(Real::Number).into_iter().collect();
                    sum.extend(group.terms(0, latent).map(term));
                    let value = if sum.is_empty() { Real::Number(0.0) } else { Real::Sum(sum) };
                    Statement::set("l", group.slot + latent, value)
                })
                .collect();
        }
        let (latents, functions) = (group.latents(), group.width());
        let names = group.names.join(", ");
        let comment = format!("Constants of {names}, one row a region.");
        let constants = self.reals("constants", index, &comment, latents, group.constants.clone());
        let row = Self::group_region(group).times(latents).plus(Index::local("i"));
        let mut body = vec![Statement::Variable("sum".into(), Real::at(&constants, row.clone()))];
        let add = |coefficient: Real, function: Index| {
            Statement::Add(Place::Local("sum".into()), coefficient.times(Real::at("q", function.plus(group.first))))
        };
        if functions == 0 {
        } else if group.is_sparse() {
            let sparse = self.sparse(index, group);
            let at = Index::local("k");
            let term = add(Real::at(&sparse.values, at.clone()), Index::table(&sparse.functions, at));
            body.push(sparse.each("k", row, vec![term]));
        } else {
            let comment = format!("Coefficients of {names}: regions x latents x functions.");
            let table = self.reals("coefficients", index, &comment, functions, group.coefficients.clone());
            let at = row.times(functions).plus(Index::local("j"));
            body.push(Statement::each("j", functions, vec![add(Real::at(&table, at), Index::local("j"))]));
        }
        if let Some(beyond) = &group.beyond {
            let comment = format!("Coefficients of {names} outside of the training domain: latents x functions.");
            let slopes = self.reals("slopes_beyond", index, &comment, functions, beyond.clone());
            let slope = Real::at(&slopes, Index::local("i").times(functions).plus(Index::local("j")));
            let more = slope.times(Real::at(&excess_name(index), Index::local("j")));
            body.push(Statement::each("j", functions, vec![Statement::Add(Place::Local("sum".into()), more)]));
        }
        body.push(Statement::set("l", Index::local("i").plus(group.slot), Real::local("sum")));
        vec![Statement::each("i", latents, body)]
    }

    /// Coefficients without their zeros.
    pub(crate) fn sparse(&mut self, index: usize, group: &Group) -> SparseTable {
        let (mut start, mut functions, mut values, mut longest) = (vec![0], Vec::new(), Vec::new(), 0);
        for region in 0..group.regions {
            for latent in 0..group.latents() {
                for (j, value) in group.terms(region, latent) {
                    functions.push(j);
                    values.push(value);
                }
                longest = longest.max(values.len() - start[start.len() - 1]);
                start.push(values.len());
            }
        }
        if values.is_empty() {
            functions.push(0);
            values.push(0.0);
        }
        let names = group.names.join(", ");
        let comment = format!("First coefficient of each region and latent of {names}.");
        let start = self.table("start", index, &comment, 12, Values::Indices(start));
        let functions = self.table("functions", index, "Function of each coefficient.", 12, Values::Indices(functions));
        let values = self.reals("coefficients", index, "Coefficients that are not zero.", 8, values);
        SparseTable { start, functions, values, longest }
    }
}

/// The cuts of a tree, nested. The columns are the features from `first` on, the regions count from `base` on, and
/// `known` is the present value of the counter.
fn nested(
    tree: &Tree,
    place: Branch,
    (first, base, known): (usize, usize, Option<usize>),
    region: &str,
) -> Vec<Statement> {
    match place {
        Branch::Region(leaf) if known == Some(base + leaf as usize) => Vec::new(),
        Branch::Region(leaf) => vec![Statement::SetCounter(region.to_owned(), (base + leaf as usize).into())],
        Branch::Cut(at) => {
            let cut = &tree.cuts[at];
            let (value, threshold) = (Real::at("q", first + cut.column), Real::Number(cut.threshold));
            let side = |next| nested(tree, next, (first, base, known), region);
            let (below, above) = (side(cut.below), side(cut.above));
            vec![match below.is_empty() {
                true => Statement::If(Condition::AtLeast(value, threshold), above, below),
                false => Statement::If(Condition::Less(value, threshold), below, above),
            }]
        }
    }
}

/// Names of the tables of a sparse group, and the most terms that a latent has in a region.
pub(crate) struct SparseTable {
    start: String,
    pub(crate) functions: String,
    pub(crate) values: String,
    longest: usize,
}

impl SparseTable {
    /// A loop over the coefficients of a row (region and latent).
    pub(crate) fn each(&self, index: &str, row: Index, body: Vec<Statement>) -> Statement {
        Statement::For {
            index: index.to_owned(),
            from: Index::table(&self.start, row.clone()),
            to: Index::table(&self.start, row.plus(1)),
            turns: self.longest,
            body,
        }
    }
}

/// The inputs of the next row.
pub(crate) const NEXT_INPUTS: &str = "u_next";

/// The array of what is left of the functions of a group beside the border of their ranges.
pub(crate) fn excess_name(index: usize) -> String {
    format!("beyond{index}")
}

pub(crate) fn region_name(index: usize) -> String {
    format!("region{index}")
}

impl Plan<'_> {
    /// Parameters that right sides read: `x`, `u`, `u_next`, `past`, `t`, those that are not empty.
    pub(crate) fn parameters(&self) -> Vec<Parameter> {
        let next = if self.next_inputs { self.inputs.len() } else { 0 };
        let arrays = [("x", self.states.len()), ("u", self.inputs.len()), (NEXT_INPUTS, next), ("past", self.memory())];
        let arrays = arrays.into_iter().filter(|(_, length)| *length > 0);
        let mut all: Vec<Parameter> = arrays.map(|(name, length)| Parameter { name, kind: Kind::In(length) }).collect();
        if self.time {
            all.push(Parameter { name: "t", kind: Kind::Value });
        }
        all
    }

    /// Value of a leaf.
    pub(crate) fn leaf(&self, leaf: Leaf) -> Real {
        let (source, lag) = match leaf {
            Leaf::Time { lag } => (Some(Source::Time), lag),
            Leaf::Column { column, lag } => (self.place(column), lag),
        };
        let past = source.and_then(|source| self.past(source, lag)).unwrap_or(0);
        match (source, lag) {
            (Some(Source::State(i)), 0) => Real::at("x", i),
            (Some(Source::Input(i)), 0) => Real::at("u", i),
            (Some(Source::Input(i)), -1) => Real::at(NEXT_INPUTS, i),
            (Some(Source::Time), 0) => Real::local("t"),
            (Some(Source::Time), _) => Real::local("t").minus(Real::at("past", past)),
            _ => Real::at("past", past),
        }
    }
}

/// Longest expression that is written in one piece, in operations.
const LONGEST: usize = 8;

/// Straight-line code as statements (names `prefix0`, ...) and the values of its outputs. A value that is used once is
/// written in its place.
pub(crate) fn straight(code: &StraightLine, prefix: &str, leaf: &dyn Fn(Leaf) -> Real) -> (Vec<Statement>, Vec<Real>) {
    let mut uses = vec![0usize; code.statements.len()];
    let mut count = |value: Value| {
        if let Value::Statement(at) = value {
            uses[at] += 1;
        }
    };
    for line in &code.statements {
        match *line {
            Line::Unary(_, x) => count(x),
            Line::Binary(_, a, b) => {
                count(a);
                count(b);
            }
        }
    }
    code.outputs.iter().for_each(|&output| count(output));
    let mut body = Vec::new();
    let mut values: Vec<(Real, usize)> = Vec::with_capacity(code.statements.len());
    let read = |values: &[(Real, usize)], value: Value| match value {
        Value::Number(number) => (Real::Number(number), 0),
        Value::Leaf(index) => (leaf(code.leaves[index]), 0),
        Value::Statement(at) => values[at].clone(),
    };
    for (at, line) in code.statements.iter().enumerate() {
        let (value, size) = match *line {
            Line::Unary(function, x) => {
                let (x, size) = read(&values, x);
                (Real::unary(function, x), size + 1)
            }
            Line::Binary(function, a, b) => {
                let ((a, m), (b, n)) = (read(&values, a), read(&values, b));
                (Real::binary(function, a, b), m + n + 1)
            }
        };
        if uses[at] > 1 || size > LONGEST {
            let name = format!("{prefix}{at}");
            body.push(Statement::Let(name.clone(), value));
            values.push((Real::Local(name), 0));
        } else {
            values.push((value, size));
        }
    }
    let outputs = code.outputs.iter().map(|&output| read(&values, output).0).collect();
    (body, outputs)
}
