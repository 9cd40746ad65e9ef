use proptest::prelude::*;

use super::*;
use crate::{Expr, Scope, coefficient_unit};

fn unit(text: &str) -> Unit {
    Unit::parse(text).unwrap()
}

#[test]
fn names_have_the_sizes_of_the_si() {
    for (text, same) in [
        ("N", "kg*m/s^2"),
        ("V*A", "W"),
        ("J", "N m"),
        ("ohm", "V/A"),
        ("T", "Wb/m²"),
        ("F*V", "C"),
        ("H", "V s/A"),
        ("Hz", "1/s"),
        ("m/s/s", "m*s^-2"),
        ("m·s⁻²", "m/s^2"),
        ("kg/(m*s)", "kg/m/s"),
        ("Pa^0.5", "Pa^(1/2)"),
        ("rad", ""),
        ("-", "1"),
        ("rad/s", "1/s"),
    ] {
        assert_eq!(unit(text), unit(same), "{text}");
    }
    for (text, scale, of) in [
        ("km", 1e3, "m"),
        ("mm^2", 1e-6, "m^2"),
        ("deg/s", 0.017453292519943295, "rad/s"),
        ("RPM", 0.10471975511965977, "rad/s"),
        ("km/h", 1.0 / 3.6, "m/s"),
        ("%", 0.01, "1"),
        ("mAh", 3.6, "C"),
        ("µs", 1e-6, "s"),
        ("min", 60.0, "s"),
        ("cd", 1.0, "cd"),
        ("dam", 10.0, "m"),
        ("g", 1e-3, "kg"),
        ("L", 1e-3, "m^3"),
    ] {
        let (unit, of) = (unit(text), unit(of));
        assert!(unit.same_dimension(&of), "{text}");
        assert!((unit.scale() / of.scale() - scale).abs() <= 1e-12 * scale, "{text}: {}", unit.scale());
    }
    assert_ne!(unit("m"), unit("mm"));
    assert_ne!(unit("N"), unit("J"));
}

#[test]
fn invalid_units_are_refused_with_reason() {
    for (text, part) in [
        ("furlong", "unknown unit `furlong`"),
        ("m/sekunde", "`sekunde`"),
        ("rmp", "`rpm`?"),
        ("m/", "character 3: expected a unit"),
        ("m^x", "a number"),
        ("(m", "`)`"),
        ("m^0.07", "multiple of 1/12"),
        ("m)", "or the end"),
        ("2*m", "a unit"),
        ("m^(1/0)", "multiple of 1/12"),
    ] {
        let message = Unit::parse(text).unwrap_err().to_string();
        assert!(message.contains(part), "{text}: {message}");
    }
    assert!(Unit::parse(&"(".repeat(100_000)).is_err());
}

fn of(text: &str) -> Result<Option<String>, UnitError> {
    let column = |name: &str| match name {
        "x" | "y" => Some(unit("m")),
        "v" => Some(unit("m/s")),
        "mass" => Some(unit("kg")),
        "T" => Some(unit("N")),
        "yaw" => Some(unit("rad")),
        "tilt" => Some(unit("deg")),
        "mm" => Some(unit("mm")),
        _ => None,
    };
    let expr = Expr::parse(text, &Scope::open()).unwrap();
    expr.unit(column).map(|result| result.map(|unit| unit.to_string()))
}

#[test]
fn expressions_have_the_units_that_follow() {
    for (text, wanted) in [
        ("T/mass - 9.81", Some("N/kg")),
        ("v^2*x", Some("m^3/s^2")),
        ("sqrt(x*y)", Some("m")),
        ("sqrt(v)", Some("m^(1/2)/s^(1/2)")),
        ("x^1.5", Some("m^(3/2)")),
        ("x/v", Some("s")),
        ("x/time() + v", Some("m/s")),
        ("central(x)", Some("m/s")),
        ("lag(x, 3) + lag1(x, tau)", Some("m")),
        ("lag1_slope(x, tau)", Some("m/s")),
        ("sin(yaw)*x", Some("m")),
        ("atan2(x, y) + yaw", Some("rad")),
        ("sin(x/y)", Some("1")),
        ("abs(x) + max(y, 2)", Some("m")),
        ("sign(v)*T", Some("N")),
        ("2*pi", Some("1")),
        ("1/v", Some("s/m")),
        ("x*q", None),
        ("x + q", Some("m")),
        ("sin(q)", Some("1")),
        ("x*T/(v*mass)", Some("N*s/kg")),
    ] {
        assert_eq!(of(text), Ok(wanted.map(str::to_owned)), "{text}");
    }
    for (text, part) in [
        ("x + v", "`x + v` joins `m` with `m/s`"),
        ("x - mm", "joins `m` with `mm`"),
        ("min(x, mass)", "joins"),
        ("atan2(x, v)", "joins"),
        ("3*sin(x)", "`sin(x)` takes a number without a unit"),
        ("cos(tilt)", "here it has `deg`"),
        ("exp(v) + q", "here it has `m/s`"),
        ("x^y", "cannot be raised"),
        ("x^0.3", "cannot be raised"),
        ("x^q", "cannot be raised"),
        ("q + sin(x + v)", "joins"),
    ] {
        let message = of(text).unwrap_err().to_string();
        assert!(message.contains(part), "{text}: {message}");
    }
}

#[test]
fn coefficient_units_are_target_over_function() {
    let column = |name: &str| (name == "v").then(|| unit("m/s"));
    let names = [Expr::column("v")];
    let vocabulary = crate::Vocabulary { variables: &names, scope: &Scope::open() };
    let terms = crate::Terms::parse(&["poly(2)", "v*q"], &vocabulary).unwrap();
    let units = terms.coefficient_units(Some(&unit("m/s^2")), column).unwrap();
    let printed: Vec<Option<String>> = units.iter().map(|unit| unit.as_ref().map(Unit::to_string)).collect();
    assert_eq!(printed, [Some("1/s".to_owned()), Some("1/m".to_owned()), None]);
    let wrong = Expr::parse("v + sin(v)", &Scope::open()).unwrap();
    assert!(coefficient_unit(None, &wrong, column).is_err());
}

proptest! {
    #[test]
    fn printed_text_reads_back_equal(
        parts in prop::collection::vec((prop::sample::select(vec!["m", "kg", "s", "mA", "deg", "N", "rpm", "%"]), -24i32..25), 0..5)
    ) {
        let product = parts.iter().fold(Unit::one(), |product, (name, twelfths)| {
            product.times(&unit(name).power(f64::from(*twelfths) / 12.0).unwrap())
        });
        prop_assert_eq!(unit(&product.to_string()), product.clone(), "{}", product);
        prop_assert!(product.per(&product).is_one());
        prop_assert_eq!(product.power(2.0).unwrap(), product.times(&product));
        prop_assert_eq!(product.power(-1.0).unwrap(), Unit::one().per(&product));
    }

    #[test]
    fn no_text_makes_the_parser_panic(text in r"[a-zA-Zµ°Ω%·²⁻0-9/*^()., -]{0,20}") {
        if let Err(error) = Unit::parse(&text) {
            prop_assert!(!error.to_string().is_empty());
        }
    }
}
