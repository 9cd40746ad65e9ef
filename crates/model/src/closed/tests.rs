use fleetfoot_library::{Expr, Scope};

use crate::{
    AffineMap, Closed, ClosedError, Column, Equation, Latent, Model, Partition, Prediction, Role, Rule, Training,
    UnseenLabel,
};

fn parse(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).unwrap()
}

/// Columns as `name = source`, roles by the first letter: `s`, `i`, `a`.
fn columns(texts: &[&str]) -> Vec<Column> {
    let column = |text: &&str| {
        let (role, rest) = text.split_once(' ').unwrap();
        let (name, source) = rest.split_once(" = ").unwrap_or((rest, rest));
        let role = match role {
            "s" => Role::State,
            "i" => Role::Input,
            _ => Role::Auxiliary,
        };
        Column { name: name.into(), source: source.into(), unit: None, role, angle: false, rotation: None }
    };
    texts.iter().map(column).collect()
}

/// `advanced` are given equations `d(state)/dt = right`; one latent has the library.
fn model(texts: &[&str], advanced: &[(&str, &str)], library: &[&str], partition: &[&str]) -> Model {
    let mut model = Model::new("test", columns(texts), 0.1, Training::default());
    model.libraries = vec![library.iter().map(|text| parse(text)).collect()];
    let mut whole = Partition::whole();
    whole.columns = partition.iter().map(|text| parse(text)).collect();
    model.add_partition(whole, Vec::new());
    model.latents = vec![Latent {
        beyond: Vec::new(),
        name: "f".into(),
        library: 0,
        partition: 0,
        map: AffineMap { constants: vec![0.0], coefficients: vec![vec![1.0; library.len()]] }.into(),
    }];
    for (subject, right) in advanced {
        model.equations.push(Equation {
            subject: (*subject).into(),
            prediction: Prediction::Derivative,
            right: parse(right),
            target: None,
            unit: None,
        });
    }
    model
}

fn library(closed: &Closed) -> Vec<String> {
    closed.model.libraries[0].iter().map(ToString::to_string).collect()
}

fn added(closed: &Closed, columns: usize) -> Vec<(String, String)> {
    closed.model.columns[columns..].iter().map(|c| (c.name.clone(), c.source.clone())).collect()
}

#[test]
fn functions_of_states_and_inputs_are_written_out() {
    let texts = [
        "s v = /odom.v",
        "s yaw = yaw(/odom.q)",
        "i u = /cmd.u",
        "i drag = abs(/odom.v)*/odom.v",
        "a heading = cos(yaw(/odom.q))",
        "a force = 2*/cmd.u - abs(/odom.v)*/odom.v",
        "a copy = /odom.v",
        "a wind = /wind.x",
        "a gust = /wind.x^2",
    ];
    let sources = ["yaw(/odom.q)"];
    // A quaternion is four fields.
    let expand = |text: &&str| text.replace(sources[0], "atan2(`/odom.q.z`, `/odom.q.w`)");
    let texts: Vec<String> = texts.iter().map(expand).collect();
    let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
    let functions = ["drag", "heading*u", "lag(force, 2)", "copy", "wind", "gust", "lead(gust, 1)"];
    let model = model(&texts, &[("v", "f - drag"), ("yaw", "copy")], &functions, &["force", "lag(copy, 1)"]);
    let closed = model.closed(0.1, &[]).unwrap();
    let expected =
        ["abs(v)*v", "cos(yaw)*u", "2*lag(u, 2) - abs(lag(v, 2))*lag(v, 2)", "v", "wind", "gust", "lead(gust, 1)"];
    assert_eq!(library(&closed), expected);
    assert_eq!(closed.model.equations[0].right, parse("f - abs(v)*v"));
    assert_eq!(closed.model.equations[1].right, parse("v"));
    assert_eq!(closed.model.partitions[0].columns, [parse("2*u - abs(v)*v"), parse("lag(v, 1)")]);
    assert_eq!(closed.model.columns, model.columns);
    let names: Vec<&str> = closed.computed.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["drag", "heading", "force", "copy"]);
    // Once closed it stays as it is.
    let again = closed.model.closed(0.1, &[]).unwrap();
    assert_eq!(again.model, closed.model);
}

#[test]
fn unlisted_fields_are_added() {
    let texts = ["s x = x", "i v = /v", "a slip = x - wheel*`v`", "a gust = wind + gravity"];
    let model = model(&texts, &[("x", "f")], &["slip", "gust"], &[]);
    let closed = model.closed(0.1, &[]).unwrap();
    // The field `v` is another one than the column of this name.
    assert_eq!(library(&closed), ["x - wheel*v_", "gust"]);
    let definition = |name: &str, source: &str| (name.to_owned(), source.to_owned());
    assert_eq!(added(&closed, 4), [definition("wheel", "wheel"), definition("v_", "v")]);
    let auxiliary: Vec<String> = model.auxiliary_columns().into_iter().map(|column| column.name).collect();
    assert_eq!(auxiliary, ["wheel", "v_"]);
    assert_eq!(closed.model.closed(0.1, &[]).unwrap().model, closed.model);
}

#[test]
fn expressions_that_need_future_values_are_refused() {
    let texts = [
        "s y = /y",
        "i u = /u",
        "i s = sqrt(max(/y, 0))",
        "a dy = (lead(/y, 1) - lag(/y, 1))/2",
        "a du = lead(/u, 1) - /u",
    ];
    let ahead = |function: &str| model(&texts, &[("y", "f")], &[function], &[]).closed(0.1, &[]);
    let error = ahead("lead(s, 1)").unwrap_err();
    assert!(matches!(&error, ClosedError::Ahead { column, state, ahead: 1, .. } if column == "s" && state == "y"));
    for word in ["`s` = sqrt(max(y, 0))", "`y` 1 row ahead", "lag(s, 1)"] {
        assert!(error.to_string().contains(word), "{error}");
    }
    assert!(matches!(ahead("dy*u"), Err(ClosedError::Ahead { column, .. }) if column == "dy"));
    assert_eq!(library(&ahead("lag(dy, 1)").unwrap()), ["(y - lag(y, 2))/2"]);
    // Inputs are recorded, unless they are driven.
    assert_eq!(library(&ahead("du").unwrap()), ["du"]);
    let driven = model(&texts, &[("y", "f")], &["du"], &[]).closed(0.1, &["u".into()]);
    assert!(matches!(driven, Err(ClosedError::Ahead { column, state, .. }) if column == "du" && state == "u"));
    // A function that no latent has, and an equation that is not simulated, need not be known.
    let mut unused = model(&texts, &[("y", "f")], &["dy", "u"], &[]);
    unused.latents[0].map.set(0, Some(0), 0.0);
    assert_eq!(library(&unused.closed(0.1, &[]).unwrap()), ["dy", "u"]);
}

#[test]
fn filters_of_computed_columns_become_states() {
    let texts = [
        "s v = /v",
        "i u = /u",
        "a slow = lag1(/v, 0.5)",
        "a lead = /v - lag1(lag1(/v, 0.5), 2)",
        "a late = delay(/v^2, 0.25)",
        "a w = lag1(/wind, 3)",
    ];
    let functions = ["slow", "lead", "lag(late, 1)", "w", "delay(slow, 0.2)"];
    let mut model = model(&texts, &[("v", "f")], &functions, &[]);
    // As a system of equations has the filters of its candidates: as columns.
    model.columns.extend(columns(&["a delay(slow, 0.2) = delay(lag1(/v, 0.5), 0.2)"]));
    let closed = model.closed(0.1, &[]).unwrap();
    let late = "lag(v, 4)^2 + (lag(v, 3)^2 - lag(v, 4)^2)*0.5";
    assert_eq!(library(&closed), ["slow", "v - lag1(slow, 2)", late, "w", "lag(slow, 2)"]);
    let lags: Vec<(String, String, f64)> = closed
        .lags
        .iter()
        .map(|lag| (lag.equation.subject.clone(), lag.equation.right.to_string(), lag.constant))
        .collect();
    let of = |name: &str, input: &str, constant| (name.to_owned(), input.to_owned(), constant);
    assert_eq!(lags, [of("slow", "v", 0.5), of("lag1(slow, 2)", "slow", 2.0)]);
    assert_eq!(added(&closed, 7), [("lag1(slow, 2)".to_owned(), "lag1(lag1(/v, 0.5), 2)".to_owned())]);
    let error = model.closed(0.0, &[]).unwrap_err();
    assert!(matches!(&error, ClosedError::Delay { .. }) && error.to_string().contains("delay("), "{error}");
    assert_eq!(closed.model.closed(0.1, &[]).unwrap().lags, closed.lags);
}

#[test]
fn a_slope_of_a_filter_cannot_be_simulated() {
    let texts = ["s v = /v", "a slope = lag1_slope(/v, 0.5)", "a ahead = lag1(lead(/v, 1), 0.5)"];
    let closed = |function: &str| model(&texts, &[("v", "f")], &[function], &[]).closed(0.1, &[]);
    assert!(matches!(closed("slope"), Err(ClosedError::Filter { .. })));
    assert!(matches!(closed("ahead"), Err(ClosedError::Ahead { .. })));
    assert!(closed("v").is_ok());
}

#[test]
fn time_is_computed_and_labels_keep_their_columns() {
    let texts = ["s v = /v", "i ground = /ground", "a label = /ground", "a wave = sin(time())"];
    let mut model = model(&texts, &[("v", "f")], &["wave"], &["v", "label"]);
    model.partitions[0].rule = Rule::Labels {
        values: vec![0.0],
        names: vec!["a".into()],
        rules: vec![Rule::Whole],
        unseen: UnseenLabel::Refuse,
    };
    let closed = model.closed(0.1, &[]).unwrap();
    assert_eq!(library(&closed), ["sin(time())"]);
    assert_eq!(closed.model.partitions[0].columns, [parse("v"), parse("label")]);
}
