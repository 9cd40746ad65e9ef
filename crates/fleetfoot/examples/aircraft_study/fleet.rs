//! The flights of one aircraft, as rows in memory, with the errors that a recorder makes.

use fleetfoot::{
    data::{Cancelled, Column, MemorySource, Silent, mix, parallel_map},
    sim::plant::aircraft::{AircraftClimb, Airplane, Flight},
};

use super::Failure;

/// Errors of the recordings.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Noise {
    /// Standard deviation of the accelerations along the path and normal to it that the equations do not explain, m/s^2 (correlated over 5 s).
    pub(crate) turbulence: f64,
    /// Standard deviation of the error of the mass flow, relative, from row to row.
    pub(crate) fuel: f64,
    /// Seed of the error of the mass flow.
    pub(crate) seed: u64,
}

/// One aircraft of the fleet.
pub(crate) fn airplane(aircraft: u32, noise: Noise) -> Result<Airplane, Failure> {
    let mut climb = AircraftClimb { aircraft, ..AircraftClimb::default() };
    (climb.turbulence.longitudinal, climb.turbulence.normal) = (noise.turbulence, noise.turbulence);
    Ok(Airplane::new(&climb)?)
}

/// Flights `0..count` of an aircraft, one episode each: all columns but those of the recorder, with an error in the mass flow.
pub(crate) fn flights(airplane: &Airplane, count: u32, noise: Noise) -> Result<MemorySource, Failure> {
    let columns = Flight::columns()[..Flight::TRUE_COLUMNS].to_vec();
    let flow = index(&columns, "m_dot")?;
    let mut source = MemorySource::new(columns);
    let flown = parallel_map(count as usize, &Silent, |k| {
        let mut flight = airplane.flight(k as u32);
        flight.values.truncate(Flight::TRUE_COLUMNS);
        let key = mix(mix(mix(noise.seed).wrapping_add(u64::from(flight.aircraft))).wrapping_add(k as u64));
        for (row, value) in flight.values[flow].iter_mut().enumerate() {
            *value *= 1.0 + noise.fuel * normal(mix(key.wrapping_add(row as u64)));
        }
        Ok::<_, Cancelled>(flight)
    })?;
    for flight in flown {
        flight.append_to(&mut source);
    }
    Ok(source)
}

/// Index of a column.
pub(crate) fn index(columns: &[Column], name: &str) -> Result<usize, Failure> {
    Ok(columns.iter().position(|column| column.name == name).ok_or_else(|| format!("flights have no column {name}"))?)
}

/// A standard normal number of an address (Box and Muller 1958).
fn normal(address: u64) -> f64 {
    let uniform = |bits: u64| ((bits >> 11) as f64 + 0.5) * 2f64.powi(-53);
    let (radius, angle) = (uniform(mix(address)), uniform(mix(address ^ u64::MAX)));
    (-2.0 * radius.ln()).sqrt() * (std::f64::consts::TAU * angle).cos()
}
