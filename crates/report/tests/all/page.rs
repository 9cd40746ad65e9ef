//! Pages of all parts, with unusual names and numbers.

use fleetfoot_report::{
    Axis, Bars, Cell, Chart, Equation, Figure, Interval, Light, Lines, Map, Mark, Math, Matrix, Page, Panels, Part,
    Scale, Section, Sentence, Series, Span, Spans, Stroke, Table,
};
use proptest::prelude::*;

use crate::strict;

fn lines(name: &str, x: &[f64], y: &[f64]) -> Chart {
    let series = |name: &str| Series::line(name, x.to_vec(), y.to_vec());
    let low: Vec<f64> = y.iter().map(|y| y - 1.0).collect();
    let high: Vec<f64> = y.iter().map(|y| y + 1.0).collect();
    let all = vec![
        series(name).banded(low, high),
        series("steps").looks(Stroke::Steps),
        series("reference").looks(Stroke::Reference),
        series("measured").looks(Stroke::Measured),
        series("marks").looks(Stroke::Marks),
        series("hollow marks").looks(Stroke::HollowMarks),
    ];
    let range = [x.first().copied().unwrap_or(f64::NAN), x.last().copied().unwrap_or(f64::NAN)];
    Chart::Lines(
        Lines::new(Axis::of(name, "s"), Axis::of(name, name), all)
            .level(1.0, name)
            .marked(range[1], name)
            .shaded(range, name),
    )
}

fn panels(name: &str, x: &[f64], y: &[f64]) -> Chart {
    let panel = |_| match lines(name, x, y) {
        Chart::Lines(lines) => lines,
        _ => unreachable!(),
    };
    Chart::Panels(Panels::new((0..4).map(panel).collect()).on_one_scale())
}

fn matrix(name: &str, values: &[f64]) -> Chart {
    let names = |count: usize| (0..count).map(|place| format!("{name} {place}")).collect::<Vec<_>>();
    let rows = vec![values.to_vec(); 3];
    Chart::Matrix(Matrix::new(name, [name, "to"], [names(3), names(values.len())], rows))
}

fn map(name: &str, values: &[f64]) -> Chart {
    let axis = || Axis::of(name, "rad").between(0.0, 6.0);
    Chart::Map(Map::new(name, [axis(), axis()], vec![values.to_vec(); 2]))
}

fn bars(name: &str, values: &[f64]) -> Chart {
    let value = |value: &f64| Interval { value: *value, low: value - 0.1, high: value + 0.1 };
    let groups = values.iter().enumerate().map(|(place, _)| format!("{name} {place}")).collect();
    let bars = vec![(name.to_owned(), values.iter().map(value).collect()), ("short".into(), Vec::new())];
    let mut chart = Bars::new(Axis::of(name, ""), groups, bars);
    chart.marks.push(Mark { name: name.into(), values: values.iter().map(|value| 5.0 * value).collect() });
    chart.level = Some((1.0, name.into()));
    Chart::Bars(chart)
}

fn spans(name: &str, values: &[f64]) -> Chart {
    let span = |value: &f64| Span { from: *value, to: value + 1.0, kind: 0 };
    let rows = vec![(name.to_owned(), values.iter().map(span).collect()), ("empty".into(), Vec::new())];
    Chart::Spans(Spans::new(Axis::of(name, "s"), vec![name.to_owned(), "other".into()], rows))
}

/// A page with a part of every kind.
fn page(name: &str, x: &[f64], y: &[f64]) -> Page {
    let figure = |id: &str, chart| Part::Figure(Figure::new(id, name, name, chart));
    let table =
        Table::new(name, [name, "value"]).row([Cell::Text(name.into()), Cell::of(y.first().copied().unwrap_or(0.0))]);
    let sentence = |light| Sentence { light, head: name.into(), text: name.into() };
    let parts = vec![
        Part::Findings([Light::Good, Light::Doubtful, Light::Bad, Light::Plain].map(sentence).to_vec()),
        Part::Paragraph(name.into()),
        Part::Heading(name.into()),
        Part::Table(table),
        Part::Table(Table::default()),
        figure("lines", lines(name, x, y)),
        figure("bars", bars(name, y)),
        figure("panels", panels(name, x, y)),
        figure("matrix", matrix(name, y)),
        figure("map", map(name, y)),
        Part::Equations(vec![Equation {
            pieces: vec![Math::new("<mi>x</mi>"), Math::new("<mo>=</mo>")],
            note: name.into(),
        }]),
        Part::Fold(name.into(), vec![figure("spans", spans(name, x))]),
    ];
    let mut page = Page::new(name, name, vec![Section::new("all", name, parts)]);
    page.source = vec![name.to_owned()];
    page
}

const NAMES: [&str; 5] = [
    "<script>alert(1)</script>",
    "\" onload=\"x",
    "a & b < c > d",
    "&amp;\u{0}\u{1b}",
    "a name that is longer than there is room for it in any of the drawings of a page, narrow or wide",
];

#[test]
fn names_are_text_and_nothing_else() {
    for name in NAMES {
        let page = page(name, &[0.0, 1.0, 2.0], &[0.5, f64::NAN, 3.0]);
        let document = strict::read(&page.to_html());
        assert!(!document.elements.iter().any(|element| element == "script"), "{name}");
        assert!(
            !document.values.iter().any(|(attribute, _)| attribute.starts_with("on") || attribute == "src"),
            "{name}"
        );
        assert!(document.text.contains(&name.replace(['\u{0}', '\u{1b}'], "\u{fffd}")), "{name}");
        for figure in page.figures() {
            assert_eq!(strict::read(&figure.to_svg()).elements[0], "svg", "{name}");
        }
        assert_eq!(page.figures().count(), 6, "folded figures are figures too");
    }
}

#[test]
fn a_figure_has_a_caption_a_table_and_words() {
    let page = page("speed", &[0.0, 1.0], &[0.25, 0.5]);
    let html = page.to_html();
    let document = strict::read(&html);
    let number = |name: &str| document.elements.iter().filter(|element| *element == name).count();
    // Each is drawn twice, for wide and for narrow pages.
    assert_eq!((number("figure"), number("figcaption"), number("svg"), number("desc")), (6, 6, 12, 12));
    assert!(html.contains("speed: 0.2500 at 0 to 0.5000 at 1.000"), "the text alternative has the numbers");
    assert_eq!(page.figures().next().unwrap().table().rows.len(), 2);
    assert!(!html.contains("http://") || html.matches("http://").count() == html.matches("http://www.w3.org/").count());
}

#[test]
fn pages_can_be_read_by_screen_readers() {
    let html = page("speed", &[0.0, 1.0], &[0.25, 0.5]).to_html();
    let document = strict::read(&html);
    let headings: Vec<usize> =
        document.elements.iter().filter_map(|name| name.strip_prefix('h')?.parse().ok()).collect();
    assert_eq!(headings[0], 1, "a page begins with its title");
    assert!(headings.windows(2).all(|pair| pair[1] <= pair[0] + 1), "no level is left out: {headings:?}");
    let with = |attribute: &str, value: &str| {
        document.values.iter().filter(|(key, text)| key == attribute && text == value).count()
    };
    let number = |name: &str| document.elements.iter().filter(|element| *element == name).count();
    assert_eq!(with("role", "img"), number("svg"), "every drawing is an image");
    assert_eq!(number("th"), with("scope", "col") + with("scope", "row"), "every head says of what it is one");
    // A group and no landmark: there are dozens of them.
    assert_eq!(with("tabindex", "0"), with("role", "group"), "what scrolls is reached by keys");
    assert_eq!((with("lang", "en"), number("main"), number("nav"), number("summary")), (1, 1, 1, number("details")));
}

/// A page of five hundred columns and three hundred rows of spans.
#[test]
fn many_names_have_room() {
    let panel = |place: usize| match lines(&format!("column {place}"), &[0.0, 1.0, 2.0], &[0.5, 1.0, 2.0]) {
        Chart::Lines(lines) => lines,
        _ => unreachable!(),
    };
    let rows = (0..300).map(|row| (format!("log {row}"), vec![Span { from: 0.0, to: 1.0, kind: 0 }])).collect();
    let values = vec![vec![0.002; 500]; 2];
    let names = |count: usize| (0..count).map(|place| format!("name {place}")).collect::<Vec<_>>();
    let charts = [
        Chart::Panels(Panels::new((0..500).map(panel).collect())),
        Chart::Spans(Spans::new(Axis::of("time", "s"), vec!["rows".into()], rows)),
        Chart::Matrix(Matrix::new("share", ["from", "to"], [names(2), names(500)], values)),
    ];
    for chart in charts {
        let document = strict::read(&Figure::new("many", "Many", "Many.", chart).to_svg());
        let beyond = |name: &str, least: f64, most: f64| {
            let values = document.values.iter().filter(|(attribute, _)| attribute == name);
            values.filter_map(|(_, value)| value.parse::<f64>().ok()).any(|value| value < least || value > most)
        };
        assert!(!beyond("x", 0.0, 720.5), "nothing is drawn beside the page");
    }
}

/// The light, the dark and the printed colours of a style sheet.
fn colours(sheet: &str) -> Vec<std::collections::BTreeMap<String, [f64; 3]>> {
    let block = |text: &str| {
        let text = &text[..text.find('}').unwrap_or(text.len())];
        let one = |entry: &str| {
            let (name, value) = entry.trim().strip_prefix("--")?.split_once(":#")?;
            let long: String =
                if value.len() == 3 { value.chars().flat_map(|c| [c, c]).collect() } else { value.into() };
            let part = |at: usize| u8::from_str_radix(long.get(at..at + 2)?, 16).ok().map(|v| f64::from(v) / 255.0);
            Some((name.to_owned(), [part(0)?, part(2)?, part(4)?]))
        };
        text.split([';', '{']).filter_map(one).collect()
    };
    let starts = sheet.match_indices("--paper").map(|(at, _)| at);
    starts.filter(|&at| !sheet[..at].ends_with("var(")).map(|at| block(&sheet[at..])).collect()
}

/// Contrast of two colours (Web Content Accessibility Guidelines 2.2, relative luminance).
fn contrast(a: [f64; 3], b: [f64; 3]) -> f64 {
    let linear = |v: f64| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
    let luminance = |c: [f64; 3]| 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
    let (a, b) = (luminance(a), luminance(b));
    (a.max(b) + 0.05) / (a.min(b) + 0.05)
}

#[test]
fn colours_have_contrast_to_the_background() {
    assert!((contrast([0.0; 3], [1.0; 3]) - 21.0).abs() < 1e-9);
    let sheets = [include_str!("../../src/page.css"), include_str!("../../src/figure.css")];
    for sheet in sheets {
        let themes = colours(sheet);
        assert_eq!(themes.len(), 3, "light, dark and print");
        for theme in themes {
            let paper = theme["paper"];
            for (name, &colour) in &theme {
                let least = match name.as_str() {
                    "ink" | "soft" | "good" | "doubtful" | "bad" => 4.5,
                    // Of a drawing the lines, not its grid.
                    name if name.starts_with('s') => 3.0,
                    _ => continue,
                };
                assert!(contrast(colour, paper) >= least, "{name}: {:.2}", contrast(colour, paper));
            }
            if let Some(cell) = theme.get("s0") {
                let darkest = [0, 1, 2].map(|k| 0.5 * (cell[k] + paper[k]));
                assert!(contrast(theme["ink"], darkest) >= 4.5, "numbers on the darkest cell");
            }
        }
    }
}

#[test]
fn the_same_page_is_the_same_bytes() {
    let make = || page("speed", &[0.0, 1.0, 2.0], &[1e-9, 2.0, 3e9]).to_html();
    assert_eq!(make(), make());
}

#[test]
fn values_far_apart_have_a_logarithmic_axis() {
    let values = [1e-3, 1.0, 1e4];
    assert_eq!(Axis::of("error", "").spread(values.into_iter()).scale, Scale::Logarithmic);
    assert_eq!(Axis::of("error", "").spread([1.0, 2.0, f64::NAN].into_iter()).scale, Scale::Linear);
    assert_eq!(Axis::of("error", "").spread([-1.0, 1e9].into_iter()).scale, Scale::Linear);
}

fn any_value() -> impl Strategy<Value = f64> {
    prop_oneof![
        8 => -10.0..10.0f64,
        1 => any::<f64>(),
        1 => prop::sample::select(vec![0.0, -0.0, f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 1e300, -1e300, 5e-324]),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is drawn, the page is well formed and no number of it is none.
    #[test]
    fn any_values_make_a_page(x in prop::collection::vec(any_value(), 0..12), y in prop::collection::vec(any_value(), 0..12), name in ".{0,12}") {
        let length = x.len().min(y.len());
        let document = strict::read(&page(&name, &x[..length], &y[..length]).to_html());
        let places = ["x", "y", "x1", "x2", "y1", "y2", "width", "height", "d", "cx", "cy", "viewBox"];
        for (attribute, value) in document.values.iter().filter(|(attribute, _)| places.contains(&attribute.as_str())) {
            let numbers = value.split(|c: char| c == ' ' || (attribute == "d" && c.is_ascii_alphabetic()));
            // A sign begins a number.
            let numbers = numbers.flat_map(|run| {
                let starts = run.char_indices().filter(|(at, c)| *at > 0 && *c == '-').map(|(at, _)| at);
                let ends: Vec<usize> = std::iter::once(0).chain(starts).chain([run.len()]).collect();
                ends.windows(2).map(|ends| &run[ends[0]..ends[1]]).collect::<Vec<_>>()
            });
            for number in numbers.filter(|number| !number.is_empty()) {
                let number: f64 = number.parse().unwrap_or(f64::NAN);
                prop_assert!(number.abs() < 1e5, "{attribute}={value}");
            }
        }
    }
}

/// A band that reaches below zero is drawn whole on a logarithmic axis, and does not decide the axis' range.
#[test]
fn negative_bands_end_at_the_axis_foot() {
    let mut axis = Axis::of("score", "");
    axis.scale = Scale::Logarithmic;
    let band = |low: [f64; 4]| {
        let line = Series::line("model", vec![0.0, 1.0, 2.0, 3.0], vec![1.0, 2.0, 20.0, 300.0]);
        let line = line.banded(low.to_vec(), vec![2.0, 4.0, 40.0, 600.0]);
        let chart = Lines::new(Axis::of("time", "s"), axis.clone(), vec![line]);
        Figure::new("log", "log", "A band.", Chart::Lines(chart)).to_svg()
    };
    let (whole, above) = (band([0.5, -1.0, 1e-9, 100.0]), band([0.5, 1.0, 1.0, 100.0]));
    assert_eq!(whole.matches("class=\"band").count(), 1, "{whole}");
    let ticks = |svg: &str| {
        svg.split("class=\"tick end\"")
            .skip(1)
            .filter_map(|rest| rest.split('<').next())
            .map(str::to_owned)
            .collect::<Vec<_>>()
    };
    assert_eq!(ticks(&whole), ticks(&above));
}
