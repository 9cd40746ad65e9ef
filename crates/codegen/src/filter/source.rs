//! The header and the source of a filter: the common text with its tokens replaced by the model's sizes and names.

use fleetfoot_control::filter::FilterTables;
use fleetfoot_model::Model;

use super::{coloured, crossing};
use crate::{
    c_syntax::C,
    code::Code,
    cost::Used,
    names::{comment, constants},
    options::Precision,
    print::Syntax,
    public::fold,
};

/// What does not hang on the model.
const TEMPLATE: &str = include_str!("filter.c.txt");

/// The estimate of all regions together.
const ESTIMATE: &str = "@P@_mixture_(f->w, f->next_m, f->next_p, f->x, f->cov);";

/// What every region begins with.
const BEGIN: &str = "for (size_t i = 0; i < @N@; ++i) {
    f->m[r][i] = f->x[i];
}
for (size_t i = 0; i < @NN@; ++i) {
    f->p[r][i] = f->cov[i];
}";

/// A filter on its way to be C.
pub(super) struct Printer<'a> {
    pub(super) c: C<'a>,
    pub(super) tables: &'a FilterTables,
    /// Places of the code's inputs among those of the tables.
    pub(super) inputs: Vec<usize>,
    /// Whether regions follow from the state.
    pub(super) by_state: bool,
    pub(super) model: &'a Model,
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

    pub(super) fn header(&self) -> String {
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

    pub(super) fn source(&self, code: &Code) -> String {
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
            for (from, to, other) in coloured::FUNCTIONS {
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
            ("@JOIN@", by_state(crossing::JOIN)),
            ("@MASS@", by_state(crossing::MASS)),
            ("@TAKE_U@", take_u),
            ("@SWITCH@", if switches { crossing::SWITCH.to_owned() } else { String::new() }),
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
                    true => crossing::PARTS.to_owned(),
                    false => crossing::WHOLE.to_owned(),
                },
            ),
            ("@WHOLE@", if behind > 0 { coloured::ESTIMATE.to_owned() } else { ESTIMATE.to_owned() }),
            ("@BEGIN@", if behind > 0 { coloured::BEGIN.to_owned() } else { BEGIN.to_owned() }),
            ("@PLACE_R@", by_state(&format!("@P@_place_(f->m[r], f->p[r]{given}, f->place[r]);"))),
            ("@W0@", by_state(crossing::SHARES)),
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
