//! Definitions in the messages of a log: formats, units, factors, parameters.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt::Write,
};

use fleetfoot_message::dataflash_letter;

use super::format::{FMT, Form, Format, Formats, HEAD, INSTANCE, TIME, bytes_of, number_in, text_in, time};
use crate::container::{SchemaRecord, Topic};

/// The name of message and schema encoding.
const ENCODING: &str = "dataflash";

/// All that a log defines.
#[derive(Debug)]
pub(super) struct Definitions {
    pub(super) formats: Formats,
    units: BTreeMap<u8, String>,
    factors: BTreeMap<u8, f64>,
    /// Parameters, with the time of each message; defaults.
    parameters: BTreeMap<String, Vec<(i64, String)>>,
    defaults: BTreeMap<String, String>,
    pub(super) notes: BTreeSet<String>,
}

impl Definitions {
    pub(super) fn new(form: Form) -> Self {
        Self {
            formats: Formats::new(form),
            units: BTreeMap::new(),
            factors: BTreeMap::new(),
            parameters: BTreeMap::new(),
            defaults: BTreeMap::new(),
            notes: BTreeSet::new(),
        }
    }

    /// Takes in what a message defines, where it does.
    pub(super) fn add(&mut self, kind: u8, payload: &[u8]) {
        let Some(format) = self.formats.get(kind) else { return };
        let text = |name: &str| text_of(format, payload, name);
        let number = |name: &str| number_of(format, payload, name);
        let byte = |name: &str| number(name).filter(|value| (0.0..256.0).contains(value)).map(|value| value as u8);
        match format.name.as_str() {
            "FMT" => {
                let words = (byte("Type"), byte("Length"), text("Name"), text("Format"), text("Columns"));
                if let (Some(kind), Some(length), Some(name), Some(letters), Some(columns)) = words {
                    self.add_format(kind, length.into(), &name, &letters, &columns);
                }
            }
            "FMTU" => {
                let (kind, units, factors) = (byte("FmtType"), text("UnitIds"), text("MultIds"));
                let format_of_kind = kind.and_then(|kind| self.formats.all.get_mut(usize::from(kind))?.as_mut());
                if let Some(format_of_kind) = format_of_kind {
                    format_of_kind.units = units.unwrap_or_default().into_bytes();
                    format_of_kind.factors = factors.unwrap_or_default().into_bytes();
                    format_of_kind.instance = format_of_kind
                        .units
                        .iter()
                        .position(|&unit| unit == INSTANCE)
                        .and_then(|place| format_of_kind.at(place));
                }
            }
            "UNIT" => {
                if let (Some(letter), Some(unit)) = (byte("Id"), text("Label")) {
                    self.units.insert(letter, unit);
                }
            }
            "MULT" => {
                // The writer has them as four bytes, and logs eight.
                let factor = number("Mult").and_then(|factor| format!("{factor:.6e}").parse().ok());
                if let (Some(letter), Some(factor)) = (byte("Id"), factor) {
                    self.factors.insert(letter, factor);
                }
            }
            "PARM" => {
                let Some(name) = text("Name").filter(|name| !name.is_empty()) else { return };
                let written = |name: &str| written(format, payload, name);
                let (value, default) = (written("Value"), written("Default"));
                let when = format.clock.and_then(|(clock, unit)| time(payload, clock, unit)).unwrap_or(0);
                if let Some(default) = default.filter(|default| default != "NaN") {
                    self.defaults.insert(name.clone(), default);
                }
                let values = self.parameters.entry(name).or_default();
                if let Some(value) = value.filter(|value| values.last().is_none_or(|(_, last)| last != value)) {
                    values.push((when, value));
                }
            }
            _ => {}
        }
    }

    fn add_format(&mut self, kind: u8, length: usize, name: &str, letters: &str, columns: &str) {
        let sound = !name.is_empty() && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_');
        let Some(length) = length.checked_sub(HEAD).filter(|_| sound && kind != FMT) else { return };
        let new = Format::new(self.formats.form, name, letters, columns, length);
        let Some(place) = self.formats.all.get_mut(usize::from(kind)) else { return };
        match place {
            None => {
                self.formats.names.entry(new.name.clone()).or_insert(kind);
                *place = Some(new);
            }
            Some(known_format) => {
                let same = (&known_format.name, &known_format.original, &known_format.columns)
                    == (&new.name, &new.original, &new.columns);
                if !same {
                    self.notes.insert(format!(
                        "the type {kind} is defined twice, as `{}` and as `{}`: the first is used",
                        known_format.name, new.name
                    ));
                }
            }
        }
    }

    /// A topic of messages of a type.
    pub(super) fn topic(&self, format: &Format, name: String, count: u64) -> Topic {
        let schema = format.problem.is_none().then(|| SchemaRecord {
            name: format.name.clone(),
            encoding: ENCODING.to_owned(),
            data: self.schema(format).into_bytes().into(),
        });
        Topic {
            name,
            type_name: format.name.clone(),
            message_encoding: ENCODING.to_owned(),
            schema,
            count: Some(count),
            problem: format.problem.clone(),
        }
    }

    /// A line a field: name, letter, factor, unit.
    fn schema(&self, format: &Format) -> String {
        let mut text = String::new();
        for (place, (name, &letter)) in format.columns.iter().zip(&format.letters).enumerate() {
            let of_letter = format.original.get(place).and_then(|&letter| dataflash_letter(letter)?.1);
            let is_clock = TIME.iter().any(|(clock, _)| clock == name);
            let factor = format.factors.get(place).and_then(|letter| self.factors.get(letter));
            // A factor of zero says that there is none. The clock stays in the unit of its name.
            let factor = factor.filter(|&&factor| of_letter.is_none() && !is_clock && factor != 0.0 && factor != 1.0);
            let factor = factor.map(f64::to_string).unwrap_or_default();
            let unit = format.units.get(place).filter(|&&letter| letter != INSTANCE && letter != b'-');
            let unit = unit.and_then(|letter| self.units.get(letter)).map(String::as_str).unwrap_or_default();
            let unit = if is_clock { name.trim_start_matches("Time").to_lowercase() } else { unit.trim().to_owned() };
            let _ = writeln!(text, "{name}\t{}\t{factor}\t{unit}", char::from(letter));
        }
        text
    }

    /// Parameters as metadata, as those of ULog: `parameter.NAME` with the first value, `changed.NAME` with the later ones and when they came,
    /// `default.system.NAME`.
    pub(super) fn metadata(&self) -> BTreeMap<String, String> {
        let mut pairs: BTreeMap<String, String> = BTreeMap::new();
        for (name, values) in &self.parameters {
            let Some(((_, first), later)) = values.split_first() else { continue };
            pairs.insert(format!("parameter.{name}"), first.clone());
            let later = later.iter().map(|(when, value)| format!("{value} from {} s", *when as f64 / 1e9));
            let later: Vec<String> = later.collect();
            if !later.is_empty() {
                pairs.insert(format!("changed.{name}"), later.join("; "));
            }
        }
        pairs.extend(self.defaults.iter().map(|(name, value)| (format!("default.system.{name}"), value.clone())));
        pairs
    }
}

fn text_of(format: &Format, payload: &[u8], name: &str) -> Option<String> {
    let field = format.field(name).filter(|field| matches!(field.letter, b'n' | b'N' | b'Z'))?;
    bytes_of(payload, field).map(text_in)
}

fn number_of(format: &Format, payload: &[u8], name: &str) -> Option<f64> {
    written(format, payload, name)?.parse().ok()
}

fn written(format: &Format, payload: &[u8], name: &str) -> Option<String> {
    let field = format.field(name)?;
    number_in(bytes_of(payload, field)?, field.letter)
}
