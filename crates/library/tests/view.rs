//! Views and designs: aliases over a recording, complete rows of a regression.

use fleetfoot_data::{Column, ColumnKind, Halo, MemorySource, ScalarBuffer, Source};
use fleetfoot_library::{Design, DesignRows, Expr, Scope, View};

fn source() -> MemorySource {
    let category = Column { kind: ColumnKind::Category(vec!["ice".into(), "sand".into()]), ..Column::float("ground") };
    let mut source = MemorySource::new(vec![Column::float("x"), Column::float("u"), category]);
    let time: Vec<i64> = (0..10).map(|row| row * 500_000_000).collect();
    for episode in 0..2 {
        let x: Vec<f64> = (0..10).map(|row| f64::from(row * row) + 100.0 * f64::from(episode)).collect();
        let mut u = vec![1.0; 10];
        u[6] = f64::NAN;
        let ground = (0..10).map(|row| f64::from(row % 2)).collect::<Vec<_>>();
        source.push("run", ScalarBuffer::from(time.clone()), [x, u, ground].map(ScalarBuffer::from).to_vec());
    }
    source
}

fn parse(text: &str) -> Expr {
    Expr::parse(text, &Scope::new(["x", "u", "ground"])).unwrap()
}

#[test]
fn plain_aliases_share_and_expressions_compute() {
    let source = source();
    let aliases =
        [("position", "x"), ("rate", "(x - lag(x, 1)) / 0.5"), ("ahead", "lead(x, 2)"), ("twice_t", "2*time()")];
    let aliases: Vec<(Column, Expr)> = aliases.map(|(name, text)| (Column::float(name), parse(text))).to_vec();
    let view = View::new(&source, &aliases).unwrap();
    for (rows, halo) in
        [(0..10, Halo::default()), (3..6, Halo { before: 2, after: 9 }), (0..2, Halo { before: 1, after: 1 })]
    {
        let block = view.read(1, rows.clone(), halo).unwrap();
        let plain = source.read(1, rows.clone(), halo).unwrap();
        assert_eq!((block.before, block.rows, block.after), (plain.before, plain.rows, plain.after));
        assert_eq!(block.column(0), plain.column(0));
        assert_eq!(block.column(0).as_ptr(), plain.column(0).as_ptr(), "a plain alias is not copied");
        for at in 0..block.time.len() {
            let row = (rows.start - block.before + at) as f64;
            let value = |row: f64| row * row + 100.0;
            let rate = if row == 0.0 { f64::NAN } else { (value(row) - value(row - 1.0)) / 0.5 };
            let ahead = if row > 7.0 { f64::NAN } else { value(row + 2.0) };
            for (value, expected) in
                [(block.column(1)[at], rate), (block.column(2)[at], ahead), (block.column(3)[at], row)]
            {
                assert!(value == expected || value.is_nan() && expected.is_nan(), "row {row}: {value} {expected}");
            }
        }
    }
    assert!(View::new(&source, &[(Column::float("y"), Expr::column("gone"))]).is_err());
}

#[test]
fn labels_are_renumbered_by_name() {
    let source = source();
    let mut view = View::new(&source, &[(source.columns()[2].clone(), parse("ground"))]).unwrap();
    view.recode("ground", vec![-1.0, 4.0]);
    let block = view.read(0, 0..4, Halo::default()).unwrap();
    assert_eq!(block.core(0), [-1.0, 4.0, -1.0, 4.0]);
}

#[test]
fn a_design_keeps_complete_rows_and_counts_the_others() {
    let source = source();
    let design =
        Design::compile(&[parse("lag(x, 2)"), parse("u"), parse("lead(x, 1)")], &["x", "u", "ground"]).unwrap();
    assert_eq!(design.halo(), Halo { before: 2, after: 1 });
    let mut out = DesignRows::default();
    let block = source.read(0, 0..10, design.halo()).unwrap();
    design.evaluate(&block, 0..10, &mut out);
    // Rows 0, 1 and 9 lack a neighbour, row 6 has no input.
    assert_eq!((out.at_border, out.incomplete), (3, 1));
    assert_eq!(out.index, [2, 3, 4, 5, 7, 8]);
    assert_eq!(out.output(0), [0.0, 1.0, 4.0, 9.0, 25.0, 36.0]);
    assert_eq!(out.output(2), [9.0, 16.0, 25.0, 36.0, 64.0, 81.0]);
    // The same rows in pieces.
    let mut pieces = Vec::new();
    for rows in [0..3, 3..4, 4..10] {
        let block = source.read(0, rows.clone(), design.halo()).unwrap();
        design.evaluate(&block, 0..rows.len(), &mut out);
        pieces.extend_from_slice(out.output(2));
    }
    assert_eq!(pieces, [9.0, 16.0, 25.0, 36.0, 64.0, 81.0]);
}
