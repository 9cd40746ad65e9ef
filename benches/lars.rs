//! Regularisation paths on one Gram matrix: LARS with 100 and 1,000 columns beside scikit-learn's `lars_path_gram`, and coordinate descent over 100
//! lambdas beside its `enet_path` with the Gram matrix precomputed. One core.
//!
//! Columns share factors, so that they are correlated as a library of candidate functions is; a tenth of them made the target, with noise.
//!
//! Every answer is checked: paths knot by knot, and the solutions of the peer with our certificate, from the same
//! moments. Times include the work before the first step (normalisation here, copies there) and, for us, the
//! certificate of every knot, which the peer does not compute.
//!
//! Bias: `enet_path` needs the rows beside the Gram matrix and gets them. It stops at its duality gap, `tol` of y'y,
//! and we at a KKT violation of 1e-11, which is printed for both.

use std::{error::Error, path::Path};

use faer::Mat;
use fleetfoot_benches::{best_of, peer, read_f64, write_f64};
use fleetfoot_sparse::{
    Penalty, Quadratic, Strength, certificate,
    coordinate::{CoordinateOptions, coordinate_descent, lambda_grid},
    lars::{LarsOptions, lars},
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const REPEATS: usize = 3;
const LAMBDAS: usize = 100;
/// The smallest lambda over the largest.
const RATIO: f64 = 1e-3;

/// Centred rows and their moments.
struct Data {
    n: usize,
    p: usize,
    /// Row-major.
    rows: Vec<f64>,
    y: Vec<f64>,
    gram: Mat<f64>,
    xy: Vec<f64>,
    yy: f64,
}

fn main() -> Result<(), Box<dyn Error>> {
    println!("paths on one Gram matrix; seconds, best of {REPEATS}");
    for (n, p) in [(2_000, 100), (4_000, 1_000)] {
        let data = make(n, p);
        let folder = tempfile::tempdir()?;
        write(&data, folder.path())?;
        path(&data, folder.path())?;
        descent(&data, folder.path())?;
    }
    Ok(())
}

fn problem(data: &Data) -> Result<Quadratic, Box<dyn Error>> {
    Ok(Quadratic::from_products(data.gram.as_ref(), &data.xy, data.yy, data.n as f64)?)
}

/// Largest difference of coefficients, in units of the largest.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let scale = a.iter().chain(b).fold(f64::MIN_POSITIVE, |scale, value| scale.max(value.abs()));
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / scale).fold(0.0, f64::max)
}

fn path(data: &Data, folder: &Path) -> Result<(), Box<dyn Error>> {
    let (n, p) = (data.n, data.p);
    let (seconds, solution) =
        best_of(REPEATS, || lars(&problem(data).expect("moments"), &Penalty::default(), &LarsOptions::default()));
    let solution = solution?;
    let worst = solution.knots.iter().map(|knot| knot.certificate.kkt).fold(0.0, f64::max);
    println!("\nLARS (lasso), {p} columns: whole path");
    println!("fleetfoot           {seconds:>9.4} s  {:>5} knots  kkt {worst:.1e}", solution.knots.len());
    let rows = faer::MatRef::from_row_major_slice(&data.rows, n, p);
    // The factor of the rows is the business of the scan: not timed.
    let problem = Quadratic::from_rows(rows, &data.y, None, false)?;
    let (seconds_root, root) = best_of(REPEATS, || lars(&problem, &Penalty::default(), &LarsOptions::default()));
    let worst = root?.knots.iter().map(|knot| knot.certificate.kkt).fold(0.0, f64::max);
    println!("the same from R, z  {seconds_root:>9.4} s               kkt {worst:.1e}");
    match other("lars", data, folder) {
        Err(reason) => println!("scikit-learn        absent: {reason}"),
        Ok((version, theirs)) => {
            let alphas = read_f64(&folder.join("alphas.f64"))?;
            let coefficients = read_f64(&folder.join("coefficients.f64"))?;
            let mut apart = 0.0_f64;
            for (alpha, theirs) in alphas.iter().zip(coefficients.chunks_exact(p)) {
                apart = apart.max(difference(&solution.coefficients(*alpha)?, theirs));
            }
            let (knots, ratio) = (alphas.len(), theirs / seconds);
            println!(
                "scikit-learn {version}  {theirs:>9.4} s  {knots:>5} knots  {ratio:.1} times ours, {apart:.1e} apart"
            );
            if apart > 1e-7 || knots != solution.knots.len() {
                return Err("the path is not that of scikit-learn".into());
            }
        }
    }
    Ok(())
}

fn descent(data: &Data, folder: &Path) -> Result<(), Box<dyn Error>> {
    let p = data.p;
    let penalty = Penalty::default();
    let lambdas = lambda_grid(&problem(data)?, &penalty, 1.0, LAMBDAS, RATIO)?;
    let options = CoordinateOptions::default();
    let (seconds, solutions) =
        best_of(REPEATS, || coordinate_descent(&problem(data).expect("moments"), &penalty, &lambdas, &options));
    let solutions = solutions?;
    let worst = |kkt: &mut dyn Iterator<Item = f64>| kkt.fold(0.0, f64::max);
    let ours = worst(&mut solutions.iter().map(|solution| solution.certificate.kkt));
    println!("\ncoordinate descent, {p} columns, {LAMBDAS} lambdas down to {RATIO} of the largest");
    println!("fleetfoot                      {seconds:>9.4} s  kkt {ours:.1e}");
    if ours > 1e-8 {
        return Err("coordinate descent did not converge".into());
    }
    write_f64(&folder.join("lambdas.f64"), &lambdas)?;
    for name in ["enet 1e-4", "enet 1e-8", "enet 1e-12"] {
        match other(name, data, folder) {
            Err(reason) => println!("scikit-learn        absent: {reason}"),
            Ok((version, theirs)) => {
                let coefficients = read_f64(&folder.join("coefficients.f64"))?;
                let (mut apart, mut kkt) = (0.0_f64, 0.0_f64);
                let problem = problem(data)?;
                for (k, theirs) in coefficients.chunks_exact(p).enumerate() {
                    apart = apart.max(difference(&solutions[k].dense(p), theirs));
                    kkt = kkt.max(certificate(&problem, &penalty, Strength::lasso(lambdas[k]), theirs)?.kkt);
                }
                let ratio = theirs / seconds;
                println!(
                    "scikit-learn {version}, {name:<10}  {theirs:>9.4} s  kkt {kkt:.1e}  {ratio:.1} times ours, {apart:.1e} apart"
                );
                if name.ends_with("1e-12") && apart > 1e-5 {
                    return Err("the solutions are not those of scikit-learn".into());
                }
            }
        }
    }
    Ok(())
}

/// Version and seconds of the peer.
fn other(name: &str, data: &Data, folder: &Path) -> Result<(String, f64), String> {
    let numbers = [data.n, data.p].map(|value| value.to_string());
    let answer = peer("lars.py", &[folder, Path::new(name), Path::new(&numbers[0]), Path::new(&numbers[1])])?;
    let version = answer["version"].as_str().unwrap_or_default().to_owned();
    Ok((version, answer["seconds"].as_f64().unwrap_or(f64::NAN)))
}

fn gaussian(random: &mut Pcg64) -> f64 {
    // Box and Muller; 1 - u is never zero.
    let (u, v): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

fn make(n: usize, p: usize) -> Data {
    let mut random = Pcg64::seed_from_u64(p as u64);
    let factors = 10;
    let loadings: Vec<f64> = (0..factors * p).map(|_| 0.4 * gaussian(&mut random)).collect();
    let truth: Vec<f64> = (0..p).map(|j| if j.is_multiple_of(10) { gaussian(&mut random) } else { 0.0 }).collect();
    let mut x = Mat::zeros(n, p);
    let mut y = vec![0.0; n];
    for i in 0..n {
        let common: Vec<f64> = (0..factors).map(|_| gaussian(&mut random)).collect();
        for j in 0..p {
            let shared: f64 = (0..factors).map(|k| common[k] * loadings[k * p + j]).sum();
            x[(i, j)] = shared + gaussian(&mut random);
            y[i] += x[(i, j)] * truth[j];
        }
        y[i] += 2.0 * gaussian(&mut random);
    }
    for j in 0..p {
        let mean = (0..n).map(|i| x[(i, j)]).sum::<f64>() / n as f64;
        (0..n).for_each(|i| x[(i, j)] -= mean);
    }
    let mean = y.iter().sum::<f64>() / n as f64;
    y.iter_mut().for_each(|y| *y -= mean);
    let gram = x.transpose() * &x;
    let xy = (0..p).map(|j| (0..n).map(|i| x[(i, j)] * y[i]).sum()).collect();
    let rows = (0..n).flat_map(|i| (0..p).map(move |j| (i, j))).map(|at| x[at]).collect();
    Data { n, p, rows, yy: y.iter().map(|y| y * y).sum(), y, gram, xy }
}

fn write(data: &Data, folder: &Path) -> std::io::Result<()> {
    let gram: Vec<f64> = (0..data.p).flat_map(|j| data.gram.col_as_slice(j).to_vec()).collect();
    write_f64(&folder.join("rows.f64"), &data.rows)?;
    write_f64(&folder.join("y.f64"), &data.y)?;
    write_f64(&folder.join("gram.f64"), &gram)?;
    write_f64(&folder.join("xy.f64"), &data.xy)
}
