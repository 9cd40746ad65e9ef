//! Cut and changed files: no panic, no invented message, and every loss is reported.

use super::*;
use crate::mcap::record::{Fields, Record, for_each_message, record_at, sound_record_at};

/// Numbers without a pattern (Marsaglia's xorshift).
struct Random(u64);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % limit as u64) as usize
    }
}

/// Returns true if the sweeps have their full size, which takes minutes (`make test-all`).
fn full() -> bool {
    std::env::var_os("FLEETFOOT_SWEEPS").is_some_and(|size| size == "full")
}

fn total(messages: &Messages) -> usize {
    messages.values().map(Vec::len).sum()
}

/// Number of messages that are not true ones in their order.
fn invented(read: &Messages, truth: &Messages) -> usize {
    let none = Vec::new();
    read.iter()
        .map(|(topic, messages)| {
            let mut left = truth.get(topic).unwrap_or(&none).iter();
            // A message that is not found leaves the rest of the search where it was.
            messages
                .iter()
                .filter(|message| {
                    let mut ahead = left.clone();
                    let is_there = ahead.any(|message_ahead| message_ahead == *message);
                    if is_there {
                        left = ahead;
                    }
                    !is_there
                })
                .count()
        })
        .sum()
}

#[test]
fn every_truncation_is_read_up_to_the_cut() {
    for (name, options) in variants() {
        let (scrap, truth) = (Scrap::new(), truth(130));
        let bytes = write(options.chunk_size(Some(1500)), 130);
        fs::write(scrap.path(), &bytes).unwrap();
        let file = fs::File::options().write(true).open(scrap.path()).unwrap();
        let (mut before, mut partial, mut cuts) = (usize::MAX, 0, 0);
        // Every cut of the head and of the end, and of the rest every eleventh: records begin at irregular places.
        let near = |length: &usize| *length < 64 || bytes.len() - length < 512;
        for length in (0..bytes.len()).rev().filter(|length| full() || near(length) || length % 11 == 0) {
            cuts += 1;
            file.set_len(length as u64).unwrap();
            let container = match open(&scrap.path()) {
                Ok(container) => container,
                Err(error) => {
                    assert!(length < 8, "{name} cut at {length}: {error}");
                    continue;
                }
            };
            let read = read_all(&container);
            for (topic, messages) in &read {
                assert!(truth[topic].starts_with(messages), "{name} cut at {length}");
            }
            // The longer the file, the more is read of it.
            let count = total(&read);
            assert!(count <= before, "{name} cut at {length}");
            before = count;
            if count < 130 {
                assert!(!container.damage().is_empty(), "{name} cut at {length}");
                partial += usize::from(count > 0);
            }
        }
        // Most cuts of the end leave all messages.
        assert!(partial > cuts / 3, "{name}: {partial} of {cuts}");
    }
}

#[test]
fn changed_bytes_invent_no_messages_and_losses_are_reported() {
    let truth = truth(1200);
    let changes = if full() { 700 } else { 70 };
    for (v, (name, options)) in variants().into_iter().enumerate() {
        let scrap = Scrap::new();
        let bytes = write(options, 1200);
        assert!(bytes.len() > 50_000);
        let mut random = Random(0x1234_5678_9abc_def1 + v as u64);
        let mut rescued = 0;
        for _ in 0..changes {
            let mut damaged = bytes.clone();
            // Every second change is among the heads and indexes at the ends of chunks or in the summary.
            let at =
                if random.below(2) == 0 { random.below(bytes.len()) } else { bytes.len() - 1 - random.below(4000) };
            let change = 1 + random.below(255) as u8;
            damaged[at] ^= change;
            let container = match scrap.open(&damaged) {
                Ok(container) => container,
                Err(error) => {
                    assert!(at < 8, "{name} byte {at} changed by {change}: {error}");
                    continue;
                }
            };
            let read = read_all(&container);
            summary(&container, &Silent).unwrap();
            let is_noted = !container.damage().is_empty() || !container.notes().is_empty();
            // Outside chunks there are no checksums: one message may be changed, or moved to another channel, in silence.
            let free = usize::from(name.starts_with("unchunked"));
            if !(free == 1 && is_noted) {
                let wrong = invented(&read, &truth);
                assert!(wrong <= free, "{name} byte {at} changed by {change}: {wrong} wrong messages");
            }
            assert!(
                is_noted || total(&read) + free >= 1200,
                "{name} byte {at} changed by {change}: {} left, untold",
                total(&read)
            );
            rescued += usize::from(total(&read) > 1000);
        }
        assert!(rescued > changes * 6 / 7, "{name}: {rescued} of {changes}");
    }
}

#[test]
fn many_changes_and_noise_do_no_harm() {
    let scrap = Scrap::new();
    let mut random = Random(99);
    for (_, options) in variants() {
        let bytes = write(options, 300);
        for _ in 0..60 {
            let mut damaged = bytes.clone();
            for _ in 0..40 {
                let (at, length) = (8 + random.below(bytes.len() - 8), 1 + random.below(64));
                let end = (at + length).min(bytes.len());
                damaged[at..end].iter_mut().for_each(|byte| *byte = random.below(256) as u8);
            }
            if let Ok(container) = scrap.open(&damaged) {
                read_all(&container);
                summary(&container, &Silent).unwrap();
                assert!(!container.damage().is_empty() || !container.notes().is_empty());
            }
        }
    }
    for _ in 0..50 {
        let mut noise = mcap::MAGIC.to_vec();
        noise.extend((0..5000).map(|_| random.below(if random.0 & 1 == 0 { 16 } else { 256 }) as u8));
        let container = scrap.open(&noise).unwrap();
        read_all(&container);
        assert!(!container.damage().is_empty());
    }
}

#[test]
fn lengths_that_lie_take_no_memory() {
    // A chunk that says it has 1 GiB and is made of 100 bytes of zstd; one that says more than is accepted.
    for size in [1_u64 << 30, (1 << 30) + 1, u64::MAX] {
        let packed = zstd::encode_all(&[5_u8; 1000][..], 3).unwrap();
        let mut body = Vec::new();
        for word in [0, 10, size] {
            body.extend(word.to_le_bytes());
        }
        body.extend(0_u32.to_le_bytes());
        body.extend(4_u32.to_le_bytes());
        body.extend(b"zstd");
        body.extend((packed.len() as u64).to_le_bytes());
        body.extend(&packed);
        let mut bytes = mcap::MAGIC.to_vec();
        bytes.push(mcap::records::op::CHUNK);
        bytes.extend((body.len() as u64).to_le_bytes());
        bytes.extend(body);
        let scrap = Scrap::new();
        let container = scrap.open(&bytes).unwrap();
        read_all(&container);
        assert_eq!(container.damage().chunks_lost, 1);
    }
}

#[test]
fn heads_and_bodies_are_checked_against_the_bytes() {
    let head = |opcode: u8, length: u64| [&[opcode][..], &length.to_le_bytes()].concat();
    for (opcode, length) in [(5, u64::MAX), (5, u64::MAX - 8), (6, 1 << 63), (3, 1)] {
        assert!(record_at(&head(opcode, length), 0).is_err());
    }
    assert!(record_at(&[0; 20], 0).is_err());
    assert!(record_at(&[5; 3], 0).is_err() && record_at(&[5; 3], usize::MAX).is_err());
    // A chunk whose opcode became one of somebody's own.
    let bytes = write(options(), 100);
    let layout = crate::mcap::layout::Layout::find(&bytes);
    let chunk = layout.pieces[0].bytes.start - 9;
    for opcode in [0x10, 0x7f, 0x80, 0xff] {
        let mut changed = bytes.clone();
        changed[chunk] = opcode;
        assert!(sound_record_at(&changed, chunk).is_err());
    }
    // A private record between others is passed over.
    let private = [head(0x90, 5), vec![1; 5], head(1, 8), vec![0; 8]].concat();
    assert!(matches!(sound_record_at(&private, 0), Ok(Record { opcode: 0x90, .. })));
    assert_eq!(Fields(&[5, 0, 0, 0, 1]).bytes(), None);
    let mut seen = 0;
    let torn = for_each_message(&[head(5, 22), vec![1; 22], head(5, 23), vec![1; 22]].concat(), |_| {
        seen += 1;
        Ok::<_, Error>(())
    });
    assert_eq!((seen, torn.unwrap().map(|torn| torn.at)), (1, Some(31)));
}
