//! Numbers and labels: escaping, sub- and superscripts, widths in the font that is drawn.

use std::fmt;
use std::sync::OnceLock;

/// The regular face: Inter, subset (see `assets/fonts`).
pub(crate) const REGULAR: &[u8] = include_bytes!("../../assets/fonts/Inter-Regular.otf");
/// The semi-bold face.
pub(crate) const SEMI_BOLD: &[u8] = include_bytes!("../../assets/fonts/Inter-SemiBold.otf");

/// Size of a sub- or superscript relative to the text around it.
const SCRIPT: f64 = 0.76;

/// Escapes text for XML and HTML, attributes included.
pub(crate) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            _ => out.push(c),
        }
    }
    out
}

/// A coordinate: two decimals at most, no trailing zeros, never `-0`.
pub(crate) fn coord(v: f64) -> String {
    let rounded = (v * 100.0).round() / 100.0;
    // Adding zero turns -0 into 0.
    format!("{}", rounded + 0.0)
}

/// A number for people: `digits` significant digits, a true minus sign, no trailing zeros.
pub(crate) fn number(v: f64, digits: usize) -> String {
    if !v.is_finite() {
        return "\u{2013}".to_owned();
    }
    if v == 0.0 {
        return "0".to_owned();
    }
    let magnitude = v.abs().log10().floor();
    let decimals = (digits as f64 - 1.0 - magnitude).clamp(0.0, 12.0) as usize;
    let text = format!("{v:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text };
    if text == "-0" { "0".to_owned() } else { text.replace('-', "\u{2212}") }
}

/// A number with a fixed count of decimals and a true minus sign.
pub(crate) fn signed(v: f64, decimals: usize) -> String {
    if !v.is_finite() {
        return "\u{2013}".to_owned();
    }
    let text = format!("{v:.decimals$}");
    let zero = text.trim_start_matches('-').chars().all(|c| c == '0' || c == '.');
    if zero { text.trim_start_matches('-').to_owned() } else { text.replace('-', "\u{2212}") }
}

/// A number inside of a format string: `{:.2}` has two decimals, `{:#.3}` three significant digits.
#[derive(Clone, Copy)]
pub(crate) struct N(pub(crate) f64);

impl fmt::Display for N {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = f.precision().unwrap_or(3);
        f.write_str(&if f.alternate() { number(self.0, digits) } else { signed(self.0, digits) })
    }
}

/// `once`, `twice`, `3 times`.
pub(crate) fn times(n: usize) -> String {
    match n {
        1 => "once".to_owned(),
        2 => "twice".to_owned(),
        n => format!("{n} times"),
    }
}

/// A count with its noun: `1 fall`, `2 falls`.
pub(crate) fn plural(n: usize, noun: &str) -> String {
    if n == 1 { format!("1 {noun}") } else { format!("{n} {noun}s") }
}

/// A run of text at one height.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Level {
    Base,
    Sub,
    Super,
}

/// Splits the small markup of labels, `ψ_{roll}` and `deg^{2}`, into runs.
fn runs(text: &str) -> Vec<(Level, String)> {
    let mut out: Vec<(Level, String)> = Vec::new();
    let mut rest = text;
    loop {
        let next = ["_{", "^{"].iter().filter_map(|m| rest.find(m)).min();
        let Some(at) = next else { break };
        let Some(close) = rest[at..].find('}') else {
            break;
        };
        if at > 0 {
            out.push((Level::Base, rest[..at].to_owned()));
        }
        let level = if rest[at..].starts_with('_') { Level::Sub } else { Level::Super };
        out.push((level, rest[at + 2..at + close].to_owned()));
        rest = &rest[at + close + 1..];
    }
    if !rest.is_empty() {
        out.push((Level::Base, rest.to_owned()));
    }
    out
}

/// The label without its markup, for captions, CSV and hover text.
pub(crate) fn plain(text: &str) -> String {
    runs(text)
        .into_iter()
        .map(|(level, run)| match level {
            Level::Base => run,
            Level::Sub => format!("_{run}"),
            Level::Super => format!("^{run}"),
        })
        .collect()
}

/// The inside of a `<text>` element: escaped runs, scripts as shifted spans.
pub(crate) fn spans(text: &str, size: f64) -> String {
    let mut out = String::new();
    let mut shift = 0.0;
    for (level, run) in runs(text) {
        let target = match level {
            Level::Base => 0.0,
            Level::Sub => 0.24 * size,
            Level::Super => -0.34 * size,
        };
        let dy = target - shift;
        shift = target;
        let run = escape(&run);
        match level {
            Level::Base if dy.abs() < 1e-9 => out.push_str(&run),
            Level::Base => out.push_str(&format!("<tspan dy=\"{}\">{run}</tspan>", coord(dy))),
            _ => out.push_str(&format!(
                "<tspan dy=\"{}\" font-size=\"{}\">{run}</tspan>",
                coord(dy),
                coord(size * SCRIPT)
            )),
        }
    }
    out
}

fn face(bold: bool) -> Option<&'static ttf_parser::Face<'static>> {
    static FACES: OnceLock<[Option<ttf_parser::Face<'static>>; 2]> = OnceLock::new();
    let faces = FACES.get_or_init(|| [REGULAR, SEMI_BOLD].map(|data| ttf_parser::Face::parse(data, 0).ok()));
    faces[usize::from(bold)].as_ref()
}

/// Width of a label in pixels; a glyph that the face lacks counts as six tenths of an em.
pub(crate) fn width(text: &str, size: f64, bold: bool) -> f64 {
    let face = face(bold);
    let advance = |c: char| -> f64 {
        face.and_then(|f| {
            let glyph = f.glyph_index(c)?;
            Some(f64::from(f.glyph_hor_advance(glyph)?) / f64::from(f.units_per_em()))
        })
        .unwrap_or(0.6)
    };
    runs(text)
        .iter()
        .map(|(level, run)| {
            let scale = if *level == Level::Base { 1.0 } else { SCRIPT };
            run.chars().map(advance).sum::<f64>() * scale * size
        })
        .sum()
}

/// Breaks text into lines no wider than `limit` pixels.
pub(crate) fn wrap(text: &str, size: f64, limit: f64) -> Vec<String> {
    let mut lines = Vec::new();
    let mut line = String::new();
    for word in text.split_whitespace() {
        let longer = if line.is_empty() { word.to_owned() } else { format!("{line} {word}") };
        if !line.is_empty() && width(&longer, size, false) > limit {
            lines.push(std::mem::take(&mut line));
            line = word.to_owned();
        } else {
            line = longer;
        }
    }
    if !line.is_empty() {
        lines.push(line);
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_as_printed_ones() {
        assert_eq!(number(-0.00123456, 3), "\u{2212}0.00123");
        assert_eq!(number(2.30, 3), "2.3");
        assert_eq!(number(1234.6, 3), "1235");
        assert_eq!(number(0.0, 3), "0");
        assert_eq!(signed(-0.0004, 3), "0.000");
        assert_eq!(format!("{0:.2} {0:#.2}", N(-12.345)), "\u{2212}12.35 \u{2212}12");
        assert_eq!(coord(-0.001), "0");
    }

    #[test]
    fn scripts_become_spans_and_plain_text_keeps_them_apart() {
        assert_eq!(plain("ψ_{roll}(k)"), "ψ_roll(k)");
        assert_eq!(
            spans("a_{b}<", 10.0),
            "a<tspan dy=\"2.4\" font-size=\"7.6\">b</tspan><tspan dy=\"-2.4\">&lt;</tspan>"
        );
    }

    #[test]
    fn lines_are_no_wider_than_asked() {
        let text = "one two three four five six seven eight nine ten eleven twelve";
        let lines = wrap(text, 12.0, 120.0);
        assert!(lines.len() > 2);
        assert!(lines.iter().all(|l| width(l, 12.0, false) <= 120.0));
        assert_eq!(lines.join(" "), text);
    }
}
