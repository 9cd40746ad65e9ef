//! Regions that are passive with one storage: the inequality, the price and the consequence for loops are checked from
//! the model's numbers.

// Matrices are capitals.
#![allow(non_snake_case)]

use faer::{Mat, Side};
use fleetfoot_data::{Column as DataColumn, MemorySource, Silent, with_threads};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_model::{Column, Model, Prediction, Role};
use fleetfoot_pwa::{Contracting, Error, Options, Port, Problem, Stability, identify};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;

use crate::bounded::{self, H, Price, equation, goes_to_the_nearest, metric, run};

const MASS: f64 = 1.5;

/// A mass on a spring that is stiffer under compression, hardly damped, with a force on it: exact steps by many small
/// ones. Rows `x, v, f, dv`.
fn mass(rows: usize, seed: u64, noise: f64) -> MemorySource {
    let mut random = Pcg64::seed_from_u64(seed);
    let mut source = MemorySource::new(["x", "v", "f", "dv"].map(DataColumn::float).to_vec());
    for _ in 0..5 {
        let (mut x, mut v) = (0.5_f64, 0.0_f64);
        let mut columns = vec![Vec::new(); 4];
        for _ in 0..rows / 5 {
            let f: f64 = random.random_range(-4.0..4.0);
            let acceleration = |x: f64, v: f64| (f - if x > 0.0 { 4.0 } else { 9.0 } * x - 0.1 * v) / MASS;
            let mut error = || noise * random.random_range(-1.0..1.0);
            let measured = [x + error(), v + error(), f, acceleration(x, v) + error()];
            columns.iter_mut().zip(measured).for_each(|(column, value)| column.push(value));
            let small = H / 500.0;
            for _ in 0..500 {
                // Symplectic, so that the steps take no energy.
                v += small * acceleration(x, v);
                x += small * v;
            }
        }
        source.push_uniform("run", H, columns);
    }
    source
}

fn next_rows() -> Problem {
    bounded::next_rows("f")
}

/// `x' = v` is given, `v'` measured.
fn derivatives() -> Problem {
    let mut problem = next_rows();
    problem.columns.push(Column::new("dv", Role::Auxiliary));
    problem.equations = vec![
        equation("x", Prediction::Derivative, "v", None),
        equation("v", Prediction::Derivative, "f_v", Some(Expr::column("dv"))),
    ];
    problem
}

fn options(partitions: &str, ports: Vec<Port>) -> Options {
    let mut options = bounded::options(partitions);
    options.ports = ports;
    options
}

fn force() -> Vec<Port> {
    vec![Port::new("f", "v")]
}

/// [M N] of a region: of next values the coefficients, of derivatives Euler's step.
fn map(model: &Model, region: usize) -> Mat<f64> {
    let row = |name: &str| {
        model
            .latents
            .iter()
            .find(|latent| latent.name == name)
            .map(|latent| &latent.affine().unwrap().coefficients[region])
    };
    match row("f_x") {
        Some(x) => Mat::from_fn(2, 3, |i, j| if i == 0 { x[j] } else { row("f_v").unwrap()[j] }),
        None => Mat::from_fn(2, 3, |i, j| match i {
            0 => [1.0, H, 0.0][j],
            _ => H * row("f_v").unwrap()[j] + [0.0, 1.0, 0.0][j],
        }),
    }
}

fn shortage(stability: &Stability) -> f64 {
    stability.passivity.as_ref().unwrap().ports[0].shortage.unwrap()
}

fn slack(map: &Mat<f64>, P: &Mat<f64>, shortage: f64) -> f64 {
    slack_at(map, P, shortage, 1.0)
}

/// The least eigenvalue of `S - [M N]'P[M N]` for the port f:v, in units in which S has ones on its diagonal.
fn slack_at(map: &Mat<f64>, P: &Mat<f64>, shortage: f64, rho: f64) -> f64 {
    let taken = map.transpose() * P * map;
    let supply = |i: usize, j: usize| match (i, j) {
        (2, 2) => H * shortage,
        (2, k) | (k, 2) => [0.0, H][k],
        _ => rho * rho * P[(i, j)],
    };
    let unit = |i: usize| supply(i, i).sqrt();
    let left = Mat::from_fn(3, 3, |i, j| (supply(i, j) - taken[(i, j)]) / (unit(i) * unit(j)));
    left.self_adjoint_eigenvalues(Side::Lower).unwrap()[0]
}

#[test]
fn all_regions_dissipate_with_the_reported_storage() {
    let source = mass(2000, 3, 0.15);
    for (problem, partitions) in [(next_rows(), "average,kmeans:8"), (derivatives(), "average,kmeans:8")] {
        let mut asked = options(partitions, force());
        asked.keep_all = true;
        let identification = run(&problem, &asked, &source);
        asked.ports.clear();
        let free = run(&problem, &asked, &source);
        for (at, candidate) in identification.candidates.iter().enumerate() {
            let stability = candidate.stability.as_ref().unwrap();
            let passivity = stability.passivity.as_ref().unwrap();
            let (P, E) = (metric(stability), shortage(stability));
            let mut active = 0;
            for (region, passive) in passivity.regions.iter().enumerate() {
                let (written, before) = (map(&identification.models[at], region), map(&free.models[at], region));
                // The program ends within the bound; rounding of three by three.
                assert!(
                    slack(&written, &P, E) >= -1e-12 && passive.norm <= 1.0,
                    "{region}: {}",
                    slack(&written, &P, E)
                );
                assert_eq!(passive.free > 1.0, slack(&before, &P, E) < 0.0, "{region}: {passive:?}");
                if passive.free <= 1.0 {
                    assert_eq!(written, before, "what is passive stays to the bit");
                }
                active += usize::from(passive.free > 1.0);
                assert!(stability.regions[region].norm <= 1.0 && stability.regions[region].radius <= 1.0);
            }
            assert_eq!(stability.moved(), active);
            assert!(partitions == "average" || at == 0 || active >= 4, "{active} of 8 regions had to move");
            // A mass of 1.5 is what the force meets: twice its kinetic energy is the storage of a speed.
            assert!((P[(1, 1)] / MASS - 1.0).abs() < 0.35, "{P:?}");
            // Sampling takes h/m, and twice that is allowed.
            assert!((E / (2.0 * H / MASS) - 1.0).abs() < 0.1, "{E}");
            assert!(candidate.loss >= candidate.free_loss - 3.0 * candidate.standard_error);
        }
        // Whatever region follows on whatever, no force draws more than went in and was stored.
        let (model, stability) = (&identification.models[1], identification.candidates[1].stability.as_ref().unwrap());
        let (P, E) = (metric(stability), shortage(stability));
        let mut random = Pcg64::seed_from_u64(9);
        for _ in 0..200 {
            let mut state = Mat::from_fn(2, 1, |_, _| random.random_range(-1.0..1.0));
            let energy = |x: &Mat<f64>| (x.transpose() * &P * x)[(0, 0)];
            let (start, mut supplied) = (energy(&state), 0.0);
            for _ in 0..100 {
                let f: f64 = -3.0 * state[(1, 0)] + random.random_range(-1.0..1.0);
                supplied += H * (2.0 * f * state[(1, 0)] + E * f * f);
                let map_of = map(model, random.random_range(0..8));
                state = map_of.subcols(0, 2) * &state + Mat::from_fn(2, 1, |i, _| map_of[(i, 2)] * f);
                assert!(energy(&state) <= start + supplied + 1e-9 * start.max(1.0));
            }
        }
        // A damper that takes no more than the shortage allows, 2 y / E, holds the loop in every region.
        for region in 0..8 {
            let map_of = map(model, region);
            for damper in [0.1, 1.0, 1.99 / E] {
                let loop_ = Mat::from_fn(2, 2, |i, j| map_of[(i, j)] - map_of[(i, 2)] * damper * [0.0, 1.0][j]);
                assert!(fleetfoot_stats::spectral_radius(loop_.as_ref()) <= 1.0 + 1e-9);
            }
        }
    }
}

/// The flow of a model of derivatives dissipates with the same shortage.
#[test]
fn the_flow_is_passive_too() {
    let identification = run(&derivatives(), &options("kmeans:6", force()), &mass(2000, 5, 0.3));
    let stability = identification.candidates[0].stability.as_ref().unwrap();
    let (P, E) = (metric(stability), shortage(stability));
    for region in 0..6 {
        let map_of = map(&identification.model, region);
        let [A, B] = [(0, 2), (2, 1)].map(|(first, count)| {
            let step =
                Mat::from_fn(2, count, |i, j| map_of[(i, first + j)] - f64::from(u8::from(first == 0 && i == j)));
            Mat::from_fn(2, count, |i, j| step[(i, j)] / H)
        });
        let (PA, PB) = (&P * &A, &P * &B);
        let balance = Mat::from_fn(3, 3, |i, j| match (i, j) {
            (2, 2) => -E,
            (2, k) | (k, 2) => PB[(k, 0)] - [0.0, 1.0][k],
            _ => PA[(i, j)] + PA[(j, i)],
        });
        let eigenvalues = balance.self_adjoint_eigenvalues(Side::Lower).unwrap();
        assert!(eigenvalues[2] <= 1e-9, "{region}: {eigenvalues:?}");
    }
}

/// Steps of a passive system are passive with the shortage that sampling takes: nothing moves, nothing is paid.
#[test]
fn passive_models_are_not_changed() {
    let source = mass(2000, 1, 0.0);
    // The regions that the spring has.
    let mut problem = next_rows();
    problem.partition_columns = vec![Expr::column("x")];
    let identification = run(&problem, &options("average", force()), &source);
    let stability = identification.candidates[0].stability.as_ref().unwrap();
    assert_eq!(
        (stability.moved(), identification.candidates[0].loss),
        (0, identification.candidates[0].free_loss),
        "{stability:?}"
    );
    // Less than what sampling takes is not to be had for nothing.
    let port = Port { shortage: Some(0.8 * H / MASS), ..force().remove(0) };
    let tight = run(&problem, &options("average", vec![port]), &source);
    let candidate = &tight.candidates[0];
    let stability = candidate.stability.as_ref().unwrap();
    assert!(
        stability.moved() == 1 && candidate.loss > 1.5 * candidate.free_loss,
        "{} {}",
        candidate.loss,
        candidate.free_loss
    );
    assert!(slack(&map(&tight.model, 0), &metric(stability), 0.8 * H / MASS) >= -1e-12);
}

/// The squared errors of the rows are least among passive maps: none that is found by random steps is better by more than the gap.
#[test]
fn no_passive_map_has_less_error() {
    let source = mass(1000, 2, 0.4);
    let mut asked = options("average", force());
    asked.stability = Some(0.75);
    let identification = run(&next_rows(), &asked, &source);
    let stability = identification.candidates[0].stability.as_ref().unwrap();
    assert_eq!(stability.moved(), 1, "{stability:?}");
    let (P, E) = (metric(stability), shortage(stability));
    let free = run(&next_rows(), &options("average", Vec::new()), &source).model;
    let is_within = |map_of: &[[f64; 4]; 2]| slack_at(&Mat::from_fn(2, 3, |i, j| map_of[i][j + 1]), &P, E, 0.75) >= 0.0;
    Price::new(&source, &free).is_least(&identification.model, is_within);
}

/// Coefficients that left the set go to where no way within it leads nearer.
#[test]
fn passive_models_are_the_nearest() {
    let identification = run(&next_rows(), &options("kmeans:6", force()), &mass(2000, 4, 0.15));
    let stability = identification.candidates[0].stability.as_ref().unwrap();
    let (P, E) = (metric(stability), shortage(stability));
    let set = Contracting::new(&next_rows(), stability).unwrap();
    let is_within = |model: &Model, region: usize, rounded: bool| {
        slack(&map(model, region), &P, E) >= if rounded { -1e-12 } else { 0.0 }
    };
    let nearest = goes_to_the_nearest(&set, &identification.model, 0.2, is_within);
    let again = set.stability_of(stability, &nearest);
    assert!(again.passivity.unwrap().regions.iter().all(|region| region.norm <= 1.0 + 1e-9));
}

#[test]
fn threads_do_not_matter_and_wrong_ports_are_refused() {
    let source = mass(1000, 7, 0.2);
    let asked = options("kmeans:5", force());
    let one = with_threads(1, || run(&next_rows(), &asked, &source));
    let seven = with_threads(7, || run(&next_rows(), &asked, &source));
    assert_eq!(one.model.to_json(), seven.model.to_json());
    assert_eq!(one.candidates[0].stability, seven.candidates[0].stability);
    let mut bent = next_rows();
    bent.library.push(Expr::parse("f*abs(f)", &Scope::open()).unwrap());
    let mut late = next_rows();
    late.library.push(Expr::lagged("f", 1));
    for (problem, port, part) in [
        (next_rows(), ("g", "v"), "no regressor reads its input"),
        (next_rows(), ("f", "w"), "its output is not a state"),
        (next_rows(), ("x", "v"), "the model predicts its input"),
        (bent, ("f", "v"), "`f*abs(f)` is not linear"),
        (late, ("f", "v"), "at the row"),
    ] {
        let asked = options("average", vec![Port::new(port.0, port.1)]);
        let error = identify(&problem, &asked, &source, &Silent).unwrap_err();
        assert!(matches!(error, Error::NoPort { .. }) && error.to_string().contains(part), "{error}");
    }
    let twice = options("average", vec![Port::new("f", "v"), Port::new("f", "x")]);
    let error = identify(&next_rows(), &twice, &source, &Silent).unwrap_err();
    assert!(error.to_string().contains("another port"), "{error}");
}
