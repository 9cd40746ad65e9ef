//! The climbs of one aircraft: equations (32) to (34), 45 functions, exact derivatives.

use fleetfoot_data::{MemorySource, Silent};
use fleetfoot_library::{Expr, Scope};
use fleetfoot_sim::plant::aircraft::{AircraftClimb, Airplane, Flight, Latent};
use fleetfoot_sparse::structured::Assembly;
use fleetfoot_sums::structured::{Banks, Candidates, Plan, Regression, Structure, Task, Term};

pub(crate) struct Climbs {
    pub(crate) source: MemorySource,
    pub(crate) regression: Regression,
    pub(crate) structure: Structure,
    pub(crate) assembly: Assembly,
    pub(crate) truth: Vec<f64>,
    /// Mean square of what the true coefficients leave, weighted like the objective.
    pub(crate) unexplained: f64,
}

fn expr(text: &str) -> Expr {
    Expr::parse(text, &Scope::open()).expect("an expression")
}

fn task(name: &str, target: &str, terms: &[(usize, &str)]) -> Task {
    let terms = terms.iter().map(|&(latent, text)| Term { latent, coefficient: expr(text) }).collect();
    Task { name: name.into(), target: expr(target), terms, prior: false }
}

fn regression() -> Regression {
    let candidates = |latent: Latent| Candidates {
        name: latent.name().into(),
        functions: latent.features().iter().map(|text| expr(text)).collect(),
    };
    Regression {
        latents: Latent::ALL.map(candidates).to_vec(),
        tasks: vec![
            task("along", "m*V_dot + m*9.80665*sin(gamma)", &[(0, "cos(alpha)"), (1, "-1")]),
            task("normal", "m*V*gamma_dot + m*9.80665*cos(gamma)", &[(0, "sin(alpha)"), (2, "1")]),
            task("fuel", "0", &[(0, "1"), (3, "m_dot")]),
        ],
        weight: None,
    }
}

/// Flights of one aircraft; all equations count alike, in units of 100 kN.
pub(crate) fn climbs(flights: u32, turbulence: bool) -> Climbs {
    let mut parameters = AircraftClimb { aircraft: 3, ..AircraftClimb::default() };
    let deviation = if turbulence { 0.05 } else { 0.0 };
    parameters.turbulence.longitudinal = deviation;
    parameters.turbulence.normal = deviation;
    let airplane = Airplane::new(&parameters).expect("valid");
    let mut source = MemorySource::new(Flight::columns());
    let (mut squares, mut rows) = (0.0, 0.0);
    for number in 0..flights {
        let flight = airplane.flight(number);
        let column = |name: &str| flight.column(name).expect("a column").to_vec();
        let (mass, along, normal) = (column("m"), column("eps_V"), column("eps_gamma"));
        squares += (0..mass.len()).map(|i| (mass[i] * along[i]).powi(2) + (mass[i] * normal[i]).powi(2)).sum::<f64>();
        rows += mass.len() as f64;
        flight.append_to(&mut source);
    }
    let regression = regression();
    Climbs {
        source,
        structure: regression.structure(),
        regression,
        assembly: Assembly { weights: vec![1e-10; 3], ..Assembly::default() },
        truth: Latent::ALL.iter().flat_map(|&latent| airplane.terms().coefficients(latent)).collect(),
        unexplained: 1e-10 * squares / rows,
    }
}

impl Climbs {
    pub(crate) fn banks(&self, chunk_rows: usize) -> Banks {
        let plan = Plan::new(self.regression.clone(), Vec::new(), chunk_rows, &self.source).expect("a plan");
        Banks::new(&plan.scan(&self.source, &Silent).expect("a scan"), |_| true)
    }
}
