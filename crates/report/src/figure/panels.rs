//! Small charts of lines side by side, with one legend.

use super::{canvas::Canvas, lines::Form, lines::Lines, scale::extent};

/// Small charts of lines side by side. Each is titled by its horizontal axis; the vertical one is that of the first, and its quantity is for the caption to say.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct Panels {
    /// The charts; their lines have the same names, and those of one chart the same places.
    pub panels: Vec<Lines>,
}

/// Room between charts.
const GAP: f64 = 12.0;

impl Panels {
    /// Charts side by side.
    pub fn new(panels: Vec<Lines>) -> Self {
        Self { panels }
    }

    /// The same, with one range of the vertical axes, so that heights can be compared.
    pub fn on_one_scale(mut self) -> Self {
        let [low, high] = extent(self.panels.iter().flat_map(Lines::heights));
        if low < high {
            let room = 0.04 * (high - low);
            self.panels.iter_mut().for_each(|panel| panel.y.range = Some([low - room, high + room]));
        }
        self
    }

    pub(super) fn in_words(&self) -> String {
        self.panels.iter().take(12).map(Lines::in_words).collect::<Vec<_>>().join(" ")
    }

    pub(super) fn draw(&self, mut canvas: Canvas) -> Canvas {
        let entries = self.panels.iter().map(Lines::entries).max_by_key(Vec::len).unwrap_or_default();
        let mut top = canvas.legend(&entries, 0.0) + if entries.is_empty() { 0.0 } else { 4.0 };
        let across = if canvas.is_wide() { 3 } else { 2 };
        let width = (canvas.width - GAP * (across - 1) as f64) / across as f64;
        for (row, panels) in self.panels.chunks(across).enumerate() {
            let mut height: f64 = 0.0;
            for (column, panel) in panels.iter().enumerate() {
                let part = panel.draw(canvas.part(row * across + column, width), Form::Panel);
                height = height.max(part.height);
                canvas.place(part, [(width + GAP) * column as f64, top]);
            }
            top += height + GAP;
        }
        canvas.height = top.max(GAP) - GAP + 4.0;
        canvas
    }
}
