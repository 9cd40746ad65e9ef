//! Tests of the field tree.

use proptest::prelude::*;

use super::*;
use crate::{FieldPath, lookup};

fn object(fields: Vec<(&str, Value)>) -> Value {
    Value::Struct(fields.into_iter().map(|(name, value)| (Arc::from(name), value)).collect())
}

fn text(text: &str) -> Value {
    Value::Text(text.to_owned())
}

fn floats(numbers: &[f64]) -> Value {
    Value::Array(numbers.iter().copied().map(Value::Float).collect())
}

fn paths(tree: &FieldTree) -> Vec<String> {
    tree.fields().into_iter().map(|field| field.path).collect()
}

#[test]
fn fields_come_in_schema_order_with_their_keys() {
    let mut tree = FieldTree::default();
    let transform =
        object(vec![("header", object(vec![("frame_id", text("odom"))])), ("child_frame_id", text("base"))]);
    tree.add(&object(vec![
        ("name", Value::Array(vec![text("left"), text("right")])),
        ("position", floats(&[1.0, 2.0])),
        ("effort", floats(&[3.0])),
        ("transforms", Value::Array(vec![transform, object(vec![("id", Value::Int(3))])])),
        ("image", Value::Long(640)),
    ]));
    tree.add(&object(vec![("image", Value::Long(320)), ("late", Value::Bool(true))]));
    let expected = [
        "name[0]",
        "name[1]",
        "position[left]",
        "position[right]",
        "effort[0]",
        "transforms[base].header.frame_id",
        "transforms[base].child_frame_id",
        "transforms[1].id",
        "late",
    ];
    assert_eq!(paths(&tree), expected);
    assert_eq!(tree.skipped(), [("image".to_owned(), 640)]);
    assert_eq!(tree.ignored(), 0);
}

#[test]
fn ambiguous_names_become_indices() {
    let mut tree = FieldTree::default();
    let names = ["7", "", "a]b", "ok"];
    tree.add(&object(vec![
        ("names", Value::Array(names.iter().copied().map(text).collect())),
        ("v", floats(&[1.0, 2.0, 3.0, 4.0])),
    ]));
    assert_eq!(paths(&tree)[4..], ["v[0]", "v[1]", "v[2]", "v[ok]"]);
}

#[test]
fn only_real_xyzw_is_a_rotation() {
    let quaternion = |last: Value| {
        let mut tree = FieldTree::default();
        let parts = ["x", "y", "z"].map(|name| (name, Value::Float(0.0)));
        tree.add(&object(vec![("q", object(parts.into_iter().chain([("w", last)]).collect()))]));
        tree.fields().iter().map(|field| field.quaternion).collect::<Vec<_>>()
    };
    assert_eq!(quaternion(Value::Float(1.0)), [true; 4]);
    assert_eq!(quaternion(Value::Int(1)), [true; 4]);
    assert_eq!(quaternion(text("1")), [false; 4]);
    let mut tree = FieldTree::default();
    let names = ["x", "y", "z", "w", "v"];
    tree.add(&object(names.iter().map(|name| (*name, Value::Float(0.0))).collect()));
    assert!(tree.fields().iter().all(|field| !field.quaternion));
}

#[test]
fn growth_is_bounded_and_reported() {
    let mut tree = FieldTree::default();
    let elements = (0..1000).map(|index| object(vec![("id", Value::Text(format!("n{index}")))])).collect();
    tree.add(&object(vec![("a", Value::Array(elements))]));
    assert_eq!(tree.fields().len(), MAX_ELEMENTS);
    assert_eq!(tree.ignored(), 1000 - MAX_ELEMENTS as u64);

    let mut deep = Value::Int(1);
    for _ in 0..500 {
        deep = Value::Array(vec![deep]);
    }
    let mut tree = FieldTree::default();
    tree.add(&deep);
    assert_eq!((tree.fields().len(), tree.ignored()), (0, 1));

    let mut tree = FieldTree::default();
    for index in 0..MAX_FIELDS + 10 {
        tree.add(&Value::Struct(vec![(Arc::from(format!("f{index}")), Value::Int(1))]));
    }
    assert_eq!((tree.fields().len(), tree.ignored()), (MAX_FIELDS, 10));
}

#[test]
fn fields_without_a_valid_path_are_left_out_and_reported() {
    let mut tree = FieldTree::default();
    let fields = ["", "a.b", "a[0]", "a]", "a"].map(|name| (name, Value::Float(1.0)));
    tree.add(&object(fields.to_vec()));
    let paths: Vec<String> = tree.fields().into_iter().map(|field| field.path).collect();
    assert_eq!((paths, tree.ignored()), (vec!["a".to_owned()], 4));
}

/// Messages whose shape changes from one to the next.
fn message() -> impl Strategy<Value = Value> {
    let name = || prop::sample::select(vec!["x", "y", "name", "id", "names", "w", "key"]);
    let leaf = prop_oneof![
        Just(Value::Null),
        any::<bool>().prop_map(Value::Bool),
        (-9i64..9).prop_map(Value::Int),
        (0u64..9).prop_map(Value::Uint),
        (-4.0f64..4.0).prop_map(Value::Float),
        prop::sample::select(vec!["a", "b", "c", "12"]).prop_map(text),
        (65usize..99).prop_map(Value::Long),
    ];
    leaf.prop_recursive(4, 40, 6, move |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..5).prop_map(Value::Array),
            prop::collection::btree_map(name(), inner, 0..6).prop_map(|fields| object(fields.into_iter().collect())),
        ]
    })
}

/// Returns true if two elements of an array have the same name.
fn repeats_a_name(value: &Value) -> bool {
    let twice = |names: Vec<&str>| (1..names.len()).any(|place| names[..place].contains(&names[place]));
    match value {
        Value::Struct(fields) => {
            let names = keys::names(fields).map(|(_, names)| names).unwrap_or_default();
            let names = names
                .iter()
                .filter_map(|name| if let Value::Text(name) = name { Some(&**name) } else { None })
                .collect();
            twice(names) || fields.iter().any(|(_, value)| repeats_a_name(value))
        }
        Value::Array(elements) => {
            twice(elements.iter().filter_map(keys::key).collect()) || elements.iter().any(repeats_a_name)
        }
        _ => false,
    }
}

/// Texts, bounds and counts alike; means up to rounding.
fn assert_same(left: &FieldTree, right: &FieldTree) {
    let (mut a, mut b) = (left.fields(), right.fields());
    for (a, b) in a.iter_mut().zip(&mut b) {
        assert!((a.mean - b.mean).abs() < 1e-12 || a.mean.is_nan() && b.mean.is_nan(), "{a:?} {b:?}");
        for field in [a, b] {
            field.mean = 0.0;
            if field.min.is_nan() {
                (field.min, field.max) = (0.0, 0.0);
            }
        }
    }
    assert_eq!(a, b);
    assert_eq!(left.skipped(), right.skipped());
    assert_eq!(left.ignored(), right.ignored());
}

proptest! {
    #[test]
    fn merging_in_order_is_adding_all(messages in prop::collection::vec(message(), 1..8), at in 0usize..8) {
        let mut whole = FieldTree::default();
        let mut parts = [FieldTree::default(), FieldTree::default(), FieldTree::default()];
        for (place, message) in messages.iter().enumerate() {
            whole.add(message);
            parts[if place < at { 0 } else if place < at + 2 { 1 } else { 2 }].add(message);
        }
        let [mut first, second, third] = parts;
        first.merge(second);
        first.merge(third);
        assert_same(&first, &whole);
    }

    #[test]
    fn paths_read_back_and_reach_values(message in message()) {
        // Of two elements with one name only the last can be looked up.
        prop_assume!(!repeats_a_name(&message));
        let mut tree = FieldTree::default();
        tree.add(&message);
        for field in tree.fields() {
            let path: FieldPath = field.path.parse().unwrap();
            prop_assert_eq!(path.to_string(), field.path.clone());
            let value = lookup::follow(&message, &path.steps, |_| ());
            prop_assert!(value.is_some(), "{} in {:?}", field.path, message);
            if field.count == 1 && field.kind != FieldKind::Text {
                prop_assert_eq!(value.and_then(Value::number), Some(field.mean));
            }
        }
    }
}
