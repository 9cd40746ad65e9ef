//! Models in files: JSON that reads back bit for bit.
//!
//! The file is `{"fleetfoot_model": 1, "checksum": "...", "model": {...}}`. Expressions are stored as their text, and
//! floats in the shortest form that reads back to the same bits. NaN and the infinities (which JSON lacks) are strings.
//! The checksum covers the canonical text of the content, so that a damaged or hand-edited file is refused instead of
//! being trusted.

mod latent;
mod marks;
mod phases;
mod rule;
mod training;

use std::path::{Path, PathBuf};

use fleetfoot_library::{Expr, Scope};
use serde::{Deserialize, Serialize};

use crate::{
    Column, Equation, Join, Lattice, Level, Model, Partition, Prediction, RegionSummary, ResidualCorrelation, Role,
    RotationKind, RotationPart, Summary, Transitions,
};
use latent::LatentText;
use phases::{PairText, PhasesText};
use rule::RuleText;
use training::TrainingText;

/// Version of the file format that this version writes and reads.
pub const FORMAT_VERSION: u32 = 1;

/// Why a model file was refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FileError {
    /// The file could not be read.
    #[error("{path}: cannot be read: {source}")]
    Io {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// Not JSON, cut off, or not of a model's shape.
    #[error("{name}: not a fleetfoot model: {source}; fit the model again, or restore the file from a copy")]
    Syntax {
        /// The file or other origin.
        name: String,
        /// Error of the parser, with line and column.
        source: serde_json::Error,
    },
    /// Another version of the format.
    #[error(
        "{name}: model format {version}, this version reads format {FORMAT_VERSION}; use the fleetfoot that wrote it, or fit again"
    )]
    Version {
        /// The file or other origin.
        name: String,
        /// The version in the file.
        version: u32,
    },
    /// The content differs from its checksum.
    #[error("{name}: the content does not match its checksum: the file was damaged or edited; fit the model again")]
    Checksum {
        /// The file or other origin.
        name: String,
    },
    /// The content contradicts itself.
    #[error("{name}: not a usable model: {problem}")]
    Invalid {
        /// The file or other origin.
        name: String,
        /// The contradiction.
        problem: String,
    },
}

impl Model {
    /// The model as JSON text.
    pub fn to_json(&self) -> String {
        let content = ModelText::from(self);
        // Serialising plain structs, numbers and strings cannot fail.
        let canonical = serde_json::to_string(&content).unwrap_or_default();
        let envelope = Envelope {
            fleetfoot_model: FORMAT_VERSION,
            checksum: blake3::hash(canonical.as_bytes()).to_hex().to_string(),
            model: content,
        };
        let mut text = serde_json::to_string_pretty(&envelope).unwrap_or_default();
        text.push('\n');
        text
    }

    /// Reads a model from JSON text; `name` is the origin, for messages.
    pub fn from_json(text: &str, name: &str) -> Result<Self, FileError> {
        #[derive(Deserialize)]
        struct Head {
            fleetfoot_model: u32,
        }
        let syntax = |source| FileError::Syntax { name: name.to_owned(), source };
        let head: Head = serde_json::from_str(text).map_err(syntax)?;
        if head.fleetfoot_model != FORMAT_VERSION {
            return Err(FileError::Version { name: name.to_owned(), version: head.fleetfoot_model });
        }
        let envelope: Envelope = serde_json::from_str(text).map_err(syntax)?;
        let canonical = serde_json::to_string(&envelope.model).map_err(syntax)?;
        if blake3::hash(canonical.as_bytes()).to_hex().as_str() != envelope.checksum {
            return Err(FileError::Checksum { name: name.to_owned() });
        }
        let invalid = |problem| FileError::Invalid { name: name.to_owned(), problem };
        let model = envelope.model.into_model().map_err(invalid)?;
        model.validate().map_err(invalid)?;
        Ok(model)
    }

    /// Reads a model from a file.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let bytes = std::fs::read(path).map_err(|source| FileError::Io { path: path.to_owned(), source })?;
        Self::from_json(&String::from_utf8_lossy(&bytes), &path.display().to_string())
    }

    /// A short hash that identifies the model.
    pub fn hash(&self) -> String {
        let canonical = serde_json::to_string(&ModelText::from(self)).unwrap_or_default();
        blake3::hash(canonical.as_bytes()).to_hex()[..16].to_owned()
    }
}

/// A float in JSON: a number, or one of the strings `nan`, `inf`, `-inf`.
#[derive(Clone, Copy)]
struct Real(f64);

impl Serialize for Real {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            v if v.is_finite() => serializer.serialize_f64(v),
            v if v.is_nan() => serializer.serialize_str("nan"),
            v if v > 0.0 => serializer.serialize_str("inf"),
            _ => serializer.serialize_str("-inf"),
        }
    }
}

impl<'de> Deserialize<'de> for Real {
    fn deserialize<D: serde::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Form {
            Number(f64),
            Text(String),
        }
        match Form::deserialize(deserializer)? {
            Form::Number(value) => Ok(Real(value)),
            Form::Text(text) => match text.as_str() {
                "nan" => Ok(Real(f64::NAN)),
                "inf" => Ok(Real(f64::INFINITY)),
                "-inf" => Ok(Real(f64::NEG_INFINITY)),
                other => Err(serde::de::Error::custom(format!("`{other}` is not a number"))),
            },
        }
    }
}

type Reals = Vec<Real>;

fn reals(values: &[f64]) -> Reals {
    values.iter().map(|&value| Real(value)).collect()
}

fn floats(values: Reals) -> Vec<f64> {
    values.into_iter().map(|value| value.0).collect()
}

fn rows(values: &[Vec<f64>]) -> Vec<Reals> {
    values.iter().map(|row| reals(row)).collect()
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Envelope {
    fleetfoot_model: u32,
    checksum: String,
    model: ModelText,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ModelText {
    method: String,
    step: Real,
    columns: Vec<ColumnText>,
    libraries: Vec<Vec<String>>,
    partitions: Vec<PartitionText>,
    latents: Vec<LatentText>,
    equations: Vec<EquationText>,
    training: TrainingText,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ColumnText {
    name: String,
    source: String,
    unit: Option<String>,
    role: String,
    angle: bool,
    /// The rotation, how it is written, and the part in it; of columns that are a part of one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    rotation: Option<(String, String, usize)>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PartitionText {
    specification: String,
    columns: Vec<String>,
    centre: Reals,
    scale: Reals,
    rule: RuleText,
    regions: Vec<RegionText>,
    /// Counts, from region to region; empty where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    transitions: Vec<Vec<u64>>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    phases: Option<PhasesText>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pairs: Vec<PairText>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lattice: Option<LatticeText>,
    /// Correlations of whitened residuals, lag by lag from 1 on; empty where there are none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    correlation: Vec<Reals>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LatticeText {
    /// Region that stands for both, region that is gone, training error then.
    joins: Vec<(u32, u32, Real)>,
    levels: Vec<LevelText>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct LevelText {
    regions: usize,
    training: Real,
    held_out: Real,
    standard_error: Real,
    bic: Real,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RegionText {
    name: String,
    rows: u64,
    mean: Reals,
    covariance: Reals,
    range: Vec<[Real; 2]>,
    residual_covariance: Reals,
    rank: usize,
    condition: Real,
    confounded: Vec<Vec<usize>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct EquationText {
    subject: String,
    prediction: String,
    right: String,
    target: Option<String>,
    unit: Option<String>,
}

const ROLES: [(Role, &str); 3] = [(Role::State, "state"), (Role::Input, "input"), (Role::Auxiliary, "auxiliary")];
const PREDICTIONS: [(Prediction, &str); 4] = [
    (Prediction::Derivative, "derivative"),
    (Prediction::Next, "next"),
    (Prediction::Difference, "delta"),
    (Prediction::Value, "value"),
];

fn word<T: Copy + PartialEq>(table: &[(T, &'static str)], value: T) -> String {
    table.iter().find(|(known, _)| *known == value).map(|(_, word)| (*word).to_owned()).unwrap_or_default()
}

fn value<T: Copy>(table: &[(T, &'static str)], word: &str) -> Result<T, String> {
    table
        .iter()
        .find(|(_, known)| *known == word)
        .map(|(value, _)| *value)
        .ok_or_else(|| format!("unknown word `{word}`"))
}

impl From<&Model> for ModelText {
    fn from(model: &Model) -> Self {
        Self {
            method: model.method.clone(),
            step: Real(model.step),
            columns: model.columns.iter().map(ColumnText::from).collect(),
            libraries: model.libraries.iter().map(|library| library.iter().map(Expr::to_string).collect()).collect(),
            partitions: model.partitions.iter().zip(&model.summaries).map(PartitionText::from).collect(),
            latents: latent::texts(&model.latents),
            equations: model.equations.iter().map(EquationText::from).collect(),
            training: TrainingText::from(&model.training),
        }
    }
}

impl ModelText {
    fn into_model(self) -> Result<Model, String> {
        let columns = self
            .columns
            .into_iter()
            .map(|c| {
                Ok(Column {
                    role: value(&ROLES, &c.role)?,
                    name: c.name,
                    source: c.source,
                    unit: c.unit,
                    angle: c.angle,
                    rotation: c.rotation.map(rotation_part).transpose()?,
                })
            })
            .collect::<Result<Vec<_>, String>>()?;
        let names: Vec<&str> = columns.iter().map(|column| column.name.as_str()).collect();
        let scope = Scope::new(&names);
        let parse = |text: &String| Expr::parse(text, &scope).map_err(|error| format!("`{text}`: {error}"));
        let with_latents: Vec<&str> =
            names.iter().copied().chain(self.latents.iter().map(|latent| latent.name.as_str())).collect();
        let right_scope = Scope::new(&with_latents);
        let libraries = self
            .libraries
            .iter()
            .map(|library| library.iter().map(parse).collect::<Result<Vec<_>, _>>())
            .collect::<Result<Vec<_>, _>>()?;
        let mut summaries = Vec::new();
        let partitions = self
            .partitions
            .into_iter()
            .map(|p| {
                summaries.push(p.regions.into_iter().map(RegionText::into_region).collect::<Vec<_>>().into());
                Ok(Partition {
                    columns: p.columns.iter().map(parse).collect::<Result<Vec<_>, _>>()?,
                    specification: p.specification,
                    centre: floats(p.centre),
                    scale: floats(p.scale),
                    rule: p.rule.into_rule(),
                    transitions: (!p.transitions.is_empty()).then_some(Transitions { counts: p.transitions }),
                    phases: p.phases.map(PhasesText::into_phases),
                    pairs: p.pairs.into_iter().map(PairText::into_pair).collect(),
                    lattice: p.lattice.map(LatticeText::into_lattice),
                    correlation: (!p.correlation.is_empty())
                        .then(|| ResidualCorrelation { lags: p.correlation.into_iter().map(floats).collect() }),
                })
            })
            .collect::<Result<Vec<_>, String>>()?;
        let equations = self
            .equations
            .iter()
            .map(|e| {
                Ok(Equation {
                    subject: e.subject.clone(),
                    prediction: value(&PREDICTIONS, &e.prediction)?,
                    right: Expr::parse(&e.right, &right_scope).map_err(|error| format!("`{}`: {error}", e.right))?,
                    target: e.target.as_ref().map(parse).transpose()?,
                    unit: e.unit.clone(),
                })
            })
            .collect::<Result<Vec<_>, String>>()?;
        let latents = latent::latents(self.latents)?;
        let training = self.training.into_training()?;
        Ok(Model {
            method: self.method,
            columns,
            libraries,
            partitions,
            summaries,
            latents,
            equations,
            step: self.step.0,
            training,
        })
    }
}

impl From<&Column> for ColumnText {
    fn from(c: &Column) -> Self {
        Self {
            name: c.name.clone(),
            source: c.source.clone(),
            unit: c.unit.clone(),
            role: word(&ROLES, c.role),
            angle: c.angle,
            rotation: c
                .rotation
                .as_ref()
                .map(|rotation| (rotation.group.clone(), rotation.kind.word().to_owned(), rotation.part)),
        }
    }
}

fn rotation_part((group, word, part): (String, String, usize)) -> Result<RotationPart, String> {
    let kind = RotationKind::of_word(&word).ok_or_else(|| format!("unknown word `{word}`"))?;
    Ok(RotationPart { group, kind, part })
}

impl From<(&Partition, &Summary)> for PartitionText {
    fn from((p, summary): (&Partition, &Summary)) -> Self {
        Self {
            specification: p.specification.clone(),
            columns: p.columns.iter().map(Expr::to_string).collect(),
            centre: reals(&p.centre),
            scale: reals(&p.scale),
            rule: RuleText::from(&p.rule),
            regions: summary.regions.iter().map(RegionText::from).collect(),
            transitions: p.transitions.as_ref().map_or_else(Vec::new, |transitions| transitions.counts.clone()),
            phases: p.phases.as_ref().map(PhasesText::from),
            pairs: p.pairs.iter().map(PairText::from).collect(),
            lattice: p.lattice.as_ref().map(LatticeText::from),
            correlation: p
                .correlation
                .iter()
                .flat_map(|correlation| correlation.lags.iter().map(|lag| reals(lag)))
                .collect(),
        }
    }
}

impl From<&Lattice> for LatticeText {
    fn from(lattice: &Lattice) -> Self {
        let level = |level: &Level| LevelText {
            regions: level.regions,
            training: Real(level.training),
            held_out: Real(level.held_out),
            standard_error: Real(level.standard_error),
            bic: Real(level.bic),
        };
        Self {
            joins: lattice.joins.iter().map(|join| (join.kept, join.gone, Real(join.training))).collect(),
            levels: lattice.levels.iter().map(level).collect(),
        }
    }
}

impl LatticeText {
    fn into_lattice(self) -> Lattice {
        let level = |level: LevelText| Level {
            regions: level.regions,
            training: level.training.0,
            held_out: level.held_out.0,
            standard_error: level.standard_error.0,
            bic: level.bic.0,
        };
        let join = |(kept, gone, training): (u32, u32, Real)| Join { kept, gone, training: training.0 };
        Lattice {
            joins: self.joins.into_iter().map(join).collect(),
            levels: self.levels.into_iter().map(level).collect(),
        }
    }
}

impl From<&RegionSummary> for RegionText {
    fn from(r: &RegionSummary) -> Self {
        Self {
            name: r.name.clone(),
            rows: r.rows,
            mean: reals(&r.mean),
            covariance: reals(&r.covariance),
            range: r.range.iter().map(|[low, high]| [Real(*low), Real(*high)]).collect(),
            residual_covariance: reals(&r.residual_covariance),
            rank: r.rank,
            condition: Real(r.condition),
            confounded: r.confounded.clone(),
        }
    }
}

impl RegionText {
    fn into_region(self) -> RegionSummary {
        RegionSummary {
            name: self.name,
            rows: self.rows,
            mean: floats(self.mean),
            covariance: floats(self.covariance),
            range: self.range.into_iter().map(|[low, high]| [low.0, high.0]).collect(),
            residual_covariance: floats(self.residual_covariance),
            rank: self.rank,
            condition: self.condition.0,
            confounded: self.confounded,
        }
    }
}

impl From<&Equation> for EquationText {
    fn from(e: &Equation) -> Self {
        Self {
            subject: e.subject.clone(),
            prediction: word(&PREDICTIONS, e.prediction),
            right: e.right.to_string(),
            target: e.target_text(),
            unit: e.unit.clone(),
        }
    }
}
