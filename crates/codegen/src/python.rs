//! Python without dependencies.

use fleetfoot_library::{Binary, Unary};

use crate::{
    ExportOptions, ExportedFile,
    assemble::Assembled,
    code::{Condition, Function, Kind, Outcome, Statement, Values},
    cost::Used,
    layout,
    lower::NEXT_INPUTS,
    names::{camel, comment, literal},
    plan::Source,
    print::{Syntax, arguments, block, index, place, real},
    public::{Public, fold},
    transitions::{self, TransitionTables},
};

/// The file `prefix.py`.
pub(crate) fn file(assembled: &Assembled<'_>, options: &ExportOptions) -> ExportedFile {
    ExportedFile::text(format!("{}.py", options.prefix), module(assembled, &camel(&options.prefix)))
}

struct Python;

fn module(assembled: &Assembled<'_>, class: &str) -> String {
    let mut out = String::new();
    for line in assembled.about() {
        out += format!("# {}", comment(&line)).trim_end();
        out.push('\n');
    }
    out += "#\n";
    let text = "Python without dependencies. Functions give the code and then their results, lists of floats; matrices are lists of rows, one after the other.";
    for line in fold(text, 112) {
        out += &format!("# {line}\n");
    }
    out += "\nimport math\n\n";
    names(assembled, &mut out);
    if let Some(tables) = TransitionTables::of(assembled) {
        transitions::python(&tables, &mut out);
    }
    for table in &assembled.code.tables {
        let values: Vec<String> = match &table.values {
            Values::Reals(values) => values.iter().map(|&value| Python.number(value)).collect(),
            Values::Indices(values) => values.iter().map(usize::to_string).collect(),
        };
        out += &format!("# {}\n{} = (\n", comment(&table.comment), Python.table(table.plain_name()));
        layout::rows(&values, table.row, &mut out);
        out += ")\n\n";
    }
    helpers(&Used::of(&assembled.code), &mut out);
    for function in &assembled.code.functions {
        inner(function, &mut out);
    }
    out += &format!("\nclass {class}:\n    \"\"\"State of a running model.\"\"\"\n\n");
    methods(assembled, &mut out);
    out.truncate(out.trim_end().len());
    out.push('\n');
    out
}

fn names(assembled: &Assembled<'_>, out: &mut String) {
    let plan = &assembled.plan;
    let states: Vec<&str> = plan.states.iter().map(|state| state.signal.name.as_str()).collect();
    let inputs: Vec<&str> = plan.inputs.iter().map(|input| input.name.as_str()).collect();
    let outputs: Vec<&str> = plan.outputs.iter().map(|output| output.name.as_str()).collect();
    for (constant, names) in
        [("STATES", states), ("INPUTS", inputs), ("OUTPUTS", outputs), ("REGIONS", assembled.regions())]
    {
        let texts: Vec<String> = names.iter().map(|name| literal(name, |code| format!("\\U{code:08x}"))).collect();
        *out += &format!("{constant} = (\n");
        layout::rows(&texts, names.len(), out);
        *out += ")\n";
    }
    *out += "NO_REGION = -32767\nNOT_FINITE = -32766\n";
    if let Some(step) = assembled.step {
        *out += &format!("STEP = {step:?}\n");
    }
    *out += "\n\n";
}

fn helpers(used: &Used, out: &mut String) {
    let mut helper = |wanted: bool, text: &str| {
        if wanted {
            *out += text;
            *out += "\n\n";
        }
    };
    helper(used.unary.contains(&Unary::Sign), "def _sign(x):\n    return 1.0 if x > 0.0 else -1.0 if x < 0.0 else x\n");
    helper(used.unary.contains(&Unary::Step), "def _step(x):\n    return 1.0 if x > 0.0 else 0.0 if x <= 0.0 else x\n");
    helper(
        used.unary.contains(&Unary::Wrap),
        "def _wrap(x):\n    y = x - math.tau * math.ceil((x - math.pi) / math.tau)\n    if y > math.pi:\n        y -= math.tau\n    if y <= -math.pi:\n        y += math.tau\n    return y\n",
    );
    helper(
        used.binary.contains(&Binary::Min),
        "def _min(a, b):\n    return a if a < b else b if b <= a else math.nan\n",
    );
    helper(
        used.binary.contains(&Binary::Max),
        "def _max(a, b):\n    return a if a > b else b if b >= a else math.nan\n",
    );
}

fn inner(function: &Function, out: &mut String) {
    let parameters: Vec<&str> = function.parameters.iter().map(|parameter| parameter.name).collect();
    *out += &format!("def _{}({}):\n", function.name, parameters.join(", "));
    block(&Python, &function.body, 1, out);
    *out += "\n\n";
}

/// Methods of the class; the state of a model without memory is an attribute all the same.
fn methods(assembled: &Assembled<'_>, out: &mut String) {
    let plan = &assembled.plan;
    let start = if plan.states.is_empty() { "" } else { ", x0" };
    *out += &format!("    def __init__(self{start}):\n");
    *out += if plan.states.is_empty() { "        self.x = []\n" } else { "        self.x = [float(v) for v in x0]\n" };
    *out += &format!("        self.past = [0.0] * {}\n        self.t = 0.0\n", plan.memory());
    for delay in &plan.delays {
        let value = match delay.source {
            Source::State(i) => format!("self.x[{i}]"),
            Source::Input(_) => continue,
            Source::Time => format!("({} - i) * {:?}", delay.depth, assembled.step.unwrap_or(plan.model.step)),
        };
        *out += &format!(
            "        for i in range({}):\n            self.past[{} + i] = {value}\n",
            delay.depth, delay.offset
        );
    }
    out.push('\n');
    if !plan.states.is_empty() {
        let next = given(assembled, plan.next_inputs, assembled.free_step());
        let given = given(assembled, false, assembled.free_step());
        *out += &format!(
            "    def step(self{next}):\n        \"\"\"Advances the states by one step; gives the code.{}\"\"\"\n",
            assembled.next_inputs_doc()
        );
        *out += &format!("        code, x_next = self.next({})\n", next.trim_start_matches(", "));
        *out += "        if code > NOT_FINITE:\n";
        let arguments = given.trim_start_matches(", ");
        *out += &format!(
            "            self.observe({arguments}{}x_next)\n        return code\n\n",
            if arguments.is_empty() { "" } else { ", " }
        );
    }
    observe(assembled, out);
    for public in assembled.public() {
        method(assembled, &public, out);
    }
}

/// `, u, u_next, dt` with the existing parameters only.
fn given(assembled: &Assembled<'_>, next: bool, dt: bool) -> String {
    let mut text = String::new();
    if !assembled.plan.inputs.is_empty() {
        text += ", u";
    }
    if next {
        text += &format!(", {NEXT_INPUTS}");
    }
    if dt {
        text += ", dt";
    }
    text
}

fn observe(assembled: &Assembled<'_>, out: &mut String) {
    let plan = &assembled.plan;
    let next = if plan.states.is_empty() { "" } else { ", x_next" };
    *out += &format!(
        "    def observe(self{}{next}):\n",
        given(assembled, false, assembled.free_step() && !plan.states.is_empty())
    );
    *out += "        \"\"\"A step that was measured: the present row, with the inputs u, becomes the past.\"\"\"\n";
    if let Some(remember) = assembled.code.functions.iter().find(|function| function.name == "remember") {
        let arguments: Vec<String> = remember
            .parameters
            .iter()
            .map(|parameter| match parameter.name {
                "x" | "past" => format!("self.{}", parameter.name),
                name => name.to_owned(),
            })
            .collect();
        *out += &format!("        _remember({})\n", arguments.join(", "));
    }
    let step = assembled.step.map_or_else(|| "dt".to_owned(), |step| format!("{step:?}"));
    *out += &format!("        self.t += {step}\n");
    if !plan.states.is_empty() {
        *out += "        self.x = list(x_next)\n";
    }
    out.push('\n');
}

fn method(assembled: &Assembled<'_>, public: &Public<'_>, out: &mut String) {
    let given: Vec<&str> = public
        .inner
        .parameters
        .iter()
        .filter(|parameter| !matches!(parameter.kind, Kind::Out(_)) && !matches!(parameter.name, "x" | "past" | "t"))
        .map(|parameter| parameter.name)
        .collect();
    let head: String = given.iter().map(|name| format!(", {name}")).collect();
    *out += &format!("    def {}(self{head}):\n        \"\"\"\n", public.name);
    for line in fold(&public.doc, 104) {
        *out += &format!("        {line}\n");
    }
    *out += "        \"\"\"\n";
    let mut results = Vec::new();
    let mut arguments = Vec::new();
    for parameter in &public.inner.parameters {
        match parameter.kind {
            Kind::Out(length) => {
                *out += &format!("        {} = [0.0] * {length}\n", parameter.name);
                results.push(parameter.name);
                arguments.push(parameter.name.to_owned());
            }
            _ if matches!(parameter.name, "x" | "past" | "t") => arguments.push(format!("self.{}", parameter.name)),
            _ => arguments.push(parameter.name.to_owned()),
        }
    }
    *out += &format!("        try:\n            code = _{}({})\n", public.inner.name, arguments.join(", "));
    // Python raises an error in cases in which C returns a NaN or an infinity.
    *out += "        except (ArithmeticError, ValueError):\n            code = NOT_FINITE\n";
    *out += &format!("        return code, {}\n\n", results.join(", "));
    debug_assert!(!assembled.code.functions.is_empty());
}

impl Syntax for Python {
    fn number(&self, value: f64) -> String {
        format!("{value:?}")
    }

    fn unary(&self, function: Unary, x: &str) -> String {
        match function {
            Unary::Neg => format!("-({x})"),
            Unary::Abs => format!("abs({x})"),
            Unary::Sign | Unary::Step | Unary::Wrap => format!("_{}({x})", function.name()),
            _ => format!("math.{}({x})", function.name()),
        }
    }

    fn binary(&self, function: Binary, a: &str, b: &str) -> String {
        match function {
            Binary::Add | Binary::Sub | Binary::Mul | Binary::Div => format!("({a}) {} ({b})", function.name()),
            Binary::Pow => format!("math.pow({a}, {b})"),
            Binary::Atan2 => format!("math.atan2({a}, {b})"),
            Binary::Min | Binary::Max => format!("_{}({a}, {b})", function.name()),
        }
    }

    fn table(&self, table: &str) -> String {
        format!("_{}", table.to_ascii_uppercase())
    }

    fn index_table(&self, table: &str, index: &str) -> String {
        format!("{}[{index}]", self.table(table))
    }

    fn condition(&self, condition: &Condition) -> String {
        match condition {
            Condition::Less(a, b) => format!("{} < {}", real(self, a), real(self, b)),
            Condition::AtLeast(a, b) => format!("{} >= {}", real(self, a), real(self, b)),
            Condition::Equal(a, b) => format!("{} == {}", real(self, a), real(self, b)),
            Condition::Outside(value, low, high) => {
                format!("not {} <= {} <= {}", real(self, low), real(self, value), real(self, high))
            }
            Condition::NotFinite(value) => format!("not math.isfinite({})", real(self, value)),
            Condition::Same(a, b) => format!("{} == {}", index(self, a), index(self, b)),
            Condition::Failed(code) => format!("{code} <= NOT_FINITE"),
        }
    }

    fn simple(&self, statement: &Statement) -> Vec<String> {
        let long = |text: String| if text.len() > 80 { format!("({text})") } else { text };
        let one = match statement {
            Statement::Comment(text) => format!("# {}", comment(text)),
            Statement::Let(name, value) | Statement::Variable(name, value) => {
                format!("{name} = {}", long(real(self, value)))
            }
            Statement::Array(name, length) => format!("{name} = [0.0] * {length}"),
            Statement::Set(to, value) => format!("{} = {}", place(self, to), long(real(self, value))),
            Statement::Add(to, value) => format!("{} += {}", place(self, to), long(real(self, value))),
            Statement::Counter(name, value) | Statement::SetCounter(name, value) => {
                format!("{name} = {}", index(self, value))
            }
            Statement::Call { result, function, arguments: given } => {
                format!("{result} = _{function}({})", arguments(self, given, &|name, _| name.to_owned()))
            }
            Statement::Return(outcome) => match outcome {
                Outcome::Region { region, outside: None } => format!("return {}", index(self, region)),
                Outcome::Region { region, outside: Some(outside) } => {
                    let region = index(self, region);
                    format!("return -1 - ({region}) if {outside} else {region}")
                }
                Outcome::NoRegion => "return NO_REGION".into(),
                Outcome::NotFinite => "return NOT_FINITE".into(),
                Outcome::Same(code) => format!("return {code}"),
            },
            Statement::For { .. } | Statement::If(..) => return Vec::new(),
        };
        vec![one]
    }

    fn open_for(&self, index: &str, from: &str, to: &str) -> String {
        format!("for {index} in range({from}, {to}):")
    }

    fn open_if(&self, condition: &str) -> String {
        format!("if {condition}:")
    }

    fn open_else(&self) -> &'static str {
        "else:"
    }

    fn close(&self) -> Option<&'static str> {
        None
    }

    fn breakable(&self, line: &str) -> bool {
        // Long values stand in parentheses: see `simple`.
        line.ends_with(')') && line.len() > 100 && line.contains("= (")
    }
}
