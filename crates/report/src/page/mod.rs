//! `report.html`: one file, no network, of one run or of several side by side.

mod facts;
mod falls;
mod html;
mod model;
mod replay;

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use crate::draw::{escape, page_variables};
use crate::error::{ReportError, Result};
use crate::figure::{Figure, write_aside};
use crate::figures::runs_compared;
use crate::report::{Section, sections};
use stridemap_record::{Recording, Run};

const STYLE: &str = include_str!("../../assets/page/style.css");
const FIGURES: &str = include_str!("../../assets/page/figures.js");
const REPLAY: &str = include_str!("../../assets/page/replay.js");
const REGULAR: &[u8] = include_bytes!("../../assets/fonts/Inter-Regular.woff2");
const SEMI_BOLD: &[u8] = include_bytes!("../../assets/fonts/Inter-SemiBold.woff2");

/// Up to how many runs stand beside each other with all of their figures; more would neither fit on a screen
/// nor into the size that a page may have.
const MOST_BESIDE: usize = 4;

/// Bytes that all recordings of a page may take, of the 6 MB that it may have.
const POSE_BUDGET: usize = 2_600_000;

/// Writes `report.html` of runs into a file, and nothing else.
///
/// # Errors
///
/// [`ReportError::Empty`] without a run; [`ReportError::Io`] if the file cannot be written.
pub fn write_report(runs: &[Run], file: &Path) -> Result<()> {
    write_aside(file, report_html(runs)?.as_bytes())
}

/// The page of one run, or of several side by side, as HTML.
///
/// The same runs give the same bytes.
///
/// # Errors
///
/// [`ReportError::Empty`] without a run.
pub fn report_html(runs: &[Run]) -> Result<String> {
    let Some(first) = runs.first() else {
        return Err(ReportError::Empty { figure: "report".to_owned(), what: "no run".to_owned() });
    };
    let title = if runs.len() == 1 { facts::title(first) } else { format!("{} runs side by side", runs.len()) };
    let mut page = Page::default();
    let parts: Vec<Vec<Section>> =
        if runs.len() <= MOST_BESIDE { runs.iter().map(sections).collect() } else { Vec::new() };

    page.body.push_str("<main>");
    if let [run] = runs {
        page.body.push_str(&facts::remarks(run));
        page.body.push_str(&falls::table(run));
        page.body.push_str(&facts::tiles(run));
    } else {
        page.overview(runs);
    }
    let beside = runs.len() <= MOST_BESIDE;
    if beside {
        page.replays(runs);
        let numbered: usize = parts.iter().map(Vec::len).max().unwrap_or(0);
        for s in 0..numbered {
            page.section(runs, &parts, s);
        }
    } else {
        page.body.push_str(&format!(
            "<p class=\"note\">Figures and replays of each of the {} runs stand on the page in its own directory, report.html.</p>",
            runs.len()
        ));
    }
    page.made(runs);
    page.body.push_str("</main>");
    let lede = if runs.len() == 1 {
        "A robot, seen once per step, is a noisy map. This run learned that map from its own steps, improved the policy inside it, \
         and gave it back to the robot."
    } else {
        "The same figures of several runs, beside each other."
    };
    Ok(page.finish(&title, lede, runs.len() > 1))
}

/// A page that shows a robot moving, below what was looked at: whether it is as it must be, what it was, and what was found.
///
/// # Errors
///
/// [`ReportError::Empty`] for a recording without a frame.
pub fn film_html(title: &str, looked_at: &[(bool, String, String)], recording: &Recording) -> Result<String> {
    if recording.frames.is_empty() {
        return Err(ReportError::Empty { figure: "film".to_owned(), what: "no frame".to_owned() });
    }
    let mut page = Page::default();
    page.body.push_str("<main>");
    page.heading("replay", "The robot moving");
    let recording = ("nominal gait".to_owned(), recording.clone());
    page.player("poses", &[&recording], POSE_BUDGET / recording.1.frames.len());
    page.heading("check", "What was looked at");
    let rows: Vec<Vec<String>> = (looked_at.iter())
        .map(|(ok, what, found)| {
            vec![escape(what), if *ok { "ok" } else { "<b>not ok</b>" }.to_owned(), html::subscripts(found)]
        })
        .collect();
    page.body.push_str(&html::table(&[("what", false), ("", false), ("found", false)], &rows));
    page.body.push_str("</main>");
    Ok(page.finish(title, "The nominal gait from its start, and what stridemap check found.", false))
}

/// The recordings of a run that its page shows: before and after, and under pushes.
fn shown(run: &Run) -> [Vec<&(String, Recording)>; 2] {
    let (pushed, calm): (Vec<_>, Vec<_>) =
        run.recordings.iter().filter(|r| !r.1.frames.is_empty()).partition(|r| r.0.starts_with("push"));
    let calm = match calm.as_slice() {
        [first, .., last] => vec![*first, *last],
        few => few.to_vec(),
    };
    [calm, pushed]
}

#[derive(Default)]
struct Page {
    body: String,
    data: String,
    nav: Vec<(&'static str, &'static str)>,
}

/// JSON that may stand in a script element.
fn json(value: &impl serde::Serialize) -> String {
    serde_json::to_string(value).unwrap_or_else(|_| "[]".to_owned()).replace('<', "\\u003c")
}

impl Page {
    fn heading(&mut self, id: &'static str, title: &'static str) {
        self.nav.push((id, title));
        self.body.push_str(&format!("<h2 id=\"{id}\">{title}</h2>"));
    }

    fn overview(&mut self, runs: &[Run]) {
        self.heading("runs", "The runs");
        self.body.push_str(&facts::overview(runs));
        for run in runs {
            let remarks = facts::remarks(run);
            // Of many runs only those with something to say.
            let said = runs.len() <= MOST_BESIDE || remarks.contains("class=\"bad\"");
            if said && !remarks.is_empty() {
                self.body.push_str(&format!("<h3>{}</h3>{remarks}", escape(&run.name)));
            }
        }
        match runs_compared(runs) {
            Ok(figure) => self.figure(&figure, "all"),
            Err(_) => self.body.push_str("<p class=\"note\">No run has a measured iteration to compare yet.</p>"),
        }
    }

    fn figure(&mut self, figure: &Figure, scope: &str) {
        let id = format!("{scope}-{}", figure.stem);
        let svg = figure.inline_svg.replace(&format!("{}-clip", figure.stem), &format!("{id}-clip"));
        let points: Vec<(f64, f64, &str)> = figure
            .hover
            .iter()
            .map(|p| ((p.x * 10.0).round() / 10.0, (p.y * 10.0).round() / 10.0, p.text.as_str()))
            .collect();
        self.data
            .push_str(&format!("<script type=\"application/json\" id=\"hover-{id}\">{}</script>\n", json(&points)));
        self.body.push_str(&format!(
            "<figure id=\"{id}\" data-hover=\"hover-{id}\"><div class=\"plot\" tabindex=\"0\" role=\"group\" \
             aria-label=\"{title}: arrow keys step through the values, plus and minus zoom, 0 resets\">\
             <div class=\"scroll\">{svg}</div><div class=\"dot\"></div><div class=\"tip\" role=\"status\"></div>\
             <div class=\"tools\"><button class=\"in\" aria-label=\"Zoom in\">+</button>\
             <button class=\"out\" aria-label=\"Zoom out\">\u{2212}</button>\
             <button class=\"home\" aria-label=\"Whole figure\">1:1</button></div></div>\
             <figcaption>{caption}</figcaption></figure>\n",
            title = escape(&figure.title),
            caption = html::subscripts(&figure.caption)
        ));
    }

    fn section(&mut self, runs: &[Run], parts: &[Vec<Section>], s: usize) {
        let Some(head) = parts.first().and_then(|p| p.get(s)) else {
            return;
        };
        self.heading(head.id, head.title);
        // One row per figure, so that runs stand beside each other; stems in the order in which they come.
        let mut stems: Vec<&str> = Vec::new();
        for figure in parts.iter().filter_map(|p| p.get(s)).flat_map(|p| &p.figures) {
            if !stems.contains(&figure.stem.as_str()) {
                stems.push(&figure.stem);
            }
        }
        for stem in stems {
            let several = runs.len() > 1;
            if several {
                self.body.push_str("<div class=\"beside\">");
            }
            for (r, part) in parts.iter().enumerate() {
                let figure = part.get(s).and_then(|p| p.figures.iter().find(|f| f.stem == stem));
                if several {
                    self.body.push_str(&format!("<div><h3>{}</h3>", escape(&runs[r].name)));
                }
                match figure {
                    Some(figure) => self.figure(figure, &format!("r{r}")),
                    None if several => {
                        self.body.push_str("<p class=\"note\">This run has no data for this figure.</p>")
                    }
                    None => {}
                }
                if several {
                    self.body.push_str("</div>");
                }
            }
            if several {
                self.body.push_str("</div>");
            }
        }
        for (r, part) in parts.iter().enumerate() {
            let name = if runs.len() > 1 { format!("{}: ", runs[r].name) } else { String::new() };
            for note in part.get(s).map(|p| p.notes.as_slice()).unwrap_or_default() {
                self.body.push_str(&format!("<p class=\"note\">{}{}</p>", escape(&name), escape(note)));
            }
        }
        if head.id == "trust" {
            for run in runs {
                if runs.len() > 1 {
                    self.body.push_str(&format!("<h3>{}</h3>", escape(&run.name)));
                }
                self.body.push_str(&model::card(run));
            }
        }
    }

    fn replays(&mut self, runs: &[Run]) {
        self.heading("replay", "The robot moving");
        // Before and after beside each other; below them the same under pushes, if the run was pushed.
        let shown: Vec<[Vec<&(String, Recording)>; 2]> = runs.iter().map(shown).collect();
        let frames: usize = shown.iter().flatten().flatten().map(|r| r.1.frames.len()).sum();
        let budget = POSE_BUDGET / frames.max(1);
        for (r, (run, [calm, pushed])) in runs.iter().zip(&shown).enumerate() {
            if runs.len() > 1 {
                self.body.push_str(&format!("<h3>{}</h3>", escape(&run.name)));
            }
            if calm.is_empty() && pushed.is_empty() {
                self.body.push_str("<p class=\"note\">The run directory holds no recorded poses.</p>");
            }
            self.player(&format!("poses-{r}"), calm, budget);
            if !pushed.is_empty() {
                self.body.push_str("<h3>Under pushes</h3>");
                self.player(&format!("poses-{r}-push"), pushed, budget);
            }
        }
    }

    /// One player: up to two recordings beside each other. `budget` is in bytes a frame.
    fn player(&mut self, id: &str, recordings: &[&(String, Recording)], budget: usize) {
        if recordings.is_empty() {
            return;
        }
        let packed: Vec<_> = recordings.iter().map(|rec| replay::pack(&rec.1, budget * rec.1.frames.len())).collect();
        self.data.push_str(&format!("<script type=\"application/json\" id=\"{id}\">{}</script>\n", json(&packed)));
        self.body.push_str(&format!("<div class=\"replay\" data-poses=\"{id}\"><div class=\"views\">"));
        for rec in recordings {
            let name = facts::recording_name(&rec.0);
            self.body.push_str(&format!(
                "<div class=\"view\"><canvas tabindex=\"0\" role=\"img\" aria-label=\"Replay of the robot, {name}: {n} frames. \
                 Arrow keys turn the view, plus and minus zoom, space plays\"></canvas>\
                 <div class=\"name\">{name}</div><div class=\"hud\"></div></div>",
                name = escape(&name),
                n = rec.1.frames.len()
            ));
        }
        self.body.push_str(
            "</div><div class=\"bar\"><button class=\"play\">Play</button>\
             <input type=\"range\" min=\"0\" max=\"1\" step=\"0.01\" value=\"0\" aria-label=\"Time\"><output>0.00 s</output>\
             <label>Speed <select aria-label=\"Speed\"><option value=\"0.1\">0.1</option><option value=\"0.25\">0.25</option>\
             <option value=\"0.5\">0.5</option><option value=\"1\" selected>1</option><option value=\"2\">2</option></select></label>\
             <button class=\"reset\">Reset view</button></div>\
             <p class=\"legend\"><span class=\"sw\" style=\"background:var(--c2)\"></span>foot on the ground\
             <span class=\"sw\" style=\"background:var(--c1)\"></span>centre of pressure",
        );
        if recordings.iter().any(|r| r.1.frames.iter().any(|f| f.push_n.is_some())) {
            self.body.push_str("<span class=\"sw\" style=\"background:var(--c3)\"></span>push");
        }
        self.body.push_str(". Drag to turn, Ctrl and wheel to come closer. A step is counted at each section.");
        if packed.iter().any(|p| p.every > 1) {
            self.body.push_str(&format!(
                " To keep the page small, one frame in {} is kept.",
                packed.iter().map(|p| p.every).max().unwrap_or(1)
            ));
        }
        self.body.push_str("</p></div>");
    }

    fn made(&mut self, runs: &[Run]) {
        self.heading("made", "How was it made?");
        let beside = if runs.len() <= MOST_BESIDE { runs } else { &runs[..1] };
        if beside.len() < runs.len() {
            self.body.push_str(&format!("<p class=\"note\">Of the first of the {} runs.</p>", runs.len()));
        }
        for run in beside {
            if runs.len() > 1 {
                self.body.push_str(&format!("<h3>{}</h3>", escape(&run.name)));
            }
            self.body.push_str(&facts::provenance(run));
        }
        self.body.push_str(&facts::bibliography(runs));
    }

    fn finish(self, title: &str, lede: &str, many: bool) -> String {
        let (light, dark, rules) = page_variables();
        let (light, dark) = (format!("{light}--card:#f4f6f8;"), format!("{dark}--card:#1c2229;"));
        let font = |weight: u32, data: &[u8]| {
            format!(
                "@font-face{{font-family:Inter;font-weight:{weight};src:url(data:font/woff2;base64,{}) format(\"woff2\")}}",
                STANDARD.encode(data)
            )
        };
        let nav: String = self.nav.iter().map(|(id, title)| format!("<a href=\"#{id}\">{title}</a>")).collect();
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width,initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n<style>\n{regular}\n{bold}\n\
             :root{{{light}color-scheme:light}}\n\
             @media (prefers-color-scheme:dark){{:root:not([data-theme=light]){{{dark}color-scheme:dark}}}}\n\
             :root[data-theme=dark]{{{dark}color-scheme:dark}}\n\
             @media print{{:root,:root[data-theme],:root:not([data-theme=light]){{{light}color-scheme:light}}}}\n\
             {rules}\n{STYLE}</style>\n</head>\n<body{many}>\n<header class=\"top\"><p class=\"kicker\">Stridemap</p>\
             <h1>{title}</h1><p class=\"lede\">{lede}</p><nav aria-label=\"Sections\">{nav}<span class=\"space\"></span>\
             <button id=\"theme\" aria-label=\"Switch between light and dark\">Dark</button></nav></header>\n{body}\n\
             <footer><p>Font: Inter, \u{a9} The Inter Project Authors, SIL Open Font License 1.1. The figures stand as SVG, PNG and \
             CSV in the run directory under figures/.</p></footer>\n{data}\
             <script>\n{FIGURES}</script>\n<script>\n{REPLAY}</script>\n</body>\n</html>\n",
            title = escape(title),
            lede = escape(lede),
            many = if many { " class=\"many\"" } else { "" },
            regular = font(400, REGULAR),
            bold = font(600, SEMI_BOLD),
            body = self.body,
            data = self.data,
        )
    }
}
