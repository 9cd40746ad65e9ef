//! Friction and stiffness of touching surfaces.

use serde::{Deserialize, Serialize};

use crate::parameter_error::{ParameterError, in_range, not_negative, positive};

/// Friction and stiffness of contacts.
///
/// A contact is a spring and damper on the effective mass of the touching bodies, implicit in time; Coulomb friction
/// acts at every point.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Contact {
    /// Coulomb coefficient, the same when it sticks and when it slips, 1.
    pub friction: f64,
    /// Stiffness against penetration: undamped natural frequency of a contact, Hz.
    ///
    /// A foot of 0.3 g under a tenth of a newton sinks in by some 10 micrometres at the default.
    pub natural_frequency: f64,
    /// Of the contact spring, 1. Well above 1: feet do not bounce.
    pub damping_ratio: f64,
}

impl Default for Contact {
    fn default() -> Self {
        Self { friction: 1.0, natural_frequency: 500.0, damping_ratio: 5.0 }
    }
}

impl Contact {
    /// Checks every value.
    ///
    /// # Errors
    /// Names the parameter, its value and what is allowed.
    pub fn validate(&self) -> Result<(), ParameterError> {
        not_negative("friction", self.friction)?;
        positive("natural_frequency", self.natural_frequency)?;
        in_range("damping_ratio", self.damping_ratio, 0.1, 100.0, "from 0.1 to 100")
    }
}
