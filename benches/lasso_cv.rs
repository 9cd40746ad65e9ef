//! A lasso path with 10-fold cross-validation on 1,000,000 dense rows of 100 columns in memory, beside scikit-learn's `LassoLarsCV` and `LassoCV`,
//! and beside adelie's single path (`grpnet` without cross-validation). All cores for everybody.
//!
//! Ours is one pass for the centred Gram matrices of the ten folds, and eleven LARS paths: ten that leave a fold out,
//! one of all rows. Then follow the held-out errors of every fold at every knot of all ten paths.
//!
//! Answers are checked: the mean held-out error at every knot against `LassoLarsCV`'s, the lambda that it chooses, the coefficients there, and
//! adelie's coefficients with our certificate.
//!
//! Bias: rows lie in memory by columns, the layout of the peers too (Fortran order). They get the array unchanged, and
//! may overwrite nothing. Folds are contiguous, as scikit-learn's `KFold` cuts them. adelie's path is that of a grid of
//! 100 lambdas without cross-validation, at its default tolerance. The physical limits are `n p^2 / 2` multiply-adds
//! and one reading of 0.8 GB.

use std::{error::Error, path::Path};

use faer::Mat;
use fleetfoot_benches::{best_of, peak_rss_mib, peer, read_f64, write_f64};
use fleetfoot_data::{Column, Halo, MemorySource, Silent, Source, parallel_map};
use fleetfoot_sparse::{
    Path as LassoPath, Penalty, Quadratic, Strength, certificate,
    lars::{LarsOptions, lars},
    select::{HeldOut, Lambdas, SelectOptions, Split, cross_validate_problems},
};
use fleetfoot_stats::{Bank, FoldLayout, FoldRule, Gram, Grid, Preconditioner, Purge, reduce};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;

const ROWS: usize = 1_000_000;
const COLUMNS: usize = 100;
const FOLDS: u16 = 10;
const REPEATS: usize = 7;

/// A path with its held-out errors.
struct Selected {
    path: LassoPath,
    /// Lambdas of all knots of the folds' paths, decreasing.
    lambdas: Vec<f64>,
    /// Mean over the folds of the held-out mean squared error at every lambda.
    errors: Vec<f64>,
    /// Index of the least.
    best: usize,
    coefficients: Vec<f64>,
}

type Failure = Box<dyn Error + Send + Sync>;

fn main() -> Result<(), Failure> {
    let columns = make();
    let folder = tempfile::tempdir()?;
    let flat: Vec<f64> = columns.concat();
    write_f64(&folder.path().join("columns.f64"), &flat)?;
    drop(flat);
    let mut source = MemorySource::new((0..=COLUMNS).map(|j| Column::float(format!("c{j}"))).collect());
    source.push_uniform("rows", 1e-3, columns);
    println!("lasso with {FOLDS}-fold cross-validation, {ROWS} x {COLUMNS}; seconds, best of {REPEATS}");
    let (pass, folds) = best_of(REPEATS, || scan(&source));
    let folds = folds?;
    let (solve, selected) = best_of(REPEATS, || select(&folds));
    let selected = selected?;
    let (whole, again) = best_of(REPEATS, || scan(&source).and_then(|folds| select(&folds)));
    if again?.coefficients != selected.coefficients {
        return Err("two runs have not the same bits".into());
    }
    let kkt = selected.path.knots.iter().map(|knot| knot.certificate.kkt).fold(0.0, f64::max);
    println!(
        "fleetfoot                  {whole:>8.3} s   (pass {pass:.3}, paths and errors {solve:.3}), kkt {kkt:.1e}"
    );
    println!(
        "    {:.1} giga multiply-adds a second in the pass, {:.1} GB/s",
        (ROWS * (COLUMNS + 1) * (COLUMNS + 2) / 2) as f64 / pass * 1e-9,
        (8 * ROWS * (COLUMNS + 1)) as f64 / pass * 1e-9
    );
    println!(
        "    peak memory {:.0} MiB, rows {:.0} MiB",
        peak_rss_mib(),
        (8 * ROWS * (COLUMNS + 1)) as f64 / 1048576.0
    );
    let all = Bank::new(&folds).total();
    let problem = Quadratic::from_gram(&all, &(0..COLUMNS).collect::<Vec<_>>(), COLUMNS)?;
    drop(source);
    for name in ["LassoLarsCV", "LassoCV", "adelie"] {
        match peer("lasso_cv.py", &[folder.path(), Path::new(name), Path::new(&ROWS.to_string())]) {
            Err(reason) => println!("{name:<18} absent: {reason}"),
            Ok(answer) => {
                let seconds = answer["seconds"].as_f64().unwrap_or(f64::NAN);
                let version = answer["version"].as_str().unwrap_or_default();
                println!("{name:<12} {version:<12} {seconds:>9.3} s   {:.1} times ours", seconds / whole);
                check(name, &answer, &selected, &problem, folder.path())?;
            }
        }
    }
    Ok(())
}

/// The centred Gram matrix of every fold, in one pass.
fn scan(source: &MemorySource) -> Result<Vec<Gram>, Failure> {
    let lengths = source.episodes().iter().map(|episode| (episode.id, episode.rows));
    let layout = FoldLayout::new(FoldRule::Count(FOLDS.into()), lengths, Purge::Exactly(0))?;
    let chunks = Grid { chunk_rows: ROWS / usize::from(FOLDS) }.chunks_in(&layout, source.episodes());
    let mut folds = vec![Gram::new(COLUMNS + 1); usize::from(FOLDS)];
    reduce(
        source,
        &chunks,
        Halo::default(),
        &Silent,
        || Gram::new(COLUMNS + 1),
        |gram, _, block, rows| {
            let columns: Vec<&[f64]> = (0..=COLUMNS).map(|j| &block.core(j)[rows.clone()]).collect();
            gram.merge(&Gram::of_columns(&columns, None));
            Ok::<_, Failure>(())
        },
        |chunk, gram| {
            folds[usize::from(chunk.fold.held_out)].merge(&gram);
            Ok(())
        },
    )?;
    Ok(folds)
}

/// Ten paths that leave a fold out and one of all rows, and the held-out errors of the ten at the knots of all of them.
fn select(folds: &[Gram]) -> Result<Selected, Failure> {
    let count = folds.len();
    let training =
        Bank::new(folds).combine(Mat::from_fn(count, count + 1, |k, b| f64::from(u8::from(k != b))).as_ref());
    let columns: Vec<usize> = (0..COLUMNS).collect();
    let penalty = Penalty::default();
    // Rows of condition 10: the Gram form is as good as the square-root form.
    let problem = |gram: &Gram| Quadratic::from_gram(gram, &columns, COLUMNS);
    let splits = parallel_map(count, &Silent, |k| {
        let held_out = Preconditioner::identity(COLUMNS, 1).square_root(&folds[k]);
        let test = HeldOut::target(held_out, 0)?;
        Ok::<_, Failure>(Split { train: problem(&training[k])?, penalty: penalty.clone(), test })
    })?;
    let full = problem(&training[count])?;
    let options = SelectOptions { lambdas: Lambdas::Knots, ..SelectOptions::default() };
    let validated = cross_validate_problems((&full, &penalty), &splits, false, &options, &Silent)?;
    let path = lars(&full, &penalty, &LarsOptions::default())?;
    let coefficients = path.coefficients(validated.lambdas[validated.best])?;
    Ok(Selected { path, lambdas: validated.lambdas, errors: validated.mean, best: validated.best, coefficients })
}

fn check(
    name: &str,
    answer: &serde_json::Value,
    ours: &Selected,
    problem: &Quadratic,
    folder: &Path,
) -> Result<(), Failure> {
    let coefficients = read_f64(&folder.join("coefficients.f64"))?;
    let alpha = answer["alpha"].as_f64().unwrap_or(f64::NAN);
    let largest = ours.coefficients.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
    let apart =
        |values: &[f64]| coefficients.iter().zip(values).map(|(a, b)| (a - b).abs() / largest).fold(0.0, f64::max);
    let kkt = certificate(problem, &Penalty::default(), Strength::lasso(alpha), &coefficients)?.kkt;
    let same = apart(&ours.path.coefficients(alpha)?);
    println!("    at its lambda {alpha:.3e}: coefficients {same:.1e} apart, its kkt {kkt:.1e}");
    match name {
        "LassoLarsCV" => {
            let (alphas, theirs) = (read_f64(&folder.join("alphas.f64"))?, read_f64(&folder.join("errors.f64"))?);
            let at =
                |alpha: f64| ours.lambdas.iter().position(|lambda| (lambda - alpha).abs() <= 1e-9 * ours.lambdas[0]);
            let pairs = alphas.iter().zip(&theirs).filter_map(|(&alpha, error)| Some((ours.errors[at(alpha)?], error)));
            let worst = pairs.clone().map(|(a, b)| (a - b).abs() / b).fold(0.0, f64::max);
            let chosen = (alpha - ours.lambdas[ours.best]).abs() / ours.lambdas[0];
            println!(
                "    {} of {} errors compared, {worst:.1e} apart; lambdas chosen {chosen:.1e} apart",
                pairs.count(),
                alphas.len()
            );
            if worst > 1e-9 || chosen > 1e-9 || apart(&ours.coefficients) > 1e-7 {
                return Err("the answer is not that of LassoLarsCV".into());
            }
        }
        "LassoCV" if same > 1e-3 => return Err("LassoCV is elsewhere".into()),
        "adelie" if same > 1e-2 => return Err("adelie is elsewhere".into()),
        _ => {}
    }
    Ok(())
}

fn gaussian(random: &mut Pcg64Mcg) -> f64 {
    // Box and Muller; 1 - u is never zero.
    let (u, v): (f64, f64) = (random.random(), random.random());
    (-2.0 * (1.0 - u).ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}

/// Columns that share factors, a fifth of which made the target, with noise; the target last.
fn make() -> Vec<Vec<f64>> {
    let mut random = Pcg64Mcg::seed_from_u64(100);
    let factors: Vec<Vec<f64>> = (0..5).map(|_| (0..ROWS).map(|_| gaussian(&mut random)).collect()).collect();
    let mut columns: Vec<Vec<f64>> = Vec::new();
    let mut y: Vec<f64> = (0..ROWS).map(|_| 3.0 + 20.0 * gaussian(&mut random)).collect();
    for j in 0..COLUMNS {
        let loadings: Vec<f64> = factors.iter().map(|_| 0.4 * gaussian(&mut random)).collect();
        let shared = |i: usize| factors.iter().zip(&loadings).map(|(factor, loading)| factor[i] * loading).sum::<f64>();
        let column: Vec<f64> = (0..ROWS).map(|i| 1.0 + shared(i) + gaussian(&mut random)).collect();
        if j.is_multiple_of(5) {
            let effect = gaussian(&mut random);
            y.iter_mut().zip(&column).for_each(|(y, x)| *y += effect * x);
        }
        columns.push(column);
    }
    columns.push(y);
    columns
}
