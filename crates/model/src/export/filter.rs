//! A filter in C: the switched Kalman filter of a model with affine regions, with the operations of the engine in the engine's order.
//!
//! Which region holds is the code of the model itself; what is around it is the same for all models but for sizes and tables, and stands in `filter.c.txt`.

use super::{
    ExportError, ExportOptions, ExportedFile,
    assemble::closed,
    c_syntax::C,
    code::{Code, Table, Values},
    cost::Used,
    evaluation::Evaluation,
    lower::Lowering,
    names::{check_prefix, comment, constants},
    options::Precision,
    plan::Plan,
    print::Syntax,
    public::fold,
};
use crate::Model;

/// What does not hang on the model.
const TEMPLATE: &str = include_str!("filter/filter.c.txt");

/// The numbers of a filter; matrices by rows, region after region.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FilterTables {
    /// Names of the n states.
    pub states: Vec<String>,
    /// Whether a state is an angle.
    pub angles: Vec<bool>,
    /// Names of the m inputs.
    pub inputs: Vec<String>,
    /// Names of the regions.
    pub regions: Vec<String>,
    /// n x n of every region.
    pub a: Vec<Vec<f64>>,
    /// n x m.
    pub b: Vec<Vec<f64>>,
    /// n.
    pub c: Vec<Vec<f64>>,
    /// n x n: the covariance of a step's noise.
    pub q: Vec<Vec<f64>>,
    /// What hangs on the rows before, where the noise is not white.
    pub colour: Option<FilterColour>,
    /// Of every sensor: the state that it measures, and its standard deviation.
    pub sensors: Vec<(usize, f64)>,
    /// Mean and standard deviation of every state before it is measured.
    pub prior: Vec<[f64; 2]>,
    /// Points of the standard normal distribution (points x n).
    pub points: Vec<f64>,
    /// Probabilities from region to region, where these do not follow from the state.
    pub transitions: Option<Vec<Vec<f64>>>,
    /// Whether the partition looks at inputs.
    pub regions_read_inputs: bool,
    /// Seconds of a step.
    pub period: f64,
}

/// Process noise that hangs on that of the rows before: an autoregression of order p of the q whitened residuals, matrices by rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FilterColour {
    /// What the residuals of a row become in the states: n x q of every region.
    pub s: Vec<Vec<f64>>,
    /// q x (p q): by those of the row before, of the one before that, ...
    pub coefficients: Vec<f64>,
    /// q x q: the covariance of what is new.
    pub innovation: Vec<f64>,
    /// (p q) x (p q): the covariance of the residuals of p rows.
    pub stationary: Vec<f64>,
}

/// The files `PREFIX_filter.h` and `PREFIX_filter.c` of a filter of a model.
///
/// # Errors
/// Those of [`super::export`].
pub fn export_filter(
    model: &Model,
    tables: &FilterTables,
    options: &ExportOptions,
) -> Result<Vec<ExportedFile>, ExportError> {
    check_prefix(&options.prefix)?;
    let closed = closed(model, options)?;
    let plan = Plan::new(&closed)?;
    let prefix = format!("{}_filter", options.prefix);
    let by_state = tables.transitions.is_none() && tables.regions.len() > 1;
    let mut code = Code::default();
    let regions = partition_alone(&closed.model, plan.advance.as_ref())?;
    if let Some(evaluation) = regions.as_ref().filter(|_| by_state) {
        let precision = options.precision;
        let mut lowering = Lowering { plan: &plan, evaluation, precision, domain: false, tag: "", tables: Vec::new() };
        code.functions.push(lowering.region_alone("region"));
        code.tables = lowering.tables;
    }
    let inputs: Vec<usize> =
        (plan.inputs.iter()).filter_map(|input| tables.inputs.iter().position(|own| *own == input.name)).collect();
    code.tables.extend(constant_tables(tables, &inputs, by_state));
    let printer = Printer { c: C { precision: options.precision, prefix: &prefix }, tables, inputs, by_state, model };
    Ok(vec![
        ExportedFile::text(format!("{prefix}.h"), printer.header()),
        ExportedFile::text(format!("{prefix}.c"), printer.source(&code)),
    ])
}

/// An evaluation of the reported partition's columns and nothing else.
fn partition_alone(model: &Model, advance: Option<&Evaluation>) -> Result<Option<Evaluation>, ExportError> {
    let Some((evaluation, reported)) = advance.and_then(|own| Some((own, own.reported?))) else { return Ok(None) };
    let own = &evaluation.partitions[reported];
    let columns: Vec<&str> = model.columns.iter().map(|column| column.name.as_str()).collect();
    let expressions = model.partitions[own.partition].columns.clone();
    let cells = super::evaluation::Cells {
        partition: own.partition,
        first: 0,
        centre: own.centre.clone(),
        scale: own.scale.clone(),
        rule: own.rule.clone(),
    };
    Ok(Some(Evaluation {
        features: super::evaluation::program(&expressions, &columns)?,
        expressions,
        partitions: vec![cells],
        groups: Vec::new(),
        rights: super::evaluation::program(&[], &columns)?,
        right_sides: Vec::new(),
        reported: Some(0),
        slots: Vec::new(),
    }))
}

fn constant_tables(tables: &FilterTables, inputs: &[usize], by_state: bool) -> Vec<Table> {
    let n = tables.states.len();
    let reals = |name: &str, comment: &str, row: usize, values: Vec<f64>| Table {
        name: format!("${name}"),
        comment: comment.to_owned(),
        values: Values::Reals(values),
        row: row.max(1),
    };
    let all = |of: &[Vec<f64>]| of.iter().flatten().copied().collect::<Vec<_>>();
    let driven = |b: &Vec<f64>| -> Vec<f64> {
        let m = tables.inputs.len();
        (0..n).flat_map(|i| inputs.iter().map(move |&input| b[i * m + input])).collect()
    };
    let deviation = |of: &dyn Fn(f64) -> f64| tables.sensors.iter().map(|&(_, own)| of(own)).collect::<Vec<_>>();
    let mut made = vec![
        reals("a", "Of every region: the next states by the states.", n, all(&tables.a)),
        reals("c", "Of every region: what is added.", n, all(&tables.c)),
        reals("q", "Of every region: the covariance of a step's noise.", n, all(&tables.q)),
        reals("variance", "The variance of every sensor.", 8, deviation(&|own| own * own)),
        // The engine keeps the root of it, and squares that again.
        reals(
            "start_variance",
            "The same, of a state that begins there.",
            8,
            deviation(&|own| (own * own).sqrt().powi(2)),
        ),
        reals(
            "prior_mean",
            "Where states begin that are not measured.",
            8,
            tables.prior.iter().map(|own| own[0]).collect(),
        ),
        reals("prior_variance", "The variance of that.", 8, tables.prior.iter().map(|own| own[1] * own[1]).collect()),
        Table {
            name: "$sensor".into(),
            comment: "The state of every sensor.".into(),
            values: Values::Indices(tables.sensors.iter().map(|own| own.0).collect()),
            row: 16,
        },
    ];
    if !inputs.is_empty() {
        made.push(reals(
            "b",
            "Of every region: the next states by the inputs.",
            inputs.len(),
            tables.b.iter().flat_map(driven).collect(),
        ));
    }
    if by_state {
        made.push(reals("points", "Points of the standard normal distribution.", n, tables.points.clone()));
    }
    if let Some(colour) = &tables.colour {
        let q = colour.innovation.len().isqrt();
        made.push(reals("s", "Of every region: the next states by the residuals of the row.", q, all(&colour.s)));
        let columns = colour.coefficients.len().checked_div(q).unwrap_or(0);
        made.push(reals("phi", "Residuals by those of the rows before.", columns, colour.coefficients.clone()));
        made.push(reals("new", "The covariance of what is new in residuals.", q, colour.innovation.clone()));
        made.push(reals("lasting", "The covariance of residuals at any time.", columns, colour.stationary.clone()));
    }
    if let Some(transitions) = tables.transitions.as_ref().filter(|rows| rows.len() > 1) {
        made.push(reals("transition", "Probabilities from region to region.", transitions.len(), all(transitions)));
    }
    made
}

struct Printer<'a> {
    c: C<'a>,
    tables: &'a FilterTables,
    /// Places of the code's inputs among those of the tables.
    inputs: Vec<usize>,
    by_state: bool,
    model: &'a Model,
}

impl Printer<'_> {
    fn points(&self) -> usize {
        self.tables.points.len() / self.tables.states.len().max(1)
    }

    /// Residuals of a row that the noise hangs on, and how many of all rows are kept.
    fn residuals(&self) -> (usize, usize) {
        let colour = self.tables.colour.as_ref();
        let q = colour.map_or(0, |colour| colour.innovation.len().isqrt());
        (q, colour.map_or(0, |colour| colour.stationary.len().isqrt()))
    }

    fn header(&self) -> String {
        let (p, upper, t) = (self.c.prefix, self.c.upper(), self.c.real());
        let (n, s, r) = (self.tables.states.len(), self.tables.sensors.len(), self.tables.regions.len());
        let names: Vec<&str> = self.inputs.iter().map(|&input| self.tables.inputs[input].as_str()).collect();
        let sensors: Vec<&str> = self.tables.sensors.iter().map(|own| self.tables.states[own.0].as_str()).collect();
        let about = format!(
            "Switched Kalman filter of the model {}: normal distributions of the states, one a region, whose points cross the borders of the regions. A step is {:?} s. C99, no heap, no global variables; all functions are reentrant, and all memory is that of a {p}_state. A measurement that is not a number was not made; an input that is none is held.",
            self.model.hash(),
            self.tables.period
        );
        let mut out = String::from("/*\n");
        for line in fold(&about, 112) {
            out += &format!(" * {line}\n");
        }
        out += &format!(
            " */\n#ifndef {upper}_H\n#define {upper}_H\n\n#include <stdint.h>\n\n#ifdef __cplusplus\nextern \"C\" {{\n#endif\n\n"
        );
        let states: Vec<&str> = self.tables.states.iter().map(String::as_str).collect();
        let regions: Vec<&str> = self.tables.regions.iter().map(String::as_str).collect();
        for (what, kind, names) in [
            ("States, in the order of x.", "STATE", states),
            ("Inputs, in the order of u.", "INPUT", names),
            ("Sensors, in the order of z.", "SENSOR", sensors),
            ("Regions, in the order of w.", "REGION", regions),
        ] {
            out += &format!("/* {what} */\nenum {{\n");
            for (index, (word, name)) in constants(names.iter().copied()).iter().zip(&names).enumerate() {
                out += &format!("    {upper}_{kind}_{word} = {index}, /* {} */\n", comment(name));
            }
            out += &format!("    {upper}_{kind}_COUNT = {}\n}};\n\n", names.len());
        }
        let nn = n * n;
        let all = n + self.residuals().1;
        let square = all * all;
        out += &format!(
            "/* A filter on its way. */\ntypedef struct {{\n    {t} x[{n}]; /* the states */\n    {t} cov[{nn}]; /* their covariance, by rows */\n    {t} w[{r}]; /* the probability of every region */\n    {t} log_likelihood; /* of what the last step measured */\n"
        );
        if !self.inputs.is_empty() {
            out += &format!("    {t} u[{}];\n", self.inputs.len());
        }
        out += &format!(
            "    {t} m[{r}][{all}];\n    {t} p[{r}][{square}];\n    {t} next_m[{r}][{all}];\n    {t} next_p[{r}][{square}];\n"
        );
        if self.by_state {
            let points = self.points();
            out += &format!(
                "    {t} part_m[{r}][{all}];\n    {t} part_p[{r}][{square}];\n    int16_t place[{r}][{points}];\n    int16_t before[{r}][{points}];\n"
            );
        }
        out += &format!("}} {p}_state;\n\n");
        let u = self.u_parameter();
        out += &format!(
            "/* Begins at a row: states that it measures at what it says. */\nvoid {p}_start({p}_state *f, const {t} z[{s}]);\n\n/* Passes to the next row: u are the inputs of the row before, held over the step, z the measurements of the new one. */\nvoid {p}_step({p}_state *f{u}, const {t} z[{s}]);\n\n"
        );
        out += &format!("#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {upper}_H */\n");
        out
    }

    fn u_parameter(&self) -> String {
        match self.inputs.len() {
            0 => String::new(),
            m => format!(", const {} u[{m}]", self.c.real()),
        }
    }

    fn source(&self, code: &Code) -> String {
        let mut used = Used::of(code);
        if self.tables.angles.contains(&true) {
            used.unary.insert(fleetfoot_library::Unary::Wrap);
        }
        let p = self.c.prefix;
        let mut out = format!(
            "/* See {p}.h. */\n#include \"{p}.h\"\n\n#include <float.h>\n#include <math.h>\n#include <stdbool.h>\n#include <stddef.h>\n\n"
        );
        if self.by_state {
            let upper = self.c.upper();
            out += &format!("enum {{ {upper}_NO_REGION = -32767, {upper}_NOT_FINITE = -32766 }};\n\n");
        }
        self.c.helpers(&used, &mut out);
        self.c.code(code, &mut out);
        out + &self.body()
    }

    /// A function of the standard library for the numbers' type.
    fn library(&self, name: &str) -> String {
        match self.c.precision {
            Precision::Float => format!("{name}f"),
            Precision::Double => name.to_owned(),
        }
    }

    /// Statements that take the angles among the states within half a turn.
    fn wrapped(&self, index: &str, value: &str) -> String {
        let own = |(i, _): (usize, &bool)| {
            format!("if ({index} == {i}) {{\n    {value} = {}_wrap_({value});\n}}\n", self.c.prefix)
        };
        self.tables.angles.iter().enumerate().filter(|(_, angle)| **angle).map(own).collect()
    }

    fn body(&self) -> String {
        let (p, t) = (self.c.prefix, self.c.real());
        let (n, r, points) = (self.tables.states.len(), self.tables.regions.len(), self.points());
        let m = self.inputs.len();
        let switches = self.tables.transitions.is_some() && r > 1;
        let largest = if self.c.precision == Precision::Float { "FLT_MAX" } else { "DBL_MAX" };
        let given = if m > 0 { ", f->u" } else { "" };
        let by_state = |text: &str| if self.by_state { text.to_owned() } else { String::new() };
        let mut text = TEMPLATE.to_owned();
        let (q, behind) = self.residuals();
        let all = n + behind;
        if behind > 0 {
            for (from, to, other) in [
                ("/* The normal distribution of those", "/* The normal distribution with the moments", PART),
                ("/* Of every region: its step", "/* Takes in one measurement", PREDICT),
            ] {
                if let (Some(from), Some(to)) = (text.find(from), text.find(to)) {
                    text.replace_range(from..to, other);
                }
            }
        }
        if !self.by_state {
            for (from, to) in [("/* A point of a distribution", "/* The normal distribution with the moments")] {
                if let (Some(from), Some(to)) = (text.find(from), text.find(to)) {
                    text.replace_range(from..to, "");
                }
            }
            if let (Some(from), Some(to)) =
                (text.find("/* Lower Cholesky"), text.find("/* The normal distribution with the moments"))
            {
                text.replace_range(from..to, "");
            }
            if !switches && let (Some(from), Some(to)) = (text.find("/* Joins in every region"), text.find("@JOIN@")) {
                text.replace_range(from..to, "");
            }
        }
        let take_u = match m {
            0 => String::new(),
            _ if self.by_state && self.tables.regions_read_inputs => format!(
                "bool changed = false;\nfor (size_t i = 0; i < {m}; ++i) {{\n    if (u[i] >= -@MAX@ && u[i] <= @MAX@) {{\n        changed = changed || u[i] < f->u[i] || u[i] > f->u[i];\n        f->u[i] = u[i];\n    }}\n}}\nif (changed) {{\n    @P@_remember_(f);\n    for (size_t r = 0; r < @R@; ++r) {{\n        if (f->w[r] > #0.0#) {{\n            @P@_place_(f->m[r], f->p[r]{given}, f->place[r]);\n        }}\n    }}\n    @P@_join_(f);\n}}"
            ),
            _ => format!(
                "for (size_t i = 0; i < {m}; ++i) {{\n    if (u[i] >= -@MAX@ && u[i] <= @MAX@) {{\n        f->u[i] = u[i];\n    }}\n}}"
            ),
        };
        let pairs = [
            ("@JOIN@", by_state(JOIN)),
            ("@MASS@", by_state(MASS)),
            ("@TAKE_U@", take_u),
            ("@SWITCH@", if switches { SWITCH.to_owned() } else { String::new() }),
            (
                "@CROSS@",
                match self.by_state {
                    true => format!(
                        "@P@_remember_(f);\n@P@_predict_(f);\nfor (size_t r = 0; r < @R@; ++r) {{\n    if (f->w[r] > #0.0#) {{\n        @P@_place_(f->m[r], f->p[r]{given}, f->place[r]);\n    }}\n}}\n@P@_join_(f);"
                    ),
                    false => "@P@_predict_(f);".to_owned(),
                },
            ),
            (
                "@EVIDENCE@",
                by_state(&format!(
                    "{{\n    const @T@ before = @P@_mass_(f->place[r], (int16_t)r);\n    @P@_place_(f->m[r], f->p[r]{given}, f->place[r]);\n    logarithm[r] += @LOG@(@P@_mass_(f->place[r], (int16_t)r) / before);\n}}"
                )),
            ),
            (
                "@PARTS@",
                match self.by_state {
                    true => PARTS.to_owned(),
                    false => WHOLE.to_owned(),
                },
            ),
            ("@WHOLE@", if behind > 0 { LEADING.to_owned() } else { ESTIMATE.to_owned() }),
            ("@BEGIN@", if behind > 0 { BEGIN_COLOURED.to_owned() } else { BEGIN.to_owned() }),
            ("@PLACE_R@", by_state(&format!("@P@_place_(f->m[r], f->p[r]{given}, f->place[r]);"))),
            ("@W0@", by_state(SHARES)),
            (
                "@U0@",
                if m > 0 {
                    format!("for (size_t i = 0; i < {m}; ++i) {{\n    f->u[i] = #0.0#;\n}}")
                } else {
                    String::new()
                },
            ),
            (
                "@BU@",
                if m > 0 {
                    format!(
                        "for (size_t j = 0; j < {m}; ++j) {{\n    v += @P@_b[(r * @N@ + i) * {m} + j] * f->u[j];\n}}"
                    )
                } else {
                    String::new()
                },
            ),
            ("@REGIONCALL@", format!("@P@_region_(x{})", if m > 0 { ", u" } else { "" })),
            ("@FINITE_Z@", "z[k] >= -@MAX@ && z[k] <= @MAX@".to_owned()),
            ("@WRAPX@", self.wrapped("s", "x[s]")),
            ("@WRAPPM@", self.wrapped("a", "pm[a]")),
            ("@WRAPD@", self.wrapped("i", "d")),
            ("@WRAPM@", self.wrapped("i", "m[i]")),
            ("@WRAPFM@", self.wrapped("i", "f->m[r][i]")),
            ("@WRAPS@", self.wrapped("s", "d")),
            ("@UIN@", self.u_parameter()),
            ("@SQRT@", self.library("sqrt")),
            ("@LOG@", self.library("log")),
            ("@EXP@", self.library("exp")),
            ("@MAX@", largest.to_owned()),
            ("@POINTS@", points.to_string()),
            ("@NN@", (n * n).to_string()),
            ("@AA@", (all * all).to_string()),
            ("@A@", all.to_string()),
            ("@Q@", q.to_string()),
            ("@H@", behind.to_string()),
            ("@N@", n.to_string()),
            ("@R@", r.to_string()),
            ("@S@", self.tables.sensors.len().to_string()),
            ("@T@", t.to_owned()),
            ("@P@", p.to_owned()),
        ];
        for (token, value) in pairs {
            text = spliced(&text, token, &value);
        }
        numbers(&text, &self.c)
    }
}

/// A token replaced; of a line that is nothing else, every line of the value is indented as it, and an empty value takes the line away.
fn spliced(text: &str, token: &str, value: &str) -> String {
    let mut out = String::new();
    for line in text.split_inclusive('\n') {
        if line.trim() == token {
            let indent = &line[..line.len() - line.trim_start().len()];
            value.lines().for_each(|own| out += format!("{indent}{own}\n").trim_start_matches('\n'));
        } else {
            out += &line.replace(token, value);
        }
    }
    out
}

/// `#1.0#` as a number of the code's type.
fn numbers(text: &str, c: &C<'_>) -> String {
    let mut out = String::new();
    for line in text.split_inclusive('\n') {
        for (i, piece) in line.split('#').enumerate() {
            match piece.parse::<f64>() {
                Ok(value) if i % 2 == 1 => out += &c.number(value),
                _ => out += piece,
            }
        }
    }
    out
}

/// Crossing of borders, where regions follow from the state.
const JOIN: &str = "/* Keeps where the points stand. */
static void @P@_remember_(@P@_state *f)
{
    for (size_t r = 0; r < @R@; ++r) {
        for (size_t i = 0; i < @POINTS@; ++i) {
            f->before[r][i] = f->place[r][i];
        }
    }
}

/* Joins in every region what stayed there and what came over its border. */
static void @P@_join_(@P@_state *f)
{
    @T@ share[@R@];
    @T@ w[@R@];
    bool inside[@POINTS@];
    bool stayed = true;
    for (size_t to = 0; to < @R@; ++to) {
        @T@ all = #0.0#;
        for (size_t from = 0; from < @R@; ++from) {
            size_t began = 0;
            size_t count = 0;
            share[from] = #0.0#;
            if (!(f->w[from] > #0.0#)) {
                continue;
            }
            for (size_t i = 0; i < @POINTS@; ++i) {
                began += (f->before[from][i] == (int16_t)from) ? 1U : 0U;
            }
            for (size_t i = 0; i < @POINTS@; ++i) {
                inside[i] = @P@_went_(f->before[from], f->place[from], began > 0, (int16_t)from, (int16_t)to, i);
                count += inside[i] ? 1U : 0U;
            }
            if (count == 0) {
                continue;
            }
            stayed = stayed && from == to;
            share[from] = f->w[from] * ((@T@)count / (@T@)((began > 0) ? began : @POINTS@));
            all += share[from];
            if (from == to) {
                for (size_t i = 0; i < @POINTS@; ++i) {
                    inside[i] = false;
                }
            }
            @P@_part_(f->m[from], f->p[from], inside, f->part_m[from], f->part_p[from]);
        }
        w[to] = all;
        if (all > #0.0#) {
            for (size_t from = 0; from < @R@; ++from) {
                share[from] /= all;
            }
            @P@_mixture_(share, f->part_m, f->part_p, f->next_m[to], f->next_p[to]);
        }
    }
    if (!stayed) {
        @P@_take_over_(f, w);
    }
}

";

/// One region follows another by probabilities of their own.
const SWITCH: &str = "@T@ w[@R@];
@T@ share[@R@];
for (size_t to = 0; to < @R@; ++to) {
    @T@ all = #0.0#;
    for (size_t from = 0; from < @R@; ++from) {
        share[from] = f->w[from] * @P@_transition[from * @R@ + to];
        all += share[from];
    }
    for (size_t from = 0; from < @R@; ++from) {
        share[from] /= all;
    }
    w[to] = all;
    @P@_mixture_(share, f->m, f->p, f->next_m[to], f->next_p[to]);
}
@P@_take_over_(f, w);";

const MASS: &str = "/* The share of the points that stand in a region; half of one where none does. */
static @T@ @P@_mass_(const int16_t place[@POINTS@], int16_t region)
{
    size_t count = 0;
    for (size_t i = 0; i < @POINTS@; ++i) {
        count += (place[i] == region) ? 1U : 0U;
    }
    return ((count > 0) ? (@T@)count : #0.5#) / (@T@)@POINTS@;
}

";

const PARTS: &str = "bool inside[@POINTS@];
for (size_t r = 0; r < @R@; ++r) {
    if (f->w[r] > #0.0#) {
        for (size_t i = 0; i < @POINTS@; ++i) {
            inside[i] = f->place[r][i] == (int16_t)r;
        }
        @P@_part_(f->m[r], f->p[r], inside, f->next_m[r], f->next_p[r]);
    }
}";

const WHOLE: &str = "for (size_t r = 0; r < @R@; ++r) {
    for (size_t i = 0; i < @A@; ++i) {
        f->next_m[r][i] = f->m[r][i];
    }
    for (size_t i = 0; i < @AA@; ++i) {
        f->next_p[r][i] = f->p[r][i];
    }
}";

/// Probabilities at the start, by the points of the one distribution that there is.
const SHARES: &str = "@T@ all = #0.0#;
@T@ own[@R@];
for (size_t r = 0; r < @R@; ++r) {
    own[r] = #0.0#;
    for (size_t i = 0; i < @POINTS@; ++i) {
        own[r] += (f->place[0][i] == (int16_t)r) ? #1.0# : #0.0#;
    }
    all += own[r];
}
if (all > #0.0#) {
    for (size_t r = 0; r < @R@; ++r) {
        f->w[r] = own[r] / all;
    }
}";

const ESTIMATE: &str = "@P@_mixture_(f->w, f->next_m, f->next_p, f->x, f->cov);";

/// The same of states alone, where residuals stand behind them.
const LEADING: &str = "@T@ m[@A@];
@T@ p[@AA@];
@P@_mixture_(f->w, f->next_m, f->next_p, m, p);
for (size_t i = 0; i < @N@; ++i) {
    f->x[i] = m[i];
    for (size_t j = 0; j < @N@; ++j) {
        f->cov[i * @N@ + j] = p[i * @A@ + j];
    }
}";

/// What every region begins with.
const BEGIN: &str = "for (size_t i = 0; i < @N@; ++i) {
    f->m[r][i] = f->x[i];
}
for (size_t i = 0; i < @NN@; ++i) {
    f->p[r][i] = f->cov[i];
}";

const BEGIN_COLOURED: &str = "for (size_t i = 0; i < @A@; ++i) {
    f->m[r][i] = (i < @N@) ? f->x[i] : #0.0#;
    for (size_t j = 0; j < @A@; ++j) {
        @T@ v = #0.0#;
        if (i < @N@ && j < @N@) {
            v = f->cov[i * @N@ + j];
        }
        if (i >= @N@ && j >= @N@) {
            v = @P@_lasting[(i - @N@) * @H@ + j - @N@];
        }
        f->p[r][i * @A@ + j] = v;
    }
}";

/// Points stand for states; the residuals behind them follow by regression.
const PART: &str = "/* The normal distribution of those points that are marked. */
static void @P@_part_(const @T@ m[@A@], const @T@ p[@AA@], const bool inside[@POINTS@], @T@ pm[@A@], @T@ pp[@AA@])
{
    size_t count = 0;
    for (size_t i = 0; i < @POINTS@; ++i) {
        count += inside[i] ? 1U : 0U;
    }
    for (size_t i = 0; i < @A@; ++i) {
        pm[i] = m[i];
    }
    for (size_t i = 0; i < @AA@; ++i) {
        pp[i] = p[i];
    }
    if (count == 0 || count == @POINTS@) {
        return;
    }
    @T@ l[@NN@];
    @T@ first[@NN@];
    @T@ offset[@N@];
    @T@ centre[@N@] = { #0.0# };
    @P@_factor_(p, l);
    for (size_t i = 0; i < @POINTS@; ++i) {
        if (inside[i]) {
            @P@_offset_(l, i, offset);
            for (size_t s = 0; s < @N@; ++s) {
                centre[s] += offset[s];
            }
        }
    }
    for (size_t s = 0; s < @N@; ++s) {
        centre[s] /= (@T@)count;
    }
    for (size_t a = 0; a < @N@; ++a) {
        for (size_t b = 0; b < @N@; ++b) {
            first[a * @N@ + b] = #2.0# * p[a * @A@ + b];
        }
    }
    for (size_t i = 0; i < @POINTS@; ++i) {
        if (inside[i]) {
            @P@_offset_(l, i, offset);
            for (size_t a = 0; a < @N@; ++a) {
                for (size_t b = 0; b <= a; ++b) {
                    first[a * @N@ + b] += (offset[a] - centre[a]) * (offset[b] - centre[b]);
                }
            }
        }
    }
    for (size_t a = 0; a < @N@; ++a) {
        for (size_t b = 0; b <= a; ++b) {
            first[a * @N@ + b] /= (@T@)count + #2.0#;
            first[b * @N@ + a] = first[a * @N@ + b];
        }
        pm[a] = m[a] + centre[a];
        @WRAPPM@
    }
    for (size_t a = 0; a < @N@; ++a) {
        for (size_t b = 0; b < @N@; ++b) {
            pp[a * @A@ + b] = first[a * @N@ + b];
        }
    }
    @T@ gain[@H@][@N@];
    for (size_t h = 0; h < @H@; ++h) {
        for (size_t i = 0; i < @N@; ++i) {
            @T@ v = p[(@N@ + h) * @A@ + i];
            for (size_t k = 0; k < i; ++k) {
                v -= l[i * @N@ + k] * gain[h][k];
            }
            gain[h][i] = (l[i * @N@ + i] > #0.0#) ? v / l[i * @N@ + i] : #0.0#;
        }
        for (size_t i = @N@; i-- > 0;) {
            @T@ v = gain[h][i];
            for (size_t k = i + 1; k < @N@; ++k) {
                v -= l[k * @N@ + i] * gain[h][k];
            }
            gain[h][i] = (l[i * @N@ + i] > #0.0#) ? v / l[i * @N@ + i] : #0.0#;
        }
    }
    for (size_t h = 0; h < @H@; ++h) {
        for (size_t k = 0; k < @N@; ++k) {
            pm[@N@ + h] += gain[h][k] * centre[k];
        }
        for (size_t j = 0; j < @N@; ++j) {
            @T@ both = #0.0#;
            @T@ change = #0.0#;
            for (size_t k = 0; k < @N@; ++k) {
                both += gain[h][k] * first[k * @N@ + j];
                change += gain[h][k] * (first[k * @N@ + j] - p[k * @A@ + j]);
            }
            pp[(@N@ + h) * @A@ + j] = both;
            pp[j * @A@ + @N@ + h] = both;
            offset[j] = change;
        }
        for (size_t o = 0; o <= h; ++o) {
            @T@ v = p[(@N@ + h) * @A@ + @N@ + o];
            for (size_t j = 0; j < @N@; ++j) {
                v += offset[j] * gain[o][j];
            }
            pp[(@N@ + h) * @A@ + @N@ + o] = v;
            pp[(@N@ + o) * @A@ + @N@ + h] = v;
        }
    }
}

";

/// The residuals one row on, then the states.
const PREDICT: &str = "/* Of every region: its step, and the residuals that its noise hangs on. */
static void @P@_predict_(@P@_state *f)
{
    for (size_t r = 0; r < @R@; ++r) {
        if (!(f->w[r] > #0.0#)) {
            continue;
        }
        const @T@ *a = &@P@_a[r * @NN@];
        const @T@ *q = &@P@_q[r * @NN@];
        const @T@ *s = &@P@_s[r * (@N@ * @Q@)];
        @T@ *p = f->p[r];
        @T@ m[@A@];
        @T@ half[@AA@];
        @T@ moved[@AA@];
        for (size_t i = 0; i < @A@; ++i) {
            m[i] = (i < @N@ + @Q@) ? #0.0# : f->m[r][i - @Q@];
            for (size_t j = 0; j < @A@; ++j) {
                half[i * @A@ + j] = (i < @N@ + @Q@) ? p[i * @A@ + j] : p[(i - @Q@) * @A@ + j];
                moved[i * @A@ + j] = p[i * @A@ + j];
            }
        }
        for (size_t i = 0; i < @Q@; ++i) {
            for (size_t j = 0; j < @A@; ++j) {
                half[(@N@ + i) * @A@ + j] = #0.0#;
            }
            for (size_t k = 0; k < @H@; ++k) {
                m[@N@ + i] += @P@_phi[i * @H@ + k] * f->m[r][@N@ + k];
                for (size_t j = 0; j < @A@; ++j) {
                    half[(@N@ + i) * @A@ + j] += @P@_phi[i * @H@ + k] * p[(@N@ + k) * @A@ + j];
                }
            }
        }
        for (size_t i = @N@; i < @A@; ++i) {
            for (size_t j = 0; j <= i; ++j) {
                @T@ v = #0.0#;
                if (j < @N@) {
                    v = half[i * @A@ + j];
                } else if (j < @N@ + @Q@) {
                    v = (i < @N@ + @Q@) ? @P@_new[(i - @N@) * @Q@ + j - @N@] : #0.0#;
                    for (size_t k = 0; k < @H@; ++k) {
                        v += half[i * @A@ + @N@ + k] * @P@_phi[(j - @N@) * @H@ + k];
                    }
                } else {
                    v = half[i * @A@ + j - @Q@];
                }
                moved[i * @A@ + j] = v;
                moved[j * @A@ + i] = v;
            }
        }
        for (size_t i = 0; i < @N@; ++i) {
            @T@ v = @P@_c[r * @N@ + i];
            for (size_t j = 0; j < @N@; ++j) {
                v += a[i * @N@ + j] * f->m[r][j];
            }
            @BU@
            for (size_t t = 0; t < @Q@; ++t) {
                v += s[i * @Q@ + t] * m[@N@ + t];
            }
            m[i] = v;
            for (size_t j = 0; j < @A@; ++j) {
                half[i * @A@ + j] = #0.0#;
            }
            for (size_t k = 0; k < @N@; ++k) {
                for (size_t j = 0; j < @A@; ++j) {
                    half[i * @A@ + j] += a[i * @N@ + k] * moved[k * @A@ + j];
                }
            }
            for (size_t t = 0; t < @Q@; ++t) {
                for (size_t j = 0; j < @A@; ++j) {
                    half[i * @A@ + j] += s[i * @Q@ + t] * moved[(@N@ + t) * @A@ + j];
                }
            }
        }
        for (size_t i = 0; i < @A@; ++i) {
            f->m[r][i] = m[i];
            @WRAPFM@
            for (size_t j = 0; j < @A@; ++j) {
                p[i * @A@ + j] = moved[i * @A@ + j];
            }
        }
        for (size_t i = 0; i < @N@; ++i) {
            for (size_t j = 0; j <= i; ++j) {
                @T@ v = q[i * @N@ + j];
                for (size_t k = 0; k < @N@; ++k) {
                    v += half[i * @A@ + k] * a[j * @N@ + k];
                }
                for (size_t t = 0; t < @Q@; ++t) {
                    v += half[i * @A@ + @N@ + t] * s[j * @Q@ + t];
                }
                p[i * @A@ + j] = v;
                p[j * @A@ + i] = v;
            }
            for (size_t j = @N@; j < @A@; ++j) {
                p[i * @A@ + j] = half[i * @A@ + j];
                p[j * @A@ + i] = half[i * @A@ + j];
            }
        }
    }
}

";
