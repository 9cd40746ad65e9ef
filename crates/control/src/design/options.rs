//! Options of a regulator.

/// A number by name.
pub type Named = (String, f64);

/// Options of a regulator.
///
/// It minimises the sum over samples of `e'Qe + v'Rv`, e being the error of the states and v that of the inputs, Q and R diagonal.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LqrOptions {
    /// Values that states and inputs are to have; the others are found.
    pub setpoint: Vec<Named>,
    /// Weights of states; where not given, one over the variance in training.
    pub q: Vec<Named>,
    /// Weights of inputs; where not given, one over the variance in training.
    pub r: Vec<Named>,
    /// Weights of the time integrals of states' errors: integral action. None where not given.
    pub integral: Vec<Named>,
    /// Lowest and highest values of inputs.
    pub limits: Vec<(String, f64, f64)>,
    /// Inputs that are driven; all of them where none are given.
    pub drive: Vec<String>,
    /// States that are neither kept nor fed back.
    pub free: Vec<String>,
    /// Seconds between commands; the model's sampling period where not given.
    pub period: Option<f64>,
    /// Schedule of the laws: one for every region, or one for all.
    pub schedule: Schedule,
}

/// Laws by region, or one for all.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Schedule {
    /// By region, where one of them rests at the set point; else the mean.
    #[default]
    Auto,
    /// By region.
    Region,
    /// One, of the mean of the regions' steps by their training rows. It suits regions that a cycle passes through too
    /// fast to rest in any, such as those of a stride.
    Mean,
}

/// Options of a predictive controller.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MpcOptions {
    /// Set point, weights, limits and period: those of the regulator whose cost ends the plan.
    pub lqr: LqrOptions,
    /// Samples that are planned ahead, 1 to [`MOST_SAMPLES`](crate::controller::MOST_SAMPLES).
    pub horizon: usize,
    /// Lowest and highest values of states, which contain the set point.
    pub bounds: Vec<(String, f64, f64)>,
}
