use proptest::prelude::*;

use super::*;

fn columns(names: &[&str]) -> Vec<Expr> {
    names.iter().map(|&name| Expr::column(name)).collect()
}

fn over(names: &[&str], items: &[&str]) -> Result<Terms, TermsError> {
    let variables = columns(names);
    Terms::parse(items, &Vocabulary { variables: &variables, scope: &Scope::open() })
}

/// The printed candidates, the constant first.
fn printed(names: &[&str], items: &[&str]) -> Vec<String> {
    over(names, items).unwrap().with_constant().iter().map(Expr::to_string).collect()
}

#[test]
fn libraries_have_the_functions_of_their_names() {
    let xy = ["x", "y"];
    for (items, wanted) in [
        (&["poly(2)"][..], "1, x, y, x^2, x*y, y^2"),
        (&["poly(2, bias=false)"], "x, y, x^2, x*y, y^2"),
        (&["poly(2, [y])"], "1, y, y^2"),
        (&["poly(2, y, bias = false)"], "y, y^2"),
        (&["poly(0)"], "1"),
        (&["poly(1, [x - y, z])"], "1, x - y, z"),
        (&["interactions(2)"], "1, x, y, x*y"),
        (&["interactions(3, [x, y, z], bias=false)"], "x, y, z, x*y, x*z, y*z, x*y*z"),
        (&["fourier(2)"], "sin(x), cos(x), sin(y), cos(y), sin(2*x), cos(2*x), sin(2*y), cos(2*y)"),
        (&["sin"], "sin(x), sin(y)"),
        (&["abs([x, x - y])"], "abs(x), abs(x - y)"),
        (&["sign"], "sign(x), sign(y)"),
        (&["identity", "tanh(y)"], "x, y, tanh(y)"),
        (&["past(3)"], "x, y, lag(x, 1), lag(y, 1), lag(x, 2), lag(y, 2)"),
        (&["past(5, every=2, [u])"], "u, lag(u, 2), lag(u, 4)"),
        (&["lags(2)"], "lag(x, 1), lag(y, 1), lag(x, 2), lag(y, 2)"),
        (&["lags(5, u, every=2)"], "lag(u, 2), lag(u, 4)"),
        (&["lags(1, every=2)"], ""),
        (&["lags(1, sin)"], "sin(lag(x, 1)), sin(lag(y, 1))"),
        (&["poly(2, past(3, every=2, [u]), bias=false)"], "u, lag(u, 2), u^2, u*lag(u, 2), lag(u, 2)^2"),
        (&["poly(1)*fourier(1, [z])"], "sin(z), cos(z), x*sin(z), x*cos(z), y*sin(z), y*cos(z)"),
        (&["poly(1) + abs"], "1, x, y, abs(x), abs(y)"),
        (&["abs + poly(1)", "x*y"], "1, abs(x), abs(y), x, y, x*y"),
        (&["(identity + sin([z]))*V^2"], "x*V^2, y*V^2, sin(z)*V^2"),
        (&["poly(1)/V"], "1/V, x/V, y/V"),
        (&["x/y*(identity + 1)"], "x, x/y, x^2/y"),
        (&["poly(1, [x]) + x*y + z"], "1, x, x*y, z"),
        (&["poly(1, [x]) + (x*y + z)"], "1, x, x*y + z"),
        (&["V^2*alpha"], "V^2*alpha"),
        (&["1"], "1"),
        (&["1 + x"], "1 + x"),
        (&["-x"], "-x"),
        (&["`sin`*x"], "`sin`*x"),
    ] {
        assert_eq!(printed(&xy, items).join(", "), wanted, "{items:?}");
    }
}

#[test]
fn angles_enter_as_cosine_and_sine() {
    let yaw = Expr::column("yaw");
    let variables = [yaw.cos(), yaw.sin(), Expr::column("v")];
    let vocabulary = Vocabulary { variables: &variables, scope: &Scope::open() };
    let text = |items: &[&str]| {
        let terms = Terms::parse(items, &vocabulary).unwrap();
        terms.functions.iter().map(Expr::to_string).collect::<Vec<_>>().join(", ")
    };
    assert_eq!(text(&["fourier(1)"]), "sin(yaw), cos(yaw), sin(v), cos(v)");
    assert_eq!(text(&["sin"]), "sin(yaw), sin(v)");
    assert_eq!(text(&["poly(2, [cos(yaw)]) + identity"]), "cos(yaw), cos(yaw)^2, sin(yaw), v");
}

#[test]
fn equal_functions_stand_once() {
    let xy = ["x", "y"];
    for (items, wanted) in [
        (&["x*y", "y*x", "2*y*x", "x/(1/y)", "-(x*y)"][..], "x*y"),
        (&["sin(x + y)", "sin(y + x)", "sin(x - -y)"], "sin(x + y)"),
        (&["x^3", "x^2*x"], "x^3"),
        (&["sin(x)*sin(x)", "sin(x)^2", "sin*sin([x])"], "sin(x)^2, sin(x)*sin(y)"),
        (&["poly(2)", "x^2", "y*x", "3"], "1, x, y, x^2, x*y, y^2"),
        (&["min(x, y)", "min(y, x)", "min(x, y + 0)"], "min(x, y)"),
        (&["abs(x*(y + 1))", "abs((1 + y)*x)"], "abs(x*(y + 1))"),
        (&["x - x + y"], "y"),
    ] {
        assert_eq!(printed(&xy, items).join(", "), wanted, "{items:?}");
    }
}

#[test]
fn errors_name_the_place_and_the_remedy() {
    for (item, position, part) in [
        ("ploy(3)", 0, "did you mean `poly`"),
        ("poly(3) + fourir(2)", 10, "`fourier`"),
        ("poly", 0, "unknown column or alias `poly`"),
        ("poly(x)", 5, "a degree"),
        ("poly(2.5)", 5, "a degree"),
        ("poly(300)", 5, "a degree"),
        ("poly(2, every=3)", 8, "`bias=false`"),
        ("past(2, bias=false)", 8, "`every=k`"),
        ("fourier(0)", 8, "a number of frequencies"),
        ("poly(2, [x, q])", 12, "unknown column or alias `q`"),
        ("poly(2, [])", 9, "found `]`"),
        ("poly(2, x, y)", 11, "stand in brackets"),
        ("poly(2", 6, "`,` or `)`"),
        ("poly(2) - x", 8, "no differences"),
        ("poly(2)^2", 7, "powers"),
        ("x/poly(1)", 1, "quotients"),
        ("-poly(1)", 0, "without a sign"),
        ("sin(x, y)", 0, "`sin` takes 1 argument"),
        ("x - x", 0, "0 everywhere"),
        ("0/0*x", 0, "everywhere"),
        ("poly(2) x", 8, "an operator or the end"),
        ("poly(2)*", 8, "found the end"),
        ("", 0, "found the end"),
        ("poly(40)*poly(3)*poly(200, [x])", 0, ""),
    ] {
        let scope = Scope::new(["x", "y"]);
        let variables = columns(&["x", "y"]);
        let vocabulary = Vocabulary { variables: &variables, scope: &scope };
        let error = Terms::parse(&[item], &vocabulary);
        if part.is_empty() {
            assert!(error.is_ok(), "{error:?}");
            continue;
        }
        let error = error.unwrap_err();
        let TermsError::Item(inner) = &error else { panic!("{error}") };
        assert!(inner.position() == position && error.to_string().contains(part), "{item}: {error}");
    }
    let error = over(&[], &["poly(2)"]).unwrap_err();
    assert!(error.to_string().contains("no variables"), "{error}");
}

#[test]
fn full_polynomials_are_recognised_in_any_form() {
    let variables = [Expr::column("x"), Expr::lagged("y", 1), Expr::column("z").sin()];
    for degree in 2..5 {
        let functions = crate::Library::polynomial(&variables, degree).unwrap().functions().to_vec();
        let library = PolynomialLibrary::of(&functions).unwrap();
        assert_eq!((library.variables.as_slice(), library.degree), (&variables[..], degree as usize));
        for (function, exponents) in functions.iter().zip(&library.exponents) {
            let powers = variables.iter().zip(exponents).filter(|(_, k)| **k > 0);
            let product = powers.map(|(x, &k)| x.powi(i32::from(k))).reduce(|a, b| a * b).unwrap();
            assert_eq!(*function, product);
        }
        let mut fewer = functions.clone();
        let last = fewer.pop().unwrap();
        assert_eq!(PolynomialLibrary::of(&fewer), None);
        for other in
            [2.0 * &last, last.sin(), &functions[0] + 0.5, functions[0].clone(), 1.0 / last.clone(), Expr::number(1.0)]
        {
            let changed: Vec<Expr> = fewer.iter().cloned().chain([other]).collect();
            assert_eq!(PolynomialLibrary::of(&changed), None, "{changed:?}");
        }
    }
    let parsed = over(&["x", "y"], &["poly(3)"]).unwrap().as_polynomial().unwrap();
    assert_eq!((parsed.degree, parsed.exponents.len()), (3, 9));
    let written = over(&["x", "y"], &["y*(x*y)", "y^3", "x", "x*(x*x)", "y*y", "x*y", "y", "x*(x*y)", "x^2"]).unwrap();
    assert_eq!(written.as_polynomial().map(|library| library.degree), Some(3));
    assert_eq!(over(&["x", "y"], &["poly(2) + sin"]).unwrap().as_polynomial(), None);
    assert_eq!(PolynomialLibrary::of(&[]), None);
}

/// n over k.
fn binomial(n: usize, k: usize) -> usize {
    (0..k.min(n)).fold(1, |product, i| product * (n - i) / (i + 1)) * usize::from(k <= n)
}

fn names(n: usize) -> Vec<String> {
    (0..n).map(|i| format!("x{i}")).collect()
}

fn size(n: usize, item: &str) -> usize {
    let names = names(n);
    let terms = over(&names.iter().map(String::as_str).collect::<Vec<_>>(), &[item]).unwrap();
    terms.functions.len() + usize::from(terms.constant)
}

#[test]
fn sizes_match_closed_forms() {
    for (n, d) in [(1, 6), (2, 4), (3, 5), (5, 3), (16, 3)] {
        let all = binomial(n + d, d);
        assert_eq!(size(n, &format!("poly({d})")), all);
        assert_eq!(size(n, &format!("interactions({d})")), (0..=d).map(|k| binomial(n, k)).sum::<usize>());
        assert_eq!(size(n, &format!("fourier({d})")), 2 * n * d);
        // No product of a monomial and a wave is another's.
        assert_eq!(size(n, &format!("poly({d})*fourier(1)")), all * 2 * n);
        assert_eq!(size(n, &format!("poly({d}) + fourier(1)")), all + 2 * n);
        // Products of polynomials are those of the summed degree.
        assert_eq!(size(n, &format!("poly(1)*poly({})", d - 1)), all);
        let (rows, every) = (2 * d, 3usize);
        assert_eq!(size(n, &format!("past({rows}, every={every})")), n * rows.div_ceil(every));
        assert_eq!(size(n, &format!("lags({rows}, every={every})")), n * (rows / every));
        let past = n * d.div_ceil(2);
        assert_eq!(size(n, &format!("poly(2, past({d}, every=2))")), binomial(past + 2, 2));
    }
}

#[test]
fn sizes_beyond_reason_are_refused_with_their_number() {
    let many = names(200);
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    for (item, part) in [
        ("poly(3)", &(binomial(203, 3) - 1).to_string()),
        ("poly(255)", &"more than 2^64".to_owned()),
        ("past(1000000)", &"200000000".to_owned()),
        ("fourier(1000)", &"400000".to_owned()),
        ("poly(2)*poly(2)", &(binomial(202, 2) * binomial(202, 2)).to_string()),
        ("interactions(3)*sin", &"at most 100000".to_owned()),
    ] {
        let message = over(&many, &[item]).unwrap_err().to_string();
        assert!(message.contains(part.as_str()), "{item}: {message}");
    }
    let items = ["poly(2)", "past(300)", "lags(700, every=2)"];
    let error = over(&many, &items).unwrap_err();
    assert!(matches!(error, TermsError::TooLarge { functions } if functions > crate::MAX_FUNCTIONS), "{error}");
}

#[test]
fn parsed_polynomial_costs_one_multiplication_each() {
    let terms = over(&["x", "y", "z"], &["poly(5, bias=false)"]).unwrap();
    assert_eq!(terms.functions, crate::Library::polynomial(&columns(&["x", "y", "z"]), 5).unwrap().functions());
    let program = crate::Program::compile(&terms.functions, &["x", "y", "z"]).unwrap();
    assert_eq!(program.instructions(), terms.functions.len());
}

/// The functions without their order, the order of their factors and the number in front.
fn keys(terms: &Terms) -> std::collections::BTreeSet<String> {
    let key = |function: &Expr| {
        let mut powers = crate::simplify::Monomial::of(&function.canonical()).powers;
        powers.sort_by_key(|(base, _)| base.to_string());
        crate::simplify::Monomial::new(1.0, powers).expr().to_string()
    };
    terms.functions.iter().map(key).collect()
}

/// Libraries and expressions, as texts.
fn items() -> impl Strategy<Value = String> {
    let atom = prop::sample::select(vec![
        "poly(2)",
        "poly(1, bias=false)",
        "fourier(1)",
        "interactions(2)",
        "sin",
        "abs([x, y - x])",
        "past(3, every=2)",
        "lags(1, [u])",
        "x",
        "x*y",
        "u^2",
        "cos(x + 2*y)",
        "1",
        "(x - 2)",
    ]);
    atom.prop_map(str::to_owned).prop_recursive(3, 6, 2, |inner| {
        (inner.clone(), prop::sample::select(vec!["*", " + "]), inner)
            .prop_map(|(a, joint, b)| format!("({a}){joint}({b})"))
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn candidates_are_distinct_and_the_same_in_any_order(a in items(), b in items()) {
        let set = |items: &[&str]| over(&["x", "y"], items).unwrap();
        let (forth, back) = (set(&[&a, &b]), set(&[&b, &a]));
        prop_assert_eq!(keys(&forth).len(), forth.functions.len());
        prop_assert_eq!(keys(&forth), keys(&back));
        prop_assert_eq!(set(&[&a, &a]), set(&[&a]));
        let libraries = format!("({a} + poly(0))*({b} + poly(0))");
        let turned = format!("({b} + poly(0))*({a} + poly(0))");
        prop_assert_eq!(keys(&set(&[&libraries])), keys(&set(&[&turned])));
    }

    #[test]
    fn printed_candidates_read_back_equal(item in items()) {
        let terms = over(&["x", "y"], &[&item]).unwrap();
        let texts: Vec<String> = terms.with_constant().iter().map(Expr::to_string).collect();
        let texts: Vec<&str> = texts.iter().map(String::as_str).collect();
        prop_assert_eq!(over(&["x", "y"], &texts).unwrap(), terms);
    }

    #[test]
    fn variables_in_another_order_give_the_same_candidates(item in items()) {
        prop_assert_eq!(keys(&over(&["x", "y"], &[&item]).unwrap()), keys(&over(&["y", "x"], &[&item]).unwrap()));
    }

    #[test]
    fn derivatives_agree_with_differences(item in items(), x in 0.2..1.7f64, y in -1.5..-0.2f64) {
        let terms = over(&["x", "y"], &[&item]).unwrap();
        for function in &terms.functions {
            let at = |x: f64, y: f64| function.value(|name, lag| match (name, lag) {
                ("x", 0) => x,
                ("y", 0) => y,
                ("x", _) => 0.4,
                ("y", _) => -0.7,
                _ => 0.6,
            }, |_| 0.0);
            let h = 1e-5;
            for (name, difference) in [("x", (at(x + h, y) - at(x - h, y)) / (2.0 * h)), ("y", (at(x, y + h) - at(x, y - h)) / (2.0 * h))] {
                let exact = function.derivative(name).value(|name, lag| match (name, lag) {
                    ("x", 0) => x,
                    ("y", 0) => y,
                    ("x", _) => 0.4,
                    ("y", _) => -0.7,
                    _ => 0.6,
                }, |_| 0.0);
                // Third derivatives of products of a few factors of size one, times h^2, and rounding over h.
                prop_assert!((exact - difference).abs() < 1e-6 * (1.0 + exact.abs()), "d/d{name} {function}: {exact} {difference}");
            }
        }
    }

    #[test]
    fn item_without_library_is_an_expression(text in r"(-?(x|y|2|sin\(x\)|\(x \+ y\)|abs\(-y\))(\^2)?[-+*/]){0,4}x") {
        let scope = Scope::new(["x", "y"]);
        let vocabulary = Vocabulary { variables: &columns(&["x", "y"]), scope: &scope };
        let wanted = Expr::parse(&text, &scope).unwrap().simplified();
        match Terms::parse(&[&text], &vocabulary) {
            Ok(terms) if terms.constant => prop_assert!(wanted.as_number().is_some_and(|value| value != 0.0), "{}", text),
            Ok(terms) => prop_assert_eq!(terms.functions, vec![wanted]),
            Err(error) => prop_assert!(wanted.as_number().is_some(), "{}", error),
        }
    }

    #[test]
    fn no_text_makes_the_parser_panic(text in r"(poly\(|fourier\(|past\(|every=|bias=|sin|abs|[\[\](),*/+^=-]|x|y|2|1| ){0,16}") {
        let scope = Scope::new(["x", "y"]);
        let vocabulary = Vocabulary { variables: &columns(&["x", "y"]), scope: &scope };
        if let Err(TermsError::Item(error)) = Terms::parse(&[&text], &vocabulary) {
            prop_assert!(text.is_char_boundary(error.position()) && !error.to_string().is_empty());
        }
    }
}

#[test]
fn hostile_texts_are_errors() {
    for text in [
        "(".repeat(100_000),
        "-".repeat(100_000),
        "abs(".repeat(100_000),
        "poly(1, ".repeat(100_000),
        "poly(1, [".repeat(50_000),
    ] {
        assert!(over(&["x"], &[&text]).is_err());
    }
    let long = vec!["poly(2)"; 20_000].join("*x + ");
    assert!(over(&["x"], &[&long]).is_ok());
}
