use fleetfoot_data::Column as DataColumn;
use fleetfoot_task::EquationTask;

use super::*;

fn fields() -> Vec<DataColumn> {
    ["x", "y", "u", "m", "dx", "theta"].map(DataColumn::float).to_vec()
}

fn resolve(text: &str) -> Result<EquationTask, String> {
    let recipe = Recipe::parse(text, "test").unwrap();
    EquationTask::resolve(&recipe, &fields()).map_err(|error| error.to_string())
}

fn candidates(task: &EquationTask, equation: usize) -> Vec<String> {
    (0..task.candidates()).filter(|&j| task.fitted[equation].allowed[j]).map(|j| task.candidate(j)).collect()
}

#[test]
fn default_library_has_the_given_degree() {
    let task = resolve("[states]\nx = {}\ny = {}\n").unwrap();
    assert_eq!(candidates(&task, 0), ["1", "x", "y", "x^2", "x*y", "y^2"]);
    assert_eq!((task.fitted.len(), task.fitted[1].latent.as_str()), (2, "f_y"));
    let task = resolve("[states]\nx = {}\n[inputs]\nu = \"u\"\n[model]\ndegree = 1\nlags = 1\n").unwrap();
    assert_eq!(candidates(&task, 0), ["1", "x", "u", "lag(x, 1)", "lag(u, 1)"]);
    let angle = resolve("[states]\ntheta = { kind = \"angle\" }\n[model]\ndegree = 1\n").unwrap();
    assert_eq!(candidates(&angle, 0), ["1", "cos(theta)", "sin(theta)"]);
}

/// 30 signals have 496 monomials up to degree 2, 31 have 528.
#[test]
fn default_library_stays_linear_for_many_signals() {
    let resolve = |signals: usize, more: &str| {
        let names: Vec<String> = (0..signals).map(|at| format!("x{at}")).collect();
        let fields: Vec<DataColumn> = names.iter().map(|name| DataColumn::float(name.as_str())).collect();
        let states: String = names.iter().map(|name| format!("{name} = {{}}\n")).collect();
        let recipe = Recipe::parse(&format!("[states]\n{states}{more}"), "test").unwrap();
        EquationTask::resolve(&recipe, &fields).unwrap()
    };
    let few = resolve(30, "");
    assert_eq!((few.candidates(), few.narrowed_note()), (496, None));
    let many = resolve(31, "");
    assert_eq!(many.candidates(), 32);
    assert!(many.narrowed_note().is_some_and(|note| note.contains("--degree 2")));
    for explicit in ["[model]\ndegree = 2\n", "[library]\nfunctions = [\"poly(2)\"]\n"] {
        let many = resolve(31, explicit);
        assert_eq!((many.candidates(), many.narrowed_note()), (528, None), "{explicit}");
    }
}

#[test]
fn equations_have_separate_libraries() {
    let task = resolve(
        "[library]\nfunctions = [\"identity\", \"x*y\"]\n[states]\nx = { fixed = [\"y*x\", \"abs(u)\"] }\ny = { library = [\"1\", \"sin(x)\", \"x\"] }\n",
    )
    .unwrap();
    assert_eq!(candidates(&task, 0), ["x", "y", "x*y", "abs(u)"]);
    assert_eq!(candidates(&task, 1), ["1", "x", "sin(x)"]);
    let fixed: Vec<String> = task.fitted[0].fixed.iter().map(|&j| task.candidate(j)).collect();
    assert_eq!(fixed, ["x*y", "abs(u)"], "y*x is x*y, which the library has");
    assert!(task.columns.iter().any(|column| column.name == "u"), "an input of a term is read too");
}

#[test]
fn the_nominal_part_leaves_the_rest_to_be_learnt() {
    let task = resolve("[states]\nx = { derivative = \"dx\", nominal = \"u/m - 9.81\" }\n").unwrap();
    let equation = &task.fitted[0];
    assert_eq!(
        (equation.measured.to_string().as_str(), task.equations[0].right.to_string().as_str()),
        ("dx", "u/m - 9.81 + f_x")
    );
    let value =
        |name: &str, _: i32| [("dx", 3.0), ("u", 4.0), ("m", 2.0)].iter().find(|pair| pair.0 == name).unwrap().1;
    assert!((equation.target.value(value, |_| 0.0) - (3.0 - 2.0 + 9.81)).abs() < 1e-14);
    assert_eq!(task.also().len(), 2);
}

#[test]
fn parameters_become_numbers_and_filters_columns() {
    let text = "[columns]\nv = \"2*u\"\n[states]\nx = { derivative = \"dx\", library = [\"x\", \"lag1(v, tau)^2\"] }\n[parameters]\ntau = { initial = 0.1, bounds = [0.01, 1.0] }\n";
    let task = resolve(text).unwrap();
    assert_eq!(candidates(&task, 0), ["x", "lag1(v, tau)^2"]);
    assert_eq!((task.parameters.len(), task.columns.len()), (1, 3), "x, dx and v: the filter is no column yet");
    let values = std::collections::BTreeMap::from([("tau".to_owned(), 0.25)]);
    let task = task.settled(&values);
    assert_eq!(candidates(&task, 0), ["x", "lag1(v, 0.25)^2"]);
    let filter = task.columns.last().unwrap();
    assert_eq!((filter.name.as_str(), filter.source.as_str()), ("lag1(v, 0.25)", "lag1(2*u, 0.25)"));
    assert!(task.parameters.is_empty());
}

#[test]
fn errors_name_the_place_and_the_remedy_in_recipes() {
    for (text, parts) in [
        ("[states]\nx = { library = [\"poly(2)\", \"sin(q)\"] }\n", ["[states] x library", "sin(q)", "q"]),
        ("[states]\nx = { library = [] }\n", ["[states] x", "no candidate", "poly(2)"]),
        ("[library]\nfunctions = [\"poly(\"]\n[states]\nx = {}\n", ["[library] functions", "poly(", "expected"]),
        ("[states]\nx = { nominal = \"thetta*u\" }\n", ["[states] x nominal", "thetta", "`theta`"]),
        ("[states]\nx = { known = \"y\", library = [\"1\"] }\n", ["[states] x", "known", "nothing is learnt"]),
        ("[states]\nx = { equation = \"y\" }\n", ["[states] x equation", "fit sparse", "nominal"]),
        ("[states]\nx = {}\n[parameters]\nk = { initial = 1.0 }\n", ["[parameters] k", "no library item", "remove it"]),
        ("[states]\nx = {}\n[parameters]\nu = { initial = 1.0 }\n", ["[parameters] u", "a column", "rename"]),
        (
            "[states]\nx = { library = [\"sin(k*x)\"] }\n[parameters]\nk = { initial = 3.0, bounds = [0.0, 1.0] }\n",
            ["[parameters] k initial = 3", "within", "0 to 1"],
        ),
        (
            "[states]\nx = { library = [\"sin(k*x)\"] }\n[parameters]\nk = { initial = 3.0, bounds = [9.0, 1.0] }\n",
            ["[parameters] k bounds", "least", "greatest"],
        ),
    ] {
        let message = resolve(text).expect_err(text);
        assert!(parts.iter().all(|part| message.contains(part)), "{text}{message}");
    }
}
