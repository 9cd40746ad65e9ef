//! The competitor of the block-sparse bolasso paper, equation (42), on the aircraft plant: 45 parameters of thrust, drag, lift and specific impulse,
//! the mass equation nonlinear in them.

use fleetfoot_data::{Halo, MemorySource, Silent, Source};
use fleetfoot_estimate::{Estimate, Options, Parameter, Residual, nonlinear_least_squares};
use fleetfoot_library::{Expr, Program, Scope};
use fleetfoot_sim::plant::aircraft::{AircraftClimb, Airplane, Flight, Latent};

fn expression(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).expect("a formula")
}

/// The latent's library with parameters `T0`, `T1`, ...
fn polynomial(latent: Latent) -> Expr {
    let terms = latent.features().into_iter().enumerate();
    terms
        .fold(Expr::number(0.0), |sum, (k, text)| sum + Expr::column(parameter(latent, k)) * expression(&text))
        .simplified()
}

fn parameter(latent: Latent, k: usize) -> String {
    format!(
        "{}{k}",
        match latent {
            Latent::Thrust => "c_T",
            Latent::Drag => "c_D",
            Latent::Lift => "c_L",
            Latent::SpecificImpulse => "c_I",
        }
    )
}

/// Parameters of a latent by linear least squares on its prior.
fn initial(latent: Latent, target: Expr, source: &MemorySource) -> Estimate {
    let parameters: Vec<Parameter> =
        (0..latent.features().len()).map(|k| Parameter::new(parameter(latent, k), 0.0)).collect();
    let residuals = [Residual::new(target, polynomial(latent))];
    let options = Options { radius: 1e12, ..Options::default() };
    nonlinear_least_squares(&residuals, &parameters, source, &options, &Silent).expect("a linear fit")
}

/// Values of an expression at all rows.
fn values(expr: &Expr, source: &MemorySource) -> Vec<f64> {
    let names: Vec<&str> = source.columns().iter().map(|column| column.name.as_str()).collect();
    let program = Program::compile(std::slice::from_ref(expr), &names).expect("columns");
    let mut all = Vec::new();
    for (episode, info) in source.episodes().iter().enumerate() {
        let block = source.read(episode, 0..info.rows, Halo::default()).expect("rows");
        let mut values = vec![0.0; info.rows];
        program.evaluate_block(&block, 0..info.rows, &mut values, info.rows, &mut Default::default());
        all.extend(values);
    }
    all
}

#[test]
fn exact_flights_leave_no_residual_and_give_back_the_latents() {
    let airplane = Airplane::new(&AircraftClimb::default()).expect("an airplane");
    let mut source = MemorySource::new(Flight::columns());
    (0..4).for_each(|number| airplane.flight(number).append_to(&mut source));

    // Specific impulse by a textbook formula (Mattingly), which is off by some per cent; thrust, drag and lift by linear least squares from it.
    let prior = expression("9.80665*3600/((0.334 + 0.44*M)*sqrt(SAT/288.15))");
    let impulse = initial(Latent::SpecificImpulse, prior.clone(), &source);
    let thrust = initial(Latent::Thrust, (-expression("m_dot")) * prior, &source);
    let believed = thrust.insert(&polynomial(Latent::Thrust));
    let drag = believed.clone() * expression("cos(alpha)") - expression("m*V_dot + m*9.80665*sin(gamma)");
    let lift = expression("m*V*gamma_dot + m*9.80665*cos(gamma)") - believed * expression("sin(alpha)");
    let starts = [thrust, initial(Latent::Drag, drag, &source), initial(Latent::Lift, lift, &source), impulse];

    let [t, d, l, isp] = Latent::ALL.map(polynomial);
    let along = (t.clone() * expression("cos(alpha)") - d) / expression("m") - expression("9.80665*sin(gamma)");
    let across = (t.clone() * expression("sin(alpha)") + l) / expression("m*V") - expression("9.80665*cos(gamma)/V");
    // One over the square of the targets' sizes.
    let residuals = [
        Residual::new(expression("V_dot"), along).weighted(10.0),
        Residual::new(expression("gamma_dot"), across).weighted(1e6),
        Residual::new(expression("m_dot"), -t / isp).weighted(1.0),
    ];
    let parameters: Vec<Parameter> = starts
        .iter()
        .flat_map(|start| {
            start.names.iter().zip(&start.values).map(|(name, value)| Parameter::new(name.as_str(), *value))
        })
        .collect();
    assert_eq!(parameters.len(), 45);
    let estimate =
        nonlinear_least_squares(&residuals, &parameters, &source, &Options::default(), &Silent).expect("an estimate");
    println!(
        "{} rows, {:?} after {} steps, cost {:e}, condition {:.1e}, undetermined {:?}",
        estimate.rows, estimate.status, estimate.iterations, estimate.cost, estimate.condition, estimate.undetermined
    );
    assert!(estimate.status.converged());
    assert!((estimate.cost / (3 * estimate.rows) as f64).sqrt() < 1e-10, "{:e}", estimate.cost);
    for latent in Latent::ALL {
        let truth = values(&Expr::column(latent.name()), &source);
        let estimate = values(&estimate.insert(&polynomial(latent)), &source);
        let start = values(
            &starts[Latent::ALL.iter().position(|other| *other == latent).expect("one of four")]
                .insert(&polynomial(latent)),
            &source,
        );
        let worst = |values: &[f64]| truth.iter().zip(values).map(|(a, b)| (b / a - 1.0).abs()).fold(0.0, f64::max);
        println!("{latent:?}: at most {:.1e} off, {:.1e} at the start", worst(&estimate), worst(&start));
        assert!(worst(&estimate) < 1e-6 && worst(&start) > 1e-4, "{latent:?}: {:e}", worst(&estimate));
    }
}
