//! A C program that compares the commands of the code with those of the engine.

use fleetfoot_control::controller::Controller;
use fleetfoot_data::mix;

use super::Predictive;
use crate::{Precision, layout, print::Syntax};

/// Starts, and samples behind each.
const STARTS: u64 = 6;
const SAMPLES: usize = 8;
/// Largest difference of a command, in its size: that of two solutions with the largest residual of a solved program.
const ROOM: f64 = 1e-6;
/// The same in 32 bits.
const ROOM_FLOAT: f64 = 2e-2;

impl Predictive<'_> {
    /// Measurements and the engine's commands: starts within twice the sizes, then the linear path of the model.
    fn samples(&self) -> Vec<(Vec<f64>, Vec<f64>)> {
        let (n, m, errors) = (self.states(), self.inputs(), self.law.sizes().len());
        let mut samples = Vec::new();
        for start in 0..STARTS {
            let draw = |at: usize| mix(mix(start) ^ at as u64) as f64 / 2f64.powi(62) - 2.0;
            let mut x: Vec<f64> = (0..n).map(|i| if i < errors { draw(i) } else { 0.0 }).collect();
            let measured: Vec<f64> =
                self.law.measured.iter().enumerate().map(|(j, c)| c.at + 0.5 * c.size * draw(errors + j)).collect();
            let mut state = self.law.start();
            let mut commands: Vec<f64> = (self.law.inputs.iter().zip(&self.tables.at))
                .map(|(input, at)| at.max(input.lowest).min(input.highest))
                .collect();
            let mut next = vec![0.0; n];
            for sample in 0..SAMPLES {
                let u = self.measurements_of(&x, &measured);
                // The second half begins again, with no memory of the first plan.
                state.control(sample as f64 * self.law.period, &u, &mut commands);
                samples.push((u, commands.clone()));
                let v: Vec<f64> =
                    (0..m).map(|j| (commands[j] - self.tables.at[j]) / self.tables.input_sizes[j]).collect();
                let step = &self.tables.program.steps[0];
                for (i, next) in next.iter_mut().enumerate() {
                    *next = self.tables.constants[i]
                        + (0..n).map(|j| step.a[n * i + j] * x[j]).sum::<f64>()
                        + (0..m).map(|j| step.b[m * i + j] * v[j]).sum::<f64>();
                }
                x.copy_from_slice(&next);
            }
        }
        samples
    }

    /// The columns that the law reads, for errors and measured columns.
    fn measurements_of(&self, x: &[f64], measured: &[f64]) -> Vec<f64> {
        let sizes = &self.tables.sizes;
        let states = self.law.states.len();
        let mut u: Vec<f64> = (0..states).map(|i| self.law.states[i].at + x[i] * sizes[i]).collect();
        for (r, rotation) in self.law.rotations.iter().enumerate() {
            let first = states + 3 * r;
            let turn = [0, 1, 2].map(|axis| x[first + axis] * sizes[first + axis]);
            let mut parts = rotation.kind.moved(&rotation.at, turn);
            rotation.kind.retract(&mut parts);
            u.extend(parts);
        }
        u.extend(measured);
        // Columns that only choose the region.
        u.resize(self.reads(), 0.0);
        u
    }

    /// The file `PREFIX_test.c`.
    pub(super) fn test(&self) -> String {
        let (p, t, c) = (self.c.prefix, self.c.real(), &self.c);
        let (reads, m) = (self.reads(), self.inputs());
        let samples = self.samples();
        let float = c.precision == Precision::Float;
        let mut out = format!(
            "/*\n * Compares {p}.c with the engine at {} samples, and returns 0 where they agree.\n */\n#include \"{p}.h\"\n\n#include <stddef.h>\n#include <stdio.h>\n\n",
            samples.len()
        );
        for (name, width, of) in [("u", reads, 0), ("command", m, 1)] as [(&str, usize, usize); 2] {
            out += &format!("static const {t} test_{name}[{}][{width}] = {{\n", samples.len());
            for sample in &samples {
                let row = if of == 0 { &sample.0 } else { &sample.1 };
                let values: Vec<String> = row.iter().map(|&value| c.number(value)).collect();
                out += "    {\n";
                layout::rows(&values, width, &mut out);
                out += "    },\n";
            }
            out += "};\n\n";
        }
        let room = if float { ROOM_FLOAT } else { ROOM };
        let rooms: Vec<String> = self.tables.input_sizes.iter().map(|size| c.number(room * size)).collect();
        out += &format!("static const {t} test_room[{m}] = {{\n");
        layout::rows(&rooms, m, &mut out);
        out += "};\n\n";
        out += &format!(
            "int main(void)\n{{\n    static {p}_controller s;\n    int failures = 0;\n    int unfinished = 0;\n    for (size_t v = 0; v < {count}; ++v) {{\n        if (v % {SAMPLES} == 0) {{\n            {p}_init(&s);\n        }}\n        unfinished += ({p}_step(&s, test_u[v]) == 1) ? 1 : 0;\n        for (size_t j = 0; j < {m}; ++j) {{\n            const {t} error = s.command[j] - test_command[v][j];\n            if (!((error <= test_room[j]) && (error >= -test_room[j]))) {{\n                printf(\"sample %lu: command %lu is %.17g, expected %.17g within %.3g\\n\", (unsigned long)v, (unsigned long)j,\n                       (double)s.command[j], (double)test_command[v][j], (double)test_room[j]);\n                ++failures;\n            }}\n        }}\n    }}\n    printf(\"%d samples, %d unfinished, %d differences\\n\", {count}, unfinished, failures);\n    return (failures == 0) ? 0 : 1;\n}}\n",
            count = samples.len(),
        );
        out
    }
}
