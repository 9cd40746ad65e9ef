//! Sensors and clocks as they are on machines: noise, biases, wrong and missing samples, and stamps that are not true time.
//!
//! Every sensor draws from streams of its own ([`stream`]), so that switching one off changes nothing else. Times are true time in ns since
//! a run's beginning; stamps are ns since 1970 by some computer's [`Clock`]. A sensor's loop, once a period:
//!
//! ```text
//! sample at true time t  ->  header stamp by the clock of its computer (Stamper)
//!                        ->  arrival by the link to the logging computer (Latency), log stamp by its clock
//!                        ->  Outbox  ->  Sink, in the order of log stamps
//! ```
//!
//! Samples are taken at even steps of true time. A real computer takes them by its own clock; at the skew of a quartz that is some
//! nanoseconds a sample, and the stamps tell the same.

mod check;
mod clock;
mod clocks;
mod encoder;
mod imu;
mod latency;
mod mocap;
mod outbox;
mod quantise;
mod streams;
mod sync;
#[cfg(test)]
mod tests;

pub(crate) use clock::nanoseconds;
pub use clock::{Clock, ClockParameters, Stamper};
pub use clocks::{Clocks, ClocksParameters};
pub use encoder::{Encoder, EncoderParameters, EncoderSample};
pub use imu::{AccelerometerParameters, BodyMotion, GyroscopeParameters, Imu, ImuParameters, ImuSample};
pub use latency::{Latency, LatencyParameters};
pub use mocap::{Mocap, MocapFaultParameters, MocapFrame, MocapParameters, MocapPose};
pub use outbox::Outbox;
pub use streams::stream;
pub use sync::{SyncWave, SyncWaveParameters};
