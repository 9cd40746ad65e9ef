//! Units in which the numbers of a joint are near one.

use super::Quantity;

/// Units of time and position, and the origin of positions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    /// Seconds a unit of time: the median period of the sensor that reads most often.
    pub(super) unit: f64,
    /// A position in the middle of all.
    pub(super) centre: f64,
    /// Positions a unit of position.
    pub(super) size: f64,
}

impl Scale {
    /// A reading in these units.
    pub(super) fn of(&self, quantity: Quantity, value: f64) -> f64 {
        match quantity {
            Quantity::Position => (value - self.centre) / self.size,
            Quantity::Rate => value * self.unit / self.size,
        }
    }

    /// A deviation, a step or a bias in these units.
    pub(super) fn scaled(&self, quantity: Quantity, value: f64) -> f64 {
        value / self.back(quantity)
    }

    /// Unit of a deviation.
    pub(super) fn back(&self, quantity: Quantity) -> f64 {
        match quantity {
            Quantity::Position => self.size,
            Quantity::Rate => self.size / self.unit,
        }
    }

    /// Unit of the `k`-th derivative.
    pub(super) fn derivative(&self, k: usize) -> f64 {
        self.size / self.unit.powi(k as i32)
    }

    /// Unit of the density of the jerk.
    pub(super) fn density(&self) -> f64 {
        self.size * self.size / self.unit.powi(5)
    }
}
