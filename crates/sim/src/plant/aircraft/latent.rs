//! The four unknown functions of the flight mechanics and their candidate features.

use serde::{Deserialize, Serialize};

/// A function that no instrument measures: equations (26)-(31) of the block-sparse bolasso paper.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Latent {
    /// Total thrust T, N, of (N1, rho, M).
    Thrust,
    /// Drag D, N, of (q, alpha, M).
    Drag,
    /// Lift L, N, of (q, alpha, M).
    Lift,
    /// Specific impulse Isp, thrust over mass flow, m/s, of (SAT, h, M).
    SpecificImpulse,
}

impl Latent {
    /// In the order of the paper's parameter vector.
    pub const ALL: [Latent; 4] = [Latent::Thrust, Latent::Drag, Latent::Lift, Latent::SpecificImpulse];

    /// The name of its column of truth.
    pub fn name(self) -> &'static str {
        match self {
            Latent::Thrust => "T",
            Latent::Drag => "D",
            Latent::Lift => "L",
            Latent::SpecificImpulse => "Isp",
        }
    }

    /// z1, z2, z3 of the feature map: columns that it depends on (30).
    pub fn variables(self) -> [&'static str; 3] {
        match self {
            Latent::Thrust => ["N1", "rho", "M"],
            Latent::Drag | Latent::Lift => ["q", "alpha", "M"],
            Latent::SpecificImpulse => ["SAT", "h", "M"],
        }
    }

    /// The degree d of its polynomial: 4 for the thrust, 3 for the others (section 9.1).
    pub fn degree(self) -> u32 {
        if self == Latent::Thrust { 4 } else { 3 }
    }

    /// The powers (k, j - k) of (z2, z3) in the order of the feature map `z1 z2^k z3^(j-k)`, j = 0..=d, k = 0..=j:
    /// 15 features for the thrust, 10 for each of the others, 45 together.
    pub fn powers(self) -> Vec<[u32; 2]> {
        (0..=self.degree()).flat_map(|j| (0..=j).map(move |k| [k, j - k])).collect()
    }

    /// The features as formulas of columns, e.g. `N1*rho^2*M`, in the order of [`Self::powers`].
    pub fn features(self) -> Vec<String> {
        let [first, second, third] = self.variables();
        let power = |name: &str, n: u32| match n {
            0 => String::new(),
            1 => format!("*{name}"),
            _ => format!("*{name}^{n}"),
        };
        self.powers().iter().map(|&[k, l]| format!("{first}{}{}", power(second, k), power(third, l))).collect()
    }
}

/// One term of a latent function: `coefficient z1 z2^powers[0] z3^powers[1]`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Term {
    /// Of z2 and z3.
    pub powers: [u32; 2],
    /// In SI units of the function over those of the feature.
    pub coefficient: f64,
}

/// The true terms of the four functions; everything else is zero. At most the degree that [`Latent::degree`] says.
///
/// The defaults are a twin-engine narrow-body jet (122.6 m^2, span 34.1 m), fitted by best subset least squares over
/// the envelope of climbs from 5,000 ft to 39,000 ft at 250-325 kt and Mach 0.75-0.79 to textbook models:
///
/// - thrust: 2 x 120.1 kN at sea level, times the lapse of a high-bypass turbofan below its throttle break,
///   `delta_0 (1 - 0.49 sqrt(M))` (Mattingly, Heiser, Pratt: Aircraft Engine Design, 2nd ed.), delta_0 the ratio of
///   stagnation pressures, reached at N1 = 0.9: 0.5 %;
/// - lift: slope of a swept wing by the Helmbold-DATCOM formula (aspect ratio 9.5, 22 degrees at mid-chord, section
///   efficiency 0.95) with Prandtl-Glauert's correction, zero lift at -0.045 rad: 0.3 %;
/// - drag: the polar 0.0185 + 0.039 CL^2 and Lock's wave drag beyond Korn's critical Mach number: 0.7 %;
/// - specific impulse: consumption (0.334 + 0.44 M) sqrt(theta) lb/(lbf h), which joins the sea-level and cruise
///   values of engines of this class: 0.4 % on the standard day.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Terms {
    /// T / N1, powers of rho (kg/m^3) and M.
    pub thrust: Vec<Term>,
    /// D / q, powers of alpha (rad) and M; m^2.
    pub drag: Vec<Term>,
    /// L / q, powers of alpha (rad) and M; m^2.
    pub lift: Vec<Term>,
    /// Isp / SAT, powers of h (m) and M; m/(s K).
    pub specific_impulse: Vec<Term>,
}

impl Default for Terms {
    fn default() -> Self {
        let terms = |list: &[([u32; 2], f64)]| {
            list.iter().map(|&(powers, coefficient)| Term { powers, coefficient }).collect::<Vec<_>>()
        };
        Self {
            thrust: terms(&[([1, 0], 127_700.0), ([3, 0], 23_700.0), ([2, 2], 47_200.0)]),
            drag: terms(&[([0, 0], 2.582), ([2, 0], 174.6), ([1, 2], 28.63)]),
            lift: terms(&[([0, 0], 25.0), ([1, 0], 559.7), ([0, 3], 18.95), ([1, 2], 301.8)]),
            specific_impulse: terms(&[([0, 0], 277.0), ([0, 2], -211.5), ([1, 1], 0.0150)]),
        }
    }
}

impl Terms {
    /// The terms of one function.
    pub fn of(&self, latent: Latent) -> &[Term] {
        match latent {
            Latent::Thrust => &self.thrust,
            Latent::Drag => &self.drag,
            Latent::Lift => &self.lift,
            Latent::SpecificImpulse => &self.specific_impulse,
        }
    }

    /// The terms of one function, to change.
    pub fn of_mut(&mut self, latent: Latent) -> &mut Vec<Term> {
        match latent {
            Latent::Thrust => &mut self.thrust,
            Latent::Drag => &mut self.drag,
            Latent::Lift => &mut self.lift,
            Latent::SpecificImpulse => &mut self.specific_impulse,
        }
    }

    /// All coefficients of one function in the order of [`Latent::features`], zeros where there is no term.
    pub fn coefficients(&self, latent: Latent) -> Vec<f64> {
        let sum = |powers: &[u32; 2]| {
            self.of(latent).iter().filter(|term| term.powers == *powers).map(|term| term.coefficient).sum()
        };
        latent.powers().iter().map(sum).collect()
    }

    /// One function at (z1, z2, z3).
    #[inline]
    pub fn value(&self, latent: Latent, [first, second, third]: [f64; 3]) -> f64 {
        let powers = |z: f64| [1.0, z, z * z, z * z * z, (z * z) * (z * z)];
        let (second, third) = (powers(second), powers(third));
        let term = |term: &Term| term.coefficient * second[term.powers[0] as usize] * third[term.powers[1] as usize];
        first * self.of(latent).iter().map(term).sum::<f64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forty_five_features_in_the_order_of_the_map() {
        let count: usize = Latent::ALL.iter().map(|latent| latent.features().len()).sum();
        assert_eq!(count, 45);
        let drag = ["q", "q*M", "q*alpha", "q*M^2", "q*alpha*M", "q*alpha^2", "q*M^3", "q*alpha*M^2", "q*alpha^2*M"];
        assert_eq!(Latent::Drag.features()[..9], drag);
        assert_eq!(Latent::Thrust.features()[14], "N1*rho^4");
    }

    #[test]
    fn the_terms_are_the_dense_polynomial() {
        let terms = Terms::default();
        let z = [0.9f64, 0.6, 0.7];
        for latent in Latent::ALL {
            let dense: f64 = latent
                .powers()
                .iter()
                .zip(terms.coefficients(latent))
                .map(|(&[k, l], c)| c * z[0] * z[1].powi(k as i32) * z[2].powi(l as i32))
                .sum();
            assert!((terms.value(latent, z) / dense - 1.0).abs() < 1e-13);
            let support = terms.coefficients(latent).iter().filter(|&&c| c != 0.0).count();
            assert_eq!(support, terms.of(latent).len());
        }
    }
}
