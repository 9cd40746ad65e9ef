//! Tests of the JSON decoder.

use proptest::prelude::*;

use super::*;
use crate::MISSING;

fn plain() -> Box<dyn Codec> {
    codec("", None).unwrap()
}

fn paths(paths: &[&str]) -> Vec<FieldPath> {
    paths.iter().map(|path| path.parse().unwrap()).collect()
}

fn extract(codec: &dyn Codec, message: &str, wanted: &[&str]) -> Row {
    let extract = codec.compile(&paths(wanted)).unwrap();
    let mut row = Row::new(&*extract);
    extract.extract(message.as_bytes(), &mut row).unwrap();
    row
}

#[test]
fn values_keep_their_kinds_and_their_order() {
    let value = plain()
        .value(br#"{"z": 1, "a": [-2, 1.5, true, null], "t": "x\u00e9", "big": 18446744073709551615, "z": 7}"#)
        .unwrap();
    let Value::Struct(fields) = &value else { panic!("{value:?}") };
    assert_eq!(fields.iter().map(|(name, _)| &**name).collect::<Vec<_>>(), ["z", "a", "t", "big"]);
    assert_eq!(value.field("z"), Some(&Value::Int(7)));
    assert_eq!(
        value.field("a"),
        Some(&Value::Array(vec![Value::Int(-2), Value::Float(1.5), Value::Bool(true), Value::Null]))
    );
    assert_eq!(value.field("t"), Some(&Value::Text("xé".to_owned())));
    assert_eq!(value.field("big"), Some(&Value::Uint(u64::MAX)));
}

#[test]
fn long_arrays_of_numbers_are_counted_but_read_when_named() {
    let numbers: Vec<String> = (0..65).map(|number| number.to_string()).collect();
    let message = format!(r#"{{"ranges": [{}], "names": [{}]}}"#, numbers.join(","), vec![r#""n""#; 65].join(","));
    let value = plain().value(message.as_bytes()).unwrap();
    assert_eq!(value.field("ranges"), Some(&Value::Long(65)));
    assert!(matches!(value.field("names"), Some(Value::Array(names)) if names.len() == 65));
    let row = extract(&*plain(), &message, &["ranges[64]", "ranges[65]"]);
    assert_eq!(row.values[0], 64.0);
    assert!(row.values[1].is_nan());
}

#[test]
fn fields_are_keyed_and_stamped() {
    let message = r#"{
        "timestamp": {"sec": 3, "nsec": 7},
        "position": [0.5, 1.5], "data": "c29tZSBieXRlcw==", "name": ["l", "r"],
        "transforms": [{"header": {"stamp": {"sec": 9, "nanosec": 1}}, "child_frame_id": "base", "t": {"x": 4}}],
        "on": true, "off": null, "deep": {"er": {"unwanted": [[[1]]]}}
    }"#;
    let wanted =
        ["transforms[base].t.x", "position[r]", "on", "off", "data", "nothing.here[3]", "position[x]", "position"];
    let row = extract(&*plain(), message, &wanted);
    assert_eq!((row.values[0], row.values[1], row.values[2], row.values[4]), (4.0, 1.5, 1.0, 0.0));
    assert!([3, 5, 6, 7].iter().all(|slot| row.values[*slot].is_nan()));
    assert_eq!(row.texts.names(), ["c29tZSBieXRlcw=="]);
    assert_eq!(row.present, [true, true, true, false]);
    assert_eq!(row.stamps, [9_000_000_001, 3_000_000_007, 3_000_000_007, MISSING]);
}

#[test]
fn schema_decides_real_numbers() {
    let schema = br##"{"type": "object", "properties": {
        "x": {"type": "number"}, "n": {"type": "integer"}, "q": {"$ref": "#/$defs/Q"},
        "list": {"type": "array", "items": {"anyOf": [{"type": "number"}, {"type": "null"}]}}},
        "$defs": {"Q": {"properties": {"w": {"type": ["number", "null"]}, "next": {"$ref": "#/$defs/Q"}}}, "loop": {"$ref": "#/$defs/loop"}}}"##;
    let codec = codec("t", Some(schema)).unwrap();
    let value = codec
        .value(br#"{"x": 1, "n": 1, "q": {"w": 2, "next": {"next": {"w": -3}}}, "list": [4, null], "other": 5}"#)
        .unwrap();
    assert_eq!(
        (value.field("x"), value.field("n"), value.field("other")),
        (Some(&Value::Float(1.0)), Some(&Value::Int(1)), Some(&Value::Int(5)))
    );
    assert_eq!(value.field("list"), Some(&Value::Array(vec![Value::Float(4.0), Value::Null])));
    let q = value.field("q").unwrap();
    assert_eq!(q.field("w"), Some(&Value::Float(2.0)));
    assert_eq!(q.field("next").and_then(|next| next.field("next")?.field("w")), Some(&Value::Float(-3.0)));
    assert!(super::codec("t", Some(b"{")).is_err());
    assert!(super::codec("t", Some(b" \n")).is_ok());
    assert!(super::codec("t", Some(br##"{"$ref": "#"}"##)).is_ok());
}

#[test]
fn non_json_numbers_are_missing() {
    let message = r#"{"a": NaN, "b": [-Infinity, Infinity, 2], "t": "NaN \" Infinity"}"#;
    let row = extract(&*plain(), message, &["a", "b[0]", "b[2]", "t"]);
    assert!(row.values[0].is_nan() && row.values[1].is_nan());
    assert_eq!(row.values[2], 2.0);
    assert_eq!(row.texts.names(), [r#"NaN " Infinity"#]);
}

#[test]
fn damage_is_reported_with_its_offset() {
    let error = plain().value(b"{\n \"a\": 1,\n \"b\": ?}").unwrap_err();
    assert_eq!(error.offset, 17);
    assert!(error.problem.contains("expected value"), "{error}");
    assert!(plain().value(b"").is_err());
    assert!(plain().value(b"{} x").is_err());
    assert!(plain().value(&[b"[".repeat(100_000), b"]".repeat(100_000)].concat()).is_err());
}

#[test]
fn objects_with_many_fields_are_read_once() {
    let fields: Vec<String> = (0..100_000).map(|field| format!(r#""f{}": {field}"#, field % 50_000)).collect();
    let value = plain().value(format!("{{{}}}", fields.join(",")).as_bytes()).unwrap();
    let Value::Struct(fields) = value else { panic!("an object is a struct") };
    assert_eq!(fields.len(), 50_000);
    assert_eq!(fields[49_999].1, Value::Int(99_999));
}

proptest! {
    #[test]
    fn damage_never_panics(flips in prop::collection::vec((any::<usize>(), 0u8..8), 1..6), end in any::<usize>()) {
        let mut message = r#"{"header": {"stamp": {"sec": 1, "nanosec": 2}}, "name": ["a", "b"], "v": [1.5, -2e3], "t": "\u00e9\n", "o": {"p": [{"id": "k", "x": 1}]}}"#
            .as_bytes()
            .to_vec();
        for (place, bit) in flips {
            let place = place % message.len();
            message[place] ^= 1 << bit;
        }
        message.truncate(end % (2 * message.len()));
        let wanted = plain().compile(&paths(&["v[a]", "o.p[k].x", "t", "v[1]"])).unwrap();
        let mut row = Row::new(&*wanted);
        let read = plain().value(&message);
        // Skipped values are checked like values that are read.
        if read.is_ok() {
            prop_assert!(wanted.extract(&message, &mut row).is_ok());
        }
        if let Err(error) = read {
            prop_assert!(error.offset <= message.len());
        }
    }

    #[test]
    fn numbers_read_back(numbers in prop::collection::vec(any::<f64>().prop_filter("finite", |x| x.is_finite()), 1..20)) {
        let message = serde_json::to_vec(&numbers).unwrap();
        let expected = numbers.iter().copied().map(Value::Float).collect();
        prop_assert_eq!(plain().value(&message).unwrap(), Value::Array(expected));
    }
}
