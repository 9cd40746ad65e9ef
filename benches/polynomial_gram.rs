//! The Gram matrix of a polynomial library from moments, beside numpy's matrix product on the ready-made library.

use std::path::Path;

use faer::Mat;
use fleetfoot_benches::{best_of, fma_rate, peak_rss_mib, peer, read_f64, write_f64};
use fleetfoot_data::{Cancelled, Silent, parallel_map, with_threads};
use fleetfoot_stats::{Gram, PolynomialMoments, PolynomialPlan, TILE_ROWS};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const ROWS: usize = 1_000_000;
const CHUNK: usize = 65_536;
const PILOT_STRIDE: usize = 97;
const REPETITIONS: usize = 15;

/// Correlated oscillations with noise, offsets and different scales.
fn signals(columns: usize) -> Vec<Vec<f64>> {
    let mut random = Pcg64::seed_from_u64(1);
    let mut result: Vec<Vec<f64>> = Vec::new();
    for k in 0..columns {
        let (scale, offset) = ([1.0, 3.0, 0.2][k % 3], [0.3, -2.0, 0.0][k % 3]);
        let rate = 0.0131 * (1.0 + 0.37 * k as f64);
        let column = (0..ROWS)
            .map(|row| {
                let noise: f64 = (0..4).map(|_| random.random_range(-0.5..0.5)).sum();
                let shared = result.first().map_or(0.0, |first| first[row] - 0.3);
                offset + scale * ((rate * row as f64).sin() + 0.5 * noise + 1.5 * shared)
            })
            .collect();
        result.push(column);
    }
    result
}

/// A scan: chunks in parallel, their rows in tiles, merged in order.
fn scan(plan: &PolynomialPlan, base: &[&[f64]], targets: &[&[f64]]) -> Gram {
    let chunks = parallel_map(ROWS.div_ceil(CHUNK), &Silent, |i| {
        let (mut moments, mut scratch) = (plan.moments(), plan.scratch());
        let end = ((i + 1) * CHUNK).min(ROWS);
        for from in (i * CHUNK..end).step_by(TILE_ROWS) {
            let rows = from..(from + TILE_ROWS).min(end);
            let base: Vec<&[f64]> = base.iter().map(|column| &column[rows.clone()]).collect();
            let targets: Vec<&[f64]> = targets.iter().map(|column| &column[rows.clone()]).collect();
            moments.add(plan, &mut scratch, &base, &targets, None);
        }
        Ok::<PolynomialMoments, Cancelled>(moments)
    });
    let mut total = plan.moments();
    chunks.iter().flatten().for_each(|chunk| total.merge(chunk));
    plan.gram(&total)
}

/// The centred Gram of the basis as the plain Gram of 1 and the raw monomials.
fn raw_gram(plan: &PolynomialPlan, gram: &Gram) -> Mat<f64> {
    let p = plan.functions();
    let identity = Mat::<f64>::identity(p, p);
    let (change, constant) = plan.from_monomials(identity.as_ref(), &vec![0.0; p]);
    let scatter = Mat::from_fn(p, p, |i, j| gram.get(i.max(j), i.min(j)));
    let raw = change.transpose() * scatter * &change;
    let mean = |j: usize| -> f64 {
        if j == 0 { 1.0 } else { constant[j - 1] + (0..p).map(|i| change[(i, j - 1)] * gram.mean[i]).sum::<f64>() }
    };
    let means: Vec<f64> = (0..=p).map(mean).collect();
    Mat::from_fn(p + 1, p + 1, |i, j| {
        let centred = if i == 0 || j == 0 { 0.0 } else { raw[(i - 1, j - 1)] };
        centred + gram.weight * means[i] * means[j]
    })
}

struct Case {
    columns: usize,
    degree: usize,
    targets: usize,
}

/// The kernel alone on rows in second-level cache, against the peak: runs of a millisecond, so that other work on the machine is not in the fastest.
fn kernel_rate(plan: &PolynomialPlan, base: &[&[f64]], targets: &[&[f64]], peak: Option<f64>) {
    const PART: usize = 16_384;
    let base: Vec<&[f64]> = base.iter().map(|column| &column[..PART]).collect();
    let targets: Vec<&[f64]> = targets.iter().map(|column| &column[..PART]).collect();
    let (mut moments, mut scratch) = (plan.moments(), plan.scratch());
    let (seconds, ()) = best_of(400, || moments.add(plan, &mut scratch, &base, &targets, None));
    let rate = (plan.sums() * PART) as f64 / seconds;
    let share =
        peak.map_or("peak not measured here".to_owned(), |peak| format!("{:.0} % of the peak", 100.0 * rate / peak));
    println!(
        "  kernel, evaluation included, one core: {:.2} ms for 1e6 rows, {:.1} GFMA/s of sums, {share}",
        1e9 * seconds / PART as f64,
        1e-9 * rate
    );
}

/// Times one library on one and two threads; the Gram of the last run.
fn time_case(case: &Case, signals: &[Vec<f64>], peak: Option<f64>) -> (PolynomialPlan, Gram, f64) {
    let all: Vec<&[f64]> = signals.iter().map(Vec::as_slice).collect();
    let (base, targets) = (&all[..case.columns], &all[all.len() - case.targets..]);
    let pilot: Vec<Vec<f64>> =
        all.iter().map(|column| column.iter().step_by(PILOT_STRIDE).copied().collect()).collect();
    let pilot: Vec<&[f64]> = pilot.iter().map(Vec::as_slice).collect();
    let (planning, plan) = best_of(1, || {
        PolynomialPlan::from_pilot(&pilot[..case.columns], &pilot[all.len() - case.targets..], case.degree)
            .expect("a plan")
    });
    println!(
        "m = {}, D = {}, q = {}: {} functions, {} sums a row, condition {:.1}, plan from {} rows {:.1} ms",
        case.columns,
        case.degree,
        case.targets,
        plan.functions(),
        plan.sums(),
        plan.condition(),
        pilot[0].len(),
        1e3 * planning
    );
    kernel_rate(&plan, base, targets, peak);
    let mut result = None;
    let mut fastest = f64::INFINITY;
    for threads in [1, 2] {
        let (seconds, gram) = with_threads(threads, || best_of(REPETITIONS, || scan(&plan, base, targets)));
        println!("  scan, {threads} thread(s): {:7.2} ms", 1e3 * seconds);
        if let Some(before) = result.replace(gram) {
            assert!(Some(&before) == result.as_ref(), "the same bits on any number of threads");
        }
        fastest = fastest.min(seconds);
    }
    (plan, result.expect("two runs"), fastest)
}

/// Numpy on the same rows: times, and the largest difference of the Gram matrices, each entry relative to its diagonal.
fn compare(case: &Case, signals: &[Vec<f64>], plan: &PolynomialPlan, gram: &Gram, ours: f64) {
    let folder = tempfile::tempdir().expect("a folder");
    let (input, output) = (folder.path().join("base.f64"), folder.path().join("gram.f64"));
    write_f64(&input, &signals[..case.columns].concat()).expect("a file for the peer");
    let (columns, degree) = (case.columns.to_string(), case.degree.to_string());
    let answer = match peer("polynomial_gram.py", &[&input, Path::new(&columns), Path::new(&degree), &output]) {
        Ok(answer) => answer,
        Err(reason) => return println!("  numpy: absent ({reason})"),
    };
    let number = |key: &str| answer[key].as_f64().unwrap_or(f64::NAN);
    let product = number("c").min(number("fortran"));
    println!(
        "  numpy {}, {} threads: X.T @ X alone {:.2} ms (C order), {:.2} ms (Fortran order); evaluation and product {:.2} ms; peak {:.0} MiB",
        answer["numpy"].as_str().unwrap_or("?"),
        number("threads"),
        1e3 * number("c"),
        1e3 * number("fortran"),
        1e3 * number("whole"),
        number("peak")
    );
    println!("  ratio to the product alone {:.1}, with evaluation {:.1}", product / ours, number("whole") / ours);
    let (theirs, raw) = (read_f64(&output).expect("the peer's Gram"), raw_gram(plan, gram));
    let d = raw.nrows();
    assert_eq!(theirs.len(), d * d, "one entry a pair");
    let difference = |i: usize, j: usize| (raw[(i, j)] - theirs[i * d + j]).abs() / (raw[(i, i)] * raw[(j, j)]).sqrt();
    let worst = (0..d).flat_map(|i| (0..d).map(move |j| (i, j))).map(|(i, j)| difference(i, j)).fold(0.0, f64::max);
    println!("  largest relative difference of the {} entries of X'X: {worst:.1e}", d * d);
    assert!(worst < 1e-11, "the answers agree");
}

fn main() {
    let signals = signals(6);
    let peak = fma_rate();
    match peak {
        Some(peak) => println!("{ROWS} rows; fused multiply-adds in registers, one core: {:.1} GFMA/s", 1e-9 * peak),
        None => println!("{ROWS} rows"),
    }
    let before = peak_rss_mib();
    let case = Case { columns: 3, degree: 5, targets: 0 };
    let (plan, gram, ours) = time_case(&case, &signals, peak);
    println!("  peak {:.0} MiB, of which {before:.0} MiB are the rows of all cases", peak_rss_mib());
    compare(&case, &signals, &plan, &gram, ours);
    for case in [
        Case { columns: 3, degree: 5, targets: 3 },
        Case { columns: 2, degree: 5, targets: 0 },
        Case { columns: 4, degree: 4, targets: 0 },
        Case { columns: 6, degree: 3, targets: 0 },
    ] {
        time_case(&case, &signals, peak);
    }
}
