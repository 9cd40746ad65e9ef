//! Resimulation: a closed form, the equations integrated by other means, the gradient by differences, bounds, noise,
//! and refusals.

use fleetfoot_data::{Column as DataColumn, MemorySource, Silent, with_threads};
use fleetfoot_estimate::{Ending, EstimateError, Resimulation, ResimulationOptions, resimulate};
use fleetfoot_library::Expr;
use fleetfoot_model::{Column, Equation, Model, Prediction, Role, Training};
use fleetfoot_sim::plant::aircraft::{AircraftClimb, Airplane, Flight, Latent};

use crate::simulation::{expression, noise};

fn model(states: &[(&str, &str)], inputs: &[&str], prediction: Prediction, period: f64) -> Model {
    let column = |name: &str, role| Column::new(name, role);
    let columns = states.iter().map(|(name, _)| column(name, Role::State));
    let columns = columns.chain(inputs.iter().map(|name| column(name, Role::Input))).collect();
    let n = states.len();
    let state_covariance =
        (0..n).flat_map(|i| (0..=i).map(move |j| if i == j { 1.0 } else { 0.0 })).collect::<Vec<f64>>();
    let mut model = Model::new("test", columns, period, Training { state_covariance, ..Training::default() });
    let equation = |(name, right): &(&str, &str)| Equation {
        subject: (*name).into(),
        prediction,
        right: expression(right),
        target: None,
        unit: None,
    };
    model.equations = states.iter().map(equation).collect();
    model
}

fn source(names: &[&str], period: f64, columns: Vec<Vec<f64>>) -> MemorySource {
    let mut source = MemorySource::new(names.iter().map(|name| DataColumn::float(*name)).collect());
    source.push_uniform("run", period, columns);
    source
}

/// With deviations that are given, and no bounds.
fn open(deviations: &[(&str, f64)]) -> ResimulationOptions {
    let mut options = ResimulationOptions::default();
    options.deviations = deviations.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
    options.bounds =
        deviations.iter().map(|(name, _)| ((*name).to_owned(), [f64::NEG_INFINITY, f64::INFINITY])).collect();
    options
}

fn assert_minimum(resimulation: &Resimulation) {
    for episode in &resimulation.episodes {
        let certificate = &episode.certificate;
        assert_eq!(episode.ending, Ending::Minimum, "{certificate:?} after {} programs", episode.programs);
        assert!(certificate.dynamics <= 1e-10 && certificate.bounds == 0.0, "{certificate:?}");
        assert!(certificate.stationarity <= 1e-8, "{certificate:?}");
    }
}

/// Gaussian elimination with the largest pivot.
fn solved(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for step in 0..n {
        let pivot = (step..n).max_by(|&i, &j| a[i][step].abs().total_cmp(&a[j][step].abs())).unwrap();
        a.swap(step, pivot);
        b.swap(step, pivot);
        for row in 0..n {
            if row != step {
                let factor = a[row][step] / a[step][step];
                (0..n).for_each(|j| a[row][j] -= factor * a[step][j]);
                b[row] -= factor * b[step];
            }
        }
    }
    (0..n).map(|i| b[i] / a[i][i]).collect()
}

/// A linear oscillator: the states are linear in the beginning and the inputs, so that the solution is one of ordinary least squares in these.
#[test]
fn linear_resimulation_equals_least_squares() {
    const ROWS: usize = 25;
    let (h, k, c) = (0.1, 2.0, 0.3);
    let wave = |scale: f64, shift: f64| (0..ROWS).map(|i| scale * (0.2 * i as f64 + shift).sin()).collect::<Vec<f64>>();
    let recorded = [wave(1.0, 0.0), wave(1.5, 1.3), wave(0.7, 2.0)];
    let deviations = [0.1, 0.2, 0.4];
    // Hermite and Simpson of x' = A x + B u, solved for the row behind.
    let a = [[0.0, 1.0], [-k, -c]];
    let ab = [1.0, -c];
    let square = |i: usize, j: usize| a[i][0] * a[0][j] + a[i][1] * a[1][j];
    let step = |x: [f64; 2], u: [f64; 2]| {
        let unit = |i: usize, j: usize| f64::from(u8::from(i == j));
        let side =
            |sign: f64, i: usize, j: usize| unit(i, j) + sign * h / 6.0 * 3.0 * a[i][j] + h * h / 12.0 * square(i, j);
        let right = |i: usize| {
            let b = [0.0, 1.0][i];
            let by_states: f64 = (0..2).map(|j| side(1.0, i, j) * x[j]).sum();
            by_states + h / 6.0 * (3.0 * b + h / 2.0 * ab[i]) * u[0] + h / 6.0 * (3.0 * b - h / 2.0 * ab[i]) * u[1]
        };
        let matrix = (0..2).map(|i| (0..2).map(|j| side(-1.0, i, j)).collect()).collect();
        let solution = solved(matrix, vec![right(0), right(1)]);
        [solution[0], solution[1]]
    };
    let path = |p: &[f64]| {
        let (mut x, mut rows) = ([p[0], p[1]], Vec::new());
        for i in 0..ROWS {
            rows.push([x[0], x[1], p[2 + i]]);
            if i + 1 < ROWS {
                x = step(x, [p[2 + i], p[3 + i]]);
            }
        }
        rows
    };
    let unknowns = 2 + ROWS;
    let unit = |j: usize| path(&(0..unknowns).map(|i| f64::from(u8::from(i == j))).collect::<Vec<f64>>());
    let design: Vec<Vec<[f64; 3]>> = (0..unknowns).map(unit).collect();
    let weight =
        |row: usize, j: usize| if row == 0 || row == ROWS - 1 { 0.5 } else { 1.0 } / deviations[j] / deviations[j];
    let product = |f: &dyn Fn(usize, usize) -> f64| -> f64 {
        (0..ROWS).flat_map(|row| (0..3).map(move |j| (row, j))).map(|(row, j)| weight(row, j) * f(row, j)).sum()
    };
    let gram = (0..unknowns)
        .map(|p| (0..unknowns).map(|q| product(&|row, j| design[p][row][j] * design[q][row][j])).collect())
        .collect();
    let moment = (0..unknowns).map(|p| product(&|row, j| design[p][row][j] * recorded[j][row])).collect();
    let expected = path(&solved(gram, moment));

    let model = model(&[("x", "v"), ("v", "-2*x - 0.3*v + u")], &["u"], Prediction::Derivative, h);
    let source = source(&["x", "v", "u"], h, recorded.to_vec());
    let resimulation = resimulate(&model, &source, &open(&[("x", 0.1), ("v", 0.2), ("u", 0.4)]), &Silent).unwrap();
    assert_eq!(resimulation.columns, ["x", "v", "u"]);
    assert_minimum(&resimulation);
    for (row, expected) in expected.iter().enumerate() {
        for j in 0..3 {
            let value = resimulation.episodes[0].followed[row * 3 + j];
            // Normal equations of condition 1e3, and a tolerance of 1e-8 on the gradient.
            assert!(
                (value - expected[j]).abs() < 1e-7,
                "row {row}, {}: {value} {}",
                resimulation.columns[j],
                expected[j]
            );
        }
    }
}

/// x' = f, by many Runge-Kutta steps, the input linear in between.
fn integrated(f: &dyn Fn([f64; 2], f64) -> [f64; 2], beginning: [f64; 2], u: &[f64], h: f64) -> Vec<[f64; 2]> {
    const PARTS: usize = 20;
    let (mut x, mut path) = (beginning, vec![beginning]);
    for pair in u.windows(2) {
        let part = h / PARTS as f64;
        let input = |at: f64| pair[0] + (pair[1] - pair[0]) * at / PARTS as f64;
        for p in 0..PARTS {
            let moved = |f: [f64; 2], by: f64| [x[0] + by * f[0], x[1] + by * f[1]];
            let one = f(x, input(p as f64));
            let two = f(moved(one, part / 2.0), input(p as f64 + 0.5));
            let three = f(moved(two, part / 2.0), input(p as f64 + 0.5));
            let four = f(moved(three, part), input(p as f64 + 1.0));
            let mean = |i: usize| (one[i] + 2.0 * two[i] + 2.0 * three[i] + four[i]) / 6.0;
            x = moved([mean(0), mean(1)], part);
        }
        path.push(x);
    }
    path
}

const PENDULUM: [(&str, &str); 2] = [("q", "w"), ("w", "-9.81*sin(q) - 0.1*w + u")];

/// A pendulum whose damping differs from the model's, with noise: 160 rows.
fn pendulum(h: f64) -> Vec<Vec<f64>> {
    let u: Vec<f64> = (0..160).map(|k| 2.0 * (0.7 * h * f64::from(k)).sin()).collect();
    let truth = integrated(&|x, u| [x[1], -9.81 * x[0].sin() - 0.5 * x[1] + u], [1.2, 0.0], &u, h);
    let noisy = |of: usize, scale: f64| {
        truth.iter().enumerate().map(|(k, x)| x[of] + scale * noise(10 * k + of)).collect::<Vec<f64>>()
    };
    vec![noisy(0, 0.02), noisy(1, 0.05), u]
}

#[test]
fn resimulated_pendulum_is_the_nearest_solution() {
    let h = 0.04;
    let recorded = pendulum(h);
    let model = model(&PENDULUM, &["u"], Prediction::Derivative, h);
    let source = source(&["q", "w", "u"], h, recorded.clone());
    let resimulation = resimulate(&model, &source, &open(&[("q", 0.02), ("w", 0.05), ("u", 0.3)]), &Silent).unwrap();
    assert_minimum(&resimulation);
    let episode = &resimulation.episodes[0];
    let column = |j: usize| episode.followed.iter().skip(j).step_by(3).copied().collect::<Vec<f64>>();
    let (q, w, u) = (column(0), column(1), column(2));
    let slope = |x: [f64; 2], u: f64| [x[1], -9.81 * x[0].sin() - 0.1 * x[1] + u];
    // An interval by itself: the rule is wrong by h^5 of a fifth derivative, here 1e-7 times some hundreds.
    for k in 0..q.len() - 1 {
        let next = integrated(&slope, [q[k], w[k]], &u[k..k + 2], h)[1];
        assert!((next[0] - q[k + 1]).abs() < 2e-6 && (next[1] - w[k + 1]).abs() < 2e-5, "row {k}: {next:?}");
    }
    // Along the trajectories of other inputs and beginnings the cost is flat here.
    let cost = |beginning: [f64; 2], u: &[f64]| {
        let path = integrated(&slope, beginning, u, h);
        let square = |k: usize| {
            let end = if k == 0 || k + 1 == u.len() { 0.5 } else { 1.0 };
            let off = [path[k][0] - recorded[0][k], path[k][1] - recorded[1][k], u[k] - recorded[2][k]];
            end * ((off[0] / 0.02).powi(2) + (off[1] / 0.05).powi(2) + (off[2] / 0.3).powi(2))
        };
        0.5 * (0..u.len()).map(square).sum::<f64>()
    };
    let sloped = |beginning: [f64; 2], u: &[f64], direction: usize| {
        let moved = |by: f64| {
            let (mut start, mut u) = (beginning, u.to_vec());
            match direction {
                0 | 1 => start[direction] += by,
                k => u[k] += by,
            }
            cost(start, &u)
        };
        (moved(1e-5) - moved(-1e-5)) / 2e-5
    };
    for direction in [0, 1, 2, 40, 80, 158] {
        let here = sloped([q[0], w[0]], &u, direction);
        let there = sloped([recorded[0][0], recorded[1][0]], &recorded[2], direction);
        assert!(here.abs() < 1e-3 * there.abs(), "direction {direction}: {here} beside {there} at the recording");
    }
    // Nearer than what the recorded inputs lead to.
    let (followed, alone) = (resimulation.deviations_of(episode), resimulation.open_loop_deviations(episode));
    assert!(followed[0] < 0.2 * alone[0] && followed[1] < 0.2 * alone[1], "{followed:?} {alone:?}");
    let path = integrated(&slope, [recorded[0][0], recorded[1][0]], &recorded[2], h);
    let last = &episode.open_loop[episode.open_loop.len() - 2..];
    // Inputs held at their mean over an interval instead of linear in it.
    assert!((last[0] - path[159][0]).abs() < 1e-3 && (last[1] - path[159][1]).abs() < 1e-3, "{last:?} {:?}", path[159]);
}

/// The climbing jet with the airplane's own terms, but for the drag, which is taken to be a twentieth more than it is.
fn jet(airplane: &Airplane) -> Model {
    let latent = |latent: Latent| {
        let terms = latent.features().into_iter().zip(airplane.terms().coefficients(latent));
        let sum = terms.map(|(feature, value)| format!("{value:e}*{feature}")).collect::<Vec<_>>().join(" + ");
        format!("({sum})")
    };
    let [t, d, l, isp] = Latent::ALL.map(latent);
    let path = format!("(({t})*cos(alpha) - 1.05*{d})/m - 9.80665*sin(gamma)");
    let across = format!("({t}*sin(alpha) + {l})/(m*V) - 9.80665*cos(gamma)/V");
    let states = [("h", "V*sin(gamma)"), ("V", &path), ("gamma", &across), ("m", &format!("-{t}/{isp}"))];
    let mut model = model(&states, &["alpha", "N1", "SAT"], Prediction::Derivative, 1.0);
    // The air, of the states.
    let pressure =
        "101325*exp(5.255877*log(1 - 0.0065*min(h, 11000)/288.15) - 9.80665*max(h - 11000, 0)/(287.053*216.65))";
    let density = format!("({pressure}/(287.053*SAT))");
    let air: [(&str, Expr); 3] = [
        ("q", expression(&format!("0.5*{density}*V^2"))),
        ("rho", expression(&density)),
        ("M", expression("V/sqrt(1.4*287.053*SAT)")),
    ];
    for equation in &mut model.equations {
        let of = |name: &str| air.iter().find(|named| named.0 == name).map(|named| named.1.clone());
        equation.right = equation.right.substituted(of);
    }
    model
}

/// Climbs through turbulence, which the model knows nothing of, and with too much drag.
#[test]
fn climbs_are_followed_to_a_minimum() {
    let mut climb = AircraftClimb::default();
    (climb.turbulence.longitudinal, climb.turbulence.normal) = (0.02, 0.02);
    let airplane = Airplane::new(&climb).unwrap();
    let mut source = MemorySource::new(Flight::columns());
    (0..3).for_each(|number| airplane.flight(number).append_to(&mut source));
    let mut options = ResimulationOptions::default();
    options.free = vec!["alpha".into(), "N1".into()];
    let resimulation = resimulate(&jet(&airplane), &source, &options, &Silent).unwrap();
    assert_eq!(
        (&resimulation.columns[..4], &resimulation.replayed[..]),
        (&["h", "V", "gamma", "m"].map(str::to_owned)[..], &["SAT".to_owned()][..])
    );
    for episode in &resimulation.episodes {
        println!(
            "{:?} after {} programs: {:?} beside {:?}",
            episode.certificate,
            episode.programs,
            resimulation.deviations_of(episode),
            resimulation.open_loop_deviations(episode)
        );
    }
    assert_minimum(&resimulation);
    for episode in &resimulation.episodes {
        let (followed, alone) = (resimulation.deviations_of(episode), resimulation.open_loop_deviations(episode));
        for (j, name) in ["h", "V", "gamma"].iter().enumerate() {
            assert!(followed[j] < 0.1 * alone[j], "{name}: {followed:?} {alone:?}");
        }
    }
}

#[test]
fn active_bounds_hold_with_multipliers() {
    let h = 0.04;
    let model = model(&PENDULUM, &["u"], Prediction::Derivative, h);
    let source = source(&["q", "w", "u"], h, pendulum(h));
    let mut options = open(&[("q", 0.02), ("w", 0.05), ("u", 0.3)]);
    options.bounds.retain(|(name, _)| name != "u" && name != "q");
    options.bounds.extend([("u".to_owned(), [-0.8, 0.5]), ("q".to_owned(), [-0.9, f64::INFINITY])]);
    let resimulation = resimulate(&model, &source, &options, &Silent).unwrap();
    assert_minimum(&resimulation);
    let episode = &resimulation.episodes[0];
    let inputs: Vec<f64> = episode.followed.iter().skip(2).step_by(3).copied().collect();
    assert!(inputs.iter().all(|u| (-0.8..=0.5).contains(u)));
    assert!(inputs.iter().filter(|u| **u > 0.5 - 1e-6).count() > 10, "the bound is in the way");
    assert!(episode.followed.iter().step_by(3).all(|q| *q >= -0.9));
}

#[test]
fn next_value_models_follow_across_gaps_with_the_same_bits() {
    let model = model(&[("x", "0.9*x + 0.3*sin(x) + u + 0.1*c")], &["u", "c"], Prediction::Next, 0.1);
    let mut source = MemorySource::new(["x", "u", "c"].map(DataColumn::float).to_vec());
    for episode in 0..5_usize {
        let wave = |scale: f64, shift: f64| {
            (0..60).map(|k| scale * (0.15 * f64::from(k) + shift + episode as f64).sin()).collect::<Vec<f64>>()
        };
        let mut x: Vec<f64> =
            wave(2.0, 0.0).iter().enumerate().map(|(k, x)| x + 0.1 * noise(100 * episode + k)).collect();
        x[20..24].fill(f64::NAN);
        source.push_uniform(format!("run{episode}"), 0.1, vec![x, wave(0.2, 1.0), wave(1.0, 2.0)]);
    }
    source.push_uniform("nothing", 0.1, vec![vec![f64::NAN; 9], vec![0.0; 9], vec![0.0; 9]]);
    let mut options = ResimulationOptions::default();
    options.free = vec!["u".into()];
    let resimulation = with_threads(1, || resimulate(&model, &source, &options, &Silent)).unwrap();
    assert_minimum(&resimulation);
    assert_eq!(
        (resimulation.episodes.len(), &resimulation.missing[..], &resimulation.replayed[..]),
        (5, &[5][..], &["c".to_owned()][..])
    );
    let again = with_threads(3, || resimulate(&model, &source, &options, &Silent)).unwrap();
    for (one, three) in resimulation.episodes.iter().zip(&again.episodes) {
        assert_eq!(one.followed, three.followed);
    }
    for episode in &resimulation.episodes {
        assert!(episode.recorded[20 * 2].is_nan());
        for k in 0..59 {
            let (x, u) = (episode.followed[2 * k], episode.followed[2 * k + 1]);
            let c = (0.15 * k as f64 + 2.0 + episode.episode as f64).sin();
            assert!((episode.followed[2 * k + 2] - (0.9 * x + 0.3 * x.sin() + u + 0.1 * c)).abs() < 1e-8);
        }
    }
}

/// The estimated deviations of the columns are the noise that was put on them.
#[test]
fn noise_is_estimated_with_the_model() {
    let model = model(&[("x", "0.95*x + 0.2*u")], &["u"], Prediction::Next, 0.1);
    let mut source = MemorySource::new(["x", "u"].map(DataColumn::float).to_vec());
    for episode in 0..4_usize {
        let (mut x, mut columns) = (0.0, vec![Vec::new(), Vec::new()]);
        for k in 0..1_500_usize {
            let key = 3 * (k + 2_000 * episode);
            let u = 3.0 * (0.02 * k as f64).sin() + (0.0013 * (k * k) as f64).cos();
            columns[0].push(x + 0.08 * noise(key));
            columns[1].push(u + 0.3 * noise(key + 1));
            x = 0.95 * x + 0.2 * u;
        }
        source.push_uniform(format!("run{episode}"), 0.1, columns);
    }
    let resimulation = resimulate(&model, &source, &ResimulationOptions::default(), &Silent).unwrap();
    assert_minimum(&resimulation);
    // 6,000 rows: a twentieth would be three standard errors of the better known one.
    assert!((resimulation.deviations[0] / 0.08 - 1.0).abs() < 0.1, "{:?}", resimulation.deviations);
    assert!((resimulation.deviations[1] / 0.3 - 1.0).abs() < 0.2, "{:?}", resimulation.deviations);
}

#[test]
fn recordings_that_cannot_be_followed_are_refused() {
    let base = model(&[("x", "-x + u")], &["u"], Prediction::Derivative, 0.1);
    let rows = |values: Vec<f64>| source(&["x", "u"], 0.1, vec![values.clone(), values]);
    let good = rows((0..30).map(f64::from).collect());
    let refuse = |model: &Model, source: &MemorySource, change: &dyn Fn(&mut ResimulationOptions)| {
        let mut options = ResimulationOptions::default();
        change(&mut options);
        resimulate(model, source, &options, &Silent).unwrap_err()
    };
    assert!(matches!(refuse(&base, &good, &|o| o.every = 0), EstimateError::Option { option: "every", .. }));
    assert!(matches!(refuse(&base, &good, &|o| o.free = vec!["v".into()]), EstimateError::NoInput { .. }));
    assert!(matches!(
        refuse(&base, &good, &|o| o.bounds = vec![("x".into(), [1.0, 1.0])]),
        EstimateError::Bounds { .. }
    ));
    assert!(matches!(
        refuse(&base, &good, &|o| o.bounds = vec![("y".into(), [0.0, 1.0])]),
        EstimateError::NotFollowed { .. }
    ));
    let long = refuse(&base, &good, &|o| o.memory = 5e4);
    assert!(matches!(long, EstimateError::TooLong { rows: 30, .. }), "{long}");
    assert!(matches!(
        refuse(&base, &rows(vec![f64::NAN; 30]), &|_| ()),
        EstimateError::NothingToFollow { episodes: 1, .. }
    ));
    let lagged = model(&[("x", "0.5*x + 0.1*lag(x, 1) + u")], &["u"], Prediction::Next, 0.1);
    assert!(matches!(refuse(&lagged, &good, &|_| ()), EstimateError::LooksBack { rows: 1 }));
    let next = model(&[("x", "0.5*x + u")], &["u"], Prediction::Next, 0.1);
    assert!(matches!(refuse(&next, &good, &|o| o.every = 2), EstimateError::Option { option: "every", .. }));
    let mut mixed = model(&[("x", "-x + u"), ("y", "x")], &["u"], Prediction::Derivative, 0.1);
    mixed.equations[1].prediction = Prediction::Next;
    assert!(matches!(refuse(&mixed, &good, &|_| ()), EstimateError::MixedSteps { .. }));
    let singular = model(&[("x", "log(x - 100) + u")], &["u"], Prediction::Derivative, 0.1);
    assert!(matches!(refuse(&singular, &good, &|_| ()), EstimateError::NotFollowable { .. }));
}
