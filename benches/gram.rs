//! The statistic of rows: change of coordinates, Gram matrix, Gram matrices by region, TSQR. One thread.
//!
//! The work is counted in useful multiply-adds: d (d + 1) / 2 a row for a Gram matrix of d columns, p (p + 1) / 2 for
//! the triangular solve, p^2 for TSQR. The yardstick is faer's full product of the same shape, in the same run, at its
//! full count of n d^2.

use std::hint::black_box;

use faer::{Accum, Mat, Par};
use fleetfoot_benches::best_of;
use fleetfoot_stats::{Factor, Gram, Preconditioner, least_squares};
use rand::{RngExt, SeedableRng};

const REPEATS: usize = 15;

fn rows(n: usize, d: usize) -> Mat<f64> {
    let mut random = rand_pcg::Pcg64Mcg::seed_from_u64(7);
    let mut previous = vec![0.0; d];
    // Neighbouring columns are correlated, as the columns of a library are.
    Mat::from_fn(d, n, |j, _| {
        let fresh: f64 = random.random_range(-1.0..1.0);
        previous[j] = fresh + if j > 0 { 0.9 * previous[j - 1] } else { 0.3 };
        previous[j]
    })
    .transpose()
    .to_owned()
}

/// Largest difference from the plain sums of centred products, relative to the diagonal.
fn deviation(gram: &Gram, z: &Mat<f64>) -> f64 {
    let (n, d) = z.shape();
    let mean: Vec<f64> = (0..d).map(|j| z.col_as_slice(j).iter().sum::<f64>() / n as f64).collect();
    let mut worst = 0.0_f64;
    for i in 0..d {
        for j in 0..=i {
            let pairs = z.col_as_slice(i).iter().zip(z.col_as_slice(j));
            let direct: f64 = pairs.map(|(a, b)| (a - mean[i]) * (b - mean[j])).sum();
            worst = worst.max((direct - gram.get(i, j)).abs() / (gram.get(i, i) * gram.get(j, j)).sqrt());
        }
    }
    worst
}

fn main() {
    println!("Gram matrices, one thread; best of {REPEATS}; giga multiply-adds a second, useful work only");
    println!(
        "{:>7} {:>4} {:>9} {:>8} {:>8} {:>8} {:>8} {:>8}",
        "rows", "d", "of_rows", "apply", "both", "regions", "TSQR", "product"
    );
    for (n, d, regions) in
        [(8192, 10, 50), (8192, 25, 50), (8192, 25, 5), (8192, 57, 50), (8192, 101, 50), (8192, 301, 5)]
    {
        let z = rows(n, d);
        let p = d - 1;
        let label: Vec<u32> = (0..n).map(|i| (i * 2_654_435_761 % 1_000_003 % regions) as u32).collect();
        let pairs = (n * d * (d + 1) / 2) as f64;

        let (plain, gram) = best_of(REPEATS, || Gram::of_rows(black_box(z.as_ref()), None));
        assert!(deviation(&gram, &z) < 1e-13, "of_rows is wrong");
        let (by_region, parts) = best_of(REPEATS, || Gram::by_region(black_box(z.as_ref()), None, &label, regions));
        let mut sum = Gram::new(d);
        parts.iter().for_each(|(_, part)| sum.merge(part));
        assert!(deviation(&sum, &z) < 1e-13, "by_region is wrong");

        let pilot = Preconditioner::from_pilot(z.subrows(0, 2048), p);
        let mut changed = z.clone();
        let (copy, ()) = best_of(REPEATS, || changed.copy_from(black_box(&z)));
        let (apply, ()) = best_of(REPEATS, || {
            changed.copy_from(&z);
            pilot.apply(changed.as_mut());
        });
        let apply = apply - copy;
        let root = pilot.square_root(&Gram::of_rows(changed.as_ref(), None));
        let (tsqr, factor) = best_of(3, || {
            let mut factor = Factor::new(p, 1);
            factor.push(black_box(z.as_ref()), None);
            factor
        });
        let units = vec![1.0; p];
        let (ours, reference) = (least_squares(&root, &units), least_squares(&factor.square_root(), &units));
        let worst =
            (0..p).map(|j| (ours.coefficients[(j, 0)] - reference.coefficients[(j, 0)]).abs()).fold(0.0, f64::max);
        assert!(worst < 1e-11, "the coefficients differ by {worst:e}");

        let mut product = Mat::<f64>::zeros(d, d);
        let (full, ()) = best_of(REPEATS, || {
            faer::linalg::matmul::matmul(&mut product, Accum::Replace, z.transpose(), black_box(&z), 1.0, Par::Seq);
        });
        let rate = |work: f64, seconds: f64| work / seconds * 1e-9;
        let solve = (n * d * (d + 1) / 2) as f64;
        println!(
            "{n:>7} {d:>4} {:>9.1} {:>8.1} {:>8.1} {:>8.1} {:>8.1} {:>8.1}   {:.0} + {:.0} us, {regions} regions {:.0} us",
            rate(pairs, plain),
            rate(solve, apply),
            rate(pairs + solve, plain + apply),
            rate(pairs, by_region),
            rate((n * (d + 1) * (d + 1)) as f64, tsqr),
            rate((n * d * d) as f64, full),
            plain * 1e6,
            apply * 1e6,
            by_region * 1e6,
        );
    }
}
