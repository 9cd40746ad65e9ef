//! Intervals of the coefficients: tables beside the equations.

use fleetfoot_data::packed;
use fleetfoot_data::setting::FIT;
use fleetfoot_model::{Latent, Model, RegionSummary};
use fleetfoot_report::{
    Cell, Light, Part, Table,
    words::{thousands, within},
};
use fleetfoot_stats::{Gram, student_t_95};

use crate::{fitting::Fit, limits::not_least_squares};

/// Coefficients of a region that stand unfolded, and terms and equations that are listed at most.
const SHOWN: usize = 12;
const TERMS: usize = 60;
const EQUATIONS: usize = 24;
/// Equations that have a table each; those of more stand side by side.
const BELOW: usize = 2;
/// Half the width of a 95 % interval in standard errors that are those of many rows.
const TWO_SIDED: f64 = 1.959_963_984_540_054;

/// The coefficients of a function in a region.
struct Known {
    /// Label of the function.
    label: String,
    /// Names and values of the terms, and half the widths of their intervals; NaN where that is not known.
    terms: Vec<(String, f64, f64)>,
    /// Confounded terms.
    confounded: Vec<String>,
}

/// Basis of the intervals.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Basis {
    /// Standard errors in the report of the fit.
    Report,
    /// The moments of the region's rows. The numbers are the independent rows, and the rows, if the report of the fit
    /// has them.
    Moments(Option<[f64; 2]>),
}

/// The coefficients of the equations of a region with their intervals; empty if neither the report of the fit nor the
/// model has them. `said`: the basis of intervals that the page has already explained.
pub(crate) fn parts(
    model: &Model,
    partition: usize,
    region: usize,
    fit: Option<&Fit>,
    printed: &mut Option<String>,
) -> Vec<Part> {
    if let Some(words) = not_least_squares(model, fit) {
        let parts =
            if printed.as_deref() == Some(words) { Vec::new() } else { vec![Part::Paragraph(words.to_owned())] };
        *printed = Some(words.to_owned());
        return parts;
    }
    let has_terms = |latent: &&Latent| !terms(model, latent, region).is_empty();
    let latents = model.latents.iter().filter(|latent| latent.partition == partition).filter(has_terms);
    let mut known: Vec<Known> = Vec::new();
    let mut bases: Vec<String> = Vec::new();
    let mut inverses = Inverses::new(&model.summaries[partition].regions[region]);
    for latent in latents {
        let equation = model.fitted().enumerate().find(|(_, one)| one.right.as_column() == Some(latent.name.as_str()));
        let label = equation.as_ref().map_or_else(|| latent.name.clone(), |(_, equation)| equation.label());
        let errors = fit.map_or_else(Vec::new, |fit| fit.standard_errors(&label, &latent.name, region));
        let mut half: Vec<f64> = terms(model, latent, region)
            .iter()
            .map(|(name, _)| {
                errors.iter().find(|(function, _)| function == name).map_or(f64::NAN, |(_, error)| TWO_SIDED * error)
            })
            .collect();
        let mut basis = Basis::Report;
        if let (true, Some((target, _))) = (errors.is_empty(), equation) {
            let independent = fit.and_then(Fit::independent);
            basis = Basis::Moments(independent);
            let share = independent.map_or(1.0, |[rows, independent]| independent / rows);
            half = inverses.half_widths(model, latent, region, target, share);
        }
        let words = basis.in_words();
        if !bases.contains(&words) {
            bases.push(words);
        }
        let terms: Vec<_> = terms(model, latent, region)
            .into_iter()
            .zip(half)
            .map(|((name, value), half)| (name, value, half))
            .collect();
        known.push(Known { confounded: confounded(model, latent, region), label, terms });
    }
    known.retain(|one| one.terms.iter().any(|(_, _, half)| !half.is_nan()));
    let total: usize = known.iter().map(|one| one.terms.len()).sum();
    if total == 0 {
        return Vec::new();
    }
    let words = bases.join(" ");
    let mut parts: Vec<Part> =
        if printed.as_ref() == Some(&words) { Vec::new() } else { vec![Part::Paragraph(words.clone())] };
    *printed = Some(words);
    if known.len() > BELOW {
        parts.push(Part::Table(side_by_side(&known)));
    } else {
        parts.extend(known.iter().map(|one| Part::Table(one.table())));
    }
    if total > SHOWN { vec![Part::Fold(format!("95 % intervals of its {total} coefficients"), parts)] } else { parts }
}

/// Estimated numbers inside the equations; nothing where there are none.
pub(crate) fn parameters(model: &Model) -> Option<Part> {
    let estimated = &model.training.parameters;
    let mut table =
        Table::new("Parameters that were estimated, with their 95 % intervals.", ["parameter", "value", HEAD[2]]);
    for parameter in estimated {
        let given = parameter.half_width == 0.0;
        let (light, words) =
            if given { (Light::Plain, "given") } else { verdict(parameter.value, parameter.half_width) };
        table = table.row([
            Cell::Text(parameter.name.clone()),
            Cell::Number(within(parameter.value, if given { f64::NAN } else { parameter.half_width })),
            Cell::Light(light, words.to_owned()),
        ]);
    }
    (!estimated.is_empty()).then_some(Part::Table(table))
}

const HEAD: [&str; 3] = ["term", "coefficient", "differs from zero"];

/// The terms of a function in a region with their coefficients, the constant first.
fn terms(model: &Model, latent: &Latent, region: usize) -> Vec<(String, f64)> {
    let all = model.terms_for_people(latent, region).into_iter();
    let named =
        all.map(|(function, value)| (function.map_or_else(|| "1".to_owned(), |function| function.to_string()), value));
    named.filter(|(_, value)| *value != 0.0).collect()
}

/// Returns true if a partition's statistics are about the functions of a latent.
fn is_described(model: &Model, latent: &Latent) -> bool {
    let first = model.latents.iter().find(|other| other.partition == latent.partition);
    first.is_some_and(|first| first.library == latent.library)
}

/// Confounded terms of a region.
fn confounded(model: &Model, latent: &Latent, region: usize) -> Vec<String> {
    let groups = &model.summaries[latent.partition].regions[region].confounded;
    let functions = &model.libraries[latent.library];
    let name = |&function: &usize| functions.get(function).map(ToString::to_string);
    if is_described(model, latent) { groups.iter().flatten().filter_map(name).collect() } else { Vec::new() }
}

impl Basis {
    fn in_words(self) -> String {
        let given = "given that these are the terms";
        match self {
            Self::Report => format!(
                "95 % intervals, {given}, by the spread between parts of the logs, as the report of the fit has them."
            ),
            Self::Moments(Some([rows, independent])) => format!(
                "95 % intervals of least squares, {given}; {} of {} rows count as independent.",
                thousands(independent.round() as u64),
                thousands(rows as u64)
            ),
            Self::Moments(None) => format!(
                "95 % intervals of least squares, {given}, as if the errors of the rows were independent: they are too narrow where an error lasts over several rows. \
                 The report of the fit ({FIT}) knows over how many."
            ),
        }
    }
}

impl Known {
    fn table(&self) -> Table {
        let mut table = Table::new(format!("{}{}", self.label, beyond(self.terms.len(), TERMS, "terms")), HEAD);
        for (name, value, half) in self.terms.iter().take(TERMS) {
            let (light, words) = self.verdict(name, *value, *half);
            let light = Cell::Light(light, words.to_owned());
            table = table.row([named(name), Cell::Number(within(*value, *half)), light]);
        }
        table
    }

    /// Verdict on a coefficient: different from zero, or not.
    fn verdict(&self, name: &str, value: f64, half: f64) -> (Light, &'static str) {
        match half {
            _ if self.confounded.iter().any(|function| function == name) => {
                (Light::Bad, "not separable from other terms")
            }
            half => verdict(value, half),
        }
    }

    /// The coefficient of a term with its interval in one cell; a sign marks one that is not distinct from zero, or
    /// from other terms.
    fn cell(&self, name: &str) -> Cell {
        let term = self.terms.iter().find(|(function, _, _)| function == name);
        let Some((_, value, half)) = term else { return Cell::Number(String::new()) };
        let sign = match self.verdict(name, *value, *half).0 {
            Light::Good | Light::Plain => String::new(),
            light => format!(" {}", light.sign()),
        };
        Cell::Number(format!("{}{sign}", within(*value, *half)))
    }
}

/// The terms of all equations of a region, a column an equation.
fn side_by_side(known: &[Known]) -> Table {
    let mut names: Vec<&str> = Vec::new();
    for (name, _, _) in known.iter().flat_map(|one| &one.terms) {
        if !names.contains(&name.as_str()) {
            names.push(name);
        }
    }
    let shown = &known[..known.len().min(EQUATIONS)];
    let caption = format!(
        "Coefficients. {} zero lies within the interval, {} not determined, or not separable from other terms.{}{}",
        Light::Doubtful.sign(),
        Light::Bad.sign(),
        beyond(names.len(), TERMS, "terms"),
        beyond(known.len(), EQUATIONS, "equations")
    );
    let head = std::iter::once("term".to_owned()).chain(shown.iter().map(|one| one.label.clone()));
    names.iter().take(TERMS).fold(Table::new(caption, head), |table, name| {
        table.row(std::iter::once(named(name)).chain(shown.iter().map(|one| one.cell(name))))
    })
}

/// Sentence about the number of rows that a table leaves out; empty if none.
fn beyond(all: usize, shown: usize, what: &str) -> String {
    if all > shown { format!(" Shown are {shown} of {all} {what}.") } else { String::new() }
}

fn named(term: &str) -> Cell {
    Cell::Text(if term == "1" { "constant" } else { term }.to_owned())
}

/// Verdict on a number: different from zero, or not.
fn verdict(value: f64, half: f64) -> (Light, &'static str) {
    match half {
        half if half.is_infinite() => (Light::Bad, "not determined"),
        half if half.is_nan() => (Light::Plain, "not known"),
        half if value.abs() > half => (Light::Good, "yes"),
        _ => (Light::Doubtful, "no"),
    }
}

/// Inverses of the moments of a region's rows, for the functions that equations use: those of a partition often share them.
struct Inverses<'a> {
    region: &'a RegionSummary,
    known: Vec<(Vec<usize>, bool, Vec<f64>)>,
}

impl<'a> Inverses<'a> {
    fn new(region: &'a RegionSummary) -> Self {
        Self { region, known: Vec::new() }
    }

    /// Half the widths of the intervals of the terms of an equation, the constant first. They are
    /// `t s sqrt(diag((X'X)^-1))` with the variance of the residuals `s^2` by their degrees of freedom; a share of the
    /// rows counts as independent. NaN if the model does not have the moments.
    fn half_widths(&mut self, model: &Model, latent: &Latent, region: usize, target: usize, share: f64) -> Vec<f64> {
        let support: Vec<usize> =
            (0..latent.map.features()).filter(|&j| latent.map.coefficient(region, j) != 0.0).collect();
        let constant = latent.map.constant(region) != 0.0;
        let count = support.len() + usize::from(constant);
        let region = self.region;
        let variance = region.residual_covariance.get(packed(target, target)).copied();
        let (Some(variance), true) = (variance, is_described(model, latent)) else { return vec![f64::NAN; count] };
        let Some(freedom) = (region.rows as usize).checked_sub(count).filter(|freedom| *freedom > 0) else {
            return vec![if variance.is_nan() { f64::NAN } else { f64::INFINITY }; count];
        };
        let square = variance * region.rows as f64 / freedom as f64;
        let independent = (region.rows as f64 * share) as usize;
        let t = student_t_95(independent.saturating_sub(count).max(1));
        self.diagonal(support, constant).iter().map(|inverse| t * (square * inverse / share).sqrt()).collect()
    }

    /// The diagonal of `(X'X)^-1`, that of the constant first.
    fn diagonal(&mut self, support: Vec<usize>, constant: bool) -> &[f64] {
        let place = self.known.iter().position(|(indices, with, _)| *indices == support && *with == constant);
        let place = place.unwrap_or_else(|| {
            let diagonal = inverse_diagonal(self.region, &support, constant);
            self.known.push((support, constant, diagonal));
            self.known.len() - 1
        });
        &self.known[place].2
    }
}

/// The diagonal of `(X'X)^-1` for some functions over a region's rows, that of the constant first. Infinite if a
/// function does not vary or depends on others, NaN if the moments are unknown.
fn inverse_diagonal(region: &RegionSummary, support: &[usize], constant: bool) -> Vec<f64> {
    let first = usize::from(constant);
    let mean = |j: usize| region.mean.get(support[j]).copied().unwrap_or(f64::NAN);
    let centred = |i: usize, j: usize| {
        region
            .covariance
            .get(packed(support[i].max(support[j]), support[i].min(support[j])))
            .copied()
            .unwrap_or(f64::NAN)
    };
    let raw = |i: usize, j: usize| centred(i, j) + mean(i) * mean(j);
    let slopes = match constant {
        true => inverses(region.rows, support.len(), centred),
        false => inverses(region.rows, support.len(), raw),
    };
    // That of the constant is one of the moments about zero, in which it is a column of ones.
    let with_ones = |i: usize, j: usize| match (i, j) {
        (0, 0) => 1.0,
        (0, j) => mean(j - 1),
        (i, 0) => mean(i - 1),
        (i, j) => raw(i - 1, j - 1),
    };
    let whole = if constant { inverses(region.rows, support.len() + 1, with_ones) } else { Vec::new() };
    whole.into_iter().take(first).chain(slopes).collect()
}

/// The diagonal of the inverse of `rows * moments`, by the inflation that each column's variance has.
fn inverses(rows: u64, count: usize, moments: impl Fn(usize, usize) -> f64) -> Vec<f64> {
    let mut gram = Gram::new(count);
    (gram.rows, gram.weight) = (rows, rows as f64);
    for i in 0..count {
        for j in 0..=i {
            gram.scatter[packed(i, j)] = moments(i, j) * gram.weight;
        }
    }
    if gram.scatter.iter().any(|value| !value.is_finite()) {
        return vec![f64::NAN; count];
    }
    let mut inverse = vec![f64::INFINITY; count];
    if let Some(collinearity) = gram.collinearity() {
        for (&column, &inflation) in collinearity.columns.iter().zip(&collinearity.inflation) {
            inverse[column] = inflation / gram.scatter[packed(column, column)];
        }
    }
    inverse
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Moments of rows as a region has them.
    fn region(columns: &[Vec<f64>]) -> RegionSummary {
        let n = columns[0].len() as f64;
        let mean: Vec<f64> = columns.iter().map(|column| column.iter().sum::<f64>() / n).collect();
        let product = |i: usize, j: usize| {
            columns[i].iter().zip(&columns[j]).map(|(a, b)| (a - mean[i]) * (b - mean[j])).sum::<f64>() / n
        };
        let covariance = (0..columns.len()).flat_map(|i| (0..=i).map(move |j| (i, j))).map(|(i, j)| product(i, j));
        RegionSummary {
            name: "all".into(),
            rows: columns[0].len() as u64,
            covariance: covariance.collect(),
            range: vec![[0.0, 1.0]; columns.len()],
            residual_covariance: vec![1.0],
            rank: columns.len(),
            condition: 1.0,
            confounded: Vec::new(),
            mean,
        }
    }

    /// The inverse of `X'X` by its adjugate, for up to three columns.
    fn exact(columns: &[Vec<f64>]) -> Vec<f64> {
        let p = columns.len();
        let m = |i: usize, j: usize| -> f64 {
            if i < p && j < p {
                columns[i].iter().zip(&columns[j]).map(|(a, b)| a * b).sum()
            } else {
                f64::from(u8::from(i == j))
            }
        };
        let minor = |i: usize, j: usize| m(i, i) * m(j, j) - m(i, j) * m(j, i);
        let determinant = m(0, 0) * minor(1, 2) - m(0, 1) * (m(1, 0) * m(2, 2) - m(1, 2) * m(2, 0))
            + m(0, 2) * (m(1, 0) * m(2, 1) - m(1, 1) * m(2, 0));
        [minor(1, 2), minor(0, 2), minor(0, 1)][..p].iter().map(|minor| minor / determinant).collect()
    }

    #[test]
    fn inverses_match_rows() {
        let wave = |k: f64, shift: f64| (0..50).map(|row| (k * f64::from(row)).sin() + shift).collect::<Vec<f64>>();
        let (a, b, ones) = (wave(0.7, 3.0), wave(1.9, -0.4), vec![1.0; 50]);
        let summary = region(&[a.clone(), b.clone()]);
        for (support, constant, columns) in [
            (vec![0, 1], true, vec![ones.clone(), a.clone(), b.clone()]),
            (vec![1], true, vec![ones.clone(), b.clone()]),
            (vec![0, 1], false, vec![a.clone(), b.clone()]),
            (vec![], true, vec![ones.clone()]),
        ] {
            let (variances, exact) = (inverse_diagonal(&summary, &support, constant), exact(&columns));
            assert_eq!(variances.len(), exact.len());
            for (variance, exact) in variances.iter().zip(&exact) {
                assert!((variance / exact - 1.0).abs() < 1e-11, "{support:?} {constant}: {variance} {exact}");
            }
        }
        // A column that equals another, or is constant beside a constant, is not determined; a column without measurements is not known.
        let same = inverse_diagonal(&region(&[a.clone(), a.clone()]), &[0, 1], true);
        assert!(same[1..].iter().all(|value| *value > 1e10), "{same:?}");
        assert_eq!(inverse_diagonal(&region(&[vec![2.5; 50]]), &[0], true)[1], f64::INFINITY);
        let mut unknown = summary;
        unknown.covariance.fill(f64::NAN);
        assert!(inverse_diagonal(&unknown, &[0], true)[1].is_nan());
    }
}
