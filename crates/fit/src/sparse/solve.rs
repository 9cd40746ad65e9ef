//! One solve of a statistic: coefficients at a penalty that is given. Nothing is chosen, held out, selected or refitted.

use fleetfoot_data::setting::CONSTRAINTS;
use fleetfoot_dataset::StatisticFile;
use fleetfoot_model::Model;
use fleetfoot_recipe::Recipe;
use fleetfoot_sparse::{Certificate, Strength, bolasso::refit, certificate};

use super::{SparseOptions, model, problem::Problem, report::named, standard_errors, support};
use crate::error::Error;

/// Method of the solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SolveMethod {
    /// Least squares on all columns.
    LeastSquares,
    /// The objective of [`fleetfoot_sparse`] at one lambda, with this share of the absolute values in the penalty: 1 is the lasso, 0 is ridge.
    Penalised {
        /// Lambda.
        lambda: f64,
        /// Share of the absolute values.
        l1_ratio: f64,
    },
}

/// Coefficients at a penalty, and their model.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct Solved {
    /// Name of the latent and the function of every coefficient (p).
    pub names: Vec<(String, String)>,
    /// Coefficients in raw units (p).
    pub coefficients: Vec<f64>,
    /// Their standard errors, clustered by episode or chunk (p), of least squares only; NaN for columns that are left out.
    pub standard_errors: Option<Vec<f64>>,
    /// Distance of the coefficients from the minimum.
    pub certificate: Certificate,
    /// Rows, weights included.
    pub rows: f64,
    /// Name, root mean squared error and R2 of every task on its rows.
    pub tasks: Vec<(String, f64, f64)>,
    /// Coefficients that the rows cannot, or can hardly, distinguish.
    pub confounded: Vec<Vec<String>>,
    /// The model.
    pub model: Model,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Solves a statistic. A recipe may name other penalty factors, signs, scales and strengths than the scan's; without one the scan's holds. Of its `[sparse]`,
/// `unscaled`, `prior_strength` and `adaptive` count. Constraints and bounds of latents are not kept: a note says so.
///
/// # Errors
/// Another plan; no rows; lambda or `l1_ratio` out of range.
pub fn solve_statistic(file: &StatisticFile, recipe: Option<&Recipe>, method: SolveMethod) -> Result<Solved, Error> {
    let (lambda, l1_ratio) = method.checked()?;
    let (recipe, task) = match recipe {
        Some(recipe) => (recipe.clone(), file.resolve(recipe)?),
        None => file.task()?,
    };
    let mut options = SparseOptions::new(&recipe.sparse)?;
    (options.l1_ratio, options.groups) = (l1_ratio, None);
    let mut notes = Vec::new();
    if !task.limits.is_empty() || !task.coefficients.is_empty() {
        notes.push(format!("the bounds at every row ({CONSTRAINTS}, at_least, at_most) were not used"));
    }
    let problem = Problem::new(&task, file, &options, |_| true)?;
    let (coefficients, errors) = if lambda == 0.0 {
        let all: Vec<usize> = (0..problem.structure.coefficients()).collect();
        let theta = refit(&problem.structure, &problem.roots, &problem.assembly, &all)?;
        let errors = standard_errors(&problem, &theta, &mut notes);
        (theta, errors)
    } else {
        let (solution, more) = support::penalised(&problem, lambda)?;
        notes.extend(more);
        (problem.assembled.coefficients(&solution), None)
    };
    let assembled = &problem.assembled;
    let scaled: Vec<f64> = coefficients.iter().zip(&assembled.scale).map(|(theta, scale)| theta * scale).collect();
    let strength = Strength::elastic_net(lambda, l1_ratio);
    let support: Vec<usize> = (0..coefficients.len()).filter(|&j| coefficients[j] != 0.0).collect();
    let origin = format!("statistic {}", method.name());
    Ok(Solved {
        names: names(&problem),
        certificate: certificate(&assembled.problem, &assembled.penalty, strength, &scaled)?,
        rows: problem.rows(),
        tasks: scores(&problem, &coefficients),
        confounded: named(&problem, &support)?.0,
        model: model::model(&problem, file, &coefficients, &origin, &recipe.to_toml(), options.seed, |_| true),
        standard_errors: errors,
        coefficients,
        notes,
    })
}

impl SolveMethod {
    /// Lambda and the share of the absolute values.
    fn checked(self) -> Result<(f64, f64), Error> {
        let Self::Penalised { lambda, l1_ratio } = self else { return Ok((0.0, 1.0)) };
        if !(lambda >= 0.0 && lambda.is_finite()) {
            return Err(Error::value(format!("lambda = {lambda}: give a number of zero or more")));
        }
        if !(0.0..=1.0).contains(&l1_ratio) {
            return Err(Error::value(format!("l1_ratio = {l1_ratio}: give a share from 0 (ridge) to 1 (the lasso)")));
        }
        Ok((lambda, l1_ratio))
    }

    fn name(self) -> &'static str {
        match self {
            Self::Penalised { lambda, l1_ratio } if lambda > 0.0 => match l1_ratio {
                0.0 => "ridge",
                1.0 => "lasso",
                _ => "elastic net",
            },
            _ => "least squares",
        }
    }
}

fn names(problem: &Problem<'_>) -> Vec<(String, String)> {
    let latents = problem.task.regression.latents.iter();
    latents
        .flat_map(|latent| latent.functions.iter().map(|function| (latent.name.clone(), function.to_string())))
        .collect()
}

fn scores(problem: &Problem<'_>, coefficients: &[f64]) -> Vec<(String, f64, f64)> {
    let errors = problem.structure.errors(&problem.roots, coefficients);
    let tasks = problem.task.regression.tasks.iter().zip(errors);
    tasks.map(|(task, error)| (task.name.clone(), error.rms(), error.r2())).collect()
}

#[cfg(test)]
mod tests {
    use fleetfoot_data::Silent;

    use super::*;
    use crate::statistic::{ScanOptions, scan};

    /// `y = 2 + 3 x - z` with an error that no function explains, on 120 rows.
    fn statistic() -> (Vec<[f64; 3]>, StatisticFile) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        let (mut text, mut rows) = (String::from("t,x,z,y\n"), Vec::new());
        for i in 0..120 {
            let t = 0.1 * f64::from(i);
            let (x, z) = ((1.3 * t).sin() + 0.2, (0.7 * t).cos() * 4.0);
            let y = 2.0 + 3.0 * x - z + 0.1 * (5.0 * t).sin();
            text.push_str(&format!("{t},{x},{z},{y}\n"));
            rows.push([x, z, y]);
        }
        std::fs::write(&path, text).unwrap();
        let recipe = "[model]\npredict = \"y\"\n[inputs]\nx = \"x\"\nz = \"z\"\n[time]\ncolumn = \"t\"";
        let recipe = Recipe::parse(recipe, "test").unwrap();
        let options = ScanOptions { chunk_rows: std::num::NonZeroUsize::new(10), ..ScanOptions::default() };
        (rows, scan(&recipe, &options, None, &[path], &Silent).unwrap().0)
    }

    /// Mean and deviation (divisor n) of a column.
    fn moments(rows: &[[f64; 3]], column: usize) -> (f64, f64) {
        let n = rows.len() as f64;
        let mean = rows.iter().map(|row| row[column]).sum::<f64>() / n;
        (mean, (rows.iter().map(|row| (row[column] - mean).powi(2)).sum::<f64>() / n).sqrt())
    }

    /// The largest violation of the conditions of optimality of centred, standardised rows, by their definition.
    fn violation(rows: &[[f64; 3]], solved: &Solved, l1: f64, l2: f64) -> f64 {
        let of = |name: &str| {
            let at = solved.names.iter().position(|(_, function)| function == name).unwrap();
            solved.coefficients[at]
        };
        let (y_mean, y_size) = moments(rows, 2);
        let b = [of("x"), of("z")];
        let means = [moments(rows, 0).0, moments(rows, 1).0];
        // The constant is not penalised: it makes the mean residual zero.
        assert!((of("1") + b[0] * means[0] + b[1] * means[1] - y_mean).abs() < 1e-9);
        let mut worst: f64 = 0.0;
        for j in 0..2 {
            let size = moments(rows, j).1 / y_size;
            let gradient: f64 = rows
                .iter()
                .map(|row| {
                    let fitted = b[0] * (row[0] - means[0]) + b[1] * (row[1] - means[1]);
                    (row[j] - means[j]) / moments(rows, j).1 * (row[2] - y_mean - fitted) / y_size
                })
                .sum::<f64>()
                / rows.len() as f64;
            let d = b[j] * size;
            worst = worst.max(if d == 0.0 { gradient.abs() - l1 } else { (gradient - l1 * d.signum() - l2 * d).abs() });
        }
        worst
    }

    #[test]
    fn solutions_meet_the_conditions_of_their_objective() {
        let (rows, file) = statistic();
        for (method, l1, l2) in [
            (SolveMethod::LeastSquares, 0.0, 0.0),
            (SolveMethod::Penalised { lambda: 0.1, l1_ratio: 1.0 }, 0.1, 0.0),
            (SolveMethod::Penalised { lambda: 0.7, l1_ratio: 1.0 }, 0.7, 0.0),
            (SolveMethod::Penalised { lambda: 0.3, l1_ratio: 0.0 }, 0.0, 0.3),
            (SolveMethod::Penalised { lambda: 0.2, l1_ratio: 0.5 }, 0.1, 0.1),
        ] {
            let solved = solve_statistic(&file, None, method).unwrap();
            assert!(violation(&rows, &solved, l1, l2) < 1e-9, "{method:?} {:?}", solved.coefficients);
            assert!(solved.certificate.kkt < 1e-9 && solved.certificate.gap < 1e-9, "{:?}", solved.certificate);
            assert_eq!(solved.standard_errors.is_some(), method == SolveMethod::LeastSquares);
        }
    }

    #[test]
    fn options_out_of_range_are_refused() {
        let (_, file) = statistic();
        for (lambda, l1_ratio, word) in [(-1.0, 1.0, "lambda = -1"), (f64::NAN, 1.0, "lambda"), (1.0, 1.5, "l1_ratio")]
        {
            let error = solve_statistic(&file, None, SolveMethod::Penalised { lambda, l1_ratio }).unwrap_err();
            assert!(error.to_string().contains(word), "{error}");
        }
        let error = solve_statistic(&file.without_rows(), None, SolveMethod::LeastSquares).unwrap_err();
        assert!(error.to_string().contains("no rows"), "{error}");
    }
}
