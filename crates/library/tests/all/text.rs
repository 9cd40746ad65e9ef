//! Parsing and printing.

use fleetfoot_library::{Expr, ParseError, ParseErrorKind, Program, Scope, Scratch};
use proptest::prelude::*;

use crate::strategy::expressions;

const NAMES: [&str; 16] = [
    "x",
    "q.w",
    "u[2]",
    "motor current (A)",
    "pi",
    "a`b",
    "",
    "/odom.twist.x",
    "/a/b-1[left]",
    "/a-",
    "sin",
    "2x",
    "φ_1",
    "/",
    "lag1(x, tau)",
    "delay(lag1(u[2], 1)^2, d)",
];

fn parse(text: &str) -> Result<Expr, ParseError> {
    let columns =
        ["x", "y", "vx", "vy", "yaw", "q.x", "q.y", "q.z", "q.w", "/a.x", "/b.y", "/a-b.x", "odd name", "u[0]"];
    Expr::parse(text, &Scope::new(columns))
}

fn value(text: &str) -> f64 {
    let column = |name: &str, lag: i32| match name {
        "x" => 2.0 - f64::from(lag),
        "y" => 5.0,
        "/a.x" => 7.0,
        "/b.y" => 11.0,
        "/a-b.x" => 13.0,
        "odd name" => 17.0,
        "u[0]" => 19.0,
        _ => panic!("{name}"),
    };
    parse(text).unwrap().value(column, |lag| 100.0 - 0.5 * f64::from(lag))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3000))]

    #[test]
    fn printed_text_reads_back_equal(expr in expressions(&NAMES)) {
        let text = expr.to_string();
        let back = Expr::parse(&text, &Scope::open());
        prop_assert_eq!(back.as_ref(), Ok(&expr), "{}", text);
        let columns: Vec<&str> = NAMES.into_iter().chain(["tau", "d"]).collect();
        prop_assert_eq!(Expr::parse(&text, &Scope::new(columns)), Ok(expr));
    }

    #[test]
    fn no_text_makes_the_parser_panic(text in r"([a-z/`.\[\]()+*^ ,-]|[0-9]|lag\(|lag1\(|delay\(|rotate\(|vec\(|yaw\(|quat\(|φ|e9|1\.|\.x){0,40}") {
        if let Err(error) = parse(&text) {
            prop_assert!(text.is_char_boundary(error.position()));
            prop_assert!(!error.to_string().is_empty());
        }
        if let Ok(expr) = Expr::parse(&text, &Scope::open()) {
            prop_assert_eq!(Expr::parse(&expr.to_string(), &Scope::open()), Ok(expr));
        }
    }
}

#[test]
fn operators_bind_as_in_mathematics() {
    for (text, wanted) in [
        ("1 + x*y", 11.0),
        ("-x^2", -4.0),
        ("(-x)^2", 4.0),
        ("2^3^2", 512.0),
        ("2**-x", 0.25),
        ("2^-x^2*3", 3.0 / 16.0),
        ("y - x - 1", 2.0),
        ("y/x/2", 1.25),
        ("- -x", 2.0),
        ("+x - -y", 7.0),
        ("2*-x", -4.0),
        ("1.5e1 + .5 + 1.", 16.5),
        ("x^0.5 - sqrt(x)", 0.0),
        ("min(x, y) + max(x, y) + atan2(0, 1) + pow(x, 3)", 15.0),
        ("sign(-y) + step(x) + abs(-3)", 3.0),
        ("wrap(3*pi/2) + pi/2", 0.0),
        ("`odd name` + u[0]", 36.0),
        ("x\n\t*\u{a0}y", 10.0),
    ] {
        assert_eq!(value(text), wanted, "{text}");
    }
}

#[test]
fn topic_fields_take_adjacent_characters() {
    for (text, wanted) in [
        ("/a.x - /b.y", -4.0),
        ("/a.x*/b.y", 77.0),
        ("/a.x / 2", 3.5),
        ("/a.x/ 2", 3.5),
        ("/a.x- 2", 5.0),
        ("(/a.x)/2", 3.5),
        ("22//b.y", 2.0),
        ("/a-b.x", 13.0),
        ("/a.x^2", 49.0),
    ] {
        assert_eq!(value(text), wanted, "{text}");
    }
    assert_eq!(parse("/a.x / 2").unwrap().to_string(), "/a.x / 2");
    assert_eq!(parse("y / 2").unwrap().to_string(), "y/2");
    let error = parse("/a.x-/b.y").unwrap_err();
    assert!(error.to_string().contains("need a space in front"), "{error}");
}

#[test]
fn lags_reach_the_leaves() {
    assert_eq!(
        parse("lag(x*time() + sin(lead(x, 3)), 2)").unwrap().to_string(),
        "lag(x, 2)*lag(time(), 2) + sin(lead(x, 1))"
    );
    assert_eq!(parse("lag(x, -1)"), parse("lead(x, 1)"));
    assert_eq!(parse("lag(lead(x, 2), 2)"), parse("x"));
    // x falls by one a row and the stamps by half a second.
    for difference in ["forward(x)", "backward(x)", "central(x)"] {
        assert_eq!(value(difference), 2.0, "{difference}");
    }
    // Their weights are quotients of stamps, which add up to one but for rounding.
    for difference in ["central4(x)", "central6(x)"] {
        assert!((value(difference) - 2.0).abs() < 1e-14, "{difference}");
    }
    assert_eq!(parse("central(y)"), parse("(lead(y, 1) - lag(y, 1))/(lead(time(), 1) - lag(time(), 1))"));
    assert_eq!(parse("forward(y)"), parse("(lead(y, 1) - y)/(lead(time(), 1) - time())"));
    for bad in ["lag(x)", "lag(x, 0.5)", "lag(x, y)", "lag(x, 1e9)", "lag(x, nan)", "lag(x, 1, 2)"] {
        assert!(matches!(parse(bad).unwrap_err().kind(), ParseErrorKind::Expected { .. }), "{bad}");
    }
}

#[test]
fn errors_name_the_place_and_the_remedy() {
    for (text, position, parts) in [
        ("vx*cso(yaw)", 3, &["unknown function `cso`", "`cos`", "character 4"][..]),
        ("vx*cos(yaq)", 7, &["unknown column or alias `yaq`", "`yaw`"]),
        ("vx*", 3, &["expected a number, a column, a function or `(`", "the end"]),
        ("(vx", 3, &["expected an operator or `)`", "the end"]),
        ("vx vy", 3, &["expected an operator or the end", "`v`"]),
        ("vx + )", 5, &["found `)`"]),
        ("sin(vx, vy)", 0, &["`sin` takes 1 argument", "has 2"]),
        ("atan2(vx)", 0, &["`atan2` takes 2 argument", "has 1"]),
        ("`vx", 0, &["closing backtick"]),
        ("2vx", 1, &["an operator or the end"]),
        ("1e+", 1, &["an operator or the end"]),
        (".", 0, &["a number"]),
        ("yaw(v)", 4, &["`v` has no components x, y, z, w"]),
        ("yaw", 0, &[]),
        ("rotate(q, vec(1, 2, 3))", 23, &["`.x`, `.y` or `.z`"]),
        ("rotate(q, vec(1, 2)).x", 10, &["`vec` takes 3"]),
        ("φ + vx", 0, &["unknown column or alias `φ`"]),
        ("", 0, &["the end"]),
    ] {
        match parse(text) {
            Ok(_) => assert_eq!(text, "yaw"),
            Err(error) => {
                assert_eq!(error.position(), position, "{error}");
                for part in parts {
                    assert!(error.to_string().contains(part), "{error}");
                }
            }
        }
    }
    let long = format!("{} + vq + {}", "vx + ".repeat(1000) + "vx", "vy*".repeat(1000) + "vy");
    let message = parse(&long).unwrap_err().to_string();
    assert!(message.len() < 250 && message.contains("character 5006") && message.contains("vq"), "{message}");
}

#[test]
fn aliases_use_each_other_in_any_order() {
    let mut scope = Scope::new([
        "/odom.x",
        "vx",
        "motor current (A)",
        "/imu.orientation.x",
        "/imu.orientation.y",
        "/imu.orientation.z",
        "/imu.orientation.w",
    ]);
    scope
        .define_all([
            ("speed", "sqrt(vx^2 + side^2)"),
            ("vx", "vx*0.01"),
            ("side", "/odom.x - i"),
            ("i", "motor current (A)"),
            ("att", "/imu.orientation"),
            ("heading", "yaw(att)"),
            ("qw", "att.w"),
        ])
        .unwrap();
    let resolved = |text| Expr::parse(text, &scope).unwrap().to_string();
    assert_eq!(resolved("speed"), "sqrt((vx*0.01)^2 + (/odom.x - `motor current (A)`)^2)");
    assert_eq!(
        scope.resolve("heading"),
        Expr::parse("yaw(/imu.orientation)", &scope).map_err(|error| error.kind().clone())
    );
    assert_eq!(resolved("qw"), "/imu.orientation.w");

    let before = scope.clone();
    let error = scope.define_all([("a", "b + 1"), ("b", "c"), ("c", "2*a")]).unwrap_err();
    assert!(matches!(error.kind(), ParseErrorKind::Circular { .. }), "{error}");
    let error = scope.define_all([("good", "vx"), ("bad", "vx + vq")]).unwrap_err();
    assert!(error.alias() == Some("bad") && error.to_string().contains("in the alias `bad`"), "{error}");
    assert_eq!(scope.resolve("good"), before.resolve("good"));
    // Its own name is a column, which must be there.
    assert!(scope.define_all([("new", "2*new")]).is_err());
}

#[test]
fn hostile_texts_are_errors() {
    let too_deep = |text: String| matches!(parse(&text).unwrap_err().kind(), ParseErrorKind::TooDeep);
    assert!(too_deep("(".repeat(100_000)));
    assert!(too_deep(format!("{}x{}", "(".repeat(100_000), ")".repeat(100_000))));
    assert!(too_deep("-".repeat(100_000) + "x"));
    assert!(too_deep("x^".repeat(100_000) + "x"));
    assert!(too_deep("sin(".repeat(100_000)));
    assert!(too_deep("rotate(q, ".repeat(50_000)));
    assert!(parse(&format!("{}x{}", "(".repeat(150), ")".repeat(150))).is_ok());
    assert_eq!(parse(&"x+".repeat(1_000_000)).unwrap_err().kind(), &ParseErrorKind::TooLarge);
    // Every alias doubles the one before: 2^64 terms in 64 lines.
    let mut scope = Scope::new(["a0"]);
    let doubling: Vec<_> = (1..=64).map(|i| (format!("a{i}"), format!("a{} + a{}", i - 1, i - 1))).collect();
    assert_eq!(scope.define_all(doubling).unwrap_err().kind(), &ParseErrorKind::TooLarge);
}

/// Everything that walks a tree does so without the call stack.
#[test]
fn long_chains_need_no_stack() {
    let work = || {
        let text = vec!["x"; 50_000].join(" + ");
        let scope = Scope::new(["x"]);
        let sum = Expr::parse(&text, &scope).unwrap();
        assert_eq!(sum.to_string(), text);
        assert_eq!(sum, Expr::parse(&text, &scope).unwrap());
        assert_eq!(sum.derivative("x").as_number(), Some(50_000.0));
        assert_eq!(sum.value(|_, _| 0.5, |_| 0.0), 25_000.0);
        assert_eq!(sum.shifted(1).columns().len(), 1);
        let program = Program::compile(&[sum], &["x"]).unwrap();
        let mut out = [0.0; 2];
        program.evaluate(&[&[0.5, 1.0]], 2, &mut out, 2, &mut Scratch::new());
        assert_eq!(out, [25_000.0, 50_000.0]);
        // Deep to the right, built by hand, and equal but not shared.
        let nest = || (0..200_000).fold(Expr::column("x"), |inner, _| (1.0 + inner).sin());
        let (a, b) = (nest(), nest());
        assert_eq!(a, b);
        assert!(a.derivative("x").size() > a.size());
        // Shared parts count once for the time that anything takes.
        let doubled = |name| (0..200).fold(Expr::column(name), |inner, _| &inner * &inner + &inner);
        assert_eq!(doubled("x"), doubled("x"));
        assert!(doubled("x") != doubled("y"));
        assert!(Program::compile(&[doubled("x").derivative("x")], &["x"]).is_ok());
        // As deep as the grammar allows, in the costliest way.
        let parse = |n: usize| Expr::parse(&format!("{}x{}", "-min(1, ".repeat(n), ")".repeat(n)), &scope);
        assert!(parse(99).is_ok() && parse(101).is_err());
    };
    std::thread::Builder::new().stack_size(512 * 1024).spawn(work).unwrap().join().unwrap();
}
