//! The page of results.

use fleetfoot_dataset::json::value;
use fleetfoot_report::Sentence;
use serde::Serialize;
use serde_json::Value;

use crate::Report;

impl Report {
    /// The findings for programs; the figures have their tables on the page.
    pub fn to_json(&self) -> Value {
        value(Findings {
            title: &self.page.title,
            findings: self.findings().map(Finding::from).collect(),
            episodes: self.episodes,
            in_sample_episodes: &self.in_sample,
            notes: &self.notes,
        })
    }
}

#[derive(Serialize)]
struct Findings<'a> {
    title: &'a str,
    findings: Vec<Finding<'a>>,
    episodes: usize,
    in_sample_episodes: &'a [String],
    notes: &'a [String],
}

#[derive(Serialize)]
struct Finding<'a> {
    light: &'static str,
    head: &'a str,
    text: &'a str,
}

impl<'a> From<&'a Sentence> for Finding<'a> {
    fn from(finding: &'a Sentence) -> Self {
        Self { light: finding.light.word(), head: &finding.head, text: &finding.text }
    }
}
