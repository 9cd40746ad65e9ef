//! Coefficients: against QR of the raw library, and between the bases.

use faer::prelude::*;

use super::*;

/// Least squares by Cholesky of the centred Gram, in the basis: coefficients and intercepts.
fn solve(plan: &PolynomialPlan, gram: &Gram) -> (Mat<f64>, Vec<f64>) {
    let (p, q) = (plan.functions(), plan.targets());
    let normal = Mat::from_fn(p, p, |i, j| gram.get(i.max(j), i.min(j)));
    let right = Mat::from_fn(p, q, |i, t| gram.get(p + t, i));
    let coefficients = normal.llt(faer::Side::Lower).unwrap().solve(&right);
    let intercept =
        (0..q).map(|t| gram.mean[p + t] - (0..p).map(|i| gram.mean[i] * coefficients[(i, t)]).sum::<f64>()).collect();
    (coefficients, intercept)
}

/// All monomials of rows, the constant first: n x (p + 1).
fn monomials(plan: &PolynomialPlan, base: &[&[f64]]) -> Mat<f64> {
    let power = |row: usize, exponent: &[u8]| -> f64 {
        exponent.iter().zip(base).map(|(&e, column)| column[row].powi(i32::from(e))).product()
    };
    Mat::from_fn(base[0].len(), plan.functions() + 1, |row, i| power(row, plan.library.exponent(i)))
}

#[test]
fn coefficients_are_as_accurate_as_qr() {
    let rows = 6000;
    for (m, degree, share) in
        [(1, 6, 0.0), (2, 5, 1.5), (3, 5, 1.5), (3, 5, 8.0), (3, 5, 30.0), (3, 3, 300.0), (6, 2, 1.5), (6, 2, 100.0)]
    {
        let columns = correlated(rows, m, 100 + degree as u64, share);
        let base = slices(&columns);
        let plan = PolynomialPlan::from_pilot(&cut(&base, 1000..4000), &[&[0.0; 3000]], degree).unwrap();
        assert!(plan.is_well_conditioned(), "{m} {degree}: {}", plan.condition());
        let raw = monomials(&plan, &base);
        let norms: Vec<f64> = (0..raw.ncols()).map(|i| raw.col(i).norm_l2()).collect();
        // Coefficients in units of their columns, so that all matter alike.
        let mut noise = Noise(5);
        let truth: Vec<f64> = (0..raw.ncols()).map(|_| noise.next()).collect();
        let scaled = Mat::from_fn(rows, raw.ncols(), |row, i| raw[(row, i)] / norms[i]);
        let y = &scaled * Mat::from_fn(raw.ncols(), 1, |i, _| truth[i]);
        let target: Vec<f64> = (0..rows).map(|row| y[(row, 0)]).collect();

        let (coefficients, intercept) = solve(&plan, &plan.gram(&moments_of(&plan, &base, &[&target], None)));
        let (coefficients, intercept) = plan.to_monomials(coefficients.as_ref(), &intercept);
        let ours: Vec<f64> =
            (0..raw.ncols()).map(|i| norms[i] * if i == 0 { intercept[0] } else { coefficients[(i - 1, 0)] }).collect();
        let reference = scaled.qr().solve_lstsq(&y);
        let values = scaled.singular_values().unwrap();
        let condition = values[0] / values[values.len() - 1];
        let size = truth.iter().map(|b| b * b).sum::<f64>().sqrt();
        let error =
            |b: &dyn Fn(usize) -> f64| (0..truth.len()).map(|i| (b(i) - truth[i]).powi(2)).sum::<f64>().sqrt() / size;
        let (mine, qr) = (error(&|i| ours[i]), error(&|i| reference[(i, 0)]));
        println!(
            "m {m} degree {degree}: condition raw {condition:.1e} basis {:.1}, error {mine:.1e}, QR {qr:.1e}",
            plan.condition()
        );
        assert!(
            mine < 100.0 * condition * f64::EPSILON,
            "m {m} degree {degree}: {mine:e}, QR {qr:e}, condition {condition:e}"
        );
        // In raw monomials the same solver would be hopeless: the claim is not empty.
        if condition > 1e4 {
            let normal = scaled.transpose() * &scaled;
            let right = scaled.transpose() * &y;
            let bad = normal.llt(faer::Side::Lower).map_or(f64::INFINITY, |llt| {
                let b = llt.solve(&right);
                error(&|i| b[(i, 0)])
            });
            assert!(bad > 100.0 * mine, "{bad:e} {mine:e}");
        }
    }
}

#[test]
fn monomial_conversion_of_exact_numbers_is_exact() {
    // Values +-1/4 about 1/2: one column, deviation 1/4, so v = (x - 1/2) * 4 / unit with a dyadic or 3-smooth unit.
    let x: Vec<f64> = (0..64).map(|i| if i % 2 == 0 { 0.25 } else { 0.75 }).collect();
    let mut plan = PolynomialPlan::from_pilot(&[&x], &[&x], 3).unwrap();
    plan.map = AffineMap::from_pilot(&[&x]).in_units_of(2.0);
    // v = 2x - 1: T_2 = 8x^2 - 8x + 1, T_3 = 32x^3 - 48x^2 + 18x - 1.
    let basis = Mat::from_fn(3, 1, |i, _| [0.0, 1.0, 2.0][i]);
    let (raw, constant) = plan.to_monomials(basis.as_ref(), &[5.0]);
    assert_eq!([raw[(0, 0)], raw[(1, 0)], raw[(2, 0)], constant[0]], [28.0, -88.0, 64.0, 4.0]);
    let (back, intercept) = plan.from_monomials(raw.as_ref(), &constant);
    assert_eq!((back, intercept), (basis, vec![5.0]));
}

#[test]
fn a_converted_model_predicts_the_same() {
    for (m, degree) in [(1, 8), (2, 5), (3, 5), (6, 2)] {
        let columns = signals(500, m, 40 + m as u64);
        let base = slices(&columns);
        let plan = PolynomialPlan::from_pilot(&base, &[&[0.0; 500], &[0.0; 500]], degree).unwrap();
        let mut noise = Noise(8);
        let coefficients = Mat::from_fn(plan.functions(), 2, |_, _| noise.next());
        let (raw, constant) = plan.to_monomials(coefficients.as_ref(), &[0.5, -2.0]);
        let (design, library) = (plan.evaluate(&base), monomials(&plan, &base));
        for row in 0..500 {
            for (t, &start) in [0.5, -2.0].iter().enumerate() {
                let expected =
                    start + (0..plan.functions()).map(|i| design[(row, i)] * coefficients[(i, t)]).sum::<f64>();
                let terms = (0..plan.functions()).map(|i| library[(row, i + 1)] * raw[(i, t)]);
                let size = constant[t].abs() + terms.clone().map(f64::abs).sum::<f64>();
                let value = constant[t] + terms.sum::<f64>();
                assert!((value - expected).abs() < 1e-14 * size, "{m} {degree} {row}: {value} {expected} {size}");
            }
        }
    }
}
