use fleetfoot_data::Column as DataColumn;
use fleetfoot_sparse::constrained::Limit;

use super::*;

const AIRCRAFT: &str = r#"
[columns]
Isp_model = "1e4 - 0.2*h"
[latents]
T = { times = "N1", of = ["rho", "M"], degree = 4 }
D = { times = "q", of = ["alpha", "M"], degree = 3, penalty = 0.5, at_least = 0.0 }
L = { times = "q", of = ["alpha", "M"], degree = 3, signs = "+" }
Isp = { times = "SAT", of = ["h", "M"], degree = 3, prior = "Isp_model", prior_strength = 1000 }
[tasks]
along = { target = "m*V_dot", right = "T*cos(alpha) - D - m*9.80665*sin(gamma)" }
normal = { target = "m*V*gamma_dot + m*9.80665*cos(gamma)", right = "T*sin(alpha) + L" }
fuel = { target = "0", right = "T + m_dot*Isp", scale = 1e4 }
"#;

fn fields() -> Vec<DataColumn> {
    ["h", "V", "gamma", "m", "alpha", "N1", "SAT", "rho", "M", "q", "V_dot", "gamma_dot", "m_dot", "T", "D"]
        .map(DataColumn::float)
        .to_vec()
}

fn resolve(text: &str) -> Result<StructuredTask, String> {
    let recipe = Recipe::parse(text, "test").unwrap();
    StructuredTask::resolve(&recipe, &fields()).map_err(|error| error.to_string())
}

#[test]
fn the_equations_of_the_paper() {
    let task = resolve(AIRCRAFT).unwrap();
    let regression = &task.regression;
    assert_eq!(regression.structure().functions, [15, 10, 10, 10]);
    assert_eq!(regression.latents[0].functions[0].to_string(), "N1");
    let shapes: Vec<Vec<(usize, String)>> = regression
        .tasks
        .iter()
        .map(|task| task.terms.iter().map(|term| (term.latent, term.coefficient.to_string())).collect())
        .collect();
    let shape = |terms: &[(usize, &str)]| terms.iter().map(|(k, c)| (*k, (*c).to_owned())).collect::<Vec<_>>();
    assert_eq!(shapes[0], shape(&[(0, "cos(alpha)"), (1, "-1")]));
    assert_eq!(shapes[1], shape(&[(0, "sin(alpha)"), (2, "1")]));
    assert_eq!(shapes[2], shape(&[(0, "1"), (3, "m_dot")]));
    assert_eq!(shapes[3], shape(&[(3, "1")]));
    // Terms without a latent move to the target: m V_dot + m g sin(gamma).
    let values = |name: &str, _: i32| match name {
        "m" => 6e4,
        "V_dot" => 0.3,
        "gamma" => 0.05,
        _ => f64::NAN,
    };
    let moved = regression.tasks[0].target.value(values, |_| 0.0);
    assert!((moved - (6e4 * 0.3 + 6e4 * 9.80665 * 0.05f64.sin())).abs() < 1e-9);
    assert!(regression.tasks[3].prior && regression.tasks[3].target.to_string() == "Isp_model");
    assert_eq!(task.scales, [None, None, Some(1e4), None]);
    assert_eq!(task.strengths, [Some(1.0), Some(1.0), Some(1.0), Some(1000.0)]);
    assert_eq!((task.penalties[14], task.penalties[15], task.penalties[25]), (1.0, 0.5, 1.0));
    assert_eq!((task.signs[24], task.signs[25]), (Sign::Free, Sign::NonNegative));
    let [limit] = &task.limits[..] else { panic!("{:?}", task.limits) };
    assert_eq!(*limit, RowLimit::of_latent("D", 1, Limit::AtLeast, Expr::number(0.0)));
    assert_eq!(task.moments[1], Moments::Task { task: 0, first: 15, factor: -1.0 });
    assert_eq!(task.moments[3], Moments::Task { task: 3, first: 0, factor: 1.0 });
    // No state has an equation: what the tasks say is predicted, and the constant target of `fuel` is not.
    let labels: Vec<String> = task.equations.iter().map(Equation::label).collect();
    assert_eq!(labels, ["along", "normal"]);
    assert_eq!(task.equations[0].right.to_string(), "T*cos(alpha) - D - m*9.80665*sin(gamma)");
    let along = task.columns.iter().find(|column| column.name == "along").unwrap();
    assert_eq!((along.source.as_str(), along.role), ("m*V_dot", Role::Auxiliary));
}

#[test]
fn states_have_equations_over_latents() {
    let states = r#"
[states]
V = { derivative = "V_dot", equation = "(T*cos(alpha) - D)/m - 9.80665*sin(gamma)" }
m = { derivative = "m_dot", equation = "-T/Isp" }
h = { known = "V*sin(gamma)" }
"#;
    let task = resolve(&format!("{AIRCRAFT}{states}")).unwrap();
    let labels: Vec<String> = task.equations.iter().map(Equation::label).collect();
    assert_eq!(labels, ["d(V)/dt", "d(m)/dt", "d(h)/dt"]);
    assert_eq!((task.targets(), task.states(), task.also.len()), (2, 3, 5));
    assert_eq!(task.equations[1].target.as_ref().unwrap().to_string(), "m_dot");
    let missing = resolve(&format!("{AIRCRAFT}{states}gamma = {{ derivative = \"gamma_dot\" }}\n")).unwrap_err();
    assert!(missing.contains("[states] gamma") && missing.contains("equation"), "{missing}");
}

#[test]
fn plain_recipes_have_a_latent_for_every_equation() {
    let task =
        resolve("[states]\nV = { derivative = \"V_dot\" }\nh = { known = \"V\" }\n[inputs]\nalpha = \"alpha\"\n[model]\ndegree = 2\n")
            .unwrap();
    // V and h, alpha: 1, three of degree 1, six of degree 2.
    assert_eq!(task.regression.structure().functions, [10]);
    assert_eq!(task.regression.latents[0].name, "f_V");
    assert_eq!(task.penalties[..2], [0.0, 1.0], "the constant is free");
    assert!(task.regression.structure().tasks[0].centred);
    assert_eq!(task.equations.len(), 2);
}

#[test]
fn latents_without_constant_have_separate_moments() {
    let task = resolve(
        "[latents]\nf = { functions = [\"h\", \"sin(h)\"], constant = true }\n[tasks]\nlift = { target = \"V\", right = \"f*M\" }\n",
    )
    .unwrap();
    assert_eq!(task.moments, [Moments::Also(1)]);
    assert_eq!(task.also.iter().map(ToString::to_string).collect::<Vec<_>>(), ["lift", "1", "h", "sin(h)"]);
    assert_eq!(task.penalties, [1.0; 3], "1 stands for M, which is no intercept");
}

#[test]
fn errors_name_the_place_and_the_remedy_in_recipes() {
    let with = |latents: &str, tasks: &str| format!("[latents]\n{latents}\n[tasks]\n{tasks}\n");
    let f = "f = { of = [\"h\"] }";
    let both = "f = { of = [\"h\"] }\ng = { of = [\"M\"] }";
    for (text, parts) in [
        (with(f, ""), vec!["[latents] without [tasks]"]),
        (with("", "a = { target = \"V\", right = \"h\" }"), vec!["[tasks] without [latents]"]),
        (
            with(f, "a = { target = \"V\", right = \"M*h\" }"),
            vec!["[tasks] a right", "no latent", "`M*h`", "the latents are f"],
        ),
        (with(both, "a = { target = \"V\", right = \"f\" }"), vec!["[latents] g", "no task"]),
        (with(f, "a = { target = \"V\", right = \"f + gama\" }"), vec!["[tasks] a right", "gama", "`gamma`"]),
        (
            with("f = { of = [\"gama\"] }", "a = { target = \"V\", right = \"f\" }"),
            vec!["[latents] f of", "gama", "`gamma`"],
        ),
        (with(f, "a = { target = \"V\", right = \"f^2\" }"), vec!["[tasks] a right", "f^2", "not linear in `f`"]),
        (with(both, "a = { target = \"V\", right = \"f*g\" }"), vec!["`f` is multiplied with `g`"]),
        (with(f, "a = { target = \"V\", right = \"sign(f) + f\" }"), vec!["`sign(f)` is not linear"]),
        (with(f, "a = { target = \"V\", right = \"f + lag(f, 1)\" }"), vec!["`lag(f, 1)` is not linear"]),
        (with(f, "a = { target = \"V\", right = \"max(f, 0)\" }"), vec!["`max(f, 0)` is not linear"]),
        (with(f, "a = { target = \"V\", right = \"f - f\" }"), vec!["`f` cancels out"]),
        (with(f, "a = { target = \"f\", right = \"f\" }"), vec!["[tasks] a target", "reads the latent `f`"]),
        (with(f, "a = { target = \"1\", right = \"f\" }"), vec!["[tasks] a", "constant", "scale"]),
        (with(f, "a = { target = \"V\", right = \"f\", scale = -1.0 }"), vec!["[tasks] a scale = -1", "positive"]),
        (with("f = {}", "a = { target = \"V\", right = \"f\" }"), vec!["[latents] f", "no candidate"]),
        (
            with("f = { functions = [\"h\", \"h\"] }", "a = { target = \"V\", right = \"f\" }"),
            vec!["candidate 2 is candidate 1"],
        ),
        (
            with("f = { of = [\"h\"], signs = \"up\" }", "a = { target = \"V\", right = \"f\" }"),
            vec!["[latents] f signs = \"up\""],
        ),
        (
            with("f = { of = [\"h\"], penalty = -1.0 }", "a = { target = \"V\", right = \"f\" }"),
            vec!["[latents] f penalty = -1"],
        ),
        (
            with("f = { of = [\"h\"], at_least = 2.0, at_most = 1.0 }", "a = { target = \"V\", right = \"f\" }"),
            vec!["at_least = 2"],
        ),
        (with("f = { of = [\"h\"], prior_strength = 2.0 }", "a = { target = \"V\", right = \"f\" }"), vec!["no prior"]),
        (
            with("f = { of = [\"h\"], prior = \"gama\" }", "a = { target = \"V\", right = \"f\" }"),
            vec!["[latents] f prior", "`gamma`"],
        ),
        (with(f, "V = { target = \"V\", right = \"f\" }"), vec!["[tasks] V", "rename the task"]),
        (
            format!("[columns]\nf = \"h\"\n{}", with(f, "a = { target = \"V\", right = \"f\" }")),
            vec!["[latents] f", "rename"],
        ),
    ] {
        let message = resolve(&text).expect_err(&text);
        for part in parts {
            assert!(message.contains(part), "{text}\n{message}\nlacks {part}");
        }
    }
}
