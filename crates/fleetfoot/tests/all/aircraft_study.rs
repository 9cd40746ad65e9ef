//! The aircraft study at a small scale: the points of the block-sparse bolasso paper's Figures 2, 3 and 5.

#[path = "../../examples/aircraft_study/main.rs"]
#[allow(dead_code, reason = "the study's command has parts that its test does not call")]
mod study;

use clap::Parser;
use fleetfoot::{Source, data::MemorySource, sim::plant::aircraft::Airplane};
use study::{Arguments, errors, fleet, hidden, selection};

/// Columns of the latents among the 45 coefficients.
const THRUST: std::ops::Range<usize> = 0..15;
const FORCES: std::ops::Range<usize> = 0..35;

fn arguments(flights: u32) -> Arguments {
    Arguments::parse_from(["aircraft_study", "--flights", &flights.to_string()])
}

fn noise(arguments: &Arguments) -> fleet::Noise {
    fleet::Noise { turbulence: arguments.turbulence, fuel: arguments.fuel_noise, seed: arguments.seed }
}

fn recorded(number: u32, arguments: &Arguments) -> (Airplane, MemorySource, selection::Scan) {
    let airplane = fleet::airplane(number, noise(arguments)).expect("an aircraft");
    let source = fleet::flights(&airplane, arguments.flights, noise(arguments)).expect("flights");
    let scan = selection::Scan::new(&source).expect("a scan");
    (airplane, source, scan)
}

/// Figure 2: at 0.02 m/s^2 of turbulence and 3 % of error in the mass flow, what is selected for one aircraft is selected for the others, and has the true functions
/// of thrust, drag and lift or rebuilds them.
#[test]
fn aircraft_of_a_type_have_the_same_structure() {
    let arguments = arguments(120);
    let mut counts = [0usize; 45];
    let fleet = 3;
    for number in 0..fleet {
        let (airplane, source, scan) = recorded(number, &arguments);
        let structure = selection::select(&airplane, &source, &scan, &arguments).expect("a selection");
        assert!(structure.selection.worst_kkt < 1e-8 && structure.selection.unconverged == 0);
        structure.selection.support.iter().for_each(|&j| counts[j] += 1);
        for &(j, left) in structure.missed.iter().filter(|(j, _)| FORCES.contains(j)) {
            assert!(left < 0.05, "aircraft {number} misses column {j}, of which {left} is left");
        }
        // The selected model predicts as well as the true one: what is left of V' is the turbulence.
        let left = errors::leave_one_out(&source, &scan, &structure, arguments.lambda_t, 0).expect("errors");
        let mut speed: Vec<f64> = left.flights.iter().map(|flight| flight.bolasso[0]).collect();
        let ratio = hidden::median(&mut speed).sqrt() / arguments.turbulence;
        assert!((0.9..1.15).contains(&ratio), "{ratio}");
    }
    let agreed = FORCES.filter(|&j| [0, fleet as usize].contains(&counts[j])).count();
    assert!(agreed >= 26, "{agreed} of 35 functions of the forces: {counts:?}");
    assert!(counts[THRUST].iter().filter(|&&count| count > 0).count() <= 8, "{counts:?}");
}

/// Figure 5: without a prior the noise of the mass flow pulls thrust and specific impulse towards zero, and drag below it; the prior of the specific impulse brings all to
/// the right size, and so does no constraint on drag, which only keeps its sign.
#[test]
fn one_prior_scales_all_latents() {
    let arguments = arguments(40);
    let (_, source, scan) = recorded(0, &arguments);
    let estimates =
        hidden::estimate(&source, &scan, &[0.0, 1000.0], source.episodes().len() / 2, &arguments).expect("latents");
    let [without, constrained, with, nonlinear] = &estimates[..] else {
        panic!("four methods, not {}", estimates.len())
    };
    assert!(without.over_true[0] < 0.75 && without.over_true[3] < 0.75, "{:?}", without.over_true);
    assert!(without.negative_drag * 20 > without.rows, "{} rows", without.negative_drag);
    assert_eq!(constrained.negative_drag, 0, "of {} rows", constrained.rows);
    assert_eq!(with.negative_drag, 0, "of {} rows", with.rows);
    // The prior is 3 % too high.
    assert!(with.over_true.iter().all(|ratio| (0.97..1.05).contains(ratio)), "{:?}", with.over_true);
    // Lift, which nothing is confounded with, is right whatever the prior.
    assert!(estimates.iter().all(|hidden| (hidden.over_true[2] - 1.0).abs() < 0.003));
    // The mass flow is on the left side there: its noise biases nothing.
    assert!((nonlinear.over_true[0] - 1.0).abs() < 0.03, "{:?}", nonlinear.over_true);
    // The derivatives hardly tell the methods apart.
    assert!(without.errors[0] < 1.6 * with.errors[0], "{:?} {:?}", without.errors, with.errors);
}
