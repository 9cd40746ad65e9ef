//! A scan as a file: plan, provenance, episodes and statistics.

use std::{
    collections::{BTreeMap, HashMap},
    io::BufWriter,
    path::Path,
};

use fleetfoot_data::{Column, Episode, EpisodeId};
use fleetfoot_model::TrainedEpisode;
use fleetfoot_output::AtomicFile;
use fleetfoot_recipe::Recipe;
use fleetfoot_stats::{Stats, scan::RowCounts};
use fleetfoot_sums::structured::{Plan, Scanned, TaskStats};
use fleetfoot_task::StructuredTask;
use serde::Serialize;

use super::{
    container::Writer,
    equation_records::EquationsRecord,
    equation_sections::{GROUP_SECTIONS, sums, systems},
    records::{EpisodeEntry, FieldRecord, FileEntry, HeadRecord, PlanRecord, SourceRecord, to_bytes},
};
use crate::{
    error::Error,
    statistic_error::{StatisticError, VERSION},
    stats_file::{ContentHash, EquationStatistic, Sizes, container::Sections, records::record},
};

/// A file that was scanned.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileRecord {
    /// Its path, as it was given.
    pub name: String,
    /// Hash of its bytes.
    pub hash: ContentHash,
    /// Its size.
    pub bytes: u64,
}

/// An episode that was scanned.
#[derive(Debug, Clone, PartialEq)]
pub struct EpisodeRecord {
    /// Identity by content.
    pub id: EpisodeId,
    /// For people: the file's name (its path where two files share the name), with `#k` where the file holds several episodes.
    pub name: String,
    /// The file that it came from.
    pub file: ContentHash,
    /// Its number among the episodes of its file, from 1; 0 for the only one.
    pub number: u32,
    /// Labels given by the recipe and by the path.
    pub labels: BTreeMap<String, String>,
    /// Rows.
    pub rows: u64,
    /// First stamp, nanoseconds.
    pub start: i64,
    /// Last stamp, nanoseconds.
    pub end: i64,
    /// Median sampling period, seconds; 0 for a single row.
    pub period: f64,
    /// Marks that identify its rows in other logs ([`TrainedEpisode::marks`]).
    pub marks: BTreeMap<String, Vec<u64>>,
}

impl EpisodeRecord {
    /// The episode as one that trains a model.
    pub fn trained(&self) -> TrainedEpisode {
        TrainedEpisode { id: self.id.to_string(), name: self.name.clone(), marks: self.marks.clone() }
    }
}

/// A column of the regression.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ColumnRecord {
    /// Its name in the expressions of the plan.
    pub name: String,
    /// The expression over the log's fields that gives its values.
    pub source: String,
    /// Its unit, where it is known.
    pub unit: Option<String>,
}

/// A scan, in memory and as a `.stats` file.
#[derive(Debug, Clone, PartialEq)]
pub struct StatisticFile {
    /// Plan of the sums, with their coordinates.
    pub plan: Plan,
    /// The sums.
    pub scanned: Scanned,
    /// The sums of the recipe's equations, for `fit sindy`; `None` where it has none that a statistic can serve, or they were not wanted.
    pub equations: Option<EquationStatistic>,
    /// The episodes, in the order of their identities.
    pub episodes: Vec<EpisodeRecord>,
    /// The files, in the order of their names.
    pub files: Vec<FileRecord>,
    /// The recipe, as TOML, with its wildcards written out.
    pub recipe: String,
    /// Fields of the logs that the recipe uses, for resolving it again.
    pub fields: Vec<Column>,
    /// The columns of the regression.
    pub columns: Vec<ColumnRecord>,
    /// The version of fleetfoot that made the plan.
    pub version: String,
    /// Identity of the command that left this work unfinished; `None` when it is finished.
    pub command: Option<[u8; 32]>,
}

impl StatisticFile {
    /// The statistic of no rows.
    pub fn empty(plan: Plan, recipe: &Recipe, task: &StructuredTask, fields: &[Column]) -> Self {
        let column = |(column, source): &(Column, fleetfoot_library::Expr)| ColumnRecord {
            name: column.name.clone(),
            source: source.to_string(),
            unit: column.unit.clone(),
        };
        Self {
            scanned: plan.empty(),
            equations: None,
            plan,
            episodes: Vec::new(),
            files: Vec::new(),
            recipe: recipe.to_toml(),
            fields: fields.iter().map(|field| FieldRecord::new(field).into_column()).collect(),
            columns: task.aliases.iter().map(column).collect(),
            version: env!("CARGO_PKG_VERSION").to_owned(),
            command: None,
        }
    }

    /// The same plan with no rows.
    pub fn without_rows(&self) -> Self {
        Self {
            scanned: self.plan.empty(),
            equations: self.equations.as_ref().map(EquationStatistic::without_rows),
            episodes: Vec::new(),
            files: Vec::new(),
            command: None,
            plan: self.plan.clone(),
            recipe: self.recipe.clone(),
            fields: self.fields.clone(),
            columns: self.columns.clone(),
            version: self.version.clone(),
        }
    }

    /// Hash of all that was frozen before the scan.
    pub fn plan_hash(&self) -> String {
        match &self.equations {
            None => self.plan.hash(),
            Some(equations) => {
                let text = format!("{}\n{}", self.plan.hash(), equations.hash());
                blake3::hash(text.as_bytes()).to_hex()[..32].to_owned()
            }
        }
    }

    /// The record of an episode.
    pub fn episode(&self, id: EpisodeId) -> Option<&EpisodeRecord> {
        self.episodes.binary_search_by_key(&id, |episode| episode.id).ok().map(|at| &self.episodes[at])
    }

    /// The file of an episode.
    pub fn file_of(&self, episode: &EpisodeRecord) -> Option<&FileRecord> {
        self.files.iter().find(|file| file.hash == episode.file)
    }

    /// Returns true if an interrupted scan left this file.
    pub fn is_partial(&self) -> bool {
        self.command.is_some()
    }

    /// The sampling period of most rows, seconds.
    pub fn step(&self) -> f64 {
        let mut periods: Vec<(f64, u64)> =
            self.episodes.iter().filter(|e| e.rows > 1).map(|episode| (episode.period, episode.rows)).collect();
        periods.sort_by(|a, b| a.0.total_cmp(&b.0));
        let half = periods.iter().map(|(_, rows)| rows).sum::<u64>() / 2;
        let mut seen = 0;
        let step = periods.into_iter().find(|(_, rows)| {
            seen += rows;
            seen > half
        });
        step.map_or(0.0, |(period, _)| period)
    }

    /// Puts files and episodes into their order and names the episodes, so that the bytes do not depend on who came first.
    pub fn arrange(&mut self) {
        self.files.sort_by(|a, b| (&a.name, a.hash).cmp(&(&b.name, b.hash)));
        self.episodes.sort_by_key(|episode| episode.id);
        let short = |name: &str| name.rsplit(['/', '\\']).next().unwrap_or(name).to_owned();
        let mut shared: HashMap<String, usize> = HashMap::new();
        self.files.iter().for_each(|file| *shared.entry(short(&file.name)).or_default() += 1);
        let names: HashMap<ContentHash, String> = self
            .files
            .iter()
            .map(|file| {
                let name = short(&file.name);
                (file.hash, if shared[&name] > 1 { file.name.clone() } else { name })
            })
            .collect();
        for episode in &mut self.episodes {
            let file = names.get(&episode.file).cloned().unwrap_or_default();
            episode.name = if episode.number > 0 { format!("{file}#{}", episode.number) } else { file };
        }
    }

    /// Adds an episode of a file, by its number among that file's, with its labels.
    pub fn add_episode(&mut self, episode: &Episode, file: ContentHash, number: u32, labels: BTreeMap<String, String>) {
        self.episodes.push(EpisodeRecord {
            id: episode.id,
            name: episode.name.clone(),
            file,
            number,
            labels,
            rows: episode.rows as u64,
            start: episode.start,
            end: episode.end,
            period: episode.period,
            marks: TrainedEpisode::from(episode).marks,
        });
    }

    /// Writes the file, whole or not at all; tells its sizes.
    ///
    /// # Errors
    /// An expression that has no text; those of writing.
    pub fn write(&self, path: &Path) -> Result<Sizes, Error> {
        let io = |source| Error::Write { path: path.to_owned(), source };
        let file = AtomicFile::create(path)?;
        let (file, sizes) = self.encode(BufWriter::new(file), &io)?;
        file.into_inner().map_err(|error| io(error.into_error()))?.commit()?;
        Ok(sizes)
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// An expression that has no text.
    pub fn to_bytes(&self) -> Result<Vec<u8>, Error> {
        let io = |source| Error::Write { path: "memory".into(), source };
        Ok(self.encode(Vec::new(), &io)?.0)
    }

    fn encode<W: std::io::Write>(&self, out: W, io: &dyn Fn(std::io::Error) -> Error) -> Result<(W, Sizes), Error> {
        let plan = PlanRecord::new(&self.plan)?;
        let head = HeadRecord { version: self.version.clone(), plan: self.plan_hash(), command: self.command };
        let source = SourceRecord {
            recipe: self.recipe.clone(),
            fields: self.fields.iter().map(FieldRecord::new).collect(),
            columns: self.columns.iter().map(|c| (c.name.clone(), c.source.clone(), c.unit.clone())).collect(),
        };
        let files: Vec<FileEntry> = self
            .files
            .iter()
            .map(|file| FileEntry { name: file.name.clone(), hash: file.hash.0, bytes: file.bytes })
            .collect();
        let groups = self.equations.as_ref().map_or(&[][..], |equations| &equations.groups);
        let count = 7 + self.scanned.tasks.len() + GROUP_SECTIONS.len() * groups.len();
        let mut writer = Writer::new(out, count as u32).map_err(io)?;
        writer.section("head", &to_bytes(&head)).map_err(io)?;
        writer.section("plan", &to_bytes(&plan)).map_err(io)?;
        writer.section("source", &to_bytes(&source)).map_err(io)?;
        writer.section("files", &to_bytes(&files)).map_err(io)?;
        writer.section("episodes", &to_bytes(&self.episode_entries())).map_err(io)?;
        for task in &self.scanned.tasks {
            writer.section("task", &task.stats.to_bytes()).map_err(io)?;
        }
        writer.section("also", &self.scanned.also.to_bytes()).map_err(io)?;
        let equations = self.equations.as_ref().map(EquationStatistic::record).transpose()?;
        writer.section("systems", &EquationsRecord::to_bytes(equations.as_ref())).map_err(io)?;
        for group in groups {
            for (name, bytes) in GROUP_SECTIONS.into_iter().zip(group.sections()) {
                writer.section(name, &bytes).map_err(io)?;
            }
        }
        writer.finish().map_err(io)
    }

    fn episode_entries(&self) -> Vec<EpisodeEntry> {
        let places: HashMap<ContentHash, u32> =
            self.files.iter().enumerate().map(|(at, file)| (file.hash, at as u32)).collect();
        self.episodes
            .iter()
            .map(|episode| EpisodeEntry {
                id: episode.id.0.to_le_bytes(),
                file: places.get(&episode.file).copied().unwrap_or(u32::MAX),
                number: episode.number,
                labels: episode.labels.clone(),
                rows: episode.rows,
                start: episode.start,
                end: episode.end,
                period: episode.period,
                marks: episode.marks.clone(),
                counts: self.scanned.rows.get(&episode.id).map(|c| [c.complete, c.at_border, c.incomplete]),
                ranges: self.scanned.ranges.get(&episode.id).cloned(),
            })
            .collect()
    }

    /// Reads a file.
    ///
    /// # Errors
    /// Foreign, newer and damaged files, with the reason.
    pub fn read(path: &Path) -> Result<Self, Error> {
        Ok(Self::read_with_sizes(path)?.0)
    }

    /// [`StatisticFile::read`], and the sizes of the sections.
    ///
    /// # Errors
    /// As [`StatisticFile::read`].
    pub fn read_with_sizes(path: &Path) -> Result<(Self, Sizes), Error> {
        let bytes = std::fs::read(path).map_err(|source| StatisticError::Read { path: path.to_owned(), source })?;
        Ok(Self::from_bytes(&bytes, path)?)
    }

    /// Reads the bytes of a file; `path` is its name, for messages. What is allocated is bounded by a small multiple of the number of bytes.
    ///
    /// # Errors
    /// As [`StatisticFile::read`].
    pub fn from_bytes(bytes: &[u8], path: &Path) -> Result<(Self, Sizes), StatisticError> {
        let mut sections = Sections::new(bytes, path)?;
        let head: HeadRecord = record(&mut sections, "head")?;
        let plan = record::<PlanRecord>(&mut sections, "plan")?.into_plan();
        let plan = plan.map_err(|problem| sections.damaged("section `plan`", &problem))?;
        let hash = plan.hash();
        let source: SourceRecord = record(&mut sections, "source")?;
        let files: Vec<FileEntry> = record(&mut sections, "files")?;
        let episodes: Vec<EpisodeEntry> = record(&mut sections, "episodes")?;
        let mut scanned = plan.empty();
        for (task, preconditioner) in scanned.tasks.iter_mut().zip(&plan.preconditioners) {
            let stats = statistics(&mut sections, "task", &hash, preconditioner.dimension())?;
            *task = TaskStats { preconditioner: preconditioner.clone(), stats };
        }
        scanned.also = statistics(&mut sections, "also", &hash, plan.also.len())?;
        let equations = EquationsRecord::from_bytes(sections.next("systems")?);
        let equations = match equations.map_err(|problem| sections.damaged("section `systems`", &problem))? {
            Some(equations) => Some(systems(&mut sections, equations)?),
            None => None,
        };
        sections.end()?;
        let mut file = Self {
            plan,
            scanned,
            equations,
            episodes: Vec::new(),
            files: files
                .into_iter()
                .map(|file| FileRecord { name: file.name, hash: ContentHash(file.hash), bytes: file.bytes })
                .collect(),
            recipe: source.recipe,
            fields: source.fields.into_iter().map(FieldRecord::into_column).collect(),
            columns: source
                .columns
                .into_iter()
                .map(|(name, source, unit)| ColumnRecord { name, source, unit })
                .collect(),
            version: head.version,
            command: head.command,
        };
        // The older rule cannot be followed any more; the checksums hold of such a file too.
        if sections.version == VERSION && file.plan_hash() != head.plan {
            return Err(sections.damaged("section `plan`", "its hash differs"));
        }
        for entry in episodes {
            file.take(entry).map_err(|problem| sections.damaged("section `episodes`", problem))?;
        }
        file.check().map_err(|problem| sections.damaged("the statistics", problem))?;
        file.arrange();
        Ok((file, sections.sizes))
    }

    fn take(&mut self, entry: EpisodeEntry) -> Result<(), &'static str> {
        let id = EpisodeId(u128::from_le_bytes(entry.id));
        let file = self.files.get(entry.file as usize).ok_or("an episode of a missing file")?.hash;
        if self.episodes.last().is_some_and(|last| last.id >= id) {
            return Err("the episodes are not in ascending order");
        }
        if let Some([complete, at_border, incomplete]) = entry.counts {
            self.scanned.rows.insert(id, RowCounts { complete, at_border, incomplete });
        }
        if let Some(ranges) = entry.ranges {
            if ranges.len() != self.plan.regression.coefficients() {
                return Err("the ranges are not those of the functions");
            }
            self.scanned.ranges.insert(id, ranges);
        }
        self.episodes.push(EpisodeRecord {
            id,
            name: String::new(),
            file,
            number: entry.number,
            labels: entry.labels,
            rows: entry.rows,
            start: entry.start,
            end: entry.end,
            period: entry.period,
            marks: entry.marks,
        });
        Ok(())
    }

    /// That all tasks have the same keys, and that these are of the episodes.
    fn check(&self) -> Result<(), &'static str> {
        let keys = || self.scanned.also.iter().map(|(key, _)| key);
        for task in &self.scanned.tasks {
            if !task.stats.iter().map(|(key, _)| key).eq(keys()) {
                return Err("the tasks have other chunks than the moments");
            }
        }
        if keys().any(|key| self.episode(key.episode).is_none()) {
            return Err("a chunk of a missing episode");
        }
        let known = |episode| self.episode(episode).is_some();
        self.equations.as_ref().map_or(Ok(()), |equations| equations.check(known))
    }
}

fn statistics(sections: &mut Sections<'_>, name: &str, plan: &str, dimension: usize) -> Result<Stats, StatisticError> {
    let stats: Stats = sums(sections, name, plan)?;
    if stats.dimension().is_some_and(|d| d != dimension) {
        return Err(sections.damaged(&format!("section `{name}`"), "it has other columns than the plan"));
    }
    Ok(stats)
}
