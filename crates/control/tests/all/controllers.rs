//! The laws of the treadmill around models, against closed forms.

use std::sync::Arc;

use crate::common::*;
use fleetfoot_control::controller::{Treadmill, TreadmillLoop, TreadmillSpeed};
use fleetfoot_data::{MemorySource, Silent, with_threads};
use fleetfoot_dynamics::{
    End, Method, RolloutOptions, Simulator, Start, Starts, Step, Trajectory, controller::Controller, rollout,
    rollout_closed_loop,
};
use fleetfoot_model::{Model, Partition, Prediction, Role};

const DT: f64 = 0.001;

/// x' = u_v cos(yaw) - belt_speed, yaw' = u_w.
fn robot() -> Model {
    let mut columns = vec![
        column("x", Role::State, false),
        column("yaw", Role::State, true),
        column("u_v", Role::Input, false),
        column("u_w", Role::Input, false),
        column("belt_speed", Role::Auxiliary, false),
    ];
    columns[1].angle = true;
    model(
        columns,
        &["u_v", "u_w"],
        Partition::whole(),
        vec![("yaw", Prediction::Derivative, "forward(yaw)", vec![(0.0, vec![0.0, 1.0])])],
        &[("x", Prediction::Derivative, "u_v*cos(yaw) - belt_speed")],
    )
}

/// Rows of a robot that stands off its place; the recorded inputs differ from those of the law.
fn recording(rows: usize) -> MemorySource {
    let column = |f: &dyn Fn(usize) -> f64| (0..rows).map(f).collect::<Vec<f64>>();
    let names = ["x", "yaw", "u_v", "u_w", "belt_speed"];
    let values = vec![
        column(&|k| 0.05 + 1e-4 * k as f64),
        column(&|k| 0.4 - 1e-3 * k as f64),
        column(&|k| 0.9 + 1e-3 * k as f64),
        column(&|k| 0.5 - 1e-3 * k as f64),
        column(&|k| 0.3 + 1e-4 * k as f64),
    ];
    source(&names, DT, vec![values])
}

fn options(horizon: usize) -> RolloutOptions {
    let mut options = RolloutOptions::new(horizon);
    options.method = Method::Euler;
    options.step = Step::Seconds(DT);
    options
}

fn run(simulator: &Simulator, source: &MemorySource, options: &RolloutOptions) -> Trajectory {
    simulator.trajectories(source, &[Start { episode: 0, row: 3 }], options, &Silent).unwrap().remove(0).unwrap()
}

#[test]
fn treadmill_holds_commands_and_history() {
    let (period, latency) = (0.01, 0.013);
    let law = Treadmill { k_x: 2.0, k_yaw: 5.0, k_y: 0.0, period, ..Treadmill::default() };
    let controller = TreadmillLoop { law, latency, ..TreadmillLoop::default() };
    let simulator = Simulator::new(&robot()).unwrap().driven_by(Arc::new(controller)).unwrap();
    let source = recording(400);
    let done = run(&simulator, &source, &options(300));
    assert_eq!(done.end, End::Horizon);
    let (mut x, mut yaw) = (vec![0.05 + 3e-4], vec![0.4 - 3e-3]);
    // Recorded inputs are held until the first state of the trajectory is seen, at the sample 20 ms after the start.
    let mut u = [0.9 + 3e-3, 0.5 - 3e-3];
    for k in 0..300 {
        let belt = 0.3 + 1e-4 * (3 + k) as f64;
        if k % 10 == 0 && k >= 20 {
            u = law.command(belt, [x[k - 13], 0.0, yaw[k - 13]]);
        }
        // The model's sums are fused, these are not.
        assert!((0..2).all(|i| (done.inputs[2 * k + i] - u[i]).abs() < 1e-13), "{k}: {u:?}");
        x.push(x[k] + DT * (u[0] * yaw[k].cos() - belt));
        yaw.push(yaw[k] + DT * u[1]);
        assert!((done.state(k + 1)[0] - x[k + 1]).abs() < 1e-13);
        assert!((done.state(k + 1)[1] - yaw[k + 1]).abs() < 1e-13);
    }
    assert!(yaw[300].abs() < 0.5 * yaw[0].abs(), "the loop turns the robot: {}", yaw[300]);
}

#[test]
fn loop_without_latency_settles() {
    let speed = TreadmillSpeed::Constant(0.3);
    let law = Treadmill { k_x: 2.0, k_yaw: 5.0, k_y: 0.0, period: DT, ..Treadmill::default() };
    let controller = TreadmillLoop { law, latency: 0.0, speed, ..TreadmillLoop::default() };
    let simulator = Simulator::new(&robot()).unwrap().driven_by(Arc::new(controller)).unwrap();
    let mut source = MemorySource::new(
        ["x", "yaw", "u_v", "u_w", "belt_speed"].iter().map(|n| fleetfoot_data::Column::float(*n)).collect(),
    );
    let constant = |value: f64| vec![value; 2100];
    source.push_uniform("run", DT, vec![constant(0.1), constant(0.2), constant(0.0), constant(0.0), constant(0.3)]);
    let done = run(&simulator, &source, &options(2000));
    assert_eq!(done.inputs[..2], law.command(0.3, [0.1, 0.0, 0.2]));
    // With equation (1), x' = -k_x x and yaw' = -k_yaw yaw exactly: the Lyapunov argument of II-C.
    for k in [1, 100, 1000, 2000] {
        let state = done.state(k);
        assert!((state[0] - 0.1 * (1.0 - 2.0 * DT).powi(k as i32)).abs() < 1e-12, "{k}: {}", state[0]);
        assert!((state[1] - 0.2 * (1.0 - 5.0 * DT).powi(k as i32)).abs() < 1e-12, "{k}: {}", state[1]);
    }
}

#[test]
fn the_fast_path_has_the_bits_of_the_general_path() {
    let (model, source) = random_hybrid(7, 2, 12, 500);
    let controller = |latency| -> Arc<dyn Controller> {
        Arc::new(TreadmillLoop {
            law: Treadmill { period: 0.03, k_y: 1.5, ..Treadmill::default() },
            latency,
            x: "x0".into(),
            y: "x4".into(),
            yaw: "x3".into(),
            speed: TreadmillSpeed::Column("x5".into()),
            u_v: "u1".into(),
            u_w: "u0".into(),
        })
    };
    let starts = Starts::Random { count: 60, seed: 3 }.choose(&source, 150, 1, 150).unwrap();
    for (method, latency) in [(Method::Euler, 0.0), (Method::Rk4, 0.05)] {
        let mut options = RolloutOptions::new(150);
        options.method = method;
        let fast = Simulator::new(&model).unwrap().driven_by(controller(latency)).unwrap();
        assert!(fast.is_affine());
        let open = Simulator::new(&model).unwrap().trajectories(&source, &starts, &options, &Silent).unwrap();
        let a = fast.trajectories(&source, &starts, &options, &Silent).unwrap();
        let b = fast.general().trajectories(&source, &starts, &options, &Silent).unwrap();
        for ((a, b), open) in a.iter().flatten().zip(b.iter().flatten()).zip(open.iter().flatten()) {
            assert_eq!(a, b);
            assert!(a.states.iter().zip(&b.states).all(|(x, y)| x.to_bits() == y.to_bits()));
            assert_ne!(a.states, open.states, "the loop makes a difference");
            assert!(open.inputs.is_empty());
        }
    }
}

#[test]
fn scores_do_not_depend_on_threads() {
    let source = recording(900);
    let model = robot();
    let law = Treadmill { k_y: 0.0, ..Treadmill::default() };
    let controller: Arc<dyn Controller> = Arc::new(TreadmillLoop { law, ..TreadmillLoop::default() });
    let starts = Starts::Even(70);
    let mut options = options(120);
    options.keep = true;
    let closed = |threads| {
        with_threads(threads, || rollout_closed_loop(&model, &controller, &source, &starts, &options, &Silent)).unwrap()
    };
    let once = closed(1);
    // As text, which has all digits: of one episode there is no interval, and NaN is no equal of itself.
    for threads in [2, 7] {
        assert_eq!(format!("{once:?}"), format!("{:?}", closed(threads)));
    }
    assert_eq!(once.driven_inputs, ["u_v", "u_w"]);
    let open = rollout(&model, &source, &starts, &options, &Silent).unwrap();
    assert!(open.driven_inputs.is_empty());
    assert_ne!(open.horizon.model, once.horizon.model);
    // The null model keeps the given equation x' = u_v cos(yaw) - belt_speed, so it is driven too; persistence is not.
    assert_ne!(open.horizon.baselines[0], once.horizon.baselines[0]);
    assert_eq!(format!("{:?}", open.horizon.baselines[1]), format!("{:?}", once.horizon.baselines[1]));
}

#[test]
fn mismatched_controllers_are_refused() {
    let refused = |controller: TreadmillLoop| {
        Simulator::new(&robot()).unwrap().driven_by(Arc::new(controller)).err().unwrap().to_string()
    };
    let law = Treadmill { k_y: 0.0, ..Treadmill::default() };
    let default = || TreadmillLoop { law, ..TreadmillLoop::default() };
    let message = refused(TreadmillLoop::default());
    assert!(message.contains("`y` is no column of the model"), "{message}");
    let message = refused(TreadmillLoop { u_v: "uv".into(), ..default() });
    assert!(message.contains("`uv` is no column of the model; did you mean u_v"), "{message}");
    let message = refused(TreadmillLoop { speed: TreadmillSpeed::Column("bolt_speed".into()), ..default() });
    assert!(message.contains("`bolt_speed`") && message.contains("belt_speed?"), "{message}");
    let message = refused(TreadmillLoop { u_w: "x".into(), ..default() });
    assert!(message.contains("`x` is a state"), "{message}");
    let message = refused(TreadmillLoop { u_w: "u_v".into(), ..default() });
    assert!(message.contains("driven twice"), "{message}");
    let message = refused(TreadmillLoop { speed: TreadmillSpeed::Column("u_w".into()), ..default() });
    assert!(message.contains("controller that drives it"), "{message}");
    let message = refused(TreadmillLoop { latency: -0.01, ..default() });
    assert_eq!(message, "the controller's latency = -0.01: must be 0 or a time in s");
    let law = Treadmill { period: 0.0, ..law };
    assert!(refused(TreadmillLoop { law, ..default() }).contains("period = 0"));
}
