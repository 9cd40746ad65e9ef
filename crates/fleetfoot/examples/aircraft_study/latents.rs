//! Latents and derivatives of a flight at given coefficients.

use fleetfoot::{data::Block, sim::plant::aircraft::Latent};

use super::{Failure, fleet::index};

const GRAVITY: f64 = 9.806_65;

/// T, D, L (N) and Isp (m/s) along a flight.
pub(crate) type Latents = [Vec<f64>; 4];

/// Rows of a flight by name.
pub(crate) struct Rows<'a> {
    pub(crate) block: &'a Block,
    pub(crate) columns: &'a [fleetfoot::Column],
}

impl Rows<'_> {
    pub(crate) fn column(&self, name: &str) -> Result<&[f64], Failure> {
        Ok(self.block.core(index(self.columns, name)?))
    }

    /// The latents that the coefficients theta (45) say.
    pub(crate) fn latents(&self, theta: &[f64]) -> Result<Latents, Failure> {
        let mut first = 0;
        let mut latents = Latents::default();
        for (latent, values) in Latent::ALL.into_iter().zip(&mut latents) {
            let powers = latent.powers();
            let theta = &theta[first..first + powers.len()];
            first += powers.len();
            let [z1, z2, z3] = latent.variables();
            let (z1, z2, z3) = (self.column(z1)?, self.column(z2)?, self.column(z3)?);
            let at = |row: usize| {
                let term =
                    |(theta, [k, l]): (&f64, &[u32; 2])| theta * z2[row].powi(*k as i32) * z3[row].powi(*l as i32);
                z1[row] * theta.iter().zip(&powers).map(term).sum::<f64>()
            };
            *values = (0..self.block.rows).map(at).collect();
        }
        Ok(latents)
    }

    /// Mean squared errors of V', gamma' and m' (26)-(29) with these latents, beside the recorded derivatives.
    pub(crate) fn errors(&self, [thrust, drag, lift, impulse]: &Latents) -> Result<[f64; 3], Failure> {
        let [speed, path, mass, alpha] =
            [self.column("V")?, self.column("gamma")?, self.column("m")?, self.column("alpha")?];
        let measured = [self.column("V_dot")?, self.column("gamma_dot")?, self.column("m_dot")?];
        let mut sums = [0.0; 3];
        for row in 0..self.block.rows {
            let (sin, cos) = alpha[row].sin_cos();
            let rates = [
                (thrust[row] * cos - drag[row]) / mass[row] - GRAVITY * path[row].sin(),
                ((thrust[row] * sin + lift[row]) / mass[row] - GRAVITY * path[row].cos()) / speed[row],
                -thrust[row] / impulse[row],
            ];
            for k in 0..3 {
                sums[k] += (rates[k] - measured[k][row]).powi(2);
            }
        }
        Ok(sums.map(|sum| sum / self.block.rows.max(1) as f64))
    }
}
