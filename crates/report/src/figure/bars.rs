//! Values by name: horizontal bars with intervals, marks beside them, and a line of reference.

use super::{
    canvas::{Canvas, Frame, INDENT, LINE, Sample, colour, width_of},
    scale::{Axis, Ruler},
};
use crate::{
    markup::Element,
    words::{ratio, typeset},
};

/// A value and its interval; an end that is not known is NaN.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    /// The value.
    pub value: f64,
    /// The lower end.
    pub low: f64,
    /// The upper end.
    pub high: f64,
}

/// Values to compare with, one a group.
#[derive(Debug, Clone, PartialEq)]
pub struct Mark {
    /// The name.
    pub name: String,
    /// A value a group; NaN where there is none.
    pub values: Vec<f64>,
}

/// A chart of bars.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Bars {
    /// The axis of the values.
    pub axis: Axis,
    /// Names of the groups, from the top.
    pub groups: Vec<String>,
    /// Names of the bars of every group, and their values, one a group.
    pub bars: Vec<(String, Vec<Interval>)>,
    /// Marks.
    pub marks: Vec<Mark>,
    /// A value that all are compared with, and its words.
    pub level: Option<(f64, String)>,
}

/// Height of a bar, and room between groups.
const BAR: f64 = 12.0;
const GAP: f64 = 12.0;
/// A group's name has at most this much room beside its bars.
const NAME: f64 = 200.0;

impl Bars {
    /// A chart of bars; `bars` are names with a value a group.
    pub fn new(axis: Axis, groups: Vec<String>, bars: Vec<(String, Vec<Interval>)>) -> Self {
        Self { axis: axis.with_zero(), groups, bars, marks: Vec::new(), level: None }
    }

    /// The values, and where they are good.
    pub(super) fn in_words(&self) -> String {
        let of = |(name, values): &(String, Vec<Interval>)| {
            let pairs = self.groups.iter().zip(values).take(12);
            let texts: Vec<String> = pairs.map(|(group, v)| format!("{group} {}", typeset(&ratio(v.value)))).collect();
            format!("{name}: {}", texts.join(", "))
        };
        format!("{}. {}.", self.axis.title(), self.bars.iter().map(of).collect::<Vec<_>>().join("; "))
    }

    /// Values that the axis shows: bars, intervals that are not far beyond them, and the level. Marks may lie beyond.
    fn shown(&self) -> Vec<f64> {
        let values = || self.bars.iter().flat_map(|(_, values)| values);
        let most = values().map(|v| v.value).filter(|v| v.is_finite()).fold(0.0, f64::max);
        let most = self.level.as_ref().map_or(most, |(level, _)| most.max(*level));
        // If no value is below zero, an interval that reaches there only shows that it is wide.
        let least = values().map(|v| v.value).filter(|v| v.is_finite()).fold(0.0, f64::min);
        let near = |value: &f64| (1.5 * least..=1.5 * most).contains(value);
        let ends = values().flat_map(|v| [v.low, v.high]);
        let marks = self.marks.iter().flat_map(|mark| mark.values.iter().copied());
        ends.chain(marks).filter(near).chain(values().map(|v| v.value)).chain([most]).collect()
    }

    pub(super) fn draw(&self, mut canvas: Canvas) -> Canvas {
        let top = self.legend(&mut canvas) + LINE;
        let beside = canvas.is_wide();
        let widest = self.groups.iter().map(|name| width_of(name)).fold(0.0, f64::max).min(NAME);
        let left = if beside { widest + 12.0 } else { INDENT };
        let head = if beside { 0.0 } else { LINE + 2.0 };
        let one = head + BAR * self.bars.len().max(1) as f64;
        let height = (one + GAP) * self.groups.len() as f64;
        // To the right of the bars their values stand, where there is one bar a group.
        let column = if self.bars.len() == 1 { 52.0 } else { 12.0 };
        let frame = Frame { left, right: canvas.width - column, top, bottom: top + height };
        canvas.height = frame.bottom + 2.0 * LINE + 8.0;
        let ruler = self.axis.ruler(self.shown().into_iter(), frame.left, frame.right);
        canvas.across(&ruler, &frame, &self.axis.title());
        for (group, name) in self.groups.iter().enumerate() {
            let y = frame.top + (one + GAP) * group as f64 + 0.5 * GAP;
            if beside {
                canvas.label("end", [left - 10.0, y + 0.5 * one + 4.0], name, NAME);
            } else {
                canvas.label("start", [0.0, y + LINE - 3.0], name, canvas.width);
            }
            self.group(&mut canvas, group, &ruler, y + head);
        }
        if let Some((level, words)) = &self.level
            && let Some(x) = ruler.at(*level)
        {
            canvas.line("level", [x, frame.top - 4.0], [x, frame.bottom]);
            canvas.text("note", if x > 0.6 * canvas.width { "end" } else { "start" }, [x, frame.top - 7.0], words);
        }
        canvas
    }

    fn group(&self, canvas: &mut Canvas, group: usize, ruler: &Ruler, top: f64) {
        for (index, (_, values)) in self.bars.iter().enumerate() {
            let Some(value) = values.get(group) else { continue };
            let y = top + BAR * index as f64;
            self.bar(canvas, value, &colour(index), ruler, y);
            if self.bars.len() == 1 {
                canvas.text("value", "end", [canvas.width, y + 0.5 * BAR + 4.0], &typeset(&ratio(value.value)));
            }
        }
        let middle = top + 0.5 * BAR * self.bars.len().max(1) as f64;
        for (index, mark) in self.marks.iter().enumerate() {
            let Some(&value) = mark.values.get(group) else { continue };
            let class = format!("reference r{}", index % 3);
            match ruler.at(value) {
                Some(_) if ruler.is_beyond(value) => canvas.beyond(&class, [ruler.to, middle]),
                Some(x) => canvas.diamond(&class, [x, middle]),
                None => {}
            }
        }
    }

    fn bar(&self, canvas: &mut Canvas, value: &Interval, class: &str, ruler: &Ruler, y: f64) {
        let (Some(zero), Some(end)) = (ruler.at(0.0), ruler.at(value.value)) else { return };
        let (from, to) = (zero.min(end), zero.max(end).min(ruler.to));
        canvas.add(
            Element::new("rect")
                .class(format!("bar {class}"))
                .at("x", from)
                .at("y", y + 1.0)
                .at("width", (to - from).max(0.5))
                .at("height", BAR - 2.0),
        );
        if let (Some(low), Some(high)) = (ruler.at(value.low), ruler.at(value.high)) {
            let middle = y + 0.5 * BAR;
            canvas.line("whisker", [low.max(ruler.from), middle], [high.min(ruler.to), middle]);
        }
    }

    fn legend(&self, canvas: &mut Canvas) -> f64 {
        let bars = self.bars.iter().enumerate().map(|(i, (name, _))| (Sample::Box, colour(i), name.clone()));
        let marks = self.marks.iter().enumerate();
        let marks = marks.map(|(i, mark)| (Sample::Mark, format!("reference r{}", i % 3), mark.name.clone()));
        let entries: Vec<_> = bars.chain(marks).collect();
        if entries.len() < 2 { 0.0 } else { canvas.legend(&entries, 0.0) }
    }
}
