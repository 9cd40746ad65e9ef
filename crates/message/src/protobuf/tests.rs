//! Tests of the protobuf decoder, with prost-reflect's dynamic messages as an independent encoder.

use std::collections::HashMap;

use proptest::prelude::*;
use prost_reflect::{
    DescriptorPool, DynamicMessage, MapKey, MessageDescriptor, Value as Dynamic,
    prost_types::{
        DescriptorProto, FieldDescriptorProto, FileDescriptorProto, MessageOptions, OneofDescriptorProto,
        field_descriptor_proto::{Label, Type},
    },
};

use super::*;

fn field(name: &str, number: i32, kind: Type) -> FieldDescriptorProto {
    FieldDescriptorProto {
        name: Some(name.to_owned()),
        number: Some(number),
        label: Some(Label::Optional as i32),
        r#type: Some(kind as i32),
        ..Default::default()
    }
}

fn many(name: &str, number: i32, kind: Type) -> FieldDescriptorProto {
    FieldDescriptorProto { label: Some(Label::Repeated as i32), ..field(name, number, kind) }
}

fn of(field: FieldDescriptorProto, kind: &str) -> FieldDescriptorProto {
    FieldDescriptorProto { type_name: Some(kind.to_owned()), ..field }
}

fn message(name: &str, field: Vec<FieldDescriptorProto>) -> DescriptorProto {
    DescriptorProto { name: Some(name.to_owned()), field, ..Default::default() }
}

/// A robot's message with all kinds of fields.
fn set() -> FileDescriptorSet {
    let in_oneof = |field: FieldDescriptorProto, place| FieldDescriptorProto { oneof_index: Some(place), ..field };
    let mut state = message(
        "State",
        vec![
            field("d", 1, Type::Double),
            field("f", 2, Type::Float),
            field("i32", 3, Type::Int32),
            field("i64", 4, Type::Int64),
            field("u32", 5, Type::Uint32),
            field("u64", 6, Type::Uint64),
            field("s32", 7, Type::Sint32),
            field("s64", 8, Type::Sint64),
            field("x32", 9, Type::Fixed32),
            field("x64", 10, Type::Fixed64),
            field("sx32", 11, Type::Sfixed32),
            field("sx64", 12, Type::Sfixed64),
            field("b", 13, Type::Bool),
            field("text", 14, Type::String),
            field("raw", 15, Type::Bytes),
            of(field("inner", 16, Type::Message), ".t.Inner"),
            of(many("frames", 17, Type::Message), ".t.Frame"),
            many("name", 18, Type::String),
            many("position", 19, Type::Double),
            many("count", 20, Type::Sint32),
            of(many("gains", 21, Type::Message), ".t.State.GainsEntry"),
            FieldDescriptorProto { proto3_optional: Some(true), ..in_oneof(field("maybe", 22, Type::Double), 1) },
            in_oneof(field("left", 23, Type::Double), 0),
            in_oneof(field("right", 24, Type::Int32), 0),
            of(field("timestamp", 25, Type::Message), ".google.protobuf.Timestamp"),
        ],
    );
    state.oneof_decl =
        ["choice", "_maybe"].map(|name| OneofDescriptorProto { name: Some(name.to_owned()), options: None }).to_vec();
    let mut entry = message("GainsEntry", vec![field("key", 1, Type::String), field("value", 2, Type::Double)]);
    entry.options = Some(MessageOptions { map_entry: Some(true), ..Default::default() });
    state.nested_type.push(entry);
    let file = FileDescriptorProto {
        name: Some("t.proto".to_owned()),
        package: Some("t".to_owned()),
        syntax: Some("proto3".to_owned()),
        dependency: vec!["google/protobuf/timestamp.proto".to_owned()],
        message_type: vec![
            state,
            message(
                "Inner",
                vec![
                    field("a", 1, Type::Double),
                    field("c", 2, Type::Int32),
                    of(field("inner", 3, Type::Message), ".t.Inner"),
                ],
            ),
            message(
                "Frame",
                vec![
                    of(field("timestamp", 1, Type::Message), ".google.protobuf.Timestamp"),
                    field("child_frame_id", 2, Type::String),
                    field("x", 3, Type::Double),
                ],
            ),
        ],
        ..Default::default()
    };
    FileDescriptorSet { file: vec![file] }
}

fn codec_of(name: &str) -> Box<dyn Codec> {
    codec(name, &set().encode_to_vec()).unwrap()
}

fn descriptor(name: &str) -> MessageDescriptor {
    let mut pool = DescriptorPool::global();
    pool.add_file_descriptor_set(set()).unwrap();
    pool.get_message_by_name(name).unwrap()
}

fn paths(paths: &[&str]) -> Vec<FieldPath> {
    paths.iter().map(|path| path.parse().unwrap()).collect()
}

fn extract(bytes: &[u8], wanted: &[&str]) -> Row {
    let extract = codec_of("t.State").compile(&paths(wanted)).unwrap();
    let mut row = Row::new(&*extract);
    extract.extract(bytes, &mut row).unwrap();
    row
}

#[test]
fn wire_bytes_follow_the_encoding() {
    let inner = codec_of("t.Inner");
    // From the encoding guide: field 2 as the varint 150; unknown fields 9 (text), 10 (group) and 11 (fixed) are skipped.
    let bytes = [0x10, 0x96, 0x01, 0x4a, 2, b'o', b'k', 0x53, 0x08, 0x01, 0x54, 0x5d, 1, 2, 3, 4];
    let value = inner.value(&bytes).unwrap();
    assert_eq!(value.field("c"), Some(&Value::Int(150)));
    assert_eq!(value.field("a"), Some(&Value::Float(0.0)));
    assert_eq!(value.field("inner"), Some(&Value::Null));
    // A negative int32 takes ten bytes; the last of two counts; a field of another wire type is not that field.
    let bytes = [0x10, 7, 0x10, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1, 0x12, 1, 9];
    assert_eq!(inner.value(&bytes).unwrap().field("c"), Some(&Value::Int(-1)));
}

#[test]
fn parts_of_an_inner_message_are_merged() {
    // inner { c: 5 }, inner { inner { c: 6 } }, inner { inner { a: 1.0 }, c: 7 }
    let mut bytes = vec![0x1a, 2, 0x10, 5, 0x1a, 4, 0x1a, 2, 0x10, 6];
    bytes.extend([0x1a, 13, 0x1a, 9, 0x09]);
    bytes.extend(1f64.to_le_bytes());
    bytes.extend([0x10, 7]);
    let value = codec_of("t.Inner").value(&bytes).unwrap();
    let inner = value.field("inner").unwrap();
    assert_eq!(inner.field("c"), Some(&Value::Int(7)));
    assert_eq!(inner.field("inner").unwrap().field("c"), Some(&Value::Int(6)));
    assert_eq!(inner.field("inner").unwrap().field("a"), Some(&Value::Float(1.0)));
}

#[test]
fn packed_and_single_elements_add_up() {
    // count (20, sint32): packed [1, -1], single 2; position (19): single 0.5, packed [1.5]
    let mut bytes = vec![0xa2, 1, 2, 2, 1, 0xa0, 1, 4, 0x99, 1];
    bytes.extend(0.5f64.to_le_bytes());
    bytes.extend([0x9a, 1, 8]);
    bytes.extend(1.5f64.to_le_bytes());
    let value = codec_of("t.State").value(&bytes).unwrap();
    assert_eq!(value.field("count"), Some(&Value::Array([1, -1, 2].map(Value::Int).to_vec())));
    assert_eq!(value.field("position"), Some(&Value::Array([0.5, 1.5].map(Value::Float).to_vec())));
}

#[test]
fn long_arrays_are_counted_but_read_when_named() {
    let state = descriptor("t.State");
    let mut message = DynamicMessage::new(state);
    message.set_field_by_name("count", Dynamic::List((0..1000).map(Dynamic::I32).collect()));
    message.set_field_by_name("position", Dynamic::List((0..65).map(|i| Dynamic::F64(i.into())).collect()));
    message.set_field_by_name("raw", Dynamic::Bytes(vec![7; 100].into()));
    let bytes = message.encode_to_vec();
    let value = codec_of("t.State").value(&bytes).unwrap();
    assert_eq!(value.field("count"), Some(&Value::Long(1000)));
    assert_eq!(value.field("position"), Some(&Value::Long(65)));
    assert_eq!(value.field("raw"), Some(&Value::Long(100)));
    let row = extract(&bytes, &["count[999]", "count[1000]", "raw[99]", "position[64]"]);
    assert_eq!((row.values[0], row.values[2], row.values[3]), (999.0, 7.0, 64.0));
    assert!(row.values[1].is_nan());
}

#[test]
fn fields_are_keyed_and_stamped() {
    let state = descriptor("t.State");
    let pool = state.parent_pool().clone();
    let stamp = |seconds: i64| {
        let mut stamp = DynamicMessage::new(pool.get_message_by_name("google.protobuf.Timestamp").unwrap());
        stamp.set_field_by_name("seconds", Dynamic::I64(seconds));
        stamp.set_field_by_name("nanos", Dynamic::I32(9));
        Dynamic::Message(stamp)
    };
    let frame = |seconds, child: &str, x| {
        let mut frame = DynamicMessage::new(pool.get_message_by_name("t.Frame").unwrap());
        frame.set_field_by_name("timestamp", stamp(seconds));
        frame.set_field_by_name("child_frame_id", Dynamic::String(child.to_owned()));
        frame.set_field_by_name("x", Dynamic::F64(x));
        Dynamic::Message(frame)
    };
    let mut message = DynamicMessage::new(state.clone());
    message.set_field_by_name("timestamp", stamp(4));
    message.set_field_by_name("frames", Dynamic::List(vec![frame(1, "base", 2.5), frame(2, "arm", 3.5)]));
    message.set_field_by_name("name", Dynamic::List(["l", "r"].map(|name| Dynamic::String(name.to_owned())).to_vec()));
    message.set_field_by_name("position", Dynamic::List(vec![Dynamic::F64(0.25), Dynamic::F64(0.75)]));
    message.set_field_by_name(
        "gains",
        Dynamic::Map(HashMap::from([(MapKey::String("kp".to_owned()), Dynamic::F64(8.0))])),
    );
    message.set_field_by_name("text", Dynamic::String("walk".to_owned()));
    let wanted = [
        "frames[arm].x",
        "position[r]",
        "gains[kp].value",
        "frames[leg].x",
        "d",
        "maybe",
        "text",
        "timestamp.seconds",
        "count[l]",
    ];
    let row = extract(&message.encode_to_vec(), &wanted);
    assert_eq!(row.values[..3], [3.5, 0.75, 8.0]);
    assert_eq!(row.present, [true, true, true, false, true, true]);
    assert_eq!(row.stamps, [2_000_000_009, 4_000_000_009, 4_000_000_009, crate::MISSING, 4_000_000_009, 4_000_000_009]);
    assert!(row.values[3].is_nan() && row.values[5].is_nan() && row.values[8].is_nan());
    assert_eq!((row.values[4], row.values[6], row.values[7]), (0.0, 0.0, 4.0));
    assert_eq!((row.texts.names(), row.is_text[6]), (&["walk".to_owned()][..], true));
}

#[test]
fn last_member_of_oneof_counts() {
    let mut bytes = vec![0xb9, 1];
    bytes.extend(2.5f64.to_le_bytes());
    assert_eq!(extract(&bytes, &["left"]).values, [2.5]);
    bytes.extend([0xc0, 1, 3]);
    assert!(extract(&bytes, &["left"]).values[0].is_nan());
    assert_eq!(extract(&bytes, &["right"]).values, [3.0]);
}

#[test]
fn wrong_fields_are_reported_with_the_nearest() {
    let codec = codec_of("t.State");
    let error = |path: &str| codec.compile(&paths(&[path])).err().unwrap().to_string();
    assert_eq!(error("positon[0]"), "there is no field `positon[0]`; the nearest is `position`");
    assert_eq!(error("frames[base].z"), "there is no field `frames[base].z`");
    assert_eq!(error("inner"), "`inner` is a message `t.Inner`: name one of its parts");
    assert_eq!(error("position"), "`position` is an array: name one of its parts");
    assert!(error("d[0]").contains("nearest is `d`"));
    assert!(codec.compile(&paths(&["inner.inner.inner.inner.a", "raw[3]", "name[l]"])).is_err());
    assert!(codec.compile(&paths(&["inner.inner.inner.inner.a", "raw[3]", "name[0]", "maybe"])).is_ok());
    assert!(matches!(error_of("t.Stat", &set().encode_to_vec()), SchemaError::Malformed { .. }));
    assert!(matches!(error_of("t.State", b"nonsense"), SchemaError::Malformed { .. }));
}

fn error_of(name: &str, data: &[u8]) -> SchemaError {
    codec(name, data).err().unwrap()
}

#[test]
fn bombs_are_refused() {
    let codec = codec_of("t.State");
    // Empty frames: two bytes each become four values.
    let bomb: Vec<u8> = [0x8a, 1, 0].repeat(1 << 20);
    let values = codec.value(&bomb).unwrap();
    assert!(matches!(values.field("frames"), Some(Value::Array(frames)) if frames.len() == 1 << 20));
    // A message in itself, deeper than is read.
    let mut deep = Vec::new();
    for _ in 0..200 {
        let mut outer = vec![0x1a];
        let mut length = deep.len();
        while length >= 0x80 {
            outer.push(length as u8 | 0x80);
            length >>= 7;
        }
        outer.push(length as u8);
        outer.extend(&deep);
        deep = outer;
    }
    assert!(codec_of("t.Inner").value(&deep).unwrap_err().problem.contains("nested"));
    // Many messages of many fields from few bytes.
    let fields = (1..=2000).map(|number| field(&format!("f{number}"), number, Type::Double)).collect();
    let file = FileDescriptorProto {
        name: Some("w.proto".to_owned()),
        syntax: Some("proto3".to_owned()),
        message_type: vec![message("Wide", fields), message("Many", vec![of(many("m", 1, Type::Message), ".Wide")])],
        ..Default::default()
    };
    let wide = super::codec("Many", &FileDescriptorSet { file: vec![file] }.encode_to_vec()).unwrap();
    assert!(wide.value(&[0x0a, 0].repeat(30)).is_ok());
    assert!(wide.value(&[0x0a, 0].repeat(100_000)).unwrap_err().problem.contains("unpack"));
    // Groups in groups.
    assert!(codec.value(&[0xfb, 0x3f].repeat(1000)).is_err());
}

/// A message, and the value that it must decode to.
fn state() -> impl Strategy<Value = (DynamicMessage, Value)> {
    let scalars = prop::collection::vec(any::<u64>(), 13);
    (scalars, "[a-zé]{0,9}", prop::collection::vec(any::<i32>(), 0..6), prop::collection::vec(any::<f32>(), 0..6))
        .prop_map(|(bits, text, counts, positions)| {
            let values = [
                Dynamic::F64(bits[0] as f64),
                Dynamic::F32(bits[1] as f32),
                Dynamic::I32(bits[2] as i32),
                Dynamic::I64(bits[3] as i64),
                Dynamic::U32(bits[4] as u32),
                Dynamic::U64(bits[5]),
                Dynamic::I32(bits[6] as i32),
                Dynamic::I64(bits[7] as i64),
                Dynamic::U32(bits[8] as u32),
                Dynamic::U64(bits[9]),
                Dynamic::I32(bits[10] as i32),
                Dynamic::I64(bits[11] as i64),
                Dynamic::Bool(bits[12] % 2 == 0),
                Dynamic::String(text),
                Dynamic::Bytes(counts.iter().map(|count| *count as u8).collect::<Vec<_>>().into()),
            ];
            let mut message = DynamicMessage::new(descriptor("t.State"));
            for (place, value) in values.iter().enumerate() {
                message.set_field_by_number(place as u32 + 1, value.clone());
            }
            message.set_field_by_name("count", Dynamic::List(counts.iter().copied().map(Dynamic::I32).collect()));
            message.set_field_by_name(
                "position",
                Dynamic::List(positions.iter().map(|&x| Dynamic::F64(x.into())).collect()),
            );
            let mut expected: Vec<Value> = values.iter().map(plain).collect();
            expected.push(Value::Array(counts.into_iter().map(|count| Value::Int(count.into())).collect()));
            expected.push(Value::Array(positions.into_iter().map(|x| Value::Float(x.into())).collect()));
            (message, Value::Array(expected))
        })
}

fn plain(value: &Dynamic) -> Value {
    match value {
        Dynamic::F64(value) => Value::Float(*value),
        Dynamic::F32(value) => Value::Float((*value).into()),
        Dynamic::I32(value) => Value::Int((*value).into()),
        Dynamic::I64(value) => Value::Int(*value),
        Dynamic::U32(value) => Value::Uint((*value).into()),
        Dynamic::U64(value) => Value::Uint(*value),
        Dynamic::Bool(value) => Value::Bool(*value),
        Dynamic::String(value) => Value::Text(value.clone()),
        Dynamic::Bytes(value) => Value::Array(value.iter().map(|byte| Value::Uint((*byte).into())).collect()),
        _ => Value::Null,
    }
}

proptest! {
    #[test]
    fn messages_of_another_encoder_are_read(state in state()) {
        let (message, Value::Array(expected)) = state else { unreachable!() };
        let bytes = message.encode_to_vec();
        let value = codec_of("t.State").value(&bytes).unwrap();
        let names = ["d", "f", "i32", "i64", "u32", "u64", "s32", "s64", "x32", "x64", "sx32", "sx64", "b", "text", "raw", "count", "position"];
        // Not by equality of values: NaN is not equal to itself.
        for (name, expected) in names.iter().zip(&expected) {
            prop_assert_eq!(format!("{:?}", value.field(name)), format!("{:?}", Some(expected)), "{}", name);
        }
        // The pruned plan sees the same as the whole one.
        let row = extract(&bytes, &names[..14]);
        for (slot, expected) in expected[..13].iter().enumerate() {
            prop_assert_eq!(row.values[slot], expected.number().unwrap());
        }
        prop_assert!(row.is_text[13]);
    }

    #[test]
    fn damage_never_panics(state in state(), flips in prop::collection::vec((any::<usize>(), 0u8..8), 1..6)) {
        let bytes = state.0.encode_to_vec();
        let codec = codec_of("t.State");
        let fields = codec.compile(&paths(&["d", "frames[a].x", "position[l]", "count[3]", "inner.inner.a", "raw[0]", "text"])).unwrap();
        let mut row = Row::new(&*fields);
        for end in 0..bytes.len() {
            let _ = (codec.value(&bytes[..end]), fields.extract(&bytes[..end], &mut row));
        }
        let mut bytes = bytes;
        for (place, bit) in flips {
            let place = place % bytes.len();
            bytes[place] ^= 1 << bit;
            if let Err(error) = codec.value(&bytes) {
                prop_assert!(error.offset <= bytes.len());
            }
            let _ = fields.extract(&bytes, &mut row);
        }
    }

    #[test]
    fn a_damaged_schema_is_refused_or_works(flips in prop::collection::vec((any::<usize>(), 0u8..8), 1..4), cut in any::<usize>()) {
        let mut data = set().encode_to_vec();
        for (place, bit) in flips {
            let place = place % data.len();
            data[place] ^= 1 << bit;
        }
        let cut = cut % (data.len() * 4);
        for data in [&data[..], &data[..cut.min(data.len())]] {
            if let Ok(codec) = codec("t.State", data) {
                let _ = codec.value(&[0x1a, 0, 0x10, 1, 0xa2, 1, 2, 2, 1]);
            }
        }
    }
}
