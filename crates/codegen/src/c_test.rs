//! A C program that compares the exported code with the model's values.

use crate::{
    ExportOptions, ExportedFile, TestVector, assemble::Assembled, c::outer_names, c_syntax::C, code::Kind, layout,
    lower::NEXT_INPUTS, print::Syntax, public::Public, vectors::parts,
};

/// The file `prefix_test.c`.
pub(crate) fn file(assembled: &Assembled<'_>, options: &ExportOptions, vectors: &[TestVector]) -> ExportedFile {
    let c = C { precision: options.precision, prefix: &options.prefix };
    let program = Program { c, assembled, vectors };
    ExportedFile::text(format!("{}_test.c", options.prefix), program.text())
}

struct Program<'a> {
    c: C<'a>,
    assembled: &'a Assembled<'a>,
    vectors: &'a [TestVector],
}

impl Program<'_> {
    fn text(&self) -> String {
        let (p, t) = (self.c.prefix, self.c.real());
        let mut out = format!(
            "/*\n * Compares {p}.c with the model's values at {} points, and returns 0 where they agree. The tolerances are bounds of\n * what rounding does to each value.\n */\n#include \"{p}.h\"\n\n#include <stddef.h>\n#include <stdio.h>\n\n",
            self.vectors.len()
        );
        if self.vectors.is_empty() {
            out += "/* Every tested point lies at a border of the model. */\nint main(void)\n{\n    return 0;\n}\n";
            return out;
        }
        out += &format!("enum {{ VECTORS = {} }};\n\n", self.vectors.len());
        let plan = &self.assembled.plan;
        self.matrix("x", plan.states.len(), |vector| vector.x.clone(), &mut out);
        self.matrix("u", plan.inputs.len(), |vector| vector.u.clone(), &mut out);
        let next = if plan.next_inputs { plan.inputs.len() } else { 0 };
        self.matrix(NEXT_INPUTS, next, |vector| vector.u_next.clone(), &mut out);
        self.matrix("past", plan.memory(), |vector| vector.past.clone(), &mut out);
        if plan.time {
            self.matrix("time", 1, |vector| vec![vector.t], &mut out);
        }
        if self.steps() {
            self.matrix("step", 1, |vector| vec![vector.dt], &mut out);
        }
        let public = self.assembled.public();
        for (index, function) in public.iter().enumerate() {
            let length: usize = parts(function.inner).iter().map(|part| part.1).sum();
            let name = function.name;
            self.matrix(&format!("{name}_value"), length, |v| v.results[index].values.clone(), &mut out);
            self.matrix(&format!("{name}_room"), length, |v| v.results[index].tolerances.clone(), &mut out);
            out += &format!("static const int test_{name}_code[VECTORS] = {{\n");
            let codes: Vec<String> = self.vectors.iter().map(|v| v.results[index].code.to_string()).collect();
            layout::rows(&codes, 16, &mut out);
            out += "};\n\n";
        }
        out += &format!(
            "static int compare(const char *what, size_t vector, int code, int expected_code, const {t} *value,\n                   const {t} *expected, const {t} *room, size_t count)\n{{\n    if (code != expected_code) {{\n        printf(\"%s, vector %lu: code %d, expected %d\\n\", what, (unsigned long)vector, code, expected_code);\n        return 1;\n    }}\n    if (code <= {}_NOT_FINITE) {{\n        return 0;\n    }}\n    for (size_t i = 0; i < count; ++i) {{\n        const {t} error = value[i] - expected[i];\n        if (!((error <= room[i]) && (error >= -room[i]))) {{\n            printf(\"%s, vector %lu: value %lu is %.17g, expected %.17g within %.3g\\n\", what, (unsigned long)vector,\n                   (unsigned long)i, (double)value[i], (double)expected[i], (double)room[i]);\n            return 1;\n        }}\n    }}\n    return 0;\n}}\n\nint main(void)\n{{\n    int failures = 0;\n    for (size_t v = 0; v < VECTORS; ++v) {{\n",
            self.c.upper()
        );
        for function in &public {
            self.check(function, &mut out);
        }
        if !plan.states.is_empty() {
            self.check_step(&mut out);
        }
        out += "    }\n    printf(\"%d vectors, %d differences\\n\", (int)VECTORS, failures);\n    return (failures == 0) ? 0 : 1;\n}\n";
        out
    }

    /// Returns true if a function takes the length of a step.
    fn steps(&self) -> bool {
        let has = |public: &Public<'_>| public.inner.parameters.iter().any(|parameter| parameter.name == "dt");
        self.assembled.public().iter().any(has)
    }

    fn matrix(&self, name: &str, width: usize, row: impl Fn(&TestVector) -> Vec<f64>, out: &mut String) {
        if width == 0 {
            return;
        }
        *out += &format!("static const {} test_{name}[VECTORS][{width}] = {{\n", self.c.real());
        for vector in self.vectors {
            let finite = |value: f64| if value.is_finite() { value } else { 0.0 };
            let values: Vec<String> = row(vector).iter().map(|&value| self.c.number(finite(value))).collect();
            *out += "    {\n";
            layout::rows(&values, width, out);
            *out += "    },\n";
        }
        *out += "};\n\n";
    }

    /// A model at a vector's point.
    fn model(&self) -> String {
        let (p, plan) = (self.c.prefix, &self.assembled.plan);
        let mut text = format!("            {p}_model m;\n");
        for (name, length) in [("x", plan.states.len()), ("past", plan.memory())] {
            if length > 0 {
                text += &format!(
                    "            for (size_t i = 0; i < {length}; ++i) {{\n                m.{name}[i] = test_{name}[v][i];\n            }}\n"
                );
            }
        }
        if plan.time {
            text += "            m.t = test_time[v][0];\n";
        }
        text
    }

    fn check(&self, public: &Public<'_>, out: &mut String) {
        let (p, plan, t) = (self.c.prefix, &self.assembled.plan, self.c.real());
        let name = public.name;
        let length: usize = parts(public.inner).iter().map(|part| part.1).sum();
        *out += "        {\n";
        *out += &format!("            {t} value[{length}] = {{{}}};\n", self.c.number(0.0));
        let mut arguments = Vec::new();
        if plan.remembers() {
            *out += &self.model();
            arguments.push("&m".to_owned());
        }
        let mut offset = 0;
        for (parameter, outer) in public.inner.parameters.iter().zip(outer_names(public)) {
            match (outer, parameter.kind) {
                _ if plan.keeps_in_model(parameter.name) => {}
                (_, Kind::Out(length)) => {
                    arguments.push(format!("&value[{offset}]"));
                    offset += length;
                }
                ("dt", _) => arguments.push("test_step[v][0]".into()),
                (name, _) => arguments.push(format!("test_{name}[v]")),
            }
        }
        *out += &format!("            const int code = {p}_{name}({});\n", arguments.join(", "));
        *out += &format!(
            "            failures += compare(\"{name}\", v, code, test_{name}_code[v], value, test_{name}_value[v], test_{name}_room[v], {length});\n        }}\n"
        );
    }

    /// Checks that a step equals `next`.
    fn check_step(&self, out: &mut String) {
        let (p, plan) = (self.c.prefix, &self.assembled.plan);
        *out += "        {\n";
        *out += &self.model();
        let mut arguments = vec!["&m".to_owned()];
        if !plan.inputs.is_empty() {
            arguments.push("test_u[v]".into());
        }
        if plan.next_inputs {
            arguments.push(format!("test_{NEXT_INPUTS}[v]"));
        }
        if self.assembled.free_step() {
            arguments.push("test_step[v][0]".into());
        }
        *out += &format!("            const int code = {p}_step({});\n", arguments.join(", "));
        *out += &format!(
            "            failures += compare(\"step\", v, code, test_next_code[v], m.x, test_next_value[v], test_next_room[v], {});\n        }}\n",
            plan.states.len()
        );
    }
}
