//! Proportional-integral-derivative control.

use serde::{Deserialize, Serialize};

use super::{ParameterError, check};

/// A PID controller: `u = f r + p (r - y) + integral of i (r - y) - d y'`, within limits.
///
/// The derivative is the measurement's, so that a step of the reference gives no kick; a first-order filter may smooth it. At a limit the
/// integral does not grow further outwards (conditional integration).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Pid {
    /// Output a unit of error.
    pub proportional: f64,
    /// Output a second and unit of error.
    pub integral: f64,
    /// Output a unit of the measurement's rate.
    pub derivative: f64,
    /// Output a unit of the reference.
    pub feedforward: f64,
    /// Time constant of the derivative's filter, s; 0: none.
    pub derivative_filter: f64,
    /// Lowest output.
    pub lowest: f64,
    /// Highest output.
    pub highest: f64,
}

impl Default for Pid {
    /// Unit proportional gain without limits.
    fn default() -> Self {
        Self {
            proportional: 1.0,
            integral: 0.0,
            derivative: 0.0,
            feedforward: 0.0,
            derivative_filter: 0.0,
            lowest: f64::MIN,
            highest: f64::MAX,
        }
    }
}

impl Pid {
    /// Checks the parameters.
    ///
    /// # Errors
    /// A gain that is not finite, a negative filter, limits in the wrong order.
    pub fn validate(&self) -> Result<(), ParameterError> {
        for (name, gain) in [
            ("proportional", self.proportional),
            ("integral", self.integral),
            ("derivative", self.derivative),
            ("feedforward", self.feedforward),
        ] {
            check(name, gain, true, "a finite number")?;
        }
        check("derivative_filter", self.derivative_filter, self.derivative_filter >= 0.0, "0 or a time in s")?;
        check("highest", self.highest, self.highest >= self.lowest, "a number not below `lowest`")?;
        check("lowest", self.lowest, true, "a finite number")
    }
}

/// The memory of a [`Pid`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PidState {
    integral: f64,
    last: Option<f64>,
    rate: f64,
}

impl PidState {
    /// The output for the `seconds` that begin now.
    pub fn update(&mut self, pid: &Pid, reference: f64, measurement: f64, seconds: f64) -> f64 {
        let error = reference - measurement;
        if let Some(last) = self.last {
            let share = seconds / (seconds + pid.derivative_filter);
            self.rate += share * ((measurement - last) / seconds - self.rate);
        }
        self.last = Some(measurement);
        let direct = pid.feedforward * reference + pid.proportional * error - pid.derivative * self.rate;
        let growth = pid.integral * error * seconds;
        let output = direct + self.integral + growth;
        let outwards = (output > pid.highest && growth > 0.0) || (output < pid.lowest && growth < 0.0);
        if !outwards {
            self.integral += growth;
        }
        (direct + self.integral).clamp(pid.lowest, pid.highest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// y' = (u - y) / tau under PI control that cancels the plant's pole (i = p / tau) is a first-order lag of tau / p.
    #[test]
    fn pole_cancelling_integral_gives_a_first_order_step_response() {
        let (tau, gain, dt) = (0.2, 4.0, 1e-5);
        let pid = Pid { proportional: gain, integral: gain / tau, ..Pid::default() };
        pid.validate().unwrap();
        let (mut state, mut y) = (PidState::default(), 0.0);
        let mut worst: f64 = 0.0;
        for k in 0..30_000 {
            let exact = 1.0 - (-gain * f64::from(k) * dt / tau).exp();
            worst = worst.max((y - exact).abs());
            y += dt * (state.update(&pid, 1.0, y, dt) - y) / tau;
        }
        // First order in dt: gain dt / tau = 2e-4.
        assert!(worst < 2e-4, "{worst}");
        assert!((y - (1.0 - (-6.0f64).exp())).abs() < 1e-4);
    }

    #[test]
    fn a_saturated_integral_does_not_wind_up() {
        // An integrator plant with a weak actuator far from its reference: without anti-windup the integral would overshoot long.
        let pid = Pid { proportional: 2.0, integral: 1.0, lowest: -0.5, highest: 0.5, ..Pid::default() };
        let free = Pid { lowest: f64::MIN, highest: f64::MAX, ..pid };
        let run = |limited: bool| {
            let (mut state, mut y, mut top, dt) = (PidState::default(), 0.0f64, 0.0f64, 1e-3);
            for _ in 0..60_000 {
                let controller = if limited { &pid } else { &free };
                let u = state.update(controller, 10.0, y, dt).clamp(-0.5, 0.5);
                y += u * dt;
                top = top.max(y);
            }
            (top - 10.0, y)
        };
        let ((settled, end), (wound, _)) = (run(true), run(false));
        assert!(wound > 3.0, "the plant is one that winds up: {wound}");
        assert!(settled < 0.3, "{settled}");
        assert!((end - 10.0).abs() < 1e-3, "{end}");
    }

    #[test]
    fn the_derivative_sees_the_measurement_alone() {
        let pid = Pid { proportional: 0.0, derivative: 0.5, ..Pid::default() };
        let mut state = PidState::default();
        assert_eq!(state.update(&pid, 0.0, 1.0, 0.1), 0.0);
        assert_eq!(state.update(&pid, 100.0, 1.0, 0.1), 0.0, "no kick");
        assert!((state.update(&pid, 100.0, 1.2, 0.1) + 1.0).abs() < 1e-12);
        // With a filter of nine periods a tenth of the step passes at first.
        let (filtered, mut state) = (Pid { derivative_filter: 0.9, ..pid }, PidState::default());
        state.update(&filtered, 0.0, 1.0, 0.1);
        assert!((state.update(&filtered, 0.0, 1.2, 0.1) + 0.1).abs() < 1e-12);
    }

    #[test]
    fn limits_hold_and_must_be_in_order() {
        let pid = Pid { proportional: 100.0, feedforward: 1.0, lowest: -1.0, highest: 2.0, ..Pid::default() };
        assert_eq!(PidState::default().update(&pid, 5.0, 0.0, 0.1), 2.0);
        assert_eq!(PidState::default().update(&pid, -5.0, 0.0, 0.1), -1.0);
        let error = Pid { lowest: 1.0, highest: 0.0, ..pid }.validate().unwrap_err();
        assert_eq!(error.name, "highest");
        assert!(Pid { integral: f64::NAN, ..pid }.validate().is_err());
    }
}
