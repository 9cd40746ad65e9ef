//! The instruction set of the kernels, chosen once a process.
//!
//! The widest instruction set of the processor is taken. [`SWITCH`] names a narrower one, so that one machine can
//! compute the results of another. Kernels of third-party libraries (matrix products of more than 128 columns,
//! factorisations of general matrices) choose theirs separately, and know nothing of the switch.

use std::{env, sync::OnceLock};

use pulp::Arch;

/// Environment variable that limits the instruction set of the kernels: `avx512`, `avx2` or `scalar`.
pub const SWITCH: &str = "FLEETFOOT_SIMD";

/// The value of [`SWITCH`] is not the name of an instruction set.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "{SWITCH}=`{value}`: no such instruction set; use `avx512`, `avx2` or `scalar`, or unset the variable for the widest one"
)]
pub struct UnknownInstructionSet {
    /// The variable's value.
    pub value: String,
}

/// The widest instruction set that kernels may use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Limit {
    Widest,
    Avx2,
    Scalar,
}

impl Limit {
    fn parse(value: Option<&str>) -> Result<Self, UnknownInstructionSet> {
        match value {
            // No kernel uses more than `avx512`.
            None | Some("" | "avx512") => Ok(Self::Widest),
            Some("avx2") => Ok(Self::Avx2),
            Some("scalar") => Ok(Self::Scalar),
            Some(value) => Err(UnknownInstructionSet { value: value.to_owned() }),
        }
    }

    /// The limit that the environment sets, read once.
    fn of_environment() -> &'static Result<Self, UnknownInstructionSet> {
        static LIMIT: OnceLock<Result<Limit, UnknownInstructionSet>> = OnceLock::new();
        LIMIT.get_or_init(|| {
            let value = env::var_os(SWITCH);
            Self::parse(value.as_ref().map(|value| value.to_string_lossy()).as_deref())
        })
    }

    /// The widest instruction set within the limit that the processor has.
    fn arch(self) -> Arch {
        match self {
            Self::Widest => Arch::new(),
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx2 => pulp::x86::V3::try_new().map_or(Arch::Scalar, Arch::V3),
            // Other processors have one set of vectors, of the width of `avx2` or less.
            #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
            Self::Avx2 => Arch::new(),
            Self::Scalar => Arch::Scalar,
        }
    }
}

/// The instruction set that every kernel is dispatched to.
///
/// An unknown value of [`SWITCH`] counts as none: programs refuse it by [`check_instruction_set`] when they start.
#[inline]
pub fn arch() -> Arch {
    static ARCH: OnceLock<Arch> = OnceLock::new();
    *ARCH.get_or_init(|| Limit::of_environment().as_ref().copied().unwrap_or(Limit::Widest).arch())
}

/// The name of the instruction set of [`arch`]: `avx512`, `avx2`, `scalar`, or `vectors` on other processors.
pub fn instruction_set() -> &'static str {
    match arch() {
        Arch::Scalar => "scalar",
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Arch::V3(_) => "avx2",
        #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
        Arch::V4(_) => "avx512",
        _ => "vectors",
    }
}

/// Refuses a value of [`SWITCH`] that names no instruction set.
///
/// # Errors
/// [`UnknownInstructionSet`] with that value.
pub fn check_instruction_set() -> Result<(), UnknownInstructionSet> {
    Limit::of_environment().clone().map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_never_exceeded_and_unknown_names_are_refused() {
        assert!(matches!(Limit::Scalar.arch(), Arch::Scalar));
        #[cfg(target_arch = "x86_64")]
        assert!(!matches!(Limit::Avx2.arch(), Arch::V4(_)));
        assert_eq!(Limit::parse(Some("")), Limit::parse(None));
        assert_eq!(Limit::parse(Some("avx512")), Ok(Limit::Widest));
        assert_eq!((Limit::parse(Some("avx2")), Limit::parse(Some("scalar"))), (Ok(Limit::Avx2), Ok(Limit::Scalar)));
        let refused = Limit::parse(Some("avx-2")).unwrap_err().to_string();
        assert!(
            refused.contains("FLEETFOOT_SIMD=`avx-2`") && refused.contains("use `avx512`, `avx2` or `scalar`"),
            "{refused}"
        );
    }
}
