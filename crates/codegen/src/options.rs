//! Options of an export: language, numbers, steps.

use crate::ExportError;

/// The language of the code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// C99 without heap: a header, a source, a test with vectors, and a source of tables where transitions were counted.
    C,
    /// A module that needs `core` only (and the crate `libm` where the model needs its functions).
    Rust,
    /// A module that needs Python's standard library only.
    Python,
    /// Equations for people.
    Latex,
    /// Arrays for NumPy.
    Npz,
    /// A network for runtimes of ONNX.
    Onnx,
}

/// Floating-point numbers of the code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Precision {
    /// 32 bits.
    Float,
    /// 64 bits.
    #[default]
    Double,
}

/// Integration method of derivatives.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StepMethod {
    /// `x + h f(x)`.
    Euler,
    /// The classical fourth-order Runge-Kutta method, inputs held within a step.
    #[default]
    Rk4,
}

/// Options of an export.
#[derive(Debug, Clone, PartialEq)]
pub struct ExportOptions {
    /// The language.
    pub target: Target,
    /// The numbers (C, Rust and ONNX; Python has 64 bits).
    pub precision: Precision,
    /// In front of all names: an identifier of lower-case letters, digits and `_`.
    pub prefix: String,
    /// A fixed step in seconds for models that integrate derivatives; `None` leaves the step to the caller.
    pub discretize: Option<f64>,
    /// Integration method of derivatives.
    pub method: StepMethod,
    /// True if the code checks its training range (two numbers a function and region).
    pub domain: bool,
}

impl ExportOptions {
    /// Double precision, steps by Runge-Kutta, the training domain checked, names with `model_` in front.
    pub fn new(target: Target) -> Self {
        Self {
            target,
            precision: Precision::default(),
            prefix: "model".into(),
            discretize: None,
            method: StepMethod::default(),
            domain: true,
        }
    }

    pub(crate) fn validate(&self) -> Result<(), ExportError> {
        if self.discretize.is_some_and(|step| !(step.is_finite() && step > 0.0)) {
            return Err(ExportError::Step(self.discretize.unwrap_or_default()));
        }
        crate::names::check_prefix(&self.prefix)
    }
}

impl Precision {
    /// The largest finite number.
    pub(crate) fn largest(self) -> f64 {
        match self {
            Self::Float => f64::from(f32::MAX),
            Self::Double => f64::MAX,
        }
    }

    /// Half the distance from 1 to the next number.
    pub(crate) fn roundoff(self) -> f64 {
        match self {
            Self::Float => f64::from(f32::EPSILON) * 0.5,
            Self::Double => f64::EPSILON * 0.5,
        }
    }

    /// Bytes of a number.
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::Float => 4,
            Self::Double => 8,
        }
    }

    /// The number nearest to `value`.
    pub(crate) fn rounded(self, value: f64) -> f64 {
        match self {
            Self::Float => f64::from(value as f32),
            Self::Double => value,
        }
    }

    /// A finite bound of a range, rounded outwards; a bound that is not a number holds nothing.
    pub(crate) fn bound(self, value: f64, upper: bool) -> f64 {
        let empty = if upper { -self.largest() } else { self.largest() };
        if value.is_nan() {
            return empty;
        }
        let value = value.clamp(-self.largest(), self.largest());
        if self == Self::Double {
            return value;
        }
        let near = value as f32;
        let outward = match upper {
            true if f64::from(near) < value => near.next_up(),
            false if f64::from(near) > value => near.next_down(),
            _ => near,
        };
        f64::from(outward)
    }
}
