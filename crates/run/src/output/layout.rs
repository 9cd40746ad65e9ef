//! Layouts of viewers beside written messages. Opened with the file they show simulated or predicted lines over
//! measured ones, without dragging topics.
//!
//! Foxglove's layouts are JSON: panels by an identifier, and how they are arranged, halves of halves. PlotJuggler's are XML: plots in a splitter of a tab; it names the
//! numbers of a JointState `topic/name/position`.

use std::path::{Path, PathBuf};

use fleetfoot_fit::Error;
use fleetfoot_output::{Overlay, together, write_atomic};
use serde_json::{Value, json};

use super::{Kind, kind};

/// Suffixes of the layout files, behind the name of the messages' file.
const SUFFIXES: [&str; 2] = ["foxglove.json", "plotjuggler.xml"];
/// Plots that a layout has: a screen has no room for more.
const PLOTS: usize = 8;
/// Colours in the order of the lines: measured dark, then distinct ones.
const COLOURS: [&str; 6] = ["#5b6168", "#1f5fae", "#c2560c", "#1b7f5c", "#8d3f9c", "#b02a4c"];

/// A plot of a layout.
pub(crate) struct Plot {
    /// Its title.
    pub(crate) title: String,
    /// Its lines; the measured one is the first.
    pub(crate) lines: Vec<Line>,
}

/// A number of a topic's messages over time.
pub(crate) struct Line {
    /// The topic.
    pub(crate) topic: String,
    /// The name of the number, and its place among the names.
    pub(crate) name: String,
    pub(crate) place: usize,
    /// Label of the line.
    pub(crate) label: String,
}

/// The files of the layouts that are written beside a file of messages (`*.mcap`): Foxglove's and PlotJuggler's. Beside other files there are none.
pub fn layout_files(output: &Path) -> Vec<PathBuf> {
    match kind(output) {
        Ok(Kind::Mcap) => SUFFIXES.iter().map(|suffix| output.with_extension(suffix)).collect(),
        _ => Vec::new(),
    }
}

/// Ends a file of messages, and writes the layouts of some plots beside it: all three files or none.
pub(crate) fn finish_with_layouts(overlay: Overlay, messages: &Path, plots: &[Plot]) -> Result<(), Error> {
    let plots = &plots[..plots.len().min(PLOTS)];
    let layouts = [format!("{:#}\n", foxglove(plots)), plotjuggler(plots)];
    together(|| {
        overlay.finish()?;
        layout_files(messages).iter().zip(&layouts).try_for_each(|(path, text)| write_atomic(path, text.as_bytes()))?;
        Ok(())
    })
}

fn colour(line: usize) -> &'static str {
    COLOURS[line % COLOURS.len()]
}

fn foxglove(plots: &[Plot]) -> Value {
    let id = |place: usize| format!("Plot!fleetfoot{place}");
    let path = |(place, line): (usize, &Line)| {
        json!({
            "value": format!("{}.position[{}]", line.topic, line.place), "enabled": true, "timestampMethod": "receiveTime",
            "label": line.label, "color": colour(place),
        })
    };
    let panel = |plot: &Plot| {
        json!({
            "title": plot.title, "paths": plot.lines.iter().enumerate().map(path).collect::<Vec<_>>(),
            "showXAxisLabels": true, "showYAxisLabels": true, "showLegend": true, "legendDisplay": "floating",
            "showPlotValuesInLegend": false, "isSynced": true, "xAxisVal": "timestamp", "sidebarDimension": 240,
        })
    };
    let panels = plots.iter().enumerate().map(|(place, plot)| (id(place), panel(plot)));
    let ids: Vec<String> = (0..plots.len()).map(id).collect();
    json!({
        "configById": panels.collect::<serde_json::Map<_, _>>(), "globalVariables": {}, "userNodes": {},
        "playbackConfig": { "speed": 1 }, "layout": arranged(&ids, true),
    })
}

/// Panels as halves of halves: side by side, and one below the other within.
fn arranged(ids: &[String], column: bool) -> Value {
    match ids {
        [] => json!(""),
        [one] => json!(one),
        several => {
            let (first, second) = several.split_at(several.len().div_ceil(2));
            let direction = if column { "column" } else { "row" };
            let share = 100.0 * first.len() as f64 / several.len() as f64;
            json!({
                "direction": direction, "first": arranged(first, !column), "second": arranged(second, !column), "splitPercentage": share,
            })
        }
    }
}

fn plotjuggler(plots: &[Plot]) -> String {
    let curve = |(place, line): (usize, &Line)| {
        let name = escaped(&format!("{}/{}/position", line.topic, line.name));
        format!("      <curve name=\"{name}\" color=\"{}\"/>\n", colour(place))
    };
    let area = |plot: &Plot| {
        let curves: String = plot.lines.iter().enumerate().map(curve).collect();
        format!(
            "    <DockArea name=\"{}\">\n     <plot style=\"Lines\" mode=\"TimeSeries\" flip_x=\"false\" flip_y=\"false\">\n      <limitY/>\n{curves}     </plot>\n    </DockArea>\n",
            escaped(&plot.title)
        )
    };
    let count = plots.len().max(1);
    let sizes = vec![format!("{:.6}", 1.0 / count as f64); count].join(";");
    format!(
        "<?xml version='1.0' encoding='UTF-8'?>\n<root>\n <tabbed_widget parent=\"main_window\" name=\"Main Window\">\n  <Tab containers=\"1\" tab_name=\"fleetfoot\">\n   <Container>\n   \
         <DockSplitter orientation=\"-\" count=\"{count}\" sizes=\"{sizes}\">\n{}   </DockSplitter>\n   </Container>\n  </Tab>\n  <currentTabIndex index=\"0\"/>\n </tabbed_widget>\n</root>\n",
        plots.iter().map(area).collect::<String>()
    )
}

/// A value of an attribute. XML 1.0 has no place for most control characters and for the last two code points of the
/// first plane, not even as references (its production 2, `Char`). They become U+FFFD. Tab and line ends are written as
/// references, as a reader makes plain ones blanks.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\t' | '\n' | '\r' => escaped.push_str(&format!("&#{};", c as u32)),
            '\0'..'\u{20}' | '\u{fffe}' | '\u{ffff}' => escaped.push(char::REPLACEMENT_CHARACTER),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plots(count: usize) -> Vec<Plot> {
        let line = |topic: &str, label: &str, place| Line {
            topic: topic.to_owned(),
            name: format!("d(v)/dt & \"{place}\""),
            place,
            label: label.to_owned(),
        };
        let plot = |place: usize| Plot {
            title: format!("<v{place}>"),
            lines: vec![
                line("/fleetfoot/measured", "measured", place),
                line("/fleetfoot/predicted", "predicted", place),
            ],
        };
        (0..count).map(plot).collect()
    }

    #[test]
    fn every_panel_has_its_place_and_lines() {
        for count in [1, 2, 3, 7] {
            let layout = foxglove(&plots(count));
            let panels = layout["configById"].as_object().expect("panels");
            assert_eq!(panels.len(), count);
            let text = layout["layout"].to_string();
            assert!(panels.keys().all(|id| text.matches(&format!("\"{id}\"")).count() == 1), "{text}");
        }
        let layout = foxglove(&plots(2));
        assert_eq!(layout["configById"]["Plot!fleetfoot1"]["paths"][1]["value"], "/fleetfoot/predicted.position[1]");
    }

    #[test]
    fn names_are_escaped_in_xml() {
        let xml = plotjuggler(&plots(3));
        assert!(xml.contains("name=\"/fleetfoot/predicted/d(v)/dt &amp; &quot;2&quot;/position\""), "{xml}");
        assert!(
            xml.contains("<DockArea name=\"&lt;v1&gt;\">")
                && xml.contains("count=\"3\" sizes=\"0.333333;0.333333;0.333333\"")
        );
        assert_eq!(escaped("a\u{1}b\u{0}\tc\r\n\u{fffe}\u{7f}"), "a\u{fffd}b\u{fffd}&#9;c&#13;&#10;\u{fffd}\u{7f}");
        let (opened, closed) = (xml.matches('<').count(), xml.matches('>').count());
        assert_eq!(opened, closed);
    }
}
