//! Notes on many files, in a few sentences.

use std::{
    collections::{BTreeMap, BTreeSet},
    path::Path,
};

use crate::{ClockSummary, index::Span};

/// Collects what happened in many files into a few sentences.
#[derive(Default)]
pub(crate) struct Notes {
    /// Sentences about single files and the files they are about.
    sentences: BTreeMap<String, Vec<String>>,
    /// For each kind of event (of one, of several, and what there is to say of them): how many, in how many files, and one of these.
    counts: BTreeMap<[&'static str; 3], (usize, usize, String)>,
    /// Kinds of events that say where episodes begin, which is nothing where a file has no stamps.
    borders: BTreeSet<[&'static str; 3]>,
}

impl Notes {
    /// Adds what a file's opening and its stamps tell.
    pub(crate) fn add_file(&mut self, path: &Path, notes: &[String], clock: &ClockSummary, spans: &[Span]) {
        for note in notes {
            self.sentences.entry(note.clone()).or_default().push(path.display().to_string());
        }
        let single = spans.iter().filter(|span| span.rows == 1).count();
        let events = [
            (["row", "rows", "without a readable stamp left out"], clock.missing, false),
            (["row", "rows", "with the stamp of the row before left out"], clock.repeated, false),
            (["backward stamp", "backward stamps", "where a new episode starts"], clock.backward, true),
            (["gap", "gaps", "longer than accepted, where a new episode starts"], clock.gaps, true),
            (["episode", "episodes", "of a single row"], single, true),
        ];
        for (what, count, border) in events.into_iter().filter(|(_, count, _)| *count > 0) {
            if border {
                self.borders.insert(what);
            }
            let entry = self.counts.entry(what).or_insert_with(|| (0, 0, path.display().to_string()));
            entry.0 += count;
            entry.1 += 1;
        }
    }

    /// The sentences, sorted.
    pub(crate) fn all(&self) -> Vec<String> {
        self.sentences(|_| true)
    }

    /// The same without where episodes begin.
    pub(crate) fn of_rows(&self) -> Vec<String> {
        self.sentences(|what| !self.borders.contains(what))
    }

    fn sentences(&self, wanted: impl Fn(&[&'static str; 3]) -> bool) -> Vec<String> {
        let place = |files: usize, first: &str| match files {
            1 => first.to_owned(),
            more => format!("{more} files, first {first}"),
        };
        let sentences = self.sentences.iter().map(|(note, files)| format!("{}: {note}", place(files.len(), &files[0])));
        let counts = self.counts.iter().filter(|(what, _)| wanted(what));
        let counts = counts.map(|([one, more, what], (count, files, first))| {
            format!("{}: {count} {} {what}", place(*files, first), if *count == 1 { one } else { more })
        });
        sentences.chain(counts).collect()
    }
}
