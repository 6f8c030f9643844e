//! One pair of axes and what is drawn between them.

use super::axis::Axis;
use super::text::{coord, spans, width};
use crate::figure::HoverPoint;

/// Size of tick labels, px.
const TICK: f64 = 12.0;
/// Size of axis labels and of notes, px.
const LABEL: f64 = 13.0;

/// How a line is broken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dash {
    Solid,
    Dashed,
    /// Dash and dot in turn.
    Chain,
    Dotted,
}

impl Dash {
    fn attribute(self) -> &'static str {
        match self {
            Dash::Solid => "",
            Dash::Dashed => " stroke-dasharray=\"7 4\"",
            Dash::Chain => " stroke-dasharray=\"9 3.5 1.8 3.5\"",
            Dash::Dotted => " stroke-dasharray=\"1.8 3.6\"",
        }
    }
}

/// The shape of a datum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Mark {
    /// A filled disc with a rim of the ground's colour.
    Disc,
    /// A circle with the ground's colour inside.
    Circle,
    /// A small translucent disc, for many data.
    Dot,
    /// A filled diamond.
    Diamond,
    /// An x.
    Cross,
    /// A filled triangle, point down.
    Triangle,
}

/// What a legend entry shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Key {
    Line(&'static str, Dash),
    Mark(&'static str, Mark),
    Band(&'static str, f64),
    /// A line with a mark on it.
    Both(&'static str, Dash, Mark),
}

/// Where a note's anchor lies in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Anchor {
    Start,
    Middle,
    End,
}

impl Anchor {
    fn name(self) -> &'static str {
        match self {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        }
    }
}

/// Points of ordinates over abscissae.
pub(crate) fn pairs(x: &[f64], y: &[f64]) -> Vec<(f64, f64)> {
    x.iter().copied().zip(y.iter().copied()).collect()
}

/// Points of values over their number, from 1.
pub(crate) fn numbered(values: &[f64]) -> Vec<(f64, f64)> {
    values.iter().enumerate().map(|(i, v)| (i as f64 + 1.0, *v)).collect()
}

/// The data of an SVG path through pixels; one that is not finite breaks it.
pub(crate) fn path_data(points: impl IntoIterator<Item = [f64; 2]>) -> String {
    let (mut d, mut pen) = (String::new(), 'M');
    for [x, y] in points {
        if x.is_finite() && y.is_finite() {
            d += &format!("{pen}{} {}", coord(x), coord(y));
            pen = 'L';
        } else {
            pen = 'M';
        }
    }
    d
}

/// A rectangle as SVG: what it looks like, left and top, width and height.
pub(crate) fn rect_svg(look: &str, [left, top]: [f64; 2], [width, height]: [f64; 2]) -> String {
    let [x, y, w, h] = [left, top, width, height].map(coord);
    format!("<rect {look} x=\"{x}\" y=\"{y}\" width=\"{w}\" height=\"{h}\"/>")
}

/// The class that fills with the colour with which another one strokes, and how opaque it is.
pub(crate) fn fill(class: &str, opacity: f64) -> String {
    format!("class=\"{}\" fill-opacity=\"{}\"", class.replace('s', "f"), coord(opacity))
}

/// What a cell of a heat map looks like.
pub(crate) fn cell_look(color: &str) -> String {
    format!("fill=\"{color}\" shape-rendering=\"crispEdges\"")
}

/// A line of text as SVG at a pixel position, its subscripts set.
pub(crate) fn text_svg(class: &str, x: f64, y: f64, size: f64, anchor: Anchor, text: &str) -> String {
    let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
    format!(
        "<text{class} x=\"{}\" y=\"{}\" font-size=\"{size}\" text-anchor=\"{}\">{}</text>",
        coord(x),
        coord(y),
        anchor.name(),
        spans(text, size)
    )
}

/// A mark as SVG at a pixel position.
pub(crate) fn mark_svg(class: &str, mark: Mark, x: f64, y: f64, r: f64) -> String {
    let (cx, cy) = (coord(x), coord(y));
    let fill = class.replace('s', "f");
    let circle = |class: &str, r: f64, more: &str| {
        format!("<circle class=\"{class}\" cx=\"{cx}\" cy=\"{cy}\" r=\"{}\" {more}/>", coord(r))
    };
    // Corners by their distance from the middle, in radii.
    let corner = |[dx, dy]: [f64; 2]| [x + dx * r, y + dy * r];
    let shape = |corners: &[[f64; 2]], stroke: f64| {
        let d = path_data(corners.iter().map(|c| corner(*c)));
        format!("<path class=\"{fill} sbg\" stroke-width=\"{stroke}\" d=\"{d}Z\"/>")
    };
    match mark {
        Mark::Disc => circle(&format!("{fill} sbg"), r, "stroke-width=\"1\""),
        Mark::Circle => circle(&format!("bg {class}"), r, "stroke-width=\"1.8\""),
        Mark::Dot => circle(&fill, r * 0.8, "fill-opacity=\"0.55\""),
        Mark::Diamond => shape(&[[-1.25, 0.0], [0.0, -1.25], [1.25, 0.0], [0.0, 1.25]], 1.0),
        Mark::Triangle => shape(&[[-1.1, -1.0], [1.1, -1.0], [0.0, 1.0]], 0.8),
        Mark::Cross => {
            let strokes = [[[-1.0, -1.0], [1.0, 1.0]], [[-1.0, 1.0], [1.0, -1.0]]];
            let d = strokes.map(|stroke| path_data(stroke.map(corner))).concat();
            line_svg(class, Dash::Solid, &d, 2.0)
        }
    }
}

/// A piece of line as SVG.
pub(crate) fn line_svg(class: &str, dash: Dash, path: &str, stroke: f64) -> String {
    format!("<path class=\"l {class}\" stroke-width=\"{}\"{} d=\"{path}\"/>", coord(stroke), dash.attribute())
}

/// A pair of axes at a place on the sheet.
#[derive(Clone, Debug)]
pub(crate) struct Panel {
    pub(crate) x: Axis,
    pub(crate) y: Axis,
    pub(crate) title: Option<String>,
    pub(crate) left: f64,
    pub(crate) top: f64,
    pub(crate) width: f64,
    pub(crate) height: f64,
    pub(crate) clip: String,
    data: String,
    over: String,
    pub(crate) hover: Vec<HoverPoint>,
    pub(crate) keys: Vec<(String, Key)>,
}

impl Panel {
    /// Room that the tick labels and the label of a vertical axis need, px.
    pub(crate) fn gutter(y: &Axis) -> f64 {
        let widest = y.ticks.iter().map(|t| width(&t.1, TICK, false)).fold(0.0, f64::max);
        widest + 8.0 + LABEL + 12.0
    }

    /// An empty pair of axes; `place` is left edge, top, width and height, px.
    pub(crate) fn new(x: Axis, y: Axis, title: Option<&str>, clip: String, place: [f64; 4]) -> Panel {
        let [left, top, width, height] = place;
        let (data, over, hover, keys) = Default::default();
        Panel { x, y, title: title.map(str::to_owned), left, top, width, height, clip, data, over, hover, keys }
    }

    /// Pixel column of a value.
    pub(crate) fn px(&self, v: f64) -> f64 {
        self.left + self.width * self.x.fraction(v)
    }

    /// Pixel row of a value.
    pub(crate) fn py(&self, v: f64) -> f64 {
        self.top + self.height * (1.0 - self.y.fraction(v))
    }

    fn path(&self, points: &[(f64, f64)]) -> String {
        path_data(points.iter().map(|&(x, y)| [self.px(x), self.py(y)]))
    }

    /// A line through points; a point that is not finite breaks it.
    pub(crate) fn line(&mut self, points: &[(f64, f64)], class: &str, dash: Dash, stroke: f64) {
        let svg = line_svg(class, dash, &self.path(points), stroke);
        self.data.push_str(&svg);
    }

    /// The area between two curves over the same abscissae.
    pub(crate) fn band(&mut self, x: &[f64], lo: &[f64], hi: &[f64], class: &str, opacity: f64) {
        let mut ring: Vec<(f64, f64)> = x.iter().copied().zip(hi.iter().copied()).collect();
        ring.extend(x.iter().copied().zip(lo.iter().copied()).rev());
        self.data += &format!("<path {} d=\"{}Z\"/>", fill(class, opacity), self.path(&ring));
    }

    /// Marks at points, clipped to the panel.
    pub(crate) fn marks(&mut self, points: &[(f64, f64)], class: &str, mark: Mark, r: f64) {
        for &(x, y) in points.iter().filter(|p| p.0.is_finite() && p.1.is_finite()) {
            let svg = mark_svg(class, mark, self.px(x), self.py(y), r);
            self.data.push_str(&svg);
        }
    }

    /// The same with their entry in the legend, if there are any.
    pub(crate) fn scatter(&mut self, name: &str, points: &[(f64, f64)], class: &'static str, mark: Mark, r: f64) {
        if !points.is_empty() {
            self.marks(points, class, mark, r);
            self.key(name, Key::Mark(class, mark));
        }
    }

    /// Vertical bars with caps from `lo` to `hi`.
    pub(crate) fn error_bars(&mut self, bars: &[(f64, f64, f64)], class: &str, cap: f64) {
        let mut d = String::new();
        for &(x, lo, hi) in bars {
            let (x, a, b) = (self.px(x), coord(self.py(lo)), coord(self.py(hi)));
            let (l, c, r) = (coord(x - cap), coord(x), coord(x + cap));
            d.push_str(&format!("M{l} {a}L{r} {a}M{c} {a}L{c} {b}M{l} {b}L{r} {b}"));
        }
        self.data.push_str(&line_svg(class, Dash::Solid, &d, 1.3));
    }

    /// A filled bar between two abscissae from `y0` to `y1`.
    pub(crate) fn bar(&mut self, x: (f64, f64), y: (f64, f64), class: &str, opacity: f64) {
        let (l, r) = (self.px(x.0), self.px(x.1));
        let (a, b) = (self.py(y.0), self.py(y.1));
        self.data += &rect_svg(&fill(class, opacity), [l.min(r), a.min(b)], [(r - l).abs(), (a - b).abs()]);
    }

    /// A cell of a heat map, a trifle enlarged so that no seam shows.
    pub(crate) fn cell(&mut self, x: (f64, f64), y: (f64, f64), color: &str) {
        let (l, r) = (self.px(x.0), self.px(x.1));
        let (b, t) = (self.py(y.0), self.py(y.1));
        self.data += &rect_svg(&cell_look(color), [l, t], [r - l + 0.4, b - t + 0.4]);
    }

    /// Short strokes along the bottom: where the data are.
    pub(crate) fn rug(&mut self, values: &[f64], class: &str, row: usize) {
        let bottom = self.top + self.height - 1.0 - 9.0 * row as f64;
        let d: String = values
            .iter()
            .filter(|v| v.is_finite())
            .map(|v| {
                let x = coord(self.px(*v));
                format!("M{x} {}L{x} {}", coord(bottom), coord(bottom - 7.0))
            })
            .collect();
        self.data
            .push_str(&format!("<path class=\"l {class}\" stroke-width=\"1\" stroke-opacity=\"0.45\" d=\"{d}\"/>"));
    }

    /// A line across at a value of the vertical axis.
    pub(crate) fn across(&mut self, y: f64, class: &str, dash: Dash) {
        self.line(&[(self.x.min, y), (self.x.max, y)], class, dash, 1.4);
    }

    /// A line upward at a value of the horizontal axis.
    pub(crate) fn upward(&mut self, x: f64, class: &str, dash: Dash) {
        self.line(&[(x, self.y.min), (x, self.y.max)], class, dash, 1.2);
    }

    /// A note at a pixel position.
    pub(crate) fn note_px(&mut self, x: f64, y: f64, anchor: Anchor, class: &str, text: &str) {
        self.over += &text_svg(class, x, y, TICK, anchor, text);
    }

    /// A value that the page shows when the pointer comes near.
    pub(crate) fn hover(&mut self, x: f64, y: f64, text: String) {
        if x.is_finite() && y.is_finite() {
            let clamp = |v: f64, lo: f64, hi: f64| v.max(lo).min(hi);
            self.hover.push(HoverPoint {
                x: clamp(self.px(x), self.left, self.left + self.width),
                y: clamp(self.py(y), self.top, self.top + self.height),
                text,
            });
        }
    }

    /// An entry of the sheet's legend.
    pub(crate) fn key(&mut self, label: &str, key: Key) {
        self.keys.push((label.to_owned(), key));
    }

    /// The panel as SVG.
    pub(crate) fn render(&self) -> String {
        let (l, t) = (self.left, self.top);
        let (r, b) = (l + self.width, t + self.height);
        let mut grid = String::new();
        let mut ticks = String::new();
        for (v, label) in &self.x.ticks {
            let x = self.px(*v);
            grid.push_str(&format!("M{} {}V{}", coord(x), coord(t), coord(b)));
            ticks += &text_svg("mut", x, b + TICK + 6.0, TICK, Anchor::Middle, label);
        }
        for (v, label) in &self.y.ticks {
            let y = self.py(*v);
            grid.push_str(&format!("M{} {}H{}", coord(l), coord(y), coord(r)));
            ticks += &text_svg("mut", l - 8.0, y + 0.36 * TICK, TICK, Anchor::End, label);
        }
        let title = self.title.as_deref().map(|title| text_svg("pnl", l, t - 9.0, LABEL, Anchor::Start, title));
        let title = title.unwrap_or_default();
        let x_label = text_svg("", l + 0.5 * self.width, b + 38.0, LABEL, Anchor::Middle, &self.x.label);
        let (cx, cy) = (l - Self::gutter(&self.y) + LABEL, t + 0.5 * self.height);
        let y_label = format!(
            "<text transform=\"translate({} {}) rotate(-90)\" font-size=\"{LABEL}\" \
             text-anchor=\"middle\">{}</text>",
            coord(cx),
            coord(cy),
            spans(&self.y.label, LABEL)
        );
        format!(
            "<g class=\"panel\"><clipPath id=\"{0}\"><rect x=\"{1}\" y=\"{2}\" width=\"{3}\" \
             height=\"{4}\"/></clipPath><path class=\"grid\" stroke-width=\"1\" d=\"{grid}\"/>\
             <g clip-path=\"url(#{0})\">{5}</g>\
             <path class=\"axis\" stroke-width=\"1\" d=\"M{1} {2}V{6}H{7}\"/>{ticks}{title}{x_label}{y_label}{8}</g>",
            self.clip,
            coord(l),
            coord(t),
            coord(self.width),
            coord(self.height),
            self.data,
            coord(b),
            coord(r),
            self.over
        )
    }
}
