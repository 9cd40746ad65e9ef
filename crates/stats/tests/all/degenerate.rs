//! Rows that do not determine a model: constant columns, sums of columns, too few rows, wild scales.

use faer::{Mat, MatRef};
use fleetfoot_stats::{ErrorSums, Factor, Gram, Preconditioner, Solution, SquareRoot, least_squares, ridge};

/// A smooth, irregular value for row i, column j.
fn wave(i: usize, j: usize) -> f64 {
    let (i, j) = (i as f64, j as f64);
    (0.37 * i * (1.0 + 0.61 * j) + j).sin() + 0.5 * (0.011 * i * i + 2.0 * j).cos()
}

/// The square-root forms of the rows by both ways: preconditioned by a pilot, and TSQR.
fn roots(z: MatRef<'_, f64>, p: usize, pilot: &Preconditioner) -> [SquareRoot; 2] {
    let mut changed = z.to_owned();
    pilot.apply(changed.as_mut());
    let mut factor = Factor::new(p, z.ncols() - p);
    factor.push(z, None);
    [pilot.square_root(&Gram::of_rows(changed.as_ref(), None)), factor.square_root()]
}

fn finite(solution: &Solution) -> bool {
    let (p, q) = solution.coefficients.shape();
    (0..q).all(|t| {
        solution.intercept[t].is_finite()
            && solution.rss[t].is_finite()
            && (0..p).all(|j| solution.coefficients[(j, t)].is_finite())
    })
}

#[test]
fn sums_of_columns_are_named() {
    let scales = [1.0, 1e-12, 1e12, 3.0];
    for &s in &scales {
        // x2 = x0 + x1, x3 free, x4 constant, x5 = 2 x3; offsets make the sums round.
        let z = Mat::from_fn(400, 7, |i, j| {
            let base = |k: usize| wave(i, k) + 10.0 * (k + 1) as f64;
            match j {
                0 | 1 => s * base(j),
                2 => s * base(0) + s * base(1),
                3 => base(3),
                4 => 0.7,
                5 => 2.0 * base(3),
                _ => base(0) - 2.0 * base(1) + 3.0 * base(3),
            }
        });
        let unit = [2.0 * s, s, 0.5 * s, 1.0, 1.0, 4.0];
        for root in roots(z.as_ref(), 6, &Preconditioner::from_pilot(z.as_ref(), 6)) {
            let solution = least_squares(&root, &unit);
            assert_eq!(solution.rank, 3);
            assert_eq!(solution.confounded, vec![vec![0, 1, 2], vec![3, 5], vec![4]]);
            assert!(solution.rss[0] < 1e-20 * root.total[0], "rss {:e}", solution.rss[0]);
            assert_eq!(solution.coefficients[(4, 0)], 0.0);
            // Minimum norm: orthogonal, in units of `unit`, to the directions the data does not see.
            let gamma: Vec<f64> = (0..6).map(|j| solution.coefficients[(j, 0)] * unit[j]).collect();
            let across = |v: [f64; 6]| (0..6).map(|j| gamma[j] * unit[j] * v[j]).sum::<f64>();
            let size = gamma.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
            assert!(across([1.0, 1.0, -1.0, 0.0, 0.0, 0.0]).abs() < 1e-10 * size * s);
            assert!(across([0.0, 0.0, 0.0, 2.0, 0.0, -1.0]).abs() < 1e-10 * size);
        }
        let pilot = Preconditioner::from_pilot(z.as_ref(), 6);
        assert_eq!(pilot.rank(), 3);
        assert_eq!(pilot.confounded(), [vec![0, 1, 2], vec![3, 5], vec![4]]);
    }
}

/// The pilot sees a constant column and two equal ones; later rows show all three.
#[test]
fn dependence_missing_in_the_pilot_is_detected() {
    let column = |i: usize, j: usize| match j {
        1 if i < 100 => 4.0,
        2 if i < 100 => wave(i, 0),
        _ => wave(i, j),
    };
    let beta = [1.5, -2.0, 0.25];
    let z = Mat::from_fn(1000, 4, |i, j| {
        if j < 3 { column(i, j) } else { 0.5 + (0..3).map(|k| beta[k] * column(i, k)).sum::<f64>() }
    });
    let pilot = Preconditioner::from_pilot(z.subrows(0, 100), 3);
    assert_eq!(pilot.confounded(), [vec![0, 2], vec![1]]);
    for root in roots(z.as_ref(), 3, &pilot) {
        let solution = least_squares(&root, &[1.0; 3]);
        assert_eq!((solution.rank, solution.confounded.len()), (3, 0));
        for (j, beta) in beta.iter().enumerate() {
            assert!((solution.coefficients[(j, 0)] - beta).abs() < 1e-13);
        }
        assert!((solution.intercept[0] - 0.5).abs() < 1e-13);
    }
}

/// A region, as seen through the preconditioner of all rows: a column that varies elsewhere is constant here, another is a sum here.
#[test]
fn degenerate_region_with_regular_pilot() {
    let z = Mat::from_fn(2000, 5, |i, j| match j {
        1 if i < 300 => 0.0,
        2 if i < 300 => wave(i, 0) - wave(i, 3),
        4 => 3.0 * wave(i, 0) + wave(i, 3),
        _ => wave(i, j),
    });
    let pilot = Preconditioner::from_pilot(z.as_ref(), 4);
    assert!(pilot.confounded().is_empty());
    for root in roots(z.subrows(0, 300), 4, &pilot) {
        let solution = least_squares(&root, &[1.0; 4]);
        assert_eq!(solution.rank, 2);
        assert_eq!(solution.confounded, vec![vec![0, 2, 3], vec![1]]);
        assert_eq!(solution.coefficients[(1, 0)], 0.0);
        // The minimum of |beta| with b0 + b2 = 3, b3 - b2 = 1.
        for (j, beta) in [(0, 7.0 / 3.0), (2, 2.0 / 3.0), (3, 5.0 / 3.0)] {
            assert!((solution.coefficients[(j, 0)] - beta).abs() < 1e-12, "{}", solution.coefficients[(j, 0)]);
        }
    }
}

#[test]
fn fewer_rows_than_columns_interpolate_with_minimum_norm() {
    let z = Mat::from_fn(500, 10, wave);
    let pilot = Preconditioner::from_pilot(z.as_ref(), 8);
    for n in 0..9 {
        let part = z.subrows(100, n);
        for root in roots(part, 8, &pilot) {
            let solution = least_squares(&root, &[1.0; 8]);
            assert!(finite(&solution));
            assert_eq!(solution.rank, n.saturating_sub(1).min(8), "{n} rows");
            if n > 0 {
                assert!(
                    solution.rss.iter().all(|rss| *rss >= 0.0 && *rss < 1e-14 * (1.0 + root.total[0])),
                    "{n} rows: {:e}",
                    solution.rss[0]
                );
                // Least norm: beta is a combination of the centred rows, so it is orthogonal to every direction they lack.
                let rows = Mat::from_fn(n + 1, 8, |i, j| match (i, j) {
                    (i, j) if i < n => part[(i, j)] - part[(0, j)],
                    _ => solution.coefficients[(j, 0)],
                });
                assert!(in_range(&rows, n), "{n} rows");
            }
            assert!(finite(&ridge(&root, &[1.0; 8], 1e-3, None)));
            assert!(finite(&ridge(&root, &[1.0; 8], 0.0, None)));
        }
        // A pilot as poor as the rows still gives a valid, finite answer.
        let poor = Preconditioner::from_pilot(part, 8);
        for root in roots(z.subrows(0, 200), 8, &poor) {
            let solution = least_squares(&root, &[1.0; 8]);
            assert!(finite(&solution) && solution.rank == 8, "pilot of {n} rows: rank {}", solution.rank);
        }
    }
}

/// Returns true if row n of `rows` is a combination of rows 0..n (first 8 columns), by Gram-Schmidt.
fn in_range(rows: &Mat<f64>, n: usize) -> bool {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let mut basis: Vec<Vec<f64>> = Vec::new();
    for i in 0..=n {
        let mut v: Vec<f64> = (0..8).map(|j| rows[(i, j)]).collect();
        let before = dot(&v, &v).sqrt();
        for _ in 0..2 {
            for b in &basis {
                let along = dot(&v, b);
                v.iter_mut().zip(b).for_each(|(v, b)| *v -= along * b);
            }
        }
        let length = dot(&v, &v).sqrt();
        if i == n {
            return length <= 1e-10 * (1.0 + before);
        }
        if length > 1e-12 * (1.0 + before) {
            basis.push(v.iter().map(|v| v / length).collect());
        }
    }
    false
}

#[test]
fn constant_badly_scaled_and_empty_columns_are_solved() {
    // Every column constant; targets too.
    let z = Mat::from_fn(50, 4, |_, j| [0.0, 1e300, -1e-300, 5.0][j]);
    let pilot = Preconditioner::from_pilot(z.as_ref(), 3);
    assert_eq!(pilot.confounded(), [vec![0], vec![1], vec![2]]);
    for root in roots(z.as_ref(), 3, &pilot) {
        let solution = least_squares(&root, &[0.0, f64::NAN, 1.0]);
        assert_eq!((solution.rank, solution.intercept[0]), (0, 5.0));
        assert!(finite(&solution));
    }
    // Fifty orders of magnitude in one design.
    let beta = [1.0, -2.0, 3.0];
    let scale = [1e-25, 1.0, 1e25];
    let z = Mat::from_fn(300, 4, |i, j| {
        if j < 3 { scale[j] * (wave(i, j) + 2.0) } else { (0..3).map(|k| beta[k] * (wave(i, k) + 2.0)).sum::<f64>() }
    });
    for root in roots(z.as_ref(), 3, &Preconditioner::from_pilot(z.subrows(0, 60), 3)) {
        let solution = least_squares(&root, &scale);
        assert_eq!(solution.rank, 3);
        for j in 0..3 {
            assert!((solution.coefficients[(j, 0)] * scale[j] - beta[j]).abs() < 1e-13);
        }
    }
    // No rows.
    let none = Mat::<f64>::zeros(0, 4);
    for root in roots(none.as_ref(), 3, &Preconditioner::from_pilot(none.as_ref(), 3)) {
        assert!(finite(&least_squares(&root, &[1.0; 3])) && finite(&ridge(&root, &[1.0; 3], 1.0, None)));
    }
    // No regressors.
    let z = Mat::from_fn(20, 1, wave);
    for root in roots(z.as_ref(), 0, &Preconditioner::from_pilot(z.as_ref(), 0)) {
        let solution = least_squares(&root, &[]);
        assert!((solution.rss[0] - root.total[0]).abs() < 1e-14 * root.total[0] && root.total[0] > 1.0);
    }
}

/// A row of weight 0 leaves no trace, even when it is not finite; a huge offset does not drown the spread.
#[test]
fn unused_rows_and_large_offsets() {
    let mut z = Mat::from_fn(1000, 3, |i, j| wave(i, j) + 1e9);
    let weights: Vec<f64> = (0..1000).map(|i| if i % 7 == 3 { 0.0 } else { 1.0 + (i % 3) as f64 }).collect();
    let used: Vec<usize> = (0..1000).filter(|i| i % 7 != 3).collect();
    let kept = Mat::from_fn(used.len(), 3, |i, j| z[(used[i], j)]);
    let kept_weights: Vec<f64> = used.iter().map(|&i| weights[i]).collect();
    let expected = Gram::of_rows(kept.as_ref(), Some(&kept_weights));
    (0..1000).filter(|i| i % 7 == 3).for_each(|i| z[(i, 1)] = f64::NAN);
    assert_eq!(Gram::of_rows(z.as_ref(), Some(&weights)), expected);
    // Subtracting the offset is exact here, so this is the true scatter; the means near 1e9 are rounded to 1e-7.
    let near = Mat::from_fn(kept.nrows(), 3, |i, j| kept[(i, j)] - 1e9);
    let near = Gram::of_rows(near.as_ref(), Some(&kept_weights));
    for i in 0..3 {
        for j in 0..=i {
            let size = (near.get(i, i) * near.get(j, j)).sqrt();
            assert!((expected.get(i, j) - near.get(i, j)).abs() < 1e-8 * size);
        }
    }
}

/// An exact fit leaves a residual at the level of rounding squared, far below `1e-16` of the total.
#[test]
fn the_residual_of_an_exact_fit_is_rounding() {
    let z = Mat::from_fn(5000, 5, |i, j| {
        if j < 4 { wave(i, j) } else { (0..4).map(|k| (k + 1) as f64 * wave(i, k)).sum::<f64>() }
    });
    for root in roots(z.as_ref(), 4, &Preconditioner::from_pilot(z.subrows(0, 500), 4)) {
        assert!(root.residual[0] < 1e-26 * root.total[0], "{:e}", root.residual[0] / root.total[0]);
    }
}

#[test]
fn polynomial_features_with_a_known_answer() {
    // Integer monomials: the targets are exact in f64, so the coefficients are known.
    let powers = 7;
    let beta = [3.0, -1.0, 2.0, 1.0, -2.0, 1.0, -1.0];
    let n = 20_000;
    let base = |i: usize| (40 + (i * 7919) % 61) as f64;
    let z = Mat::from_fn(n, powers + 1, |i, j| {
        let power = |k: usize| base(i).powi(k as i32 + 1);
        if j < powers { power(j) } else { (0..powers).map(|k| beta[k] * power(k)).sum::<f64>() }
    });
    let pilot = Mat::from_fn(n / 40, powers + 1, |i, j| z[(40 * i, j)]);
    for root in roots(z.as_ref(), powers, &Preconditioner::from_pilot(pilot.as_ref(), powers)) {
        let scale = root.deviation();
        let solution = least_squares(&root, &scale);
        assert_eq!(solution.rank, powers);
        assert!(solution.condition > 1e6, "condition {:e}", solution.condition);
        let size = (0..powers).map(|j| (beta[j] * scale[j]).powi(2)).sum::<f64>().sqrt();
        let error = (0..powers).map(|j| ((solution.coefficients[(j, 0)] - beta[j]) * scale[j]).powi(2)).sum::<f64>();
        let bound = 100.0 * solution.condition * f64::EPSILON;
        assert!(error.sqrt() <= bound * size, "{:e} against {bound:e}", error.sqrt() / size);
    }
}

#[test]
fn error_sums_merge_and_count_losses() {
    let y: Vec<f64> = (0..100).map(|i| wave(i, 0)).collect();
    let mut prediction: Vec<f64> = (0..100).map(|i| wave(i, 0) + 0.1 * wave(i, 1)).collect();
    prediction[17] = f64::INFINITY;
    let mut whole = ErrorSums::new(1);
    whole.push(0, &y, &prediction, 0.25, None);
    let mut parts = ErrorSums::new(1);
    for range in [0..30, 30..100] {
        let mut part = ErrorSums::new(1);
        part.push(0, &y[range.clone()], &prediction[range], 0.25, None);
        parts.merge(&part);
    }
    let (sum, merged) = (whole.targets[0], parts.targets[0]);
    assert_eq!((sum.rows, sum.lost, sum.largest), (99, 1, merged.largest));
    assert_eq!((merged.rows, merged.lost), (99, 1));
    let used: Vec<usize> = (0..100).filter(|&i| i != 17).collect();
    let absolute: f64 = used.iter().map(|&i| (y[i] - prediction[i]).abs()).sum();
    let null: f64 = used.iter().map(|&i| (y[i] - 0.25).abs()).sum();
    assert!((sum.absolute - absolute).abs() < 1e-12 && (merged.absolute - absolute).abs() < 1e-12);
    assert!((sum.relative_absolute(0.0) - absolute / null).abs() < 1e-12);
    let mean = used.iter().map(|&i| y[i]).sum::<f64>() / 99.0;
    let square: f64 = used.iter().map(|&i| (y[i] - prediction[i]).powi(2)).sum();
    let total: f64 = used.iter().map(|&i| (y[i] - mean).powi(2)).sum();
    assert!((sum.r_squared(0.0) - (1.0 - square / total)).abs() < 1e-12);
    assert!((sum.root_mean_square() - (square / 99.0).sqrt()).abs() < 1e-14);
    let doubled: Vec<f64> = vec![2.0; 100];
    let mut weighted = ErrorSums::new(1);
    weighted.push(0, &y, &prediction, 0.25, Some(&doubled));
    assert!((weighted.targets[0].mean_absolute() - sum.mean_absolute()).abs() < 1e-15);
}

/// A target that does not move has a score: 1 for a model without error, else 0, as in scikit-learn.
#[test]
fn scores_of_a_constant_target_are_defined() {
    let y = vec![0.1; 1_000];
    for reference in [0.1, 0.3, -7.0] {
        for (error, r2) in [(0.0, 1.0), (1e-17, 1.0), (1e-3, 0.0)] {
            let mut sums = ErrorSums::new(1);
            sums.push(0, &y, &y.iter().map(|y| y + error).collect::<Vec<_>>(), reference, None);
            let sum = sums.targets[0];
            assert_eq!(sum.r_squared(1e-13 * reference.abs()), r2, "{reference} {error}");
            assert_eq!(sum.deviation_of_target(), 0.0);
            if reference == 0.1 {
                assert_eq!(sum.relative_absolute(1e-14), 1.0 - r2);
            }
        }
    }
    let nothing = ErrorSums::new(1).targets[0];
    assert!(nothing.r_squared(0.0).is_nan() && nothing.relative_absolute(0.0).is_nan());
}

/// The noise level must hold at size: many columns and rows, five columns that are sums of eight others, and one that is nearly one.
#[test]
fn rank_is_found_among_many_columns() {
    let (n, p) = (20_000, 40);
    let base: Vec<Vec<f64>> = (0..p).map(|j| (0..n).map(|i| wave(i, j) + 3.0 * (j % 3) as f64).collect()).collect();
    let nearly = 1e-10;
    let z = Mat::from_fn(n, p + 1, |i, j| match j {
        35..40 => (0..8).map(|k| (1.0 + k as f64) * base[(j * 5 + k * 4) % 34][i]).sum::<f64>(),
        34 => base[3][i] - base[7][i] + nearly * base[34][i],
        40 => base[0][i] + wave(i, 50),
        _ => base[j][i],
    });
    let pilot = Mat::from_fn(n / 20, p + 1, |i, j| z[(20 * i + i % 20, j)]);
    let pilot = Preconditioner::from_pilot(pilot.as_ref(), p);
    assert_eq!(pilot.rank(), 35);
    for root in roots(z.as_ref(), p, &pilot) {
        let solution = least_squares(&root, &root.deviation());
        assert_eq!(solution.rank, 35, "noise {:e}, condition {:e}", root.noise, root.condition);
        assert!(solution.confounded.iter().flatten().all(|&column| column != 34));
        assert!(solution.condition > 1e9, "{:e}", solution.condition);
        assert!(solution.rss[0] < root.total[0]);
    }
}
