//! Columns that follow from simulated ones are computed: an alias and its text give the same bits, whatever the
//! recording has.

use std::sync::Arc;

use crate::common::{column, identity, model, parse, partition, source};
use fleetfoot_data::{Column as DataColumn, MemorySource, Silent, Source};
use fleetfoot_dynamics::{
    Course, Error, FreeRunOptions, InputSequence, Integration, Method, RolloutOptions, Simulator, Start, Starts, Step,
    Stepper, StepperWorkspace, Tangent,
    controller::{Controller, ControllerState, ParameterError},
    free_run, rollout_closed_loop,
};
use fleetfoot_library::{Expr, Filtered, View};
use fleetfoot_model::{Column, Model, Prediction, Role, Rule};

const DT: f64 = 0.01;

/// Definitions of the aliases: over fields, and over the columns of the model.
const ALIASES: [(&str, &str, &str); 5] = [
    ("slip", "2*(/y*/v + /u)", "2*(y*v + u)"),
    ("gust", "wind*/v - cos(/y)", "wind*v - cos(y)"),
    ("slow", "lag1(/v, 0.05)", "lag1(v, 0.05)"),
    ("late", "delay(/y, 0.025)", "delay(y, 0.025)"),
    ("side", "sign(/v)", "sign(v)"),
];

/// Two regions on an alias, a known equation and a library of aliases; or all of that with the aliases written out.
fn craft(aliased: bool, discrete: bool) -> Model {
    let mut columns =
        vec![column("y", Role::State, false), column("v", Role::State, false), column("u", Role::Input, false)];
    let auxiliary = |name: &str, source: &str| Column { source: source.into(), ..column(name, Role::Auxiliary, false) };
    for (c, field) in columns.iter_mut().zip(["/y", "/v", "/u"]) {
        c.source = field.into();
    }
    if aliased {
        columns.extend(ALIASES.iter().map(|(name, text, _)| auxiliary(name, text)));
    } else {
        columns.push(auxiliary("wind", "wind"));
        // Filters stand in models as columns of their own.
        columns.extend(ALIASES[2..4].iter().map(|(_, text, name)| auxiliary(name, text)));
    }
    let text = |text: &str| {
        let written = |name: &str| ALIASES.iter().find(|(alias, ..)| *alias == name).map(|(.., text)| parse(text));
        let expression = parse(text);
        if aliased { expression } else { expression.substituted(written) }
    };
    let kind = if discrete { Prediction::Difference } else { Prediction::Derivative };
    let rule = Rule::voronoi(vec![vec![1.0], vec![-1.0]]);
    // A difference is what a derivative adds in a step.
    let scale = if discrete { DT } else { 1.0 };
    let maps = [(0.1, [-2.0, 0.1, 0.2, -0.1, 0.4]), (0.2, [-1.5, 0.2, 0.3, 0.1, -0.2])];
    let maps =
        maps.map(|(constant, row): (f64, [f64; 5])| (scale * constant, row.map(|c| scale * c).to_vec())).to_vec();
    let known = format!("{scale}*(v - slip/(2 + late^2) - 0.5*y)");
    let library = ["v", "slip", "gust*u", "lag(slow, 1)", "late - slow"];
    let mut model = model(
        columns,
        &library,
        partition(&["side"], &[0.1], &[1.0], rule),
        vec![("v", kind, "forward(v)", maps)],
        &[("y", kind, &known)],
    );
    for expression in model.libraries[0].iter_mut().chain(&mut model.partitions[0].columns) {
        *expression = text(&expression.to_string());
    }
    for equation in &mut model.equations {
        equation.right = text(&equation.right.to_string());
    }
    model.training.state_covariance = identity(2, 1.0);
    model.step = DT;
    model
}

fn recording(seed: f64) -> MemorySource {
    let rows = |f: &dyn Fn(f64) -> f64| (0..400).map(|row| f(f64::from(row) * DT + seed)).collect::<Vec<f64>>();
    let values = vec![
        rows(&|t| (2.0 * t).sin()),
        rows(&|t| (5.0 * t).cos() * 0.7),
        rows(&|t| 0.5 * (3.0 * t + 1.0).sin()),
        rows(&|t| 0.3 * (0.7 * t).cos()),
    ];
    source(&["/y", "/v", "/u", "wind"], DT, vec![values])
}

/// The recording seen through the columns of a model, and through those that a simulation of it needs.
fn through<'a>(model: &Model, recording: &'a dyn Source) -> View<'a> {
    let columns: Vec<Column> = model.columns.iter().cloned().chain(model.auxiliary_columns()).collect();
    let aliases: Vec<(DataColumn, Expr)> =
        columns.iter().map(|column| (DataColumn::float(&column.name), parse(&column.source))).collect();
    let expressions: Vec<Expr> = aliases.iter().map(|(_, expression)| expression.clone()).collect();
    View::over(Box::new(Filtered::of(recording, &expressions).unwrap()), &aliases).unwrap()
}

fn bits(values: &[f64]) -> Vec<u64> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn alias_is_rolled_out_like_its_text() {
    let recording = recording(0.0);
    for (discrete, method) in [(false, Method::Euler), (false, Method::Rk4), (true, Method::Euler)] {
        let mut options = RolloutOptions::new(120);
        (options.method, options.divergence) = (method, f64::INFINITY);
        let starts: Vec<Start> = (0..6).map(|k| Start { episode: 0, row: 5 + 40 * k }).collect();
        let run = |aliased: bool| {
            let model = craft(aliased, discrete);
            let simulator = Simulator::for_source(&model, &recording, Step::Median).unwrap();
            assert_eq!(simulator.states(), ["y", "v"]);
            assert_eq!(simulator.replayed(), ["u", "wind"]);
            simulator.trajectories(&through(&model, &recording), &starts, &options, &Silent).unwrap()
        };
        let (aliased, inlined) = (run(true), run(false));
        for (a, b) in aliased.into_iter().zip(inlined) {
            let (a, b) = (a.expect("complete"), b.expect("complete"));
            assert_eq!(a.steps(), 120);
            assert_eq!(bits(&a.states), bits(&b.states), "{discrete} {method:?}");
            assert_eq!(a.regions, b.regions);
        }
        let free = |aliased: bool| {
            let model = craft(aliased, discrete);
            let mut options = FreeRunOptions::default();
            (options.divergence, options.method, options.keep) = (f64::INFINITY, method, true);
            free_run(&model, &through(&model, &recording), &options, &Silent).unwrap()
        };
        let (aliased, inlined) = (free(true), free(false));
        assert_eq!(format!("{aliased:?}"), format!("{inlined:?}"));
        assert_eq!(aliased.runs.len(), 1);
        assert_eq!(aliased.replayed, ["u", "wind"]);
    }
}

#[test]
fn simulated_values_do_not_read_the_recording() {
    // The rows behind the start say something else of the states: the trajectory stays.
    let model = craft(true, false);
    let run = |change: f64| {
        let read = recording(0.0).read(0, 0..400, fleetfoot_data::Halo::default()).unwrap();
        let values = (0..4).map(|c| {
            let changed = |(row, &x): (usize, &f64)| if c < 2 && row > 100 { x + change } else { x };
            read.core(c).iter().enumerate().map(changed).collect()
        });
        let changed = source(&["/y", "/v", "/u", "wind"], DT, vec![values.collect()]);
        let simulator = Simulator::new(&model).unwrap();
        let starts = [Start { episode: 0, row: 100 }];
        simulator
            .trajectories(&through(&model, &changed), &starts, &RolloutOptions::new(150), &Silent)
            .unwrap()
            .remove(0)
            .unwrap()
    };
    assert_eq!(bits(&run(0.0).states), bits(&run(3.0).states));
}

#[test]
fn lag_follows_recorded_filter() {
    // v is recorded as the model makes it, so that the filter of the recording is the simulated one.
    let columns = vec![
        Column { source: "/v".into(), ..column("v", Role::State, false) },
        Column { source: "/w".into(), ..column("w", Role::State, false) },
        Column { source: "lag1(lag1(/v, 0.03), 0.2)".into(), ..column("slow", Role::Auxiliary, false) },
    ];
    let model = model(
        columns,
        &["v"],
        partition(&[], &[], &[], Rule::Whole),
        vec![("v", Prediction::Difference, "lead(v, 1) - v", vec![(0.0, vec![-0.02])])],
        &[("w", Prediction::Next, "slow")],
    );
    let v: Vec<f64> = (0..200).map(|row| 0.98f64.powi(row)).collect();
    let recording = source(&["/v", "/w"], DT, vec![vec![v, vec![0.0; 200]]]);
    let view = through(&model, &recording);
    let simulator = Simulator::new(&model).unwrap();
    let options = RolloutOptions::new(100);
    let run =
        simulator.trajectories(&view, &[Start { episode: 0, row: 20 }], &options, &Silent).unwrap().remove(0).unwrap();
    let slow = view.columns().iter().position(|column| column.name == "slow").unwrap();
    let block = view.read(0, 0..200, fleetfoot_data::Halo::default()).unwrap();
    for k in 1..=100 {
        let (simulated, recorded) = (run.state(k)[1], block.core(slow)[20 + k - 1]);
        assert!((simulated - recorded).abs() < 1e-12, "{k}: {simulated} {recorded}");
    }
}

#[test]
fn stepper_values_equal_rollout() {
    let recording = recording(0.3);
    for (aliased, method) in [(true, Method::Euler), (true, Method::Rk4), (false, Method::Rk4)] {
        let model = craft(aliased, false);
        let stepper = Stepper::new(&model).unwrap();
        let lag = if aliased { "slow" } else { "lag1(v, 0.05)" };
        assert_eq!(stepper.states().collect::<Vec<_>>(), ["y", "v", lag]);
        assert_eq!(stepper.inputs().collect::<Vec<_>>(), ["u", "wind"]);
        let view = through(&model, &recording);
        let block = view.read(0, 0..400, fleetfoot_data::Halo::default()).unwrap();
        let value = |name: &str, row: usize| {
            block.core(view.columns().iter().position(|column| column.name == name).unwrap())[row]
        };
        let start = 50;
        let mut points = stepper.points(1);
        let names: Vec<String> = stepper.states().chain(stepper.inputs()).map(str::to_owned).collect();
        let places: Vec<usize> = (0..stepper.states().len())
            .map(|state| stepper.state_column(state))
            .chain((0..stepper.inputs().len()).map(|input| stepper.input_column(input)))
            .collect();
        for (name, &place) in names.iter().zip(&places) {
            for back in 0..=stepper.history() {
                points.column_mut(place, back)[0] = value(name, start - back);
            }
        }
        let inputs: Vec<f64> = (0..60).flat_map(|k| ["u", "wind"].map(|name| value(name, start + k))).collect();
        let times: Vec<f64> = (0..=60).map(|k| f64::from(k) * DT).collect();
        let mut simulated = Vec::new();
        let values = InputSequence { values: &inputs, by_point: false, course: Course::Held };
        let (grid, how) = (stepper.grid(times).unwrap(), Integration::Fixed { method, substeps: Some(1) });
        stepper.simulate(&mut points.clone(), &grid, values, &how, |_, states| {
            simulated.push(states.to_vec());
            true
        });
        let mut options = RolloutOptions::new(60);
        (options.method, options.step, options.divergence) = (method, Step::Seconds(DT), f64::INFINITY);
        let starts = [Start { episode: 0, row: start }];
        let simulator = Simulator::new(&model).unwrap();
        let rolled = simulator.trajectories(&view, &starts, &options, &Silent).unwrap().remove(0).unwrap();
        for (k, states) in simulated.iter().enumerate() {
            for (value, other) in states[..2].iter().zip(rolled.state(k)) {
                assert!((value - other).abs() < 1e-12, "{aliased} {method:?} step {k}: {value} {other}");
            }
        }
        slopes_are_those_of_differences(&stepper, &points, &places, method);
    }
}

/// The exact derivatives of a step against differences of steps.
fn slopes_are_those_of_differences(
    stepper: &Stepper,
    points: &fleetfoot_dynamics::Points,
    places: &[usize],
    method: Method,
) {
    let tangent = Tangent::new(stepper).unwrap();
    let mut workspace = StepperWorkspace::default();
    let linearized = tangent.linearize_step(stepper, &mut points.clone(), DT, method, &mut workspace).remove(0);
    let states = stepper.states().len();
    for (variable, &place) in places.iter().enumerate() {
        let mut next = |change: f64| {
            let mut moved = points.clone();
            moved.column_mut(place, 0)[0] += change;
            stepper.next(&mut moved, DT, method, &mut workspace).to_vec()
        };
        let (high, low) = (next(1e-5), next(-1e-5));
        for row in 0..states {
            let slope = (high[row] - low[row]) / 2e-5;
            let exact = match variable.checked_sub(states) {
                None => linearized.a[row * states + variable],
                Some(input) => linearized.b[row * (places.len() - states) + input],
            };
            assert!((slope - exact).abs() < 1e-7, "row {row}, variable {variable}: {slope} {exact}");
        }
    }
}

/// u = -0.5 times the column that it reads.
#[derive(Debug)]
struct Damper(&'static str);

impl Controller for Damper {
    fn reads(&self) -> Vec<String> {
        vec![self.0.into()]
    }

    fn drives(&self) -> Vec<String> {
        vec!["u".into()]
    }

    fn validate(&self) -> Result<(), ParameterError> {
        Ok(())
    }

    fn start(&self) -> Box<dyn ControllerState> {
        Box::new(DamperState)
    }
}

struct DamperState;

impl ControllerState for DamperState {
    fn control(&mut self, _: f64, columns: &[f64], inputs: &mut [f64]) {
        inputs[0] = -0.5 * columns[0];
    }
}

#[test]
fn driven_input_moves_derived_columns() {
    let recording = recording(0.0);
    let run = |aliased: bool, reads: &'static str| {
        let mut model = craft(aliased, false);
        let copy = Column { source: "/y".into(), ..column("heading", Role::Auxiliary, false) };
        let doubled = Column { source: "2*/y - /y".into(), ..column("doubled", Role::Auxiliary, false) };
        model.columns.extend([copy, doubled]);
        let controller: Arc<dyn Controller> = Arc::new(Damper(reads));
        let mut options = RolloutOptions::new(100);
        options.keep = true;
        let starts = Starts::At(vec![Start { episode: 0, row: 30 }]);
        rollout_closed_loop(&model, &controller, &through(&model, &recording), &starts, &options, &Silent)
    };
    let aliased = run(true, "y").unwrap();
    assert_eq!(aliased.replayed, ["wind"]);
    let trajectory = &aliased.trajectories[0];
    for k in 0..100 {
        assert_eq!(trajectory.inputs[k], -0.5 * trajectory.state(k)[0]);
    }
    // Columns that the controller reads are computed too.
    for (alias, reads) in [(false, "y"), (true, "heading"), (true, "doubled")] {
        assert_eq!(bits(&run(alias, reads).unwrap().trajectories[0].states), bits(&trajectory.states), "{reads}");
    }
    assert!(matches!(run(true, "slip"), Err(Error::Controller { column, .. }) if column == "slip"));
    assert!(matches!(run(true, "late"), Err(Error::Controller { column, .. }) if column == "late"));
}
