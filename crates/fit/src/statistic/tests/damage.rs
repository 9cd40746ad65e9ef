//! Files that were damaged after they were written.

use std::path::Path;

use fleetfoot_dataset::stats_file::of_sections;
use proptest::prelude::*;

use super::*;

/// A statistic of one small log.
fn small() -> Vec<u8> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.csv");
    fs::write(&path, log(30, 0.0)).unwrap();
    let recipe = Recipe::parse(
        "[latents]\nT = { functions = [\"x\"] }\n[tasks]\nalong = { target = \"a\", right = \"T\" }\n[time]\ncolumn = \"t\"\n",
        "test",
    );
    bytes(&scan(&recipe.unwrap(), &ScanOptions::default(), None, &[path], &Silent).unwrap().0)
}

fn read(bytes: &[u8]) -> Result<(StatisticFile, Sizes), StatisticError> {
    StatisticFile::from_bytes(bytes, Path::new("run.stats"))
}

#[test]
fn every_truncation_is_refused() {
    let whole = small();
    for length in 0..whole.len() {
        match read(&whole[..length]) {
            Err(StatisticError::Damaged { .. }) if length > 0 => {}
            Err(StatisticError::Foreign { .. }) if length == 0 => {}
            other => panic!("{length} of {} bytes: {other:?}", whole.len()),
        }
    }
    let mut longer = whole;
    longer.push(0);
    assert!(matches!(read(&longer), Err(StatisticError::Damaged { .. })));
}

#[test]
fn every_byte_flip_is_refused() {
    let whole = small();
    let mut bytes = whole.clone();
    for at in 0..whole.len() {
        for flip in [1, 0x80, 0xff] {
            bytes[at] ^= flip;
            let error = read(&bytes).expect_err("a changed byte");
            assert_eq!(matches!(error, StatisticError::Foreign { .. }), at < 8, "byte {at}: {error}");
            assert!(error.to_string().starts_with("run.stats: "));
            bytes[at] ^= flip;
        }
    }
    assert!(read(&bytes).is_ok());
}

#[test]
fn the_damaged_section_is_named() {
    let whole = small();
    let sizes = read(&whole).unwrap().1;
    let mut at = 16;
    for (name, size) in &sizes.sections {
        let mut bytes = whole.clone();
        bytes[at + *size as usize - 1] ^= 4;
        let message = read(&bytes).unwrap_err().to_string();
        assert!(
            message.contains(&format!("section `{name}` at byte {at}")) && message.contains("another copy"),
            "{message}"
        );
        at += *size as usize;
    }
}

/// Bytes with the checksum of the whole made right again.
fn sealed(mut bytes: Vec<u8>) -> Vec<u8> {
    let body = bytes.len() - 32;
    let hash = blake3::hash(&bytes[..body]);
    bytes[body..].copy_from_slice(hash.as_bytes());
    bytes
}

#[test]
fn foreign_and_newer_files_are_refused() {
    assert!(matches!(read(b"{\"model\": 1}"), Err(StatisticError::Foreign { .. })));
    assert!(matches!(read(b""), Err(StatisticError::Foreign { .. })));
    let mut bytes = small();
    bytes[8] = 5;
    let message = read(&sealed(bytes)).unwrap_err().to_string();
    assert!(message.contains("its format is 5") && message.contains("newer fleetfoot"), "{message}");
    let missing = StatisticFile::read(Path::new("no/such.stats")).unwrap_err().to_string();
    assert!(missing.contains("no/such.stats"), "{missing}");
}

/// Written by the last fleetfoot of format 3, whose plans had another hash: `scan --partition kmeans:2 --chunk-rows 60`
/// of 120 rows of x, v and u. It is read unchanged, and written anew in this format.
#[test]
fn files_of_the_format_before_are_read() {
    let old = include_bytes!("format3.stats");
    assert_eq!(old[8], 3);
    let (file, _) = read(old).unwrap();
    assert_eq!((file.episodes.len(), file.episodes[0].rows, file.chunks()), (1, 120, 2));
    assert!(file.equations.is_some());
    let new = bytes(&file);
    assert_eq!(new[8], 4);
    let (again, _) = read(&new).unwrap();
    assert_eq!((again.plan_hash(), bytes(&again)), (file.plan_hash(), new.clone()));
    // In a file of this format another hash of the plan is damage.
    let mut other = old.to_vec();
    other[8] = 4;
    let message = read(&sealed(other)).unwrap_err().to_string();
    assert!(message.contains("section `plan`") && message.contains("its hash differs"), "{message}");
}

/// A file of these sections, checksums right.
fn crafted(sections: &[(&str, Vec<u8>)]) -> Vec<u8> {
    of_sections(sections).unwrap()
}

/// The sections of a file.
fn sections(whole: &[u8]) -> Vec<(String, Vec<u8>)> {
    let mut at = 16;
    let of = |(name, size): &(String, u64)| {
        let payload = whole[at + 20..at + *size as usize].to_vec();
        at += *size as usize;
        (name.clone(), payload)
    };
    read(whole).unwrap().1.sections.iter().map(of).collect()
}

fn with(sections: &[(String, Vec<u8>)], index: usize, payload: Vec<u8>) -> Vec<u8> {
    let mut copies: Vec<(&str, Vec<u8>)> =
        sections.iter().map(|(name, payload)| (name.as_str(), payload.clone())).collect();
    copies[index].1 = payload;
    crafted(&copies)
}

#[test]
fn files_with_inconsistent_content_are_refused() {
    let whole = small();
    let sections = sections(&whole);
    assert_eq!(with(&sections, 0, sections[0].1.clone()), whole, "the crafted file is the written one");
    let names: Vec<&str> = sections.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["head", "plan", "source", "files", "episodes", "task", "also", "systems"]);
    // Counts far beyond the file, in every section.
    let huge = postcard::to_stdvec(&u64::MAX).unwrap();
    for index in 0..sections.len() {
        let error = read(&with(&sections, index, huge.clone())).unwrap_err();
        assert!(matches!(error, StatisticError::Damaged { .. }), "{}: {error}", names[index]);
    }
    for index in [5, 6] {
        for word in 0..3 {
            let mut payload = sections[index].1.clone();
            payload[8 * word..8 * word + 8].copy_from_slice(&(u64::MAX / 2).to_le_bytes());
            assert!(matches!(read(&with(&sections, index, payload)), Err(StatisticError::Damaged { .. })));
        }
    }
    // An episode that no chunk may speak of, no files, no task.
    let none = postcard::to_stdvec(&Vec::<u8>::new()).unwrap();
    for index in [3, 4] {
        assert!(matches!(read(&with(&sections, index, none.clone())), Err(StatisticError::Damaged { .. })));
    }
    let short: Vec<(&str, Vec<u8>)> =
        sections[..5].iter().map(|(name, payload)| (name.as_str(), payload.clone())).collect();
    let message = read(&crafted(&short)).unwrap_err().to_string();
    assert!(message.contains("`task` is missing"), "{message}");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn sections_of_any_bytes_are_refused_without_harm(index in 0_usize..7, at in any::<prop::sample::Index>(), bytes in prop::collection::vec(any::<u8>(), 1..40)) {
        thread_local!(static SECTIONS: Vec<(String, Vec<u8>)> = sections(&small()));
        SECTIONS.with(|sections| {
            let mut payload = sections[index].1.clone();
            let from = at.index(payload.len());
            payload.splice(from..(from + bytes.len()).min(sections[index].1.len()), bytes);
            // Numbers may change; that it is refused, or read and described, and nothing else, is what counts.
            if let Ok((mut read, _)) = read(&with(sections, index, payload)) {
                prop_assert!(read.to_bytes().is_ok());
                prop_assert!(read.task_summaries().len() <= 1);
                let _ = (read.task(), read.by_label(), read.step(), read.is_partial());
                read.compact();
            }
            Ok(())
        })?;
    }
}
