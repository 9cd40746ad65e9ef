//! Controllers made from models.

mod file;

pub use file::{ControllerFile, ControllerRecord, LqrRecord, SetPointRecord};
use fleetfoot_control::design::{Lqr, LqrOptions, Schedule, lqr};
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
    let recipe = Recipe::parse(&model.training.recipe, "the model's recipe")?;
    let settings = section.clone().over(recipe.control);
    let options = LqrOptions {
        setpoint: named("setpoint", settings.setpoint.as_deref())?,
        q: named("q", settings.q.as_deref())?,
        r: named("r", settings.r.as_deref())?,
        integral: named("integral", settings.integral.as_deref())?,
        limits: limits(settings.limits.as_deref())?,
        drive: list(settings.drive.as_deref()),
        free: list(settings.free.as_deref()),
        period: settings.period,
        schedule: match settings.schedule.unwrap_or_default() {
            ControlSchedule::Auto => Schedule::Auto,
            ControlSchedule::Region => Schedule::Region,
            ControlSchedule::Mean => Schedule::Mean,
        },
    };
    let Lqr { regulator, setpoint, regions, notes, .. } = lqr(model, &options)?;
    Ok(ControllerFile::of_lqr(model, settings, regulator, &setpoint, regions, notes))
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
fn limits(text: Option<&str>) -> Result<Vec<(String, f64, f64)>, Error> {
    let parse = |item: String| {
        let pair = item.rsplit_once('=').and_then(|(name, range)| {
            let (low, high) = range.split_once(':')?;
            Some((name.trim().to_owned(), low.trim().parse().ok()?, high.trim().parse().ok()?))
        });
        let mend = "write INPUT=LOW:HIGH, several separated by commas";
        pair.ok_or_else(|| Error::value(format!("{entry}: {mend}", entry = CONTROL.entry("limits").is(item))))
    };
    list(text).into_iter().map(parse).collect()
}
