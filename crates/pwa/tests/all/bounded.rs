//! Common parts of the tests of contracting and of passive maps: two states and an input, and rows of next values. Also
//! the least and nearest maps within a bound.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::Mat;
use fleetfoot_data::{Halo, MemorySource, Silent, Source};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Column, Equation, Model, Prediction, Role};
use fleetfoot_pwa::{
    Contracting, Identification, Options, Problem, RegionWeight, Shrinkage, Specification, Stability, identify,
};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

/// Seconds from row to row.
pub(crate) const H: f64 = 0.05;

pub(crate) fn equation(subject: &str, prediction: Prediction, right: &str, target: Option<Expr>) -> Equation {
    let right = Expr::parse(right, &Scope::open()).unwrap();
    Equation { subject: subject.into(), prediction, right, target, unit: None }
}

/// The next values of states x and v by these, and by an input.
pub(crate) fn next_rows(input: &str) -> Problem {
    let next = |name: &str| Some(Expr::lagged(name, -1));
    let columns = [("x", Role::State), ("v", Role::State), (input, Role::Input)];
    Problem {
        columns: columns.map(|(name, role)| Column::new(name, role)).to_vec(),
        library: ["x", "v", input].map(Expr::column).to_vec(),
        equations: vec![
            equation("x", Prediction::Next, "f_x", next("x")),
            equation("v", Prediction::Next, "f_v", next("v")),
        ],
        partition_columns: vec![Expr::column("x"), Expr::column("v")],
        weight: None,
        step: H,
    }
}

/// Five folds, and nothing bounded.
pub(crate) fn options(partitions: &str) -> Options {
    let mut options = Options::default();
    options.partitions = Specification::parse_list(partitions).unwrap();
    options.folds = 5;
    // Check of the least squared error within a bound.
    options.shrinkage = Shrinkage::Rows(0.0);
    options
}

pub(crate) fn run(problem: &Problem, options: &Options, source: &MemorySource) -> Identification {
    identify(problem, options, source, &Silent).unwrap()
}

/// The reported metric, which is twice the energy if maps are passive.
pub(crate) fn metric(stability: &Stability) -> Mat<f64> {
    let n = stability.variables.len();
    Mat::from_fn(n, n, |i, j| stability.metric[i * n + j])
}

/// A target's numbers: the constant, then the coefficients of x, v and the input.
pub(crate) type Numbers = [f64; 4];

fn numbers(model: &Model, region: usize, target: usize) -> Numbers {
    let latent = &model.latents[target];
    let [x, v, input] = [0, 1, 2].map(|j| latent.affine().unwrap().coefficients[region][j]);
    [latent.affine().unwrap().constants[region], x, v, input]
}

/// Squared errors of a source's rows, each target's over its residual variance in the free one-region model: the price
/// that a bounded map keeps least.
pub(crate) struct Price {
    rows: Vec<[f64; 5]>,
    variance: [f64; 2],
}

impl Price {
    /// Of the columns x, v and input of a source, in this order; `free` is the model without a bound.
    pub(crate) fn new(source: &MemorySource, free: &Model) -> Self {
        let rows = (0..source.episodes().len()).flat_map(|episode| {
            let length = source.episodes()[episode].rows;
            let block = source.read(episode, 0..length, Halo::default()).unwrap();
            let of = |column: usize, row: usize| block.core(column)[row];
            (0..length - 1).map(|k| [of(0, k), of(1, k), of(2, k), of(0, k + 1), of(1, k + 1)]).collect::<Vec<_>>()
        });
        let mut price = Self { rows: rows.collect(), variance: [1.0; 2] };
        price.variance = [0, 1].map(|t| price.squares(&numbers(free, 0, t), t) / price.rows.len() as f64);
        price
    }

    fn squares(&self, numbers: &Numbers, target: usize) -> f64 {
        let of = |row: &[f64; 5]| row[3 + target] - numbers[0] - (0..3).map(|j| numbers[j + 1] * row[j]).sum::<f64>();
        self.rows.iter().map(|row| of(row).powi(2)).sum()
    }

    fn of(&self, numbers: &[Numbers; 2]) -> f64 {
        (0..2).map(|t| self.squares(&numbers[t], t) / self.variance[t]).sum()
    }

    /// Asserts that none of many maps near to that of a model is within the bound and costs less, by more than its gap.
    /// The bound has a cost.
    pub(crate) fn is_least(&self, model: &Model, is_within: impl Fn(&[Numbers; 2]) -> bool) {
        let numbers_of = [0, 1].map(|t| numbers(model, 0, t));
        let (least, best) = (2.0 * self.rows.len() as f64, self.of(&numbers_of));
        assert!(best > least * (1.0 + 1e-6), "the bound costs something here: {best} {least}");
        let mut random = Pcg64::seed_from_u64(5);
        let mut within = 0;
        for size in [1e-2, 1e-3, 1e-4] {
            for _ in 0..6000 {
                let mut other = numbers_of;
                other.iter_mut().flatten().for_each(|value| *value += size * random.random_range(-1.0..1.0));
                if is_within(&other) {
                    within += 1;
                    assert!(self.of(&other) >= best - 1e-6 * (best - least), "{} {best}", self.of(&other));
                }
            }
        }
        assert!(within > 400, "{within}");
    }
}

/// Coefficients that left a bound by steps of a size go to the nearest ones of it. From there no way within the bound
/// leads nearer, the condition of a least distance over a convex set. Coefficients within stay to the bit. `is_within`
/// tests a region, with optional room for rounding. Returns the moved models.
pub(crate) fn goes_to_the_nearest(
    set: &Contracting,
    model: &Model,
    size: f64,
    is_within: impl Fn(&Model, usize, bool) -> bool,
) -> Model {
    let regions = model.latents[0].affine().unwrap().constants.len();
    let mut random = Pcg64::seed_from_u64(11);
    let mut weight = || {
        let root = Mat::from_fn(9, 4, |_, j| if j == 0 { 1.0 } else { random.random_range(-1.0..2.0) });
        RegionWeight::new(root.transpose() * &root, vec![1.0, random.random_range(0.2..5.0)])
    };
    let weights: Vec<RegionWeight> = (0..regions).map(|_| weight()).collect();
    let mut moved = |size: f64| {
        let mut model = model.clone();
        for latent in &mut model.latents {
            latent
                .affine_mut()
                .unwrap()
                .constants
                .iter_mut()
                .for_each(|value| *value += size * random.random_range(-1.0..1.0));
            latent
                .affine_mut()
                .unwrap()
                .coefficients
                .iter_mut()
                .flatten()
                .for_each(|value| *value += size * random.random_range(-1.0..1.0));
        }
        model
    };
    let wanted = moved(size);
    let nearest = set.nearest(&wanted, &weights).unwrap();
    let other = |k: u32| set.nearest(&moved(size * (0.05 + 0.03 * f64::from(k))), &weights).unwrap();
    let others: Vec<Model> = (0..200).map(other).collect();
    let mut left = 0;
    for region in 0..regions {
        let within = is_within(&wanted, region, false);
        assert!(is_within(&nearest, region, true));
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
        let distance = along(&wanted);
        for other in others.iter().chain([model]) {
            // The gap is a millionth of the squared distance, and a thousandth its root.
            assert!(along(other) <= 3e-3 * (distance + distance.sqrt()), "{region}: {} {distance}", along(other));
        }
    }
    assert!(left >= 3, "{left}");
    nearest
}
