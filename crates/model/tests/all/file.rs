//! Models in files read back bit for bit, whatever their numbers; damage is refused.

use fleetfoot_library::Expr;
use fleetfoot_model::{
    AffineMap, Column, Equation, Estimated, FileError, Join, Latent, Lattice, Level, Model, Partition, Passage,
    PhaseBins, Phases, Prediction, RegionPair, RegionSummary, ResidualCorrelation, Role, RotationKind, RotationPart,
    Rule, TrainedEpisode, Training, Transitions, UnseenLabel,
};
use proptest::prelude::*;

fn model(numbers: &[f64; 12]) -> Model {
    let n = |i: usize| numbers[i % 12];
    let column = |name: &str, role| Column {
        name: name.into(),
        source: format!("`raw {name}`*2"),
        unit: None,
        role,
        angle: name == "a",
        rotation: None,
    };
    let training = Training {
        version: "0.1.0".into(),
        recipe: "[states]\nx = {}\n".into(),
        seed: u64::MAX,
        rows: 7,
        episodes: vec![TrainedEpisode {
            id: "00ff".into(),
            name: "a \"quoted\" name".into(),
            marks: [("x".to_owned(), vec![0, u64::MAX])].into(),
        }],
        target_mean: vec![n(0)],
        target_covariance: vec![n(1)],
        target_deviation: vec![n(2)],
        state_covariance: vec![n(3), n(4), n(5)],
        state_mean: Vec::new(),
        parameters: vec![
            Estimated { name: "mass".into(), value: n(3), half_width: n(4) },
            Estimated { name: "a \"b\"".into(), value: n(5), half_width: n(6) },
        ],
        parameter_covariance: vec![n(7), n(8), n(9)],
    };
    let columns = vec![column("x", Role::State), column("a", Role::State), column("ground", Role::Auxiliary)];
    let mut model = Model::new("pwa labels:ground+kmeans:2", columns, 0.01, training);
    let region = |i: usize| RegionSummary {
        name: format!("{i}"),
        rows: i as u64,
        mean: vec![n(i), n(i + 1)],
        covariance: vec![n(i + 2), n(i + 3), n(i + 4)],
        range: vec![[n(i + 5), n(i + 6)], [n(i + 7), n(i + 8)]],
        residual_covariance: vec![n(i + 9)],
        rank: 2,
        condition: n(i + 10),
        confounded: vec![vec![0, 1]],
    };
    model.libraries = vec![vec![Expr::column("x"), Expr::column("a").cos()]];
    model.partitions = vec![Partition {
        specification: "labels:ground+kmeans:2".into(),
        columns: vec![Expr::column("x"), Expr::column("ground")],
        centre: vec![n(6), 0.0],
        scale: vec![1.5, 1.0],
        rule: Rule::Labels {
            values: vec![0.0, 3.0, 4.0],
            names: vec!["ice".into(), "grass".into(), "sand".into()],
            rules: vec![
                Rule::voronoi(vec![vec![n(7)], vec![n(8)]]),
                Rule::Ball { radius: 1.5 },
                Rule::Box { half: 1.25 },
            ],
            unseen: UnseenLabel::Pool,
        },
        transitions: Some(Transitions {
            counts: (0..7).map(|from| (0..7).map(|to| from * 7 + to).collect()).collect(),
        }),
        phases: Some(Phases {
            specification: "stance".into(),
            bins: PhaseBins::Cyclic { period: 6.25, count: 3 },
            rows: (0..3).map(|bin| (0..7).map(|region| bin * 11 + region).collect()).collect(),
            passages: vec![Passage { bin: 2, from: 0, to: 4, rows: u64::MAX }],
            strides: (0..7).map(|from| (0..7).map(|to| from * 3 + to).collect()).collect(),
            stride_rows: 977,
            falling: true,
        }),
        pairs: vec![RegionPair { regions: [1, 3], statistic: n(4), freedom: 3, p: n(5) }],
        lattice: Some(Lattice {
            joins: (0..6).map(|i| Join { kept: 0, gone: 6 - i, training: n(i as usize) }).collect(),
            levels: vec![Level { regions: 5, training: n(3), held_out: f64::NAN, standard_error: n(1), bic: n(2) }],
        }),
        correlation: Some(ResidualCorrelation { lags: vec![vec![0.75], vec![-0.25]] }),
    }];
    model.summaries = vec![(0..7).map(region).collect::<Vec<_>>().into()];
    model.latents = vec![Latent {
        beyond: Vec::new(),
        name: "f_x".into(),
        library: 0,
        partition: 0,
        map: AffineMap {
            constants: (0..7).map(n).collect(),
            coefficients: (0..7).map(|i| vec![n(i), n(i + 1)]).collect(),
        }
        .into(),
    }];
    let x = Expr::column("x");
    model.equations = vec![
        Equation {
            subject: "x".into(),
            prediction: Prediction::Next,
            right: Expr::column("f_x"),
            target: Some(x.shifted(-1)),
            unit: Some("m".into()),
        },
        Equation { subject: "a".into(), prediction: Prediction::Derivative, right: x.sin(), target: None, unit: None },
    ];
    model
}

/// Any bits, the special ones among them; all NaN are one.
fn number() -> impl Strategy<Value = f64> {
    let special = [0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, f64::MIN_POSITIVE, 5e-324, f64::MAX, 0.1];
    prop_oneof![
        prop::sample::select(special.to_vec()),
        any::<u64>().prop_map(f64::from_bits).prop_map(|v| if v.is_nan() { f64::NAN } else { v })
    ]
}

proptest! {
    #[test]
    fn every_number_reads_back_bit_for_bit(numbers in prop::collection::vec(number(), 12)) {
        let numbers: [f64; 12] = numbers.try_into().expect("twelve");
        let model = model(&numbers);
        let text = model.to_json();
        let again = Model::from_json(&text, "test").expect("it reads back");
        prop_assert_eq!(again.to_json(), text);
        let bits = |model: &Model| -> Vec<u64> {
            let regions = model.summaries[0].regions.iter();
            regions.flat_map(|r| r.mean.iter().chain(&r.covariance).chain(r.range.iter().flatten())).map(|v| v.to_bits()).collect()
        };
        prop_assert_eq!(bits(&again), bits(&model));
        prop_assert_eq!(&again.equations, &model.equations);
        prop_assert_eq!(again.hash(), model.hash());
    }
}

#[test]
fn every_kind_of_model_reads_back() {
    for (name, model) in crate::models::all() {
        let again = Model::from_json(&model.to_json(), name).expect("a model");
        assert_eq!(format!("{again:?}"), format!("{model:?}"), "{name}");
    }
}

#[test]
fn every_truncation_and_every_changed_digit_is_refused() {
    let text = model(&[0.5; 12]).to_json();
    for end in (0..text.len()).filter(|&end| text.is_char_boundary(end)).step_by(7) {
        assert!(Model::from_json(&text[..end], "cut").is_err(), "cut at {end}");
    }
    let mut changed = 0;
    for (at, digit) in text.char_indices().filter(|(_, c)| c.is_ascii_digit()) {
        let other = if digit == '9' { '8' } else { char::from(digit as u8 + 1) };
        let edited = format!("{}{other}{}", &text[..at], &text[at + 1..]);
        assert!(Model::from_json(&edited, "edited").is_err(), "a digit changed at {at} goes unnoticed");
        changed += 1;
    }
    assert!(changed > 200);
}

#[test]
fn a_model_that_contradicts_itself_is_refused() {
    let mut broken = model(&[0.5; 12]);
    broken.latents[0].affine_mut().unwrap().constants.pop();
    let error = Model::from_json(&broken.to_json(), "broken.json").expect_err("four constants for five regions");
    assert!(matches!(error, FileError::Invalid { .. }) && error.to_string().contains("broken.json"), "{error}");
    for (text, word) in
        [("{}", "not a fleetfoot model"), ("[1, 2", "not a fleetfoot model"), ("{\"fleetfoot_model\": 7}", "format 7")]
    {
        let error = Model::from_json(text, "x.json").expect_err("not a model").to_string();
        assert!(error.contains(word) && error.contains("x.json"), "{error}");
    }
}

#[test]
fn absent_phases_and_pairs_are_not_written() {
    let mut model = model(&[0.5; 12]);
    (model.partitions[0].phases, model.partitions[0].pairs) = (None, Vec::new());
    let text = model.to_json();
    // Files that were written before there were any are the same files.
    assert!(!text.contains("phases") && !text.contains("pairs"));
    assert_eq!(Model::from_json(&text, "old.json").expect("it reads back").to_json(), text);
}

#[test]
fn phases_and_pairs_of_other_regions_are_refused() {
    let refused = |change: &dyn Fn(&mut Partition)| {
        let mut broken = model(&[0.5; 12]);
        change(&mut broken.partitions[0]);
        Model::from_json(&broken.to_json(), "broken.json").expect_err("contradicts itself").to_string()
    };
    let strides = refused(&|partition| partition.phases.iter_mut().for_each(|phases| phases.strides.truncate(4)));
    assert!(strides.contains("3 bins and 7 regions"), "{strides}");
    for pair in [[3, 3], [1, 7], [2, 1]] {
        let error = refused(&|partition| partition.pairs[0].regions = pair);
        assert!(error.contains(&format!("{} and {} are no pair", pair[0], pair[1])), "{error}");
    }
}

#[test]
fn rotations_read_back() {
    let part = |(part, name): (usize, &str)| Column {
        name: name.into(),
        source: name.into(),
        unit: None,
        role: Role::State,
        angle: false,
        rotation: Some(RotationPart { group: "attitude".into(), kind: RotationKind::Vector, part }),
    };
    let columns: Vec<Column> = ["rx", "ry", "rz"].into_iter().enumerate().map(part).collect();
    let training = Training { state_covariance: vec![1.0; 6], state_mean: vec![0.1, -0.2, 0.3], ..Training::default() };
    let model = Model::new("given", columns.clone(), 0.01, training.clone());
    let again = Model::from_json(&model.to_json(), "test").unwrap();
    assert_eq!(again, model);
    assert_eq!((again.rotations()[0].columns.as_slice(), again.training.state_mean.len()), (&[0, 1, 2][..], 3));
    // Files of models without rotations are as they were.
    let plain: Vec<Column> = columns.into_iter().map(|column| Column { rotation: None, ..column }).collect();
    let text = Model::new("given", plain, 0.01, training).to_json();
    assert!(!text.contains("rotation") && !text.contains("state_mean"));
}
