//! Names of units: the SI Brochure (9th edition, tables 2, 4, 7 and 8) and further units from logs of machines.

use std::f64::consts::PI;

/// Exponents of m, kg, s, A, K, mol, cd, in twelfths.
pub(super) type Dimension = [i32; 7];

/// A name, its size in coherent units of the SI, the exponents of m, kg, s, A, K, mol, cd, and whether it takes prefixes.
type Symbol = (&'static str, f64, [i32; 7], bool);

const NONE: [i32; 7] = [0; 7];
const SPEED: [i32; 7] = [1, 0, -1, 0, 0, 0, 0];
const PRESSURE: [i32; 7] = [-1, 1, -2, 0, 0, 0, 0];
const ENERGY: [i32; 7] = [2, 1, -2, 0, 0, 0, 0];

const fn base(at: usize) -> [i32; 7] {
    let mut dimension = NONE;
    dimension[at] = 1;
    dimension
}

const SYMBOLS: [Symbol; 57] = [
    ("m", 1.0, base(0), true),
    ("g", 1e-3, base(1), true),
    ("s", 1.0, base(2), true),
    ("A", 1.0, base(3), true),
    ("K", 1.0, base(4), true),
    ("mol", 1.0, base(5), true),
    ("cd", 1.0, base(6), true),
    ("rad", 1.0, NONE, true),
    ("sr", 1.0, NONE, false),
    ("Hz", 1.0, [0, 0, -1, 0, 0, 0, 0], true),
    ("N", 1.0, [1, 1, -2, 0, 0, 0, 0], true),
    ("Pa", 1.0, PRESSURE, true),
    ("J", 1.0, ENERGY, true),
    ("W", 1.0, [2, 1, -3, 0, 0, 0, 0], true),
    ("C", 1.0, [0, 0, 1, 1, 0, 0, 0], true),
    ("V", 1.0, [2, 1, -3, -1, 0, 0, 0], true),
    ("F", 1.0, [-2, -1, 4, 2, 0, 0, 0], true),
    ("ohm", 1.0, [2, 1, -3, -2, 0, 0, 0], true),
    ("Ohm", 1.0, [2, 1, -3, -2, 0, 0, 0], true),
    ("Ω", 1.0, [2, 1, -3, -2, 0, 0, 0], true),
    ("S", 1.0, [-2, -1, 3, 2, 0, 0, 0], true),
    ("Wb", 1.0, [2, 1, -2, -1, 0, 0, 0], true),
    ("T", 1.0, [0, 1, -2, -1, 0, 0, 0], true),
    ("H", 1.0, [2, 1, -2, -2, 0, 0, 0], true),
    ("lm", 1.0, base(6), true),
    ("lx", 1.0, [-2, 0, 0, 0, 0, 0, 1], true),
    ("degC", 1.0, base(4), false),
    ("°C", 1.0, base(4), false),
    ("deg", PI / 180.0, NONE, false),
    ("°", PI / 180.0, NONE, false),
    ("rev", 2.0 * PI, NONE, false),
    ("rpm", PI / 30.0, [0, 0, -1, 0, 0, 0, 0], false),
    ("RPM", PI / 30.0, [0, 0, -1, 0, 0, 0, 0], false),
    ("%", 0.01, NONE, false),
    ("percent", 0.01, NONE, false),
    ("ppm", 1e-6, NONE, false),
    ("min", 60.0, base(2), false),
    ("h", 3600.0, base(2), false),
    ("hr", 3600.0, base(2), false),
    ("day", 86400.0, base(2), false),
    ("sec", 1.0, base(2), false),
    ("Ah", 3600.0, [0, 0, 1, 1, 0, 0, 0], true),
    ("Wh", 3600.0, ENERGY, true),
    ("L", 1e-3, [3, 0, 0, 0, 0, 0, 0], true),
    ("l", 1e-3, [3, 0, 0, 0, 0, 0, 0], true),
    ("t", 1e3, base(1), false),
    ("bar", 1e5, PRESSURE, true),
    ("atm", 101_325.0, PRESSURE, false),
    ("psi", 6_894.757_293_168, PRESSURE, false),
    ("eV", 1.602_176_634e-19, ENERGY, true),
    ("Gs", 1e-4, [0, 1, -2, -1, 0, 0, 0], true),
    ("g0", 9.806_65, [1, 0, -2, 0, 0, 0, 0], false),
    ("in", 0.0254, base(0), false),
    ("ft", 0.3048, base(0), false),
    ("mi", 1_609.344, base(0), false),
    ("mph", 0.447_04, SPEED, false),
    ("kn", 1852.0 / 3600.0, SPEED, false),
];

const PREFIXES: [(&str, f64); 15] = [
    ("f", 1e-15),
    ("p", 1e-12),
    ("n", 1e-9),
    ("u", 1e-6),
    ("µ", 1e-6),
    ("μ", 1e-6),
    ("m", 1e-3),
    ("c", 1e-2),
    ("d", 1e-1),
    ("da", 1e1),
    ("h", 1e2),
    ("k", 1e3),
    ("M", 1e6),
    ("G", 1e9),
    ("T", 1e12),
];

/// The size and the dimension of a name, first as it stands, then with a prefix.
pub(super) fn find(name: &str) -> Option<(f64, Dimension)> {
    let whole = |exponents: [i32; 7]| exponents.map(|exponent| exponent * super::WHOLE);
    if let Some(&(_, scale, exponents, _)) = SYMBOLS.iter().find(|symbol| symbol.0 == name) {
        return Some((scale, whole(exponents)));
    }
    PREFIXES.iter().find_map(|(prefix, factor)| {
        let rest = name.strip_prefix(prefix)?;
        let &(_, scale, exponents, _) = SYMBOLS.iter().find(|symbol| symbol.3 && symbol.0 == rest)?;
        Some((factor * scale, whole(exponents)))
    })
}

pub(super) fn names() -> impl Iterator<Item = &'static str> {
    SYMBOLS.iter().map(|symbol| symbol.0)
}
