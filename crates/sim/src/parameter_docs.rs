//! Descriptions of the simulated robots' parameters: the doc comments of types of this crate and of the controllers,
//! gathered when the crate is built.

/// A struct or an enum of parameters.
pub struct TypeDoc {
    /// The source file, to tell types of one name apart.
    pub file: &'static str,
    /// The type's name.
    pub name: &'static str,
    /// Of a struct.
    pub fields: &'static [FieldDoc],
    /// Of an enum.
    pub variants: &'static [VariantDoc],
}

/// A field.
pub struct FieldDoc {
    /// Name in world files.
    pub name: &'static str,
    /// Name of its type; for a list or an option, of the type inside.
    pub kind: &'static str,
    /// Description in a line.
    pub doc: &'static str,
}

/// A variant of an enum.
pub struct VariantDoc {
    /// Name in world files.
    pub name: &'static str,
    /// Description in a line.
    pub doc: &'static str,
    /// The struct that it holds, if it does.
    pub inner: &'static str,
    /// Its own fields.
    pub fields: &'static [FieldDoc],
}

include!(concat!(env!("OUT_DIR"), "/parameter_docs.rs"));

impl TypeDoc {
    /// The type of this name, of this crate's where there are several.
    pub fn named(name: &str) -> Option<&'static Self> {
        Self::find(name, "src/")
    }

    /// The type of this name that is nearest to `file`: in it, in a folder that both are in, anywhere.
    pub fn find(name: &str, file: &str) -> Option<&'static Self> {
        // `hexapod.rs` is the front of the folder `hexapod`.
        let parts = |file: &str| file.trim_end_matches(".rs").split('/').map(str::to_owned).collect::<Vec<_>>();
        let wanted = parts(file);
        let common = |other: &str| parts(other).iter().zip(&wanted).take_while(|(a, b)| a == b).count();
        // Of equally near ones the first.
        TYPES.iter().rev().filter(|known| known.name == name).max_by_key(|known| common(known.file))
    }

    /// The fields of a struct; of an enum, those of the variant of this name.
    pub fn fields(&self, variant: Option<&str>) -> (&'static [FieldDoc], &'static str) {
        let Some(variant) = self.variants.iter().find(|known| Some(known.name) == variant) else {
            return (self.fields, self.file);
        };
        match Self::find(variant.inner, self.file) {
            Some(inner) if variant.fields.is_empty() => (inner.fields, inner.file),
            _ => (variant.fields, self.file),
        }
    }
}
