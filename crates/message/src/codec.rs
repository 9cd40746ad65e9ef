//! Decoder for a channel, chosen by the channel's encodings.

use crate::{Codec, SchemaError, json, packed, protobuf, ros};

/// The decoder for the messages of a channel: how they are encoded, and the name, encoding and bytes of their schema where there is one.
///
/// # Errors
/// Encodings that are not known, a schema that is missing or cannot be understood.
pub fn codec(message_encoding: &str, schema: Option<(&str, &str, &[u8])>) -> Result<Box<dyn Codec>, SchemaError> {
    match (message_encoding, schema) {
        ("cdr", Some((name, encoding @ ("ros2msg" | "ros2idl"), data)))
        | ("ros1", Some((name, encoding @ "ros1msg", data)))
        | ("ulog", Some((name, encoding @ "ulog", data))) => ros::codec(message_encoding, name, encoding, data),
        ("dataflash", Some((name, "dataflash", data))) => packed::dataflash::codec(name, data),
        ("wpilog", Some((name, "wpilog", data))) => packed::wpilog::codec(name, data),
        ("protobuf", Some((name, "protobuf", data))) => protobuf::codec(name, data),
        ("json", Some((name, "jsonschema", data))) => json::codec(name, Some(data)),
        // A schema without an encoding says nothing.
        ("json", None | Some((_, "", _))) => json::codec("", None),
        ("cdr" | "ros1" | "ulog" | "protobuf", None | Some((_, "", []))) => {
            Err(SchemaError::NoSchema { message: message_encoding.to_owned() })
        }
        (_, schema) => Err(SchemaError::UnknownEncoding {
            message: message_encoding.to_owned(),
            schema: schema.map_or("", |(_, encoding, _)| encoding).to_owned(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encodings_find_their_decoders() {
        let imu = ("std_msgs/msg/Float64", "ros2msg", &b"float64 data\n"[..]);
        assert!(codec("cdr", Some(imu)).is_ok());
        assert!(codec("ros1", Some(("std_msgs/Float64", "ros1msg", b"float64 data\n"))).is_ok());
        assert!(codec("json", None).is_ok());
        assert!(codec("json", Some(("t", "", b""))).is_ok());
        assert!(codec("json", Some(("t", "jsonschema", b"{}"))).is_ok());
        let error = |message, schema| codec(message, schema).err().unwrap();
        assert!(matches!(error("json", Some(("t", "jsonschema", b"?"))), SchemaError::Malformed { .. }));
        assert!(matches!(error("protobuf", Some(("t", "protobuf", b""))), SchemaError::Malformed { .. }));
        for encoding in ["cdr", "ros1", "ulog", "protobuf"] {
            assert_eq!(error(encoding, None), SchemaError::NoSchema { message: encoding.to_owned() });
        }
        for (message, schema) in
            [("cdr", "ros1msg"), ("ros1", "ros2msg"), ("protobuf", "jsonschema"), ("cbor", ""), ("json", "protobuf")]
        {
            let expected = SchemaError::UnknownEncoding { message: message.to_owned(), schema: schema.to_owned() };
            assert_eq!(error(message, Some(("t", schema, b"x"))), expected);
        }
    }
}
