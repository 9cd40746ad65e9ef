//! The figures as Parquet.

use std::path::Path;

use fleetfoot::{
    Halo, Source,
    data::MemorySource,
    output::{ParquetWriter, Values, WriteColumn, WriteKind, WriteOptions},
    sim::plant::aircraft::Latent,
};

use super::{Failure, errors::Errors, hidden::Hidden, latents::Rows, selection::Aircraft};

/// Latent and function of every coefficient.
pub(crate) fn functions() -> Vec<(&'static str, String)> {
    Latent::ALL
        .iter()
        .flat_map(|latent| latent.features().into_iter().map(|feature| (latent.name(), feature)))
        .collect()
}

/// Figure 2: one row an aircraft and function.
pub(crate) fn frequencies(path: &Path, fleet: &[Aircraft]) -> Result<(), Failure> {
    let float = |name: &str| WriteColumn::new(name, WriteKind::Float);
    let columns = vec![
        WriteColumn::new("aircraft", WriteKind::Integer),
        WriteColumn::new("latent", WriteKind::Text),
        WriteColumn::new("function", WriteKind::Text),
        float("frequency"),
        WriteColumn::new("selected", WriteKind::Boolean),
        float("coefficient"),
        float("true_coefficient"),
        float("lambda"),
    ];
    let mut writer = ParquetWriter::create(path, columns, &WriteOptions::default())?;
    let functions = functions();
    let latents: Vec<&str> = functions.iter().map(|(latent, _)| *latent).collect();
    let texts: Vec<&str> = functions.iter().map(|(_, text)| text.as_str()).collect();
    for aircraft in fleet {
        let p = functions.len();
        let selected: Vec<bool> = (0..p).map(|j| aircraft.selection.support.contains(&j)).collect();
        writer.write(&[
            Values::Integer(&vec![i64::from(aircraft.number); p]),
            Values::Text(&latents),
            Values::Text(&texts),
            Values::Float(&aircraft.selection.frequency),
            Values::Boolean(&selected),
            Values::Float(&aircraft.theta),
            Values::Float(&aircraft.truth),
            Values::Float(&vec![aircraft.lambda; p]),
        ])?;
    }
    Ok(writer.finish()?)
}

/// Figure 3: one row a flight.
pub(crate) fn errors(path: &Path, errors: &Errors) -> Result<(), Failure> {
    let mut columns = vec![WriteColumn::new("flight", WriteKind::Text)];
    for method in ["bolasso", "nonlinear"] {
        for (name, unit) in [("V_dot", "m^2/s^4"), ("gamma_dot", "rad^2/s^2"), ("m_dot", "kg^2/s^2")] {
            columns.push(WriteColumn::new(format!("{method}_{name}"), WriteKind::Float).with_unit(unit));
        }
    }
    let mut writer = ParquetWriter::create(path, columns, &WriteOptions::default())?;
    let names: Vec<&str> = errors.flights.iter().map(|left| left.flight.as_str()).collect();
    let bolasso = |k: usize| errors.flights.iter().map(|left| left.bolasso[k]).collect::<Vec<f64>>();
    let nonlinear =
        |k: usize| errors.flights.iter().map(|left| left.nonlinear.map_or(f64::NAN, |e| e[k])).collect::<Vec<f64>>();
    let values: Vec<Vec<f64>> = (0..3).map(bolasso).chain((0..3).map(nonlinear)).collect();
    let mut all = vec![Values::Text(&names)];
    all.extend(values.iter().map(|values| Values::Float(values)));
    writer.write(&all)?;
    Ok(writer.finish()?)
}

/// Figure 5: latents along one flight, one row a second and method; the truth is a method too.
pub(crate) fn latents(path: &Path, source: &MemorySource, flight: usize, estimates: &[Hidden]) -> Result<(), Failure> {
    let block = source.read(flight, 0..source.episodes()[flight].rows, Halo::default())?;
    let rows = Rows { block: &block, columns: source.columns() };
    let seconds: Vec<f64> = block.stamps().iter().map(|&stamp| stamp as f64 * 1e-9).collect();
    let mut columns = vec![
        WriteColumn::new("method", WriteKind::Text),
        WriteColumn::new("t", WriteKind::Float).with_unit("s"),
        WriteColumn::new("h", WriteKind::Float).with_unit("m"),
    ];
    for (name, unit) in [("T", "N"), ("D", "N"), ("L", "N"), ("Isp", "m/s")] {
        columns.push(WriteColumn::new(name, WriteKind::Float).with_unit(unit));
    }
    let mut writer = ParquetWriter::create(path, columns, &WriteOptions::default())?;
    let height = rows.column("h")?;
    let mut write = |method: &str, latents: [&[f64]; 4]| {
        let name = vec![method; seconds.len()];
        let mut values = vec![Values::Text(&name), Values::Float(&seconds), Values::Float(height)];
        values.extend(latents.map(Values::Float));
        writer.write(&values)
    };
    write("truth", [rows.column("T")?, rows.column("D")?, rows.column("L")?, rows.column("Isp")?])?;
    for hidden in estimates {
        write(&hidden.method, std::array::from_fn(|k| hidden.shown[k].as_slice()))?;
    }
    Ok(writer.finish()?)
}
