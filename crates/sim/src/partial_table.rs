//! Tables of a world file with some of their keys.

/// A function for `#[serde(deserialize_with = ...)]`: the keys that a table leaves out keep the values of a default of one's own, not those
/// of `Default` for the table's type.
macro_rules! partial_table {
    ($name:ident, $table:ident { $($field:ident: $kind:ty),+ $(,)? }, $default:expr) => {
        pub(super) fn $name<'de, D: serde::Deserializer<'de>>(table: D) -> Result<$table, D::Error> {
            #[derive(serde::Deserialize)]
            #[serde(deny_unknown_fields)]
            struct Given {
                $($field: Option<$kind>),+
            }
            let (given, default): (Given, $table) = (serde::Deserialize::deserialize(table)?, $default);
            Ok($table { $($field: given.$field.unwrap_or(default.$field)),+ })
        }
    };
}

pub(crate) use partial_table;
