//! Wildcards of a recipe: one line for many fields of a log.
//!
//! A star stands for the text in a pair of brackets, `/joint_states.position[*]`, or for one part between dots,
//! `/imu.angular_velocity.*`. An alias of a wildcard becomes as many aliases, each with the text of its stars. `q` of
//! `/joint_states.position[*]` becomes `q[left_crank]`, `q[right_crank]`; `w` of `/imu.angular_velocity.*` becomes
//! `w.x`, `w.y`, `w.z`.

use fleetfoot_data::Column;
use fleetfoot_data::setting::{COLUMNS, INFO_VALUES, INPUTS_SECTION, STATES_SECTION};
use indexmap::IndexMap;

use crate::{
    error::Error,
    recipe::{Input, InputTable, Recipe, State},
};

/// A star and its surroundings.
#[derive(Clone, Copy, PartialEq)]
enum Part<'a> {
    Text(&'a str),
    /// `[*]`
    Bracket,
    /// `.*`
    Field,
}

/// The parts of a wildcard; `None` for a text without one (where `*` is the product's sign).
fn parts(text: &str) -> Option<Vec<Part<'_>>> {
    let (mut parts, mut rest, mut has_star) = (Vec::new(), text.trim(), false);
    while !rest.is_empty() {
        let star = (0..rest.len()).filter(|&at| rest.is_char_boundary(at)).find_map(|at| {
            let here = &rest[at..];
            if here.starts_with("[*]") {
                return Some((at, 3, Part::Bracket));
            }
            let after = here.strip_prefix(".*")?;
            (after.is_empty() || after.starts_with(['.', '['])).then_some((at, 2, Part::Field))
        });
        let Some((at, length, part)) = star else {
            parts.push(Part::Text(rest));
            break;
        };
        if at > 0 {
            parts.push(Part::Text(&rest[..at]));
        }
        parts.push(part);
        has_star = true;
        rest = &rest[at + length..];
    }
    has_star.then_some(parts)
}

/// Part of `name` under the stars, as it is appended to an alias.
fn suffix(parts: &[Part<'_>], name: &str) -> Option<String> {
    let (mut rest, mut suffix) = (name, String::new());
    for part in parts {
        let length = match part {
            Part::Text(text) => {
                rest = rest.strip_prefix(text)?;
                continue;
            }
            Part::Bracket => rest.strip_prefix('[')?.find(']')? + 2,
            Part::Field => {
                let inside = rest.strip_prefix('.')?;
                1 + inside.find(['.', '[']).unwrap_or(inside.len())
            }
        };
        suffix.push_str(&rest[..length]);
        rest = &rest[length..];
    }
    rest.is_empty().then_some(suffix)
}

/// The fields that a wildcard names, with the text of its stars; `None` for a text without a star of this kind.
fn matches(text: &str, fields: &[Column], place: &str) -> Result<Option<Vec<(String, String)>>, Error> {
    let Some(parts) = parts(text) else { return Ok(None) };
    let pairs: Vec<(String, String)> = fields
        .iter()
        .filter_map(|field| suffix(&parts, &field.name).map(|suffix| (suffix, field.name.clone())))
        .collect();
    if pairs.is_empty() {
        let problem = format!("{place}: no field of the log matches `{text}`; {INFO_VALUES} lists them");
        return Err(Error::unknown(text, problem));
    }
    Ok(Some(pairs))
}

/// Returns true if a column's name matches a pattern: a wildcard as in a recipe, or the name itself.
pub fn is_match(pattern: &str, name: &str) -> bool {
    pattern == name || parts(pattern).is_some_and(|parts| suffix(&parts, name).is_some())
}

impl Recipe {
    /// The recipe with every wildcard and every rotation written out for the fields of a log.
    ///
    /// # Errors
    /// A wildcard that no field matches; a rotation whose columns, order or rates are unknown.
    pub fn expand(&self, fields: &[Column]) -> Result<Self, Error> {
        let mut out = self.clone();
        out.columns = IndexMap::new();
        // Fields of each wildcard alias.
        let mut aliases: IndexMap<&str, Vec<(String, String)>> = IndexMap::new();
        for (name, text) in &self.columns {
            match matches(text, fields, &COLUMNS.entry(name).to_string())? {
                None => _ = out.columns.insert(name.clone(), text.clone()),
                Some(matched) => {
                    for (suffix, field) in &matched {
                        out.columns.insert(format!("{name}{suffix}"), field.clone());
                    }
                    aliases.insert(name, matched);
                }
            }
        }
        let named = |name: &str, place: &str| -> Result<Option<Vec<String>>, Error> {
            if let Some(matched) = aliases.get(name) {
                return Ok(Some(matched.iter().map(|(suffix, _)| format!("{name}{suffix}")).collect()));
            }
            Ok(matches(name, fields, place)?.map(|matched| matched.into_iter().map(|(_, field)| field).collect()))
        };
        out.states = IndexMap::new();
        for (name, state) in &self.states {
            let place = STATES_SECTION.entry(name).to_string();
            match named(name, &place)? {
                Some(names) => out.states.extend(names.into_iter().map(|name| (name, state.clone()))),
                None => match state.column.as_deref().map_or(Ok(None), |text| matches(text, fields, &place))? {
                    None => _ = out.states.insert(name.clone(), state.clone()),
                    Some(matched) => out.states.extend(matched.into_iter().map(|(suffix, field)| {
                        (format!("{name}{suffix}"), crate::State { column: Some(field), ..state.clone() })
                    })),
                },
            }
        }
        out.states = with_parts(std::mem::take(&mut out.states), &out.columns, fields)?;
        out.inputs = IndexMap::new();
        for (name, input) in &self.inputs {
            let place = INPUTS_SECTION.entry(name).to_string();
            let table = input.table();
            let text = table.column.as_deref().unwrap_or(name);
            let with = |column: String| Input::Table(InputTable { column: Some(column), ..table.clone() });
            match (named(text, &place)?, matches(text, fields, &place)?) {
                (_, Some(matched)) if text != name => out
                    .inputs
                    .extend(matched.into_iter().map(|(suffix, field)| (format!("{name}{suffix}"), with(field)))),
                (Some(names), _) => out.inputs.extend(names.into_iter().map(|name| (name.clone(), with(name)))),
                _ => _ = out.inputs.insert(name.clone(), input.clone()),
            }
        }
        if let Some(on) = &self.model.partition_on {
            let mut written = Vec::new();
            for text in on {
                written.extend(named(text, "partition_on")?.unwrap_or_else(|| vec![text.clone()]));
            }
            out.model.partition_on = Some(written);
        }
        Ok(out)
    }
}

/// The states with every rotation written out. A state without settings that is a part of one is that part.
fn with_parts(
    states: IndexMap<String, State>,
    aliases: &IndexMap<String, String>,
    fields: &[Column],
) -> Result<IndexMap<String, State>, Error> {
    let mut written: IndexMap<String, State> = IndexMap::new();
    for (name, state) in states {
        let parts = state.parts(&name, aliases, fields)?;
        for (name, part) in parts.unwrap_or_else(|| vec![(name, state)]) {
            let blank = |state: &State| *state == State::default();
            match written.get(&name) {
                Some(_) if blank(&part) => {}
                Some(known) if !blank(known) => {
                    let problem = format!(
                        "{entry}: it is both a part of a rotation, whose equations are its kinematics, and a state; leave one of the two out",
                        entry = STATES_SECTION.entry(&name)
                    );
                    return Err(Error::name_taken(&name, problem));
                }
                _ => _ = written.insert(name, part),
            }
        }
    }
    Ok(written)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields() -> Vec<Column> {
        ["/js.position[left]", "/js.position[right]", "/js.velocity[left]", "/imu.w.x", "/imu.w.y", "/imu.a.x", "vx"]
            .map(Column::float)
            .to_vec()
    }

    #[test]
    fn wildcards_become_fields_and_products_stay() {
        let recipe = Recipe::parse(
            r#"
            [columns]
            q = "/js.position[*]"
            product = "vx*vx"
            [states]
            q = { kind = "angle" }
            "/imu.w.*" = {}
            [inputs]
            u = "/js.velocity[*]"
            [model]
            partition_on = ["q"]
            "#,
            "test",
        )
        .unwrap();
        let wide = recipe.expand(&fields()).unwrap();
        assert_eq!(wide.columns["q[left]"], "/js.position[left]");
        assert_eq!(wide.columns["product"], "vx*vx");
        assert_eq!(wide.states.keys().collect::<Vec<_>>(), ["q[left]", "q[right]", "/imu.w.x", "/imu.w.y"]);
        assert_eq!(wide.states["q[right]"].kind, Some(crate::Kind::Angle));
        assert_eq!(wide.inputs.keys().collect::<Vec<_>>(), ["u[left]"]);
        assert_eq!(wide.inputs["u[left]"].table().column.as_deref(), Some("/js.velocity[left]"));
        assert_eq!(wide.model.partition_on.unwrap(), ["q[left]", "q[right]"]);
    }

    #[test]
    fn a_wildcard_without_a_field_is_an_error() {
        let recipe = Recipe::parse("[states]\n\"/js.effort[*]\" = {}\n", "test").unwrap();
        let message = recipe.expand(&fields()).unwrap_err().to_string();
        assert!(message.contains("/js.effort[*]"), "{message}");
    }

    #[test]
    fn stars_match_one_part() {
        assert!(is_match("/a.*.x", "/a.b.x") && is_match("/a[*].x", "/a[k].x") && is_match("/a.x", "/a.x"));
        assert!(!is_match("/a.*", "/a.b.c") && !is_match("/a.*.x", "/a.b.c.x") && !is_match("/a*", "/ab"));
    }
}
