//! Dead reckoning from the wheels' encoders.

use fleetfoot_control::controller::DifferentialDrive;

/// Odometry of a differential drive from its wheels' turns: it takes slip for motion.
#[derive(Debug, Clone)]
pub struct WheelOdometry {
    drive: DifferentialDrive,
    last: Option<[f64; 2]>,
    pose: [f64; 3],
    velocity: [f64; 2],
}

impl WheelOdometry {
    /// From the origin of its own frame, heading along x.
    pub fn new(drive: DifferentialDrive) -> Self {
        Self { drive, last: None, pose: [0.0; 3], velocity: [0.0; 2] }
    }

    /// Takes the angles (rad, counted over whole turns) and rates (rad/s) of the left and the right wheel. The way since the angles before is
    /// an arc.
    pub fn update(&mut self, turned: [f64; 2], rate: [f64; 2]) {
        if let Some(last) = self.last {
            let [way, turn] = self.drive.velocity([turned[0] - last[0], turned[1] - last[1]]);
            self.pose = super::avoidance::arc(self.pose, way, turn, 1.0);
        }
        self.last = Some(turned);
        self.velocity = self.drive.velocity(rate);
    }

    /// `[x, y, yaw]` in its own frame, m and rad; the yaw counts whole turns.
    pub fn pose(&self) -> [f64; 3] {
        self.pose
    }

    /// Forward velocity, m/s, and yaw rate, rad/s.
    pub fn velocity(&self) -> [f64; 2] {
        self.velocity
    }
}
