//! The values of entries of WPILib's logs.
//!
//! Format: <https://github.com/wpilibsuite/allwpilib/blob/main/wpiutil/doc/datalog.adoc> and, of structs,
//! <https://github.com/wpilibsuite/allwpilib/blob/main/wpiutil/doc/struct.adoc>. A schema is a text with a line a struct: its name, a tab and its
//! declarations. The name of the schema is the type of the entry, such as `double[]` or `struct:Pose2d`. What is no struct is the field `value`.

use std::{collections::HashMap, sync::Arc};

use super::{
    bytes::{BitKind, Kind, Number},
    layout::{Layout, Part, Shape},
};
use crate::{Codec, SchemaError};

/// The name of the one field of an entry that is no struct.
const VALUE: &str = "value";

/// Structs inside each other.
const MAX_DEPTH: usize = 32;

/// Parts that all structs of a type may have together, each counted where it is used.
const MAX_PARTS: usize = 1 << 14;

/// Makes the decoder of an entry's values.
pub(crate) fn codec(name: &str, text: &[u8]) -> Result<Box<dyn Codec>, SchemaError> {
    let malformed =
        |problem: String| SchemaError::Malformed { encoding: "wpilog".to_owned(), name: name.to_owned(), problem };
    let text = String::from_utf8_lossy(text);
    let schemas: HashMap<&str, &str> = text.lines().filter_map(|line| line.split_once('\t')).collect();
    let layout = match name {
        "boolean" => one(Shape::Number(Number::plain(Kind::Bool))),
        "int64" => one(Shape::Number(Number::plain(Kind::I64))),
        "float" => one(Shape::Number(Number::plain(Kind::F32))),
        "double" => one(Shape::Number(Number::plain(Kind::F64))),
        "boolean[]" => rest(Shape::Number(Number::plain(Kind::Bool))),
        "int64[]" => rest(Shape::Number(Number::plain(Kind::I64))),
        "float[]" => rest(Shape::Number(Number::plain(Kind::F32))),
        "double[]" => rest(Shape::Number(Number::plain(Kind::F64))),
        "string" => one(Shape::RestText),
        "string[]" => one(Shape::Texts),
        _ => {
            let struct_name =
                name.strip_prefix("struct:").ok_or_else(|| malformed("its type is not read".to_owned()))?;
            let (struct_name, many) =
                struct_name.strip_suffix("[]").map_or((struct_name, false), |element| (element, true));
            let mut structs = Structs { schemas: &schemas, known: HashMap::new(), parts: 0 };
            let layout = structs.find(struct_name, 0).map_err(malformed)?;
            if many { rest(Shape::Struct(layout)) } else { Arc::unwrap_or_clone(layout) }
        }
    };
    Ok(super::codec(layout))
}

fn one(shape: Shape) -> Layout {
    let mut layout = Layout::default();
    layout.push(VALUE, shape, None);
    layout
}

fn rest(element: Shape) -> Layout {
    one(Shape::Rest(Box::new(element)))
}

/// The names of the structs that declarations use.
pub fn wpilog_uses(declarations: &str) -> Vec<&str> {
    let kinds = declarations.split(';').filter_map(|text| Some(declaration(text).ok()??.kind));
    kinds.filter(|kind| primitive(kind).is_none() && *kind != "char").collect()
}

/// Structs that are being laid out.
struct Structs<'a> {
    schemas: &'a HashMap<&'a str, &'a str>,
    /// `None` while it is being laid out, so that a struct inside itself is found.
    known: HashMap<&'a str, Option<Arc<Layout>>>,
    parts: usize,
}

impl<'a> Structs<'a> {
    fn find(&mut self, name: &str, depth: usize) -> Result<Arc<Layout>, String> {
        let (&name, &text) = self
            .schemas
            .get_key_value(name)
            .ok_or_else(|| format!("the schema of `struct:{name}` is not in the file"))?;
        match self.known.get(name) {
            Some(Some(layout)) => return Ok(layout.clone()),
            Some(None) => return Err(format!("`{name}` contains itself")),
            None if depth > MAX_DEPTH => return Err("its structs are nested too deeply".to_owned()),
            None => {}
        }
        self.known.insert(name, None);
        let mut layout = Layout::default();
        let mut bits = Bits::default();
        for text in text.split(';') {
            let Some(declared) = declaration(text)? else { continue };
            self.parts += 1;
            if self.parts > MAX_PARTS {
                return Err("its structs have too many fields".to_owned());
            }
            match declared.width {
                Some(width) => bits.push(&mut layout, &declared, width)?,
                None => {
                    bits.close(&mut layout);
                    let shape = self.shape(&declared, depth)?;
                    layout.push(declared.name, shape, None);
                }
            }
        }
        bits.close(&mut layout);
        if layout.size == 0 {
            return Err(format!("`{name}` has no fields"));
        }
        let layout = Arc::new(layout);
        self.known.insert(name, Some(layout.clone()));
        Ok(layout)
    }

    fn shape(&mut self, declared: &Declaration<'_>, depth: usize) -> Result<Shape, String> {
        if declared.kind == "char" {
            return Ok(Shape::Text(declared.count.unwrap_or(1)));
        }
        let one = match primitive(declared.kind) {
            Some(kind) => Shape::Number(Number::plain(kind)),
            None => Shape::Struct(self.find(declared.kind, depth + 1)?),
        };
        Ok(match declared.count {
            Some(count) => Shape::Array(Box::new(one), count),
            None => one,
        })
    }
}

/// Bit-fields under way: as WPILib's `StructDescriptor` places them.
#[derive(Debug, Default)]
struct Bits {
    /// Bytes of the number that holds them; zero where none is under way.
    bytes: usize,
    shift: u32,
}

impl Bits {
    fn push(&mut self, layout: &mut Layout, declared: &Declaration<'_>, width: u32) -> Result<(), String> {
        let (size, of) = match primitive(declared.kind) {
            Some(Kind::Bool) => (1, BitKind::Bool),
            Some(kind @ (Kind::I8 | Kind::I16 | Kind::I32 | Kind::I64)) => {
                (Number::plain(kind).size(), BitKind::Signed)
            }
            Some(kind @ (Kind::U8 | Kind::U16 | Kind::U32 | Kind::U64)) => {
                (Number::plain(kind).size(), BitKind::Unsigned)
            }
            _ => return Err(format!("`{}` has bits of a type that has none", declared.name)),
        };
        if width == 0 || width as usize > 8 * size || (of == BitKind::Bool && width != 1) {
            return Err(format!("`{}` has {width} bits, which its type does not hold", declared.name));
        }
        // A truth value goes into whatever number is under way.
        let fits = |bytes: usize| (self.shift + width) as usize <= 8 * bytes;
        let stays = self.bytes > 0 && (of == BitKind::Bool || size == self.bytes) && fits(self.bytes);
        if !stays {
            self.close(layout);
            self.bytes = size;
        }
        let kind = Kind::Bits { bytes: self.bytes, shift: self.shift, width, of };
        let shape = Shape::Number(Number::plain(kind));
        layout.parts.push(Part { name: declared.name.into(), at: layout.size, shape, unit: None });
        self.shift += width;
        Ok(())
    }

    fn close(&mut self, layout: &mut Layout) {
        layout.size = layout.size.saturating_add(self.bytes);
        *self = Self::default();
    }
}

fn primitive(kind: &str) -> Option<Kind> {
    Some(match kind {
        "bool" => Kind::Bool,
        "int8" => Kind::I8,
        "uint8" => Kind::U8,
        "int16" => Kind::I16,
        "uint16" => Kind::U16,
        "int32" => Kind::I32,
        "uint32" => Kind::U32,
        "int64" => Kind::I64,
        "uint64" => Kind::U64,
        "float" | "float32" => Kind::F32,
        "double" | "float64" => Kind::F64,
        _ => return None,
    })
}

/// One field of a struct as its schema has it.
struct Declaration<'a> {
    kind: &'a str,
    name: &'a str,
    count: Option<usize>,
    width: Option<u32>,
}

/// Reads `[enum] [{name=1, ...}] type name`, `type name[count]` or `type name:bits`; `None` of an empty declaration.
fn declaration(text: &str) -> Result<Option<Declaration<'_>>, String> {
    let none = || format!("`{}` is not a field", text.trim());
    let mut rest = text.trim();
    if rest.is_empty() {
        return Ok(None);
    }
    if let Some(after) = rest.strip_prefix("enum").map(str::trim_start).filter(|after| after.starts_with('{')) {
        rest = after;
    }
    if rest.starts_with('{') {
        rest = rest.split_once('}').ok_or_else(none)?.1.trim_start();
    }
    let (kind, rest) = rest.split_once(char::is_whitespace).ok_or_else(none)?;
    let end = rest.find(['[', ':']).unwrap_or(rest.len());
    let (name, more) = rest.split_at_checked(end).ok_or_else(none)?;
    let (mut count, mut width) = (None, None);
    if let Some(inside) = more.strip_prefix('[') {
        count = Some(inside.trim_end().strip_suffix(']').and_then(|count| count.trim().parse().ok()).ok_or_else(none)?);
    } else if let Some(bits) = more.strip_prefix(':') {
        width = Some(bits.trim().parse().map_err(|_| none())?);
    }
    let name = name.trim();
    if name.is_empty() || count == Some(0) {
        return Err(none());
    }
    Ok(Some(Declaration { kind, name, count, width }))
}
