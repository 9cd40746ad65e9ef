//! Rust without the standard library.

use fleetfoot_library::{Binary, Unary};

use crate::{
    ExportOptions, ExportedFile,
    assemble::Assembled,
    c::outer_names,
    code::{Function, Kind, Table, Values},
    cost::{Cost, Used},
    layout,
    lower::NEXT_INPUTS,
    names::{comment, literal},
    options::Precision,
    plan::Source,
    print::{Syntax, block},
    public::{Public, fold},
    transitions::{self, TransitionTables},
};

/// The file `prefix.rs`.
pub(crate) fn file(assembled: &Assembled<'_>, options: &ExportOptions, cost: &Cost) -> ExportedFile {
    let printer = Rust { precision: options.precision, parameters: Vec::new() };
    ExportedFile::text(format!("{}.rs", options.prefix), printer.module(assembled, cost))
}

/// Rust with one kind of real numbers, within a function with these array parameters.
pub(crate) struct Rust {
    pub(crate) precision: Precision,
    /// Parameters that are references already.
    pub(crate) parameters: Vec<&'static str>,
}

impl Rust {
    pub(crate) fn real(&self) -> &'static str {
        match self.precision {
            Precision::Float => "f32",
            Precision::Double => "f64",
        }
    }

    pub(crate) fn library(&self, name: &str) -> String {
        match self.precision {
            Precision::Float => format!("libm::{name}f"),
            Precision::Double => format!("libm::{name}"),
        }
    }

    fn module(&self, assembled: &Assembled<'_>, cost: &Cost) -> String {
        let used = Used::of(&assembled.code);
        let needs = if used.library() { "`core` and the crate `libm` (elementary functions)" } else { "`core` only" };
        let mut head = String::new();
        for line in assembled.about().iter().chain(std::iter::once(&String::new())) {
            head += format!("//! {}", comment(line)).trim_end();
            head.push('\n');
        }
        for line in fold(&format!("A module for `no_std` crates: it needs {needs}, no heap and no unsafe code."), 112) {
            head += &format!("//! {line}\n");
        }
        head += "//!\n";
        for line in cost.lines() {
            head += &format!("//! {line}\n");
        }
        head + &self.body(assembled, &used)
    }

    fn body(&self, assembled: &Assembled<'_>, used: &Used) -> String {
        let mut out = String::from("\n#![allow(clippy::all, non_snake_case, unused_mut, unused_variables)]\n\n");
        self.names(assembled, &mut out);
        if let Some(tables) = TransitionTables::of(assembled) {
            transitions::rust(&tables, self.real(), &|value| self.number(value), &mut out);
        }
        for table in &assembled.code.tables {
            self.table_of(table, &mut out);
        }
        self.helpers(used, &mut out);
        for function in &assembled.code.functions {
            self.function(function, &mut out);
        }
        out += "/// True if a code is that of a failure.\npub fn failed(code: i32) -> bool {\n    code <= NOT_FINITE\n}\n\n";
        if assembled.kept() > 0 {
            self.variable(assembled, &mut out);
        }
        if !assembled.plan.remembers() {
            for public in assembled.public() {
                self.free(assembled, &public, &mut out);
            }
        }
        out.truncate(out.trim_end().len());
        out.push('\n');
        out
    }

    fn names(&self, assembled: &Assembled<'_>, out: &mut String) {
        let plan = &assembled.plan;
        let states: Vec<&str> = plan.states.iter().map(|state| state.signal.name.as_str()).collect();
        let inputs: Vec<&str> = plan.inputs.iter().map(|input| input.name.as_str()).collect();
        let outputs: Vec<&str> = plan.outputs.iter().map(|output| output.name.as_str()).collect();
        for (what, constant, names) in [
            ("Names of the states, in the order of `x`.", "STATES", states),
            ("Names of the inputs, in the order of `u`.", "INPUTS", inputs),
            ("Names of the outputs, in the order of `y`.", "OUTPUTS", outputs),
            ("Names of the regions.", "REGIONS", assembled.regions()),
        ] {
            let escape = |code: u32| format!("\\u{{{code:x}}}");
            let texts: Vec<String> = names.iter().map(|name| literal(name, escape)).collect();
            *out += &format!("/// {what}\npub const {constant}: [&str; {}] = [\n", names.len());
            layout::rows(&texts, names.len(), out);
            *out += "];\n";
        }
        *out += "/// The code of a label that was not seen in training.\npub const NO_REGION: i32 = -32767;\n";
        *out += "/// The code of an input, a function or a result that is not a finite number.\npub const NOT_FINITE: i32 = -32766;\n";
        if let Some(step) = assembled.step {
            *out +=
                &format!("/// Seconds from step to step.\npub const STEP: {} = {};\n", self.real(), self.number(step));
        }
        out.push('\n');
    }

    fn table_of(&self, table: &Table, out: &mut String) {
        let (kind, values): (&str, Vec<String>) = match &table.values {
            Values::Reals(values) => (self.real(), values.iter().map(|&value| self.number(value)).collect()),
            Values::Indices(values) => {
                let kind = match values.iter().max() {
                    Some(&most) if most > usize::from(u16::MAX) => "u32",
                    Some(&most) if most > usize::from(u8::MAX) => "u16",
                    _ => "u8",
                };
                (kind, values.iter().map(usize::to_string).collect())
            }
        };
        *out += &format!(
            "/// {}\nstatic {}: [{kind}; {}] = [\n",
            comment(&table.comment),
            Syntax::table(self, table.plain_name()),
            values.len()
        );
        layout::rows(&values, table.row, out);
        *out += "];\n\n";
    }

    fn helpers(&self, used: &Used, out: &mut String) {
        let t = self.real();
        let mut helper = |wanted: bool, text: String| {
            if wanted {
                *out += &text;
                out.push('\n');
            }
        };
        helper(
            used.unary.contains(&Unary::Sign),
            format!(
                "fn sign(x: {t}) -> {t} {{\n    if x > 0.0 {{ 1.0 }} else if x < 0.0 {{ -1.0 }} else {{ x }}\n}}\n"
            ),
        );
        helper(
            used.unary.contains(&Unary::Step),
            format!(
                "fn step(x: {t}) -> {t} {{\n    if x > 0.0 {{ 1.0 }} else if x <= 0.0 {{ 0.0 }} else {{ x }}\n}}\n"
            ),
        );
        let (turn, half) = (self.number(std::f64::consts::TAU), self.number(std::f64::consts::PI));
        helper(
            used.unary.contains(&Unary::Wrap),
            format!(
                "/// The angle in (-pi, pi].\nfn wrap(x: {t}) -> {t} {{\n    let y = x - {turn} * {}((x - {half}) / {turn});\n    let y = if y > {half} {{ y - {turn} }} else {{ y }};\n    if y <= -{half} {{ y + {turn} }} else {{ y }}\n}}\n",
                self.library("ceil")
            ),
        );
        for (function, name, operator) in [(Binary::Min, "min", "<"), (Binary::Max, "max", ">")] {
            helper(
                used.binary.contains(&function),
                format!(
                    "/// Not a number if either is not.\nfn {name}(a: {t}, b: {t}) -> {t} {{\n    if a {operator} b {{ a }} else if b {operator}= a {{ b }} else {{ a + b }}\n}}\n"
                ),
            );
        }
    }

    fn parameter(&self, name: &str, kind: Kind) -> String {
        let t = self.real();
        match kind {
            Kind::In(length) => format!("{name}: &[{t}; {length}]"),
            Kind::Out(length) => format!("{name}: &mut [{t}; {length}]"),
            Kind::Value => format!("{name}: {t}"),
        }
    }

    fn function(&self, function: &Function, out: &mut String) {
        let parameters: Vec<String> =
            function.parameters.iter().map(|parameter| self.parameter(parameter.name, parameter.kind)).collect();
        let gives = if function.gives { " -> i32" } else { "" };
        *out += &format!("fn {}_inner({}){gives} {{\n", function.name, parameters.join(", "));
        let inside = Self {
            precision: self.precision,
            parameters: function.parameters.iter().map(|parameter| parameter.name).collect(),
        };
        block(&inside, &function.body, 1, out);
        *out += "}\n\n";
    }

    /// The struct of a model on its way.
    fn variable(&self, assembled: &Assembled<'_>, out: &mut String) {
        let (t, plan) = (self.real(), &assembled.plan);
        *out += "/// State of a running model.\n#[derive(Debug, Clone, PartialEq)]\npub struct Model {\n";
        if !plan.states.is_empty() {
            *out += &format!("    /// The states.\n    pub x: [{t}; {}],\n", plan.states.len());
        }
        if plan.memory() > 0 {
            *out +=
                &format!("    /// Earlier rows: see the head of this file.\n    pub past: [{t}; {}],\n", plan.memory());
        }
        if plan.time {
            *out += &format!("    /// Seconds since the start.\n    pub t: {t},\n");
        }
        *out += "}\n\nimpl Model {\n";
        self.new_method(assembled, out);
        if !plan.states.is_empty() {
            self.step_method(assembled, out);
        }
        if plan.remembers() {
            self.observe_method(assembled, out);
            for public in assembled.public() {
                self.method(assembled, &public, out);
            }
        }
        *out += "}\n\n";
    }

    fn new_method(&self, assembled: &Assembled<'_>, out: &mut String) {
        let (t, plan) = (self.real(), &assembled.plan);
        let start = if plan.states.is_empty() { String::new() } else { format!("x0: &[{t}; {}]", plan.states.len()) };
        *out += "    /// Starts; earlier rows are taken for equal to `x0`, with inputs of 0: observe real rows where that is wrong.\n";
        *out += &format!("    pub fn new({start}) -> Self {{\n");
        let mut fields = Vec::new();
        if !plan.states.is_empty() {
            fields.push("x: *x0".to_owned());
        }
        if plan.memory() > 0 {
            *out += &format!("        let mut past = [0.0; {}];\n", plan.memory());
            for delay in &plan.delays {
                let value = match delay.source {
                    Source::State(i) => format!("x0[{i}]"),
                    Source::Input(_) => continue,
                    Source::Time => {
                        format!(
                            "({} - i) as {t} * {}",
                            delay.depth,
                            self.number(assembled.step.unwrap_or(plan.model.step))
                        )
                    }
                };
                *out += &format!(
                    "        for i in 0..{} {{\n            past[{} + i] = {value};\n        }}\n",
                    delay.depth, delay.offset
                );
            }
            fields.push("past".into());
        }
        if plan.time {
            fields.push("t: 0.0".into());
        }
        *out += &format!("        Self {{ {} }}\n    }}\n\n", fields.join(", "));
    }

    /// `, u, u_next, dt` with the existing parameters only.
    fn given(&self, assembled: &Assembled<'_>, next: bool, dt: bool) -> String {
        let inputs = assembled.plan.inputs.len();
        let mut text = if inputs > 0 { format!(", u: &[{}; {inputs}]", self.real()) } else { String::new() };
        if next {
            text += &format!(", {NEXT_INPUTS}: &[{}; {inputs}]", self.real());
        }
        if dt {
            text += &format!(", dt: {}", self.real());
        }
        text
    }

    /// Arguments with which the methods of the model call an inner function.
    fn inner_arguments(function: &Function, next: &str) -> String {
        let arguments: Vec<String> = function
            .parameters
            .iter()
            .map(|parameter| match (parameter.name, parameter.kind) {
                ("t", _) => "self.t".into(),
                (name @ ("x" | "past"), Kind::Out(_)) => format!("&mut self.{name}"),
                (name @ ("x" | "past"), _) => format!("&self.{name}"),
                ("n", _) => next.to_owned(),
                (name, _) => name.to_owned(),
            })
            .collect();
        arguments.join(", ")
    }

    fn remember(&self, assembled: &Assembled<'_>) -> String {
        let mut text = String::new();
        if let Some(remember) = assembled.code.functions.iter().find(|function| function.name == "remember") {
            text += &format!("        remember_inner({});\n", Self::inner_arguments(remember, ""));
        }
        if assembled.plan.time {
            let step = assembled.step.map_or_else(|| "dt".to_owned(), |step| self.number(step));
            text += &format!("        self.t += {step};\n");
        }
        text
    }

    fn step_method(&self, assembled: &Assembled<'_>, out: &mut String) {
        let Some(next) = assembled.code.functions.iter().find(|function| function.name == "next") else { return };
        let doc = format!(
            "Advances the states by one step; the code is that of the step's start.{}",
            assembled.next_inputs_doc()
        );
        for line in fold(&doc, 110) {
            *out += &format!("    /// {line}\n");
        }
        let given = self.given(assembled, assembled.plan.next_inputs, assembled.free_step());
        *out += &format!("    pub fn step(&mut self{given}) -> i32 {{\n");
        *out += &format!("        let mut n = [0.0; {}];\n", assembled.plan.states.len());
        *out += &format!("        let code = next_inner({});\n", Self::inner_arguments(next, "&mut n"));
        *out += "        if failed(code) {\n            return code;\n        }\n";
        *out += &self.remember(assembled);
        *out += "        self.x = n;\n        code\n    }\n\n";
    }

    fn observe_method(&self, assembled: &Assembled<'_>, out: &mut String) {
        let (t, states) = (self.real(), assembled.plan.states.len());
        let next = if states > 0 { format!(", x_next: &[{t}; {states}]") } else { String::new() };
        let dt = assembled.free_step() && assembled.plan.time;
        *out += "    /// A step that was measured: the present row, with the inputs `u`, becomes the past.\n";
        *out += &format!("    pub fn observe(&mut self{}{next}) {{\n", self.given(assembled, false, dt));
        *out += &self.remember(assembled);
        if states > 0 {
            *out += "        self.x = *x_next;\n";
        }
        *out += "    }\n\n";
    }

    fn method(&self, assembled: &Assembled<'_>, public: &Public<'_>, out: &mut String) {
        for line in fold(&public.doc, 110) {
            *out += &format!("    /// {line}\n");
        }
        let given: Vec<String> = public
            .parameters(&assembled.plan)
            .into_iter()
            .map(|(name, kind)| format!(", {}", self.parameter(name, kind)))
            .collect();
        *out += &format!("    pub fn {}(&self{}) -> i32 {{\n", public.name, given.concat());
        let arguments: Vec<String> = public
            .inner
            .parameters
            .iter()
            .zip(outer_names(public))
            .map(|(parameter, outer)| match parameter.name {
                "t" => "self.t".into(),
                "x" | "past" => format!("&self.{}", parameter.name),
                _ => outer.to_owned(),
            })
            .collect();
        *out += &format!("        {}_inner({})\n    }}\n\n", public.inner.name, arguments.join(", "));
    }

    fn free(&self, assembled: &Assembled<'_>, public: &Public<'_>, out: &mut String) {
        for line in fold(&public.doc, 114) {
            *out += &format!("/// {line}\n");
        }
        let given: Vec<String> =
            public.parameters(&assembled.plan).into_iter().map(|(name, kind)| self.parameter(name, kind)).collect();
        *out += &format!("pub fn {}({}) -> i32 {{\n", public.name, given.join(", "));
        *out += &format!("    {}_inner({})\n}}\n\n", public.inner.name, outer_names(public).join(", "));
    }
}
