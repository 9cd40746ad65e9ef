//! k-means: 1,000,000 x 16, K = 50, 25 iterations from the same start, beside scikit-learn (f64, f32) and faiss (f32).
//!
//! Three kinds of rows, because bounds skip as much as the rows allow:
//! - `gaits`: like a log of a legged robot: a limit cycle of sixteen correlated channels, five gaits at varying
//!   frequencies, in the order of time, with sensor noise. The main case. No cluster structure but a manifold of low
//!   dimension.
//! - `blobs`: fifty Gaussian blobs around random centres, in random order: the usual benchmark, kind to bounds.
//! - `noise`: one isotropic Gaussian: no structure whatever, the worst case.
//!
//! CPU seconds (all threads, mean) are the steadier figure on a busy machine; those of the peers include the spinning of idle OpenMP threads.
//!
//! Bias: every process runs alone and reports its best of three; peers get the rows in their own layout and type before the clock starts, and so do
//! we. Peak memory is that of the process from the finished input on (ours: the rows and the fit). The float32 peers solve an easier problem and stop at other centroids; their inertia is computed in float64 for all. faiss makes all
//! iterations, the others stop at a fixed point.

use std::{error::Error, path::Path};

use faer::{Accum, Mat, Par, linalg::matmul::matmul};
use fleetfoot_benches::{best_of, cpu_seconds, peak_rss_mib, peer, read_f64, reset_peak_rss, write_f64};
use fleetfoot_data::{Cancelled, Silent, parallel_map, thread_count};
use fleetfoot_pwa::{KMeansOptions, Points, Start, kmeans};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const N: usize = 1_000_000;
const D: usize = 16;
const K: usize = 50;
const ITERATIONS: usize = 25;
/// As many as the peers make.
const REPEATS: usize = 3;

fn main() -> Result<(), Box<dyn Error>> {
    let rate = product_rate();
    println!("k-means, {N} x {D}, K = {K}, {ITERATIONS} iterations, {} threads", thread_count());
    println!("f64 products of faer on all threads: {rate:.1} GFMA/s");
    // Cargo hands its own arguments over; names choose cases.
    let selected: Vec<String> = std::env::args().skip(1).filter(|argument| !argument.starts_with('-')).collect();
    for (name, rows) in [("gaits", gaits as fn() -> Vec<Vec<f64>>), ("blobs", blobs), ("noise", noise)] {
        if selected.is_empty() || selected.iter().any(|selected| selected == name) {
            case(name, rows(), rate)?;
        }
    }
    Ok(())
}

/// One line of the table.
struct Line {
    who: String,
    seconds: f64,
    cpu: f64,
    seeding: f64,
    iterations: u64,
    peak: f64,
    inertia: f64,
    centroids: Vec<f64>,
}

fn case(name: &str, columns: Vec<Vec<f64>>, rate: f64) -> Result<(), Box<dyn Error>> {
    let folder = tempfile::tempdir()?;
    let slices: Vec<&[f64]> = columns.iter().map(Vec::as_slice).collect();
    let (build, points) = best_of(3, || Points::from_columns(&slices, &[0.0; D], &[1.0; D]));
    let points = points?;
    drop(columns);
    let rows: Vec<f64> = (0..N).flat_map(|row| points.row(row)).collect();
    write_f64(&folder.path().join("rows.f64"), &rows)?;
    drop(rows);
    let start: Vec<f64> = (0..K).flat_map(|k| points.row((k * 19_997 + 123) % N)).collect();
    write_f64(&folder.path().join("start.f64"), &start)?;

    let ours = fit(&points, &start)?;
    println!("\n{name} (rows put into place in {build:.3} s)");
    println!("                  seconds   ratio    CPU s  k-means++  iter.  peak MiB            inertia     max |dc|");
    print(&ours, &ours);
    for who in ["sklearn64", "sklearn32", "faiss32"] {
        match other(who, folder.path()) {
            Err(reason) => println!("{who:<17} absent: {reason}"),
            Ok(theirs) => {
                let difference = print(&theirs, &ours);
                let same = difference <= 1e-9 && ours.inertia <= theirs.inertia * (1.0 + 1e-12);
                if who == "sklearn64" && !same {
                    return Err(format!("{name}: the answer is not that of scikit-learn").into());
                }
            }
        }
    }
    let work = (N * D * K) as f64 * (ours.iterations + 1) as f64 * 1e-9;
    println!(
        "plain Lloyd needs {work:.1} GFMA, {:.3} s at the rate of f64 products; this run took {:.2} of that",
        work / rate,
        ours.seconds * rate / work
    );
    Ok(())
}

/// Prints a line of the table; the largest difference of a coordinate of a centroid.
fn print(line: &Line, ours: &Line) -> f64 {
    let pairs = line.centroids.iter().zip(&ours.centroids);
    let difference = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    println!(
        "{:<17} {:>7.3} {:>7.2} {:>8.2} {:>10.3} {:>6} {:>9.0} {:>18.9e} {difference:>12.1e}",
        line.who,
        line.seconds,
        line.seconds / ours.seconds,
        line.cpu,
        line.seeding,
        line.iterations,
        line.peak,
        line.inertia,
    );
    difference
}

fn fit(points: &Points, start: &[f64]) -> Result<Line, Box<dyn Error>> {
    reset_peak_rss();
    let options = KMeansOptions { k: K, max_iterations: ITERATIONS, tolerance: 0.0 };
    let busy = cpu_seconds();
    let (seconds, clustering) = best_of(REPEATS, || kmeans(points, Start::Centroids(start), &options, &Silent));
    let cpu = (cpu_seconds() - busy) / REPEATS as f64;
    let clustering = clustering?;
    // Without iterations what remains is the seeding and one assignment.
    let none = KMeansOptions { max_iterations: 0, ..options };
    let seeded = Start::PlusPlus { seed: 1, restarts: 1 };
    let (both, checked) = best_of(3, || kmeans(points, seeded, &none, &Silent));
    checked?;
    let (assignment, _) = best_of(3, || kmeans(points, Start::Centroids(start), &none, &Silent));
    Ok(Line {
        who: "fleetfoot f64".into(),
        seconds,
        cpu,
        seeding: both - assignment,
        iterations: clustering.iterations as u64,
        peak: peak_rss_mib(),
        inertia: clustering.inertia,
        centroids: clustering.centroids,
    })
}

fn other(who: &str, folder: &Path) -> Result<Line, String> {
    let numbers = [N, D, K, ITERATIONS].map(|value| value.to_string());
    let mut arguments: Vec<&Path> = vec![folder, Path::new(who)];
    arguments.extend(numbers.iter().map(Path::new));
    let answer = peer("kmeans.py", &arguments)?;
    let number = |key: &str| answer[key].as_f64().unwrap_or(f64::NAN);
    Ok(Line {
        who: format!("{who} {}", answer["version"].as_str().unwrap_or_default()),
        seconds: number("seconds"),
        cpu: number("cpu"),
        seeding: number("seeding"),
        iterations: number("iterations") as u64,
        peak: number("peak_mib"),
        inertia: number("inertia"),
        centroids: read_f64(&folder.join(format!("{who}.f64"))).map_err(|error| error.to_string())?,
    })
}

/// GFMA/s of large f64 products, one on every thread.
fn product_rate() -> f64 {
    let m = 1024;
    let a = Mat::from_fn(m, m, |i, j| ((i * 7 + j * 3) % 11) as f64);
    let product = |_| {
        let mut c = Mat::<f64>::zeros(m, m);
        matmul(c.as_mut(), Accum::Replace, a.as_ref(), a.as_ref(), 1.0, Par::Seq);
        Ok::<_, Cancelled>(c[(m - 1, m - 1)])
    };
    let (seconds, _) = best_of(5, || parallel_map(thread_count(), &Silent, product));
    (thread_count() * m * m * m) as f64 * 1e-9 / seconds
}

fn gaussian(random: &mut Pcg64) -> f64 {
    // Box and Muller; 1 - u is never zero.
    let (u, v): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

fn standardise(columns: &mut [Vec<f64>]) {
    for column in columns {
        let mean = column.iter().sum::<f64>() / N as f64;
        let deviation = (column.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / N as f64).sqrt();
        column.iter_mut().for_each(|x| *x = (*x - mean) / deviation);
    }
}

fn gaits() -> Vec<Vec<f64>> {
    let mut random = Pcg64::seed_from_u64(1);
    let mut columns = vec![Vec::new(); D];
    // Amplitude and phase of three harmonics, per gait and channel.
    let shapes: Vec<[[f64; 6]; D]> = (0..5)
        .map(|_| std::array::from_fn(|_| std::array::from_fn(|h| gaussian(&mut random) / (1.0 + (h / 2) as f64))))
        .collect();
    let (mut phase, mut gait, mut speed) = (0.0f64, 0, 1.0f64);
    for row in 0..N {
        if row % 5000 == 0 {
            gait = random.random_range(0..shapes.len());
        }
        speed += 0.002 * (1.0 - speed) + 0.01 * gaussian(&mut random);
        phase += std::f64::consts::TAU * 4.0 * (1.0 + 0.1 * speed) * 0.002;
        for (column, shape) in columns.iter_mut().zip(&shapes[gait]) {
            let cycle: f64 = (0..3)
                .map(|h| {
                    let angle = (h + 1) as f64 * phase;
                    shape[2 * h] * angle.sin() + shape[2 * h + 1] * angle.cos()
                })
                .sum();
            column.push(speed * cycle + 0.3 * gaussian(&mut random));
        }
    }
    standardise(&mut columns);
    columns
}

fn blobs() -> Vec<Vec<f64>> {
    let mut random = Pcg64::seed_from_u64(2);
    let centres: Vec<[f64; D]> = (0..K).map(|_| std::array::from_fn(|_| random.random_range(-10.0..10.0))).collect();
    let mut columns = vec![Vec::new(); D];
    for _ in 0..N {
        let centre = &centres[random.random_range(0..K)];
        for (column, centre) in columns.iter_mut().zip(centre) {
            column.push(centre + 2.0 * gaussian(&mut random));
        }
    }
    standardise(&mut columns);
    columns
}

fn noise() -> Vec<Vec<f64>> {
    let mut random = Pcg64::seed_from_u64(3);
    let mut columns: Vec<Vec<f64>> = (0..D).map(|_| (0..N).map(|_| gaussian(&mut random)).collect()).collect();
    standardise(&mut columns);
    columns
}
