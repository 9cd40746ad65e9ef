//! The affine map that makes the base columns centred, uncorrelated and of one size on the pilot sample.

use super::double::Double;

/// `v_k = (x_k - centre_k - sum_{l<k} slope_kl v_l) * scale_k`: forward substitution with a triangular whitening.
///
/// Polynomials of total degree D stay polynomials of total degree D under it. Solving with the triangle instead of multiplying by its
/// inverse keeps the rounding of nearly collinear columns at that of the data.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct AffineMap {
    pub(super) centre: Vec<f64>,
    /// Row k holds `slope_kl`, l < k, at `k (k - 1) / 2 + l`.
    slopes: Vec<f64>,
    pub(super) scale: Vec<f64>,
}

/// A column whose part outside the span of the earlier ones is smaller than this share of its size is left as it is:
/// what remains of it is rounding, and no scale could make it a variable of its own.
const COLLINEAR: f64 = 1e-12;

impl AffineMap {
    /// The map with unit standard deviations on the pilot: modified Gram-Schmidt, each projection done twice.
    pub(super) fn from_pilot(base: &[&[f64]]) -> Self {
        let rows = base.first().map_or(0, |column| column.len()) as f64;
        let mut map = Self { centre: Vec::new(), slopes: Vec::new(), scale: Vec::new() };
        let mut whitened: Vec<Vec<f64>> = Vec::new();
        for column in base {
            let rough = column.iter().sum::<f64>() / rows;
            let centre = rough + column.iter().map(|x| x - rough).sum::<f64>() / rows;
            let mut rest: Vec<f64> = column.iter().map(|x| x - centre).collect();
            let spread = (rest.iter().map(|r| r * r).sum::<f64>() / rows).sqrt();
            let mut slopes = vec![0.0; whitened.len()];
            for _ in 0..2 {
                for (slope, v) in slopes.iter_mut().zip(&whitened) {
                    let size: f64 = v.iter().map(|v| v * v).sum();
                    let step =
                        if size > 0.0 { v.iter().zip(&rest).map(|(v, r)| v * r).sum::<f64>() / size } else { 0.0 };
                    *slope += step;
                    rest.iter_mut().zip(v).for_each(|(r, v)| *r -= step * v);
                }
            }
            let mut deviation = (rest.iter().map(|r| r * r).sum::<f64>() / rows).sqrt();
            if deviation <= COLLINEAR * spread || deviation.is_nan() {
                slopes.fill(0.0);
                rest = column.iter().map(|x| x - centre).collect();
                deviation = spread;
            }
            // A constant column: any scale will do, the size of its values suits later rows that may vary.
            if deviation <= f64::EPSILON * centre.abs() || deviation < f64::MIN_POSITIVE {
                deviation = if centre.abs() > f64::MIN_POSITIVE { centre.abs() } else { 1.0 };
            }
            let scale = 1.0 / deviation;
            rest.iter_mut().for_each(|r| *r *= scale);
            whitened.push(rest);
            map.centre.push(centre);
            map.slopes.extend(slopes);
            map.scale.push(scale);
        }
        map
    }

    /// The same map with the variables divided by `unit`.
    pub(super) fn in_units_of(&self, unit: f64) -> Self {
        Self {
            centre: self.centre.clone(),
            slopes: self.slopes.iter().map(|slope| slope * unit).collect(),
            scale: self.scale.iter().map(|scale| scale / unit).collect(),
        }
    }

    pub(super) fn variables(&self) -> usize {
        self.centre.len()
    }

    /// All numbers of the map.
    pub(super) fn values(&self) -> impl Iterator<Item = &f64> {
        self.centre.iter().chain(&self.slopes).chain(&self.scale)
    }

    /// The map of [`AffineMap::values`], which are as many as `variables` ask for.
    pub(super) fn of_values(values: &[f64], variables: usize) -> Self {
        let (centre, rest) = values.split_at(variables);
        let (slopes, scale) = rest.split_at(rest.len() - variables);
        Self { centre: centre.to_vec(), slopes: slopes.to_vec(), scale: scale.to_vec() }
    }

    /// `slope_kl` for all l < k.
    pub(super) fn slopes(&self, k: usize) -> &[f64] {
        &self.slopes[k * k.saturating_sub(1) / 2..][..k]
    }

    /// Maps one row in place.
    pub(super) fn apply(&self, row: &mut [f64]) {
        for k in 0..row.len() {
            let (done, rest) = row.split_at_mut(k);
            let along: f64 = self.slopes(k).iter().zip(done.iter()).map(|(slope, v)| slope * v).sum();
            rest[0] = (rest[0] - self.centre[k] - along) * self.scale[k];
        }
    }

    /// `v_k` as affine forms of x: for each k the constant, then the factors of x_0 ..= x_{m-1}.
    pub(super) fn forward_forms(&self) -> Vec<Vec<Double>> {
        let m = self.variables();
        let mut forms: Vec<Vec<Double>> = Vec::with_capacity(m);
        for k in 0..m {
            let mut form = vec![Double::default(); m + 1];
            form[0] = -Double::from(self.centre[k]);
            form[1 + k] = Double::from(1.0);
            for (l, &slope) in self.slopes(k).iter().enumerate() {
                for (target, &other) in form.iter_mut().zip(&forms[l]) {
                    *target = *target - Double::from(slope) * other;
                }
            }
            form.iter_mut().for_each(|value| *value = *value * Double::from(self.scale[k]));
            forms.push(form);
        }
        forms
    }

    /// `x_k` as affine forms of v, in the same layout.
    pub(super) fn inverse_forms(&self) -> Vec<Vec<Double>> {
        let m = self.variables();
        (0..m)
            .map(|k| {
                let mut form = vec![Double::default(); m + 1];
                form[0] = Double::from(self.centre[k]);
                self.slopes(k).iter().enumerate().for_each(|(l, &slope)| form[1 + l] = Double::from(slope));
                form[1 + k] = Double::reciprocal(self.scale[k]);
                form
            })
            .collect()
    }
}
