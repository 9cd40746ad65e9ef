//! Choice of models: held-out errors over lambda or over numbers of terms, and selection frequencies. A model does not
//! carry these. The report of its fit does, and names the model by its hash.

use fleetfoot_data::setting::JSON;
use fleetfoot_fit::{Bounded, Error, LimitReport};
use fleetfoot_model::Model;
use fleetfoot_report::{
    Axis, Bars, Chart, Figure, Interval, Lines, Matrix, Panels, Part, Scale, Series, Stroke, words::count,
};
use serde::Deserialize;
use serde_json::Value;

use crate::Judged;

/// Functions whose frequencies are drawn, models beside them, and equations whose fronts are.
const FUNCTIONS: usize = 24;
const MODELS: usize = 24;
const EQUATIONS: usize = 6;
/// Held-out errors are drawn up to so many times the least.
const FAR: f64 = 3.0;
/// Functions of a path that are drawn: more lines cannot be distinguished.
const ALONG: usize = 12;

/// Parts of a fit's report that a page shows.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Fit {
    /// The model's.
    hash: String,
    rows: Option<f64>,
    effective_rows: Option<f64>,
    lambda: Option<Lambda>,
    path: Option<Paths>,
    #[serde(default)]
    latents: Vec<Latent>,
    #[serde(default)]
    pub(crate) candidates: Value,
    /// True if losses are of held-out rows; some fits have another value.
    pub(crate) held_out: Option<Value>,
    #[serde(default)]
    pub(crate) regions: Vec<Region>,
    /// Bounds of the fit, with their errors.
    #[serde(default)]
    pub(crate) limits: Vec<LimitReport>,
    #[serde(default)]
    pub(crate) tasks: Vec<Task>,
    #[serde(default)]
    pub(crate) noise: Vec<Deviation>,
    objective: Option<Simulated>,
    /// Models of an autoregression that were tried.
    #[serde(default)]
    tried: Vec<Tried>,
}

/// Errors of a task with limits and without.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Task {
    pub(crate) name: String,
    #[serde(flatten)]
    pub(crate) priced: Priced,
}

/// Errors with limits and without.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Priced {
    pub(crate) rms: Option<f64>,
    pub(crate) held_out_rms: Option<f64>,
    pub(crate) free_rms: Option<f64>,
    pub(crate) free_held_out_rms: Option<f64>,
}

/// The deviation of a state's measurements, or of residuals, with limits and without.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Deviation {
    pub(crate) of: String,
    pub(crate) deviation: Option<f64>,
    pub(crate) free_deviation: Option<f64>,
}

/// The fit to simulations.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Simulated {
    written: bool,
    bound: Option<Bounded>,
}

/// An autoregression that was tried.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Tried {
    coefficients: usize,
    rrse: Option<f64>,
    loss: Option<f64>,
    bic: Option<f64>,
    front: bool,
    chosen: bool,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Lambda {
    value: Option<f64>,
    how: String,
    validation: Option<Validation>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Validation {
    folds: usize,
    lambdas: Vec<Option<f64>>,
    error: Vec<Option<f64>>,
    standard_error: Vec<Option<f64>>,
}

/// Coefficients along a penalty, or along the number of terms of each equation.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
enum Paths {
    Lambda(Path),
    Terms(Vec<TermsPath>),
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct TermsPath {
    /// The region's.
    name: String,
    label: String,
    terms: Vec<usize>,
    functions: Vec<Along>,
    entered: usize,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Path {
    lambdas: Vec<Option<f64>>,
    functions: Vec<Along>,
    entered: usize,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Along {
    function: String,
    coefficients: Vec<Option<f64>>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Latent {
    name: String,
    functions: Vec<Function>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Function {
    function: String,
    frequency: Option<f64>,
    standard_error: Option<f64>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Region {
    pub(crate) name: String,
    pub(crate) equations: Vec<Equation>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
pub(crate) struct Equation {
    pub(crate) label: String,
    #[serde(flatten)]
    pub(crate) priced: Priced,
    #[serde(default)]
    terms: Vec<Function>,
    inclusion: Option<Vec<Option<f64>>>,
    #[serde(default)]
    front: Vec<Point>,
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Point {
    terms: usize,
    rms: Option<f64>,
    held_out_rms: Option<f64>,
    chosen: bool,
}

/// Reads reports of fits, in the form of `--json`; one of `--by` has several.
///
/// # Errors
/// A JSON value that is no report of a fit.
pub(crate) fn read(reports: &[Value]) -> Result<Vec<Fit>, Error> {
    let of = |report: &Value| match report.get("models").and_then(Value::as_array) {
        Some(several) => several.clone(),
        None => vec![report.clone()],
    };
    let one = |report: Value| {
        serde_json::from_value(report).map_err(|error| {
            Error::value(format!("not a report of a fit ({error}): give the output of a fit with {JSON}"))
        })
    };
    reports.iter().flat_map(of).map(one).collect()
}

/// Parts of all models; empty if no report belongs to a model here.
pub(crate) fn parts(judged: &[Judged<'_>], fits: &[Fit]) -> Vec<Part> {
    let known: Vec<(&str, &Fit)> =
        judged.iter().filter_map(|one| Some((one.name, Fit::of(fits, one.model)?))).collect();
    let mut figures = Vec::new();
    for (place, (name, fit)) in known.iter().enumerate() {
        let title = |what: &str| if judged.len() > 1 { format!("{what}: {name}") } else { what.to_owned() };
        figures.extend(fit.curve(place + 1, title("Choice of lambda")));
        figures.extend(fit.path(place + 1, title("Coefficients over lambda")));
        figures.extend(fit.fronts(place + 1, title("Error and number of terms")));
        figures.extend(fit.orders(place + 1, title("Error and number of coefficients")));
        figures.extend(fit.along_terms(place + 1, &title("Contributions by number of terms")));
    }
    let shares: Vec<(&str, Vec<(String, f64)>)> = known.iter().map(|(name, fit)| (*name, fit.shares())).collect();
    figures.extend(frequencies(&shares));
    let parts: Vec<Part> = figures.into_iter().map(Part::Figure).collect();
    if parts.is_empty() {
        parts
    } else {
        std::iter::once(Part::Heading("Choice of the model".into())).chain(parts).collect()
    }
}

/// Number of reports that belong to no model here.
pub(crate) fn strangers(judged: &[Judged<'_>], fits: &[Fit]) -> usize {
    fits.iter().filter(|fit| judged.iter().all(|one| one.model.hash() != fit.hash)).count()
}

fn number(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

fn list(values: &[Option<f64>]) -> Vec<f64> {
    values.iter().map(|&value| number(value)).collect()
}

impl Fit {
    /// Held-out error over lambda, with the range between the least error and the choice.
    fn curve(&self, place: usize, title: String) -> Option<Figure> {
        let lambda = self.lambda.as_ref()?;
        let validation = lambda.validation.as_ref().filter(|validation| validation.lambdas.len() > 1)?;
        let (lambdas, error, spread) =
            (list(&validation.lambdas), list(&validation.error), list(&validation.standard_error));
        let best = (0..error.len()).filter(|&k| error[k].is_finite()).min_by(|&a, &b| error[a].total_cmp(&error[b]))?;
        // Far from the least error a curve only says that it is far.
        let near: Vec<usize> = (0..error.len()).filter(|&k| error[k] <= FAR * error[best]).collect();
        let at = |list: &[f64]| near.iter().map(|&k| list[k]).collect::<Vec<f64>>();
        let ends =
            |sign: f64| near.iter().map(|&k| error[k] + sign * spread.get(k).copied().unwrap_or(f64::NAN)).collect();
        let line = Series::line("held-out error", at(&lambdas), at(&error)).banded(ends(-1.0), ends(1.0));
        let mut x = Axis::of("lambda", "");
        x.scale = Scale::Logarithmic;
        let y = Axis::of("held-out error", "");
        let chosen = number(lambda.value);
        let chart = Lines::new(x, y, vec![line])
            .level(error[best] + spread.get(best).copied().unwrap_or(f64::NAN), "one standard error above the least")
            .shaded([lambdas[best].min(chosen), lambdas[best].max(chosen)], "from the least error to the choice");
        let caption = format!(
            "Error on held-out rows of {} over lambda; the band is one standard error to both sides. Chosen: lambda = {} ({}). To the right there are fewer functions; where the \
             error is more than {FAR} times the least the curve is not drawn.",
            count(validation.folds, "fold"),
            fleetfoot_report::words::number(chosen),
            lambda.how
        );
        Some(Figure::new(format!("validation-{place}"), title, caption, Chart::Lines(chart)))
    }

    /// Coefficients over lambda, with the one that was chosen.
    fn path(&self, place: usize, title: String) -> Option<Figure> {
        let Some(Paths::Lambda(path)) = &self.path else { return None };
        if path.lambdas.len() < 2 {
            return None;
        }
        let chosen = number(self.lambda.as_ref()?.value);
        // Places rise along an axis, and lambda falls along a path.
        let rising = |values: &[Option<f64>]| list(values).into_iter().rev().collect::<Vec<f64>>();
        let line =
            |along: &Along| Series::line(along.function.clone(), rising(&path.lambdas), rising(&along.coefficients));
        let lines: Vec<Series> = path.functions.iter().take(ALONG).map(line).collect();
        let drawn = lines.len();
        let mut x = Axis::of("lambda", "");
        x.scale = Scale::Logarithmic;
        let chart = Lines::new(x, Axis::of("coefficient, standardised", ""), lines).marked(chosen, "chosen lambda");
        let more = if path.entered > drawn {
            format!(" Drawn are the {drawn} largest of {} functions that enter.", path.entered)
        } else {
            String::new()
        };
        let caption = format!(
            "Coefficients of the penalised fit over lambda, in the units in which the penalty compares them; lines bend where a function enters or leaves. The upright line is at the \
             chosen lambda, {}: functions that leave zero to its right are in the model; the next ones leave zero to its left.{more}",
            fleetfoot_report::words::number(chosen)
        );
        Some(Figure::new(format!("path-{place}"), title, caption, Chart::Lines(chart)))
    }

    /// Error over the number of terms, an equation a panel, in the first region.
    fn fronts(&self, place: usize, title: String) -> Option<Figure> {
        let region = self.regions.first()?;
        let panels: Vec<Lines> = region
            .equations
            .iter()
            .filter(|equation| equation.front.len() > 1)
            .take(EQUATIONS)
            .map(Equation::panel)
            .collect();
        if panels.is_empty() {
            return None;
        }
        let of = if self.regions.len() > 1 { format!(" of region {}", region.name) } else { String::new() };
        let caption = format!(
            "Root mean squared error of the equations{of} with so many terms, on the rows of the fit and on held-out rows; shaded is the chosen number. Where the \
             held-out error no longer falls, more terms only follow the noise."
        );
        Some(Figure::new(format!("front-{place}"), title, caption, Chart::Panels(Panels::new(panels))))
    }

    /// The models that were tried: autoregressions, or the partitions of a piecewise-affine fit.
    fn orders_tried(&self) -> Vec<Tried> {
        if !self.tried.is_empty() {
            return self.tried.clone();
        }
        Vec::deserialize(&self.candidates).unwrap_or_default()
    }

    /// Held-out error, and the criterion where it is known, of the models that were tried over their coefficients: regions, lags and library together.
    fn orders(&self, place: usize, title: String) -> Option<Figure> {
        let tried = self.orders_tried();
        let mut all: Vec<&Tried> = tried.iter().filter(|candidate| candidate.error().is_some()).collect();
        all.sort_by_key(|candidate| candidate.coefficients);
        let front: Vec<&Tried> = all.iter().copied().filter(|candidate| candidate.front).collect();
        if front.len() < 2 {
            return None;
        }
        let chosen = all.iter().find(|candidate| candidate.chosen).map(|candidate| candidate.coefficients as f64);
        let places = |of: &[&Tried]| of.iter().map(|candidate| candidate.coefficients as f64).collect::<Vec<f64>>();
        let panel = |title: &str, of: &dyn Fn(&Tried) -> Option<f64>| {
            let values =
                |of_these: &[&Tried]| of_these.iter().map(|candidate| number(of(candidate))).collect::<Vec<f64>>();
            let x = Axis::of(title, "").spread(places(&all).into_iter());
            let y = Axis::of(title, "").spread(values(&all).into_iter().filter(|value| value.is_finite()));
            let line = Series::line("front", places(&front), values(&front));
            let marks = Series::line("models", places(&all), values(&all)).looks(Stroke::HollowMarks);
            let lines = Lines::new(x, y, vec![line, marks]);
            match chosen {
                Some(at) => lines.marked(at, "taken"),
                None => lines,
            }
        };
        let simulated = all.iter().all(|candidate| candidate.loss.is_none());
        let what = if simulated { "relative error of free runs" } else { "squared error over variance" };
        let mut panels = vec![panel("error over coefficients", &|candidate| candidate.error())];
        let criterion = all.iter().any(|candidate| candidate.bic.is_some());
        if criterion {
            panels.push(panel("BIC over coefficients", &|candidate| candidate.bic));
        }
        let caption = format!(
            "Each mark is one of {} with its regions, lags and library, those of few coefficients to the left: its {what} on rows that did not train{}. On the line no model of as \
             few coefficients has a smaller error. The upright line is at the chosen model.",
            count(tried.len(), "model"),
            if criterion { ", and the Bayesian information criterion" } else { "" }
        );
        Some(Figure::new(format!("orders-{place}"), title, caption, Chart::Panels(Panels::new(panels))))
    }

    /// Contribution of each function over the number of terms, an equation a figure, in the first region.
    fn along_terms(&self, place: usize, title: &str) -> Vec<Figure> {
        let (Some(Paths::Terms(paths)), Some(region)) = (&self.path, self.regions.first()) else { return Vec::new() };
        let paths = paths.iter().filter(|path| path.name == region.name && path.terms.len() > 1).take(EQUATIONS);
        let figure = |(number, path): (usize, &TermsPath)| {
            let chosen = region.equations.iter().find(|equation| equation.label == path.label);
            let chosen = chosen.and_then(|equation| equation.front.iter().find(|point| point.chosen));
            let name = format!("terms-{place}-{}", number + 1);
            path.figure(name, format!("{title}: {}", path.label), chosen.map(|point| point.terms))
        };
        paths.enumerate().map(figure).collect()
    }

    /// The standard errors of the coefficients of an equation, or of a shared function, in a region: functions by name,
    /// `1` for the constant.
    pub(crate) fn standard_errors(&self, label: &str, latent: &str, region: usize) -> Vec<(&str, f64)> {
        let equations = self.regions.get(region).into_iter().flat_map(|region| &region.equations);
        let terms = equations.filter(|equation| equation.label == label).flat_map(|equation| &equation.terms);
        let shared =
            self.latents.iter().filter(|candidate| candidate.name == latent).flat_map(|candidate| &candidate.functions);
        terms.chain(shared).filter_map(|term| Some((term.function.as_str(), term.standard_error?))).collect()
    }

    /// Contraction of the maps that were fitted to simulations, if these were written.
    pub(crate) fn bound_of_simulations(&self) -> Option<Bounded> {
        self.objective.as_ref().filter(|objective| objective.written)?.bound
    }

    /// Returns true if coefficients fitted to simulations were written.
    pub(crate) fn is_simulated(&self) -> bool {
        self.objective.as_ref().is_some_and(|objective| objective.written)
    }

    /// Rows, and how many of them count as independent.
    pub(crate) fn independent(&self) -> Option<[f64; 2]> {
        Some([self.rows?, self.effective_rows?])
            .filter(|[rows, independent]| *independent >= 1.0 && rows >= independent)
    }

    /// The report of a model's fit, if it is among these.
    pub(crate) fn of<'a>(fits: &'a [Self], model: &Model) -> Option<&'a Self> {
        fits.iter().find(|fit| fit.hash == model.hash())
    }

    /// Functions with the share of resamples that select them.
    fn shares(&self) -> Vec<(String, f64)> {
        let latents = self.latents.iter().flat_map(|latent| {
            let several = self.latents.len() > 1;
            latent.functions.iter().filter_map(move |one| {
                let name = if several { format!("{}: {}", latent.name, one.function) } else { one.function.clone() };
                Some((name, one.frequency?))
            })
        });
        let names: Vec<&str> = self.candidates.as_array().into_iter().flatten().filter_map(Value::as_str).collect();
        let equations = self.regions.iter().take(1).flat_map(|region| &region.equations);
        let members = equations.flat_map(|equation| {
            let shares = equation.inclusion.iter().flatten();
            names.iter().zip(shares).map(move |(name, &share)| (format!("{}: {name}", equation.label), number(share)))
        });
        latents.chain(members).filter(|(_, share)| share.is_finite()).collect()
    }
}

impl TermsPath {
    fn figure(&self, name: String, title: String, chosen: Option<usize>) -> Figure {
        let terms: Vec<f64> = self.terms.iter().map(|&terms| terms as f64).collect();
        let line = |along: &Along| Series::line(along.function.clone(), terms.clone(), list(&along.coefficients));
        let lines: Vec<Series> = self.functions.iter().take(ALONG).map(line).collect();
        let drawn = lines.len();
        let y = Axis::of("coefficient times the function\u{2019}s root mean square", "");
        let mut chart = Lines::new(Axis::of("terms", ""), y, lines);
        if let Some(chosen) = chosen {
            chart = chart.marked(chosen as f64, "taken");
        }
        let more = if self.entered > drawn {
            format!(" Drawn are the {drawn} largest of {} functions.", self.entered)
        } else {
            String::new()
        };
        let caption = format!(
            "Contribution of each function to {} in the best model of so many terms, in the unit of the left side; zero if the model lacks the function. A coefficient that \
             still changes behind the upright line is traded for others.{more}",
            self.label
        );
        Figure::new(name, title, caption, Chart::Lines(chart))
    }
}

impl Tried {
    /// The error that the models were compared by.
    fn error(&self) -> Option<f64> {
        self.loss.or(self.rrse)
    }
}

impl Equation {
    fn panel(&self) -> Lines {
        let terms: Vec<f64> = self.front.iter().map(|point| point.terms as f64).collect();
        let line = |name: &str, of: fn(&Point) -> Option<f64>| {
            Series::line(name, terms.clone(), self.front.iter().map(|point| number(of(point))).collect())
        };
        let seen = line("rows of the fit", |point| point.rms).looks(Stroke::Reference);
        let held = line("held-out rows", |point| point.held_out_rms);
        let values = seen.y.iter().chain(&held.y).copied().collect::<Vec<_>>().into_iter();
        let lines = Lines::new(
            Axis::of(format!("terms of {}", self.label), ""),
            Axis::of("RMSE", "").spread(values),
            vec![held, seen],
        );
        match self.front.iter().find(|point| point.chosen) {
            Some(chosen) => lines.shaded([chosen.terms as f64 - 0.2, chosen.terms as f64 + 0.2], "taken"),
            None => lines,
        }
    }
}

/// Selection frequencies (Fig. 2 of the aircraft paper): bars of one model, a map of several.
fn frequencies(shares: &[(&str, Vec<(String, f64)>)]) -> Option<Figure> {
    let models: Vec<_> = shares.iter().filter(|(_, frequencies)| !frequencies.is_empty()).take(MODELS).collect();
    let of = |model: &[(String, f64)], name: &str| {
        model.iter().find(|(function, _)| function == name).map_or(f64::NAN, |(_, share)| *share)
    };
    let mut names: Vec<String> = Vec::new();
    for (name, _) in models.iter().flat_map(|(_, frequencies)| frequencies) {
        if !names.contains(name) {
            names.push(name.clone());
        }
    }
    let largest = |name: &String| models.iter().map(|(_, frequencies)| of(frequencies, name)).fold(0.0, f64::max);
    let all = names.len();
    // The largest ones, in the order of the library.
    let mut order: Vec<usize> = (0..all).collect();
    order.sort_by(|&a, &b| largest(&names[b]).total_cmp(&largest(&names[a])).then(a.cmp(&b)));
    order.truncate(FUNCTIONS);
    order.sort_unstable();
    let names: Vec<String> = order.iter().map(|&place| names[place].clone()).collect();
    let more = if all > names.len() {
        format!(" Shown are the {} most frequent of {all} functions.", names.len())
    } else {
        String::new()
    };
    let caption = |what: &str| {
        format!(
            "Share of the resampled fits that select a function{what}: a function that is always selected does not depend on a few rows.{more}"
        )
    };
    let chart = match models.as_slice() {
        [] => return None,
        [(_, frequencies)] => {
            let value = |name: &String| Interval { value: of(frequencies, name), low: f64::NAN, high: f64::NAN };
            let bars = vec![("selection frequency".to_owned(), names.iter().map(value).collect())];
            Chart::Bars(Bars::new(Axis::of("selection frequency", "").between(0.0, 1.0), names, bars))
        }
        several => {
            let values = names
                .iter()
                .map(|name| several.iter().map(|(_, frequencies)| of(frequencies, name)).collect())
                .collect();
            let columns = several.iter().map(|(name, _)| (*name).to_owned()).collect();
            Chart::Matrix(Matrix::new("selection frequency", ["function", "model"], [names, columns], values))
        }
    };
    let what = if models.len() > 1 { ", model by model" } else { "" };
    Some(Figure::new("selection-frequency", "Selection frequencies", caption(what), chart))
}
