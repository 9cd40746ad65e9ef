//! A predictive controller in C: the program and the solver of the engine, with its operations in its order.
//!
//! `controller.c` is the solver with `$` before each name that depends on the controller, `@` behind each number and
//! function whose type is that of the code, and `%if`, `%else` and `%end` around lines of some controllers only.

mod header;
mod template;
mod test;

use fleetfoot_control::{
    controller::{MOST_SEQUENCES, PredictionTables, Regulator},
    predictive::{
        CENTRED, DECREASE, FIRST_STEPS, INSIDE, LAST_STEPS, MOST_HALVINGS, MOST_ITERATIONS, NEAR, SOLVED, UNLIMITED,
    },
};

use crate::{
    ExportError, ExportOptions, ExportedFile, Precision,
    assemble::closed,
    c_syntax::C,
    code::{Code, Table, Values},
    cost::Used,
    evaluation::{Cells, Evaluation, program},
    lower::Lowering,
    plan::Plan,
    print::Syntax,
};
use template::Template;

/// Residual of a solved program in 32 bits: some hundred roundings of inputs of the order of 1.
const SOLVED_FLOAT: f64 = 1e-4;

/// Mean complementarity in 32 bits at which the interior-point method ends.
const CENTRED_FLOAT: f64 = 1e-4;

/// A predictive controller that is written in C.
struct Predictive<'a> {
    c: C<'a>,
    law: &'a Regulator,
    tables: PredictionTables,
    /// Inputs of the code: the columns that the law reads, then the driven inputs that regions are chosen by.
    columns: Vec<String>,
    /// Hash of the model of the law's measurements.
    model: String,
}

/// The files `PREFIX.h`, `PREFIX.c` and `PREFIX_test.c` of a regulator with a prediction.
///
/// # Errors
/// Those of [`export`](crate::export()); a regulator without a prediction, or one that cannot be used
/// ([`ExportError::Inconsistent`]).
pub fn export_predictive(law: &Regulator, options: &ExportOptions) -> Result<Vec<ExportedFile>, ExportError> {
    let inconsistent = |error: String| ExportError::Inconsistent(error);
    let model = law.measurements().map_err(|error| inconsistent(error.to_string()))?;
    let tables = law.prediction_tables().ok_or_else(|| inconsistent("the controller has no prediction".to_owned()))?;
    let closed = closed(&model, options)?;
    let plan = Plan::new(&closed)?;
    let evaluation = plan.predict.as_ref().ok_or(ExportError::NoEquations)?;
    let mut code = Code::default();
    let lowering = |evaluation| Lowering {
        plan: &plan,
        evaluation,
        precision: options.precision,
        domain: false,
        tag: "",
        tables: Vec::new(),
    };
    let mut measuring = lowering(evaluation);
    code.functions.push(measuring.right_sides("measure"));
    code.tables.append(&mut measuring.tables);
    let regions = (tables.program.steps.len() > 1).then(|| partition(&closed.model)).transpose()?;
    if let Some(regions) = &regions {
        let mut choosing = lowering(regions);
        code.functions.push(choosing.region_alone("region"));
        code.tables.append(&mut choosing.tables);
    }
    let columns: Vec<String> = plan.inputs.iter().map(|input| input.name.clone()).collect();
    let c = C { precision: options.precision, prefix: &options.prefix };
    let controller = Predictive { c, law, tables, columns, model: model.hash() };
    code.tables.extend(controller.constants());
    let prefix = &options.prefix;
    Ok(vec![
        ExportedFile::text(format!("{prefix}.h"), controller.header()),
        ExportedFile::text(format!("{prefix}.c"), controller.source(&code)),
        ExportedFile::text(format!("{prefix}_test.c"), controller.test()),
    ])
}

/// An evaluation of the partition's columns and nothing else.
fn partition(model: &fleetfoot_model::Model) -> Result<Evaluation, ExportError> {
    let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
    let partition = &model.partitions[0];
    let none: [fleetfoot_library::Expr; 0] = [];
    let cells = Cells {
        partition: 0,
        first: 0,
        centre: partition.centre.clone(),
        scale: partition.scale.clone(),
        rule: partition.rule.clone(),
    };
    Ok(Evaluation {
        features: program(&partition.columns, &columns)?,
        expressions: partition.columns.clone(),
        partitions: vec![cells],
        groups: Vec::new(),
        rights: program(&none, &columns)?,
        right_sides: Vec::new(),
        reported: Some(0),
        slots: Vec::new(),
    })
}

impl Predictive<'_> {
    fn states(&self) -> usize {
        self.tables.program.states()
    }

    fn inputs(&self) -> usize {
        self.tables.program.inputs()
    }

    fn regions(&self) -> usize {
        self.tables.program.steps.len()
    }

    /// Columns that the law reads.
    fn reads(&self) -> usize {
        self.columns.len() - self.driven().len()
    }

    /// Places of the driven inputs that regions are chosen by.
    fn driven(&self) -> Vec<usize> {
        let place = |name: &String| self.law.inputs.iter().position(|input| input.name == *name);
        self.columns.iter().filter_map(place).collect()
    }

    fn constants(&self) -> Vec<Table> {
        let largest = self.c.precision.largest();
        let program = &self.tables.program;
        let (n, m, k) = (self.states(), self.inputs(), self.law.measured.len());
        let mut tables = Vec::new();
        let mut reals = |name: &str, comment: &str, row: usize, values: Vec<f64>| {
            if !values.is_empty() {
                let values = values.into_iter().map(|value| value.clamp(-largest, largest)).collect();
                tables.push(Table {
                    name: format!("${name}"),
                    comment: comment.to_owned(),
                    values: Values::Reals(values),
                    row: row.max(1),
                });
            }
        };
        let of_inputs = |of: &dyn Fn(&fleetfoot_control::controller::DrivenInput) -> f64| -> Vec<f64> {
            self.law.inputs.iter().map(of).collect()
        };
        let limits = &self.tables.limits;
        reals("a", "Of every region: the next states by the states.", n, all(program.steps.iter().map(|s| &s.a)));
        reals("b", "Of every region: the next states by the inputs.", m, all(program.steps.iter().map(|s| &s.b)));
        reals("c", "Of every region: the constant of the step.", n, self.tables.constants.clone());
        reals("c_slope", "Its change by the measured columns.", k, self.tables.constant_slopes.clone());
        reals("weight", "Weights of states.", n, program.weights.clone());
        reals("input_weight", "Weights of inputs.", m, program.input_weights.clone());
        reals("terminal", "Cost of the last states.", n, program.terminal.clone());
        reals("curvature", "Second derivatives of the cost by the inputs.", m, program.curvature.clone());
        reals("target", "The states that cost nothing.", n, self.tables.target.clone());
        reals("target_slope", "Their change by the measured columns.", k, self.tables.target_slopes.clone());
        reals("input_target", "The inputs that cost nothing.", m, self.tables.input_target.clone());
        reals("input_target_slope", "Their change.", k, self.tables.input_target_slopes.clone());
        reals("law", "Gain of the linear law behind a plan.", n, self.tables.gain.clone());
        reals("size", "Size of every state.", n, self.tables.sizes.clone());
        reals("input_size", "Size of every input.", m, self.tables.input_sizes.clone());
        reals("at", "Value of every input that counts as 0.", m, self.tables.at.clone());
        reals("lowest", "Lowest inputs, in sizes.", m, limits.iter().map(|limit| limit[0]).collect());
        reals("highest", "Highest inputs, in sizes.", m, limits.iter().map(|limit| limit[1]).collect());
        reals("lowest_command", "Lowest commands.", m, of_inputs(&|input| input.lowest));
        reals("highest_command", "Highest commands.", m, of_inputs(&|input| input.highest));
        let at =
            |(input, at): (&fleetfoot_control::controller::DrivenInput, &f64)| at.max(input.lowest).min(input.highest);
        reals(
            "command",
            "Commands before the first step.",
            m,
            self.law.inputs.iter().zip(&self.tables.at).map(at).collect(),
        );
        let bounds = &program.bounds;
        reals("bound_lowest", "Lowest value of every bound.", 8, bounds.iter().map(|bound| bound.lowest).collect());
        reals("bound_highest", "Highest value of every bound.", 8, bounds.iter().map(|bound| bound.highest).collect());
        reals("bound_weight", "Weight of the violation of every bound.", 8, bounds.iter().map(|b| b.weight).collect());
        let integral = self.law.laws.iter().flat_map(|law| law.integral.iter().flatten().copied()).collect();
        reals("integral_gain", "Of every region: gains of the integrals.", self.law.integrated.len(), integral);
        let mut indices = |name: &str, comment: &str, values: Vec<usize>| {
            if !values.is_empty() {
                let values = Values::Indices(values);
                tables.push(Table { name: format!("${name}"), comment: comment.to_owned(), values, row: 16 });
            }
        };
        indices("bound_state", "State of every bound.", bounds.iter().map(|bound| bound.state).collect());
        indices("integrated", "Error of every integral.", self.law.integrated.clone());
        tables
    }

    /// Tables, measurements, regions, then the solver.
    fn source(&self, code: &Code) -> String {
        let p = self.c.prefix;
        let mut out = format!(
            "/* See {p}.h. */\n#include \"{p}.h\"\n\n#include <float.h>\n#include <math.h>\n#include <stddef.h>\n\n"
        );
        let upper = self.c.upper();
        let program = &self.tables.program;
        for (name, value) in [
            ("N", program.horizon),
            ("NX", self.states()),
            ("NU", self.inputs()),
            ("NR", self.regions()),
            ("NB", program.bounds.len()),
            ("NE", self.law.sizes().len()),
            ("NQ", self.law.integrated.len()),
            ("NW", self.law.measured.len()),
            ("NI", self.inequalities()),
        ] {
            out += &format!("#define {upper}_{name} ((size_t){value})\n");
        }
        out += "\n";
        let mut used = Used::of(code);
        if self.regions() > 1 && self.law.states.iter().any(|state| state.angle) {
            used.unary.insert(fleetfoot_library::Unary::Wrap);
        }
        self.c.helpers(&used, &mut out);
        self.c.code(code, &mut out);
        out + &self.template().fill(include_str!("predictive/controller.c"))
    }

    fn inequalities(&self) -> usize {
        2 * self.tables.program.horizon * (self.inputs() + self.tables.program.bounds.len())
    }

    fn template(&self) -> Template {
        let float = self.c.precision == Precision::Float;
        let many = self.regions() > 1;
        let number = |value: f64| self.c.number(value);
        let measurements = self.law.sizes().len()
            + self.law.measured.len()
            + self.law.partition.as_ref().map_or(0, |p| p.columns.len());
        let (reads, columns) = (self.reads(), self.columns.len());
        Template {
            flags: vec![
                ("bounds", !self.tables.program.bounds.is_empty()),
                ("integrals", !self.law.integrated.is_empty()),
                ("measured", !self.law.measured.is_empty()),
                ("regions", many),
            ],
            words: vec![
                ("row_parameter", if many { format!("{} row[{columns}], ", self.c.real()) } else { String::new() }),
                ("row_argument", if many { "row, ".to_owned() } else { String::new() }),
                ("predicted_row", self.predicted_row()),
                ("driven_row", self.driven_row()),
                ("measurements", measurements.to_string()),
                ("decrease", number(DECREASE)),
                ("near", number(NEAR)),
                ("halvings", MOST_HALVINGS.to_string()),
                ("solved", number(if float { SOLVED_FLOAT } else { SOLVED })),
                ("first_steps", FIRST_STEPS.to_string()),
                ("last_steps", LAST_STEPS.to_string()),
                ("iterations", MOST_ITERATIONS.to_string()),
                ("sequences", MOST_SEQUENCES.to_string()),
                ("centred", number(if float { CENTRED_FLOAT } else { CENTRED })),
                ("inside", number(INSIDE)),
                ("unlimited", number(UNLIMITED)),
                ("period", number(self.law.period)),
                ("region * ", if many { "(size_t)region * ".to_owned() } else { "0 * ".to_owned() }),
                ("index", self.index().to_owned()),
                ("reads", reads.to_string()),
                ("columns", columns.to_string()),
                ("P", self.c.upper()),
                ("p", self.c.prefix.to_owned()),
                ("t", self.c.real().to_owned()),
            ],
            suffix: if float { "f" } else { "" },
        }
    }

    /// The type of a region's index.
    fn index(&self) -> &'static str {
        if self.regions() > 256 { "uint16_t" } else { "uint8_t" }
    }

    /// The row of a predicted state: states and driven inputs have their predicted values, other columns keep theirs.
    fn predicted_row(&self) -> String {
        let mut lines = Vec::new();
        for (i, state) in self.law.states.iter().enumerate() {
            let value = format!("{} + x[{i}] * {}_size[{i}]", self.c.number(state.at), self.c.prefix);
            let value = if state.angle { format!("{}_wrap_({value})", self.c.prefix) } else { value };
            lines.push(format!("        row[{i}] = {value};"));
        }
        for (place, j) in self.driven().into_iter().enumerate() {
            let p = self.c.prefix;
            lines.push(format!("        row[{}] = {p}_input_size[{j}] * v[{j}] + {p}_at[{j}];", self.reads() + place));
        }
        lines.join("\n")
    }

    /// The last commands in the row.
    fn driven_row(&self) -> String {
        let line = |(place, j): (usize, usize)| format!("    row[{}] = s->command[{j}];", self.reads() + place);
        self.driven().into_iter().enumerate().map(line).collect::<Vec<_>>().join("\n")
    }
}

fn all<'a>(parts: impl Iterator<Item = &'a Vec<f64>>) -> Vec<f64> {
    parts.flatten().copied().collect()
}
