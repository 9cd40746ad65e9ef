//! Ports, at which a model exchanges energy with its surroundings.

/// A port, at which a model exchanges energy.
#[derive(Debug, Clone, PartialEq)]
pub struct Port {
    /// The input.
    pub input: String,
    /// The state by which it is multiplied to be a power.
    pub output: String,
    /// E of the port, in units of the state over those of the input; `None`: twice the discretisation error of the
    /// one-region model.
    pub shortage: Option<f64>,
}

impl Port {
    /// With the shortage that sampling asks for.
    pub fn new(input: impl Into<String>, output: impl Into<String>) -> Self {
        Self { input: input.into(), output: output.into(), shortage: None }
    }
}
