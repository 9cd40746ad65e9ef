//! Messages on their way to the log.

use std::{cmp::Reverse, collections::BinaryHeap};

use crate::{Reading, Sink, SinkError, Stamps};

/// Messages that are made now and logged later, given to the sink in the order of their log stamps.
///
/// Memory is what is on its way: with delays of at most D and N messages a second, N D of them. Places are used again, so that once the
/// busiest moment has passed nothing is allocated.
#[derive(Debug, Default)]
pub struct Outbox {
    /// The next message to deliver on top: by log stamp, topic, order of sending.
    queue: BinaryHeap<Reverse<Ticket>>,
    places: Vec<Place>,
    free: Vec<u32>,
    sent: u64,
    /// Log stamps before it have been delivered.
    horizon: i64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Ticket {
    log: i64,
    topic: u32,
    sequence: u64,
    place: u32,
}

/// A message that waits.
#[derive(Debug)]
struct Place {
    header: i64,
    body: Body,
    /// Numbers that the reading borrowed.
    numbers: Vec<f64>,
}

/// A reading without what it borrows.
#[derive(Debug, Clone, Copy)]
enum Body {
    /// Nothing is borrowed.
    Whole(Reading<'static>),
    /// Positions, velocities and efforts follow one another, as many as said.
    Joints([usize; 3]),
    Numbers,
}

impl Outbox {
    /// An outbox with nothing in it, for log stamps from `i64::MIN` on.
    pub fn new() -> Self {
        Self { horizon: i64::MIN, ..Self::default() }
    }

    /// Number of messages on their way.
    pub fn len(&self) -> usize {
        self.queue.len()
    }

    /// Returns true if no message is on its way.
    pub fn is_empty(&self) -> bool {
        self.queue.is_empty()
    }

    /// Sends a message on the topic with this index.
    ///
    /// A message whose time is before that of the last [`Outbox::flush_until`] is logged at that time: a log's stamps
    /// never go back.
    pub fn push(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) {
        let place = self.free.pop().unwrap_or_else(|| {
            self.places.push(Place { header: 0, body: Body::Numbers, numbers: Vec::new() });
            (self.places.len() - 1) as u32
        });
        let slot = &mut self.places[place as usize];
        slot.header = stamps.header;
        slot.keep(reading);
        let log = stamps.log.max(self.horizon);
        self.queue.push(Reverse(Ticket { log, topic: topic as u32, sequence: self.sent, place }));
        self.sent += 1;
    }

    /// Delivers all messages whose log stamps are before `time` (ns since 1970, by the logging clock). Those of one stamp go in the order of
    /// their topics, those of one topic in the order of sending.
    ///
    /// To be called with what the logging clock shows now: what is sent later is also logged later.
    ///
    /// # Errors
    /// That of the sink. The message that it refused is gone, those after it wait.
    pub fn flush_until(&mut self, time: i64, sink: &mut dyn Sink) -> Result<(), SinkError> {
        self.horizon = self.horizon.max(time);
        while self.queue.peek().is_some_and(|Reverse(next)| next.log < time) {
            self.deliver(sink)?;
        }
        Ok(())
    }

    /// Delivers all that is on its way: the end of a log.
    ///
    /// # Errors
    /// That of the sink.
    pub fn finish(mut self, sink: &mut dyn Sink) -> Result<(), SinkError> {
        while !self.queue.is_empty() {
            self.deliver(sink)?;
        }
        Ok(())
    }

    fn deliver(&mut self, sink: &mut dyn Sink) -> Result<(), SinkError> {
        let Some(Reverse(ticket)) = self.queue.pop() else { return Ok(()) };
        self.free.push(ticket.place);
        let place = &self.places[ticket.place as usize];
        let stamps = Stamps { header: place.header, log: ticket.log };
        sink.message(ticket.topic as usize, stamps, place.reading())
    }
}

impl Place {
    fn keep(&mut self, reading: Reading<'_>) {
        self.numbers.clear();
        self.body = match reading {
            Reading::Joints { position, velocity, effort } => {
                let parts = [position, velocity, effort];
                parts.iter().for_each(|part| self.numbers.extend_from_slice(part));
                Body::Joints(parts.map(<[f64]>::len))
            }
            Reading::Numbers(numbers) => {
                self.numbers.extend_from_slice(numbers);
                Body::Numbers
            }
            // Field by field: what borrows nothing lives as long as it likes.
            Reading::Imu { angular_velocity, linear_acceleration } => {
                Body::Whole(Reading::Imu { angular_velocity, linear_acceleration })
            }
            Reading::Pose { position, orientation } => Body::Whole(Reading::Pose { position, orientation }),
            Reading::Odometry { position, orientation, linear_velocity, angular_velocity } => {
                Body::Whole(Reading::Odometry { position, orientation, linear_velocity, angular_velocity })
            }
            Reading::Twist { linear, angular } => Body::Whole(Reading::Twist { linear, angular }),
            Reading::Vector(vector) => Body::Whole(Reading::Vector(vector)),
            Reading::Light(light) => Body::Whole(Reading::Light(light)),
            Reading::Number(number) => Body::Whole(Reading::Number(number)),
            Reading::Flag(flag) => Body::Whole(Reading::Flag(flag)),
        };
    }

    fn reading(&self) -> Reading<'_> {
        match self.body {
            Body::Whole(reading) => reading,
            Body::Numbers => Reading::Numbers(&self.numbers),
            Body::Joints([positions, velocities, efforts]) => {
                let (position, rest) = self.numbers.split_at(positions);
                let (velocity, effort) = rest.split_at(velocities);
                Reading::Joints { position, velocity, effort: &effort[..efforts] }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;

    /// Keeps what it is given, as text where it borrows.
    #[derive(Default)]
    struct Log {
        messages: Vec<(usize, Stamps, String)>,
        refuse: Option<usize>,
    }

    impl Sink for Log {
        fn message(&mut self, topic: usize, stamps: Stamps, reading: Reading<'_>) -> Result<(), SinkError> {
            if self.refuse == Some(self.messages.len()) {
                self.refuse = None;
                return Err("full".into());
            }
            self.messages.push((topic, stamps, format!("{reading:?}")));
            Ok(())
        }
    }

    fn stamps(header: i64, log: i64) -> Stamps {
        Stamps { header, log }
    }

    #[test]
    fn messages_come_by_log_stamp_then_topic_then_sequence() {
        let (mut outbox, mut log) = (Outbox::new(), Log::default());
        for (number, (topic, stamp)) in [(2, 50), (1, 70), (1, 50), (1, 50), (0, 20), (2, 20)].into_iter().enumerate() {
            outbox.push(topic, stamps(number as i64, stamp), Reading::Number(number as f64));
        }
        outbox.flush_until(50, &mut log).unwrap();
        assert_eq!((log.messages.len(), outbox.len()), (2, 4));
        outbox.flush_until(51, &mut log).unwrap();
        outbox.finish(&mut log).unwrap();
        let order: Vec<_> = log.messages.iter().map(|(topic, stamps, _)| (*topic, stamps.log, stamps.header)).collect();
        assert_eq!(order, [(0, 20, 4), (2, 20, 5), (1, 50, 2), (1, 50, 3), (2, 50, 0), (1, 70, 1)]);
    }

    #[test]
    fn messages_arrive_unchanged() {
        let (a, b, turned) = (DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0), DQuat::from_rotation_x(0.3));
        let many: Vec<f64> = (0..40).map(f64::from).collect();
        let readings = [
            Reading::Imu { angular_velocity: a, linear_acceleration: b },
            Reading::Joints { position: &many[..2], velocity: &[], effort: &many[7..12] },
            Reading::Joints { position: &[], velocity: &many, effort: &[] },
            Reading::Pose { position: a, orientation: turned },
            Reading::Odometry { position: a, orientation: turned, linear_velocity: b, angular_velocity: a },
            Reading::Twist { linear: a, angular: b },
            Reading::Vector(b),
            Reading::Light(7.0),
            Reading::Number(-1.0),
            Reading::Flag(true),
            Reading::Numbers(&many),
            Reading::Numbers(&[]),
        ];
        let (mut outbox, mut log) = (Outbox::new(), Log::default());
        // Twice, so that every place has held something else before.
        for round in 0..2 {
            for (index, reading) in readings.iter().enumerate() {
                outbox.push(index, stamps(index as i64, 100 * round - index as i64), *reading);
            }
            outbox.flush_until(100 * round + 1, &mut log).unwrap();
            assert!(outbox.is_empty());
        }
        assert_eq!(log.messages.len(), 2 * readings.len());
        for (topic, stamps, text) in &log.messages {
            assert_eq!((stamps.header, text), (*topic as i64, &format!("{:?}", readings[*topic])));
        }
    }

    #[test]
    fn stamps_never_go_back_and_places_are_used_again() {
        let (mut outbox, mut log) = (Outbox::new(), Log::default());
        let mut delay = 1i64;
        for now in 0..5000 {
            outbox.flush_until(now, &mut log).unwrap();
            for topic in 0..5 {
                delay = delay * 7919 % 104_729;
                // One in eleven should have been logged before now.
                outbox.push(topic, stamps(now, now + delay % 33 - 3), Reading::Numbers(&[now as f64]));
            }
            assert!(outbox.len() <= 5 * 31, "{}", outbox.len());
        }
        assert!(outbox.places.len() <= 5 * 31);
        outbox.finish(&mut log).unwrap();
        assert_eq!(log.messages.len(), 25_000);
        assert!(log.messages.is_sorted_by_key(|(topic, stamps, _)| (stamps.log, *topic)));
        assert!(log.messages.iter().any(|(_, stamps, _)| stamps.log == stamps.header));
    }

    #[test]
    fn after_a_sink_error_the_rest_waits() {
        let (mut outbox, mut log) = (Outbox::new(), Log { refuse: Some(1), ..Log::default() });
        (0..4).for_each(|stamp| outbox.push(0, stamps(stamp, stamp), Reading::Flag(false)));
        assert_eq!(outbox.flush_until(9, &mut log).unwrap_err().to_string(), "full");
        assert_eq!(outbox.len(), 2);
        outbox.finish(&mut log).unwrap();
        assert_eq!(log.messages.iter().map(|(_, stamps, _)| stamps.log).collect::<Vec<_>>(), [0, 2, 3]);
    }
}
