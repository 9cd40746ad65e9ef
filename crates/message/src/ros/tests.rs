//! Tests of decoding: known bytes, random schemas on every wire, and damage.

mod encode;
mod known;
mod random;

use proptest::prelude::*;

use self::random::Random;
use super::{RosCodec, wire::Wire};
use crate::{Codec, FieldPath, Row, Schema, Type, Value, lookup::Lookup, value::LONG_ARRAY};

/// Value as [`Codec::value`] returns it: long arrays of numbers are only counted.
fn shortened(value: &Value) -> Value {
    match value {
        Value::Array(elements) => {
            let is_number = |value: &Value| !matches!(value, Value::Text(_) | Value::Struct(_) | Value::Array(_));
            if elements.len() > LONG_ARRAY && elements.iter().all(is_number) {
                return Value::Long(elements.len());
            }
            Value::Array(elements.iter().map(shortened).collect())
        }
        Value::Struct(fields) => {
            Value::Struct(fields.iter().map(|(name, value)| (name.clone(), shortened(value))).collect())
        }
        other => other.clone(),
    }
}

/// A random schema for a wire, a value of it, some paths, and the value's bytes.
fn example(seed: u64, wire: Wire, big: bool) -> (Schema, Value, Vec<FieldPath>, Vec<u8>) {
    let mut random = Random(seed);
    let schema = random::schema(&mut random, matches!(wire, Wire::Plain2 | Wire::Delimited2));
    let value = random::value(&mut random, &schema, &Type::Struct(schema.root));
    let mut paths = random::paths(&schema);
    let most = [1, 3, 40][random.below(3)];
    while paths.len() > most {
        let place = random.below(paths.len());
        paths.swap_remove(place);
    }
    let bytes = encode::encode(&schema, wire, big, &value);
    (schema, value, paths, bytes)
}

/// Equal, and NaN where NaN is.
fn same(a: &[f64], b: &[f64]) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a == b || (a.is_nan() && b.is_nan()))
}

fn wires() -> impl Strategy<Value = (Wire, bool)> {
    prop_oneof![
        Just((Wire::Ros1, false)),
        any::<bool>().prop_map(|big| (Wire::Xcdr1, big)),
        any::<bool>().prop_map(|big| (Wire::Plain2, big)),
        any::<bool>().prop_map(|big| (Wire::Delimited2, big)),
    ]
}

/// Holds both decoders against the values that a message was made of.
fn decoded_as_written(seed: u64, wire: Wire, big: bool) -> Result<(), TestCaseError> {
    let (schema, value, paths, bytes) = example(seed, wire, big);
    let codec = RosCodec::new(schema, wire == Wire::Ros1);
    prop_assert_eq!(codec.value(&bytes).unwrap(), shortened(&value));
    let extract = codec.compile(&paths).unwrap();
    let oracle = Lookup::new(&paths);
    prop_assert_eq!(extract.groups(), oracle.groups());
    let mut row = Row::new(&*extract);
    let mut expected = Row::new(&*extract);
    // Twice, so that nothing of the first message is left in the row.
    for _ in 0..2 {
        extract.extract(&bytes, &mut row).unwrap();
        oracle.extract(&value, &mut expected);
        // A text that is missing has no code.
        let text = |row: &Row, slot: usize| {
            Some(row.values[slot]).filter(|code| !code.is_nan()).map(|code| row.texts.names()[code as usize].clone())
        };
        for (slot, path) in paths.iter().enumerate() {
            if row.is_text[slot] || expected.is_text[slot] && !expected.values[slot].is_nan() {
                prop_assert_eq!(text(&row, slot), text(&expected, slot), "{}", path);
            } else {
                prop_assert!(same(&row.values[slot..=slot], &expected.values[slot..=slot]), "{}", path);
            }
        }
        prop_assert_eq!(&row.present, &expected.present, "{:?}", &paths);
        prop_assert_eq!(&row.stamps, &expected.stamps, "{:?}", &paths);
    }
    Ok(())
}

/// Three elements of one name, of which the last lacks the wanted text that another has.
#[test]
fn an_earlier_elements_text_does_not_shine_through() {
    decoded_as_written(16284606466296353364, Wire::Ros1, false).unwrap();
}

/// Messages to try; the size of sweeps is told as everywhere (`make test-all`).
fn cases() -> u32 {
    if std::env::var_os("FLEETFOOT_SWEEPS").is_some_and(|size| size == "full") { 4000 } else { 600 }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(cases()))]

    #[test]
    fn random_messages_read_back_equal(seed: u64, (wire, big) in wires()) {
        decoded_as_written(seed, wire, big)?;
    }

    #[test]
    fn truncated_message_is_error_or_equal(seed: u64, (wire, big) in wires()) {
        let (schema, _, paths, bytes) = example(seed, wire, big);
        let codec = RosCodec::new(schema, wire == Wire::Ros1);
        let extract = codec.compile(&paths).unwrap();
        let mut whole = Row::new(&*extract);
        extract.extract(&bytes, &mut whole).unwrap();
        let mut row = Row::new(&*extract);
        row.texts = whole.texts.clone();
        for length in 0..bytes.len() {
            prop_assert!(codec.value(&bytes[..length]).is_err(), "{} of {}", length, bytes.len());
            if extract.extract(&bytes[..length], &mut row).is_ok() {
                prop_assert!(same(&row.values, &whole.values));
                prop_assert_eq!(&row.present, &whole.present);
                prop_assert_eq!(&row.stamps, &whole.stamps);
            }
        }
    }

    #[test]
    fn damaged_bytes_do_no_harm(seed: u64, (wire, big) in wires(), flips in prop::collection::vec(any::<(usize, u8)>(), 1..8)) {
        let (schema, _, paths, mut bytes) = example(seed, wire, big);
        let codec = RosCodec::new(schema, wire == Wire::Ros1);
        let extract = codec.compile(&paths).unwrap();
        let mut row = Row::new(&*extract);
        for (place, bits) in flips {
            let place = place % bytes.len();
            bytes[place] ^= bits;
            let value = codec.value(&bytes);
            let extracted = extract.extract(&bytes, &mut row);
            // Every part of a sound message is sound.
            if value.is_ok() {
                prop_assert!(extracted.is_ok(), "{:?}", extracted);
            }
        }
    }
}
