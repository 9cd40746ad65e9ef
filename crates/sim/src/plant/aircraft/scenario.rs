//! A climb as a scenario that writes a log.

use fleetfoot_data::Column;

use super::fleet::Airplane;
use super::flight::{Climb, Flight};
use super::parameters::AircraftClimb;
use super::recorder::Recorder;
use crate::parameter_error::ParameterError;
use crate::sensor::Clock;
use crate::{End, Kind, Reading, Regressors, Run, Scenario, Sink, SinkError, Stamps, Topic};

/// Topics of the recorded channels, in their order.
const CHANNELS: [&str; Recorder::CHANNELS] = [
    "/qar/altitude",
    "/qar/mach",
    "/qar/fuel_flow",
    "/qar/fan_speed",
    "/qar/static_air_temperature",
    "/qar/pitch",
    "/qar/mass",
];

/// Climbs of one aircraft of the fleet: a run is a flight, which the run's seed draws, cut at the run's length.
///
/// A climb that reaches its top before that ends early: there is nothing to record after it.
#[derive(Debug, Clone, PartialEq)]
pub struct ClimbScenario {
    airplane: Airplane,
}

impl ClimbScenario {
    /// Flights of the aircraft that the parameters name.
    ///
    /// # Errors
    /// Those of [`AircraftClimb::validate`].
    pub fn new(parameters: &AircraftClimb) -> Result<Self, ParameterError> {
        Ok(Self { airplane: Airplane::new(parameters)? })
    }

    /// The aircraft, with its true terms.
    pub fn airplane(&self) -> &Airplane {
        &self.airplane
    }
}

impl Scenario for ClimbScenario {
    fn topics(&self) -> Vec<Topic> {
        let topic = |name: &str, kind| Topic { name: name.to_owned(), kind, frame: String::new() };
        let truth = Flight::columns()[..Flight::TRUE_COLUMNS].iter().map(|column| column.name.clone()).collect();
        let recorded = CHANNELS.iter().map(|name| topic(name, Kind::Number));
        recorded.chain([topic("/truth/aircraft", Kind::Numbers(truth))]).collect()
    }

    fn columns(&self) -> Vec<Column> {
        Flight::columns()
    }

    fn regressors(&self) -> Regressors {
        Regressors { states: 4, inputs: 2 }
    }

    fn row_period(&self) -> f64 {
        self.airplane.parameters.row_period
    }

    fn run(&self, run: Run, sink: &mut dyn Sink) -> Result<End, SinkError> {
        let clock = Clock::perfect(self.airplane.parameters.epoch * 1_000_000_000);
        let period = (self.row_period() * 1e9).round() as i64;
        let mut climb = Climb::new(&self.airplane, run.seed);
        let mut elapsed = 0;
        loop {
            let seconds = climb.seconds();
            // Rows at 0, period, ... before the end of the run: as many as period times rows make its length.
            if seconds > run.seconds - 0.5 * self.row_period() {
                return Ok(End::Complete);
            }
            let Some(row) = climb.next() else { break };
            let stamp = clock.read(elapsed);
            elapsed += period;
            let stamps = Stamps { header: stamp, log: stamp };
            for (topic, &value) in row[Flight::TRUE_COLUMNS..].iter().enumerate() {
                sink.message(topic, stamps, Reading::Number(value))?;
            }
            sink.message(CHANNELS.len(), stamps, Reading::Numbers(&row[..Flight::TRUE_COLUMNS]))?;
            sink.row(stamp, &row)?;
        }
        Ok(climb.end())
    }
}
