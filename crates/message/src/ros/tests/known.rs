//! Bytes made by hand, one for each wire and byte order, and refusals.

use super::super::codec;
use crate::{Codec, Extract, MISSING, Row, SchemaError, Value};

fn cdr(schema: &str) -> Box<dyn Codec> {
    codec("cdr", "pkg/msg/A", "ros2msg", schema.as_bytes()).unwrap()
}

fn compiled(codec: &dyn Codec, fields: &[&str]) -> Box<dyn Extract> {
    codec.compile(&fields.iter().map(|field| field.parse().unwrap()).collect::<Vec<_>>()).unwrap()
}

fn row(codec: &dyn Codec, message: &[u8], fields: &[&str]) -> Row {
    let extract = compiled(codec, fields);
    let mut row = Row::new(&*extract);
    extract.extract(message, &mut row).unwrap();
    row
}

fn problem(result: Result<Box<dyn Codec>, SchemaError>) -> String {
    result.err().map(|error| error.to_string()).unwrap()
}

const PLAIN: &str = "uint8 a\nfloat64 b\nstring s\nint16[] n\n";

#[test]
fn plain_structs_on_every_wire() {
    // XCDR1: b at 8, s at 16, n at 24, its numbers at 28; little- and big-endian.
    let little = b"\0\x01\0\0\x07\0\0\0\0\0\0\0\0\0\0\0\0\0\xf0\x3f\x03\0\0\0hi\0\0\x02\0\0\0\x05\0\xff\xff";
    let big = b"\0\0\0\0\x07\0\0\0\0\0\0\0\x3f\xf0\0\0\0\0\0\0\0\0\0\x03hi\0\0\0\0\0\x02\0\x05\xff\xff";
    // XCDR2: b at 4; in the delimited form all of it behind its length of 28 bytes.
    let plain2 = b"\0\x07\0\0\x07\0\0\0\0\0\0\0\0\0\xf0\x3f\x03\0\0\0hi\0\0\x02\0\0\0\x05\0\xff\xff";
    let plain2_big = b"\0\x06\0\0\x07\0\0\0\x3f\xf0\0\0\0\0\0\0\0\0\0\x03hi\0\0\0\0\0\x02\0\x05\xff\xff";
    let delimited = b"\0\x09\0\0\x1c\0\0\0\x07\0\0\0\0\0\0\0\0\0\xf0\x3f\x03\0\0\0hi\0\0\x02\0\0\0\x05\0\xff\xff";
    let codec = cdr(PLAIN);
    for message in [&little[..], big, plain2, plain2_big, delimited] {
        let value = codec.value(message).unwrap();
        assert_eq!(value.field("a"), Some(&Value::Uint(7)));
        assert_eq!(value.field("b"), Some(&Value::Float(1.0)));
        assert_eq!(value.field("s"), Some(&Value::Text("hi".to_owned())));
        assert_eq!(value.field("n"), Some(&Value::Array(vec![Value::Int(5), Value::Int(-1)])));
        let row = row(&*codec, message, &["n[1]", "b", "s", "a"]);
        assert_eq!(row.values, [-1.0, 1.0, 0.0, 7.0]);
        assert_eq!(row.is_text, [false, false, true, false]);
        assert_eq!(row.texts.names(), ["hi"]);
        assert_eq!(row.stamps, [MISSING]);
    }
    let ros1 = codec_ros1(PLAIN);
    let message = b"\x07\0\0\0\0\0\0\xf0\x3f\x02\0\0\0hi\x02\0\0\0\x05\0\xff\xff";
    assert_eq!(row(&*ros1, message, &["n[1]", "b", "a"]).values, [-1.0, 1.0, 7.0]);
}

fn codec_ros1(schema: &str) -> Box<dyn Codec> {
    codec("ros1", "pkg/A", "ros1msg", schema.as_bytes()).unwrap()
}

#[test]
fn invalid_utf8_names_match_their_display() {
    let codec = codec_ros1("string[] name\nfloat32[] position\n");
    let message = b"\x02\0\0\0\x03\0\0\0r\xe9f\x01\0\0\0b\x02\0\0\0\0\0\x80\x3f\0\0\0\x40";
    let name = codec.value(message).unwrap().field("name").cloned();
    assert_eq!(name, Some(Value::Array(vec![Value::Text("r\u{fffd}f".to_owned()), Value::Text("b".to_owned())])));
    assert_eq!(row(&*codec, message, &["position[r\u{fffd}f]", "position[b]"]).values, [1.0, 2.0]);
}

#[test]
fn a_shorter_definition_of_the_writer_leaves_fields_out() {
    // The length says 12 bytes: a, padding and b, and neither s nor n.
    let message = b"\0\x09\0\0\x0c\0\0\0\x07\0\0\0\0\0\0\0\0\0\xf0\x3f";
    let codec = cdr(PLAIN);
    assert_eq!(codec.value(message).unwrap().field("s"), Some(&Value::Null));
    let row = row(&*codec, message, &["a", "b", "n[0]"]);
    assert_eq!(row.values[..2], [7.0, 1.0]);
    assert!(row.values[2].is_nan());
}

#[test]
fn encapsulations_that_cannot_be_read_are_refused() {
    let codec = cdr(PLAIN);
    for (message, word) in
        [(&b"\0\x03\0\0\x07"[..], "PL_CDR"), (b"\0\x0b\0\0", "PL_CDR"), (b"\x01\x01\0\0", "0x0101"), (b"\0", "header")]
    {
        let error = codec.value(message).unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn lying_lengths_are_errors() {
    let codec = cdr("uint8[] a\nA2[] b\n===\nMSG: pkg/A2\nfloat64[1000000] x\n");
    for message in [&b"\0\x01\0\0\xff\xff\xff\xff\x01"[..], b"\0\x01\0\0\0\0\0\0\xff\xff\xff\x7f\0\0\0\0\0\0\0\0"] {
        assert!(codec.value(message).is_err());
        let extract = compiled(&*codec, &["b[0].x[3]"]);
        assert!(extract.extract(message, &mut Row::new(&*extract)).is_err());
    }
}

#[test]
fn definitions_with_everything_a_log_may_hold() {
    let text = "# a = b [c]\nint32 lower=1 # constant\nstring<=5 S = \"a # b\"\nstring<=5[<=3] texts ['x', \"y=#\"]\nbyte b\nchar c 5\n\
                Empty e\nbuiltin_interfaces/Time t\nonly_constants/E k\nwstring w\nHeader header\n\
                =====\nMSG: pkg/Empty\n=====\nMSG: only_constants/E\nint32 A=1\nint32 b=x\n=====\nMSG: std_msgs/Header\ntime stamp\nstring frame_id";
    let codec = cdr(text);
    // texts: none; b, c, e, then t at 8, k, w at 20, header.stamp at 32.
    let message = b"\0\x01\0\0\0\0\0\0\xfe\xfd\0\0\xff\xff\xff\xff\x02\0\0\0\0\0\0\0\x02\0\0\0a\0\0\0\xe9\0\0\0\x03\0\0\0\x04\0\0\0\x01\0\0\0\0";
    let row = row(&*codec, message, &["b", "c", "t.sec", "w", "header.stamp.nanosec"]);
    assert_eq!(row.values, [254.0, 253.0, -1.0, 0.0, 4.0]);
    assert_eq!(row.texts.names(), ["aé"]);
    assert_eq!(row.stamps, [3_000_000_004]);
    let ros1 = codec_ros1("byte b\nchar c\nEmpty e\ntime t\nduration d\n===\nMSG: pkg/Empty\n");
    let row = super::known::row(
        &*ros1,
        b"\xfe\xfd\xff\xff\xff\xff\0\0\0\0\xff\xff\xff\xff\0\0\0\0",
        &["b", "c", "t.secs", "d.secs"],
    );
    assert_eq!(row.values, [-2.0, 253.0, f64::from(u32::MAX), -1.0]);
}

#[test]
fn schemas_that_cannot_be_used_say_why() {
    let parse = |text: &str| problem(codec("cdr", "pkg/msg/A", "ros2msg", text.as_bytes()));
    assert!(parse("B b").contains("`pkg/B` is missing"), "{}", parse("B b"));
    assert!(parse("B b\n===\nMSG: pkg/B\nA a").contains("contains itself"));
    assert!(parse("int8 x\nint16 x").contains("`pkg/msg/A` has two fields `x`"), "{}", parse("int8 x\nint16 x"));
    assert!(parse("int32").contains("missing name"), "{}", parse("int32"));
    let deep: String = (0..40).map(|place| format!("===\nMSG: pkg/T{place}\nT{} t\n", place + 1)).collect();
    assert!(parse(&format!("T0 t\n{deep}===\nMSG: pkg/T40\nint8 x")).contains("deep"));
    let service =
        codec("cdr", "example_interfaces/srv/AddTwoInts_Event", "ros2msg", b"int64 a\nint64 b\n---\nint64 sum\n");
    let service = problem(service);
    assert!(service.contains("`example_interfaces/srv/AddTwoInts_Event` is missing"), "{service}");
    assert!(matches!(codec("cdr", "a/B", "omgidl", b""), Err(SchemaError::UnknownEncoding { .. })));
}

#[test]
fn paths_that_lead_nowhere_say_why() {
    let codec = cdr("float64[] position\nB b\n===\nMSG: pkg/B\nint8[3] covariance\n");
    let error = |path: &str| codec.compile(&[path.parse().unwrap()]).err().map(|error| error.to_string()).unwrap();
    assert!(error("positon[0]").contains("nearest is `position`"), "{}", error("positon[0]"));
    assert!(error("b.covarianc[0]").contains("nearest is `b.covariance`"));
    assert!(error("position").contains("an array"));
    assert!(error("b").contains("`pkg/msg/B`"));
    assert!(error("position[left]").contains("`position[0]`"));
    assert!(error("b.covariance[3]").contains("`b.covariance[2]`"));
    assert_eq!(row(&*codec, &[0, 1, 0, 0, 0, 0, 0, 0, 1, 2, 3], &["b.covariance[2]"]).values, [3.0]);
}

#[test]
fn idl_is_read() {
    let text = r#"================================================================================
IDL: pkg/msg/A
// generated
#include "pkg/msg/B.idl"
module pkg { module msg {
  typedef double double__9[9];
  module A_Constants { const uint8 MODE = 3; @verbatim (language="comment", text="say \"(\" \n" "more") const string S = "}"; };
  enum Kind { ONE, TWO };
  @verbatim (language="comment", text=
    "a comment; } with { everything")
  struct A {
    @unit(value="m") @default (value=1.5)
    double__9 covariance; /* } */
    sequence<pkg::msg::B, 3> bs;
    string<8> s; wstring w;
    Kind kind;
    unsigned long long big;
    short grid[2][A_Constants::MODE];
    @optional long maybe;
  };
}; };
================================================================================
IDL: pkg/msg/B
module pkg { module msg { @final struct B { boolean x; builtin_interfaces::msg::Time stamp; }; }; };
"#;
    let codec = codec("cdr", "pkg/msg/A", "ros2idl", text.as_bytes()).unwrap();
    let mut message = b"\0\x07\0\0".to_vec();
    (0..9).for_each(|place| message.extend(f64::from(place).to_le_bytes()));
    // bs: a length of 16 bytes, one element, x and its padding, the stamp.
    for word in [16_u32, 1, 1, 5, 6] {
        message.extend(word.to_le_bytes());
    }
    message.extend(b"\x02\0\0\0s\0\0\0\0\0\0\0\x01\0\0\0\x09\0\0\0\0\0\0\0");
    (0..6_i16).for_each(|place| message.extend(place.to_le_bytes()));
    message.extend(b"\x01\0\0\0\xfe\xff\xff\xff");
    let fields = ["covariance[8]", "bs[0].stamp.nanosec", "kind", "big", "grid[1][2]", "maybe"];
    assert_eq!(row(&*codec, &message, &fields).values, [8.0, 6.0, 1.0, 9.0, 5.0, -2.0]);
    assert_eq!(codec.value(&message).unwrap().field("maybe"), Some(&Value::Int(-2)));
    message[1] = 1;
    assert!(codec.value(&message).is_err());
}

#[test]
fn unreadable_idl_has_a_reason() {
    let parse = |text: &str| {
        problem(codec("cdr", "p/msg/A", "ros2idl", format!("module p {{ module msg {{ {text} }}; }};").as_bytes()))
    };
    let cases = [
        ("@mutable struct A { long x; };", "@mutable"),
        ("union U switch (long) { case 1: long x; }; struct A { U u; };", "a union"),
        ("struct A { B b; };", "`B` is missing"),
        ("struct A { sequence<A> a; };", "contains itself"),
        ("typedef T U; typedef U T; struct A { T t; };", "deep"),
        ("struct A { long x[N]; };", "`N` is not a constant"),
        ("struct A { long x }", "`;` is missing"),
        ("struct B { long x; };", "there is no struct p::msg::A"),
        ("struct A : A { long x; };", "inherits from itself"),
        ("struct A { @unit(value=\"m long x; };", "does not end"),
    ];
    for (text, word) in cases {
        assert!(parse(text).contains(word), "{}", parse(text));
    }
    let nested = format!("struct A {{ {}long{} x; }};", "sequence<".repeat(10_000), ">".repeat(10_000));
    assert!(parse(&nested).contains("deep"));
}
