use std::{ops::Range, sync::Arc};

use faer::MatRef;
use fleetfoot_data::{Silent, mix, with_threads};

use super::{DIRECT, DenseDesign, DenseError, DenseRows, Nonzeros, ROOT_COLUMNS};
use crate::{
    Penalty, Quadratic, SparseError,
    coordinate::{CoordinateOptions, coordinate_descent},
    lars::{LarsOptions, lars},
    quadratic::Form,
};

/// Columns that lean on each other, far from zero, and two targets.
#[derive(Debug)]
struct Table {
    rows: usize,
    regressors: usize,
}

fn uniform(at: usize) -> f64 {
    (mix(at as u64) >> 11) as f64 / (1_u64 << 53) as f64 - 0.5
}

impl Table {
    fn value(&self, row: usize, column: usize) -> f64 {
        let shared = uniform(row);
        let value = |j: usize| uniform((row + 1) * 10_007 + j);
        if column < self.regressors {
            return 3.0 + shared + (1.0 + column as f64 % 7.0) * value(column);
        }
        let noise = 0.3 * uniform((row + 1) * 777_767 + column);
        let sum: f64 = (0..self.regressors.min(4)).map(|j| (j as f64 - 1.3) * self.value(row, j)).sum();
        (column - self.regressors) as f64 + sum + noise
    }
}

impl DenseRows for Table {
    fn rows(&self) -> usize {
        self.rows
    }

    fn regressors(&self) -> usize {
        self.regressors
    }

    fn targets(&self) -> usize {
        2
    }

    fn read(&self, rows: Range<usize>, out: &mut Vec<f64>) {
        for column in 0..self.regressors + 2 {
            out.extend(rows.clone().map(|row| self.value(row, column)));
        }
    }
}

const FOLDS: u32 = 3;

/// Group and weight of a row: weights with zeros, groups that alternate and groups that do not.
fn label(row: usize) -> u32 {
    if row.is_multiple_of(5) { 0 } else { 1 + (row / 70) as u32 % (FOLDS - 1) }
}

fn weight(row: usize) -> f64 {
    (row % 4) as f64 / 2.0
}

fn design(rows: usize, regressors: usize) -> DenseDesign {
    let weights = Some((0..rows).map(weight).collect());
    let labels = (0..rows).map(label).collect();
    DenseDesign::new(Arc::new(Table { rows, regressors }), weights, labels, FOLDS as usize, &Silent).unwrap()
}

/// The same problem from all rows at once.
fn direct(rows: usize, regressors: usize, groups: Option<&[usize]>, target: usize, intercept: bool) -> Quadratic {
    let table = Table { rows, regressors };
    let used: Vec<usize> =
        (0..rows).filter(|&row| groups.is_none_or(|groups| groups.contains(&(label(row) as usize)))).collect();
    let column = |j: usize| used.iter().map(move |&row| (row, j));
    let x: Vec<f64> = (0..regressors).flat_map(column).map(|(row, j)| table.value(row, j)).collect();
    let y: Vec<f64> = used.iter().map(|&row| table.value(row, regressors + target)).collect();
    let weights: Vec<f64> = used.iter().map(|&row| weight(row)).collect();
    let x = MatRef::from_column_major_slice(&x, used.len(), regressors);
    Quadratic::from_rows(x, &y, Some(&weights), intercept).unwrap()
}

/// The paths agree, down to a hundredth of where they begin.
fn assert_same_path(quadratic: &Quadratic, expected: &Quadratic, tolerance: f64) {
    let top = lars(expected, &Penalty::default(), &LarsOptions { max_knots: Some(1), ..LarsOptions::default() });
    let end = 0.01 * top.unwrap().knots[0].l1;
    let options = LarsOptions { lambda_min: end, ..LarsOptions::default() };
    let (a, b) = (
        lars(quadratic, &Penalty::default(), &options).unwrap(),
        lars(expected, &Penalty::default(), &options).unwrap(),
    );
    let p = expected.columns();
    let size = b.knots.last().unwrap().dense(p).iter().fold(0.0_f64, |size, value| size.max(value.abs()));
    for share in [0.9, 0.5, 0.1, 0.01] {
        let lambda = (100.0 * end * share).max(end);
        let (x, y) = (a.coefficients(lambda).unwrap(), b.coefficients(lambda).unwrap());
        let worst = x.iter().zip(&y).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        assert!(worst <= tolerance * size, "{worst:e} of {size:e} at {lambda}");
    }
    let (a, b) = (a.knots.last().unwrap(), b.knots.last().unwrap());
    assert!((a.intercept - b.intercept).abs() <= tolerance * (1.0 + b.intercept.abs()));
    assert!((a.mse / b.mse - 1.0).abs() <= tolerance.max(1e-9), "{} {}", a.mse, b.mse);
}

#[test]
fn shapes_give_the_problem_of_rows() {
    // Fewer rows than columns, few rows, many rows, many rows of many columns.
    let many = DIRECT / (20 * 20) + 1;
    let shapes = [(30, 50, 1e-11), (400, 9, 1e-11), (many, 18, 1e-11), (1100, ROOT_COLUMNS + 10, 1e-8)];
    for (rows, regressors, tolerance) in shapes {
        let design = design(rows, regressors);
        assert_eq!(design.sums.is_some(), rows * (regressors + 2).pow(2) > DIRECT && rows > 2 * (regressors + 2));
        for (groups, intercept) in [(None, true), (None, false), (Some(&[0, 2][..]), true), (Some(&[1][..]), false)] {
            let problems = design.problems(groups, intercept).unwrap();
            for (target, problem) in problems.iter().enumerate() {
                assert_same_path(problem, &direct(rows, regressors, groups, target, intercept), tolerance);
            }
        }
    }
}

#[test]
fn errors_match_rows() {
    for (rows, regressors) in [(30, 50), (400, 9), (DIRECT / (12 * 12) + 1, 10)] {
        let (design, table) = (design(rows, regressors), Table { rows, regressors });
        let coefficients: Vec<f64> = (0..2 * regressors).map(|at| uniform(at + 5)).collect();
        let intercepts = [0.5, -2.0];
        let groups = [0, 1];
        let mean_squares = design.mean_squares(Some(&groups), 1, &coefficients, &intercepts, &Silent).unwrap();
        for (model, solution) in mean_squares.iter().enumerate() {
            let beta = &coefficients[model * regressors..][..regressors];
            let (mut sum, mut total) = (0.0, 0.0);
            for row in (0..rows).filter(|&row| groups.contains(&(label(row) as usize))) {
                let predicted: f64 = beta.iter().enumerate().map(|(j, beta)| beta * table.value(row, j)).sum();
                let error = table.value(row, regressors + 1) - intercepts[model] - predicted;
                (sum, total) = (sum + weight(row) * error * error, total + weight(row));
            }
            assert!((solution / (sum / total) - 1.0).abs() < 1e-11, "{solution} {}", sum / total);
        }
    }
}

#[test]
fn the_root_holds_all_targets() {
    for rows in [400, DIRECT / (12 * 12) + 1] {
        let design = design(rows, 10);
        let root = design.root(Some(&[2]));
        for target in 0..2 {
            let problem = Quadratic::from_square_root(&root, target).unwrap();
            assert_same_path(&problem, &direct(rows, 10, Some(&[2]), target, true), 1e-11);
        }
    }
}

#[test]
fn the_bits_do_not_depend_on_the_threads() {
    let rows = DIRECT / (12 * 12) + 1;
    let roots: Vec<_> = [1, 3].map(|threads| with_threads(threads, || design(rows, 10).root(None))).into();
    assert_eq!(roots[0], roots[1]);
}

#[test]
fn bad_input_is_named() {
    let table = || Arc::new(Table { rows: 10, regressors: 3 });
    let made = |weights, labels, groups| DenseDesign::new(table(), weights, labels, groups, &Silent).unwrap_err();
    assert!(matches!(
        made(Some(vec![1.0; 9]), Vec::new(), 1),
        DenseError::Problem(SparseError::Length { actual: 9, .. })
    ));
    let mut weights = vec![1.0; 10];
    weights[4] = -1.0;
    assert!(matches!(made(Some(weights), Vec::new(), 1), DenseError::Problem(SparseError::RowWeight { row: 4, .. })));
    assert!(matches!(made(None, vec![7; 10], 3), DenseError::Group { row: 0, label: 7, most: 2 }));
    let none = DenseDesign::new(table(), Some(vec![0.0; 10]), Vec::new(), 1, &Silent).unwrap();
    assert!(matches!(none.problems(None, true), Err(DenseError::Problem(SparseError::NoRows))));
    assert!(none.mean_squares(None, 0, &[0.0; 3], &[0.0], &Silent).is_err());
}

#[test]
fn few_solutions_of_many_columns_use_the_rows() {
    let rows = || Arc::new(Table { rows: 700, regressors: ROOT_COLUMNS + 10 });
    let weights: Vec<f64> = (0..700).map(|row| f64::from(row % 5 > 0) * (1.0 + uniform(row))).collect();
    let few = DenseDesign::for_few(rows(), Some(weights.clone()), &Silent).unwrap();
    let all = DenseDesign::new(rows(), Some(weights), Vec::new(), 1, &Silent).unwrap();
    for intercept in [true, false] {
        let [kept, products] = [&few, &all].map(|design| design.problems(None, intercept).unwrap().remove(1));
        assert!(matches!(&kept.form, Form::Root { a, .. } if a.rows() == 560));
        assert!(matches!(&products.form, Form::Gram { .. }));
        let lambdas = [0.2, 0.02].map(|share| share * kept.target_deviation());
        let solve = |problem| coordinate_descent(problem, &Penalty::default(), &lambdas, &CoordinateOptions::default());
        for (a, b) in solve(&kept).unwrap().iter().zip(&solve(&products).unwrap()) {
            assert!(a.converged && a.certificate.gap < 1e-12);
            assert_eq!(a.support, b.support);
            a.coefficients
                .iter()
                .zip(&b.coefficients)
                .for_each(|(a, b)| assert!((a - b).abs() < 1e-7 * b.abs().max(1e-3)));
        }
    }
}

/// One value in twenty is not zero.
#[derive(Debug)]
struct Scattered {
    rows: usize,
    regressors: usize,
    /// True if the source reports its density, and so its nonzero values.
    tells: bool,
    /// True if a column nearly repeats another one.
    leans: bool,
}

impl Scattered {
    fn value(&self, row: usize, column: usize) -> f64 {
        let value = |j: usize| match mix((row * 7919 + j * 31) as u64) % 20 {
            0 => 1.0 + uniform(row * 911 + j),
            _ => 0.0,
        };
        match column {
            j if j >= self.regressors => 1e3 + value(3) - 2.0 * value(8) + uniform(row + 5 * j),
            // Rows without weight leave no trace, whatever they hold.
            8 if weight(row) == 0.0 && self.regressors > ROOT_COLUMNS => f64::NAN,
            5 if self.leans => value(4) * (1.0 + 1e-6 * uniform(row)),
            j => value(j),
        }
    }
}

impl DenseRows for Scattered {
    fn rows(&self) -> usize {
        self.rows
    }

    fn regressors(&self) -> usize {
        self.regressors
    }

    fn targets(&self) -> usize {
        2
    }

    fn read(&self, rows: Range<usize>, out: &mut Vec<f64>) {
        (0..self.regressors + 2).for_each(|column| out.extend(rows.clone().map(|row| self.value(row, column))));
    }

    fn density(&self) -> f64 {
        if self.tells { 0.05 } else { 1.0 }
    }

    fn nonzeros(&self, rows: Range<usize>) -> Option<Nonzeros> {
        let mut nonzeros = Nonzeros { starts: vec![0], ..Nonzeros::default() };
        for row in rows {
            for column in (0..self.regressors).filter(|&column| self.value(row, column) != 0.0) {
                nonzeros.columns.push(column as u32);
                nonzeros.values.push(self.value(row, column));
            }
            nonzeros.starts.push(nonzeros.values.len());
        }
        Some(nonzeros)
    }
}

#[test]
fn few_values_give_the_sums_of_all() {
    let many = DIRECT / (20 * 20) + 1;
    for (rows, regressors, leans) in [(many, 18, false), (many, 18, true), (1100, ROOT_COLUMNS + 10, false)] {
        let design = |tells| {
            let rows = Arc::new(Scattered { rows, regressors, tells, leans });
            let labels = (0..rows.rows).map(label).collect();
            DenseDesign::new(rows.clone(), Some((0..rows.rows).map(weight).collect()), labels, 3, &Silent).unwrap()
        };
        let designs = [1, 3].map(|threads| with_threads(threads, || design(true)));
        let expected = design(false);
        for (groups, intercept) in [(None, true), (Some(&[0, 2][..]), false)] {
            let [one, three] = [&designs[0], &designs[1]].map(|design| design.problems(groups, intercept).unwrap());
            assert_eq!(one, three);
            for (problem, expected) in one.iter().zip(&expected.problems(groups, intercept).unwrap()) {
                // Columns that lean on each other are summed as dense rows are.
                assert_eq!(leans, problem == expected);
                assert_same_path(problem, expected, 1e-9);
            }
        }
        let coefficients: Vec<f64> = (0..regressors).map(uniform).collect();
        let [a, b] =
            [&designs[0], &expected].map(|design| design.mean_squares(Some(&[1]), 0, &coefficients, &[900.0], &Silent));
        assert!(leans || (a.unwrap()[0] / b.unwrap()[0] - 1.0).abs() < 1e-11);
    }
}
