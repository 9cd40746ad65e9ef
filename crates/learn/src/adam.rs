//! Adam (Kingma and Ba, "Adam: a method for stochastic optimization", ICLR 2015), algorithm 1.

const BETA: [f64; 2] = [0.9, 0.999];
const SMALL: f64 = 1e-8;

/// First and second moments of the gradient.
pub(crate) struct Adam {
    moments: Vec<[f64; 2]>,
    steps: i32,
}

impl Adam {
    pub(crate) fn new(count: usize) -> Self {
        Self { moments: vec![[0.0; 2]; count], steps: 0 }
    }

    /// One step along the gradient, whose parts come in the order of the values.
    pub(crate) fn step<'a>(
        &mut self,
        rate: f64,
        values: impl Iterator<Item = &'a mut f64>,
        gradient: impl Iterator<Item = f64>,
    ) {
        self.steps += 1;
        let [first, second] = BETA.map(|beta| 1.0 - beta.powi(self.steps));
        for ((value, slope), [m, v]) in values.zip(gradient).zip(&mut self.moments) {
            *m = BETA[0] * *m + (1.0 - BETA[0]) * slope;
            *v = BETA[1] * *v + (1.0 - BETA[1]) * slope * slope;
            *value -= rate * (*m / first) / ((*v / second).sqrt() + SMALL);
        }
    }
}
