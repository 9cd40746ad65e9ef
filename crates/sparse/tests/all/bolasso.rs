//! Bolasso and stability selection against plain solves of every replicate.

use crate::common::gaussian;
use faer::Mat;
use fleetfoot_data::{Column, Halo, MemorySource, Silent, Source, with_threads};
use fleetfoot_library::{Design, DesignRows, Expr, Scope};
use fleetfoot_sparse::{
    bolasso::{
        BolassoError, BootstrapOptions, BootstrapUnit, Selection, StabilityOptions, bach_lambda, block_bootstrap,
        multinomial_counts, poisson_counts, refit, row_bootstrap, stability_selection,
    },
    lars::{LarsOptions, lars},
    structured::{Assembly, Tikhonov, assemble},
};
use fleetfoot_stats::{Factor, SquareRoot};
use fleetfoot_sums::structured::{Banks, Candidates, Plan, Regression, Structure, Task, Term};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

const COLUMNS: [&str; 7] = ["a", "b", "c", "y1", "y2", "y3", "w"];

/// Episodes of unequal length in which y1 = f + cos(c) g, y2 = 2 g' - f (1 + b), with g and g' of the same library; some values are missing.
fn source(seed: u64, lengths: &[usize], missing: bool) -> MemorySource {
    let mut rng = Pcg64::seed_from_u64(seed);
    let mut source = MemorySource::new(COLUMNS.iter().map(|&name| Column::float(name)).collect());
    for &length in lengths {
        let mut values = vec![Vec::new(); COLUMNS.len()];
        for row in 0..length {
            let [a, b, c] = [2.0 + gaussian(&mut rng), gaussian(&mut rng), gaussian(&mut rng)];
            let f = 3.0 * a - a * a * b;
            let g = 0.5 * c * c + 1.5;
            let y1 = f + c.cos() * g + 0.3 * gaussian(&mut rng);
            let y2 = 2.0 * g - f * (1.0 + b) + 0.3 * gaussian(&mut rng);
            let y3 = g + 0.2 * gaussian(&mut rng);
            let a = if missing && row % 17 == 5 { f64::NAN } else { a };
            for (column, value) in values.iter_mut().zip([a, b, c, y1, y2, y3, rng.random_range(0.5..2.0)]) {
                column.push(value);
            }
        }
        source.push_uniform(format!("episode {length}"), 0.1, values);
    }
    source
}

fn parse(text: &str) -> Expr {
    Expr::parse(text, &Scope::new(COLUMNS)).expect("an expression")
}

fn candidates(name: &str, functions: &[&str]) -> Candidates {
    Candidates { name: name.into(), functions: functions.iter().map(|text| parse(text)).collect() }
}

fn task(target: &str, terms: &[(usize, &str)], prior: bool) -> Task {
    let terms = terms.iter().map(|&(latent, text)| Term { latent, coefficient: parse(text) }).collect();
    Task { name: target.into(), target: parse(target), terms, prior }
}

/// Three latents in two tasks and a prior; the second and the third have one library, with a constant.
fn regression(weight: bool) -> Regression {
    let library = ["1", "c", "c^2", "c^3"];
    Regression {
        latents: vec![
            candidates("f", &["a", "a*b", "a^2", "a^2*b", "b^3"]),
            candidates("g", &library),
            candidates("h", &library),
        ],
        tasks: vec![
            task("y1", &[(0, "1"), (1, "cos(c)")], false),
            task("y2", &[(0, "-(1 + b)"), (2, "2")], false),
            task("y3", &[(2, "1")], true),
        ],
        weight: weight.then(|| parse("w")),
    }
}

fn assembly() -> Assembly {
    Assembly { weights: vec![0.05, 0.02, 0.003], ..Assembly::default() }
}

/// The square-root forms of all tasks from the rows, each repeated as often as its episode's counts say (`count(episode, row)`), by Householder QR.
fn repeated(regression: &Regression, source: &dyn Source, count: impl Fn(usize, usize) -> f64) -> Vec<SquareRoot> {
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let tasks = (0..regression.tasks.len()).map(|task| regression.columns(task));
    let widths: Vec<usize> = tasks.clone().map(|columns| columns.len()).collect();
    let all: Vec<Expr> = tasks.flatten().chain(regression.weight.clone()).collect();
    let design = Design::compile(&all, &names).expect("columns");
    let mut factors: Vec<Factor> = widths.iter().map(|width| Factor::new(width - 1, 1)).collect();
    for (episode, info) in source.episodes().iter().enumerate() {
        let block = source.read(episode, 0..info.rows, Halo::default()).expect("rows");
        let mut rows = DesignRows::default();
        design.evaluate(&block, 0..info.rows, &mut rows);
        // Repetition itself, not a weight.
        let drawn: Vec<usize> =
            (0..rows.rows()).flat_map(|at| vec![at; count(episode, rows.index[at]) as usize]).collect();
        let weights: Option<Vec<f64>> =
            regression.weight.as_ref().map(|_| drawn.iter().map(|&at| rows.output(all.len() - 1)[at]).collect());
        let mut first = 0;
        for (factor, width) in factors.iter_mut().zip(&widths) {
            let x = Mat::from_fn(drawn.len(), *width, |i, j| rows.output(first + j)[drawn[i]]);
            factor.push(x.as_ref(), weights.as_deref());
            first += width;
        }
    }
    factors.iter().map(Factor::square_root).collect()
}

/// The lasso of one replicate the long way.
fn lasso(structure: &Structure, roots: &[SquareRoot], assembly: &Assembly, lambda: f64) -> (Vec<f64>, f64) {
    let assembled = assemble(structure, roots, assembly).expect("a problem");
    let options = LarsOptions { lambda_min: lambda, ..LarsOptions::default() };
    let path = lars(&assembled.problem, &assembled.penalty, &options).expect("a path");
    let end = path.at(&assembled.problem, lambda).expect("the end of the path");
    assert!(end.certificate.kkt < 1e-9, "{:?}", end.certificate);
    (assembled.coefficients(&end), assembled.problem.weight())
}

/// Largest difference of coefficients, in units of each column's largest over the replicates.
fn compare(selection: &Selection, replicate: usize, expected: &[f64], tolerance: f64) {
    for (j, expected) in expected.iter().enumerate() {
        let largest = selection.coefficients.col_as_slice(j).iter().fold(expected.abs(), |a, b| a.max(b.abs()));
        let ours = selection.coefficients[(replicate, j)];
        assert!((ours - expected).abs() <= tolerance * largest, "replicate {replicate}, column {j}: {ours} {expected}");
        assert_eq!(ours != 0.0, *expected != 0.0, "replicate {replicate}, column {j}");
    }
}

fn gamma(p: usize) -> Tikhonov {
    Tikhonov {
        strength: 3.0,
        gamma: Mat::from_fn(2, p, |i, j| if i == 0 { 0.1 * (j as f64 + 1.0).sin() } else { f64::from(j == 3) }),
        prior: (0..p).map(|j| 0.2 * j as f64).collect(),
    }
}

#[test]
fn row_replicate_is_lasso_of_repeated_rows() {
    for (seed, weight, tikhonov, lambda) in [(1, false, false, 0.05), (2, true, false, 0.02), (3, true, true, 0.005)] {
        let source = source(seed, &[120, 61, 1, 230], true);
        let regression = regression(weight);
        let mut assembly = assembly();
        assembly.tikhonov = tikhonov.then(|| gamma(regression.coefficients()));
        assembly.latents = vec![1.0, 0.5, 2.0];
        let plan = Plan::new(regression.clone(), Vec::new(), 100, &source).expect("a plan");
        let options = BootstrapOptions { replicates: 9, seed, ..BootstrapOptions::new(lambda) };
        let bootstrap = row_bootstrap(&plan, &assembly, &source, &options, &Silent).expect("a selection");
        assert!(bootstrap.worst_kkt < 1e-9 && bootstrap.stalled == 0 && bootstrap.empty == 0);
        let counts: Vec<Mat<f64>> =
            source.episodes().iter().map(|info| poisson_counts(seed, info.id, 0, info.rows, 9)).collect();
        for replicate in 0..9 {
            let roots = repeated(&regression, &source, |episode, row| counts[episode][(replicate, row)]);
            let (expected, n) = lasso(&regression.structure(), &roots, &assembly, lambda);
            compare(&bootstrap, replicate, &expected, 1e-9);
            assert!((bootstrap.weights[replicate] / n - 1.0).abs() < 1e-12);
        }
        // The summary is that of the coefficients.
        for j in 0..regression.coefficients() {
            let selected = (0..9).filter(|&k| bootstrap.coefficients[(k, j)] != 0.0).count();
            assert_eq!(bootstrap.frequency[j], selected as f64 / 9.0);
            assert_eq!(bootstrap.support(1.0).contains(&j), selected == 9);
            assert_eq!(bootstrap.support(5.0 / 9.0).contains(&j), selected >= 5);
        }
        assert_eq!(bootstrap.support, bootstrap.support(1.0));
        assert!(bootstrap.sizes.iter().sum::<usize>() > 0);
    }
}

#[test]
fn block_replicate_is_lasso_of_reweighted_statistic() {
    for (unit, tikhonov, weight) in
        [(BootstrapUnit::Episode, true, true), (BootstrapUnit::Chunk, false, false), (BootstrapUnit::Chunk, true, true)]
    {
        let source = source(4, &[80, 61, 90, 55, 70, 40, 66, 93], true);
        let regression = regression(weight);
        let structure = regression.structure();
        let mut assembly = assembly();
        assembly.tikhonov = tikhonov.then(|| gamma(regression.coefficients()));
        let plan = Plan::new(regression, Vec::new(), 32, &source).expect("a plan");
        let banks = Banks::new(&plan.scan(&source, &Silent).expect("a scan"), |_| true);
        let options = BootstrapOptions { replicates: 40, seed: 11, ..BootstrapOptions::new(0.01) };
        let bootstrap = block_bootstrap(&structure, &banks, &assembly, unit, &options, &Silent).expect("a selection");
        let keys = banks.keys();
        let mut unit_of = vec![0; keys.len()];
        for k in 1..keys.len() {
            let whole = unit == BootstrapUnit::Episode;
            // The last chunks of the 5th, 6th and 7th episode have fewer rows than a fortieth of all, and are one unit with their neighbour.
            let short = banks.rows()[k] < 13;
            let same = keys[k].episode == keys[k - 1].episode && (whole || short);
            unit_of[k] = unit_of[k - 1] + usize::from(!same);
        }
        let units = unit_of.last().map_or(0, |last| last + 1);
        assert_eq!(units, if unit == BootstrapUnit::Episode { 8 } else { keys.len() - 3 });
        for replicate in 0..40 {
            let counts = multinomial_counts(11, replicate, units);
            let weights = Mat::from_fn(keys.len(), 1, |k, _| counts[unit_of[k]]);
            let roots = banks.roots(weights.as_ref()).remove(0);
            let (expected, n) = lasso(&structure, &roots, &assembly, 0.01);
            compare(&bootstrap, replicate, &expected, 1e-9);
            assert!((bootstrap.weights[replicate] / n - 1.0).abs() < 1e-12);
        }
        assert!(bootstrap.worst_kkt < 1e-9);
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    let source = source(5, &[150, 90, 40, 210], false);
    let regression = regression(true);
    let options = BootstrapOptions { replicates: 20, seed: 3, ..BootstrapOptions::new(0.02) };
    let run = |threads: usize, chunk_rows: usize, replicates: usize| {
        with_threads(threads, || {
            let plan = Plan::new(regression.clone(), Vec::new(), chunk_rows, &source).expect("a plan");
            let options = BootstrapOptions { replicates, ..options };
            let rows = row_bootstrap(&plan, &assembly(), &source, &options, &Silent).expect("a selection");
            let banks = Banks::new(&plan.scan(&source, &Silent).expect("a scan"), |_| true);
            let structure = regression.structure();
            let unit = BootstrapUnit::Episode;
            let blocks = block_bootstrap(&structure, &banks, &assembly(), unit, &options, &Silent);
            let stability = StabilityOptions { pairs: 9, lambdas: vec![0.1, 0.02], seed: 1, threshold: 0.7 };
            let halves = stability_selection(&structure, &banks, &assembly(), unit, &stability, &Silent);
            (rows, blocks.expect("a selection"), halves.expect("a selection"))
        })
    };
    let one = run(1, 64, 20);
    assert_eq!(one, run(2, 64, 20));
    assert_eq!(one, run(7, 64, 20));
    // Other chunks and more replicates: the same counts, so the same replicates up to rounding.
    let other = run(2, 37, 70);
    for (mine, theirs) in [(&one.0, &other.0), (&one.1, &other.1)] {
        for replicate in 0..20 {
            let expected: Vec<f64> = (0..13).map(|j| theirs.coefficients[(replicate, j)]).collect();
            compare(mine, replicate, &expected, 1e-9);
        }
    }
}

#[test]
fn units_do_not_change_selection() {
    let source = source(6, &[200, 140], false);
    let mut scaled = regression(false);
    let options = BootstrapOptions { replicates: 12, seed: 2, ..BootstrapOptions::new(0.01) };
    let run = |regression: &Regression, weights: Vec<f64>| {
        let plan = Plan::new(regression.clone(), Vec::new(), 64, &source).expect("a plan");
        let assembly = Assembly { weights, ..Assembly::default() };
        let rows = row_bootstrap(&plan, &assembly, &source, &options, &Silent).expect("a selection");
        let banks = Banks::new(&plan.scan(&source, &Silent).expect("a scan"), |_| true);
        let structure = regression.structure();
        let blocks = block_bootstrap(&structure, &banks, &assembly, BootstrapUnit::Chunk, &options, &Silent);
        [rows, blocks.expect("a selection")]
    };
    let weights = assembly().weights;
    let plain = run(&scaled, weights.clone());
    let factor = |j: usize| 10.0_f64.powi([9, -7, 0, 12, -15][j % 5]);
    let mut j = 0;
    for latent in &mut scaled.latents {
        for function in &mut latent.functions {
            *function = &Expr::number(factor(j)) * &*function;
            j += 1;
        }
    }
    for (plain, scaled) in plain.iter().zip(run(&scaled, weights)) {
        assert_eq!(plain.frequency, scaled.frequency);
        assert_eq!(plain.support, scaled.support);
        for replicate in 0..12 {
            let back: Vec<f64> = (0..13).map(|j| scaled.coefficients[(replicate, j)] * factor(j)).collect();
            compare(plain, replicate, &back, 1e-8);
        }
    }
}

#[test]
fn degenerate_input_has_an_answer_or_a_reason() {
    let options = BootstrapOptions { replicates: 64, ..BootstrapOptions::new(0.05) };
    let single = |functions: &[&str]| Regression {
        latents: vec![candidates("f", functions)],
        tasks: vec![task("y1", &[(0, "1")], false)],
        weight: None,
    };
    let assembly = Assembly { weights: vec![1.0], ..Assembly::default() };
    let run = |regression: Regression, source: &MemorySource, options: &BootstrapOptions| {
        let plan = Plan::new(regression.clone(), Vec::new(), 64, source).expect("a plan");
        let rows = row_bootstrap(&plan, &assembly, source, options, &Silent);
        let banks = Banks::new(&plan.scan(source, &Silent).expect("a scan"), |_| true);
        let unit = BootstrapUnit::Chunk;
        (rows, block_bootstrap(&regression.structure(), &banks, &assembly, unit, options, &Silent))
    };
    // A column of zeros, two duplicates and a multiple, a constant: certified, and at most one of the duplicates in any replicate.
    let many = source(7, &[150, 80], false);
    let (rows, blocks) = run(single(&["a", "0*b", "b", "b", "3*b", "1", "2"]), &many, &options);
    for selection in [rows.expect("a selection"), blocks.expect("a selection")] {
        assert!(selection.worst_kkt < 1e-8 && selection.unconverged == 0, "{selection:?}");
        assert_eq!(selection.frequency[1], 0.0);
        for replicate in 0..64 {
            let taken =
                |columns: &[usize]| columns.iter().filter(|&&j| selection.coefficients[(replicate, j)] != 0.0).count();
            assert!(taken(&[2, 3, 4]) <= 1 && taken(&[5, 6]) <= 1);
        }
    }
    // More functions than rows.
    let few = source(8, &[6], false);
    let (rows, blocks) = run(single(&["a", "b", "c", "a*b", "b*c", "a*c", "a^2", "b^2", "c^2"]), &few, &options);
    assert!(rows.expect("a selection").worst_kkt < 1e-8);
    assert!(blocks.expect("a selection").worst_kkt < 1e-8);
    // One row: more than a third of the Poisson replicates draw nothing, and do not vote.
    let one = source(9, &[1], false);
    let (rows, blocks) = run(single(&["a", "b"]), &one, &options);
    let rows = rows.expect("a selection");
    let drawn = poisson_counts(0, one.episodes()[0].id, 0, 1, 64);
    assert_eq!(rows.empty, (0..64).filter(|&k| drawn[(k, 0)] == 0.0).count());
    assert!(rows.empty > 10 && rows.frequency.iter().all(|f| (0.0..=1.0).contains(f)));
    assert_eq!(blocks.expect("a selection").empty, 0);
    // No rows, and rows that are all incomplete.
    let (rows, blocks) = run(single(&["a"]), &source(1, &[], false), &options);
    assert!(rows.is_err() && blocks.is_err());
    let (rows, blocks) = run(single(&["log(-1 - a^2)"]), &many, &options);
    assert!(rows.is_err() && blocks.is_err());
    for wrong in [
        BootstrapOptions { replicates: 0, ..options },
        BootstrapOptions { lambda: f64::NAN, ..options },
        BootstrapOptions { lambda: -1.0, ..options },
        BootstrapOptions { threshold: 0.0, ..options },
        BootstrapOptions { threshold: 1.5, ..options },
    ] {
        let (rows, blocks) = run(single(&["a"]), &many, &wrong);
        assert!(rows.is_err() && blocks.is_err(), "{wrong:?}");
    }
    let plan = Plan::new(single(&["a"]), Vec::new(), 64, &many).expect("a plan");
    let short = Assembly::default();
    assert!(matches!(row_bootstrap(&plan, &short, &many, &options, &Silent), Err(BolassoError::Sparse(_))));
    let negative = Regression { weight: Some(parse("-w")), ..single(&["a"]) };
    let plan = Plan { regression: negative, ..plan };
    let error = row_bootstrap(&plan, &assembly, &many, &options, &Silent).expect_err("negative weights");
    assert!(error.to_string().contains("weights are not negative"), "{error}");
}

#[test]
fn the_refit_is_least_squares_on_the_support() {
    let source = source(12, &[150, 90], false);
    let regression = regression(true);
    let structure = regression.structure();
    let roots = repeated(&regression, &source, |_, _| 1.0);
    let mut assembly = assembly();
    assembly.tikhonov = Some(gamma(13));
    let support = [0, 3, 7, 9, 11];
    let theta = refit(&structure, &roots, &assembly, &support).expect("a fit");
    assert!((0..13).all(|j| (theta[j] != 0.0) == support.contains(&j)));
    // The gradient of the sum of squares vanishes on the support, by the raw square-root forms.
    let mut gradient = [0.0; 13];
    let mut size = [0.0; 13];
    for (task, root) in roots.iter().enumerate() {
        let columns = structure.columns(task);
        let s = assembly.weights[task];
        let mut left: Vec<f64> = (0..columns.len())
            .map(|i| (i..columns.len()).map(|c| root.r[(i, c)] * theta[columns[c]]).sum::<f64>() - root.z[(i, 0)])
            .collect();
        let mean = columns.iter().zip(&root.mean_x).map(|(&j, mean)| mean * theta[j]).sum::<f64>() - root.mean_y[0];
        left.push(mean);
        for (c, &j) in columns.iter().enumerate() {
            let term = (0..=c).map(|i| root.r[(i, c)] * left[i]).sum::<f64>() + root.weight * root.mean_x[c] * mean;
            gradient[j] += s * term;
            size[j] += s * root.weight;
        }
    }
    let tikhonov = gamma(13);
    for i in 0..2 {
        let left: f64 = (0..13).map(|j| tikhonov.gamma[(i, j)] * (theta[j] - tikhonov.prior[j])).sum();
        (0..13).for_each(|j| gradient[j] += tikhonov.strength * tikhonov.gamma[(i, j)] * left);
    }
    for j in support {
        assert!(gradient[j].abs() < 1e-9 * size[j], "column {j}: {}", gradient[j]);
    }
    assert!(refit(&structure, &roots, &assembly, &[13]).is_err());
}

/// Rows of y = x'truth + noise with p = 8 columns; `correlated`: the third column is what Zhao and Yu (2006) call irrepresentable, 2/3 of each of the
/// two true ones (and the rest its own), so that the lasso takes it in at every lambda.
fn linear(seed: u64, n: usize, correlated: bool) -> (MemorySource, Regression) {
    let mut rng = Pcg64::seed_from_u64(seed);
    let names: Vec<String> = (0..8).map(|j| format!("x{j}")).chain(["y".to_owned()]).collect();
    let mut values = vec![Vec::new(); 9];
    for _ in 0..n {
        let mut x: Vec<f64> = (0..8).map(|_| gaussian(&mut rng)).collect();
        if correlated {
            x[2] = (2.0 * x[0] + 2.0 * x[1] + x[2]) / 3.0;
        }
        x.push(x[0] + x[1] + gaussian(&mut rng));
        values.iter_mut().zip(x).for_each(|(column, value)| column.push(value));
    }
    let mut source = MemorySource::new(names.iter().map(Column::float).collect());
    source.push_uniform("rows", 1.0, values);
    let functions = names[..8].iter().map(|name| Expr::column(name.as_str())).collect();
    let terms = vec![Term { latent: 0, coefficient: Expr::number(1.0) }];
    let task = Task { name: "y".into(), target: Expr::column("y"), terms, prior: false };
    let latents = vec![Candidates { name: "f".into(), functions }];
    (source, Regression { latents, tasks: vec![task], weight: None })
}

/// Shares of trials in which the lasso and the bolasso select the two true columns and no other.
fn recovery(n: usize, trials: u64, correlated: bool) -> [f64; 2] {
    let assembly = Assembly { weights: vec![1.0], ..Assembly::default() };
    let mut right = [0.0; 2];
    for trial in 0..trials {
        let (source, regression) = linear(1000 * n as u64 + trial, n, correlated);
        let lambda = bach_lambda(1.0, n as f64);
        let (theta, _) = lasso(&regression.structure(), &repeated(&regression, &source, |_, _| 1.0), &assembly, lambda);
        let lasso: Vec<usize> = (0..8).filter(|&j| theta[j] != 0.0).collect();
        let plan = Plan::new(regression, Vec::new(), 4096, &source).expect("a plan");
        let options = BootstrapOptions { replicates: 256, seed: trial, ..BootstrapOptions::new(lambda) };
        let bootstrap = row_bootstrap(&plan, &assembly, &source, &options, &Silent).expect("a selection");
        right[0] += f64::from(u8::from(lasso == [0, 1]));
        right[1] += f64::from(u8::from(bootstrap.support == [0, 1]));
    }
    right.map(|right| right / trials as f64)
}

/// Theorem 7.1.
#[test]
fn bolasso_is_consistent_unlike_lasso() {
    for correlated in [false, true] {
        let shares: Vec<[f64; 2]> = [20, 80, 640].iter().map(|&n| recovery(n, 40, correlated)).collect();
        println!("correlated {correlated}: {shares:?}");
        let [first, middle, last] = [shares[0][1], shares[1][1], shares[2][1]];
        assert!(first < last && middle <= last + 0.1 && last >= 0.9, "{shares:?}");
        // At the same rate of lambda the lasso keeps false columns, and nearly always the one that it cannot tell.
        assert!(shares[2][0] <= if correlated { 0.3 } else { 0.6 }, "{shares:?}");
    }
}

#[test]
fn stability_selection_keeps_its_error_bound() {
    let (mut false_columns, mut bounds, runs) = (0.0, 0.0, 12);
    for seed in 0..runs {
        let (source, regression) = linear(seed, 600, false);
        let plan = Plan::new(regression.clone(), Vec::new(), 10, &source).expect("a plan");
        let banks = Banks::new(&plan.scan(&source, &Silent).expect("a scan"), |_| true);
        let assembly = Assembly { weights: vec![1.0], ..Assembly::default() };
        let options = StabilityOptions { pairs: 50, lambdas: vec![0.5, 0.2, 0.12, 0.08], seed, threshold: 0.8 };
        let structure = regression.structure();
        let unit = BootstrapUnit::Chunk;
        let selection =
            stability_selection(&structure, &banks, &assembly, unit, &options, &Silent).expect("a selection");
        assert!(selection.worst_kkt < 1e-8 && selection.stalled == 0);
        assert!(selection.support.starts_with(&[0, 1]), "{selection:?}");
        false_columns += (selection.support.len() - 2) as f64;
        bounds += selection.bound;
        assert!((selection.bound - selection.selected.powi(2) / (0.6 * 8.0)).abs() < 1e-12);
        for j in 0..8 {
            let by: Vec<f64> = selection.by_lambda.iter().map(|frequency| frequency[j]).collect();
            assert_eq!(selection.frequency[j], by.iter().copied().fold(0.0, f64::max));
            // Halves are counted, 100 of them.
            assert!(by.iter().all(|f| ((f * 100.0).round() - f * 100.0).abs() < 1e-9));
        }
        // The mean number of selected columns at a lambda is the sum of the frequencies; somewhere on the grid is at least that.
        let sizes = selection.by_lambda.iter().map(|frequency| frequency.iter().sum::<f64>());
        assert!(sizes.fold(0.0, f64::max) <= selection.selected + 1e-9);
        // A grid of one lambda, by hand from the statistic's halves at that lambda: the frequencies do not depend on the grid.
        let alone = StabilityOptions { lambdas: vec![0.12], ..options };
        let alone = stability_selection(&structure, &banks, &assembly, unit, &alone, &Silent).expect("a selection");
        assert_eq!(alone.frequency, selection.by_lambda[2]);
    }
    assert!(false_columns / runs as f64 <= bounds / runs as f64, "{false_columns} {bounds}");
    let (source, regression) = linear(1, 50, false);
    let plan = Plan::new(regression.clone(), Vec::new(), 100, &source).expect("a plan");
    let banks = Banks::new(&plan.scan(&source, &Silent).expect("a scan"), |_| true);
    let options = StabilityOptions { pairs: 5, lambdas: vec![0.1], seed: 1, threshold: 0.8 };
    let run = |options: &StabilityOptions| {
        let assembly = Assembly { weights: vec![1.0], ..Assembly::default() };
        stability_selection(&regression.structure(), &banks, &assembly, BootstrapUnit::Episode, options, &Silent)
    };
    assert!(matches!(run(&options), Err(BolassoError::TooFewUnits { units: 1, needed: 2, .. })));
    assert!(matches!(run(&StabilityOptions { pairs: 0, ..options.clone() }), Err(BolassoError::NoReplicates)));
    assert!(matches!(
        run(&StabilityOptions { threshold: 0.5, ..options.clone() }),
        Err(BolassoError::Threshold { .. })
    ));
    assert!(matches!(run(&StabilityOptions { lambdas: vec![], ..options.clone() }), Err(BolassoError::NoLambdas)));
    assert!(matches!(run(&StabilityOptions { lambdas: vec![-1.0], ..options }), Err(BolassoError::Sparse(_))));
}
