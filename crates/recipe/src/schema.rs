//! JSON Schema of a recipe, for editors: made from the types that read the recipe, so that both have the same keys.

use schemars::{Schema, generate::SchemaSettings, transform::transform_subschemas};
use serde_json::Value;

use crate::Recipe;

impl Recipe {
    /// JSON Schema (draft 7) of a recipe in TOML or JSON.
    ///
    /// It refuses the keys, the words of enumerations and the kinds of values that [`Recipe::parse`] refuses. Bounds of
    /// numbers and the syntax of expressions are beyond it.
    pub fn schema() -> Value {
        let mut settings = SchemaSettings::draft07();
        settings.transforms.insert(0, Box::new(plain));
        let mut schema = settings.into_generator().into_root_schema_for::<Self>();
        schema.insert("title".to_owned(), "Recipe of fleetfoot".into());
        schema.to_value()
    }
}

/// Removes the widths of numbers (`uint32`), which are no formats of JSON Schema, and null from the values of optional
/// entries: TOML has none, and an entry that is not given is absent.
fn plain(schema: &mut Schema) {
    schema.remove("format");
    if let Some(Value::Array(kinds)) = schema.get_mut("type") {
        kinds.retain(|kind| kind != "null");
        if let [kind] = kinds.as_slice() {
            let kind = kind.clone();
            schema.insert("type".to_owned(), kind);
        }
    }
    if let Some(Value::Array(choices)) = schema.get_mut("anyOf") {
        choices.retain(|choice| choice.get("type").is_none_or(|kind| kind != "null"));
        if let [Value::Object(choice)] = choices.as_slice() {
            let choice = choice.clone();
            schema.remove("anyOf");
            choice.into_iter().for_each(|(key, value)| drop(schema.insert(key, value)));
        }
    }
    transform_subschemas(&mut plain, schema);
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::Command;

    use super::*;
    use crate::{
        AutoSection, ControlSection, EstimateSection, FilterSection, NarxSection, NetworkSection, PrepareSection,
        PwaSection, ResimulateSection, Settings, SindySection, SparseSection,
    };

    /// A node behind its references.
    fn resolved<'a>(schema: &'a Value, node: &'a Value) -> &'a Value {
        let reference = node.get("$ref").or_else(|| node.pointer("/allOf/0/$ref")).and_then(Value::as_str);
        let target = reference.and_then(|reference| schema.pointer(reference.trim_start_matches('#')));
        target.map_or(node, |target| resolved(schema, target))
    }

    /// All words of an enumeration.
    fn words<'a>(schema: &'a Value, node: &'a Value) -> Vec<&'a str> {
        let node = resolved(schema, node);
        let lists = ["oneOf", "anyOf"].into_iter().filter_map(|key| node.get(key)?.as_array());
        let nested = lists.flatten().flat_map(|choice| words(schema, choice));
        let listed = node.get("enum").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str);
        node.get("const").and_then(Value::as_str).into_iter().chain(listed).chain(nested).collect()
    }

    /// The entries of a section are those of its flags, with the words of their values and the aliases of these words.
    fn compare<S: Settings>(schema: &Value) -> usize {
        let section = resolved(schema, &schema["properties"][S::SECTION]);
        assert_eq!(section["additionalProperties"], false, "[{}]", S::SECTION);
        let entries = section["properties"].as_object().unwrap();
        let known: BTreeSet<&str> = S::ENTRIES.iter().copied().collect();
        assert_eq!(entries.keys().map(String::as_str).collect::<BTreeSet<_>>(), known, "[{}]", S::SECTION);
        let flags = S::augment_args(Command::new("settings"));
        let mut compared = 0;
        for flag in flags.get_arguments() {
            let entry = &entries[flag.get_id().as_str()];
            if entry["type"] == "boolean" {
                continue;
            }
            let words = words(schema, entry);
            for value in flag.get_possible_values() {
                for word in value.get_name_and_aliases() {
                    assert!(words.contains(&word), "[{}] {} = {word:?}: {words:?}", S::SECTION, flag.get_id());
                    compared += 1;
                }
            }
        }
        compared
    }

    #[test]
    fn entries_and_words_are_those_of_flags() {
        let schema = Recipe::schema();
        let compared = [
            compare::<PwaSection>(&schema),
            compare::<SparseSection>(&schema),
            compare::<SindySection>(&schema),
            compare::<NarxSection>(&schema),
            compare::<NetworkSection>(&schema),
            compare::<EstimateSection>(&schema),
            compare::<ControlSection>(&schema),
            compare::<FilterSection>(&schema),
            compare::<PrepareSection>(&schema),
            compare::<ResimulateSection>(&schema),
            compare::<AutoSection>(&schema),
        ];
        assert!(compared.iter().sum::<usize>() > 50, "{compared:?}");
        assert!(words(&schema, &schema["definitions"]["Kind"]).contains(&"axis-angle"));
    }

    #[test]
    fn no_value_is_null() {
        fn visit(value: &Value) {
            assert!(value != "null", "{value}");
            match value {
                Value::Object(table) => table.values().for_each(visit),
                Value::Array(list) => list.iter().for_each(visit),
                _ => {}
            }
        }
        let schema = Recipe::schema();
        assert_eq!(schema["additionalProperties"], false);
        visit(&schema);
    }
}
