//! Excitation of the training rows: correlation of the functions that a model uses.

use std::collections::BTreeSet;

use fleetfoot_model::Model;
use fleetfoot_report::{
    Axis, Bars, Chart, Figure, Interval, Part,
    words::{count, number, series},
};
use fleetfoot_stats::Collinearity;

use crate::condition::{CONDITION, gram, used};

/// Functions that are drawn, and groups that are listed.
const FUNCTIONS: usize = 24;
const GROUPS: usize = 3;
/// A function belongs to weak directions that take more than this share of its coefficient's variance (Belsley, Kuh, Welsch, section 3.2).
const SHARE: f64 = 0.5;
/// From here on a standard error is inflated seriously: a variance tenfold (Marquardt, Technometrics 12, 1970).
const INFLATED: f64 = 3.162_277_660_168_379_5;

/// The functions of a partition that the model uses, and how they move together over all its regions.
struct Excitation {
    /// The functions that they make, where there are several in the model.
    of: String,
    names: Vec<String>,
    log_determinant: f64,
    collinearity: Collinearity,
}

/// Parts about the excitation of all partitions. Empty if the model does not know it, or every partition has one
/// function. `place` distinguishes the figures.
pub(crate) fn parts(model: &Model, place: usize) -> Vec<Part> {
    let all: Vec<Excitation> =
        (0..model.partitions.len()).filter_map(|partition| Excitation::of(model, partition)).collect();
    if all.iter().all(|excitation| excitation.names.len() < 2) {
        return Vec::new();
    }
    let several = all.len() > 1;
    let mut parts = vec![Part::Heading("Functions that the training rows separate".into())];
    parts.extend(all.iter().map(|excitation| Part::Paragraph(excitation.in_words(several))));
    parts.push(Part::Figure(figure(&all, place)));
    parts
}

impl Excitation {
    fn of(model: &Model, partition: usize) -> Option<Self> {
        let summary = &model.summaries[partition];
        let latents: Vec<_> = model.latents.iter().filter(|latent| latent.partition == partition).collect();
        let functions = &model.libraries[latents.first()?.library];
        let used = (0..summary.regions.len()).flat_map(|region| used(model, partition, region));
        let used: Vec<usize> = used.collect::<BTreeSet<usize>>().into_iter().collect();
        let parts = summary.regions.iter().filter_map(|region| gram(region, &used));
        let all = parts.reduce(|mut all, part| {
            all.merge(&part);
            all
        })?;
        Some(Self {
            of: series(&latents.iter().map(|latent| latent.name.clone()).collect::<Vec<_>>(), GROUPS),
            names: used.iter().map(|&function| functions[function].to_string()).collect(),
            log_determinant: all.log_determinant().value,
            collinearity: all.collinearity()?,
        })
    }

    fn in_words(&self, several: bool) -> String {
        let named = |columns: &[usize]| {
            series(&columns.iter().map(|&column| self.names[column].clone()).collect::<Vec<_>>(), 6)
        };
        let groups = self.collinearity.together(CONDITION, SHARE);
        let note = |group: &Vec<usize>| {
            format!(" {} nearly move together: the rows hardly separate their coefficients.", named(group))
        };
        let together = match groups.as_slice() {
            [] => " None of them moves so closely with the others that its coefficient is in doubt.".to_owned(),
            groups => groups.iter().take(GROUPS).map(note).collect(),
        };
        let still: Vec<usize> =
            (0..self.names.len()).filter(|column| !self.collinearity.columns.contains(column)).collect();
        let still =
            if still.is_empty() { String::new() } else { format!(" Constant over the rows: {}.", named(&still)) };
        let of = if several { format!("{}: ", self.of) } else { String::new() };
        let weakest = self.collinearity.index(self.collinearity.columns.len() - 1);
        format!(
            "{of}{} beside the constant, over all training rows.{together}{still} Condition {}, log-determinant of their covariance {} and of their correlations {} (0 where \
             no two move together).",
            count(self.names.len(), "function"),
            number(weakest),
            number(self.log_determinant),
            number(self.collinearity.log_determinant())
        )
    }

    /// Functions with the inflation of their coefficients' standard errors. `several`: true to name them with their
    /// latents.
    fn inflated(&self, several: bool) -> impl Iterator<Item = (String, f64)> {
        let name = move |&column: &usize| {
            if several { format!("{}: {}", self.of, self.names[column]) } else { self.names[column].clone() }
        };
        self.collinearity.columns.iter().map(name).zip(self.collinearity.inflation.iter().map(|factor| factor.sqrt()))
    }
}

/// Inflation of each standard error: its ratio to that of a function that moves alone.
fn figure(all: &[Excitation], place: usize) -> Figure {
    let mut inflated: Vec<(String, f64)> =
        all.iter().flat_map(|excitation| excitation.inflated(all.len() > 1)).collect();
    inflated.sort_by(|a, b| b.1.total_cmp(&a.1));
    let total = inflated.len();
    inflated.truncate(FUNCTIONS);
    let (groups, values): (Vec<String>, Vec<f64>) = inflated.into_iter().unzip();
    let values: Vec<Interval> =
        values.into_iter().map(|value| Interval { value, low: f64::NAN, high: f64::NAN }).collect();
    let mut chart =
        Bars::new(Axis::of("inflation of the standard error", ""), groups, vec![("inflation".into(), values)]);
    chart.level = Some((INFLATED, "serious".to_owned()));
    let more =
        if total > FUNCTIONS { format!(" Shown are the {FUNCTIONS} largest of {total}.") } else { String::new() };
    let of = |excitation: &Excitation| {
        excitation
            .collinearity
            .eigenvalues
            .iter()
            .rev()
            .take(4)
            .map(|&value| number(value))
            .collect::<Vec<_>>()
            .join(", ")
    };
    let eigenvalues: Vec<String> = all.iter().map(of).collect();
    let caption = format!(
        "Factor by which collinearity increases the standard error of each coefficient; 1 is best. From {INFLATED:.1} on, a variance tenfold, coefficients are traded for one \
         another: drive so that the functions move apart. Least eigenvalues of the correlations: {}.{more}",
        eigenvalues.join("; ")
    );
    Figure::new(format!("excitation-{place}"), "Separation of the functions", caption, Chart::Bars(chart))
}
