//! Maps that contract in one metric: the bound, the metric and the price are checked from the model's own numbers.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};
use fleetfoot_data::{Column as DataColumn, Halo, MemorySource, Silent, Source, with_threads};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Column, Equation, Model, Prediction, Role};
use fleetfoot_pwa::{
    Contracting, Error, Identification, Options, Problem, RegionWeight, Specification, Stability, identify,
};
use fleetfoot_stats::{spectral_radius, svd};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

fn column(name: &str, role: Role) -> Column {
    Column::new(name, role)
}

fn equation(subject: &str, prediction: Prediction, right: &str, target: Option<Expr>) -> Equation {
    Equation { subject: subject.into(), prediction, right: Expr::column(right), target, unit: None }
}

/// An oscillator whose states are measured with noise, so that maps of small regions are wrong by much; rows of next values.
fn oscillator(rows: usize, seed: u64) -> MemorySource {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut source = MemorySource::new(["x", "v", "u"].map(DataColumn::float).to_vec());
    for _ in 0..5 {
        let (mut x, mut v) = (1.0_f64, 0.0_f64);
        let mut columns = vec![Vec::new(); 3];
        for _ in 0..rows / 5 {
            let u: f64 = random.random_range(-2.0..2.0);
            let mut noise = || random.random_range(-0.4..0.4);
            let measured = [x + noise(), v + noise(), u];
            columns.iter_mut().zip(measured).for_each(|(column, value)| column.push(value));
            (x, v) = (0.98 * x + 0.2 * v, -0.2 * x + 0.97 * v + 0.3 * u);
        }
        source.push_uniform("run", 0.05, columns);
    }
    source
}

fn problem() -> Problem {
    let next = |name: &str| Some(Expr::lagged(name, -1));
    Problem {
        columns: vec![column("x", Role::State), column("v", Role::State), column("u", Role::Input)],
        library: ["x", "v", "u"].map(Expr::column).to_vec(),
        equations: vec![
            equation("x", Prediction::Next, "f_x", next("x")),
            equation("v", Prediction::Next, "f_v", next("v")),
        ],
        partition_columns: vec![Expr::column("x"), Expr::column("v")],
        weight: None,
        step: 0.05,
    }
}

fn options(partitions: &str, bound: Option<f64>) -> Options {
    let mut options = Options::default();
    options.partitions = Specification::parse_list(partitions).unwrap();
    options.folds = 5;
    options.stability = bound;
    options
}

fn run(problem: &Problem, options: &Options, source: &MemorySource) -> Identification {
    identify(problem, options, source, &Silent).unwrap()
}

/// M of a region of a model of next values whose first functions are its states.
fn map(model: &Model, region: usize, n: usize) -> Mat<f64> {
    Mat::from_fn(n, n, |i, j| model.latents[i].coefficients[region][j])
}

fn metric(stability: &Stability) -> Mat<f64> {
    let n = stability.variables.len();
    Mat::from_fn(n, n, |i, j| stability.metric[i * n + j])
}

/// The largest singular value of M in the metric: by the Cholesky factor of P, from nothing but what is told.
fn norm(M: &Mat<f64>, P: &Mat<f64>) -> f64 {
    use faer::linalg::solvers::Solve;
    let T = P.llt(Side::Lower).unwrap().L().transpose().to_owned();
    let inverse = T.partial_piv_lu().solve(Mat::<f64>::identity(T.nrows(), T.ncols()));
    svd((&T * M * &inverse).as_ref()).unwrap().s[0]
}

#[test]
fn all_regions_contract_in_the_metric_that_is_told() {
    let source = oscillator(2000, 1);
    let (free, bound) = (
        run(&problem(), &options("kmeans:30", None), &source),
        run(&problem(), &options("kmeans:30", Some(1.0)), &source),
    );
    let told = bound.candidates[0].stability.as_ref().unwrap();
    assert_eq!(told.variables, ["x", "v"]);
    assert!(told.inputs.is_empty());
    let P = metric(told);
    let grows = |model: &Model| (0..30).filter(|&region| spectral_radius(map(model, region, 2).as_ref()) > 1.0).count();
    assert!(grows(&free.model) > 0, "else there is nothing to show");
    assert_eq!(grows(&bound.model), 0);
    let mut stayed = 0;
    for (region, own) in told.regions.iter().enumerate() {
        let found = norm(&map(&bound.model, region, 2), &P);
        assert!(found <= 1.0 + 1e-9 && (found - own.norm).abs() < 1e-9, "{found} {own:?}");
        assert!((norm(&map(&free.model, region, 2), &P) - own.free_norm).abs() < 1e-9);
        assert!(own.gap <= 1e-7, "{own:?}");
        let same =
            (0..2).all(|t| bound.model.latents[t].coefficients[region] == free.model.latents[t].coefficients[region]);
        assert_eq!(same, own.free_norm <= 1.0, "what contracts already stays to the bit");
        stayed += usize::from(same);
    }
    assert!(stayed > 0 && stayed < 30 && told.moved() == 30 - stayed);
    // The price is told, and it is the free fit's own loss beside it.
    let score = &bound.candidates[0];
    assert!((score.free_loss - free.candidates[0].loss).abs() < 1e-12);
    // Noise made the regions wild: bound ones predict rows that did not train no worse here.
    assert!(score.loss < 1.02 * score.free_loss, "{} {}", score.loss, score.free_loss);
    // Whatever region follows on whatever: no product of maps is larger than 1 in the metric.
    let mut random = Pcg64::seed_from_u64(3);
    let mut product = Mat::<f64>::identity(2, 2);
    for _ in 0..500 {
        product = map(&bound.model, random.random_range(0..30), 2) * &product;
        assert!(norm(&product, &P) <= 1.0 + 1e-9);
    }
}

/// The squared errors of a region's rows are least among maps within the bound: none that is found by random steps is better by more than the gap.
#[test]
fn no_map_within_the_bound_has_less_error() {
    let source = oscillator(1000, 2);
    let found = run(&problem(), &options("average", Some(0.9)), &source);
    let told = found.candidates[0].stability.as_ref().unwrap();
    let P = metric(told);
    let blocks: Vec<_> = (0..5).map(|e| source.read(e, 0..200, Halo::default()).unwrap()).collect();
    let rows: Vec<[f64; 5]> = blocks
        .iter()
        .flat_map(|block| {
            (0..199).map(|k| {
                let [x, v, u] = [0, 1, 2].map(|c| block.core(c)[k]);
                [x, v, u, block.core(0)[k + 1], block.core(1)[k + 1]]
            })
        })
        .collect();
    // The variances of the errors of the free one-region model: the weights of the two targets.
    let free = run(&problem(), &options("average", None), &source).model;
    let error = |coefficients: &[[f64; 3]; 2], constants: [f64; 2], t: usize| -> f64 {
        let of = |row: &[f64; 5]| row[3 + t] - constants[t] - (0..3).map(|j| coefficients[t][j] * row[j]).sum::<f64>();
        rows.iter().map(|row| of(row).powi(2)).sum()
    };
    let numbers = |model: &Model| {
        let of = |t: usize| [0, 1, 2].map(|j| model.latents[t].coefficients[0][j]);
        ([of(0), of(1)], [model.latents[0].constants[0], model.latents[1].constants[0]])
    };
    let ((free, free_constants), (own, constants)) = (numbers(&free), numbers(&found.model));
    let variance = [0, 1].map(|t| error(&free, free_constants, t) / rows.len() as f64);
    let price = |coefficients: &[[f64; 3]; 2], constants: [f64; 2]| -> f64 {
        (0..2).map(|t| error(coefficients, constants, t) / variance[t]).sum()
    };
    let (least, best) = (price(&free, free_constants), price(&own, constants));
    assert!(best > least, "the bound costs something here");
    let mut random = Pcg64::seed_from_u64(5);
    let mut within = 0;
    for size in [1e-2, 1e-3, 1e-4] {
        for _ in 0..2000 {
            let mut other = own;
            let mut shift = constants;
            other
                .iter_mut()
                .flatten()
                .chain(&mut shift)
                .for_each(|value| *value += size * random.random_range(-1.0..1.0));
            let M = Mat::from_fn(2, 2, |i, j| other[i][j]);
            if norm(&M, &P) <= 0.9 {
                within += 1;
                assert!(price(&other, shift) >= best - 1e-6 * (best - least), "{} {best}", price(&other, shift));
            }
        }
    }
    assert!(within > 500, "{within}");
}

/// Coefficients that left the bound go to the nearest ones of it: from there no way within the bound leads nearer, the condition of a least distance over a convex set. What is within stays to the bit.
#[test]
fn models_are_kept_within_the_bound_where_they_are_nearest() {
    let source = oscillator(2000, 4);
    let found = run(&problem(), &options("kmeans:8", Some(0.98)), &source);
    let stability = found.candidates[0].stability.as_ref().unwrap();
    let (set, P) = (Contracting::new(&problem(), stability).unwrap(), metric(stability));
    let mut random = Pcg64::seed_from_u64(11);
    let weights: Vec<RegionWeight> = (0..8)
        .map(|_| {
            let root = Mat::from_fn(9, 4, |_, j| if j == 0 { 1.0 } else { random.random_range(-1.0..2.0) });
            RegionWeight::new(root.transpose() * &root, vec![1.0, random.random_range(0.2..5.0)])
        })
        .collect();
    let mut moved = |size: f64| {
        let mut model = found.model.clone();
        for latent in &mut model.latents {
            latent.constants.iter_mut().for_each(|value| *value += size * random.random_range(-1.0..1.0));
            latent.coefficients.iter_mut().flatten().for_each(|value| *value += size * random.random_range(-1.0..1.0));
        }
        model
    };
    let numbers = |model: &Model, region: usize, t: usize| -> Vec<f64> {
        let own = &model.latents[t];
        std::iter::once(own.constants[region]).chain(own.coefficients[region].iter().copied()).collect()
    };
    let wanted = moved(0.3);
    let nearest = set.nearest(&wanted, &weights).unwrap();
    let others: Vec<Model> = (0..200).map(|k| set.nearest(&moved(0.02 + 0.01 * k as f64), &weights).unwrap()).collect();
    let mut left = 0;
    for region in 0..8 {
        let within = norm(&map(&wanted, region, 2), &P) <= 0.98;
        assert!(norm(&map(&nearest, region, 2), &P) <= 0.98 + 1e-9);
        let same = (0..2).all(|t| numbers(&wanted, region, t) == numbers(&nearest, region, t));
        assert_eq!(same, within);
        left += usize::from(!within);
        // sum_t weight_t (wanted - nearest)' G (other - nearest)
        let along = |to: &Model| -> f64 {
            let of = |t: usize| {
                let at = numbers(&nearest, region, t);
                let away = |model: &Model| Mat::from_fn(4, 1, |j, _| numbers(model, region, t)[j] - at[j]);
                weights[region].targets[t] * (away(&wanted).transpose() * &weights[region].products * away(to))[(0, 0)]
            };
            (0..2).map(of).sum()
        };
        let size = along(&wanted);
        for other in others.iter().chain([&found.model]) {
            // The gap is a millionth of the squared distance, and a thousandth its root.
            assert!(along(other) <= 3e-3 * (size + size.sqrt()), "{region}: {} {size}", along(other));
        }
    }
    assert!(left >= 3, "{left}");
    let told = set.told(stability, &nearest);
    assert!(told.regions.iter().all(|own| own.norm <= 0.98 + 1e-9 && own.radius <= own.norm + 1e-9));
}

#[test]
fn earlier_rows_are_part_of_the_map() {
    let source = oscillator(1500, 3);
    let mut problem = problem();
    problem.columns = vec![column("x", Role::State), column("u", Role::Input), column("v", Role::Auxiliary)];
    problem.library = vec![Expr::column("x"), Expr::lagged("x", 1), Expr::column("u")];
    problem.equations = vec![equation("x", Prediction::Next, "f_x", Some(Expr::lagged("x", -1)))];
    problem.partition_columns = vec![Expr::column("x"), Expr::lagged("x", 1)];
    let found = run(&problem, &options("kmeans:20", Some(0.999)), &source);
    let told = found.candidates[0].stability.as_ref().unwrap();
    assert_eq!(told.variables, ["x", "lag(x, 1)"]);
    assert!(told.moved() > 0);
    let P = metric(told);
    for region in 0..20 {
        let [a, b] = [0, 1].map(|j| found.model.latents[0].coefficients[region][j]);
        let M = Mat::from_fn(2, 2, |i, j| [[a, b], [1.0, 0.0]][i][j]);
        assert!(norm(&M, &P) <= 0.999 + 1e-9);
        assert!(spectral_radius(M.as_ref()) <= 0.999 + 1e-9);
    }
}

#[test]
fn given_equations_are_part_of_the_map_and_derivatives_are_steps() {
    let source = oscillator(1500, 4);
    let mut problem = problem();
    problem.equations = vec![
        Equation { right: Expr::column("v"), ..equation("x", Prediction::Derivative, "v", None) },
        equation(
            "v",
            Prediction::Derivative,
            "f_v",
            Some((Expr::lagged("v", -1) - &Expr::column("v")) / Expr::number(0.05)),
        ),
    ];
    let found = run(&problem, &options("kmeans:20", Some(1.0)), &source);
    let told = found.candidates[0].stability.as_ref().unwrap();
    let P = metric(told);
    let maps: Vec<Mat<f64>> = (0..20)
        .map(|region| {
            let [a, b] = [0, 1].map(|j| found.model.latents[0].coefficients[region][j]);
            Mat::from_fn(2, 2, |i, j| [[1.0, 0.05], [0.05 * a, 1.0 + 0.05 * b]][i][j])
        })
        .collect();
    match told.variables.len() {
        2 => maps.iter().for_each(|M| assert!(norm(M, &P) <= 1.0 + 1e-9)),
        // The positions act as an input.
        _ => {
            assert_eq!(told.inputs, ["x"]);
            maps.iter().for_each(|M| assert!(M[(1, 1)].abs() <= 1.0 + 1e-9));
        }
    }
}

#[test]
fn threads_do_not_matter_and_what_cannot_be_bound_is_refused() {
    let source = oscillator(1000, 6);
    let options = options("average,kmeans:12", Some(0.97));
    let one = with_threads(1, || run(&problem(), &options, &source));
    let three = with_threads(3, || run(&problem(), &options, &source));
    assert_eq!(one.model.to_json(), three.model.to_json());
    assert_eq!(one.candidates[1].stability, three.candidates[1].stability);
    let mut bent = problem();
    bent.library.push(Expr::parse("v^3", &Scope::open()).unwrap());
    let refused = identify(&bent, &options, &source, &Silent).unwrap_err();
    assert!(matches!(&refused, Error::Bends { state, .. } if state == "v"), "{refused}");
    let mut open = problem();
    open.library = vec![Expr::column("u")];
    let refused = identify(&open, &options, &source, &Silent).unwrap_err();
    assert!(matches!(refused, Error::NothingToBound), "{refused}");
}
