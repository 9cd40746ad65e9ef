//! Arrays for NumPy: the model's numbers, by name.
//!
//! The format of `.npy` is that of NumPy's `numpy.lib.format`, version 1.0: a magic, a header that is a Python literal, the values.

use fleetfoot_model::{Cut, Model, Partition, Rule, Summary, UnseenLabel};

use crate::{
    ExportOptions, ExportedFile,
    transitions::{Values, tables as transition_tables},
    zip::archive,
};

/// The file `prefix.npz`.
///
/// Per latent `latent/NAME/constants` (regions) and `latent/NAME/coefficients` (regions x functions) with the functions' texts in
/// `latent/NAME/functions`, the number of its partition, and in `latent/NAME/beyond` the coefficients outside of training ranges, where it has any; per partition `partition/N/...` its columns, centres, scales and weights, per
/// label where it has labels; of a tree the cuts' columns and thresholds, and what follows below and above: a cut, or `-1 - region`; where transitions were counted
/// `partition/N/transitions/count` and `.../probability` (regions x regions, from the row to the column) and `.../dwell` (rows); along a phase `partition/N/phase/rows` and
/// `.../share` (bins x regions) and `.../transition_count` (bins x regions x regions), from stride to stride `partition/N/stride/count` and `.../probability`, and
/// `partition/N/pairs/p` where pairs of regions were told apart.
pub(crate) fn file(model: &Model, options: &ExportOptions) -> ExportedFile {
    let mut arrays = Arrays::default();
    let texts = |values: Vec<String>| values;
    arrays.strings("hash", &[model.hash()]);
    arrays.strings("method", std::slice::from_ref(&model.method));
    arrays.reals("step", &[model.step], &[]);
    let columns = &model.columns;
    arrays.strings("columns/names", &texts(columns.iter().map(|column| column.name.clone()).collect()));
    arrays.strings(
        "columns/units",
        &texts(columns.iter().map(|column| column.unit.clone().unwrap_or_default()).collect()),
    );
    arrays.strings(
        "columns/roles",
        &texts(columns.iter().map(|column| format!("{:?}", column.role).to_lowercase()).collect()),
    );
    arrays.strings("equations/left", &texts(model.equations.iter().map(|equation| equation.label()).collect()));
    arrays.strings(
        "equations/right",
        &texts(model.equations.iter().map(|equation| equation.right.to_string()).collect()),
    );
    arrays.strings("latents", &texts(model.latents.iter().map(|latent| latent.name.clone()).collect()));
    for (index, latent) in model.latents.iter().enumerate() {
        let functions = &model.libraries[latent.library];
        let name = |what: &str| format!("latent/{index}/{what}");
        for array in latent.map.arrays() {
            arrays.reals(&name(&array.name), &array.values, &array.shape);
        }
        if !latent.beyond.is_empty() {
            arrays.reals(&name("beyond"), &latent.beyond, &[latent.beyond.len()]);
        }
        arrays.strings(&name("functions"), &texts(functions.iter().map(ToString::to_string).collect()));
        arrays.integers(&name("partition"), &[latent.partition as i64], &[]);
    }
    for (index, partition) in model.partitions.iter().zip(&model.summaries).enumerate() {
        partition_arrays(&mut arrays, index, partition);
    }
    ExportedFile { name: format!("{}.npz", options.prefix), bytes: archive(&arrays.files) }
}

fn partition_arrays(arrays: &mut Arrays, index: usize, (partition, summary): (&Partition, &Summary)) {
    let name = |what: &str| format!("partition/{index}/{what}");
    let columns = partition.columns.len();
    arrays.strings(&name("specification"), std::slice::from_ref(&partition.specification));
    arrays.strings(&name("columns"), &partition.columns.iter().map(ToString::to_string).collect::<Vec<_>>());
    arrays.reals(&name("centre"), &partition.centre, &[columns]);
    arrays.reals(&name("scale"), &partition.scale, &[columns]);
    let regions = &summary.regions;
    arrays.strings(&name("regions"), &regions.iter().map(|region| region.name.clone()).collect::<Vec<_>>());
    let rows: Vec<i64> = regions.iter().map(|region| i64::try_from(region.rows).unwrap_or(i64::MAX)).collect();
    arrays.integers(&name("rows"), &rows, &[rows.len()]);
    let functions = regions.first().map_or(0, |region| region.range.len());
    if regions.iter().all(|region| region.range.len() == functions) {
        let ranges: Vec<f64> = regions.iter().flat_map(|region| region.range.iter().flatten().copied()).collect();
        arrays.reals(&name("ranges"), &ranges, &[regions.len(), functions, 2]);
    }
    rule_arrays(arrays, &name("rule"), &partition.rule, columns);
    for table in transition_tables(partition, 0.0) {
        match &table.values {
            Values::Counts(rows) => {
                let rows: Vec<i64> = rows.iter().map(|&rows| i64::try_from(rows).unwrap_or(i64::MAX)).collect();
                arrays.integers(&name(table.path), &rows, &table.shape());
            }
            Values::Reals(values) => arrays.reals(&name(table.path), values, &table.shape()),
        }
    }
    if let Some(phases) = &partition.phases {
        let bins: Vec<String> = (0..phases.bins.count()).map(|bin| phases.bins.name(bin)).collect();
        arrays.strings(&name("phase/bins"), &bins);
    }
}

fn rule_arrays(arrays: &mut Arrays, name: &str, rule: &Rule, columns: usize) {
    match rule {
        Rule::Whole => arrays.strings(&format!("{name}/kind"), &["whole".into()]),
        Rule::Ball { radius } => {
            arrays.strings(&format!("{name}/kind"), &["ball".into()]);
            arrays.reals(&format!("{name}/radius"), &[*radius], &[]);
        }
        Rule::Box { half } => {
            arrays.strings(&format!("{name}/kind"), &["box".into()]);
            arrays.reals(&format!("{name}/half"), &[*half], &[]);
        }
        Rule::Linear { weights, offsets } => {
            arrays.strings(&format!("{name}/kind"), &["linear".into()]);
            let all: Vec<f64> = weights.iter().flatten().copied().collect();
            arrays.reals(&format!("{name}/weights"), &all, &[weights.len(), columns]);
            arrays.reals(&format!("{name}/offsets"), offsets, &[offsets.len()]);
        }
        Rule::Joined { cells, regions } => {
            arrays.strings(&format!("{name}/kind"), &["joined".into()]);
            let regions: Vec<i64> = regions.iter().map(|&region| i64::from(region)).collect();
            arrays.integers(&format!("{name}/regions"), &regions, &[regions.len()]);
            rule_arrays(arrays, &format!("{name}/cells"), cells, columns);
        }
        Rule::Tree(tree) => {
            arrays.strings(&format!("{name}/kind"), &["tree".into()]);
            let all = |of: fn(&Cut) -> i64| tree.cuts.iter().map(of).collect::<Vec<i64>>();
            let thresholds: Vec<f64> = tree.cuts.iter().map(|cut| cut.threshold).collect();
            arrays.integers(&format!("{name}/column"), &all(|cut| cut.column as i64), &[tree.cuts.len()]);
            arrays.reals(&format!("{name}/threshold"), &thresholds, &[tree.cuts.len()]);
            arrays.integers(&format!("{name}/below"), &all(|cut| cut.below.code()), &[tree.cuts.len()]);
            arrays.integers(&format!("{name}/above"), &all(|cut| cut.above.code()), &[tree.cuts.len()]);
        }
        Rule::Labels { values, names, rules, unseen } => {
            let kind = if *unseen == UnseenLabel::Pool { "labels, others pooled" } else { "labels, others refused" };
            arrays.strings(&format!("{name}/kind"), &[kind.into()]);
            arrays.reals(&format!("{name}/values"), values, &[values.len()]);
            arrays.strings(&format!("{name}/names"), names);
            for (label, rule) in rules.iter().enumerate() {
                rule_arrays(arrays, &format!("{name}/{label}"), rule, columns.saturating_sub(1));
            }
        }
    }
}

/// Files of an archive.
#[derive(Default)]
struct Arrays {
    files: Vec<(String, Vec<u8>)>,
}

impl Arrays {
    fn add(&mut self, name: &str, kind: &str, shape: &[usize], values: impl Iterator<Item = u8>) {
        let sizes: String = shape.iter().map(|size| format!("{size},")).collect();
        let mut header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({sizes}), }}");
        // Magic, version and length take 10 bytes; the values begin at a multiple of 64.
        while (10 + header.len() + 1) % 64 != 0 {
            header.push(' ');
        }
        header.push('\n');
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(values);
        self.files.push((format!("{name}.npy"), bytes));
    }

    fn reals(&mut self, name: &str, values: &[f64], shape: &[usize]) {
        self.add(name, "<f8", shape, values.iter().flat_map(|value| value.to_le_bytes()));
    }

    fn integers(&mut self, name: &str, values: &[i64], shape: &[usize]) {
        self.add(name, "<i8", shape, values.iter().flat_map(|value| value.to_le_bytes()));
    }

    /// Texts as NumPy's fixed-width strings of 32-bit characters.
    fn strings(&mut self, name: &str, values: &[String]) {
        let width = values.iter().map(|text| text.chars().count()).max().unwrap_or(0).max(1);
        let characters =
            values.iter().flat_map(|text| text.chars().map(u32::from).chain(std::iter::repeat(0)).take(width));
        self.add(name, &format!("<U{width}"), &[values.len()], characters.flat_map(u32::to_le_bytes));
    }
}
