//! Random schemas and values, and all paths into them.

use std::sync::Arc;

use crate::{Extensibility, Field, FieldPath, Length, Scalar, Schema, Step, StructType, Type, Value};

/// Random numbers that a test can repeat (SplitMix64).
pub(super) struct Random(pub(super) u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    pub(super) fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    fn chance(&mut self, of: usize) -> bool {
        self.below(of) == 0
    }

    fn word(&mut self) -> String {
        ["left", "right", "", "base_link", "näher", "x"][self.below(6)].to_owned()
    }
}

const SCALARS: [Scalar; 12] = [
    Scalar::Bool,
    Scalar::I8,
    Scalar::U8,
    Scalar::I16,
    Scalar::U16,
    Scalar::I32,
    Scalar::U32,
    Scalar::I64,
    Scalar::U64,
    Scalar::F32,
    Scalar::F64,
    Scalar::LongDouble,
];

/// A text that has room for every word.
const PLAIN: Type = Type::PlainText { size: Some(12) };

/// A schema whose structs only use earlier ones. Two are as robots have them: with a header, and with parallel arrays.
pub(super) fn schema(random: &mut Random, version2: bool) -> Schema {
    let field = |name: &str, kind| Field { name: Arc::from(name), kind, optional: false };
    let text = Type::Text { wide: false };
    let many = |kind: &Type| Type::Array { element: Box::new(kind.clone()), length: Length::Sequence(None) };
    let struct_of = |name: &str, fields| StructType { name: name.to_owned(), fields, extensibility: None };
    let mut structs = vec![
        struct_of("Time", vec![field("sec", Type::Scalar(Scalar::I32)), field("nanosec", Type::Scalar(Scalar::U32))]),
        struct_of("Header", vec![field("stamp", Type::Struct(0)), field("frame_id", text.clone())]),
    ];
    let mut joints = vec![
        field("header", Type::Struct(1)),
        field("name", many(&text)),
        field("position", many(&Type::Scalar(SCALARS[random.below(11)]))),
        field("mode", many(&text)),
    ];
    // The names may stand anywhere among what they name.
    let place = 1 + random.below(3);
    joints[1..].rotate_left(place - 1);
    structs.push(struct_of("Joints", joints));
    for index in 0..1 + random.below(4) {
        let mut fields: Vec<Field> =
            (0..1 + random.below(5)).map(|place| field(&format!("f{place}"), kind(random, structs.len(), 0))).collect();
        if version2 {
            fields.iter_mut().for_each(|field| field.optional = random.chance(6));
        }
        if random.chance(2) {
            let place = random.below(fields.len() + 1);
            let id = if random.chance(3) { PLAIN } else { text.clone() };
            fields.insert(place, field("id", id));
        }
        if random.chance(3) {
            let place = random.below(fields.len() + 1);
            fields.insert(place, field("header", Type::Struct(1)));
        }
        structs.push(struct_of(&format!("S{index}"), fields));
    }
    let root = structs.len() - 1;
    for struct_type in structs.iter_mut().take(root) {
        struct_type.extensibility =
            [None, Some(Extensibility::Final), Some(Extensibility::Appendable)][random.below(3)];
    }
    Schema { structs, root }
}

fn kind(random: &mut Random, structs: usize, depth: usize) -> Type {
    match random.below(if depth < 3 { 10 } else { 6 }) {
        0..=2 => Type::Scalar(SCALARS[random.below(12)]),
        3 if random.chance(3) => PLAIN,
        3 => Type::Text { wide: random.chance(3) },
        4 | 5 => Type::Struct(random.below(structs)),
        6 | 7 => Type::Array { element: Box::new(kind(random, structs, depth + 1)), length: Length::Sequence(None) },
        _ => Type::Array {
            element: Box::new(kind(random, structs, depth + 1)),
            length: Length::Fixed(1 + random.below(4)),
        },
    }
}

/// A value of a type. Absent members are there only where they may be.
pub(super) fn value(random: &mut Random, schema: &Schema, kind: &Type) -> Value {
    let bits = random.next();
    match kind {
        Type::Scalar(scalar) => match scalar {
            Scalar::Bool => Value::Bool(bits & 1 == 1),
            Scalar::I8 => Value::Int((bits as i8).into()),
            Scalar::I16 => Value::Int((bits as i16).into()),
            Scalar::I32 => Value::Int((bits as i32).into()),
            Scalar::I64 => Value::Int(bits as i64),
            Scalar::U8 => Value::Uint((bits as u8).into()),
            Scalar::U16 => Value::Uint((bits as u16).into()),
            Scalar::U32 => Value::Uint((bits as u32).into()),
            Scalar::U64 => Value::Uint(bits),
            Scalar::F32 => Value::Float(f64::from(bits as i32 as f32 / 1024.0)),
            Scalar::F64 => Value::Float(bits as i64 as f64 / 1e9),
            Scalar::LongDouble => Value::Null,
        },
        Type::Text { .. } | Type::PlainText { .. } => Value::Text(random.word()),
        Type::Padding(_) => Value::Null,
        Type::Struct(index) => {
            let fields = schema.structs[*index].fields.iter().map(|field| {
                let absent = field.optional && random.chance(2);
                (Arc::clone(&field.name), if absent { Value::Null } else { value(random, schema, &field.kind) })
            });
            Value::Struct(fields.collect())
        }
        Type::Array { element, length } => {
            let count = match length {
                Length::Fixed(count) => *count,
                Length::Sequence(_) if random.chance(30) && matches!(**element, Type::Scalar(_)) => 70,
                Length::Sequence(_) => random.below(4),
            };
            Value::Array((0..count).map(|_| value(random, schema, element)).collect())
        }
    }
}

/// All paths to values, with some places beyond the ends and names that are not there.
pub(super) fn paths(schema: &Schema) -> Vec<FieldPath> {
    let mut all = Vec::new();
    walk(schema, &Type::Struct(schema.root), None, &mut Vec::new(), &mut all);
    all
}

fn walk(schema: &Schema, kind: &Type, beside: Option<bool>, steps: &mut Vec<Step>, all: &mut Vec<FieldPath>) {
    match kind {
        Type::Scalar(Scalar::LongDouble) => {}
        Type::Padding(_) => {}
        Type::Scalar(_) | Type::Text { .. } | Type::PlainText { .. } => all.push(FieldPath { steps: steps.clone() }),
        Type::Struct(index) => {
            let struct_type = &schema.structs[*index];
            for field in &struct_type.fields {
                let has_names = struct_type.name == "Joints" && *field.name != *"name";
                steps.push(Step::Field(Arc::clone(&field.name)));
                walk(schema, &field.kind, Some(has_names), steps, all);
                steps.pop();
            }
        }
        Type::Array { element, length } => {
            let mut ways = vec![Step::Index(0), Step::Index(2), Step::Index(66)];
            // A place beyond the end of a fixed array is no field.
            ways.retain(|way| !matches!((way, length), (Step::Index(index), Length::Fixed(count)) if index >= count));
            let texts = |index: usize| schema.structs[index].fields.iter().any(|field| *field.name == *"id");
            if beside == Some(true) || matches!(**element, Type::Struct(index) if texts(index)) {
                ways.extend(["left", "", "nobody"].map(|key| Step::Key(key.to_owned())));
            }
            for way in ways {
                steps.push(way);
                walk(schema, element, None, steps, all);
                steps.pop();
            }
        }
    }
}
