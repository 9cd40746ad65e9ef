//! `tf2_msgs`: coordinate frames in each other.

use super::{
    Header, Message,
    cdr::Cdr,
    definition::{header, quaternion, section, vector3},
};

/// `tf2_msgs/msg/TFMessage`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TFMessage<'a> {
    /// Any number of frames, each once.
    pub transforms: &'a [TransformStamped<'a>],
}

/// `geometry_msgs/msg/TransformStamped`: a frame in its parent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransformStamped<'a> {
    /// When, and the parent frame.
    pub header: Header<'a>,
    /// The frame.
    pub child_frame_id: &'a str,
    /// x, y, z of its origin in metres.
    pub translation: [f64; 3],
    /// x, y, z, w; of length one.
    pub rotation: [f64; 4],
}

impl Default for TransformStamped<'_> {
    /// The parent frame itself.
    fn default() -> Self {
        Self { header: Header::default(), child_frame_id: "", translation: [0.0; 3], rotation: [0.0, 0.0, 0.0, 1.0] }
    }
}

impl Message for TFMessage<'_> {
    const NAME: &'static str = "tf2_msgs/msg/TFMessage";
    const SCHEMA: &'static str = concat!(
        "geometry_msgs/TransformStamped[] transforms\n",
        section!(
            "geometry_msgs/TransformStamped",
            "std_msgs/Header header\nstring child_frame_id\nTransform transform\n"
        ),
        section!("geometry_msgs/Transform", "Vector3 translation\nQuaternion rotation\n"),
        quaternion!(),
        vector3!(),
        header!()
    );

    fn encode(&self, out: &mut Vec<u8>) {
        let mut cdr = Cdr::begin(out);
        cdr.count(self.transforms.len());
        for transform in self.transforms {
            transform.header.put(&mut cdr);
            cdr.text(transform.child_frame_id);
            cdr.f64s(&transform.translation);
            cdr.f64s(&transform.rotation);
        }
    }
}
