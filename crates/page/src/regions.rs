//! Regions, and the coefficients that their rows determine.

use fleetfoot_model::{Model, Partition, Rule};
use fleetfoot_report::{
    Cell, Light, Part, Sentence, Table,
    words::{number, series, thousands},
};

use crate::{
    condition::{CONDITION, condition, used},
    sentence::sentence,
};

/// Rows a coefficient that a region has at least, else its coefficients are little more than its noise.
const ROWS: u64 = 10;
/// Regions that are shown unfolded, the largest first, and whose equations are written: a model of hundreds of regions has its file.
pub(crate) const SHOWN: usize = 8;

/// Verdict on a region: do its rows determine the coefficients?
pub(crate) struct Determined {
    pub(crate) light: Light,
    pub(crate) words: String,
    /// Advice on the motion to record, as a remedy.
    mend: Option<String>,
}

pub(crate) fn determined(model: &Model, partition: usize, region: usize) -> Determined {
    let info = &model.summaries[partition].regions[region];
    let alone = model.summaries[partition].regions.len() == 1;
    let of = match (alone, named(model, partition)) {
        (true, names) if names.is_empty() => String::new(),
        (true, names) => format!("{names}: "),
        (false, _) => format!("region {}: ", info.name),
    };
    let used = used(model, partition, region);
    let first = model.latents.iter().find(|latent| latent.partition == partition);
    let name = |function: &usize| {
        first
            .and_then(|latent| model.libraries[latent.library].get(*function))
            .map(ToString::to_string)
            .unwrap_or_default()
    };
    let group = info.confounded.iter().find(|group| group.iter().any(|function| used.contains(function)));
    if let Some(group) = group {
        let names: Vec<String> = group.iter().map(name).collect();
        return Determined {
            light: Light::Bad,
            words: format!("cannot separate {}", series(&names, 4)),
            mend: Some(format!("{of}rows in which {} do not move together", series(&names, 4))),
        };
    }
    let needed = ROWS * (used.len() as u64 + 1);
    if info.rows < needed {
        let words = format!("few rows: {} for {} coefficients", info.rows, used.len() + 1);
        let mend = format!("{of}more rows (it has {})", thousands(info.rows));
        return Determined { light: Light::Doubtful, words, mend: Some(mend) };
    }
    let condition = condition(model, partition, region);
    if condition >= CONDITION {
        let words = "columns nearly move together".to_owned();
        let mend = format!("{of}more varied motion (condition {})", number(condition));
        return Determined { light: Light::Doubtful, words, mend: Some(mend) };
    }
    if condition.is_nan() {
        return Determined { light: Light::Plain, words: "not known".into(), mend: None };
    }
    Determined { light: Light::Good, words: "determined".into(), mend: None }
}

/// Names of the functions of a partition, if the model has several such partitions; else empty.
fn named(model: &Model, partition: usize) -> String {
    let names: Vec<String> =
        model.latents.iter().filter(|latent| latent.partition == partition).map(|latent| latent.name.clone()).collect();
    if model.latents.iter().all(|latent| latent.partition == partition) { String::new() } else { series(&names, 4) }
}

/// All regions that are fitted: partition and region.
fn all(model: &Model) -> impl Iterator<Item = (usize, usize)> {
    let fitted = |partition: &usize| model.latents.iter().any(|latent| latent.partition == *partition);
    let partitions = (0..model.partitions.len()).filter(fitted);
    partitions
        .flat_map(|partition| (0..model.summaries[partition].regions.len()).map(move |region| (partition, region)))
}

/// Sentence about rows that do or do not determine the coefficients, and the motion to record next.
pub(crate) fn finding(model: &Model) -> Option<Sentence> {
    let verdicts: Vec<Determined> =
        all(model).map(|(partition, region)| determined(model, partition, region)).collect();
    if verdicts.is_empty() || verdicts.iter().all(|region| region.light == Light::Plain) {
        return None;
    }
    let condition = all(model).map(|(p, r)| condition(model, p, r)).fold(f64::NAN, f64::max);
    let mends: Vec<String> = verdicts.iter().filter_map(|region| region.mend.clone()).collect();
    let next = if mends.is_empty() { String::new() } else { format!(" What to drive next: {}.", series(&mends, 3)) };
    let number_of = |light| verdicts.iter().filter(|region| region.light == light).count();
    let (bad, doubtful, regions) = (number_of(Light::Bad), number_of(Light::Doubtful), verdicts.len());
    let whole = regions == 1;
    let (light, head) = match (bad, doubtful) {
        (0, 0) => (Light::Good, "The rows determine its coefficients.".to_owned()),
        (0, _) if whole => (Light::Doubtful, "The rows hardly determine some of its coefficients.".to_owned()),
        (0, _) => {
            (Light::Doubtful, format!("In {doubtful} of {regions} regions the rows hardly determine the coefficients."))
        }
        (_, _) if whole => (Light::Bad, "The rows do not determine all of its coefficients.".to_owned()),
        (_, _) => (Light::Bad, format!("In {bad} of {regions} regions the rows do not determine the coefficients.")),
    };
    let condition = if condition.is_nan() {
        String::new()
    } else {
        format!("The largest condition number of the standardised functions that it uses is {}.", number(condition))
    };
    Some(sentence(light, &head, format!("{condition}{next}").trim()))
}

/// The only region of a partition.
pub(crate) fn alone(model: &Model, partition: usize) -> String {
    let info = &model.summaries[partition].regions[0];
    let verdict = determined(model, partition, 0);
    let condition = condition(model, partition, 0);
    let condition = if condition.is_nan() { String::new() } else { format!(", condition {}", number(condition)) };
    let names = named(model, partition);
    format!(
        "{} holds everywhere: {} rows, rank {}{condition}; its coefficients: {}.",
        if names.is_empty() { "It".to_owned() } else { names },
        thousands(info.rows),
        info.rank,
        verdict.words
    )
}

/// The regions of a partition, the largest first: a table, the rest of it folded away.
pub(crate) fn tables(model: &Model, partition: usize) -> Vec<Part> {
    let described = &model.partitions[partition];
    let order = model.summaries[partition].by_size();
    let place_of = if matches!(described.rule, Rule::Tree(_)) { "where" } else { "where (sd from the middle)" };
    let table = |regions: &[usize]| {
        let mut table = Table::new(
            format!("Regions of {}, the largest first.", described.specification),
            ["region", "coefficients", "rows", "share", "rank", "condition", place_of],
        );
        for &region in regions {
            table = table.row(row(model, partition, region));
        }
        Part::Table(table)
    };
    let mut parts = vec![table(&order[..order.len().min(SHOWN)])];
    if order.len() > SHOWN {
        let rest = &order[SHOWN..];
        parts.push(Part::Fold(format!("{} smaller regions", rest.len()), vec![table(rest)]));
    }
    let rule = model.outside_in_words(partition);
    parts.extend(rule.map(|rule| Part::Paragraph(format!("Outside the training ranges of a region {rule}."))));
    parts
}

fn row(model: &Model, partition: usize, region: usize) -> Vec<Cell> {
    let summary = &model.summaries[partition];
    let info = &summary.regions[region];
    let total = summary.rows();
    let verdict = determined(model, partition, region);
    vec![
        Cell::Text(info.name.clone()),
        Cell::Light(verdict.light, verdict.words),
        Cell::Number(thousands(info.rows)),
        Cell::Number(format!("{:.1} %", 100.0 * info.rows as f64 / total.max(1) as f64)),
        Cell::Number(info.rank.to_string()),
        Cell::of(condition(model, partition, region)),
        Cell::Text(place(&model.partitions[partition], region)),
    ]
}

/// Place of a region: the box of a tree's, or the columns in which the centroid of a Voronoi cell is farthest from the
/// middle.
fn place(partition: &Partition, region: usize) -> String {
    if let Rule::Tree(tree) = &partition.rule {
        let bound = |(column, [low, high]): &(usize, [f64; 2])| {
            let name = partition.columns.get(*column).map_or_else(String::new, ToString::to_string);
            match (low.is_finite(), high.is_finite()) {
                (true, true) => format!("{} \u{2264} {name} < {}", number(*low), number(*high)),
                (true, false) => format!("{name} \u{2265} {}", number(*low)),
                _ => format!("{name} < {}", number(*high)),
            }
        };
        let sides = tree.boxes().into_iter().nth(region).unwrap_or_default();
        return sides.iter().map(bound).collect::<Vec<_>>().join(", ");
    }
    let Rule::Linear { weights, offsets } = &partition.rule else { return String::new() };
    let (Some(centroid), Some(offset)) = (weights.get(region), offsets.get(region)) else { return String::new() };
    let square: f64 = centroid.iter().map(|v| v * v).sum();
    // Learned separators are no centroids.
    if (offset + 0.5 * square).abs() > 1e-9 * square.max(1.0) {
        return String::new();
    }
    let mut order: Vec<usize> = (0..centroid.len().min(partition.columns.len())).collect();
    order.sort_by(|&a, &b| centroid[b].abs().total_cmp(&centroid[a].abs()).then(a.cmp(&b)));
    let coordinates = order.iter().take(2).map(|&c| format!("{} {}", partition.columns[c], signed(centroid[c])));
    coordinates.collect::<Vec<_>>().join(", ")
}

fn signed(value: f64) -> String {
    format!("{}{:.2}", if value < 0.0 { '\u{2212}' } else { '+' }, value.abs())
}
