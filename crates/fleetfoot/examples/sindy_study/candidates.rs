//! Libraries of the study: the same functions for fleetfoot and for the peer.

use fleetfoot::{
    data::mix,
    library::{Expr, Leaf, Library, Program, Scope, Scratch, Vocabulary},
};

use super::Failure;

/// Which functions are candidates.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Features {
    /// Highest total degree of the monomials, the constant among them; 0 for none at all.
    pub(crate) degree: u32,
    /// Whether there are the sine and the cosine of every variable.
    pub(crate) trigonometric: bool,
}

/// Candidate functions of some variables, with their values at a few states, by which two libraries are compared.
#[derive(Debug)]
pub(crate) struct Candidates {
    /// The constant, if it is a candidate, stands first and is not among these.
    pub(crate) functions: Vec<Expr>,
    pub(crate) constant: bool,
    /// States at which values are known.
    pub(crate) probe: Vec<Vec<f64>>,
    /// Of every such state: the values of all functions, the constant's first.
    pub(crate) values: Vec<Vec<f64>>,
}

/// States at which functions are told apart.
const PROBES: u64 = 6;

impl Candidates {
    pub(crate) fn new(variables: &[&str], features: Features) -> Result<Self, Failure> {
        let mut items = Vec::new();
        if features.degree > 0 {
            items.push(format!("poly({})", features.degree));
        }
        if features.trigonometric {
            items.push("fourier(1)".into());
        }
        let scope = Scope::new(variables);
        let columns: Vec<Expr> = variables.iter().map(|name| Expr::column(*name)).collect();
        let terms = Library::parse(&items, &Vocabulary { variables: &columns, scope: &scope })?;
        let at = |k: u64| {
            (0..variables.len() as u64).map(move |i| 0.3 + (mix(100 * k + i) >> 11) as f64 / (1_u64 << 53) as f64)
        };
        let probe: Vec<Vec<f64>> = (0..PROBES).map(|k| at(k).collect()).collect();
        let mut candidates = Self { functions: terms.functions, constant: terms.constant, probe, values: Vec::new() };
        let values = candidates.probe.iter().map(|state| candidates.evaluate(&candidates.functions, variables, state));
        let values: Vec<Vec<f64>> = values.collect::<Result<_, _>>()?;
        let first = candidates.constant.then_some(1.0);
        candidates.values = values.into_iter().map(|row| first.into_iter().chain(row).collect()).collect();
        Ok(candidates)
    }

    /// Number of candidates, the constant among them.
    pub(crate) fn len(&self) -> usize {
        usize::from(self.constant) + self.functions.len()
    }

    /// The coefficients of an equation that is known as a sum of functions, each of which must be a candidate.
    pub(crate) fn coefficients(&self, variables: &[&str], terms: &[(&str, f64)]) -> Result<Vec<f64>, Failure> {
        let scope = Scope::new(variables);
        let mut coefficients = vec![0.0; self.len()];
        for &(text, coefficient) in terms {
            let function = [Expr::parse(text, &scope)?];
            let of = |state: &Vec<f64>| Ok(self.evaluate(&function, variables, state)?[0]);
            let values: Vec<f64> = self.probe.iter().map(of).collect::<Result<_, Failure>>()?;
            let same = |j: &usize| self.values.iter().zip(&values).all(|(row, value)| (row[*j] - value).abs() < 1e-12);
            let j = (0..self.len()).find(same).ok_or_else(|| format!("{text} is no candidate"))?;
            coefficients[j] += coefficient;
        }
        Ok(coefficients)
    }

    fn evaluate(&self, functions: &[Expr], variables: &[&str], state: &[f64]) -> Result<Vec<f64>, Failure> {
        let program = Program::compile(functions, variables)?;
        let leaf = |leaf: &Leaf| match *leaf {
            Leaf::Column { column, .. } => state[column],
            Leaf::Time { .. } => 0.0,
        };
        let leaves: Vec<f64> = program.leaves().iter().map(leaf).collect();
        let mut out = vec![0.0; functions.len()];
        program.evaluate_row(&leaves, &mut out, &mut Scratch::default());
        Ok(out)
    }
}
