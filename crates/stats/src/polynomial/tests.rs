use std::ops::Range;

use fleetfoot_data::{Cancelled, Silent, parallel_map, with_threads};
use proptest::prelude::*;

use super::{double::Double, *};

mod fit;

/// Reproducible numbers in [-1, 1): a linear congruential generator's upper bits.
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn gaussian(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() / 2.0
    }
}

/// Correlated columns with offsets and very different scales, as joint angles, speeds and forces have.
fn signals(rows: usize, columns: usize, seed: u64) -> Vec<Vec<f64>> {
    correlated(rows, columns, seed, 1.5)
}

/// The same, each column with `share` times the first one's values in it.
fn correlated(rows: usize, columns: usize, seed: u64, share: f64) -> Vec<Vec<f64>> {
    let mut noise = Noise(seed);
    let mut result: Vec<Vec<f64>> = Vec::new();
    for k in 0..columns {
        let (scale, offset) = ([1.0, 30.0, 0.02, 400.0][k % 4], [0.3, -20.0, 0.0, 900.0][k % 4]);
        let rate = 0.013 * (1.0 + 0.37 * k as f64);
        let column: Vec<f64> = (0..rows)
            .map(|row| {
                let wave = (rate * row as f64).sin() + 0.4 * noise.gaussian();
                let shared = result.first().map_or(0.0, |first| first[row] - 0.3);
                offset + scale * (wave + share * shared)
            })
            .collect();
        result.push(column);
    }
    result
}

fn slices(columns: &[Vec<f64>]) -> Vec<&[f64]> {
    columns.iter().map(Vec::as_slice).collect()
}

fn cut<'a>(columns: &[&'a [f64]], rows: Range<usize>) -> Vec<&'a [f64]> {
    columns.iter().map(|column| &column[rows.clone()]).collect()
}

fn moments_of(
    plan: &PolynomialPlan,
    base: &[&[f64]],
    targets: &[&[f64]],
    weights: Option<&[f64]>,
) -> PolynomialMoments {
    let mut moments = plan.moments();
    moments.add(plan, &mut plan.scratch(), base, targets, weights);
    moments
}

/// Largest difference from the centred weighted product in twice the precision, each entry relative to the sizes of its columns.
fn gram_error(plan: &PolynomialPlan, gram: &Gram, base: &[&[f64]], targets: &[&[f64]], weights: Option<&[f64]>) -> f64 {
    let (design, p) = (plan.evaluate(base), plan.functions());
    let rows = base[0].len();
    let value = |row: usize, i: usize| {
        if i < p { design[(row, i)] } else { targets[i - p][row] }
    };
    let weight = |row: usize| weights.map_or(1.0, |weights| weights[row]);
    let total = (0..rows).fold(Double::default(), |sum, row| sum + Double::from(weight(row)));
    let inverse = Double::reciprocal(total.to_f64());
    let d = p + targets.len();
    let product = |i: usize, j: Option<usize>| {
        (0..rows).fold(Double::default(), |sum, row| {
            let other = j.map_or(1.0, |j| value(row, j));
            sum + Double::from(weight(row)) * Double::from(value(row, i)) * Double::from(other)
        })
    };
    let firsts: Vec<Double> = (0..d).map(|i| product(i, None)).collect();
    let sizes: Vec<f64> = (0..d).map(|i| product(i, Some(i)).to_f64().max(total.to_f64()).sqrt()).collect();
    let mut worst: f64 = 0.0;
    for i in 0..d {
        let mean = (firsts[i] * inverse).to_f64();
        worst = worst.max((gram.mean[i] - mean).abs() * total.to_f64().sqrt() / sizes[i]);
        for j in 0..=i {
            let exact = product(i, Some(j)) - firsts[i] * firsts[j] * inverse;
            worst = worst.max((gram.get(i, j) - exact.to_f64()).abs() / (sizes[i] * sizes[j]));
        }
    }
    worst
}

#[test]
fn the_gram_is_the_direct_product() {
    for (m, degree, q, rows) in [
        (1, 7, 1, 301),
        (2, 4, 0, 1),
        (2, 4, 2, 1500),
        (3, 5, 1, 2317),
        (6, 2, 9, 1100),
        (4, 3, 3, 777),
        (16, 1, 1, 130),
    ] {
        let columns = signals(rows + 50, m + q, 7 + m as u64);
        let all = slices(&columns);
        let plan = PolynomialPlan::from_pilot(&all[..m], &all[m..], degree).unwrap();
        let used = cut(&all, 13..13 + rows);
        let (base, targets) = used.split_at(m);
        let weights: Vec<f64> = (0..rows).map(|row| [1.0, 0.25, 0.0, 3.5][row % 4]).collect();
        for weights in [None, Some(&weights[..])] {
            let moments = moments_of(&plan, base, targets, weights);
            let gram = plan.gram(&moments);
            let error = gram_error(&plan, &gram, base, targets, weights);
            assert!(error < 2e-14, "m {m} degree {degree} rows {rows}: {error:e}");
            let counted = weights.map_or(rows, |w| w.iter().filter(|&&w| w > 0.0).count());
            assert_eq!((gram.rows, gram.dimension()), (counted as u64, plan.functions() + q));
        }
    }
}

#[test]
fn every_instruction_set_gives_the_same_sums() {
    let columns = signals(1333, 4, 3);
    let all = slices(&columns);
    let (base, targets) = all.split_at(3);
    let mut plan = PolynomialPlan::from_pilot(base, targets, 4).unwrap();
    let reference = moments_of(&plan, base, targets, None);
    for registers in [1, 16, 32] {
        plan.program = program(&plan.library, &plan.moments, plan.degree, 1, registers);
        let mut scratch = plan.scratch();
        let mut totals = vec![0.0; plan.sums()];
        let rows = Rows { base, targets, weights: None, count: 1333 };
        let (program, map, target_centre) = (&plan.program, &plan.map, &plan.target_centre);
        let total = |i: usize, value: f64| totals[i] += value;
        let scalar = AddRows { program, map, target_centre, rows, workspace: &mut scratch.0, total };
        pulp::Simd::vectorize(pulp::Scalar, scalar);
        for (i, total) in totals.iter().enumerate() {
            let size = if i < plan.moments.len() { 1333.0 } else { 1333.0 * 1000.0 };
            assert!((total - reference.total(i)).abs() < 1e-12 * size, "{registers} {i}");
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn narrow_vectors_give_the_same_sums() {
    let Some(simd) = pulp::x86::V3::try_new() else {
        return;
    };
    let columns = signals(1000, 2, 4);
    let base = slices(&columns);
    let plan = PolynomialPlan::from_pilot(&base, &[], 6).unwrap();
    let reference = moments_of(&plan, &base, &[], None);
    let (mut scratch, mut totals) = (plan.scratch(), vec![0.0; plan.sums()]);
    let rows = Rows { base: &base, targets: &[], weights: None, count: 1000 };
    let (program, map, target_centre) = (&plan.program, &plan.map, &plan.target_centre);
    let total = |i: usize, value: f64| totals[i] += value;
    pulp::Simd::vectorize(simd, AddRows { program, map, target_centre, rows, workspace: &mut scratch.0, total });
    for (i, total) in totals.iter().enumerate() {
        assert!((total - reference.total(i)).abs() < 1e-10, "{i}: {total} {}", reference.total(i));
    }
}

#[test]
fn condition_predicts_the_loss_of_digits() {
    // x and x + 1e-7 noise: whitened, the pair is as good as any.
    let mut noise = Noise(1);
    let x: Vec<f64> = (0..4000).map(|_| noise.gaussian()).collect();
    let near: Vec<f64> = x.iter().map(|x| x + 1e-7 * noise.gaussian()).collect();
    let plan = PolynomialPlan::from_pilot(&[&x, &near], &[], 3).unwrap();
    assert!(plan.condition() < 20.0, "{}", plan.condition());
    // A function of x is not made independent by an affine map.
    let square: Vec<f64> = x.iter().map(|x| x * x).collect();
    let plan = PolynomialPlan::from_pilot(&[&x, &square], &[], 2).unwrap();
    assert_eq!(plan.condition(), f64::INFINITY);
    let almost: Vec<f64> = square.iter().map(|s| s + 1e-3 * noise.gaussian()).collect();
    let plan = PolynomialPlan::from_pilot(&[&x, &almost], &[], 2).unwrap();
    assert!(!plan.is_well_conditioned() && plan.condition() < 1e5, "{}", plan.condition());
    // Heavy tails: range scaling would be useless, the best unit is not.
    let tails: Vec<f64> = x.iter().map(|x| x * x * x).collect();
    assert!(PolynomialPlan::from_pilot(&[&tails], &[], 3).unwrap().condition() < 100.0);
}

#[test]
fn degenerate_pilots_have_infinite_condition_and_finite_values() {
    let x: Vec<f64> = (0..50).map(f64::from).collect();
    let constant = vec![4.0; 50];
    let double: Vec<f64> = x.iter().map(|x| 2.0 * x + 1.0).collect();
    for base in
        [vec![&x[..], &constant], vec![&x, &double], vec![&constant], vec![&x[..1], &constant[..1]], vec![&[0.0; 9]]]
    {
        let plan = PolynomialPlan::from_pilot(&base, &[], 3).unwrap();
        let moments = moments_of(&plan, &base, &[], None);
        assert!(moments.is_finite());
        assert_eq!(plan.condition(), f64::INFINITY);
        let gram = plan.gram(&moments);
        assert!(gram.mean.iter().chain(&gram.scatter).all(|value| value.is_finite()));
    }
    let plan = PolynomialPlan::from_pilot(&[&x], &[&double], 2).unwrap();
    let gram = plan.gram(&plan.moments());
    assert_eq!((gram.rows, gram.weight), (0, 0.0));
    assert!(gram.scatter.iter().all(|&value| value == 0.0));
}

#[test]
fn wrong_input_is_refused_with_a_remedy() {
    let x = vec![1.0, 2.0];
    let many: Vec<&[f64]> = vec![&x; 17];
    assert!(matches!(PolynomialPlan::from_pilot(&many, &[], 2), Err(PolynomialError::Shape { variables: 17, .. })));
    assert!(matches!(PolynomialPlan::from_pilot(&[&x], &[], 0), Err(PolynomialError::Shape { .. })));
    let error = PolynomialPlan::from_pilot(&many[..12], &[], 9).unwrap_err();
    assert!(error.to_string().contains("lower the degree"), "{error}");
    assert!(matches!(PolynomialPlan::from_pilot(&[&x], &[], usize::MAX), Err(PolynomialError::TooLarge { .. })));
    assert_eq!(PolynomialPlan::from_pilot(&[&x, &x[..1]], &[], 2).unwrap_err(), PolynomialError::Pilot);
    let error = PolynomialPlan::from_pilot(&[&x], &[&[0.0, f64::NAN]], 2).unwrap_err();
    assert_eq!(error, PolynomialError::NotFinite { column: 1 });
}

#[test]
fn rows_of_weight_zero_may_hold_anything() {
    let mut columns = signals(40, 3, 9);
    let clean = columns.clone();
    let plan = PolynomialPlan::from_pilot(&slices(&clean[..2]), &[&clean[2]], 3).unwrap();
    let weights: Vec<f64> = (0..40).map(|row| f64::from(row % 3 != 0)).collect();
    for (row, bad) in [(0, f64::NAN), (3, f64::INFINITY), (39, 1e300)] {
        columns.iter_mut().for_each(|column| column[row] = bad);
    }
    let with_bad = moments_of(&plan, &slices(&columns[..2]), &[&columns[2]], Some(&weights));
    let without = moments_of(&plan, &slices(&clean[..2]), &[&clean[2]], Some(&weights));
    assert_eq!(with_bad, without);
    assert!(!moments_of(&plan, &slices(&columns[..2]), &[&columns[2]], None).is_finite());
}

#[test]
fn names_follow_the_exponents() {
    let columns = signals(30, 2, 1);
    let plan = PolynomialPlan::from_pilot(&slices(&columns), &[], 2).unwrap();
    assert_eq!(plan.names(&["x", "y"]), ["x", "y", "x^2", "x*y", "y^2"]);
}

#[test]
fn the_same_bits_from_any_number_of_threads() {
    let columns = signals(9000, 4, 77);
    let all = slices(&columns);
    let plan = PolynomialPlan::from_pilot(&all[..3], &all[3..], 3).unwrap();
    let run = |threads: usize| {
        let chunks = with_threads(threads, || {
            parallel_map(9, &Silent, |i| {
                let rows = cut(&all, i * 1000..(i + 1) * 1000);
                Ok::<_, Cancelled>(moments_of(&plan, &rows[..3], &rows[3..], None))
            })
        });
        let mut total = plan.moments();
        chunks.unwrap().iter().for_each(|chunk| total.merge(chunk));
        total
    };
    let one = run(1);
    assert_eq!(one.rows(), 9000);
    assert!(run(2) == one && run(7) == one);
}

#[test]
fn many_merges_lose_nothing() {
    let columns = signals(1000, 2, 6);
    let base = slices(&columns);
    let plan = PolynomialPlan::from_pilot(&base, &[], 2).unwrap();
    let chunk = moments_of(&plan, &base, &[], Some(&[0.1; 1000]));
    let mut total = plan.moments();
    let mut plain = vec![0.0; plan.sums()];
    for _ in 0..10_000 {
        total.merge(&chunk);
        plain.iter_mut().zip(chunk.values()).for_each(|(sum, value)| *sum += value);
    }
    let error = |value: f64, i: usize| (value / (1e4 * chunk.total(i)) - 1.0).abs();
    let worst = (0..plan.sums()).map(|i| error(total.total(i), i)).fold(0.0, f64::max);
    let naive = (0..plan.sums()).map(|i| error(plain[i], i)).fold(0.0, f64::max);
    assert!(worst < 4.0 * f64::EPSILON, "{worst:e}");
    assert!(naive > 20.0 * f64::EPSILON, "{naive:e}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(40))]

    #[test]
    fn splits_and_orders_change_only_rounding(m in 1usize..5, degree in 1usize..4, q in 0usize..3, at in 0usize..700, seed in 0u64..1000) {
        let columns = signals(700, m + q, seed);
        let all = slices(&columns);
        let plan = PolynomialPlan::from_pilot(&all[..m], &all[m..], degree).unwrap();
        let whole = plan.gram(&moments_of(&plan, &all[..m], &all[m..], None));
        let part = |rows: Range<usize>| {
            let used = cut(&all, rows);
            moments_of(&plan, &used[..m], &used[m..], None)
        };
        let (first, second) = (part(0..at), part(at..700));
        let (mut forward, mut backward) = (first.clone(), second.clone());
        forward.merge(&second);
        backward.merge(&first);
        for other in [&forward, &backward] {
            let gram = plan.gram(other);
            prop_assert_eq!((gram.rows, gram.weight), (700, 700.0));
            let size = |i: usize| (whole.get(i, i) + 700.0 * whole.mean[i].powi(2)).max(700.0).sqrt();
            for i in 0..gram.dimension() {
                for j in 0..=i {
                    prop_assert!((gram.get(i, j) - whole.get(i, j)).abs() < 1e-13 * size(i) * size(j));
                }
            }
        }
    }

    #[test]
    fn an_integer_weight_is_a_repeated_row(m in 1usize..4, counts in prop::collection::vec(0usize..4, 60)) {
        let columns = signals(60, m + 1, 12);
        let repeat = |column: &Vec<f64>| -> Vec<f64> {
            column.iter().zip(&counts).flat_map(|(&value, &count)| std::iter::repeat_n(value, count)).collect()
        };
        let repeated: Vec<Vec<f64>> = columns.iter().map(repeat).collect();
        let weights: Vec<f64> = counts.iter().map(|&count| count as f64).collect();
        let (all, longer) = (slices(&columns), slices(&repeated));
        let plan = PolynomialPlan::from_pilot(&all[..m], &all[m..], 3).unwrap();
        let weighted = moments_of(&plan, &all[..m], &all[m..], Some(&weights));
        let plain = moments_of(&plan, &longer[..m], &longer[m..], None);
        prop_assert_eq!(weighted.weight(), plain.weight());
        prop_assert_eq!(weighted.rows(), counts.iter().filter(|&&count| count > 0).count() as u64);
        let (a, b) = (plan.gram(&weighted), plan.gram(&plain));
        let size = |i: usize| (b.get(i, i) + b.weight * b.mean[i].powi(2)).max(b.weight).sqrt();
        for i in 0..a.dimension() {
            for j in 0..=i {
                prop_assert!((a.get(i, j) - b.get(i, j)).abs() <= 1e-13 * size(i) * size(j));
            }
        }
    }

    #[test]
    fn conversion_there_and_back(m in 1usize..4, degree in 1usize..5, seed in 0u64..1000) {
        let mut noise = Noise(seed);
        let columns: Vec<Vec<f64>> = (0..m).map(|_| (0..200).map(|_| noise.gaussian()).collect()).collect();
        let plan = PolynomialPlan::from_pilot(&slices(&columns), &[], degree).unwrap();
        let coefficients = Mat::from_fn(plan.functions(), 1, |_, _| noise.next());
        let (raw, constant) = plan.to_monomials(coefficients.as_ref(), &[1.0]);
        let (back, intercept) = plan.from_monomials(raw.as_ref(), &constant);
        prop_assert!((intercept[0] - 1.0).abs() < 1e-12);
        for i in 0..plan.functions() {
            prop_assert!((back[(i, 0)] - coefficients[(i, 0)]).abs() < 1e-12);
        }
    }
}
