//! Statistics joined, parted and made smaller, without the logs.

use fleetfoot_data::setting::{EPISODE, FILE, KEY, WHERE};

use std::collections::{HashMap, HashSet};

use fleetfoot_data::EpisodeId;

use super::{ContentHash, EpisodeRecord, FileRecord, StatisticFile};
use crate::{error::Error, statistic_error::StatisticError};

/// Selector of the episodes to drop.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Unwanted {
    /// By name, or by identity or at least eight digits of its beginning.
    Episode(String),
    /// By the value of a label.
    Label(String, String),
    /// By the file that they came from: its path as it was given, or its name.
    File(String),
}

impl StatisticFile {
    /// Adds the rows of another statistic of the same plan. `left` and `right` are the names of the two, for messages.
    ///
    /// # Errors
    /// Another plan, with the difference; the same log on both sides, with its names. `self` is then unchanged.
    pub fn merge(&mut self, left: &str, other: Self, right: &str) -> Result<(), Error> {
        self.same_plan(left, &other, right)?;
        let twice: Vec<String> = other
            .episodes
            .iter()
            .filter(|episode| self.episode(episode.id).is_some())
            .map(|episode| episode.name.clone())
            .collect();
        if !twice.is_empty() {
            return Err(StatisticError::SameLog { left: left.to_owned(), right: right.to_owned(), names: twice }.into());
        }
        self.scanned.merge(other.scanned)?;
        if let (Some(equations), Some(others)) = (&mut self.equations, other.equations) {
            equations.merge(others)?;
        }
        // Facts beside the sums must not depend on the order of merges.
        if (&other.recipe, &other.version) < (&self.recipe, &self.version) {
            (self.recipe, self.version) = (other.recipe, other.version);
            (self.fields, self.columns) = (other.fields, other.columns);
        }
        self.episodes.extend(other.episodes);
        let places: HashMap<ContentHash, usize> =
            self.files.iter().enumerate().map(|(at, file)| (file.hash, at)).collect();
        for file in other.files {
            match places.get(&file.hash) {
                None => self.files.push(file),
                Some(&at) if file.name < self.files[at].name => self.files[at] = file,
                Some(_) => {}
            }
        }
        self.command = None;
        self.arrange();
        Ok(())
    }

    /// Adds the rows of another statistic of the same plan as one scan of the logs of both does: a file whose content is here already is left out. Tells
    /// what was left out, with the reason.
    ///
    /// # Errors
    /// Those of [`StatisticFile::merge`]: another plan, the same rows in another file. `self` is then unchanged.
    pub fn append(&mut self, mut other: Self) -> Result<Vec<String>, Error> {
        self.same_plan("the statistic", &other, "the one added to it")?;
        let known: HashMap<ContentHash, &str> = self.files.iter().map(|file| (file.hash, file.name.as_str())).collect();
        let mut skipped = Vec::new();
        for file in &other.files {
            match known.get(&file.hash) {
                Some(&same) if same == file.name => skipped.push(format!("{same}: it is there already")),
                Some(same) => skipped.push(format!("{}: the same content as {same}", file.name)),
                None => {}
            }
        }
        if !skipped.is_empty() {
            let gone = |file: &ContentHash| known.contains_key(file);
            let episodes: HashSet<EpisodeId> =
                other.episodes.iter().filter(|episode| gone(&episode.file)).map(|episode| episode.id).collect();
            other.files.retain(|file| !gone(&file.hash));
            other.episodes.retain(|episode| !episodes.contains(&episode.id));
            other.retain(|id| !episodes.contains(&id));
        }
        self.merge("the statistic", other, "the one added to it")?;
        Ok(skipped)
    }

    /// Keeps the episodes that are wanted; returns the names of the others. What is left is what a scan of them finds with the same plan.
    ///
    /// # Errors
    /// When nothing would be left. `self` is then unchanged.
    pub fn keep_episodes(&mut self, wanted: impl Fn(&EpisodeRecord) -> bool) -> Result<Vec<String>, Error> {
        let dropped: HashSet<EpisodeId> =
            self.episodes.iter().filter(|episode| !wanted(episode)).map(|episode| episode.id).collect();
        self.without(&dropped)
    }

    /// Drops the episodes that any of these names; returns their names. What is left is what a scan of the others finds with the same plan. A file
    /// without episodes is forgotten, so that it can be appended again.
    ///
    /// # Errors
    /// A name that matches nothing, with what there is; when nothing would be left.
    pub fn drop_episodes(&mut self, unwanted: &[Unwanted]) -> Result<Vec<String>, Error> {
        let mut dropped: HashSet<EpisodeId> = HashSet::new();
        for one in unwanted {
            let episodes = self.matching(one);
            if episodes.is_empty() {
                return Err(self.no_match(one).into());
            }
            dropped.extend(episodes);
        }
        self.without(&dropped)
    }

    fn without(&mut self, dropped: &HashSet<EpisodeId>) -> Result<Vec<String>, Error> {
        if dropped.is_empty() {
            return Ok(Vec::new());
        }
        if dropped.len() == self.episodes.len() {
            return Err(StatisticError::NothingLeft(dropped.len()).into());
        }
        let parted = self.episodes.iter().filter(|episode| dropped.contains(&episode.id));
        let (names, files): (Vec<_>, Vec<_>) = parted.map(|episode| (episode.name.clone(), episode.file)).unzip();
        self.retain(|id| !dropped.contains(&id));
        self.episodes.retain(|episode| !dropped.contains(&episode.id));
        let left: HashSet<_> = self.episodes.iter().map(|episode| episode.file).collect();
        self.files.retain(|file| left.contains(&file.hash) || !files.contains(&file.hash));
        self.arrange();
        Ok(names)
    }

    /// Keeps the sums of the episodes that are wanted.
    fn retain(&mut self, wanted: impl Fn(EpisodeId) -> bool) {
        self.scanned.retain(&wanted);
        if let Some(equations) = &mut self.equations {
            equations.retain(&wanted);
        }
    }

    fn matching(&self, unwanted: &Unwanted) -> Vec<EpisodeId> {
        const LEAST_DIGITS: usize = 8;
        let named =
            |file: &&FileRecord, text: &str| file.name == text || file.name.rsplit(['/', '\\']).next() == Some(text);
        let files: HashSet<ContentHash> = match unwanted {
            Unwanted::File(text) => self.files.iter().filter(|file| named(file, text)).map(|file| file.hash).collect(),
            _ => HashSet::new(),
        };
        let matches = |episode: &&EpisodeRecord| match unwanted {
            Unwanted::Episode(text) => {
                let digits = text.len() >= LEAST_DIGITS && episode.id.to_string().starts_with(&text.to_lowercase());
                episode.name == *text || digits
            }
            Unwanted::Label(name, value) => episode.labels.get(name) == Some(value),
            Unwanted::File(_) => files.contains(&episode.file),
        };
        self.episodes.iter().filter(matches).map(|episode| episode.id).collect()
    }

    fn no_match(&self, unwanted: &Unwanted) -> StatisticError {
        let (asked, mut there): (String, Vec<String>) = match unwanted {
            Unwanted::Episode(text) => {
                (EPISODE.to(text).to_string(), self.episodes.iter().map(|episode| episode.name.clone()).collect())
            }
            Unwanted::File(text) => {
                (FILE.to(text).to_string(), self.files.iter().map(|file| file.name.clone()).collect())
            }
            Unwanted::Label(name, value) => {
                let pairs = self.episodes.iter().flat_map(|episode| &episode.labels);
                let of_name: Vec<String> = pairs
                    .clone()
                    .filter(|(known, _)| *known == name)
                    .map(|(name, value)| format!("{name}={value}"))
                    .collect();
                let all = pairs.map(|(name, value)| format!("{name}={value}"));
                (
                    WHERE.to(format_args!("{name}={value}")).to_string(),
                    if of_name.is_empty() { all.collect() } else { of_name },
                )
            }
        };
        there.sort();
        there.dedup();
        if there.is_empty() {
            there.push(format!("no label (give labels with {KEY} when scanning)"));
        }
        StatisticError::NoMatch { asked, there }
    }

    /// Joins the chunks of every episode into one: a smaller file, of which block bootstrap and folds within an episode are no longer possible.
    pub fn compact(&mut self) {
        self.scanned.compact();
        if let Some(equations) = &mut self.equations {
            equations.compact();
        }
    }

    /// Number of chunks.
    pub fn chunks(&self) -> usize {
        self.scanned.also.len()
    }
}
