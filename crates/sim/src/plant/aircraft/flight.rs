//! One climb, simulated.

use fleetfoot_data::{Column, MemorySource};
use rand::RngExt;
use rand_pcg::Pcg64;

use super::autopilot::Guidance;
use super::dynamics::{Forces, State};
use super::fleet::{Airplane, Conditions};
use super::recorder::{Recorder, Recording};
use crate::plant::atmosphere::GRAVITY;
use crate::plant::integrator::rk4_step;
use crate::sensor::stream;
use crate::{End, OrnsteinUhlenbeck};

/// Names and units of the columns: states, inputs, given models, derivatives, latent functions, errors of the equations
/// (per mass), and what the recorder kept.
const COLUMNS: [(&str, &str); 27] = [
    ("h", "m"),
    ("V", "m/s"),
    ("gamma", "rad"),
    ("m", "kg"),
    ("alpha", "rad"),
    ("N1", "1"),
    ("SAT", "K"),
    ("rho", "kg/m^3"),
    ("M", "1"),
    ("q", "Pa"),
    ("h_dot", "m/s"),
    ("V_dot", "m/s^2"),
    ("gamma_dot", "rad/s"),
    ("m_dot", "kg/s"),
    ("T", "N"),
    ("D", "N"),
    ("L", "N"),
    ("Isp", "m/s"),
    ("eps_V", "m/s^2"),
    ("eps_gamma", "m/s^2"),
    ("qar_h", "m"),
    ("qar_M", "1"),
    ("qar_C", "kg/s"),
    ("qar_N1", "1"),
    ("qar_SAT", "K"),
    ("qar_theta", "rad"),
    ("qar_m", "kg"),
];

/// Values of one row, in the order of [`Flight::columns`].
pub(super) type Row = [f64; COLUMNS.len()];

/// One climb of one aircraft, by columns.
#[derive(Debug, Clone, PartialEq)]
pub struct Flight {
    /// Of the fleet.
    pub aircraft: u32,
    /// Of the aircraft.
    pub number: u32,
    /// Conditions of the flight.
    pub conditions: Conditions,
    /// Seconds between rows; the first is at 0.
    pub row_period: f64,
    /// Values by column, in the order of [`Self::columns`].
    pub values: Vec<Vec<f64>>,
}

impl Flight {
    /// The columns without the time: 4 states, 2 inputs, given models (`SAT rho M q`), true derivatives, latent
    /// functions, what the equations do not explain (`eps_V`, `eps_gamma`, m/s^2), recorded channels (`qar_...`).
    pub fn columns() -> Vec<Column> {
        COLUMNS.iter().map(|&(name, unit)| Column { unit: Some(unit.to_owned()), ..Column::float(name) }).collect()
    }

    /// Number of columns with true values; those after them are the recorder's.
    pub const TRUE_COLUMNS: usize = COLUMNS.len() - Recorder::CHANNELS;

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.values[0].len()
    }

    /// One column by its name.
    pub fn column(&self, name: &str) -> Option<&[f64]> {
        COLUMNS.iter().position(|&(column, _)| column == name).map(|i| self.values[i].as_slice())
    }

    /// Adds it, by its aircraft and number, as an episode to a source that has [`Self::columns`].
    pub fn append_to(self, source: &mut MemorySource) {
        source.push_uniform(format!("aircraft {} flight {}", self.aircraft, self.number), self.row_period, self.values);
    }

    pub(super) fn simulate(airplane: &Airplane, number: u32, seed: u64) -> Self {
        let mut climb = Climb::new(airplane, seed);
        // 15 minutes: most climbs.
        let mut values = vec![Vec::with_capacity(900); COLUMNS.len()];
        for row in &mut climb {
            values.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
        }
        let row_period = airplane.parameters.row_period;
        Self { aircraft: airplane.index(), number, conditions: climb.conditions, row_period, values }
    }
}

impl Airplane {
    /// The flight with this number: always the same for the same parameters, whatever flew before.
    pub fn flight(&self, number: u32) -> Flight {
        let mut random = stream(self.parameters.fleet.seed, &format!("fleet/{}/flight/{number}", self.index()));
        Flight::simulate(self, number, random.random())
    }
}

/// A climb under way: an iterator over its rows.
pub(super) struct Climb<'a> {
    airplane: &'a Airplane,
    conditions: Conditions,
    guidance: Guidance<'a>,
    recording: Recording,
    turbulence: [(OrnsteinUhlenbeck, Pcg64); 2],
    state: State,
    rows: usize,
}

impl<'a> Climb<'a> {
    pub(super) fn new(airplane: &'a Airplane, seed: u64) -> Self {
        let parameters = &airplane.parameters;
        let conditions = Conditions::draw(parameters, seed);
        let guidance = Guidance::new(parameters, conditions, seed);
        let disturbance = |purpose: &str, deviation: f64| {
            let mut random = stream(seed, purpose);
            let correlation = parameters.turbulence.correlation;
            (OrnsteinUhlenbeck::new(deviation, correlation, parameters.row_period, &mut random), random)
        };
        Self {
            airplane,
            conditions,
            state: trim(airplane, &conditions, &guidance),
            guidance,
            recording: Recording::new(&parameters.recorder, seed),
            turbulence: [
                disturbance("turbulence/longitudinal", parameters.turbulence.longitudinal),
                disturbance("turbulence/normal", parameters.turbulence.normal),
            ],
            rows: 0,
        }
    }

    /// When the next row is, s.
    pub(super) fn seconds(&self) -> f64 {
        self.rows as f64 * self.airplane.parameters.row_period
    }

    /// Reason why the flight cannot continue, if there is one: parameters can be valid one by one and still describe no
    /// aircraft that flies.
    pub(super) fn lost(&self) -> Option<String> {
        let [h, speed, path, ..] = self.state;
        // Negated, so that what is no number counts.
        let flies = speed > 70.0 && speed < 300.0 && h > -100.0 && path.abs() < 0.5;
        (!flies).then(|| format!("left the envelope at h = {h:.0} m, V = {speed:.1} m/s, gamma = {path:.3} rad"))
    }

    /// End of the flight, once there are no more rows.
    pub(super) fn end(&self) -> End {
        let seconds = self.seconds();
        match self.lost() {
            Some(reason) => End::Fault { seconds, reason },
            None => End::Early { seconds, reason: self.over().unwrap_or("at its top").to_owned() },
        }
    }

    /// Why there is nothing more to record, where there is not.
    fn over(&self) -> Option<&'static str> {
        let flights = &self.airplane.parameters.flights;
        let [h, speed, path, ..] = self.state;
        if h >= self.conditions.cruise_altitude {
            return Some("at cruise altitude");
        }
        // The climb pauses where the aircraft accelerates; it is over for want of thrust only near the cruise
        // altitudes.
        let weak = speed * path.sin() < flights.residual_climb_rate && h > 0.7 * self.conditions.cruise_altitude;
        if weak {
            return Some("climbs no more");
        }
        (self.seconds() > flights.longest).then_some("longest climb")
    }
}

impl Iterator for Climb<'_> {
    type Item = Row;

    fn next(&mut self) -> Option<Row> {
        let (terms, deviation) = (self.airplane.terms(), self.conditions.isa_deviation);
        let forces = Forces::at(terms, &self.state, deviation);
        let [h, _, path, mass, alpha, fan] = self.state;
        if self.over().is_some() || self.lost().is_some() {
            return None;
        }
        let unexplained = std::array::from_fn(|i| {
            let (process, random) = &mut self.turbulence[i];
            process.next(random)
        });
        let reference = self.guidance.next(h);
        let [h_dot, v_dot, path_dot, m_dot] = forces.derivatives(&self.state, unexplained);
        let kept = [h, forces.mach, -m_dot, fan, forces.air.temperature, alpha + path, mass];
        let kept = self.recording.keep(kept);
        let mut row: Row = [0.0; COLUMNS.len()];
        row[..6].copy_from_slice(&self.state);
        let given = [forces.air.temperature, forces.air.density, forces.mach, forces.dynamic_pressure];
        row[6..10].copy_from_slice(&given);
        row[10..14].copy_from_slice(&[h_dot, v_dot, path_dot, m_dot]);
        row[14..18].copy_from_slice(&[forces.thrust, forces.drag, forces.lift, forces.specific_impulse]);
        row[18..20].copy_from_slice(&unexplained);
        row[Flight::TRUE_COLUMNS..].copy_from_slice(&kept);

        let parameters = &self.airplane.parameters;
        let step = parameters.row_period / f64::from(parameters.substeps);
        for _ in 0..parameters.substeps {
            self.state = rk4_step(&self.state, step, |state| {
                let forces = Forces::at(terms, state, deviation);
                let [h, v, path, m] = forces.derivatives(state, unexplained);
                let [alpha, fan] = parameters.autopilot.control(state, &forces, &reference);
                [h, v, path, m, alpha, fan]
            });
        }
        self.rows += 1;
        Some(row)
    }
}

/// The state in which a recording begins: on the schedule, climbing steadily at it, with the rated thrust.
fn trim(airplane: &Airplane, conditions: &Conditions, guidance: &Guidance<'_>) -> State {
    let parameters = &airplane.parameters;
    let h = parameters.flights.initial_altitude;
    let speed = guidance.scheduled_speed(h);
    // dV/dh of the schedule over 10 m: what V' takes from the climb.
    let gradient = (guidance.scheduled_speed(h + 10.0) - speed) / 10.0;
    let gradient = if gradient.abs() < 0.05 { gradient } else { 0.0 };
    let mut state = [h, speed, 0.05, conditions.mass, 0.05, guidance.rated_fan_speed(h)];
    // A contraction: the lift slope is known within some 20 %.
    for _ in 0..30 {
        let forces = Forces::at(airplane.terms(), &state, conditions.isa_deviation);
        let [along, normal] = forces.specific(&state);
        state[2] = (along / (GRAVITY + speed * gradient)).clamp(-0.3, 0.3).asin();
        let slope = forces.dynamic_pressure * parameters.autopilot.lift_slope / conditions.mass;
        let correction = (GRAVITY * state[2].cos() - normal) / slope;
        state[4] = (state[4] + correction).clamp(-0.1, parameters.autopilot.alpha_most);
    }
    state
}
