//! The header of a predictive controller.

use super::Predictive;
use crate::{
    names::{comment, constants},
    public::fold,
};

impl Predictive<'_> {
    pub(super) fn header(&self) -> String {
        let (p, t, upper) = (self.c.prefix, self.c.real(), self.c.upper());
        let (n, m, horizon) = (self.states(), self.inputs(), self.tables.program.horizon);
        let (bounds, regions, inequalities) = (self.tables.program.bounds.len(), self.regions(), self.inequalities());
        let about = format!(
            "Predictive controller, exported by fleetfoot {}: the commands of the next {horizon} samples of {:?} s within their limits that cost least, the first of which is given. Measurements {}. C99, no heap, no global variables; all functions are reentrant, and all memory is that of a {p}_controller. The number of iterations has a fixed limit. {p}_test.c is a separate program that compares with the engine and returns 0 if they agree (no -ffast-math).",
            env!("CARGO_PKG_VERSION"),
            self.law.period,
            self.model,
        );
        let mut out = String::from("/*\n");
        for line in fold(&about, 112) {
            out += &format!(" * {line}\n");
        }
        out += &format!(
            " */\n#ifndef {upper}_H\n#define {upper}_H\n\n#include <stdbool.h>\n#include <stdint.h>\n\n#ifdef __cplusplus\nextern \"C\" {{\n#endif\n\n"
        );
        let reads: Vec<&str> = self.columns[..self.reads()].iter().map(String::as_str).collect();
        let commands: Vec<&str> = self.law.inputs.iter().map(|input| input.name.as_str()).collect();
        for (what, kind, names) in
            [("Measurements, in the order of u.", "INPUT", reads), ("Commands.", "COMMAND", commands)]
        {
            out += &format!("/* {what} */\nenum {{\n");
            for (index, (word, name)) in constants(names.iter().copied()).iter().zip(&names).enumerate() {
                out += &format!("    {upper}_{kind}_{word} = {index}, /* {} */\n", comment(name));
            }
            out += &format!("    {upper}_{kind}_COUNT = {}\n}};\n\n", names.len());
        }
        out += &format!(
            "/* Codes of a step whose commands are those of the step before. */\nenum {{ {upper}_NO_REGION = -32767, {upper}_NOT_FINITE = -32766 }};\n\n"
        );
        out += &format!(
            "/* State of a running controller. */\ntypedef struct {{\n    {t} command[{m}]; /* the commands */\n"
        );
        let integrals = self.law.integrated.len();
        if integrals > 0 {
            out += &format!("    {t} integral[{integrals}]; /* integrals of errors */\n");
        }
        out += &format!(
            "    {t} residual; /* of the last plan: the largest part of v - P(v - g / d), in sizes of inputs */\n    int steps; /* iterations of the last step */\n    bool began;\n"
        );
        let (plan, path) = (horizon * m, (horizon + 1) * n);
        let index = self.index();
        let mut member = |kind: &str, name: &str, length: usize| {
            out += &format!("    {kind} {name}[{length}];\n");
        };
        for (name, length) in [
            ("plan", plan),
            ("path", path),
            ("slopes", path),
            ("gradient", plan),
            ("move", plan),
            ("change", plan),
            ("input_slopes", plan),
            ("input_curvature", plan),
            ("displaced", path),
            ("off", path),
            ("gain", plan * n),
            ("constant", plan),
            ("cost", n * n),
            ("slope", n),
            ("cost_a", n * n),
            ("cost_b", n * m),
            ("cross", plan * n),
            ("factor", plan * m),
            ("start", n),
            ("c", regions * n),
            ("target", n),
            ("input_target", m),
            ("slack", inequalities),
            ("multiplier", inequalities),
            ("slack_move", inequalities),
            ("multiplier_move", inequalities),
            ("centring", inequalities),
            ("own_slopes", path),
            ("own_input_slopes", plan),
        ] {
            member(t, name, length);
        }
        if bounds > 0 {
            member(t, "bound_curvature", horizon * bounds);
        }
        if regions > 1 {
            member(t, "best", plan);
        }
        member(index, "sequence", horizon);
        member(index, "met", horizon);
        member("bool", "fixed", plan);
        out += &format!("}} {p}_controller;\n\n");
        out += &format!("/* Starts without a plan. */\nvoid {p}_init({p}_controller *s);\n\n");
        let step = format!(
            "One sample: u are the measurements, s->command the commands. Returns 0 if the plan is the best one, and 1 if iterations or sequences of regions are spent (the plan is within the limits). {upper}_NO_REGION and {upper}_NOT_FINITE leave the controller as it is."
        );
        out += "/*\n";
        for line in fold(&step, 112) {
            out += &format!(" * {line}\n");
        }
        out += &format!(" */\nint {p}_step({p}_controller *s, const {t} u[{}]);\n\n", self.reads());
        out += &format!("#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {upper}_H */\n");
        out
    }
}
