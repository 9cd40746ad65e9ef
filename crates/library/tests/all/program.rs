//! Programs against plain recursion, bit for bit.

use fleetfoot_data::{Column, Halo, MemorySource, ScalarBuffer, Source};
use fleetfoot_library::{
    Expr, Leaf, Library, Program, Scope, Scratch, backward_difference, central_difference, forward_difference,
};
use proptest::prelude::*;

use crate::strategy::{expressions, naive, same};

const NAMES: [&str; 3] = ["x", "y", "z"];

/// An episode of uneven stamps with a few missing values.
fn recording(rows: usize) -> MemorySource {
    let mut source = MemorySource::new(NAMES.iter().map(|&name| Column::float(name)).collect());
    let stamps: Vec<i64> = (0..rows as i64).map(|row| 5_000_000_000 + row * 2_000_000 + row * row % 7 * 1000).collect();
    let column = |phase: f64| -> ScalarBuffer<f64> {
        (0..rows)
            .map(|row| if row % 97 == 13 { f64::NAN } else { 3.0 * (phase * (row as f64 + 0.3)).sin() })
            .collect::<Vec<_>>()
            .into()
    };
    source.push("run", stamps.into(), vec![column(0.37), column(1.1), column(0.011)]);
    source
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn programs_equal_plain_recursion(
        exprs in prop::collection::vec(expressions(&NAMES), 1..6),
        repeated in any::<bool>(),
        cut in 1usize..40,
        core in 20usize..80,
    ) {
        let mut exprs = exprs;
        if repeated {
            let first = exprs[0].clone();
            exprs.extend([first.clone(), &first + &first, Expr::column("z"), Expr::number(0.1)]);
        }
        let source = recording(700);
        let program = Program::compile(&exprs, &NAMES).unwrap();
        let block = source.read(0, core..680, program.halo()).unwrap();
        let rows = program.valid_rows(&block);
        prop_assert_eq!(rows.clone(), 0..block.rows);
        let whole = source.read(0, 0..700, Halo::default()).unwrap();
        let seconds = whole.seconds();
        let (n, mut scratch) = (rows.len(), Scratch::new());
        let mut out = vec![0.0; n * exprs.len()];
        program.evaluate_block(&block, rows, &mut out, n, &mut scratch);
        let mut single = vec![0.0; exprs.len()];
        for row in 0..n {
            let at = |lag: i32| (core + row).wrapping_add_signed(-(lag as isize));
            let column = |name: &str, lag: i32| {
                whole.column(NAMES.iter().position(|&known| known == name).unwrap())[at(lag)]
            };
            let time = |lag: i32| seconds[at(lag)];
            let leaves: Vec<f64> = program
                .leaves()
                .iter()
                .map(|leaf| match *leaf {
                    Leaf::Column { column: c, lag } => column(NAMES[c], lag),
                    Leaf::Time { lag } => time(lag),
                })
                .collect();
            program.evaluate_row(&leaves, &mut single, &mut scratch);
            for (j, expr) in exprs.iter().enumerate() {
                let wanted = naive(expr, &column, &time);
                prop_assert!(same(out[j * n + row], wanted), "{}: {} not {}", expr, out[j * n + row], wanted);
                prop_assert!(same(single[j], wanted), "{}: {} not {} in one row", expr, single[j], wanted);
                prop_assert!(same(expr.value(column, time), wanted));
            }
        }
        // Any range of rows, with room between the outputs.
        let mut part = vec![-1.0; exprs.len() * (cut + 3)];
        for first in (0..n).step_by(cut) {
            let last = (first + cut).min(n);
            program.evaluate_block(&block, first..last, &mut part, cut + 3, &mut scratch);
            for j in 0..exprs.len() {
                for row in first..last {
                    prop_assert!(same(part[j * (cut + 3) + row - first], out[j * n + row]));
                }
                prop_assert!(part[j * (cut + 3) + last - first..][..3].iter().all(|&gap| last - first < cut || gap == -1.0));
            }
        }
    }

    #[test]
    fn a_shift_moves_the_row(expr in expressions(&NAMES), lag in -5i32..6, row in 20usize..60) {
        let whole = recording(80).read(0, 0..80, Halo::default()).unwrap();
        let seconds = whole.seconds();
        let at = |row: usize, expr: &Expr| {
            let index = |lag: i32| row.wrapping_add_signed(-(lag as isize));
            let column = |name: &str, lag: i32| whole.column(NAMES.iter().position(|&n| n == name).unwrap())[index(lag)];
            naive(expr, &column, &|lag| seconds[index(lag)])
        };
        let shifted = expr.shifted(lag);
        prop_assert!(same(at(row, &shifted), at(row.wrapping_add_signed(-(lag as isize)), &expr)));
        prop_assert_eq!(shifted.shifted(-lag), expr);
    }
}

#[test]
fn a_lag_never_crosses_the_border_of_an_episode() {
    let source = recording(50);
    let scope = Scope::new(NAMES);
    let exprs = ["lag(x, 3) + y", "lead(y, 2)"].map(|text| Expr::parse(text, &scope).unwrap());
    let program = Program::compile(&exprs, &NAMES).unwrap();
    assert_eq!(program.halo(), Halo { before: 3, after: 2 });
    for (core, wanted) in
        [(0..50, 3..48), (10..20, 0..10), (0..10, 3..10), (45..50, 0..3), (1..3, 0..0), (48..50, 0..0), (7..7, 0..0)]
    {
        let block = source.read(0, core.clone(), program.halo()).unwrap();
        assert_eq!(program.valid_rows(&block), wanted, "{core:?}");
    }
}

#[test]
fn common_parts_are_computed_once() {
    let scope = Scope::new(NAMES);
    let compile = |texts: &[&str]| {
        let exprs: Vec<Expr> = texts.iter().map(|text| Expr::parse(text, &scope).unwrap()).collect();
        Program::compile(&exprs, &NAMES).unwrap()
    };
    let program = compile(&["sin(x*y) + 1", "cos(z)*sin(y*x)", "sin(x*y)"]);
    // x*y, its sine as an output, 1 +, cos, *.
    assert_eq!((program.instructions(), program.registers()), (5, 1));
    // x^2, x^3, x^4, x^7 = x^3*x^4.
    assert_eq!(compile(&["x^7"]).instructions(), 4);
    assert_eq!(compile(&["x^2", "x^3", "x^4", "x^5", "x^6", "x^7"]).instructions(), 6);
    // x^1024 by squaring.
    assert_eq!(compile(&["x^1024"]).instructions(), 10);
    assert_eq!(compile(&["2*pi*x + sin(1)"]).instructions(), 2);
    assert_eq!(compile(&["x", "x", "3"]).instructions(), 3);
    // A chain needs one register besides the one that is read.
    let program = compile(&["sin(cos(sin(cos(x + y) + z) + x) + y)"]);
    assert!(program.registers() <= 2, "{} registers", program.registers());
}

#[test]
fn unknown_columns_are_named() {
    let error = Program::compile(&[Expr::column("velocty")], &["velocity", "current"]).unwrap_err();
    assert_eq!(error.to_string(), "there is no column `velocty`; did you mean `velocity`?");
    assert!(Program::compile(&[Expr::column("q").sin() + Expr::column("r")], &[]).is_err());
}

#[test]
fn finite_differences_use_the_stamps() {
    // An angle that turns at 3 rad/s, wrapped, at uneven stamps.
    let rate = 3.0;
    let stamps: Vec<i64> = (0..2000i64).map(|row| row * 10_000_000 + (row * 7919 % 13) * 300_000).collect();
    let angle: Vec<f64> = stamps
        .iter()
        .map(|&stamp| Expr::number(rate * stamp as f64 * 1e-9).wrap().value(|_, _| 0.0, |_| 0.0))
        .collect();
    assert!(angle.windows(2).any(|pair| pair[1] < pair[0]), "the angle wraps");
    let mut source = MemorySource::new(vec![Column::float("a")]);
    source.push("run", stamps.into(), vec![angle.into()]);
    let a = Expr::column("a");
    for difference in [forward_difference, central_difference, backward_difference] {
        let program = Program::compile(&[difference(&a, true), difference(&a, false)], &["a"]).unwrap();
        let block = source.read(0, 0..2000, program.halo()).unwrap();
        let rows = program.valid_rows(&block);
        assert!(rows.len() >= 1998);
        let n = rows.len();
        let mut out = vec![0.0; 2 * n];
        program.evaluate_block(&block, rows, &mut out, n, &mut Scratch::new());
        assert!(out[..n].iter().all(|slope| (slope - rate).abs() < 1e-9), "wrapped");
        assert!(out[n..].iter().any(|slope| (slope - rate).abs() > 1.0), "not wrapped");
    }
}

#[test]
fn many_outputs_and_few_rows_give_the_same_bits() {
    let names: Vec<String> = (0..6).map(|i| format!("x{i}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let variables: Vec<Expr> = names.iter().map(|&name| Expr::column(name)).collect();
    let library = Library::polynomial(&variables, 6).unwrap();
    let program = library.compile(&names).unwrap();
    let rows = 1037;
    let data: Vec<Vec<f64>> =
        (0..6).map(|c| (0..rows).map(|row| ((row * (2 * c + 3)) as f64 * 0.1).sin() * 1.5).collect()).collect();
    let leaves: Vec<&[f64]> = program
        .leaves()
        .iter()
        .map(|leaf| match *leaf {
            Leaf::Column { column, .. } => data[column].as_slice(),
            Leaf::Time { .. } => unreachable!("no time here"),
        })
        .collect();
    let mut out = vec![0.0; rows * library.len()];
    let mut scratch = Scratch::new();
    program.evaluate(&leaves, rows, &mut out, rows, &mut scratch);
    let mut single = vec![0.0; library.len()];
    for row in (0..rows).step_by(61) {
        let values: Vec<f64> = leaves.iter().map(|leaf| leaf[row]).collect();
        program.evaluate_row(&values, &mut single, &mut scratch);
        for (j, expr) in library.functions().iter().enumerate() {
            let column = |name: &str, _: i32| data[names.iter().position(|&known| known == name).unwrap()][row];
            let wanted = naive(expr, &column, &|_| f64::NAN);
            assert!(same(out[j * rows + row], wanted) && same(single[j], wanted), "{expr} in row {row}");
        }
    }
}
