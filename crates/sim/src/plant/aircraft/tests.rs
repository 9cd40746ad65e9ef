//! The climbs against their equations.

use fleetfoot_data::{Cancelled, Halo, MemorySource, Silent, Source, parallel_map, with_threads};

use super::*;
use crate::plant::atmosphere::GRAVITY;
use crate::{End, Reading, Run, Scenario, Sink, SinkError, Stamps};

fn airplane(parameters: &AircraftClimb) -> Airplane {
    Airplane::new(parameters).unwrap()
}

fn columns<'a, const N: usize>(flight: &'a Flight, names: [&str; N]) -> [&'a [f64]; N] {
    names.map(|name| flight.column(name).unwrap())
}

#[test]
fn climbs_match_a_narrow_body_jet() {
    let airplane = airplane(&AircraftClimb::default());
    for number in 0..8 {
        let flight = airplane.flight(number);
        let [h, v, path, m] = columns(&flight, ["h", "V", "gamma", "m"]);
        let last = flight.rows() - 1;
        assert!((400..1_800).contains(&flight.rows()), "{number}: {} rows", flight.rows());
        assert_eq!(h[0], 1_524.0);
        assert!(h[last] > flight.conditions.cruise_altitude - 1_500.0, "{number}: {}", h[last]);
        assert!(v.iter().all(|v| (130.0..245.0).contains(v)));
        assert!(path.iter().all(|path| (-0.01..0.25).contains(path)));
        assert!(m.windows(2).all(|m| m[1] < m[0]));
        let burnt = m[0] - m[last];
        assert!((600.0..2_500.0).contains(&burnt), "{number}: {burnt} kg");
        let [t, d, l, isp, alpha, mach] = columns(&flight, ["T", "D", "L", "Isp", "alpha", "M"]);
        for row in 0..flight.rows() {
            assert!(t[row] > d[row] && d[row] > 0.0, "{number} at row {row}: T {} D {}", t[row], d[row]);
            assert!((9.0..20.0).contains(&(l[row] / d[row])), "{number} at row {row}: L/D {}", l[row] / d[row]);
            assert!((45_000.0..80_000.0).contains(&isp[row]), "{number} at row {row}: {}", isp[row]);
            assert!((-0.02..0.12).contains(&alpha[row]) && (0.35..0.81).contains(&mach[row]));
        }
    }
}

/// (T cos alpha - D + m eps) V = m g h' + m V V': equation (27) times V, with (26). And (28), (29), and the definitions
/// of M and q.
#[test]
fn every_row_obeys_the_equations() {
    let mut parameters = AircraftClimb::default();
    (parameters.turbulence.longitudinal, parameters.turbulence.normal) = (0.05, 0.3);
    let flight = airplane(&parameters).flight(3);
    let [v, path, m, alpha, rho, q] = columns(&flight, ["V", "gamma", "m", "alpha", "rho", "q"]);
    let [h_dot, v_dot, path_dot, m_dot] = columns(&flight, ["h_dot", "V_dot", "gamma_dot", "m_dot"]);
    let [t, d, l, isp, eps_v, eps_path] = columns(&flight, ["T", "D", "L", "Isp", "eps_V", "eps_gamma"]);
    for i in 0..flight.rows() {
        let power = (t[i] * alpha[i].cos() - d[i] + m[i] * eps_v[i]) * v[i];
        let energy = m[i] * GRAVITY * h_dot[i] + m[i] * v[i] * v_dot[i];
        assert!((power - energy).abs() < 1e-13 * m[i] * GRAVITY * v[i], "row {i}: {power} {energy}");
        let normal = t[i] * alpha[i].sin() + l[i] + m[i] * eps_path[i] - m[i] * GRAVITY * path[i].cos();
        assert!((m[i] * v[i] * path_dot[i] - normal).abs() < 1e-13 * m[i] * GRAVITY);
        assert!((m_dot[i] * isp[i] + t[i]).abs() < 1e-13 * t[i]);
        assert!((0.5 * rho[i] * v[i] * v[i] - q[i]).abs() < 1e-13 * q[i]);
    }
    let deviation = (eps_v.iter().map(|eps| eps * eps).sum::<f64>() / flight.rows() as f64).sqrt();
    assert!((0.03..0.07).contains(&deviation), "{deviation}");
    // Off by default: the equations then hold without a remainder.
    assert!(airplane(&AircraftClimb::default()).flight(3).column("eps_V").unwrap().iter().all(|&eps| eps == 0.0));
}

/// The states are the integrals of their derivatives: Simpson's rule against differences, for a guidance that does not
/// wander. The mass lost is the integral of T / Isp.
#[test]
fn states_are_the_integrals_of_their_derivatives() {
    let mut steady = AircraftClimb { row_period: 0.1, substeps: 1, ..AircraftClimb::default() };
    steady.flights.transition_altitude = 0.0;
    let autopilot = &mut steady.autopilot;
    (autopilot.normal_wander, autopilot.speed_wander, autopilot.fan_speed_wander) = (0.0, 0.0, 0.0);
    let flight = airplane(&steady).flight(1);
    let last = (flight.rows() - 1) / 2 * 2;
    let [t, isp] = columns(&flight, ["T", "Isp"]);
    let burning: Vec<f64> = t.iter().zip(isp).map(|(t, isp)| -t / isp).collect();
    let rates = ["h_dot", "V_dot", "gamma_dot"].map(|name| flight.column(name).unwrap().to_vec());
    let [h_dot, v_dot, path_dot] = rates;
    for (state, rate, tolerance) in
        [("h", h_dot, 1e-3), ("V", v_dot, 2e-3), ("gamma", path_dot, 2e-4), ("m", burning, 1e-3)]
    {
        let x = flight.column(state).unwrap();
        let three = |i: usize| (rate[i] + 4.0 * rate[i + 1] + rate[i + 2]) * 0.1 / 3.0;
        let error = (x[last] - x[0] - (0..last).step_by(2).map(three).sum::<f64>()).abs();
        println!("{state} {error:e}");
        assert!(error < tolerance, "{state}: {error:e}");
    }
}

/// Largest difference of altitude (m), speed (m/s) and mass (kg) at a row from what 64 steps a second say.
fn step_error(parameters: &AircraftClimb, row: usize, substeps: u32) -> f64 {
    let at = |substeps: u32| {
        let flight = airplane(&AircraftClimb { substeps, ..parameters.clone() }).flight(2);
        columns(&flight, ["h", "V", "m"]).map(|column| column[row])
    };
    at(substeps).iter().zip(at(64)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// If no limit of the control is met, the method is of fourth order. With the default parameters, which accelerate at a
/// limit at 10,000 ft, the default step is good to a millimetre.
#[test]
fn halving_the_step_divides_the_error_by_sixteen() {
    let mut smooth = AircraftClimb::default();
    smooth.flights.transition_altitude = 0.0;
    let [two, four, eight] = [2, 4, 8].map(|substeps| step_error(&smooth, 300, substeps));
    assert!((3.5..4.6).contains(&(two / four).log2()), "{two:e} {four:e}");
    assert!((3.5..4.6).contains(&(four / eight).log2()), "{four:e} {eight:e}");
    let error = step_error(&AircraftClimb::default(), 700, 2);
    assert!(error < 1e-3, "{error:e}");
}

#[test]
fn flights_repeat_and_differ() {
    let one = airplane(&AircraftClimb::default());
    let bits = |flight: &Flight| flight.values.iter().flatten().map(|v| v.to_bits()).collect::<Vec<_>>();
    let flight = one.flight(5);
    assert_eq!(bits(&flight), bits(&airplane(&AircraftClimb::default()).flight(5)));
    assert_ne!(flight.conditions, one.flight(6).conditions);
    let other = airplane(&AircraftClimb { aircraft: 1, ..AircraftClimb::default() });
    assert_ne!(bits(&flight), bits(&other.flight(5)));
    let mut seeded = AircraftClimb::default();
    seeded.fleet.seed = 1;
    assert_ne!(flight.conditions, airplane(&seeded).flight(5).conditions);
}

#[test]
fn threads_do_not_matter() {
    let fly = |threads: usize| {
        with_threads(threads, || {
            parallel_map::<_, Cancelled>(6, &Silent, |i| {
                let aircraft = airplane(&AircraftClimb { aircraft: i as u32 / 3, ..AircraftClimb::default() });
                Ok(aircraft.flight(i as u32 % 3))
            })
            .unwrap()
        })
    };
    let one = fly(1);
    assert!(one == fly(2) && one == fly(7));
}

#[test]
fn a_quieter_recorder_changes_nothing_else() {
    let mut quiet = AircraftClimb::default();
    quiet.recorder.altitude = Channel { deviation: 0.0, resolution: 0.0 };
    let (noisy, quiet) = (airplane(&AircraftClimb::default()).flight(0), airplane(&quiet).flight(0));
    let recorded = Flight::columns().iter().position(|column| column.name == "qar_h").unwrap();
    for (i, (a, b)) in noisy.values.iter().zip(&quiet.values).enumerate() {
        assert_eq!(a == b, i != recorded, "column {i}");
    }
    assert_eq!(quiet.column("qar_h"), quiet.column("h"));
}

#[test]
fn fleet_shares_supports_only() {
    let type_terms = Terms::default();
    let fleet: Vec<Airplane> =
        (0..25).map(|aircraft| airplane(&AircraftClimb { aircraft, ..AircraftClimb::default() })).collect();
    for latent in Latent::ALL {
        let support = |terms: &Terms| terms.coefficients(latent).iter().map(|&c| c != 0.0).collect::<Vec<_>>();
        assert!(fleet.iter().all(|airplane| support(airplane.terms()) == support(&type_terms)));
        let first: Vec<f64> = fleet.iter().map(|airplane| airplane.terms().of(latent)[0].coefficient).collect();
        let nominal = type_terms.of(latent)[0].coefficient;
        let spread = (first.iter().map(|c| (c / nominal - 1.0).powi(2)).sum::<f64>() / 25.0).sqrt();
        assert!((0.004..0.04).contains(&spread), "{latent:?}: {spread}");
    }
}

#[derive(Default)]
struct Kept {
    rows: Vec<Vec<f64>>,
    stamps: Vec<i64>,
    messages: usize,
    altitudes: Vec<f64>,
}

impl Sink for Kept {
    fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
        self.messages += 1;
        if let (0, Reading::Number(altitude)) = (topic, reading) {
            self.altitudes.push(altitude);
            self.stamps.push(stamps.log);
        }
        Ok(())
    }

    fn row(&mut self, _stamp: i64, values: &[f64]) -> Result<(), SinkError> {
        self.rows.push(values.to_vec());
        Ok(())
    }
}

#[test]
fn scenario_writes_its_columns() {
    let scenario = ClimbScenario::new(&AircraftClimb::default()).unwrap();
    let mut kept = Kept::default();
    let end = scenario.run(Run { seconds: 100.0, seed: 9 }, &mut kept).unwrap();
    assert_eq!(end, End::Complete);
    assert_eq!((kept.rows.len(), kept.messages), (100, 100 * scenario.topics().len()));
    assert_eq!(kept.rows[0].len(), scenario.columns().len());
    assert!(kept.stamps.windows(2).all(|stamps| stamps[1] - stamps[0] == 1_000_000_000));
    let recorded = scenario.columns().iter().position(|column| column.name == "qar_h").unwrap();
    assert!(kept.rows.iter().zip(&kept.altitudes).all(|(row, altitude)| row[recorded] == *altitude));
    let mut again = Kept::default();
    // The whole climb begins with the same rows.
    let end = scenario.run(Run { seconds: 5_000.0, seed: 9 }, &mut again).unwrap();
    assert!(again.rows.len() > 400 && again.rows[..100] == kept.rows[..]);
    let reason = "at cruise altitude".to_owned();
    assert_eq!(end, End::Early { seconds: again.rows.len() as f64, reason });
}

#[test]
fn flights_are_episodes_of_a_source() {
    let airplane = airplane(&AircraftClimb::default());
    let mut source = MemorySource::new(Flight::columns());
    (0..2).for_each(|number| airplane.flight(number).append_to(&mut source));
    assert_eq!(source.episodes().len(), 2);
    let flight = airplane.flight(1);
    let block = source.read(1, 0..flight.rows(), Halo::default()).unwrap();
    assert_eq!(block.core(0), flight.column("h").unwrap());
}

#[test]
fn parameters_that_do_not_fly_are_named() {
    let refused = |change: fn(&mut AircraftClimb)| {
        let mut parameters = AircraftClimb::default();
        change(&mut parameters);
        ClimbScenario::new(&parameters).unwrap_err().to_string()
    };
    assert!(refused(|p| p.substeps = 0).starts_with("substeps = 0"));
    assert!(refused(|p| p.row_period = 5.0).starts_with("substeps = 2"));
    assert!(refused(|p| p.flights.mass.mean = f64::NAN).starts_with("flights.mass.mean = NaN"));
    assert!(refused(|p| p.terms.drag[0].coefficient = -2.0).starts_with("terms.drag"));
    assert!(refused(|p| p.terms.lift[0].powers = [3, 3]).contains("3 at most"));
    assert!(refused(|p| p.recorder.pitch.deviation = -1.0).starts_with("recorder.pitch.deviation = -1"));
    let text = toml::to_string(&AircraftClimb::default()).unwrap();
    assert_eq!(toml::from_str::<AircraftClimb>(&text).unwrap(), AircraftClimb::default());
    assert!(toml::from_str::<AircraftClimb>("[flights]\nmas = 3").is_err());
    // Valid one by one, and too heavy to climb all the same: told, not a panic.
    let mut heavy = AircraftClimb::default();
    (heavy.flights.mass.mean, heavy.flights.mass.most) = (100_000.0, 100_000.0);
    heavy.terms.thrust.iter_mut().for_each(|term| term.coefficient *= 0.2);
    heavy.flights.mass.least = 100_000.0;
    let scenario = ClimbScenario::new(&heavy).unwrap();
    let end = scenario.run(Run { seconds: 4_000.0, seed: 1 }, &mut Kept::default()).unwrap();
    assert!(matches!(&end, End::Fault { reason, .. } if reason.contains("envelope")), "{end:?}");
}
