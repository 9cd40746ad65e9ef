//! Work of the models of an equation fit, estimated beforehand: a large library takes minutes.

use fleetfoot_data::Work;
use fleetfoot_data::setting::FOLDS;
use fleetfoot_recipe::SindyOptimizer;
use fleetfoot_sparse::threshold::Rivals;

use super::{SindyOptions, solve::most_thresholds};

/// Cost of refitting a path's supports on all folds, in factorisations of the size of the library.
const OF_PATH: f64 = 11.0;

/// The models of `targets` equations in every region, and their held-out errors. Measured against fits of 30 to 180 candidates, it is right within a factor of two;
/// reading rows, smoothing states and simulations come beside it.
pub(super) fn work(options: &SindyOptions, candidates: usize, targets: usize, regions: usize, folds: usize) -> Work {
    let size = candidates as f64;
    let factorisation = size.powi(3);
    let of_one = options.threshold.is_some() || options.optimizer == SindyOptimizer::LeastSquares;
    let path = match options.optimizer {
        _ if of_one => factorisation,
        SindyOptimizer::Ssr => size.powi(4) / 4.0,
        SindyOptimizer::Frols | SindyOptimizer::Lasso | SindyOptimizer::GroupLasso => 4.0 * factorisation,
        SindyOptimizer::Auto | SindyOptimizer::Stlsq | SindyOptimizer::Sr3 | SindyOptimizer::LeastSquares => {
            most_thresholds(candidates) as f64 * factorisation
        }
    };
    let backward = match options.optimizer {
        SindyOptimizer::Auto if !of_one => (candidates.min(Rivals::START) as f64).powi(4),
        _ => 0.0,
    };
    let held_out = folds as f64 * if of_one { 1.0 } else { OF_PATH } * factorisation;
    let members = options.ensemble.map_or(0.0, |(_, members)| members as f64 * factorisation);
    Work {
        operations: (path + backward + held_out + members) * (targets * regions) as f64,
        parts: targets.max(1),
        mend: format!(
            "fewer functions in the library or fewer folds ({given_folds}) make it shorter",
            given_folds = FOLDS.to(2)
        ),
    }
}
