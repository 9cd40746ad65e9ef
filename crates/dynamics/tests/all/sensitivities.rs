//! Derivatives of simulations by coefficients, beside differences of simulations.

use crate::common::*;
use fleetfoot_data::{MemorySource, Source};
use fleetfoot_dynamics::{
    Coefficient, Error, Method, NormalBlocks, Products, Segment, Shooting, ShootingOptions, Step,
};
use fleetfoot_model::{Column, Model, Partition, Prediction, Role, RotationKind, RotationPart, Rule};
use proptest::prelude::*;

/// Every segment of a source.
fn segments(model: &Model, source: &MemorySource, options: &ShootingOptions) -> Vec<Segment> {
    let coefficients = Coefficient::support(model);
    let shooting = Shooting::new(model, source, &coefficients, options).unwrap();
    let mut list = Vec::new();
    for (episode, info) in source.episodes().iter().enumerate() {
        let block = source.read(episode, 0..info.rows, shooting.halo()).unwrap();
        assert_eq!(shooting.segments(episode, &block, 0..info.rows, |segment| list.push(segment)), 0);
    }
    list
}

/// The greatest difference between the slopes and central differences of the residuals, relative to the greatest slope of a segment.
fn worst(model: &Model, source: &MemorySource, options: &ShootingOptions) -> f64 {
    let coefficients = Coefficient::support(model);
    let at_start = segments(model, source, options);
    assert!(
        !at_start.is_empty() && at_start.iter().all(|segment| segment.is_finite() && !segment.residuals.is_empty())
    );
    let mut worst = 0.0_f64;
    for (number, coefficient) in coefficients.iter().enumerate() {
        let value = coefficient.value(model);
        let step = 1e-7 * value.abs().max(1.0);
        let moved = |sign: f64| {
            let mut model = model.clone();
            coefficient.set(&mut model, value + sign * step);
            segments(&model, source, options)
        };
        for ((segment, more), less) in at_start.iter().zip(moved(1.0)).zip(moved(-1.0)) {
            let n = segment.residuals.len();
            let size = segment.slopes.iter().fold(1e-2_f64, |size, slope| size.max(slope.abs()));
            let at = segment.active.iter().position(|&active| active == number);
            for row in 0..n {
                let difference = (more.residuals[row] - less.residuals[row]) / (2.0 * step);
                let slope = at.map_or(0.0, |at| segment.slopes[at * n + row]);
                worst = worst.max((slope - difference).abs() / size);
            }
        }
    }
    worst
}

/// Two states, one an angle; an input; library functions of all kinds, of earlier rows and of time; coefficients from the seed.
fn tangled(seed: u64, prediction: Prediction, regions: usize) -> (Model, MemorySource) {
    let library = ["q", "v", "u", "sin(q)", "v^2", "lag(v,1)*u", "cos(time())", "lag(q,2)"];
    let columns =
        vec![column("q", Role::State, true), column("v", Role::State, false), column("u", Role::Input, false)];
    let rule = match regions {
        1 => Rule::Whole,
        _ => Rule::voronoi((0..regions).map(|r| vec![1.2 * noise(seed + 900 + r as u64)]).collect()),
    };
    let partition = if regions == 1 { Partition::whole() } else { partition(&["v"], &[0.1], &[0.7], rule) };
    let size = if prediction == Prediction::Next { 0.12 } else { 0.8 };
    let maps = |state: u64| -> Vec<(f64, Vec<f64>)> {
        let number = |region: usize, j: usize| size * noise(seed + 1000 * state + 40 * region as u64 + j as u64);
        let map = |region: usize| (number(region, 20), (0..library.len()).map(|j| number(region, j)).collect());
        (0..regions).map(map).collect()
    };
    let fitted = vec![("q", prediction, "1", maps(1)), ("v", prediction, "1", maps(2))];
    let mut model = model(columns, &library, partition, fitted, &[]);
    // A right side in which a latent stands within a product.
    model.equations[1].right = parse("latent_v*(1 + 0.2*u) - 0.1*q");
    // Every other model has radial functions too, of a function of earlier rows among others.
    if seed.is_multiple_of(2) {
        model = with_radial(model, &[5, 1, 3], seed);
    } else if seed % 4 == 1 {
        model = with_beyond(model, [-0.4, 0.5], seed);
    }
    let values = |shift: f64| (0..60).map(|k| (0.13 * k as f64 + shift).sin()).collect::<Vec<f64>>();
    let source = source(
        &["q", "v", "u"],
        0.02,
        vec![vec![values(0.0), values(1.0), values(2.5)], vec![values(4.0), values(0.4), values(3.0)]],
    );
    (model, source)
}

fn options(steps: usize, method: Method) -> ShootingOptions {
    let mut options = ShootingOptions::new(steps);
    options.method = method;
    options
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Central differences with steps of 1e-7 are good to some 1e-9 of the residuals' size; within a region the model is smooth.
    #[test]
    fn slopes_match_simulations(seed in 0u64..1 << 40, steps in 1usize..9, kind in 0usize..4, regions in 1usize..4) {
        let (prediction, method) = [
            (Prediction::Derivative, Method::Rk4),
            (Prediction::Derivative, Method::Euler),
            (Prediction::Difference, Method::Rk4),
            (Prediction::Next, Method::Euler),
        ][kind];
        let (model, source) = tangled(seed, prediction, regions);
        let worst = worst(&model, &source, &options(steps, method));
        prop_assert!(worst < 1e-6, "{worst:e}");
    }
}

/// Products of all segments of a source with a direction, or with their residuals.
fn products(model: &Model, source: &MemorySource, options: &ShootingOptions, direction: Option<&[f64]>) -> Products {
    let coefficients = Coefficient::support(model);
    let shooting = Shooting::new(model, source, &coefficients, options).unwrap();
    let mut sums = Products::new(coefficients.len());
    for (episode, info) in source.episodes().iter().enumerate() {
        let block = source.read(episode, 0..info.rows, shooting.halo()).unwrap();
        assert_eq!(shooting.products(episode, &block, (0..info.rows, 1), direction, &mut sums), 0);
    }
    sums
}

/// `J'u`, dense, for one number u of every row of J.
fn dense(segments: &[Segment], p: usize, of: impl Fn(&Segment, usize) -> f64) -> (Vec<f64>, f64) {
    let (mut back, mut square) = (vec![0.0; p], 0.0);
    for segment in segments {
        let n = segment.residuals.len();
        for row in 0..n {
            let value = of(segment, row);
            square += value * value;
            segment.active.iter().enumerate().for_each(|(at, &to)| back[to] += segment.slopes[at * n + row] * value);
        }
    }
    (back, square)
}

/// A body whose rates are fitted and turn its attitude, in steps that leave the unit sphere.
#[test]
fn products_follow_rotations_back() {
    let names = ["qw", "qx", "qy", "qz", "wx", "wy", "wz"];
    let columns = names.iter().enumerate().map(|(part, name)| {
        let rotation = RotationPart { group: "attitude".into(), kind: RotationKind::Quaternion, part };
        Column { rotation: Some(rotation).filter(|_| part < 4), ..column(name, Role::State, false) }
    });
    let fitted = |name, shift: f64| {
        let numbers: Vec<f64> = (0..4).map(|j| 0.4 * (shift + 1.3 * f64::from(j)).sin()).collect();
        (name, Prediction::Derivative, "1", vec![(0.3 * shift.cos(), numbers)])
    };
    let given = [
        ("qw", Prediction::Derivative, "-0.5*(qx*wx + qy*wy + qz*wz)"),
        ("qx", Prediction::Derivative, "0.5*(qw*wx + qy*wz - qz*wy)"),
        ("qy", Prediction::Derivative, "0.5*(qw*wy - qx*wz + qz*wx)"),
        ("qz", Prediction::Derivative, "0.5*(qw*wz + qx*wy - qy*wx)"),
    ];
    let fitted = vec![fitted("wx", 0.0), fitted("wy", 1.0), fitted("wz", 2.0)];
    let library = ["wy*wz", "wz*wx", "wx*wy", "qx"];
    let mut model = model(columns.collect(), &library, Partition::whole(), fitted, &given);
    model.training.state_mean = vec![1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let rows = 0..60;
    let angle = |k: i32| 0.4 * f64::from(k);
    let values = vec![
        rows.clone().map(|k| (0.5 * angle(k)).cos()).collect(),
        rows.clone().map(|k| 0.6 * (0.5 * angle(k)).sin()).collect(),
        rows.clone().map(|k| -0.8 * (0.5 * angle(k)).sin()).collect(),
        vec![0.0; 60],
        rows.clone().map(|k| 5.0 + angle(k).sin()).collect(),
        rows.clone().map(|k| -6.0 + angle(k).cos()).collect(),
        rows.map(|k| 2.0 * (0.3 * angle(k)).sin()).collect(),
    ];
    let source = source(&names, 0.1, vec![values]);
    let p = Coefficient::support(&model).len();
    let direction: Vec<f64> = (0..p).map(|j| noise(7 * j as u64)).collect();
    for method in [Method::Euler, Method::Rk4] {
        let options = options(6, method);
        let segments = segments(&model, &source, &options);
        let along = |segment: &Segment, row: usize| {
            let n = segment.residuals.len();
            segment.active.iter().enumerate().map(|(at, &j)| segment.slopes[at * n + row] * direction[j]).sum::<f64>()
        };
        for (products, expected) in [
            (products(&model, &source, &options, None), dense(&segments, p, |segment, row| segment.residuals[row])),
            (products(&model, &source, &options, Some(&direction)), dense(&segments, p, along)),
        ] {
            let size = expected.0.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
            assert!(size > 1e-3 && products.segments > 5);
            for (value, other) in products.back.iter().zip(&expected.0) {
                assert!((value - other).abs() <= 1e-11 * size, "{method:?} {value} {other}");
            }
            assert!((products.square - expected.1).abs() <= 1e-12 * expected.1);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Products with one vector are those of the dense derivatives up to the rounding of sums of some hundred terms.
    #[test]
    fn products_match_derivatives(seed in 0u64..1 << 40, steps in 1usize..9, kind in 0usize..4, regions in 1usize..4) {
        let (prediction, method) = [
            (Prediction::Derivative, Method::Rk4),
            (Prediction::Derivative, Method::Euler),
            (Prediction::Difference, Method::Rk4),
            (Prediction::Next, Method::Euler),
        ][kind];
        let (model, source) = tangled(seed, prediction, regions);
        let options = options(steps, method);
        let segments = segments(&model, &source, &options);
        let p = Coefficient::support(&model).len();
        let direction: Vec<f64> = (0..p).map(|j| noise(seed + 7 * j as u64)).collect();
        let along = |segment: &Segment, row: usize| {
            let n = segment.residuals.len();
            segment.active.iter().enumerate().map(|(at, &j)| segment.slopes[at * n + row] * direction[j]).sum::<f64>()
        };
        for (products, expected) in [
            (products(&model, &source, &options, None), dense(&segments, p, |segment, row| segment.residuals[row])),
            (products(&model, &source, &options, Some(&direction)), dense(&segments, p, along)),
        ] {
            let size = expected.0.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
            for (value, other) in products.back.iter().zip(&expected.0) {
                prop_assert!((value - other).abs() <= 1e-11 * size, "{value} {other}");
            }
            prop_assert!((products.square - expected.1).abs() <= 1e-12 * expected.1);
            prop_assert!(products.finite && products.segments == segments.len() as u64);
        }
    }

    /// The normal matrix of one step is that of segments of one step, whatever the length of the segments whose rows it has.
    #[test]
    fn one_step_normal_matrix_matches_short_segments(seed in 0u64..1 << 40, steps in 1usize..5, regions in 1usize..4) {
        let (model, source) = tangled(seed, Prediction::Derivative, regions);
        let coefficients = Coefficient::support(&model);
        let of = |steps: usize| {
            let shooting = Shooting::new(&model, &source, &coefficients, &options(steps, Method::Euler)).unwrap();
            let mut blocks = NormalBlocks::new(&coefficients);
            // As many rows, whatever the steps: 48 from the first start on.
            let block = source.read(0, 0..60, shooting.halo()).unwrap();
            shooting.normal(0, &block, 0..shooting.halo().before + 49 - steps, &mut blocks);
            blocks
        };
        let mut dense = vec![vec![0.0; coefficients.len()]; coefficients.len()];
        let shooting = Shooting::new(&model, &source, &coefficients, &options(1, Method::Euler)).unwrap();
        let block = source.read(0, 0..60, shooting.halo()).unwrap();
        shooting.segments(0, &block, 0..shooting.halo().before + 48, |segment| {
            let n = segment.residuals.len();
            for (a, &i) in segment.active.iter().enumerate() {
                for (b, &j) in segment.active.iter().enumerate() {
                    dense[i][j] += (0..n).map(|row| segment.slopes[a * n + row] * segment.slopes[b * n + row]).sum::<f64>();
                }
            }
        });
        let mut seen = 0;
        for (range, values) in of(steps).blocks() {
            seen += range.len();
            let size = range.clone().map(|i| dense[i][i]).fold(1e-9, f64::max);
            for (at, value) in values.iter().enumerate() {
                let (i, j) = (range.start + at / range.len(), range.start + at % range.len());
                prop_assert!((value * steps as f64 - dense[i][j]).abs() <= 1e-12 * size, "{i} {j}: {value} {}", dense[i][j]);
            }
        }
        prop_assert_eq!(seen, coefficients.len());
    }
}

#[test]
fn the_affine_path_has_the_same_slopes() {
    let (model, source) = random_hybrid(3, 2, 4, 80);
    for method in [Method::Euler, Method::Rk4] {
        let worst = worst(&model, &source, &options(6, method));
        assert!(worst < 1e-6, "{worst:e}");
    }
}

/// x' = a x from x0: after k Euler steps of h, x0 (1 + h a)^k, and its derivative k h x0 (1 + h a)^(k-1).
#[test]
fn slopes_of_a_decay_have_a_closed_form() {
    let (a, h) = (-0.7, 0.1);
    let columns = vec![column("x", Role::State, false)];
    let model =
        model(columns, &["x"], Partition::whole(), vec![("x", Prediction::Derivative, "1", vec![(0.0, vec![a])])], &[]);
    let x: Vec<f64> = (0..13).map(|k| 2.0 + (k as f64).cos()).collect();
    let slopes = segments(&model, &source(&["x"], h, vec![vec![x.clone()]]), &options(4, Method::Euler));
    // Row 0 is in front of the first start: rows 1 to 5 and 5 to 9; a third segment would need row 13.
    assert_eq!(slopes.len(), 2);
    for (segment, first) in slopes.iter().zip([1, 5]) {
        assert_eq!((segment.active.as_slice(), segment.ended), (&[0][..], false));
        for k in 1..=4 {
            let (growth, scale) = (1.0 + h * a, 0.5);
            let residual = scale * (x[first + k] - x[first] * growth.powi(k as i32));
            let slope = -scale * k as f64 * h * x[first] * growth.powi(k as i32 - 1);
            assert!((segment.residuals[k - 1] - residual).abs() < 1e-14);
            assert!((segment.slopes[k - 1] - slope).abs() < 1e-14);
        }
    }
}

/// A coefficient that another region has alone does not move a segment, and is not among those that do.
#[test]
fn segment_lists_the_coefficients_of_its_regions() {
    let columns = vec![column("x", Role::State, false)];
    let rule = Rule::voronoi(vec![vec![-1.0], vec![1.0]]);
    let maps = vec![(0.5, vec![-1.0]), (0.0, vec![-0.1])];
    let regions = partition(&["x"], &[0.0], &[1.0], rule);
    let model = model(columns, &["x"], regions, vec![("x", Prediction::Derivative, "1", maps)], &[]);
    let x = (0..9).map(|k| 3.0 - 0.1 * f64::from(k)).collect();
    let slopes = segments(&model, &source(&["x"], 0.1, vec![vec![x]]), &options(3, Method::Rk4));
    // The zero constant of the second region is no part of the support: its coefficient is number 2.
    assert_eq!(Coefficient::support(&model).len(), 3);
    assert!(slopes.iter().all(|segment| segment.active == [2]));
}

/// A segment that runs away keeps its last good state, whose derivatives stand for the rest.
#[test]
fn diverging_segments_end_with_a_reason() {
    let columns = vec![column("x", Role::State, false)];
    let maps = vec![(0.0, vec![30.0])];
    let model = model(columns, &["x"], Partition::whole(), vec![("x", Prediction::Derivative, "1", maps)], &[]);
    let source = source(&["x"], 0.1, vec![vec![vec![1.0; 8]]]);
    let slopes = segments(&model, &source, &options(5, Method::Euler));
    // 1, 4, then 16, which is more than ten deviations away.
    assert!(slopes[0].ended && slopes[0].is_finite());
    let scale = 1.0 / 5f64.sqrt();
    assert!(slopes[0].residuals.iter().all(|r| (r + 3.0 * scale).abs() < 1e-14), "{:?}", slopes[0].residuals);
    assert!(slopes[0].slopes.iter().all(|slope| (slope + 0.1 * scale).abs() < 1e-14));
}

#[test]
fn segments_that_cannot_be_cut_are_refused() {
    let (model, source) = tangled(3, Prediction::Derivative, 1);
    let refused = |options: &ShootingOptions| Shooting::new(&model, &source, &[], options).err().expect("an error");
    assert!(matches!(refused(&options(0, Method::Rk4)), Error::NoHorizon));
    assert!(matches!(refused(&options(59, Method::Rk4)), Error::TooShort { .. }));
    let mut backward = options(5, Method::Rk4);
    backward.step = Step::Seconds(-0.1);
    assert!(matches!(refused(&backward), Error::BadStep(_)));
}
