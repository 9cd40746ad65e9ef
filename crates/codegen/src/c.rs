//! C99: a header, a source.

use crate::{
    ExportOptions, ExportedFile,
    assemble::Assembled,
    c_syntax::C,
    code::Kind,
    cost::{Cost, Used},
    lower::NEXT_INPUTS,
    names::{comment, constants},
    options::Precision,
    public::{Public, fold},
    transitions::{TransitionTables, c_declarations, c_source},
};

/// The files `prefix.h` and `prefix.c`, and `prefix_transitions.c` where transitions were counted.
pub(crate) fn files(assembled: &Assembled<'_>, options: &ExportOptions, cost: &Cost) -> Vec<ExportedFile> {
    let printer = Printer { c: C { precision: options.precision, prefix: &options.prefix }, assembled, cost };
    let file = |extension: &str, text: String| ExportedFile::text(format!("{}.{extension}", options.prefix), text);
    let mut files = vec![file("h", printer.header()), file("c", printer.source())];
    files.extend(
        TransitionTables::of(assembled).map(|tables| {
            ExportedFile::text(format!("{}_transitions.c", options.prefix), c_source(&tables, &printer.c))
        }),
    );
    files
}

struct Printer<'a> {
    c: C<'a>,
    assembled: &'a Assembled<'a>,
    cost: &'a Cost,
}

impl Printer<'_> {
    fn header(&self) -> String {
        let upper = self.c.upper();
        let mut out = String::from("/*\n");
        for line in self.assembled.about() {
            out += &format!(" * {}\n", comment(&line)).replace(" * \n", " *\n");
        }
        out += " *\n";
        for line in fold(&self.usage(), 112) {
            out += &format!(" * {line}\n");
        }
        out += " *\n";
        for line in self.cost.lines() {
            out += &format!(" * {line}\n");
        }
        let tables = TransitionTables::of(self.assembled);
        let include = if tables.is_some() { "#include <stdint.h>\n\n" } else { "" };
        out += &format!(
            " */\n#ifndef {upper}_H\n#define {upper}_H\n\n{include}#ifdef __cplusplus\nextern \"C\" {{\n#endif\n\n"
        );
        self.names(&mut out);
        self.variable(&mut out);
        for (head, doc) in self.declarations() {
            out += "/*\n";
            for line in fold(&doc, 112) {
                out += &format!(" * {line}\n");
            }
            out += &format!(" */\n{head};\n\n");
        }
        if let Some(tables) = &tables {
            c_declarations(tables, &self.c, &mut out);
        }
        out += &format!("#ifdef __cplusplus\n}}\n#endif\n\n#endif /* {upper}_H */\n");
        out
    }

    fn usage(&self) -> String {
        let p = self.c.prefix;
        let numbers = match self.c.precision {
            Precision::Float => "32-bit numbers",
            Precision::Double => "64-bit numbers",
        };
        format!(
            "C99, {numbers}, no heap, no global variables; all functions are reentrant. Compile {p}.c with the robot's code (no -ffast-math: the code tests for NaN); {p}_test.c is a separate program that compares with the model's values and returns 0 if they agree."
        )
    }

    /// Enums of names.
    fn names(&self, out: &mut String) {
        let upper = self.c.upper();
        let plan = &self.assembled.plan;
        let states: Vec<&str> = plan.states.iter().map(|state| state.signal.name.as_str()).collect();
        let inputs: Vec<&str> = plan.inputs.iter().map(|input| input.name.as_str()).collect();
        let outputs: Vec<&str> = plan.outputs.iter().map(|output| output.name.as_str()).collect();
        for (what, kind, names) in [
            ("States, in the order of x.", "STATE", states),
            ("Inputs, in the order of u.", "INPUT", inputs),
            ("Outputs, in the order of y.", "OUTPUT", outputs),
            ("Regions.", "REGION", self.assembled.regions()),
        ] {
            *out += &format!("/* {what} */\nenum {{\n");
            for (index, (word, name)) in constants(names.iter().copied()).iter().zip(&names).enumerate() {
                *out += &format!("    {upper}_{kind}_{word} = {index}, /* {} */\n", comment(name));
            }
            *out += &format!("    {upper}_{kind}_COUNT = {}\n}};\n\n", names.len());
        }
        *out += &format!(
            "/* Codes of failures. */\nenum {{ {upper}_NO_REGION = -32767, {upper}_NOT_FINITE = -32766 }};\n\n"
        );
        if let Some(step) = self.assembled.step {
            *out += &format!("/* Seconds from step to step. */\n#define {upper}_STEP {}\n\n", number(&self.c, step));
        }
    }

    /// The struct.
    fn variable(&self, out: &mut String) {
        let plan = &self.assembled.plan;
        if self.assembled.kept() == 0 {
            return;
        }
        let t = self.c.real();
        *out += "/* State of a running model. */\ntypedef struct {\n";
        if !plan.states.is_empty() {
            *out += &format!("    {t} x[{}]; /* the states */\n", plan.states.len());
        }
        if plan.memory() > 0 {
            *out += &format!("    {t} past[{}]; /* earlier rows, see above */\n", plan.memory());
        }
        if plan.time {
            *out += &format!("    {t} t; /* seconds since the start */\n");
        }
        *out += &format!("}} {}_model;\n\n", self.c.prefix);
    }

    /// Public functions: heads and documentation.
    fn declarations(&self) -> Vec<(String, String)> {
        let mut all: Vec<(String, String)> = Vec::new();
        if self.assembled.kept() > 0 {
            all.push((self.init_head(), self.init_doc()));
            if !self.assembled.plan.states.is_empty() {
                all.push((
                    self.step_head(),
                    format!(
                        "Advances the states by one step; the code is that of the step's start.{}",
                        self.assembled.next_inputs_doc()
                    ),
                ));
            }
            if self.assembled.plan.remembers() {
                all.push((self.observe_head(), self.observe_doc()));
            }
        }
        all.extend(self.assembled.public().iter().map(|public| (self.head(public), public.doc.clone())));
        all
    }

    fn array(&self, name: &str, length: usize, constant: bool) -> String {
        format!("{}{} {name}[{length}]", if constant { "const " } else { "" }, self.c.real())
    }

    fn init_head(&self) -> String {
        let (p, states) = (self.c.prefix, self.assembled.plan.states.len());
        let start = if states > 0 { format!(", {}", self.array("x0", states, true)) } else { String::new() };
        format!("void {p}_init({p}_model *m{start})")
    }

    fn init_doc(&self) -> String {
        let mut text = String::from("Starts at the states x0.");
        if self.assembled.plan.states.is_empty() {
            text = "Starts.".into();
        }
        if self.assembled.plan.memory() > 0 {
            text += " Earlier rows are taken for equal to x0, with inputs of 0: observe real rows, or fill m->past, where that is wrong.";
        }
        text
    }

    /// `, u, dt` with the existing parameters only.
    fn given(&self, dt: bool) -> String {
        self.given_with(false, dt)
    }

    /// `, u, u_next, dt` with the existing parameters only.
    fn given_with(&self, next: bool, dt: bool) -> String {
        let inputs = self.assembled.plan.inputs.len();
        let mut text = if inputs > 0 { format!(", {}", self.array("u", inputs, true)) } else { String::new() };
        if next {
            text += &format!(", {}", self.array(NEXT_INPUTS, inputs, true));
        }
        if dt {
            text += &format!(", {} dt", self.c.real());
        }
        text
    }

    fn step_head(&self) -> String {
        let p = self.c.prefix;
        let given = self.given_with(self.assembled.plan.next_inputs, self.assembled.free_step());
        format!("int {p}_step({p}_model *m{given})")
    }

    /// Returns true if observing needs the length of the step.
    fn observes_step(&self) -> bool {
        self.assembled.free_step() && self.assembled.plan.time
    }

    fn observe_head(&self) -> String {
        let (p, states) = (self.c.prefix, self.assembled.plan.states.len());
        let next = if states > 0 { format!(", {}", self.array("x_next", states, true)) } else { String::new() };
        format!("void {p}_observe({p}_model *m{}{next})", self.given(self.observes_step()))
    }

    fn observe_doc(&self) -> String {
        if self.assembled.plan.states.is_empty() {
            "The row with the inputs u becomes the past.".into()
        } else {
            "A step that was measured: the present row, with the inputs u, becomes the past, and the states are x_next."
                .into()
        }
    }

    fn head(&self, public: &Public<'_>) -> String {
        let (p, plan) = (self.c.prefix, &self.assembled.plan);
        let mut parameters = Vec::new();
        if plan.remembers() {
            parameters.push(format!("const {p}_model *m"));
        }
        parameters.extend(public.parameters(plan).into_iter().map(|(name, kind)| match kind {
            Kind::In(length) => self.array(name, length, true),
            Kind::Out(length) => self.array(name, length, false),
            Kind::Value => format!("{} {name}", self.c.real()),
        }));
        format!("int {p}_{}({})", public.name, parameters.join(", "))
    }

    fn source(&self) -> String {
        let used = Used::of(&self.assembled.code);
        let mut out = format!("/* See {0}.h. */\n#include \"{0}.h\"\n\n#include <float.h>\n", self.c.prefix);
        if used.library() || used.unary.contains(&fleetfoot_library::Unary::Abs) {
            out += "#include <math.h>\n";
        }
        out += "#include <stddef.h>\n#include <stdint.h>\n\n";
        self.c.helpers(&used, &mut out);
        self.c.code(&self.assembled.code, &mut out);
        if self.assembled.kept() > 0 {
            self.init(&mut out);
            if !self.assembled.plan.states.is_empty() {
                self.step(&mut out);
            }
            if self.assembled.plan.remembers() {
                self.observe(&mut out);
            }
        }
        for public in self.assembled.public() {
            let given = public.inner.parameters.iter().zip(outer_names(&public));
            let arguments: Vec<String> = given.map(|(inner, outer)| self.argument(inner.name, outer)).collect();
            out += &format!(
                "{}\n{{\n    return {}_{}_({});\n}}\n\n",
                self.head(&public),
                self.c.prefix,
                public.inner.name,
                arguments.join(", ")
            );
        }
        out.truncate(out.trim_end().len());
        out.push('\n');
        out
    }

    /// Text of an inner parameter in a call.
    fn argument(&self, inner: &str, outer: &str) -> String {
        if self.assembled.plan.keeps_in_model(inner) { format!("m->{inner}") } else { outer.to_owned() }
    }

    fn init(&self, out: &mut String) {
        let plan = &self.assembled.plan;
        *out += &format!("{}\n{{\n", self.init_head());
        if !plan.states.is_empty() {
            *out += &format!(
                "    for (size_t i = 0; i < {}; ++i) {{\n        m->x[i] = x0[i];\n    }}\n",
                plan.states.len()
            );
        }
        for delay in &plan.delays {
            let (value, extra) = match delay.source {
                crate::plan::Source::State(i) => (format!("x0[{i}]"), ""),
                crate::plan::Source::Input(_) => (number(&self.c, 0.0), ""),
                crate::plan::Source::Time => {
                    let step = number(&self.c, self.assembled.step.unwrap_or(plan.model.step));
                    (format!("({})({} - i) * {step}", self.c.real(), delay.depth), "")
                }
            };
            *out += &format!(
                "    for (size_t i = 0; i < {}; ++i) {{\n        m->past[{} + i] = {value};{extra}\n    }}\n",
                delay.depth, delay.offset
            );
        }
        if plan.time {
            *out += &format!("    m->t = {};\n", number(&self.c, 0.0));
        }
        *out += "}\n\n";
    }

    /// The statements that make the present row the past.
    fn remember(&self) -> String {
        let (p, plan) = (self.c.prefix, &self.assembled.plan);
        let mut text = String::new();
        if let Some(remember) = self.assembled.code.functions.iter().find(|function| function.name == "remember") {
            let arguments: Vec<String> = remember
                .parameters
                .iter()
                .map(|parameter| match parameter.name {
                    "x" | "past" => format!("m->{}", parameter.name),
                    name => name.to_owned(),
                })
                .collect();
            text += &format!("    {p}_remember_({});\n", arguments.join(", "));
        }
        if plan.time {
            let step = self.assembled.step.map_or_else(|| "dt".to_owned(), |step| number(&self.c, step));
            text += &format!("    m->t += {step};\n");
        }
        text
    }

    fn step(&self, out: &mut String) {
        let (p, plan) = (self.c.prefix, &self.assembled.plan);
        let Some(next) = self.assembled.code.functions.iter().find(|function| function.name == "next") else { return };
        let arguments: Vec<String> = next
            .parameters
            .iter()
            .map(|parameter| match parameter.name {
                "x" | "past" | "t" => format!("m->{}", parameter.name),
                name => name.to_owned(),
            })
            .collect();
        let count = plan.states.len();
        *out += &format!("{}\n{{\n    {} n[{count}];\n", self.step_head(), self.c.real());
        *out += &format!("    const int code = {p}_next_({});\n", arguments.join(", "));
        *out += &format!("    if (code <= {}_NOT_FINITE) {{\n        return code;\n    }}\n", self.c.upper());
        *out += &self.remember();
        *out += &format!(
            "    for (size_t i = 0; i < {count}; ++i) {{\n        m->x[i] = n[i];\n    }}\n    return code;\n}}\n\n"
        );
    }

    fn observe(&self, out: &mut String) {
        let plan = &self.assembled.plan;
        *out += &format!("{}\n{{\n{}", self.observe_head(), self.remember());
        if !plan.states.is_empty() {
            *out += &format!(
                "    for (size_t i = 0; i < {}; ++i) {{\n        m->x[i] = x_next[i];\n    }}\n",
                plan.states.len()
            );
        }
        // Inputs that no earlier row is needed of are given all the same.
        let remembers_inputs = plan.delays.iter().any(|delay| matches!(delay.source, crate::plan::Source::Input(_)));
        if !plan.inputs.is_empty() && !remembers_inputs {
            *out += "    (void)u;\n";
        }
        *out += "}\n\n";
    }
}

/// The callers' names of an inner function's parameters.
pub(crate) fn outer_names(public: &Public<'_>) -> Vec<&'static str> {
    public.inner.parameters.iter().map(|parameter| public.outer_name(parameter.name)).collect()
}

fn number(c: &C<'_>, value: f64) -> String {
    crate::print::Syntax::number(c, value)
}
