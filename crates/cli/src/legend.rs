//! `--explain`: the meaning of the headings of the tables that a command prints.

use std::cell::RefCell;

/// The page that explains every column and key.
const PAGE: &str = "docs/reference/reports.md";

/// Headings, and what their columns have. A heading without an entry of its own is explained by its first word.
const HEADINGS: [(&str, &str); 62] = [
    ("+-", "standard error over the folds"),
    ("AUC", "area under the curve: 0.5 for a guess, 1 for a perfect order"),
    ("BIC", "Bayesian information criterion: lower is better"),
    ("CRLB", "Cramer-Rao bound: the least standard error that these rows allow"),
    ("ERR", "error reduction ratio: share of the output's variance that the term explains, in the order of selection"),
    ("FIT", "100 % less the error relative to the mean: 100 is exact, 0 is the mean"),
    ("MAE", "mean absolute error, in the unit of the target"),
    ("MAE / null", "mean absolute error over that of the mean of the training rows: below 1 is better than the mean"),
    ("MAE / sigma", "mean absolute error over the standard deviation of the target"),
    ("Mahalanobis", "length of the error of all targets together, in standard deviations of the targets"),
    ("R2", "share of the variance that is explained: 1 is exact, 0 is the mean"),
    ("RMSE", "root mean squared error, in the unit of the column"),
    ("RRSE", "root of the squared error over that of the mean: 0 is exact, 1 is the mean"),
    ("by", "error of the derivative by the noise of the column"),
    ("candidate", "a model that was fitted and compared"),
    ("candidates", "functions that the search may choose from"),
    ("channel", "column of the log"),
    ("coefficient", "number that multiplies the term, in the units of the columns"),
    ("coefficients", "numbers of the model that are not zero"),
    ("complete", "rows without a missing value"),
    ("const.", "error of a state that goes on at its last rate, over that of the model: above 1 the model is better"),
    ("constant", "the state goes on at its last rate: a prediction without a model"),
    ("deviation", "standard deviation"),
    ("ended", "simulations that diverged or met an unknown region before this step"),
    ("equation", "left side of the equation"),
    ("error", "error of the simulations over that of persistence, mean over the states: below 1 is better"),
    ("error (rms)", "root mean squared error on the training rows, in the unit of the left side"),
    ("error of order 2", "estimated error of a central difference of second order, by the curvature of the column"),
    ("gap", "time between neighbouring rows that is longer than the usual one"),
    ("held", "the same error on rows that did not train"),
    ("held out (rms)", "root mean squared error on rows that did not train"),
    ("interval", "where the error on other rows of such logs is, in 95 of 100 cases"),
    ("latent", "function inside of the equations that the fit chose"),
    ("least", "smallest value"),
    ("least RRSE, held out", "smallest error on rows that did not train, of the models of that degree"),
    ("linear", "error of the linear model"),
    ("loss", "held-out squared error over the variance, mean over the targets: 0 is exact, 1 is the mean"),
    ("mean", "error of the mean of the training rows: a prediction without a model"),
    ("mean (rms)", "error of the mean, root mean squared"),
    ("missing", "share of the rows without a value"),
    ("model", "error of the model"),
    ("most", "largest value"),
    ("moves", "share of the rows whose value is another one than that of the row before"),
    ("null", "the mean of the training rows: a prediction without a model"),
    ("null / model", "error of the mean over that of the model: above 1 the model is better"),
    ("order", "order of the central difference that was chosen"),
    ("orders", "numbers of past rows that were compared"),
    ("partition", "rule that divides the rows into regions, each with a map of its own"),
    ("persistence", "the value of the previous row: a prediction without a model"),
    ("persistence (rms)", "error of the previous row, root mean squared"),
    ("persistence / model", "error of the previous row over that of the model: above 1 the model is better"),
    ("region", "part of the state space with one map"),
    ("regions", "number of regions of the partition"),
    ("rollouts", "error of simulations over that of persistence"),
    ("rows", "rows of the log"),
    ("sigma", "standard deviation of the target"),
    ("squared", "squared error over the variance: 0 is exact, 1 is the mean"),
    ("standard", "standard error of the coefficient, from blocks of neighbouring rows"),
    ("step", "rows after the start of the simulation"),
    ("target", "the quantity that is predicted"),
    ("term", "function of the columns in the equation"),
    ("terms", "functions in the equation, of those that could be chosen"),
];

thread_local! {
    /// Headings of the tables that were made, in their order.
    static PRINTED: RefCell<Vec<String>> = const { RefCell::new(Vec::new()) };
}

/// Remembers the headings of a table.
pub(crate) fn headings(header: &[&str]) {
    PRINTED.with_borrow_mut(|printed| {
        for heading in header {
            if !printed.iter().any(|other| other == heading) {
                printed.push((*heading).to_owned());
            }
        }
    });
}

/// The meaning of a heading, and the part of it that is explained.
fn meaning(heading: &str) -> Option<(&'static str, &'static str)> {
    let of = |name: &str| HEADINGS.iter().find(|(entry, _)| *entry == name).copied();
    of(heading).or_else(|| of(heading.split([' ', ',']).next()?))
}

/// Lines that explain the headings printed so far; empty if none is known.
pub(crate) fn legend() -> String {
    let mut lines: Vec<String> = Vec::new();
    for heading in PRINTED.take() {
        if let Some((name, meaning)) = meaning(&heading) {
            let line = format!("  {name}: {meaning}");
            if !lines.contains(&line) {
                lines.push(line);
            }
        }
    }
    if lines.is_empty() {
        return String::new();
    }
    format!("\n\nColumns (all of them: {PAGE}):\n{}", lines.join("\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn headings_are_sorted_and_short() {
        assert!(HEADINGS.is_sorted_by(|a, b| a.0 < b.0), "sorted, each once");
        for (heading, meaning) in HEADINGS {
            assert!(meaning.split_whitespace().count() <= 25, "{heading}: {meaning}");
        }
    }

    #[test]
    fn legend_explains_each_heading_once() {
        headings(&["target", "RMSE x", "RMSE y", "q", "R2"]);
        headings(&["R2"]);
        let text = legend();
        let lines: Vec<&str> = text.trim().lines().collect();
        assert_eq!(lines.len(), 4, "{text}");
        assert!(lines[1].starts_with("  target: ") && lines[2].starts_with("  RMSE: root"), "{text}");
        assert_eq!(legend(), "");
    }
}
