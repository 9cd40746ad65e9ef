//! Controllers made from models.

mod file;

pub use file::{ControllerFile, ControllerRecord, LqrRecord, SetPointRecord};
use fleetfoot_control::design::{LqrOptions, MpcOptions, Schedule, lqr, mpc};
use fleetfoot_data::setting::CONTROL;
use fleetfoot_fit::Error;
use fleetfoot_model::Model;
use fleetfoot_recipe::{ControlSchedule, ControlSection, Recipe, Settings, items};

/// Makes the linear-quadratic regulator of a model. Defaults of `said` are the settings of `[control]` in the model's
/// recipe.
///
/// # Errors
/// Settings that cannot be read, and those of [`lqr`].
pub fn control_lqr(model: &Model, section: &ControlSection) -> Result<ControllerFile, Error> {
    let settings = ControlSection { horizon: None, bounds: None, ..settled(model, section)? };
    let designed = lqr(model, &regulator(&settings)?)?;
    Ok(ControllerFile::of(ControllerRecord::Lqr, model, settings, designed))
}

/// Makes the predictive controller of a model, with the settings of [`control_lqr`] and a horizon (20 samples if none is
/// given) and bounds of states.
///
/// # Errors
/// Settings that cannot be read, and those of [`mpc`].
pub fn control_mpc(model: &Model, section: &ControlSection) -> Result<ControllerFile, Error> {
    let mut settings = settled(model, section)?;
    let horizon = *settings.horizon.get_or_insert(HORIZON);
    let options = MpcOptions {
        lqr: regulator(&settings)?,
        horizon: usize::try_from(horizon).unwrap_or(usize::MAX),
        bounds: ranges("bounds", settings.bounds.as_deref())?,
    };
    let designed = mpc(model, &options)?;
    Ok(ControllerFile::of(ControllerRecord::Mpc, model, settings, designed))
}

/// Samples that are planned if no horizon is given.
const HORIZON: u64 = 20;

/// Settings above those of the model's recipe.
fn settled(model: &Model, section: &ControlSection) -> Result<ControlSection, Error> {
    let recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
    Ok(section.clone().over(recipe.control))
}

/// Options of the regulator.
fn regulator(settings: &ControlSection) -> Result<LqrOptions, Error> {
    Ok(LqrOptions {
        setpoint: named("setpoint", settings.setpoint.as_deref())?,
        q: named("q", settings.q.as_deref())?,
        r: named("r", settings.r.as_deref())?,
        integral: named("integral", settings.integral.as_deref())?,
        limits: ranges("limits", settings.limits.as_deref())?,
        drive: list(settings.drive.as_deref()),
        free: list(settings.free.as_deref()),
        period: settings.period,
        schedule: match settings.schedule.unwrap_or_default() {
            ControlSchedule::Auto => Schedule::Auto,
            ControlSchedule::Region => Schedule::Region,
            ControlSchedule::Mean => Schedule::Mean,
        },
    })
}

/// The items of an entry. An empty text has none: it stands above names that a recipe below has.
fn list(text: Option<&str>) -> Vec<String> {
    text.filter(|text| !text.trim().is_empty()).map(items).unwrap_or_default()
}

/// `x=1`.
pub(crate) fn pair(place: &str, item: &str) -> Result<(String, f64), Error> {
    let parsed = item.rsplit_once('=');
    let parsed = parsed.and_then(|(name, value)| Some((name.trim().to_owned(), value.trim().parse().ok()?)));
    parsed.ok_or_else(|| Error::value(format!("{place} = {item}: write NAME=NUMBER, several separated by commas")))
}

/// `x=1,y=2`.
fn named(entry: &str, text: Option<&str>) -> Result<Vec<(String, f64)>, Error> {
    let place = CONTROL.entry(entry).to_string();
    list(text).iter().map(|item| pair(&place, item)).collect()
}

/// `u=0:1`.
fn ranges(entry: &str, text: Option<&str>) -> Result<Vec<(String, f64, f64)>, Error> {
    let parse = |item: String| {
        let pair = item.rsplit_once('=').and_then(|(name, range)| {
            let (low, high) = range.split_once(':')?;
            Some((name.trim().to_owned(), low.trim().parse().ok()?, high.trim().parse().ok()?))
        });
        let name = if entry == "limits" { "INPUT" } else { "STATE" };
        let mend = format!("write {name}=LOW:HIGH, several separated by commas");
        pair.ok_or_else(|| Error::value(format!("{place}: {mend}", place = CONTROL.entry(entry).is(item))))
    };
    list(text).into_iter().map(parse).collect()
}
