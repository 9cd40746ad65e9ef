//! Preconditioners of well-conditioned pilots: centred and scaled columns only, at a price of two digits at most.

use faer::{Mat, MatRef};
use fleetfoot_stats::{Factor, Gram, Preconditioner, least_squares};

const P: usize = 6;

/// Columns with offsets and units, neighbours correlated by `share`, and a target with `noise`.
fn rows(n: usize, share: f64, noise: f64) -> Mat<f64> {
    let wave = |i: usize, j: usize| (0.37 * (i * (2 * j + 3)) as f64).sin() + 0.5 * (1.1 * (i + 7 * j) as f64).cos();
    let unit = |j: usize| 10.0_f64.powi(3 * (j as i32 % 3) - 3);
    let x = Mat::from_fn(n, P, |i, j| {
        let common = wave(i, 99);
        unit(j) * (5.0 + share * common + (1.0 - share) * wave(i, j))
    });
    Mat::from_fn(n, P + 1, |i, j| match j {
        P => (0..P).map(|j| (j as f64 - 2.0) * x[(i, j)] / unit(j)).sum::<f64>() + noise * wave(i, 50),
        _ => x[(i, j)],
    })
}

fn fitted(rows: MatRef<'_, f64>, preconditioner: &Preconditioner) -> (Vec<f64>, f64) {
    let mut total = Gram::new(P + 1);
    for first in (0..rows.nrows()).step_by(1000) {
        let mut part = rows.subrows(first, 1000.min(rows.nrows() - first)).to_owned();
        preconditioner.apply(part.as_mut());
        total.merge(&Gram::of_rows(part.as_ref(), None));
    }
    let root = preconditioner.square_root(&total);
    let solution = least_squares(&root, &[1.0; P]);
    ((0..P).map(|j| solution.coefficients[(j, 0)]).collect(), solution.rss[0])
}

#[test]
fn coefficients_lose_two_digits_at_most() {
    let mut simple = 0;
    for (share, noise) in [(0.0, 1.0), (0.5, 0.1), (0.9, 0.1), (0.95, 1e-3), (0.99, 0.1)] {
        let rows = rows(5000, share, noise);
        let pilot = Mat::from_fn(500, P + 1, |i, j| rows[(10 * i, j)]);
        let preconditioner = Preconditioner::from_pilot(pilot.as_ref(), P);
        let condition = preconditioner.condition();
        let mut factor = Factor::new(P, 1);
        factor.push(rows.as_ref(), None);
        let reference = least_squares(&factor.square_root(), &[1.0; P]);
        let (coefficients, rss) = fitted(rows.as_ref(), &preconditioner);
        // Offsets of 5 deviations or so; 100 is the two digits, beside what a QR loses.
        let limit = 100.0 * 50.0 * condition * f64::EPSILON;
        for j in 0..P {
            let unit = 10.0_f64.powi(3 * (j as i32 % 3) - 3);
            let apart = (coefficients[j] - reference.coefficients[(j, 0)]).abs() * unit;
            assert!(apart < limit, "condition {condition:.1}: {apart:e}, limit {limit:e}");
        }
        assert!((rss / reference.rss[0] - 1.0).abs() < 1e-9, "{rss} {}", reference.rss[0]);
        // Centred and scaled only: a column of the result is its own, in its own place.
        let mut changed = pilot.clone();
        preconditioner.apply(changed.as_mut());
        let slope = |j: usize| (changed[(1, j)] - changed[(0, j)]) / (pilot[(1, j)] - pilot[(0, j)]);
        let scaled = |j: usize| {
            (0..500)
                .all(|i| (changed[(i, j)] - changed[(0, j)] - slope(j) * (pilot[(i, j)] - pilot[(0, j)])).abs() < 1e-11)
        };
        let is_simple = (0..P).all(scaled);
        assert_eq!(is_simple, condition <= 100.0, "condition {condition}");
        simple += usize::from(is_simple);
        let read = Preconditioner::from_bytes(&preconditioner.to_bytes()).expect("bytes");
        assert_eq!(read, preconditioner);
        let mut again = pilot.clone();
        read.apply(again.as_mut());
        assert_eq!(again, changed);
    }
    assert!((2..5).contains(&simple), "both forms were made: {simple} simple ones");
}

#[test]
fn an_exact_fit_keeps_a_residual_of_rounding() {
    let rows = rows(3000, 0.5, 0.0);
    let preconditioner = Preconditioner::from_pilot(rows.subrows(0, 600), P);
    assert!(preconditioner.condition() <= 100.0);
    let (_, rss) = fitted(rows.as_ref(), &preconditioner);
    let total: f64 = Gram::of_rows(rows.as_ref(), None).get(P, P);
    assert!(rss < 1e-24 * total, "{rss:e} of {total:e}");
}

#[test]
fn row_major_views_give_equal_results() {
    let rows = rows(300, 0.2, 0.3);
    let preconditioner = Preconditioner::from_pilot(rows.as_ref(), P);
    let mut columns = rows.clone();
    preconditioner.apply(columns.as_mut());
    let mut transposed = rows.transpose().to_owned();
    preconditioner.apply(transposed.as_mut().transpose_mut());
    assert_eq!(transposed.transpose().to_owned(), columns);
}
