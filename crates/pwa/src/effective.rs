//! Row weights of any scale: together they count as the effective number of rows.
//!
//! Kish, "Survey sampling" (1965), section 11.7: rows of weights w count as `(sum w)^2 / sum w^2` rows of weight 1.
//! Quantities that are compared with numbers of rows are then the same for counts and for shares: the pull of a region,
//! its least rows, the price of a number of a map.

use fleetfoot_data::{Progress, Source};
use fleetfoot_library::{Binary, Expr};
use fleetfoot_stats::{
    COARSE, Grid,
    scan::{Columns, scan},
};

use crate::{Error, Problem};

/// The problem with its weights divided by their weighted mean, in one pass over the weights. `None` without weights,
/// or if the mean is zero.
pub(crate) fn with_effective_weights(
    problem: &Problem,
    source: &dyn Source,
    progress: &dyn Progress,
) -> Result<Option<Problem>, Error> {
    let Some(weight) = &problem.weight else { return Ok(None) };
    let targets: Vec<Expr> = problem.equations.iter().filter_map(|equation| equation.target.clone()).collect();
    let columns = Columns::compile(&[&problem.library, &targets, &problem.partition_columns], Some(weight), source)?;
    let (mut sum, mut squares) = (0.0, 0.0);
    progress.stage("weights");
    scan(
        &columns,
        source,
        &Grid { chunk_rows: COARSE }.chunks(source.episodes()),
        progress,
        || (0.0, 0.0),
        |part: &mut (f64, f64), _, tile| {
            for weight in tile.weights().into_iter().flatten() {
                (part.0, part.1) = (part.0 + weight, weight.mul_add(*weight, part.1));
            }
            Ok::<_, Error>(())
        },
        |_, _, part| {
            (sum, squares) = (sum + part.0, squares + part.1);
            Ok(())
        },
    )?;
    let factor = sum / squares;
    if !(factor.is_finite() && factor > 0.0) || factor == 1.0 {
        return Ok(None);
    }
    let weight = Expr::binary(Binary::Mul, Expr::number(factor), weight.clone());
    Ok(Some(Problem { weight: Some(weight), ..problem.clone() }))
}
