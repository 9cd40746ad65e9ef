//! Gathers the descriptions of the simulated robots' parameters, so that a world file shows them beside each number.
//! They are the doc comments of every `Deserialize` type of this crate and of the controllers in `control`, which it
//! uses.

use std::{
    env, fs, io,
    path::{Path, PathBuf},
};

use syn::{Attribute, Expr, Field, Fields, GenericArgument, Item, Lit, Meta, PathArguments, Type};

/// Folders with parameters, from this crate's.
const FOLDERS: [&str; 2] = ["src", "../control/src"];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let here = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?);
    let mut files = Vec::new();
    for folder in FOLDERS {
        println!("cargo::rerun-if-changed={folder}");
        collect(&here.join(folder), &mut files)?;
    }
    files.sort();
    let mut out = String::from("static TYPES: &[TypeDoc] = &[\n");
    for file in &files {
        let text = fs::read_to_string(file)?;
        // A file that is no Rust is the compiler's to complain about.
        let Ok(parsed) = syn::parse_file(&text) else { continue };
        let name = file.strip_prefix(&here).unwrap_or(file).to_string_lossy().into_owned();
        parsed.items.iter().filter_map(|item| describe(item, &name)).for_each(|line| out.push_str(&line));
    }
    out.push_str("];\n");
    fs::write(Path::new(&env::var("OUT_DIR")?).join("parameter_docs.rs"), out)?;
    Ok(())
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            collect(&path, files)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
    Ok(())
}

/// The `TypeDoc` of a type that is read from files.
fn describe(item: &Item, file: &str) -> Option<String> {
    let (name, attributes, fields, variants) = match item {
        Item::Struct(item) => (&item.ident, &item.attrs, self::fields(&item.fields), Vec::new()),
        Item::Enum(item) => {
            let rename = serde_value(&item.attrs, "rename_all");
            let variants = item.variants.iter().map(|variant| {
                let plain = variant.ident.to_string();
                let name = serde_value(&variant.attrs, "rename").unwrap_or_else(|| cased(&plain, rename.as_deref()));
                // A variant that holds one struct has that struct's fields.
                let inner = match &variant.fields {
                    Fields::Unnamed(inner) => inner.unnamed.first().and_then(|field| type_name(&field.ty)),
                    _ => None,
                };
                format!(
                    "VariantDoc {{ name: {name:?}, doc: {:?}, inner: {:?}, fields: &[{}] }}, ",
                    doc(&variant.attrs),
                    inner.unwrap_or_default(),
                    self::fields(&variant.fields).concat()
                )
            });
            (&item.ident, &item.attrs, Vec::new(), variants.collect())
        }
        _ => return None,
    };
    let read = attributes.iter().any(|attribute| {
        matches!(&attribute.meta, Meta::List(list) if list.path.is_ident("derive") && list.tokens.to_string().contains("Deserialize"))
    });
    let (name, fields, variants) = (name.to_string(), fields.concat(), variants.concat());
    read.then(|| {
        format!("    TypeDoc {{ file: {file:?}, name: {name:?}, fields: &[{fields}], variants: &[{variants}] }},\n")
    })
}

fn fields(fields: &Fields) -> Vec<String> {
    let named = |field: &Field| {
        let plain = field.ident.as_ref()?.to_string();
        let name = serde_value(&field.attrs, "rename").unwrap_or(plain);
        let kind = type_name(&field.ty).unwrap_or_default();
        Some(format!("FieldDoc {{ name: {name:?}, kind: {kind:?}, doc: {:?} }}, ", doc(&field.attrs)))
    };
    fields.iter().filter_map(named).collect()
}

/// The last name of a type, looked for inside of options, boxes, lists and arrays.
fn type_name(kind: &Type) -> Option<String> {
    match kind {
        Type::Array(array) => type_name(&array.elem),
        Type::Path(path) => {
            let last = path.path.segments.last()?;
            match &last.arguments {
                PathArguments::AngleBracketed(inside) => inside.args.iter().find_map(|argument| match argument {
                    GenericArgument::Type(inner) => type_name(inner),
                    _ => None,
                }),
                _ => Some(last.ident.to_string()),
            }
        }
        _ => None,
    }
}

/// The first paragraph of a doc comment, in one line.
fn doc(attributes: &[Attribute]) -> String {
    let lines = attributes.iter().filter_map(|attribute| match &attribute.meta {
        Meta::NameValue(pair) if pair.path.is_ident("doc") => match &pair.value {
            Expr::Lit(literal) => match &literal.lit {
                Lit::Str(text) => Some(text.value().trim().to_owned()),
                _ => None,
            },
            _ => None,
        },
        _ => None,
    });
    lines.take_while(|line| !line.is_empty()).collect::<Vec<_>>().join(" ").replace(['`', '[', ']'], "")
}

/// Value of `#[serde(key = "value")]`.
fn serde_value(attributes: &[Attribute], key: &str) -> Option<String> {
    let mut parsed_value = None;
    for attribute in attributes.iter().filter(|attribute| attribute.path().is_ident("serde")) {
        // Other keys of the same attribute may have any form; what stands before them counts.
        let _ = attribute.parse_nested_meta(|meta| {
            if let Ok(value) = meta.value() {
                let literal: Lit = value.parse()?;
                if let (true, Lit::Str(text)) = (meta.path.is_ident(key), literal) {
                    parsed_value = Some(text.value());
                }
            }
            Ok(())
        });
    }
    parsed_value
}

/// A variant's name as serde writes it.
fn cased(name: &str, rule: Option<&str>) -> String {
    let separator = match rule {
        Some("kebab-case") => "-",
        Some("snake_case") => "_",
        Some("lowercase") => "",
        _ => return name.to_owned(),
    };
    let mut out = String::new();
    for (index, c) in name.chars().enumerate() {
        if c.is_uppercase() && index > 0 {
            out.push_str(separator);
        }
        out.extend(c.to_lowercase());
    }
    out
}
