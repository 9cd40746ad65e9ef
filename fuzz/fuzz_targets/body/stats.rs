//! Statistics as files, none of their bytes to be trusted.
//!
//! An input is a `.stats` file. It is read as it is, where its checksums stop most changes, and once more with all checksums made right, as one who
//! means harm would. What is read is described, compacted, written and read again. Errors are fine; panics, hangs and memory beyond measure are not.

use std::path::Path;

use fleetfoot::statistic::StatisticFile;

/// The layout of the file: bytes of its head, of a section's head, and of the hash at its end.
const HEAD: usize = 16;
const SECTION_HEAD: usize = 20;
const HASH: usize = 32;

/// The file with right checksums, as far as sections are as long as they say.
fn sealed(data: &[u8]) -> Vec<u8> {
    let mut bytes = data.to_vec();
    let Some(body) = bytes.len().checked_sub(HASH).filter(|&body| body >= HEAD) else { return bytes };
    let mut at = HEAD;
    while at + SECTION_HEAD <= body {
        let mut length = [0; 8];
        length.copy_from_slice(&bytes[at + 8..at + 16]);
        let payload = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
        let Some(end) = (at + SECTION_HEAD).checked_add(payload).filter(|&end| end <= body) else { break };
        let mut hasher = crc32fast::Hasher::new();
        hasher.update(&bytes[at..at + 16]);
        hasher.update(&bytes[at + SECTION_HEAD..end]);
        bytes[at + 16..at + SECTION_HEAD].copy_from_slice(&hasher.finalize().to_le_bytes());
        at = end;
    }
    let hash = blake3::hash(&bytes[..body]);
    bytes[body..].copy_from_slice(hash.as_bytes());
    bytes
}

/// Reads and uses one file; whether it was accepted.
fn read(bytes: &[u8]) -> bool {
    let name = Path::new("fuzz.stats");
    let Ok((mut file, _)) = StatisticFile::from_bytes(bytes, name) else { return false };
    let tasks = file.task_summaries();
    assert!(tasks.len() <= file.plan.regression.tasks.len());
    let _ = (file.task(), file.by_label(), file.step(), file.plan_text());
    if let Ok(written) = file.to_bytes() {
        let again = StatisticFile::from_bytes(&written, name).map(|(again, _)| again.to_bytes().ok());
        assert_eq!(again.ok().flatten(), Some(written), "what was written reads back");
    }
    file.compact();
    true
}

/// Reads one input both ways; whether it was accepted with right checksums. Panics where a promise is broken.
pub(crate) fn run(data: &[u8]) -> bool {
    read(data);
    read(&sealed(data))
}
