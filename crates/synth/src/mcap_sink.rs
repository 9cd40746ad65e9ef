//! Readings into MCAP files, as the ROS 2 messages that robots log.

use std::path::Path;

use fleetfoot_fit::Error;
use fleetfoot_message::write::{
    Bool, Float64, Float64MultiArray, Header, Illuminance, Imu, JointState, Message, MultiArrayDimension, Odometry,
    Pose, PoseStamped, Time, Twist, TwistStamped, Vector3Stamped,
};
use fleetfoot_output::{ChannelId, McapOptions, McapWriter};
use fleetfoot_sim::{Kind, Reading, SinkError, Stamps, Topic};

/// First entry of the orientation's covariance in an [`Imu`] that measures none.
const NOT_MEASURED: f64 = -1.0;

/// A run's MCAP file under construction.
pub(super) struct McapSink {
    writer: McapWriter,
    /// In the order of the scenario's topics; `None` for topics that are left out.
    topics: Vec<Option<Channel>>,
}

/// A topic in the file.
struct Channel {
    id: ChannelId,
    topic: Topic,
    /// Row-major covariances of the angular velocity and the linear acceleration of an inertial unit.
    covariances: [[f64; 9]; 2],
}

/// The type of the messages that hold a kind of readings.
pub(super) fn message_type(kind: &Kind) -> Option<&'static str> {
    Some(match kind {
        Kind::Imu { .. } => Imu::NAME,
        Kind::Joints(_) => JointState::NAME,
        Kind::Pose => PoseStamped::NAME,
        Kind::Odometry { .. } => Odometry::NAME,
        Kind::Twist => TwistStamped::NAME,
        Kind::Vector => Vector3Stamped::NAME,
        Kind::Light => Illuminance::NAME,
        Kind::Number => Float64::NAME,
        Kind::Flag => Bool::NAME,
        Kind::Numbers(_) => Float64MultiArray::NAME,
        _ => return None,
    })
}

impl McapSink {
    /// Begins a file with these topics; those that `keep` refuses are left out.
    pub(super) fn create(
        path: &Path,
        options: &McapOptions,
        topics: Vec<Topic>,
        keep: impl Fn(&Topic) -> bool,
    ) -> Result<Self, Error> {
        let mut writer = McapWriter::create(path, options)?;
        let mut channels = Vec::with_capacity(topics.len());
        for topic in topics {
            channels.push(if keep(&topic) { Some(Channel::open(&mut writer, topic)?) } else { None });
        }
        Ok(Self { writer, topics: channels })
    }

    /// Writes a reading of the topic with this index; false where the topic is left out.
    pub(super) fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<bool, SinkError> {
        match self.topics.get(topic) {
            None => Err(format!("topic {topic} of {}", self.topics.len()).into()),
            Some(None) => Ok(false),
            Some(Some(channel)) => channel.write(&mut self.writer, stamps, reading).map(|()| true),
        }
    }

    /// Completes the file.
    pub(super) fn finish(self) -> Result<(), Error> {
        Ok(self.writer.finish()?)
    }
}

impl Channel {
    fn open(writer: &mut McapWriter, topic: Topic) -> Result<Self, Error> {
        let name = &topic.name;
        let id = match &topic.kind {
            Kind::Imu { .. } => writer.channel::<Imu<'_>>(name),
            Kind::Joints(_) => writer.channel::<JointState<'_>>(name),
            Kind::Pose => writer.channel::<PoseStamped<'_>>(name),
            Kind::Odometry { .. } => writer.channel::<Odometry<'_>>(name),
            Kind::Twist => writer.channel::<TwistStamped<'_>>(name),
            Kind::Vector => writer.channel::<Vector3Stamped<'_>>(name),
            Kind::Light => writer.channel::<Illuminance<'_>>(name),
            Kind::Number => writer.channel::<Float64>(name),
            Kind::Flag => writer.channel::<Bool>(name),
            Kind::Numbers(_) => writer.channel::<Float64MultiArray<'_>>(name),
            other => {
                return Err(Error::internal(format!(
                    "the topic {name} has readings ({other:?}) that no message holds"
                )));
            }
        }?;
        let covariances = match topic.kind {
            Kind::Imu { angular_velocity_deviation: gyroscope, linear_acceleration_deviation: accelerometer } => {
                [diagonal(gyroscope * gyroscope), diagonal(accelerometer * accelerometer)]
            }
            _ => [[0.0; 9]; 2],
        };
        Ok(Self { id, topic, covariances })
    }

    fn write(&self, writer: &mut McapWriter, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
        let Self { id, topic, covariances } = self;
        // Messages without a stamp of their own keep the sensor's as the time of publication.
        let (log, publish) = (stamps.log, stamps.header);
        let header = || match Time::from_nanoseconds(stamps.header) {
            Some(stamp) => Ok(Header { stamp, frame_id: &topic.frame }),
            None => Err(format!(
                "{}: the stamp {} ns does not fit into a message: it is after 2038",
                topic.name, stamps.header
            )),
        };
        match (&topic.kind, reading) {
            (Kind::Imu { .. }, Reading::Imu { angular_velocity, linear_acceleration }) => {
                let mut message = Imu { header: header()?, ..Imu::default() };
                message.orientation_covariance[0] = NOT_MEASURED;
                message.angular_velocity = angular_velocity.to_array();
                message.linear_acceleration = linear_acceleration.to_array();
                [message.angular_velocity_covariance, message.linear_acceleration_covariance] = *covariances;
                writer.write(*id, log, publish, &message)?;
            }
            (Kind::Joints(names), Reading::Joints { position, velocity, effort }) => {
                let name: Vec<&str> = names.iter().map(String::as_str).collect();
                let message = JointState { header: header()?, name: &name, position, velocity, effort };
                writer.write(*id, log, publish, &message)?;
            }
            (Kind::Pose, Reading::Pose { position, orientation }) => {
                let pose = Pose { position: position.to_array(), orientation: orientation.to_array() };
                writer.write(*id, log, publish, &PoseStamped { header: header()?, pose })?;
            }
            (
                Kind::Odometry { child_frame },
                Reading::Odometry { position, orientation, linear_velocity, angular_velocity },
            ) => {
                let message = Odometry {
                    header: header()?,
                    child_frame_id: child_frame,
                    pose: Pose { position: position.to_array(), orientation: orientation.to_array() },
                    twist: Twist { linear: linear_velocity.to_array(), angular: angular_velocity.to_array() },
                    ..Odometry::default()
                };
                writer.write(*id, log, publish, &message)?;
            }
            (Kind::Twist, Reading::Twist { linear, angular }) => {
                let twist = Twist { linear: linear.to_array(), angular: angular.to_array() };
                writer.write(*id, log, publish, &TwistStamped { header: header()?, twist })?;
            }
            (Kind::Vector, Reading::Vector(vector)) => {
                writer.write(*id, log, publish, &Vector3Stamped { header: header()?, vector: vector.to_array() })?;
            }
            (Kind::Light, Reading::Light(illuminance)) => {
                let message = Illuminance { header: header()?, illuminance, ..Illuminance::default() };
                writer.write(*id, log, publish, &message)?;
            }
            (Kind::Number, Reading::Number(data)) => writer.write(*id, log, publish, &Float64 { data })?,
            (Kind::Flag, Reading::Flag(data)) => writer.write(*id, log, publish, &Bool { data })?,
            (Kind::Numbers(labels), Reading::Numbers(data)) => {
                let label = labels.join(",");
                let size = data.len() as u32;
                let dim = [MultiArrayDimension { label: &label, size, stride: size }];
                writer.write(*id, log, publish, &Float64MultiArray { dim: &dim, data_offset: 0, data })?;
            }
            (kind, reading) => {
                return Err(format!("{}: {reading:?} on a topic of {kind:?}", topic.name).into());
            }
        }
        Ok(())
    }
}

fn diagonal(value: f64) -> [f64; 9] {
    let mut matrix = [0.0; 9];
    (0..3).for_each(|i| matrix[4 * i] = value);
    matrix
}
