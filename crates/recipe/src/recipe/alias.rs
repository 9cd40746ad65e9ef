//! Second words of enumerations, which serde reads as `alias` and the derive of the schema does not.

use schemars::Schema;
use serde_json::Value;

/// Adds a word that is read as another one to the words of an enumeration.
pub(super) fn also(word: &'static str, meaning: &'static str) -> impl FnMut(&mut Schema) {
    move |schema| {
        if let Some(Value::Array(words)) = schema.get_mut("oneOf") {
            let description = format!("The same as `{meaning}`.");
            words.push(serde_json::json!({ "const": word, "description": description, "type": "string" }));
        }
    }
}
