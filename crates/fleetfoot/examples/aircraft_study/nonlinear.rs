//! The paper's competitor: the equations of motion themselves, nonlinear in the parameters through m' = -T/Isp, by least squares (42).

use fleetfoot::{
    Episode, Halo, Silent, Source,
    data::{Block, Column, Error, MemorySource},
    estimate::{Estimate, Options, Parameter, Residual, nonlinear_least_squares},
    library::{Expr, Scope},
    sim::plant::aircraft::Latent,
};

use super::Failure;

/// Estimates the 45 parameters from all rows; `initial` is where the iteration begins.
pub(crate) fn fit(source: &dyn Source, initial: &[f64], variances: [f64; 3]) -> Result<Estimate, Failure> {
    let parse = |text: &str| Ok::<_, Failure>(Expr::parse(text, &Scope::open())?);
    let mut parameters = Vec::new();
    let mut sums = Vec::new();
    for latent in Latent::ALL {
        let mut terms = Vec::new();
        for (k, feature) in latent.features().iter().enumerate() {
            let name = format!("theta_{}_{k}", latent.name());
            terms.push(format!("{name}*{feature}"));
            parameters.push(Parameter::new(name, initial[parameters.len()]));
        }
        sums.push(format!("({})", terms.join(" + ")));
    }
    let [thrust, drag, lift, impulse] = &sums[..] else { return Err("four latents".into()) };
    let models = [
        ("V_dot", format!("({thrust}*cos(alpha) - {drag})/m - 9.80665*sin(gamma)")),
        ("gamma_dot", format!("({thrust}*sin(alpha) + {lift})/(m*V) - 9.80665*cos(gamma)/V")),
        ("m_dot", format!("-{thrust}/{impulse}")),
    ];
    let residuals = models.iter().zip(variances).map(|((target, model), variance)| {
        Ok::<_, Failure>(Residual::new(parse(target)?, parse(model)?).weighted(1.0 / variance))
    });
    let residuals = residuals.collect::<Result<Vec<_>, _>>()?;
    let options = Options { max_iterations: 100, ..Options::default() };
    Ok(nonlinear_least_squares(&residuals, &parameters, source, &options, &Silent)?)
}

/// All flights but one.
pub(crate) struct Without<'a> {
    source: &'a MemorySource,
    left_out: usize,
    episodes: Vec<Episode>,
}

impl<'a> Without<'a> {
    pub(crate) fn new(source: &'a MemorySource, left_out: usize) -> Self {
        let mut episodes = source.episodes().to_vec();
        episodes.remove(left_out);
        Self { source, left_out, episodes }
    }
}

impl Source for Without<'_> {
    fn columns(&self) -> &[Column] {
        self.source.columns()
    }

    fn episodes(&self) -> &[Episode] {
        &self.episodes
    }

    fn read(&self, episode: usize, rows: std::ops::Range<usize>, halo: Halo) -> Result<Block, Error> {
        self.source.read(episode + usize::from(episode >= self.left_out), rows, halo)
    }
}
