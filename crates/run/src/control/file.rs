//! Controllers as files: the law, its origin and its certificates.

use std::path::Path;

use fleetfoot_control::{
    controller::{Controller, Regulator},
    design::Lqr,
};
use fleetfoot_data::setting::{CONTROL_LQR, CONTROL_MPC};
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_output::write_atomic;
use fleetfoot_recipe::ControlSection;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// Version of the format.
const FORMAT: u32 = 1;

/// A controller: the law, and how it was made.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct ControllerFile {
    /// Kind of the design.
    pub kind: ControllerRecord,
    /// The law.
    pub law: Regulator,
    /// The hash of the model that it was made for.
    pub model: String,
    /// Method of the model's fit.
    pub method: String,
    /// Version of fleetfoot.
    pub version: String,
    /// Settings of the design.
    pub settings: ControlSection,
    /// Set point of the model.
    pub setpoint: SetPointRecord,
    /// One entry a law.
    pub regions: Vec<LqrRecord>,
    /// Notes for the user.
    pub notes: Vec<String>,
}

/// Kind of a controller's design.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum ControllerRecord {
    /// The linear-quadratic regulator.
    Lqr,
    /// The predictive controller.
    Mpc,
}

/// A set point, as text.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct SetPointRecord {
    /// All states of the model.
    pub states: IndexMap<String, f64>,
    /// All its inputs.
    pub inputs: IndexMap<String, f64>,
    /// The region that rests there; none where it is found for the mean of all.
    pub region: Option<String>,
    /// Remaining motion there: derivatives, or changes a sample.
    pub drift: IndexMap<String, f64>,
    /// True if the model rests there, within the accuracy of its numbers.
    pub at_rest: bool,
}

/// A law, certified.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct LqrRecord {
    /// The region.
    pub region: String,
    /// Its training rows.
    pub rows: u64,
    /// Modes that do not decay and that nothing reaches, in words.
    pub unreached: Vec<String>,
    /// Spectral radius of the closed loop, a sample; none of a borrowed law.
    pub radius: Option<f64>,
    /// Residual of the Riccati equation, relative to its solution; none of a borrowed law.
    pub residual: Option<f64>,
    /// True if the region's submodel can rest near the set point.
    pub rests: bool,
    /// True if the law is that of the set point, because the region has no law itself.
    pub borrowed: bool,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Envelope {
    fleetfoot_controller: u32,
    checksum: String,
    controller: ControllerFile,
}

impl ControllerFile {
    pub(super) fn of(kind: ControllerRecord, model: &Model, settings: ControlSection, designed: Lqr) -> Self {
        let Lqr { regulator: law, setpoint, regions, notes, .. } = designed;
        let map = |named: &[(String, f64)]| named.iter().cloned().collect();
        let finite = |value: f64| value.is_finite().then_some(value);
        let name = |region: usize| regions.get(region).map_or_else(|| region.to_string(), |region| region.name.clone());
        Self {
            kind,
            law,
            model: model.hash(),
            method: model.method.clone(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            settings,
            setpoint: SetPointRecord {
                states: map(&setpoint.states),
                inputs: map(&setpoint.inputs),
                region: setpoint.region.map(name),
                drift: map(&setpoint.drift),
                at_rest: setpoint.at_rest,
            },
            regions: regions
                .into_iter()
                .map(|region| LqrRecord {
                    region: region.name,
                    rows: region.rows,
                    unreached: region.unreached,
                    radius: finite(region.radius),
                    residual: finite(region.residual),
                    rests: region.rests,
                    borrowed: region.borrowed,
                })
                .collect(),
            notes,
        }
    }

    /// The file as text.
    pub fn to_json(&self) -> String {
        // Plain structs, numbers and strings: nothing that cannot be written.
        let canonical = serde_json::to_string(self).unwrap_or_default();
        let checksum = blake3::hash(canonical.as_bytes()).to_hex().to_string();
        let envelope = Envelope { fleetfoot_controller: FORMAT, checksum, controller: self.clone() };
        let mut text = serde_json::to_string_pretty(&envelope).unwrap_or_default();
        text.push('\n');
        text
    }

    /// Reads a file's text; `name` is its origin, for messages.
    ///
    /// # Errors
    /// A text that is no controller, is of another version, or was damaged or edited; a law that cannot be used.
    pub fn from_json(text: &str, name: &str) -> Result<Self, Error> {
        #[derive(Deserialize)]
        struct Head {
            fleetfoot_controller: u32,
        }
        let refused = |problem: String| Error::value(format!("controller {name}: {problem}"));
        let syntax = |error: serde_json::Error| {
            refused(format!("not a fleetfoot controller: {error}; make it again with {CONTROL_LQR} or {CONTROL_MPC}"))
        };
        let head: Head = serde_json::from_str(text).map_err(syntax)?;
        if head.fleetfoot_controller != FORMAT {
            return Err(refused(format!(
                "controller format {}, this version reads format {FORMAT}; make it again with {CONTROL_LQR} or {CONTROL_MPC}",
                head.fleetfoot_controller
            )));
        }
        let Envelope { checksum, controller, .. } = serde_json::from_str(text).map_err(syntax)?;
        let canonical = serde_json::to_string(&controller).map_err(syntax)?;
        if blake3::hash(canonical.as_bytes()).to_hex().as_str() != checksum {
            let mend = "the content does not match its checksum: the file was damaged or edited; make it again";
            return Err(refused(mend.to_owned()));
        }
        controller.law.validate().map_err(|error| refused(error.to_string()))?;
        Ok(controller)
    }

    /// Reads a file.
    ///
    /// # Errors
    /// Those of [`Self::from_json`], and a file that cannot be read.
    pub fn read(path: &Path) -> Result<Self, Error> {
        let name = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|error| Error::value(format!("controller {name}: cannot be read: {error}")))?;
        Self::from_json(&text, &name)
    }

    /// The law as a model, of which [`crate::export`] makes code; of a predictive controller that of its regulator. Its
    /// training range has no meaning ([`fleetfoot_codegen::ExportOptions::domain`]).
    ///
    /// # Errors
    /// A law that cannot be used.
    pub fn law_model(&self) -> Result<Model, Error> {
        let mut model = self.law.model().map_err(fleetfoot_dynamics::Error::from)?;
        model.method = format!("regulator of {} as", self.model);
        for (region, record) in model.summaries.iter_mut().flat_map(|summary| &mut summary.regions).zip(&self.regions) {
            region.name.clone_from(&record.region);
        }
        Ok(model)
    }

    /// Writes the file, whole or not at all.
    ///
    /// # Errors
    /// Those of writing.
    pub fn write(&self, path: &Path) -> Result<(), Error> {
        Ok(write_atomic(path, self.to_json().as_bytes())?)
    }
}
