//! Shapes of a message by its JSON Schema: they mark the numbers that are real.

use std::collections::{HashMap, VecDeque};

use serde_json::Value as Json;

/// References that lead to one another.
const MAX_REFERENCES: usize = 16;

/// Shapes of the values of a message; the first is that of the message. Types may contain themselves.
#[derive(Debug, Default)]
pub(super) struct Shapes {
    shapes: Vec<Shape>,
}

/// Schema of one value.
#[derive(Debug, Default)]
struct Shape {
    is_real: bool,
    fields: HashMap<String, usize>,
    elements: Option<usize>,
}

impl Shapes {
    /// Reads a schema. Of what JSON Schema has, `type`, `properties`, `items`, local `$ref` and alternatives to null are understood; what else
    /// it says has no influence.
    ///
    /// # Errors
    /// A text that is no JSON.
    pub(super) fn new(text: &[u8]) -> Result<Self, serde_json::Error> {
        let schema: Json = serde_json::from_slice(text)?;
        let mut builder = Builder { schema: &schema, places: HashMap::new(), todo: VecDeque::new() };
        let mut shapes = Vec::new();
        builder.place(&schema);
        while let Some(part) = builder.todo.pop_front() {
            shapes.push(builder.shape(part));
        }
        Ok(Self { shapes })
    }

    /// The shape of the message.
    pub(super) fn root(&self) -> Option<usize> {
        (!self.shapes.is_empty()).then_some(0)
    }

    /// Returns true if whole numbers of this shape stand for real ones.
    pub(super) fn is_real(&self, shape: Option<usize>) -> bool {
        self.get(shape).is_some_and(|shape| shape.is_real)
    }

    /// The shape of a field.
    pub(super) fn field(&self, shape: Option<usize>, name: &str) -> Option<usize> {
        self.get(shape)?.fields.get(name).copied()
    }

    /// The shape of an array's elements.
    pub(super) fn elements(&self, shape: Option<usize>) -> Option<usize> {
        self.get(shape)?.elements
    }

    fn get(&self, shape: Option<usize>) -> Option<&Shape> {
        self.shapes.get(shape?)
    }
}

/// Parts of a schema in the order in which they were first met.
struct Builder<'a> {
    schema: &'a Json,
    /// By address: a part that is referred to twice is one shape.
    places: HashMap<*const Json, usize>,
    todo: VecDeque<&'a Json>,
}

impl<'a> Builder<'a> {
    /// The place of a part's shape.
    fn place(&mut self, part: &'a Json) -> usize {
        let part = self.meant(part);
        let next = self.places.len();
        let place = *self.places.entry(part).or_insert(next);
        if place == next {
            self.todo.push_back(part);
        }
        place
    }

    /// Target of a reference, or the alternative to null.
    fn meant(&self, mut part: &'a Json) -> &'a Json {
        for _ in 0..MAX_REFERENCES {
            let target =
                part.get("$ref").and_then(Json::as_str).and_then(|link| self.schema.pointer(link.strip_prefix('#')?));
            let alternatives = part.get("anyOf").or_else(|| part.get("oneOf")).and_then(Json::as_array);
            let mut others = alternatives
                .into_iter()
                .flatten()
                .filter(|part| part.get("type").and_then(Json::as_str) != Some("null"));
            match (target, others.next(), others.next()) {
                (Some(target), _, _) => part = target,
                (None, Some(only), None) => part = only,
                _ => break,
            }
        }
        part
    }

    fn shape(&mut self, part: &'a Json) -> Shape {
        let is_number = |kind: &Json| kind.as_str() == Some("number");
        let is_real = match part.get("type") {
            Some(Json::Array(kinds)) => kinds.iter().any(is_number),
            Some(kind) => is_number(kind),
            None => false,
        };
        let mut shape = Shape { is_real, ..Default::default() };
        for (name, part) in part.get("properties").and_then(Json::as_object).into_iter().flatten() {
            shape.fields.insert(name.clone(), self.place(part));
        }
        shape.elements = part.get("items").filter(|items| items.is_object()).map(|items| self.place(items));
        shape
    }
}
