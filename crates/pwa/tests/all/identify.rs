//! Identification of systems with known truth, and its invariants.

use fleetfoot_data::{Column as DataColumn, MemorySource, Progress, Silent, with_threads};
use fleetfoot_library::{Expr, Library};
use fleetfoot_model::{Column, Equation, Model, Prediction, Role};
use fleetfoot_pwa::{Identification, Options, Problem, Selection, Shrinkage, Specification, identify, partition};
use fleetfoot_stats::Mahalanobis;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// The truth: two affine maps of (x, u) to dx, switched at x > 0, and their rows.
fn hybrid(rows: usize, episodes: usize, noise: f64, seed: u64) -> MemorySource {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut source = MemorySource::new(["x", "u", "dx", "mode"].map(DataColumn::float).to_vec());
    for _ in 0..episodes {
        let mut columns = vec![Vec::new(); 4];
        for _ in 0..rows / episodes {
            let x: f64 = random.random_range(-2.0..2.0);
            let u: f64 = random.random_range(-1.0..1.0);
            let e: f64 = random.random_range(-noise..=noise);
            let dx = if x > 0.0 { -1.5 * x + 2.0 * u + 0.5 } else { -0.25 * x + 1.0 * u - 1.0 };
            let mode = if x > 0.0 { 7.0 } else { 3.0 };
            columns.iter_mut().zip([x, u, dx + e, mode]).for_each(|(column, value)| column.push(value));
        }
        source.push_uniform("run", 0.01, columns);
    }
    source
}

fn problem(regressors: &[&str]) -> Problem {
    let column = |name: &str, role| Column::new(name, role);
    Problem {
        columns: vec![
            column("x", Role::State),
            column("u", Role::Input),
            column("dx", Role::Auxiliary),
            column("mode", Role::Auxiliary),
        ],
        library: regressors.iter().map(|name| Expr::column(*name)).collect(),
        equations: vec![Equation {
            subject: "x".into(),
            prediction: Prediction::Derivative,
            right: Expr::column("f_x"),
            target: Some(Expr::column("dx")),
            unit: None,
        }],
        partition_columns: vec![Expr::column("x")],
        weight: None,
        step: 0.01,
    }
}

fn options(partitions: &str) -> Options {
    let mut options = Options::default();
    options.partitions = Specification::parse_list(partitions).unwrap();
    options
}

fn run(problem: &Problem, options: &Options, source: &MemorySource) -> Identification {
    identify(problem, options, source, &Silent).unwrap()
}

#[test]
fn labels_recover_the_truth_and_the_model_reads_back() {
    let identification = run(&problem(&["x", "u"]), &options("labels:mode"), &hybrid(2000, 4, 0.0, 1));
    let latent = &identification.model.latents[0];
    let expected = [(-1.0, [-0.25, 1.0]), (0.5, [-1.5, 2.0])];
    for (region, (constant, coefficients)) in expected.iter().enumerate() {
        assert!((latent.affine().unwrap().constants[region] - constant).abs() < 1e-12);
        for (coefficient, expected) in latent.affine().unwrap().coefficients[region].iter().zip(coefficients) {
            assert!((coefficient - expected).abs() < 1e-12);
        }
    }
    assert_eq!(identification.model.summaries[0].regions[0].name, "3");
    assert!(identification.candidates[0].over_null[0] < 1e-12);
    let text = identification.model.to_json();
    let again = Model::from_json(&text, "test").unwrap();
    assert_eq!(again.to_json(), text);
    assert_eq!(again, identification.model);
}

#[test]
fn stages_name_partition_and_fold() {
    #[derive(Default)]
    struct Stages(std::sync::Mutex<Vec<String>>);
    impl Progress for Stages {
        fn advance(&self, _: usize, _: usize) {}
        fn stage(&self, name: &str) {
            self.0.lock().unwrap().push(name.to_owned());
        }
    }
    let stages = Stages::default();
    let mut options = options("average,kmeans:2,refined:2,lattice:3");
    options.folds = 2;
    identify(&problem(&["x", "u"]), &options, &hybrid(600, 2, 0.1, 4), &stages).unwrap();
    let of = |fold: &str| {
        [format!("cells of lattice:3{fold}"), format!("partition kmeans:2{fold}"), format!("partition refined:2{fold}")]
    };
    let expected: Vec<String> = ["", ", fold 1 of 2", ", fold 2 of 2"].into_iter().flat_map(of).collect();
    let all = stages.0.into_inner().unwrap();
    assert_eq!(all[0], "survey");
    assert_eq!(all[1..=9], expected, "{all:?}");
}

#[test]
fn more_regions_predict_better_and_cross_validation_chooses() {
    let identification =
        run(&problem(&["x", "u"]), &options("null,average,zscore:1.5,kmeans:2,8"), &hybrid(20_000, 12, 0.05, 2));
    let errors: Vec<f64> = identification.candidates.iter().map(|candidate| candidate.over_null[0]).collect();
    assert!((errors[0] - 1.0).abs() < 1e-12, "the null model over itself");
    assert!(errors[1] < errors[0] && errors[3] < errors[1], "{errors:?}");
    let chosen = &identification.candidates[identification.chosen];
    assert!(matches!(chosen.specification, Specification::KMeans(_)), "{:?}", chosen.specification);
    assert!(chosen.r2[0] > 0.99, "{}", chosen.r2[0]);
    let by_bic = {
        let mut options = options("null,average,kmeans:2,8");
        options.selection = Selection::Bic;
        run(&problem(&["x", "u"]), &options, &hybrid(20_000, 12, 0.05, 2))
    };
    assert!(matches!(by_bic.candidates[by_bic.chosen].specification, Specification::KMeans(_)));
}

#[test]
fn held_out_losses_match_models_without_fold() {
    let source = hybrid(5000, 5, 0.3, 3);
    let mut options = options("average");
    // Five episodes are enough to be folds.
    options.folds = 5;
    let identification = run(&problem(&["x", "u"]), &options, &source);
    // The same by hand: leave one episode out, ordinary least squares on the others.
    use fleetfoot_data::{Halo, Source};
    let blocks: Vec<_> = (0..5).map(|e| source.read(e, 0..1000, Halo::default()).unwrap()).collect();
    let mut losses = Vec::new();
    let all: Vec<f64> = blocks.iter().flat_map(|b| b.core(2).to_vec()).collect();
    let mean = all.iter().sum::<f64>() / 5000.0;
    let variance = all.iter().map(|y| (y - mean).powi(2)).sum::<f64>() / 5000.0;
    for held in 0..5 {
        let train: Vec<[f64; 4]> = (0..5)
            .filter(|&e| e != held)
            .flat_map(|e| (0..1000).map(move |i| (e, i)))
            .map(|(e, i)| [1.0, blocks[e].core(0)[i], blocks[e].core(1)[i], blocks[e].core(2)[i]])
            .collect();
        let x = faer::Mat::from_fn(4000, 3, |i, j| train[i][j]);
        let y = faer::Mat::from_fn(4000, 1, |i, _| train[i][3]);
        use faer::linalg::solvers::SolveLstsq;
        let beta = x.qr().solve_lstsq(&y);
        let error: f64 = (0..1000)
            .map(|i| {
                let b = &blocks[held];
                (b.core(2)[i] - beta[(0, 0)] - beta[(1, 0)] * b.core(0)[i] - beta[(2, 0)] * b.core(1)[i]).powi(2)
            })
            .sum();
        losses.push(error / 1000.0 / variance);
    }
    let mut reported = identification.candidates[0].losses.clone();
    reported.sort_by(f64::total_cmp);
    losses.sort_by(f64::total_cmp);
    for (a, b) in reported.iter().zip(&losses) {
        assert!((a - b).abs() < 1e-10 * b, "{a} {b}");
    }
}

#[test]
fn the_number_of_threads_does_not_change_a_bit() {
    let source = hybrid(30_000, 5, 0.1, 4);
    let problem = problem(&["x", "u"]);
    let options = options("kmeans:5,labels:mode+kmeans:3");
    let texts: Vec<String> = [1, 2, 7]
        .map(|threads| {
            let identification = with_threads(threads, || run(&problem, &options, &source));
            let scores: Vec<_> = identification.candidates.iter().map(|c| format!("{c:?}")).collect();
            format!("{}{}", identification.model.to_json(), scores.join("\n"))
        })
        .to_vec();
    assert_eq!(texts[0], texts[1]);
    assert_eq!(texts[0], texts[2]);
}

#[test]
fn the_order_of_the_episodes_does_not_change_a_bit() {
    let source = hybrid(10_000, 4, 0.1, 5);
    use fleetfoot_data::{Halo, Source};
    let mut reversed = MemorySource::new(source.columns().to_vec());
    for episode in (0..4).rev() {
        let block = source.read(episode, 0..2500, Halo::default()).unwrap();
        reversed.push("run", block.time.clone(), block.columns.clone());
    }
    let options = options("average,kmeans:4");
    let strip = |identification: Identification| {
        let mut model = identification.model;
        model.training.episodes.sort();
        model.to_json()
    };
    assert_eq!(
        strip(run(&problem(&["x", "u"]), &options, &source)),
        strip(run(&problem(&["x", "u"]), &options, &reversed))
    );
}

#[test]
fn permuting_regressors_permutes_the_coefficients() {
    let source = hybrid(5_000, 2, 0.2, 6);
    let a = run(&problem(&["x", "u"]), &options("zscore:1"), &source).model;
    let b = run(&problem(&["u", "x"]), &options("zscore:1"), &source).model;
    for region in 0..2 {
        let (a, b) = (
            &a.latents[0].affine().unwrap().coefficients[region],
            &b.latents[0].affine().unwrap().coefficients[region],
        );
        assert!((a[0] - b[1]).abs() < 1e-12 && (a[1] - b[0]).abs() < 1e-12);
    }
}

#[test]
fn shrinkage_leads_from_the_regions_to_the_average() {
    let source = hybrid(2_000, 2, 0.1, 7);
    let slope = |shrinkage| {
        let mut options = options("labels:mode");
        options.shrinkage = Shrinkage::Rows(shrinkage);
        run(&problem(&["x", "u"]), &options, &source).model.latents[0].affine().unwrap().coefficients[0][1]
    };
    let average =
        run(&problem(&["x", "u"]), &options("average"), &source).model.latents[0].affine().unwrap().coefficients[0][1];
    let path = [0.0, 10.0, 1e3, 1e9].map(slope);
    assert!((path[0] - 1.0).abs() < 0.05);
    assert!((path[3] - average).abs() < 1e-4 * average.abs());
    assert!(path.windows(2).all(|pair| (pair[0] - average).abs() >= (pair[1] - average).abs()));
    let mut auto = options("labels:mode");
    auto.shrinkage = Shrinkage::Auto;
    let identification = run(&problem(&["x", "u"]), &auto, &source);
    assert!(
        identification.candidates[0].shrinkage <= 10.0,
        "different maps need no shrinkage: {}",
        identification.candidates[0].shrinkage
    );
}

/// Forty cells of a few noisy rows each diverge outside of them. Cells of exact maps stay unchanged, though folds draw
/// their borders elsewhere.
#[test]
fn held_out_rows_decide_shrinkage() {
    let held_out = |shrinkage, noise| {
        let mut options = options("kmeans:40");
        options.shrinkage = shrinkage;
        run(&problem(&["x", "u"]), &options, &hybrid(240, 3, noise, 5)).candidates[0].clone()
    };
    let (free, pulled) = (held_out(Shrinkage::Rows(0.0), 1.5), held_out(Options::default().shrinkage, 1.5));
    assert!(pulled.shrinkage > 0.0 && pulled.loss < 0.8 * free.loss, "{} {}", pulled.loss, free.loss);
    let mut exact = options("kmeans:2");
    exact.folds = 5;
    let identification = run(&problem(&["x", "u"]), &exact, &hybrid(2_000, 4, 0.0, 1));
    assert_eq!(identification.candidates[0].shrinkage, 0.0);
}

#[test]
fn tsqr_and_the_gram_agree() {
    let source = hybrid(6_000, 2, 0.2, 12);
    let fit = |tsqr| {
        let mut options = options("labels:mode+kmeans:3");
        options.tsqr = tsqr;
        run(&problem(&["x", "u"]), &options, &source).model
    };
    let (gram, tsqr) = (fit(false), fit(true));
    for (a, b) in gram.latents[0]
        .affine()
        .unwrap()
        .coefficients
        .iter()
        .flatten()
        .zip(tsqr.latents[0].affine().unwrap().coefficients.iter().flatten())
    {
        assert!((a - b).abs() < 1e-12, "{a} {b}");
    }
    for (a, b) in gram.summaries[0].regions.iter().zip(&tsqr.summaries[0].regions) {
        assert_eq!(a.rows, b.rows);
        assert!(a.covariance.iter().zip(&b.covariance).all(|(a, b)| (a - b).abs() < 1e-12));
    }
}

#[test]
fn memory_limit_clusters_a_sample() {
    let source = hybrid(40_000, 3, 0.05, 11);
    let all = run(&problem(&["x", "u"]), &options("kmeans:4"), &source);
    let mut small = options("kmeans:4");
    small.memory = 16 * 4_000;
    let sampled = run(&problem(&["x", "u"]), &small, &source);
    assert!(sampled.notes.iter().any(|note| note.contains("sample")), "{:?}", sampled.notes);
    assert_eq!(sampled.model.summaries[0].regions.iter().map(|region| region.rows).sum::<u64>(), all.rows);
    let (a, b) = (all.candidates[0].over_null[0], sampled.candidates[0].over_null[0]);
    assert!((a - b).abs() < 0.1 * a, "{a} {b}");
}

#[test]
fn a_constant_column_and_a_copy_are_named() {
    let mut source = MemorySource::new(["x", "u", "dx", "mode"].map(DataColumn::float).to_vec());
    let x: Vec<f64> = (0..500).map(|i| (f64::from(i) * 0.37).sin()).collect();
    let dx = x.iter().map(|x| 2.0 * x).collect();
    source.push_uniform("run", 0.1, vec![x.clone(), vec![4.0; 500], dx, x]);
    let identification = run(&problem(&["x", "u", "mode"]), &options("average"), &source);
    assert!(identification.notes.iter().any(|note| note.contains("u does not change")), "{:?}", identification.notes);
    assert!(identification.notes.iter().any(|note| note.contains("x, mode")), "{:?}", identification.notes);
    let coefficients = &identification.model.latents[0].affine().unwrap().coefficients[0];
    assert!(
        (coefficients[0] - 1.0).abs() < 1e-9 && (coefficients[2] - 1.0).abs() < 1e-9,
        "minimum norm: {coefficients:?}"
    );
}

/// A note names a model that explains nothing on held-out rows; the null model, which promises nothing, gets none.
#[test]
fn a_note_reports_a_model_no_better_than_the_mean() {
    let mut random = Pcg64::seed_from_u64(7);
    let mut noise = MemorySource::new(["x", "u", "dx", "mode"].map(DataColumn::float).to_vec());
    for _ in 0..4 {
        let columns = (0..4).map(|_| (0..200).map(|_| random.random_range(-1.0..1.0)).collect()).collect();
        noise.push_uniform("run", 0.01, columns);
    }
    let notes = |partitions: &str, source: &MemorySource| -> Vec<String> {
        let notes = run(&problem(&["x", "u"]), &options(partitions), source).notes;
        notes.into_iter().filter(|note| note.contains("no better than their mean")).collect()
    };
    let notes_of_noise = notes("average", &noise);
    assert!(notes_of_noise.len() == 1 && notes_of_noise[0].starts_with("average "), "{notes_of_noise:?}");
    let many = notes("kmeans:40", &noise);
    assert!(many.len() == 1 && many[0].starts_with("kmeans:40 predicts held-out rows"), "{many:?}");
    assert!(notes("null", &noise).is_empty());
    assert!(notes("average,kmeans:2", &hybrid(2000, 4, 0.1, 8)).is_empty());
}

#[test]
fn impossible_fits_are_refused_with_reason() {
    let few = hybrid(3, 1, 0.0, 8);
    let message = identify(&problem(&["x", "u"]), &options("average"), &few, &Silent).unwrap_err().to_string();
    assert!(message.contains("too few"), "{message}");
    let mut constant = MemorySource::new(["x", "u", "dx", "mode"].map(DataColumn::float).to_vec());
    let ramp: Vec<f64> = (0..100).map(f64::from).collect();
    constant.push_uniform("run", 0.1, vec![ramp.clone(), ramp.clone(), vec![1.0; 100], ramp]);
    let message = identify(&problem(&["x"]), &options("average"), &constant, &Silent).unwrap_err().to_string();
    assert!(message.contains("d(x)/dt") && message.contains("same value"), "{message}");
    let message =
        identify(&problem(&["x"]), &options("labels:dx"), &hybrid(5000, 1, 0.5, 9), &Silent).unwrap_err().to_string();
    assert!(message.contains("does not look like a label"), "{message}");
}

#[test]
fn polynomial_libraries_and_weights() {
    let source = hybrid(4_000, 2, 0.0, 10);
    let mut problem = problem(&["x", "u"]);
    problem.library = Library::polynomial(&problem.library, 2).unwrap().functions().to_vec();
    // Rows of the other mode weigh nothing: the one-region model is that mode's.
    problem.weight = Some(Expr::parse("(mode - 3)/4", &fleetfoot_library::Scope::new(["mode"])).unwrap());
    let identification = run(&problem, &options("average"), &source);
    let latent = &identification.model.latents[0];
    assert!((latent.affine().unwrap().constants[0] - 0.5).abs() < 1e-10);
    for (coefficient, expected) in latent.affine().unwrap().coefficients[0].iter().zip([-1.5, 2.0, 0.0, 0.0, 0.0]) {
        assert!((coefficient - expected).abs() < 1e-10, "{:?}", latent.affine().unwrap().coefficients[0]);
    }
}

#[test]
fn dependent_targets_share_one_metric() {
    // The second target is the first one, up to a hundred-thousandth: an eigenvalue below the metric's floor.
    let mut random = Pcg64::seed_from_u64(12);
    let mut rows: Vec<[f64; 4]> = Vec::new();
    for _ in 0..2000 {
        let x: f64 = random.random_range(-2.0..2.0);
        let (e, across): (f64, f64) = (random.random_range(-0.3..0.3), random.random_range(-1e-5..1e-5));
        rows.push([x, 0.0, e - x, e - x + across]);
    }
    let mut source = MemorySource::new(["x", "u", "dx", "mode"].map(DataColumn::float).to_vec());
    source.push_uniform("run", 0.01, (0..4).map(|j| rows.iter().map(|row| row[j]).collect()).collect());
    let equation = |name: &str| Equation {
        subject: name.into(),
        prediction: Prediction::Value,
        right: Expr::column(format!("f_{name}")),
        target: Some(Expr::column(name)),
        unit: None,
    };
    let mut problem = problem(&["x"]);
    problem.equations = vec![equation("dx"), equation("mode")];
    let mut options = options("average");
    options.folds = 1;
    let identification = run(&problem, &options, &source);
    let metric = Mahalanobis::of_covariance(&identification.model.training.target_covariance, 2);
    let latents = &identification.model.latents;
    let error = |row: &[f64; 4], t: usize| {
        row[2 + t]
            - latents[t].affine().unwrap().constants[0]
            - latents[t].affine().unwrap().coefficients[0][0] * row[0]
    };
    let expected = rows.iter().map(|row| metric.score(&[error(row, 0), error(row, 1)])).sum::<f64>() / 2000.0;
    let score = identification.candidates[0].mahalanobis;
    // An error across the two is known to rounding, 1e-16 of a deviation over the floor's 3e-5.
    assert!((score / expected - 1.0).abs() < 1e-9, "{score} {expected}");
    let along = rows.iter().map(|row| error(row, 0).abs()).sum::<f64>() / 2000.0 / identification.sigma[0];
    assert!(score > 1.05 * along, "errors across count too: {score} {along}");
}

#[test]
fn kept_models_match_separate_fits() {
    let source = hybrid(6_000, 4, 0.1, 8);
    let mut together = options("null,average,zscore:1,kmeans:4");
    together.folds = 2;
    together.keep_all = true;
    let all = run(&problem(&["x", "u"]), &together, &source);
    assert_eq!(all.models.len(), 4);
    assert_eq!(all.models[all.chosen], all.model);
    for (candidate, text) in ["null", "average", "zscore:1", "kmeans:4"].into_iter().enumerate() {
        let mut alone = options(text);
        alone.folds = 2;
        let alone = run(&problem(&["x", "u"]), &alone, &source);
        assert!(alone.models.is_empty());
        // Their scans share chunks and pilot, so all but the plan is the same.
        assert_eq!(alone.model.to_json(), all.models[candidate].to_json(), "{text}");
        let (one, of_all) = (&alone.candidates[0], &all.candidates[candidate]);
        assert_eq!((&one.over_null, &one.over_null_interval), (&of_all.over_null, &of_all.over_null_interval));
    }
}

#[test]
fn intervals_hold_the_error_and_pairs_are_tighter() {
    use fleetfoot_stats::Basis;
    let source = hybrid(8_000, 8, 0.4, 9);
    let mut options = options("null,average,labels:mode");
    options.folds = 4;
    let identification = run(&problem(&["x", "u"]), &options, &source);
    assert_eq!(identification.basis, Basis::Episodes(8));
    for score in &identification.candidates {
        let interval = &score.over_null_interval[0];
        assert!((interval.value - score.over_null[0]).abs() < 1e-12);
        assert!(interval.low <= interval.value && interval.value <= interval.high);
        assert_eq!(score.absolute.len(), 8);
    }
    let itself = &identification.error_ratio(1, 1)[0];
    assert!((itself.value - 1.0).abs() < 1e-12 && itself.high - itself.low < 1e-12);
    let better = &identification.error_ratio(2, 1)[0];
    assert!(better.high < 1.0, "{better:?}");
    let expected = identification.candidates[2].over_null[0] / identification.candidates[1].over_null[0];
    assert!((better.value - expected).abs() < 1e-12);
    options.folds = 10;
    assert_eq!(run(&problem(&["x", "u"]), &options, &source).basis, Basis::Folds(10));
}

#[test]
fn partitions_alone_match_identification() {
    let source = hybrid(600, 3, 0.01, 5);
    let mut options = options("average,zscore:1.2,kmeans:3,labels:mode,labels:mode+kmeans:2");
    // Folds cut the rows into other chunks, whose sums round differently.
    (options.keep_all, options.folds) = (true, 0);
    let problem = problem(&["x", "u"]);
    let identified = run(&problem, &options, &source);
    let alone = partition(&problem, &options, &source, &Silent).unwrap();
    assert_eq!((alone.rows, alone.partitions.len()), (identified.rows, 5));
    for ((specification, partition), model) in alone.partitions.iter().zip(&identified.models) {
        let whole = &model.partitions[0];
        assert_eq!(partition.specification, specification.to_string());
        assert_eq!(
            (&partition.columns, &partition.centre, &partition.scale),
            (&whole.columns, &whole.centre, &whole.scale)
        );
        assert_eq!(partition.rule, whole.rule);
        assert_eq!(partition.rule.count(), model.summaries[0].regions.len());
    }
}
