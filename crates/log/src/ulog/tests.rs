//! The container against files of a writer of the tests: whole, cut at every byte, and with every byte changed.

use std::{collections::BTreeMap, fs, path::PathBuf};

use fleetfoot_data::Silent;
use proptest::prelude::*;

use super::{
    message::{HEADER, Message},
    *,
};
use crate::{
    Compression, Error,
    container::{Container, summary},
};

#[path = "../../tests/all/ulog_writer.rs"]
mod ulog_writer;
use ulog_writer::{Ulog, flight};

/// Messages of each topic: time and bytes.
type Messages = BTreeMap<String, Vec<(i64, Vec<u8>)>>;

/// Returns true if the sweeps have their full size (`make test-all`).
fn full() -> bool {
    std::env::var_os("FLEETFOOT_SWEEPS").is_some_and(|size| size == "full")
}

/// A file in a folder of its own.
struct Scrap {
    folder: tempfile::TempDir,
}

impl Scrap {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self) -> PathBuf {
        self.folder.path().join("run.ulg")
    }

    fn open(&self, bytes: &[u8]) -> Result<UlogContainer, Error> {
        fs::write(self.path(), bytes).unwrap();
        UlogContainer::open(&self.path(), Compression::None, &Silent)
    }
}

fn read_all(container: &UlogContainer) -> Messages {
    let mut messages = Messages::new();
    let all: Vec<usize> = (0..container.topics().len()).collect();
    for piece in 0..container.pieces() {
        let mut count = 0;
        container
            .read_piece(piece, &all, &mut |topic, log, publish, data| {
                assert_eq!(log, publish);
                count += 1;
                let name = container.topics()[topic].name.clone();
                messages.entry(name).or_default().push((log, data.to_vec()));
                Ok(())
            })
            .unwrap();
        assert_eq!(container.messages(piece), Some(count), "what was counted is what is read");
    }
    messages
}

fn total(messages: &Messages) -> usize {
    messages.values().map(Vec::len).sum()
}

/// Returns true if a problem, the damage or a note reports missing messages.
fn tells(container: &UlogContainer) -> bool {
    let problem = container.topics().iter().any(|topic| topic.problem.is_some());
    problem || !container.damage().is_empty() || container.notes().len() > usize::from(!container.breaks().is_empty())
}

/// The messages with a time that end at or before a byte, read by hopping over a sound file: its topics by their numbers.
fn until(bytes: &[u8], end: usize) -> Messages {
    let topics = BTreeMap::from([(0, "/gyro"), (7, "/gyro.1"), (3, "/engine"), (4, "/mode")]);
    let (mut messages, mut at) = (Messages::new(), HEADER);
    while let Ok(message) = Message::at(bytes, at) {
        at = message.end();
        if at > end {
            break;
        }
        let payload = message.payload;
        let (name, place, data) = match message.kind {
            b'D' => {
                let id = u16::from_le_bytes([payload[0], payload[1]]);
                (topics[&id], if id == 4 { 4 } else { 0 }, &payload[2..])
            }
            b'L' => ("/logged_messages", 1, payload),
            b'C' => ("/logged_messages_tagged", 3, payload),
            _ => continue,
        };
        let time = u64::from_le_bytes(*data[place..].first_chunk().unwrap());
        messages.entry(name.to_owned()).or_default().push((time as i64 * 1000, data.to_vec()));
    }
    messages
}

/// Every topic begins with these messages.
fn begins_with(read: &Messages, first: &Messages) -> bool {
    first
        .iter()
        .all(|(topic, messages)| read.get(topic).is_some_and(|messages_read| messages_read.starts_with(messages)))
}

#[test]
fn topics_are_instances_that_have_messages() {
    let (scrap, log) = (Scrap::new(), flight(100));
    let container = scrap.open(&log.bytes).unwrap();
    let counts: Vec<(&str, Option<u64>)> =
        container.topics().iter().map(|topic| (topic.name.as_str(), topic.count)).collect();
    let expected = [
        ("/engine", 20),
        ("/gyro", 100),
        ("/gyro.1", 100),
        ("/logged_messages", 1),
        ("/logged_messages_tagged", 4),
        ("/mode", 10),
    ];
    assert_eq!(counts, expected.map(|(name, count)| (name, Some(count))));
    let read = read_all(&container);
    assert_eq!(read, until(&log.bytes, usize::MAX));
    assert!(container.damage().is_empty() && container.notes().is_empty(), "{:?}", container.notes());
    let times = summary(&container, &Silent).unwrap().topics;
    let gyro = container.topic("/gyro.1").unwrap();
    assert_eq!((times[gyro].first, times[gyro].rate), (Some(1_000_000_000), Some(250.0)));
    assert!(container.topic("/gyro.2").unwrap_err().to_string().contains("/gyro"));
    // A large file is told by its pieces.
    let spans = container.indexed_spans(0).unwrap();
    assert_eq!((spans[&gyro].count, spans[&gyro].last), (100, 1_396_000_000));
}

#[test]
fn large_files_have_several_pieces_with_the_same_messages() {
    let (scrap, log) = (Scrap::new(), flight(20_000));
    let container = scrap.open(&log.bytes).unwrap();
    assert_eq!(container.pieces(), log.bytes.len().div_ceil(1 << 20));
    assert!(container.pieces() > 1);
    assert_eq!(read_all(&container), until(&log.bytes, usize::MAX));
    let engine = container.topic("/engine").unwrap();
    let counted: u64 = (0..container.pieces()).filter_map(|piece| container.wanted_messages(piece, &[engine])).sum();
    assert_eq!(counted, 4000);
}

#[test]
fn file_information_is_read() {
    let scrap = Scrap::new();
    let pairs = scrap.open(&flight(40).bytes).unwrap().metadata();
    let expected = [
        ("boot", "first, on\nsecond"),
        ("changed.RATE_P", "13.2 from 1.052 s; 38.2 from 1.152 s"),
        ("default.setup.RATE_P", "0.1"),
        ("default.setup.SYS_ID", "7"),
        ("default.system.RATE_P", "0.1"),
        ("parameter.RATE_P", "0.15"),
        ("parameter.SYS_ID", "-3"),
        ("sys_name", "PX4"),
        ("time_ref", "ok"),
        ("ver_sw_release", "16846335"),
    ];
    assert_eq!(pairs, expected.map(|(key, value)| (key.to_owned(), value.to_owned())).into());
}

#[test]
fn untyped_definition_loses_no_message() {
    let scrap = Scrap::new();
    let row = |time: u64| [&time.to_le_bytes()[..], &1_f32.to_le_bytes()].concat();
    for (key, lost) in [("sys_name", false), ("float ", false), ("float \u{7}x", true)] {
        for place in 0..3 {
            let mut log = Ulog::new(0);
            if place == 0 {
                log.entry(b'I', key, b"PX4");
            }
            log.format("a:uint64_t timestamp;float x;");
            if place == 1 {
                log.entry(b'I', key, b"PX4").flagged(b'M', 0, key, b"PX4");
            }
            log.subscribe(0, 1, "a");
            if place == 2 {
                log.entry(b'P', key, b"PX4");
            }
            for k in 0..30 {
                log.data(1, &[&row(1000 * k)]);
            }
            let container = scrap.open(&log.bytes).unwrap();
            assert_eq!(total(&read_all(&container)), 30, "{key}, {place}: {}", container.damage());
            assert_eq!(!container.damage().is_empty(), lost, "{key}: {}", container.damage());
            let is_noted = container.notes().iter().any(|note| note.contains("without a type"));
            assert_eq!(is_noted, !lost, "{key}: {:?}", container.notes());
        }
    }
}

#[test]
fn flags_that_are_not_known_are_refused() {
    let scrap = Scrap::new();
    for (place, bits, word) in [(0, 2, "bit 1"), (0, 0x81, "bit 7"), (7, 0x80, "bit 63")] {
        let mut incompatible = [0; 8];
        incompatible[place] = bits;
        let mut log = Ulog::new(0);
        log.flags(0, incompatible, [0; 3]);
        let message = scrap.open(&log.bytes).unwrap_err().to_string();
        assert!(message.contains(word) && message.contains("run.ulg"), "{message}");
    }
    // Compatible ones are not looked at.
    let mut log = Ulog::new(0);
    log.flags(0xff, [0; 8], [0; 3]);
    assert!(scrap.open(&log.bytes).unwrap().damage().is_empty());
}

#[test]
fn appended_data_begin_where_the_flags_say() {
    let (scrap, whole) = (Scrap::new(), flight(60));
    // The first part ends in the middle of a message; two more are appended.
    let flags = |offsets: [u64; 3]| {
        let mut log = Ulog::new(900_000);
        log.flags(1, [1, 0, 0, 0, 0, 0, 0, 0], offsets);
        log.bytes
    };
    let end = flags([0; 3]).len();
    let last = whole.bytes.len() - 20;
    let mut more = Ulog { bytes: Vec::new() };
    let time = 5_000_000_u64.to_le_bytes();
    more.subscribe(5, 40, "mode").data(40, &[&1_u32.to_le_bytes(), &time, b"failsafe", &[0; 8]]);
    more.logged(b'0', 5_000_001, "hard fault");
    let second = last + more.bytes.len();
    let mut bytes = flags([last as u64, second as u64, 0]);
    bytes.extend(&whole.bytes[end..last]);
    bytes.extend(&more.bytes);
    bytes.extend(&more.bytes);
    let container = scrap.open(&bytes).unwrap();
    let mut read = read_all(&container);
    assert_eq!(read.remove("/mode.5").unwrap().len(), 2);
    let expected = until(&whole.bytes, last);
    assert_eq!(read.get_mut("/logged_messages").unwrap().split_off(1).len(), 2);
    assert_eq!(read, expected);
    let damage_text = container.damage().to_string();
    assert!(damage_text.contains("data appended behind it"), "{damage_text}");
    // Places that cannot be are told, and the file is read as it stands.
    for offsets in [[7, 0, 0], [u64::MAX, 0, 0], [last as u64, 100, 0]] {
        let mut bytes = flags(offsets);
        bytes.extend(&whole.bytes[end..]);
        let container = scrap.open(&bytes).unwrap();
        assert!(container.notes()[0].contains("ignored"), "{:?}", container.notes());
        assert!(read_all(&container)["/gyro"].len() >= 58);
    }
}

#[test]
fn every_truncation_is_read_up_to_the_cut() {
    let (scrap, log) = (Scrap::new(), flight(26));
    let whole = until(&log.bytes, usize::MAX);
    for length in 0..log.bytes.len() {
        let container = match scrap.open(&log.bytes[..length]) {
            Ok(container) => container,
            Err(error) => {
                assert!(length < 7, "cut at {length}: {error}");
                continue;
            }
        };
        let read = read_all(&container);
        assert_eq!(read, until(&log.bytes, length), "cut at {length}");
        summary(&container, &Silent).unwrap();
        container.metadata();
        let at_a_message = ends(&log.bytes).contains(&length);
        assert_eq!(container.damage().is_empty(), at_a_message, "cut at {length}: {}", container.damage());
        if let (false, Some(parts)) = (at_a_message, container.damage().to_string().split_once("at byte")) {
            assert!(parts.1.contains("the file ends inside"), "cut at {length}: {parts:?}");
        }
    }
    assert!(total(&whole) > 60);
}

/// Ends of the messages of a sound file.
fn ends(bytes: &[u8]) -> Vec<usize> {
    let mut ends = vec![HEADER];
    while let Ok(message) = Message::at(bytes, *ends.last().unwrap()) {
        ends.push(message.end());
    }
    ends
}

#[test]
fn changed_byte_keeps_earlier_messages() {
    let (scrap, log) = (Scrap::new(), flight(20));
    let all = total(&until(&log.bytes, usize::MAX));
    let (mut refused, mut rescued, mut opened) = (0, 0, 0);
    for place in 0..log.bytes.len() {
        let masks = [0x01, 0x80, 0xff];
        for &mask in if full() { &masks[..] } else { std::slice::from_ref(&masks[place % 3]) } {
            let mut bytes = log.bytes.clone();
            bytes[place] ^= mask;
            let Ok(container) = scrap.open(&bytes) else {
                assert!(place < HEADER + 3 + 16, "byte {place}");
                refused += 1;
                continue;
            };
            opened += 1;
            let read = read_all(&container);
            assert!(begins_with(&read, &until(&log.bytes, place)), "byte {place} changed by {mask}");
            assert!(total(&read) >= all || tells(&container), "byte {place} changed by {mask}: {} left", total(&read));
            assert!(total(&read) <= all + 1, "byte {place} changed by {mask}: {} messages", total(&read));
            rescued += usize::from(total(&read) + 3 >= all);
        }
    }
    assert!(refused > 10 && rescued > opened / 2, "{refused} refused, {rescued} of {opened}");
}

#[test]
fn contradicting_definitions_are_reported() {
    let scrap = Scrap::new();
    let mut log = Ulog::new(0);
    log.format("a:uint64_t timestamp;float x;")
        .format("a:uint64_t timestamp;float y;")
        .format("b:float x;")
        .subscribe(0, 1, "a")
        .subscribe(0, 2, "b")
        .subscribe(0, 3, "nowhere");
    let row = |time: u64| [&time.to_le_bytes()[..], &1_f32.to_le_bytes()].concat();
    // The number 1 stands for another instance from its second subscription on.
    log.data(1, &[&row(1)]).data(2, &[&[0; 4]]).data(3, &[&[0; 9]]).subscribe(4, 1, "a").data(1, &[&row(2)]);
    log.data(1, &[&u64::MAX.to_le_bytes(), &[0; 4]]).data(77, &[&row(3)]).message(b'z', &[b"to come"]).sync();
    let container = scrap.open(&log.bytes).unwrap();
    let read = read_all(&container);
    assert_eq!((read["/a"].len(), read["/a"][0].0, read["/a.4"][0].0), (1, 1000, 2000));
    let problem = |name: &str| container.topic(name).unwrap_err().to_string();
    assert!(problem("/b").contains("no `timestamp`"), "{}", problem("/b"));
    assert!(problem("/nowhere").contains("definition of `nowhere` is missing"), "{}", problem("/nowhere"));
    let (notes, damage) = (container.notes().join("\n"), container.damage());
    assert!(notes.contains("`a` is defined twice") && notes.contains("1 messages of unknown types"), "{notes}");
    assert_eq!((damage.messages_lost, damage.more_lost), (2, false));
    assert!(damage.to_string().contains("undefined") && damage.to_string().contains("far after"), "{damage}");
}

#[test]
fn sizes_that_lie_take_no_memory() {
    let scrap = Scrap::new();
    let mut log = Ulog::new(0);
    log.format("a:uint64_t timestamp;b[4000000000] b;").format("b:double[4000000000] x;").subscribe(0, 1, "a");
    log.data(1, &[&[0; 40]]).sync().sync().sync();
    let container = scrap.open(&log.bytes).unwrap();
    assert!(read_all(&container).is_empty());
    assert!(container.damage().to_string().contains("does not fit its format"), "{}", container.damage());
    // A long definition that every topic would have a copy of.
    let mut log = Ulog::new(0);
    let fields: String = (0..4000).map(|field| format!("uint8_t a{field};")).collect();
    log.format(&format!("long:{fields}"));
    for id in 0..100_u16 {
        log.format(&format!("f{id}:uint64_t timestamp;long x;")).subscribe(0, id, &format!("f{id}"));
        log.data(id, &[&[0; 4008]]);
    }
    let container = scrap.open(&log.bytes).unwrap();
    let copied: usize = container.topics().iter().filter_map(|topic| Some(topic.schema()?.2.len())).sum();
    assert!(copied <= 4 << 20, "{copied}");
    assert!(
        container
            .topics()
            .iter()
            .any(|topic| topic.problem.as_deref().is_some_and(|reason| reason.contains("too long")))
    );
}

#[test]
fn other_files_are_recognised() {
    let scrap = Scrap::new();
    for (bytes, word) in [(&b"ULog"[..], "only the first bytes"), (b"t,x\n1,2\n", "text"), (mcap::MAGIC, ".mcap")] {
        let message = scrap.open(bytes).unwrap_err().to_string();
        assert!(message.contains(word) && message.contains("not ULog"), "{message}");
    }
    let packed = zstd::encode_all(&flight(4000).bytes[..], 3).unwrap();
    let path = scrap.folder.path().join("run.ulg.zst");
    fs::write(&path, &packed[..packed.len() - 5]).unwrap();
    let container = UlogContainer::open(&path, Compression::Zstd, &Silent).unwrap();
    assert!(container.damage().to_string().contains("compressed file is cut"), "{}", container.damage());
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn noise_does_no_harm(
        noise in prop::collection::vec(any::<u8>(), 0..3000),
        holes in prop::collection::vec((any::<prop::sample::Index>(), 1..200_usize), 1..8),
    ) {
        let scrap = Scrap::new();
        let log = flight(40);
        let mut bytes = log.bytes.clone();
        let mut first = bytes.len();
        for (place, length) in holes {
            let at = HEADER + place.index(bytes.len() - HEADER);
            let end = (at + length).min(bytes.len());
            let from = noise.iter().copied().chain(std::iter::repeat(0xa5));
            bytes[at..end].iter_mut().zip(from).for_each(|(byte, noise)| *byte = noise);
            first = first.min(at);
        }
        if let Ok(container) = scrap.open(&bytes) {
            prop_assert!(begins_with(&read_all(&container), &until(&log.bytes, first)));
            summary(&container, &Silent).unwrap();
            container.metadata();
        }
        let mut only = log.bytes[..HEADER].to_vec();
        only.extend(&noise);
        if let Ok(container) = scrap.open(&only) {
            read_all(&container);
        }
    }
}
