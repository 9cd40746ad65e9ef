use crate::{Codec, FieldPath, Row, Value, codec};

fn made(encoding: &str, name: &str, text: &str) -> Box<dyn Codec> {
    codec(encoding, Some((name, encoding, text.as_bytes()))).unwrap()
}

fn read(codec: &dyn Codec, message: &[u8], paths: &[&str]) -> (Vec<f64>, Vec<String>) {
    let paths: Vec<FieldPath> = paths.iter().map(|path| path.parse().unwrap()).collect();
    let extract = codec.compile(&paths).unwrap();
    let mut row = Row::new(&*extract);
    extract.extract(message, &mut row).unwrap();
    (row.values, row.texts.names().to_vec())
}

#[test]
fn letters_of_dataflash_with_their_factors_and_units() {
    let text = "TimeUS\tQ\t\tus\nTemp\tc\t\tdegC\nLat\tL\t\tdeg\nV\tH\t0.001\tV\nHalf\tg\t\t\nName\tn\t\t\nA\ta\t\t\n";
    let codec = made("dataflash", "X", text);
    let mut message = 1_500_000_u64.to_le_bytes().to_vec();
    message.extend((-1234_i16).to_le_bytes());
    message.extend((-353_632_621_i32).to_le_bytes());
    message.extend(12_345_u16.to_le_bytes());
    message.extend(0xc500_u16.to_le_bytes());
    message.extend(b"ab\0c");
    message.extend((0..32_i16).flat_map(|k| (k - 5).to_le_bytes()));
    let paths = ["TimeUS", "Temp", "Lat", "V", "Half", "A[31]", "Name"];
    let (values, texts) = read(&*codec, &message, &paths);
    assert_eq!(values, [1.5e6, -12.34, -35.3632621, 12.345, -5.0, 26.0, 0.0]);
    assert_eq!(texts, ["ab"]);
    assert_eq!(codec.unit(&"V".parse().unwrap()).as_deref(), Some("V"));
    assert_eq!(codec.unit(&"Half".parse().unwrap()), None);
    let value = codec.value(&message).unwrap();
    assert_eq!(value.field("TimeUS"), Some(&Value::Uint(1_500_000)));
    assert_eq!(value.field("Temp"), Some(&Value::Float(-12.34)));
    assert!(codec.value(&message[..message.len() - 1]).is_err());
    let error = |path: &str| codec.compile(&[path.parse().unwrap()]).err().unwrap().to_string();
    assert!(error("Tmp").contains("nearest is `Temp`") && error("A").contains("an array"), "{}", error("A"));
    assert!(error("A[32]").contains("no field"));
    let unknown = crate::codec("dataflash", Some(("X", "dataflash", b"a\t?\t\t\n"))).err().unwrap().to_string();
    assert!(unknown.contains("the type `?` of `a`"), "{unknown}");
}

#[test]
fn wpilog_arrays_fill_the_message() {
    let codec = made("wpilog", "double[]", "");
    let message: Vec<u8> = [1.5, -2.0].iter().flat_map(|value: &f64| value.to_le_bytes()).collect();
    assert_eq!(read(&*codec, &message, &["value[1]"]).0, [-2.0]);
    assert!(read(&*codec, &message, &["value[2]"]).0[0].is_nan(), "an element that this message lacks");
    assert!(codec.value(&message[..9]).is_err());
    assert_eq!(codec.value(&[0; 800]).unwrap().field("value"), Some(&Value::Long(100)));
    assert_eq!(read(&*made("wpilog", "string", ""), b"tele", &["value"]).1, ["tele"]);
    let texts = [&2_u32.to_le_bytes()[..], &1_u32.to_le_bytes(), b"a", &2_u32.to_le_bytes(), b"bc"].concat();
    assert_eq!(read(&*made("wpilog", "string[]", ""), &texts, &["value[1]"]).1, ["bc"]);
    // A count that lies.
    assert!(made("wpilog", "string[]", "").value(&u32::MAX.to_le_bytes()).is_err());
}

#[test]
fn structs_of_wpilog_nest_and_pack_bits() {
    let text = "Pose\tTranslation t;double[2] wrong\nTranslation\tdouble x;double y\n";
    assert!(crate::codec("wpilog", Some(("struct:Pose", "wpilog", text.as_bytes()))).is_err());
    let text = "Pose\tTranslation t; float r[2]; char name[4]\nTranslation\tdouble x;double y;\n";
    let codec = made("wpilog", "struct:Pose[]", text);
    let mut one: Vec<u8> = [1.0_f64, 2.0].iter().flat_map(|value| value.to_le_bytes()).collect();
    one.extend([3.0_f32, 4.0].iter().flat_map(|value| value.to_le_bytes()));
    one.extend(b"ab\0\0");
    let two = [one.clone(), one].concat();
    let paths = ["value[1].t.y", "value[0].r[1]", "value[1].name"];
    let (values, texts) = read(&*codec, &two, &paths);
    assert_eq!((values, texts), (vec![2.0, 4.0, 0.0], vec!["ab".to_owned()]));
    // Elements that carry a name can be asked for by it.
    assert_eq!(read(&*codec, &two, &["value[ab].t.x"]).0, [1.0]);
    // The layout of WPILib's own documentation: a truth value joins the number before it.
    let text = "Flags\tint8 a:4;bool b:1;enum {on=1, off=2} int16 c:3; uint8 d; bool e:1; int16 f:9";
    let codec = made("wpilog", "struct:Flags", text);
    let message = [0b0001_1001, 0b101, 0, 200, 1, 0b1111_1111, 1];
    let (values, _) = read(&*codec, &message, &["a", "b", "c", "d", "e", "f"]);
    assert_eq!(values, [-7.0, 1.0, -3.0, 200.0, 1.0, -1.0]);
    assert!(codec.value(&message[..6]).is_err());
}

#[test]
fn schemas_of_wpilog_that_lie_are_refused() {
    let problem = |name: &str, text: &str| {
        crate::codec("wpilog", Some((name, "wpilog", text.as_bytes()))).err().unwrap().to_string()
    };
    assert!(problem("struct:A", "A\tA a").contains("contains itself"));
    assert!(problem("struct:A", "A\tB b").contains("schema of `struct:B` is not in the file"));
    assert!(problem("struct:A", "A\t").contains("no fields"));
    assert!(problem("struct:A", "A\tint8 a:9").contains("9 bits"));
    assert!(problem("struct:A", "A\tdouble x[0]").contains("not a field"));
    assert!(problem("msgpack", "").contains("not read"));
    // Sizes beyond every message, and structs that double thirty times.
    let codec = made("wpilog", "struct:A", "A\tdouble x[4000000000]\n");
    assert!(codec.value(&[0; 64]).is_err());
    let text: String = (0..30).map(|k| format!("S{k}\tS{} a;S{} b\n", k + 1, k + 1)).collect();
    assert!(made("wpilog", "struct:S0", &(text + "S30\tint8 a\n")).value(&[0; 64]).is_err());
}
