//! Properties that hold for any rows: merging, weights, permutations, scales and held-out errors.

use faer::{Mat, MatRef};
use fleetfoot_stats::{Factor, Gram, Preconditioner, Solution, SquareRoot, least_squares, ridge};
use proptest::prelude::*;

/// SplitMix64: uniform numbers in [-1, 1) from a seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut x = self.0;
        x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Rows (x, y): correlated regressors with offsets and scales between 1e-3 and 1e3, targets linear in them with noise.
fn rows(seed: u64, n: usize, p: usize, q: usize) -> Mat<f64> {
    let mut random = Random(seed);
    let mix = Mat::from_fn(p, p, |i, j| if i == j { 1.0 } else { 0.3 * random.next() });
    let scale: Vec<f64> = (0..p).map(|_| 10f64.powf(3.0 * random.next())).collect();
    let offset: Vec<f64> = (0..p).map(|_| 5.0 * random.next()).collect();
    let beta = Mat::from_fn(p, q, |_, _| random.next());
    let mut z = Mat::zeros(n, p + q);
    for i in 0..n {
        let raw: Vec<f64> = (0..p).map(|_| random.next()).collect();
        for j in 0..p {
            let x: f64 = (0..p).map(|k| mix[(k, j)] * raw[k]).sum::<f64>() + offset[j];
            z[(i, j)] = x * scale[j];
            (0..q).for_each(|t| z[(i, p + t)] += x * beta[(j, t)]);
        }
        (0..q).for_each(|t| z[(i, p + t)] += 0.1 * random.next());
    }
    z
}

fn root(z: MatRef<'_, f64>, weights: Option<&[f64]>, p: usize) -> SquareRoot {
    let pilot = Preconditioner::from_pilot(z, p);
    let mut changed = z.to_owned();
    pilot.apply(changed.as_mut());
    pilot.square_root(&Gram::of_rows(changed.as_ref(), weights))
}

fn close(a: f64, b: f64, size: f64) -> bool {
    (a - b).abs() <= 1e-12 * size
}

/// Returns true if two statistics agree to rounding, entry by entry, relative to the diagonal and to the spread of the
/// means.
fn same(a: &Gram, b: &Gram) -> bool {
    let d = a.dimension();
    let size = |i: usize| a.get(i, i).max(b.get(i, i)).sqrt() + a.weight.sqrt() * a.mean[i].abs();
    a.rows == b.rows
        && close(a.weight, b.weight, a.weight)
        && (0..d).all(|i| close(a.mean[i] * a.weight.sqrt(), b.mean[i] * a.weight.sqrt(), size(i)))
        && (0..d).all(|i| (0..=i).all(|j| close(a.get(i, j), b.get(i, j), size(i) * size(j))))
}

fn assert_solutions(a: &Solution, b: &Solution, scale: &[f64]) -> Result<(), TestCaseError> {
    prop_assert_eq!(a.rank, b.rank);
    prop_assert_eq!(&a.confounded, &b.confounded);
    for t in 0..a.intercept.len() {
        for j in 0..scale.len() {
            let (left, right) = (a.coefficients[(j, t)] * scale[j], b.coefficients[(j, t)] * scale[j]);
            prop_assert!((left - right).abs() < 1e-10, "coefficient {} of target {}: {} {}", j, t, left, right);
        }
        prop_assert!((a.rss[t] - b.rss[t]).abs() <= 1e-10 * (1.0 + b.rss[t]), "rss {} {}", a.rss[t], b.rss[t]);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn any_split_and_any_order_give_the_same_gram(seed: u64, n in 1usize..1400, d in 1usize..45, cut in 0.0..1.0f64) {
        let z = rows(seed, n, d, 1);
        let whole = Gram::of_rows(z.as_ref(), None);
        prop_assert_eq!(whole.rows, n as u64);
        let at = (cut * n as f64) as usize;
        let (top, bottom) = (Gram::of_rows(z.subrows(0, at), None), Gram::of_rows(z.subrows(at, n - at), None));
        let (mut down, mut up) = (top.clone(), bottom.clone());
        down.merge(&bottom);
        up.merge(&top);
        prop_assert!(same(&whole, &down) && same(&whole, &up));
        // The same order of merges gives the same bits.
        let mut again = top;
        again.merge(&bottom);
        prop_assert_eq!(&again, &down);
        // Nothing is the neutral element, bit for bit.
        let mut none = Gram::new(d + 1);
        none.merge(&down);
        none.merge(&Gram::new(d + 1));
        prop_assert_eq!(&none, &down);
    }

    #[test]
    fn the_gram_is_the_centred_second_moment(seed: u64, n in 1usize..700, d in 1usize..50) {
        let z = rows(seed, n, d, 0);
        let mut random = Random(seed ^ 1);
        let weights: Vec<f64> = (0..n).map(|_| 1.0 + random.next()).collect();
        let gram = Gram::of_rows(z.as_ref(), Some(&weights));
        let total: f64 = weights.iter().sum();
        let mean: Vec<f64> = (0..d).map(|j| (0..n).map(|i| weights[i] * z[(i, j)]).sum::<f64>() / total).collect();
        for i in 0..d {
            for j in 0..d {
                let direct: f64 = (0..n).map(|r| weights[r] * (z[(r, i)] - mean[i]) * (z[(r, j)] - mean[j])).sum();
                let size = (gram.get(i, i).sqrt() + mean[i].abs()) * (gram.get(j, j).sqrt() + mean[j].abs());
                prop_assert!(close(gram.get(i, j), direct, size));
            }
        }
        let columns: Vec<usize> = (0..d).rev().step_by(2).collect();
        let selected = gram.select(&columns);
        for (i, &a) in columns.iter().enumerate() {
            prop_assert_eq!(selected.mean[i], gram.mean[a]);
            for (j, &b) in columns.iter().enumerate() {
                prop_assert_eq!(selected.get(i, j), gram.get(a, b));
            }
        }
    }

    #[test]
    fn region_bits_match_its_rows(seed: u64, n in 1usize..2500, d in 1usize..45, count in 1usize..9, weighted: bool) {
        let z = rows(seed, n, d, 1);
        let mut random = Random(seed ^ 2);
        let mut regions: Vec<u32> = (0..n).map(|_| ((random.next() + 1.0) * 0.7 * count as f64) as u32).collect();
        regions.iter_mut().for_each(|region| *region = if *region < count as u32 { *region } else { u32::MAX });
        let weights: Vec<f64> = (0..n).map(|_| random.next().max(0.0)).collect();
        let weights = weighted.then_some(&weights[..]);
        let answer = Gram::by_region(z.as_ref(), weights, &regions, count);
        let mut expected = Vec::new();
        for region in 0..count as u32 {
            let used: Vec<usize> = (0..n).filter(|&i| regions[i] == region && weights.is_none_or(|w| w[i] > 0.0)).collect();
            if !used.is_empty() {
                let part = Mat::from_fn(used.len(), d + 1, |i, j| z[(used[i], j)]);
                let weights: Option<Vec<f64>> = weights.map(|w| used.iter().map(|&i| w[i]).collect());
                expected.push((region, Gram::of_rows(part.as_ref(), weights.as_deref())));
            }
        }
        prop_assert_eq!(answer, expected);
    }

    #[test]
    fn whole_weights_repeat_rows(seed: u64, n in 30usize..300, p in 1usize..12) {
        let z = rows(seed, n, p, 2);
        let mut random = Random(seed ^ 3);
        let weights: Vec<f64> = (0..n).map(|_| (2.0 + 2.0 * random.next()).floor()).collect();
        let repeated: Vec<usize> = (0..n).flat_map(|i| std::iter::repeat_n(i, weights[i] as usize)).collect();
        prop_assume!(repeated.len() > p + 5);
        let long = Mat::from_fn(repeated.len(), p + 2, |i, j| z[(repeated[i], j)]);
        let (mut short_factor, mut long_factor) = (Factor::new(p, 2), Factor::new(p, 2));
        short_factor.push(z.as_ref(), Some(&weights));
        long_factor.push(long.as_ref(), None);
        let scale = long_factor.square_root().deviation();
        let expected = least_squares(&long_factor.square_root(), &scale);
        assert_solutions(&least_squares(&short_factor.square_root(), &scale), &expected, &scale)?;
        assert_solutions(&least_squares(&root(z.as_ref(), Some(&weights), p), &scale), &expected, &scale)?;
        assert_solutions(&least_squares(&root(long.as_ref(), None, p), &scale), &expected, &scale)?;
        let used = weights.iter().filter(|&&w| w > 0.0).count() as u64;
        prop_assert_eq!(short_factor.square_root().rows, used);
    }

    #[test]
    fn factors_merge_in_any_order(seed: u64, n in 20usize..900, p in 1usize..12, cut in 0.0..1.0f64) {
        let z = rows(seed, n, p, 1);
        let at = (cut * n as f64) as usize;
        let part = |first: usize, rows: usize| {
            let mut factor = Factor::new(p, 1);
            factor.push(z.subrows(first, rows), None);
            factor
        };
        let (mut down, mut up) = (part(0, at), part(at, n - at));
        let top = down.clone();
        down.merge(&up);
        up.merge(&top);
        let scale = down.square_root().deviation();
        let expected = least_squares(&part(0, n).square_root(), &scale);
        assert_solutions(&least_squares(&down.square_root(), &scale), &expected, &scale)?;
        assert_solutions(&least_squares(&up.square_root(), &scale), &expected, &scale)?;
    }

    #[test]
    fn permuting_columns_permutes_the_answer(seed: u64, n in 40usize..200, p in 2usize..12, turn in 1usize..12) {
        let z = rows(seed, n, p, 1);
        let at = |j: usize| if j < p { (j + turn) % p } else { j };
        let turned = Mat::from_fn(n, p + 1, |i, j| z[(i, at(j))]);
        let straight = root(z.as_ref(), None, p);
        let scale = straight.deviation();
        let turned_scale: Vec<f64> = (0..p).map(|j| scale[at(j)]).collect();
        let a = least_squares(&straight, &scale);
        let b = least_squares(&root(turned.as_ref(), None, p), &turned_scale);
        for j in 0..p {
            let size = scale[at(j)];
            prop_assert!((b.coefficients[(j, 0)] - a.coefficients[(at(j), 0)]).abs() * size < 1e-11);
        }
        prop_assert!((a.rss[0] - b.rss[0]).abs() <= 1e-11 * a.rss[0]);
    }

    #[test]
    fn scaling_a_column_scales_its_coefficient_back(seed: u64, n in 40usize..200, p in 1usize..10, power in -40i32..40) {
        let z = rows(seed, n, p, 1);
        let factor = 10f64.powi(power / 3);
        let scaled = Mat::from_fn(n, p + 1, |i, j| if j == 0 { factor * z[(i, j)] } else { z[(i, j)] });
        let straight = root(z.as_ref(), None, p);
        let mut scale = straight.deviation();
        let a = least_squares(&straight, &scale);
        let size = scale.clone();
        scale[0] *= factor;
        let b = least_squares(&root(scaled.as_ref(), None, p), &scale);
        prop_assert_eq!(b.rank, p);
        for j in 0..p {
            let back = if j == 0 { factor } else { 1.0 };
            prop_assert!((b.coefficients[(j, 0)] * back - a.coefficients[(j, 0)]).abs() * size[j] < 1e-10);
        }
    }

    #[test]
    fn error_is_the_sum_of_squared_residuals(seed: u64, n in 1usize..200, p in 1usize..10, weighted: bool) {
        let z = rows(seed, n, p, 2);
        let mut random = Random(seed ^ 4);
        let weights: Vec<f64> = (0..n).map(|_| 1.0 + random.next()).collect();
        let weight = |i: usize| if weighted { weights[i] } else { 1.0 };
        let weights = weighted.then_some(&weights[..]);
        let mut factor = Factor::new(p, 2);
        factor.push(z.as_ref(), weights);
        let spread: Vec<f64> = (0..p).map(|j| (0..n).map(|i| z[(i, j)].abs()).fold(0.0, f64::max)).collect();
        let beta = Mat::from_fn(p, 2, |j, _| random.next() / spread[j]);
        let intercept = [random.next(), random.next()];
        let direct = |t: usize| -> f64 {
            let left = |i: usize| z[(i, p + t)] - intercept[t] - (0..p).map(|j| z[(i, j)] * beta[(j, t)]).sum::<f64>();
            (0..n).map(|i| weight(i) * left(i).powi(2)).sum()
        };
        for root in [root(z.as_ref(), weights, p), factor.square_root()] {
            for (t, error) in root.error(beta.as_ref(), &intercept).into_iter().enumerate() {
                prop_assert!((error - direct(t)).abs() <= 1e-11 * (direct(t) + n as f64), "{} {}", error, direct(t));
            }
            // The null model's error is the total; a sub-library explains less.
            let zero = Mat::zeros(p, 2);
            for (null, total) in root.error(zero.as_ref(), &root.mean_y).iter().zip(&root.total) {
                prop_assert!((null - total).abs() <= 1e-12 * total);
            }
            let columns: Vec<usize> = (0..p).step_by(2).collect();
            let less = root.select(&columns);
            let sub = Mat::from_fn(columns.len(), 2, |j, t| beta[(columns[j], t)]);
            let full = Mat::from_fn(p, 2, |j, t| if j % 2 == 0 { beta[(j, t)] } else { 0.0 });
            let (a, b) = (less.error(sub.as_ref(), &intercept), root.error(full.as_ref(), &intercept));
            for t in 0..2 {
                prop_assert!((a[t] - b[t]).abs() <= 1e-12 * b[t].max(1.0), "{} {}", a[t], b[t]);
            }
        }
    }

    /// The gradient of the stated objective vanishes.
    #[test]
    fn ridge_meets_its_stated_objective(seed: u64, n in 1usize..120, p in 1usize..9, power in -6i32..4, weighted: bool) {
        let z = rows(seed, n, p, 1);
        let lambda = 10f64.powi(power);
        let mut random = Random(seed ^ 5);
        let weights: Vec<f64> = (0..n).map(|_| 1.5 + random.next()).collect();
        let root = root(z.as_ref(), weighted.then_some(&weights[..]), p);
        let scale: Vec<f64> = root.deviation().iter().map(|&s| if s > 0.0 { s } else { 1.0 }).collect();
        let prior = Mat::from_fn(p, 1, |j, _| random.next() / scale[j]);
        let solution = ridge(&root, &scale, lambda, Some(prior.as_ref()));
        let weight = |i: usize| if weighted { weights[i] } else { 1.0 };
        let total: f64 = (0..n).map(weight).sum();
        let error = |i: usize| {
            z[(i, p)] - solution.intercept[0] - (0..p).map(|j| z[(i, j)] * solution.coefficients[(j, 0)]).sum::<f64>()
        };
        for j in 0..p {
            let mean = root.mean_x[j];
            let fit: f64 = (0..n).map(|i| weight(i) * error(i) * (z[(i, j)] - mean)).sum::<f64>() / total;
            let penalty = lambda * scale[j] * scale[j] * (solution.coefficients[(j, 0)] - prior[(j, 0)]);
            prop_assert!((fit - penalty).abs() <= 1e-9 * scale[j] * (1.0 + lambda), "{} {}", fit, penalty);
        }
        prop_assert!((0..n).map(|i| weight(i) * error(i)).sum::<f64>().abs() <= 1e-9 * total);
    }

    #[test]
    fn bytes_of_a_preconditioner_read_back(seed: u64, n in 0usize..60, p in 0usize..9, q in 0usize..3, cut in 0.0..1.0f64) {
        let pilot = Preconditioner::from_pilot(rows(seed, n, p, q).as_ref(), p);
        let bytes = pilot.to_bytes();
        prop_assert_eq!(&Preconditioner::from_bytes(&bytes).unwrap(), &pilot);
        let short = (cut * bytes.len() as f64) as usize;
        prop_assert!(Preconditioner::from_bytes(&bytes[..short]).is_err());
    }
}
