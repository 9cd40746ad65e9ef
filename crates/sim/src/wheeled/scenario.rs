//! Log of a run of the wheeled robot.

use fleetfoot_data::{Column, ColumnKind};

use super::run::WheeledRun;
use super::{Inputs, Wheeled};
use crate::{End, Kind, Regressors, Run, Scenario, Sink, SinkError, Topic};

/// `x y yaw v vy w left_rate right_rate`.
const STATES: usize = 8;

impl Scenario for Wheeled {
    /// Odometry, command and truth are in the robot's or the world's axes; the bumper says when the shell comes to touch a wall and when
    /// it leaves it. True commands and voltages are those held until the next row, as in the rows.
    fn topics(&self) -> Vec<Topic> {
        let wheels = || Kind::Joints(vec!["left_wheel_joint".to_owned(), "right_wheel_joint".to_owned()]);
        let voltages = || Kind::Numbers(vec!["left".to_owned(), "right".to_owned()]);
        let odometry = || Kind::Odometry { child_frame: "base_link".to_owned() };
        let topic =
            |name: &str, kind: Kind, frame: &str| Topic { name: name.to_owned(), kind, frame: frame.to_owned() };
        vec![
            topic("/odom", odometry(), "odom"),
            topic("/imu/data", self.imu.kind(), "imu_link"),
            topic("/joint_states", wheels(), ""),
            topic("/cmd_vel", Kind::Twist, "base_link"),
            topic("/motor/voltage", voltages(), ""),
            topic("/bumper", Kind::Flag, ""),
            topic("/truth/odometry", odometry(), "world"),
            topic("/truth/wheels", wheels(), ""),
            topic("/truth/cmd_vel", Kind::Twist, "base_link"),
            topic("/truth/voltage", voltages(), ""),
        ]
    }

    /// States: pose, velocity forward, to the left and about the vertical in the axes of the heading, the wheels' rates. Inputs: the
    /// commanded velocities and the voltages, in the order of [`Wheeled::inputs`], as held until the next row. Then the tyres' velocities
    /// over the floor, and whether a wall is touched.
    fn columns(&self) -> Vec<Column> {
        let mut columns = vec![
            column("x", "m"),
            column("y", "m"),
            column("yaw", "rad"),
            column("v", "m/s"),
            column("vy", "m/s"),
            column("w", "rad/s"),
            column("left_rate", "rad/s"),
            column("right_rate", "rad/s"),
        ];
        let velocity = [column("v_command", "m/s"), column("w_command", "rad/s")];
        let voltage = [column("left_voltage", "V"), column("right_voltage", "V")];
        match self.inputs {
            Inputs::Velocity => columns.extend(velocity.into_iter().chain(voltage)),
            Inputs::Voltage => columns.extend(voltage.into_iter().chain(velocity)),
        }
        columns.extend([column("left_slip", "m/s"), column("right_slip", "m/s")]);
        columns.push(Column { kind: ColumnKind::Boolean, ..Column::float("wall_contact") });
        columns
    }

    fn regressors(&self) -> Regressors {
        Regressors { states: STATES, inputs: 2 }
    }

    fn row_period(&self) -> f64 {
        self.row_period
    }

    fn run(&self, run: Run, sink: &mut dyn Sink) -> Result<End, SinkError> {
        WheeledRun::new(self, run.seed).run(run.seconds, sink)
    }
}

fn column(name: &str, unit: &str) -> Column {
    Column { unit: Some(unit.to_owned()), ..Column::float(name) }
}
