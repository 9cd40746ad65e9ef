//! The header of a filter.

use super::sizes::Filter;
use crate::{
    names::{comment, constants},
    public::fold,
};

impl Filter<'_> {
    pub(super) fn header(&self) -> String {
        let Self { p, t, n, nn, r, all, square, points, sensors: s, .. } = self;
        let upper = self.c.upper();
        let names: Vec<&str> = self.inputs.iter().map(|&input| self.tables.inputs[input].as_str()).collect();
        let sensors: Vec<&str> =
            self.tables.sensors.iter().map(|sensor| self.tables.states[sensor.0].as_str()).collect();
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
        out += &format!(
            "/* State of a running filter. */\ntypedef struct {{\n    {t} x[{n}]; /* the states */\n    {t} cov[{nn}]; /* their covariance, by rows */\n    {t} w[{r}]; /* the probability of every region */\n    {t} log_likelihood; /* of what the last step measured */\n"
        );
        if !self.inputs.is_empty() {
            out += &format!("    {t} u[{}];\n", self.inputs.len());
        }
        out += &format!(
            "    {t} m[{r}][{all}];\n    {t} p[{r}][{square}];\n    {t} next_m[{r}][{all}];\n    {t} next_p[{r}][{square}];\n"
        );
        if self.by_state {
            out += &format!(
                "    {t} part_m[{r}][{all}];\n    {t} part_p[{r}][{square}];\n    int16_t place[{r}][{points}];\n    int16_t before[{r}][{points}];\n"
            );
        }
        out += &format!("}} {p}_state;\n\n");
        let u = self.u_parameter();
        out += &format!(
            "/* Starts at a row: measured states take their measurements. */\nvoid {p}_start({p}_state *f, const {t} z[{s}]);\n\n/* Passes to the next row: u are the inputs of the row before, held over the step, z the measurements of the new one. */\nvoid {p}_step({p}_state *f{u}, const {t} z[{s}]);\n\n"
        );
        out += &format!("#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {upper}_H */\n");
        out
    }
}
