//! A figure's sheet: title, legend, rows of panels, caption.

use super::axis::Axis;
use super::panel::{Anchor, Key, Panel, fill, line_svg, mark_svg, rect_svg, text_svg};
use super::style::sheet_rules;
use super::text::{coord, escape, plain, width, wrap};
use crate::figure::{Figure, HoverPoint};

/// Width of every figure, px.
const WIDTH: f64 = 720.0;
const MARGIN: f64 = 14.0;
const TITLE: f64 = 16.0;
const LEGEND: f64 = 12.5;
const CAPTION: f64 = 12.0;

/// A figure being drawn.
#[derive(Default)]
pub(crate) struct Sheet {
    stem: String,
    title: String,
    bottom: f64,
    clips: usize,
    body: String,
    hover: Vec<HoverPoint>,
    keys: Vec<(String, Key)>,
}

impl Sheet {
    pub(crate) fn new(stem: &str, title: &str) -> Sheet {
        Sheet { stem: stem.to_owned(), title: title.to_owned(), ..Sheet::default() }
    }

    /// A row of panels of one height with given axes, titles and shares of the width.
    pub(crate) fn row(&mut self, height: f64, panels: Vec<(f64, Axis, Axis, Option<&str>)>) -> Vec<Panel> {
        let gutters: f64 = panels.iter().map(|p| Panel::gutter(&p.2)).sum();
        let gaps = 18.0 * panels.len().saturating_sub(1) as f64;
        let free = WIDTH - 2.0 * MARGIN - 4.0 - gutters - gaps;
        let shares: f64 = panels.iter().map(|p| p.0).sum();
        let titled = panels.iter().any(|p| p.3.is_some());
        let top = self.bottom + if titled { 30.0 } else { 12.0 };
        self.bottom = top + height + 48.0;
        let mut left = MARGIN;
        let mut place = |(share, x, y, title): (f64, Axis, Axis, Option<&str>)| {
            let (from, width) = (left + Panel::gutter(&y), free * share / shares);
            left = from + width + 18.0;
            self.clips += 1;
            let clip = format!("{}-clip{}", self.stem, self.clips - 1);
            Panel::new(x, y, title, clip, [from, top, width, height])
        };
        panels.into_iter().map(&mut place).collect()
    }

    /// One panel over the whole width.
    pub(crate) fn single(&mut self, height: f64, x: Axis, y: Axis, title: Option<&str>) -> Panel {
        let mut row = self.row(height, vec![(1.0, x, y, title)]);
        row.remove(0)
    }

    /// Left edge of a drawing without axes, px.
    pub(crate) const LEFT: f64 = MARGIN;
    /// Width of a drawing without axes, px.
    pub(crate) const FREE_WIDTH: f64 = WIDTH - 2.0 * MARGIN;

    /// A stretch of the sheet for a drawing without axes: its left edge and its top.
    pub(crate) fn free(&mut self, height: f64) -> [f64; 2] {
        let top = self.bottom + 4.0;
        self.bottom = top + height;
        [Self::LEFT, top]
    }

    /// Puts a drawing without axes on the sheet.
    pub(crate) fn draw(&mut self, svg: &str, hover: Vec<HoverPoint>) {
        self.body.push_str(svg);
        self.hover.extend(hover);
    }

    /// An entry of the legend.
    pub(crate) fn key(&mut self, label: &str, key: Key) {
        self.keys.push((label.to_owned(), key));
    }

    /// Puts a finished panel on the sheet.
    pub(crate) fn add(&mut self, panel: Panel) {
        self.body.push_str(&panel.render());
        self.hover.extend(panel.hover);
        for key in panel.keys {
            if !self.keys.contains(&key) {
                self.keys.push(key);
            }
        }
    }

    /// Legend as SVG from `top` down, and the height that it takes.
    fn legend(&self, top: f64) -> (String, f64) {
        if self.keys.is_empty() {
            return (String::new(), 0.0);
        }
        let (mut x, mut y) = (MARGIN, top + 12.0);
        let mut svg = String::new();
        for (label, key) in &self.keys {
            let wide = 34.0 + width(label, LEGEND, false) + 20.0;
            if x > MARGIN && x + wide > WIDTH - MARGIN + 18.0 {
                x = MARGIN;
                y += 20.0;
            }
            svg.push_str(&key_svg(*key, x, y - 4.2));
            svg += &text_svg("", x + 34.0, y, LEGEND, Anchor::Start, label);
            x += wide;
        }
        (svg, y - top + 8.0)
    }

    /// Finishes the figure.
    pub(crate) fn finish(self, caption: &str, alt: &str, csv: String) -> Figure {
        let head_bottom = 14.0 + TITLE;
        let (legend, legend_height) = self.legend(head_bottom + 6.0);
        let shift = head_bottom + 6.0 + legend_height;
        let height = shift + self.bottom;
        let head = format!(
            "<rect class=\"bg\" width=\"100%\" height=\"100%\"/>{}{legend}<g transform=\"translate(0 {})\">{}</g>",
            text_svg("ttl", MARGIN, head_bottom - 4.0, TITLE, Anchor::Start, &self.title),
            coord(shift),
            self.body
        );
        let lines = wrap(caption, CAPTION, WIDTH - 2.0 * MARGIN);
        let mut caption_svg = String::new();
        for (i, line) in lines.iter().enumerate() {
            let y = height + 12.0 + 17.0 * i as f64;
            caption_svg += &text_svg("mut", MARGIN, y, CAPTION, Anchor::Start, line);
        }
        let full = height + 17.0 * lines.len() as f64 + 12.0;
        let open = |h: f64, extra: &str| {
            format!(
                "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"sm\" viewBox=\"0 0 {} {}\"{extra} \
                 role=\"img\" aria-label=\"{}\">",
                coord(WIDTH),
                coord(h),
                escape(alt)
            )
        };
        let size = format!(" width=\"{}\" height=\"{}\"", coord(WIDTH), coord(full));
        let svg = format!(
            "{}<desc>{}</desc><style>{}</style>{head}{caption_svg}</svg>\n",
            open(full, &size),
            escape(caption),
            sheet_rules()
        );
        let inline_svg = format!("{}{head}</svg>", open(height, ""));
        let hover =
            self.hover.into_iter().map(|p| HoverPoint { x: p.x, y: p.y + shift, text: plain(&p.text) }).collect();
        Figure {
            stem: self.stem,
            title: plain(&self.title),
            caption: caption.to_owned(),
            alt: alt.to_owned(),
            svg,
            csv,
            inline_svg,
            hover,
        }
    }
}

fn key_svg(key: Key, x: f64, y: f64) -> String {
    let path = format!("M{} {}H{}", coord(x), coord(y), coord(x + 27.0));
    match key {
        Key::Line(class, dash) => line_svg(class, dash, &path, 2.2),
        Key::Mark(class, mark) => mark_svg(class, mark, x + 17.0, y, 4.2),
        Key::Band(class, opacity) => rect_svg(&fill(class, opacity), [x, y - 5.5], [27.0, 11.0]),
        Key::Both(class, dash, mark) => {
            let mut svg = line_svg(class, dash, &path, 2.2);
            svg.push_str(&mark_svg(class, mark, x + 13.5, y, 4.2));
            svg
        }
    }
}
