//! Gaussian radial functions around given centres.

use fleetfoot_library::Expr;

use crate::map_array::MapArray;

/// Radial functions of some functions x of a library: `phi_k(x) = exp(-sum_i ((x_i - c_ki)/s_i)^2 / (2 w^2))`.
///
/// Centres are in the units of x, the width w in scales s (Broomhead and Lowe, "Multivariable functional interpolation and adaptive networks", Complex Systems 1988).
#[derive(Debug, Clone, PartialEq)]
pub struct Gaussian {
    /// Indices of the functions x in the library.
    pub inputs: Vec<usize>,
    /// One row a radial function.
    pub centres: Vec<Vec<f64>>,
    /// Scale of each input.
    pub scale: Vec<f64>,
    /// Width of all.
    pub width: f64,
}

impl Gaussian {
    /// The name of one in text for people: `radial1`.
    pub fn name(index: usize) -> String {
        format!("radial{}", index + 1)
    }

    /// Number of radial functions.
    pub fn count(&self) -> usize {
        self.centres.len()
    }

    /// The factor in front of the squared distance: `1/(2 w^2)`.
    pub fn factor(&self) -> f64 {
        0.5 / (self.width * self.width)
    }

    /// Their values.
    #[inline(always)]
    pub fn evaluate(&self, inputs: &[f64], values: &mut [f64]) {
        let factor = self.factor();
        for (value, centre) in values.iter_mut().zip(&self.centres) {
            *value = (-factor * self.square(inputs, centre)).exp();
        }
    }

    #[inline(always)]
    fn square(&self, inputs: &[f64], centre: &[f64]) -> f64 {
        let parts = inputs.iter().zip(centre).zip(&self.scale);
        parts.fold(0.0, |sum, ((x, c), s)| {
            let part = (x - c) / s;
            sum + part * part
        })
    }

    /// Reverse product: adds `sum_k weights_k dphi_k/dx_i` to the slope of every input; `values` are those at `inputs`.
    pub fn gradient(&self, inputs: &[f64], values: &[f64], weights: &[f64], slopes: &mut [f64]) {
        let factor = 2.0 * self.factor();
        for ((value, weight), centre) in values.iter().zip(weights).zip(&self.centres) {
            let slope = -factor * value * weight;
            for (((to, x), c), s) in slopes.iter_mut().zip(inputs).zip(centre).zip(&self.scale) {
                *to += slope * ((x - c) / s) / s;
            }
        }
    }

    /// Forward product: how the values change where the inputs change by `change`.
    pub fn tangent(&self, inputs: &[f64], values: &[f64], change: &[f64], out: &mut [f64]) {
        let factor = 2.0 * self.factor();
        for ((out, value), centre) in out.iter_mut().zip(values).zip(&self.centres) {
            let parts = inputs.iter().zip(centre).zip(&self.scale).zip(change);
            let along: f64 = parts.map(|(((x, c), s), d)| ((x - c) / s) * (d / s)).sum();
            *out = -factor * value * along;
        }
    }

    /// One of them as an expression of its inputs.
    pub fn expression(&self, index: usize, inputs: &[Expr]) -> Expr {
        let parts = inputs.iter().zip(&self.centres[index]).zip(&self.scale);
        let square = |((x, &c), &s): ((&Expr, &f64), &f64)| ((x - Expr::number(c)) / Expr::number(s)).powi(2);
        let sum = parts.map(square).reduce(|sum, part| sum + part).unwrap_or_else(|| Expr::number(0.0));
        (Expr::number(-self.factor()) * sum).exp()
    }

    /// Its numbers for a file of arrays.
    pub fn arrays(&self) -> Vec<MapArray> {
        let (count, inputs) = (self.count(), self.inputs.len());
        let array =
            |name: &'static str, values: Vec<f64>, shape: Vec<usize>| MapArray { name: name.into(), values, shape };
        vec![
            array("inputs", self.inputs.iter().map(|&input| input as f64).collect(), vec![inputs]),
            array("centres", self.centres.iter().flatten().copied().collect(), vec![count, inputs]),
            array("scale", self.scale.clone(), vec![inputs]),
            array("width", vec![self.width], vec![1]),
        ]
    }

    /// Checks that the parts fit together, and to a library of so many functions.
    ///
    /// # Errors
    /// The contradiction, in words.
    pub fn check(&self, functions: usize) -> Result<(), String> {
        let inputs = self.inputs.len();
        if inputs == 0 || self.inputs.iter().any(|&input| input >= functions) {
            return Err(format!("radial functions of functions that the library does not have ({functions})"));
        }
        if self.scale.len() != inputs || self.centres.iter().any(|centre| centre.len() != inputs) {
            return Err(format!("{inputs} inputs of radial functions, {} scales", self.scale.len()));
        }
        let positive = |value: &f64| value.is_finite() && *value > 0.0;
        if !(positive(&self.width) && self.scale.iter().all(positive)) {
            return Err("the width or a scale of radial functions is not positive".into());
        }
        match self.centres.iter().flatten().all(|value| value.is_finite()) {
            true => Ok(()),
            false => Err("a centre of a radial function is not finite".into()),
        }
    }
}
