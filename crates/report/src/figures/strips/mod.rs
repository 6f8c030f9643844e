//! Time-lapse strips: a robot at moments in equal steps, drawn from recorded poses, as in Figs. 11, 12 and
//! 15 to 18 of the paper.
//!
//! Every moment has a lane of its own, the same floor some seconds later; lanes lie behind one another and
//! to the right, so that time goes from left to right even where the robot stays:
//!
//! ```text
//!                     ╱     ╱  o      lane of 4 s: two metres from the start
//!                 ╱  o  ╱             lane of 2 s
//!             ╱o    ╱                 lane of 0 s: on the start line
//!           start  1 m
//! ```

mod outline;
mod picture;
mod silhouette;

use super::check::some;
use crate::draw::{Anchor, N, Sheet, number, signed, text_svg};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::{Recording, Run};

use picture::{Stage, picture};
pub use silhouette::View;
use silhouette::{Scene, Silhouette};

/// A robot walking, to be drawn as one strip.
#[derive(Clone, Debug, PartialEq)]
pub struct Strip {
    /// Which gait or policy, for the title: `walking: nominal gait`.
    pub name: String,
    /// Its speed as the run recorded it; `None` where it was not measured.
    pub speed_m_s: Option<f64>,
    /// What else to say in the caption, after the speed; may be empty.
    pub note: String,
    /// Its poses, from the start on.
    pub recording: Recording,
}

impl Strip {
    /// The time lapse of a measured policy of a run (`nominal`, `iteration-1`, ..., `final`) or of its
    /// `exploration`, with the speed that the run recorded.
    ///
    /// # Errors
    ///
    /// [`ReportError::Empty`](crate::ReportError::Empty) if the run holds no such time lapse.
    pub fn of_run(run: &Run, what: &str, name: &str, note: &str) -> Result<Strip> {
        let lapse = run.lapses.iter().find(|l| l.0 == what);
        let Some((_, recording)) = lapse else {
            return Err(crate::ReportError::Empty {
                figure: format!("strip of {}", run.dir.display()),
                what: format!("no lapse/{what}.json; runs made before there were strips lack it"),
            });
        };
        Ok(Strip {
            name: name.to_owned(),
            speed_m_s: run.speed_m_s(what),
            note: note.to_owned(),
            recording: recording.clone(),
        })
    }
}

/// A figure of strips below one another.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeLapse {
    /// File name without extension.
    pub stem: String,
    /// One line above the picture.
    pub title: String,
    /// How the caption begins: which figure of the paper it is and what that showed.
    pub lead: String,
    /// The strips, from above.
    pub strips: Vec<Strip>,
}

/// The camera that several figures share, and its shutter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Shot {
    /// From where.
    pub view: View,
    /// Time between moments, seconds.
    pub interval_s: f64,
    /// How many moments.
    pub moments: usize,
}

/// Room for the title of a strip, px.
const TITLE: f64 = 24.0;
/// Room for time and way above a head, px.
const ABOVE: f64 = 36.0;
/// Room for the scale below the floor, px.
const BELOW: f64 = 26.0;
/// Draws figures of strips with one camera and one scale for all of them.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if a figure has no strip, a strip no pose, or the shot
/// no moment.
pub fn time_lapses(figures: &[TimeLapse], shot: Shot) -> Result<Vec<Figure>> {
    let mut seen = Vec::new();
    for figure in figures {
        some(&figure.stem, "strips", figure.strips.len())?;
        some(&figure.stem, "moments", shot.moments)?;
        let mut rows = Vec::new();
        for strip in &figure.strips {
            let scene = Scene::new(&strip.recording, shot.view);
            let row: Vec<Silhouette> = scene.map_or_else(Vec::new, |scene| {
                (0..shot.moments).map_while(|i| scene.at(i as f64 * shot.interval_s)).collect()
            });
            some(&figure.stem, &format!("recorded poses of {}", strip.name), row.len())?;
            rows.push(row);
        }
        seen.push(rows);
    }
    let everything: Vec<Vec<Silhouette>> = seen.iter().flatten().cloned().collect();
    let stage = Stage::fitting(&everything, shot, Sheet::FREE_WIDTH);
    Ok(figures.iter().zip(&seen).map(|(figure, rows)| draw(figure, rows, &stage, shot)).collect())
}

/// `(a) `, or nothing where there is only one strip.
fn letter(index: usize, of: usize) -> String {
    if of < 2 {
        return String::new();
    }
    let letter = char::from(b'a' + u8::try_from(index % 26).unwrap_or(0));
    format!("({letter}) ")
}

fn draw(figure: &TimeLapse, rows: &[Vec<Silhouette>], stage: &Stage, shot: Shot) -> Figure {
    let mut sheet = Sheet::new(&figure.stem, &figure.title);
    let mut csv = String::from("strip,time_s,way_ahead_m,way_left_m,piece,side,ahead_m,left_m,up_m\n");
    let mut said = Vec::new();
    for (index, (strip, row)) in figure.strips.iter().zip(rows).enumerate() {
        let head = letter(index, figure.strips.len());
        let height = TITLE + ABOVE + stage.rise_px() + BELOW;
        let [left, top] = sheet.free(height);
        let floor = top + height - BELOW;
        let (svg, hover) = picture(strip, row, stage, shot.view, [left, floor]);
        let speed = strip.speed_m_s.map(|v| format!("{:.3} m/s", N(v))).unwrap_or_default();
        let (y, name) = (top + 15.0, format!("{head}{}", strip.name));
        let title = text_svg("pnl", left, y, 13.0, Anchor::Start, &name);
        let speed = text_svg("pnl", left + Sheet::FREE_WIDTH, y, 13.0, Anchor::End, &speed);
        sheet.draw(&(title + &speed + &svg), hover);
        said.push(caption_of(&head, strip, row, shot.view));
        for silhouette in row {
            for piece in &silhouette.pieces {
                let [ahead, left, up] = piece.centre_m;
                csv.push_str(&format!(
                    "{},{},{},{},{},{},{ahead},{left},{up}\n",
                    strip.name.replace(',', ";"),
                    silhouette.time_s,
                    silhouette.way_m[0],
                    silhouette.way_m[1],
                    piece.name.replace(',', ";"),
                    piece.tone.name(),
                ));
            }
        }
    }
    let legend = match shot.view {
        View::Side => format!(
            "The thick line is the starting position, thin lines are {} m apart, a bar on the floor is the way from the start; \
             the right leg, nearer to the camera, has the stronger tone.",
            number(stage.ruler_m(), 2)
        ),
        View::Front => "Seen from ahead: the right leg, on the left of the picture, has the stronger tone; the thick line is where the middle \
             of the torso is at first, a bar on the floor how far it is from there."
            .to_owned(),
    };
    let caption = format!(
        "{} {} Time proceeds from left to right, {} s from one moment to the next: each lane is the same floor, later. \
         {legend} Drawn from recorded poses.",
        figure.lead,
        said.join(" "),
        number(shot.interval_s, 3),
    );
    let alt = format!(
        "Time-lapse drawing of a walking robot: {}",
        figure
            .strips
            .iter()
            .zip(rows)
            .map(|(strip, row)| {
                let way = row.last().map_or(0.0, |s| s.way_m[0]);
                format!("{}, {} m from the start at the end. ", strip.name, signed(way, 2))
            })
            .collect::<String>()
            .trim_end()
    );
    sheet.finish(&caption, &alt, csv)
}

/// What the caption says of a strip.
fn caption_of(head: &str, strip: &Strip, row: &[Silhouette], view: View) -> String {
    let mut text = format!("{head}{}", strip.name);
    if let Some(speed) = strip.speed_m_s {
        text.push_str(&format!(": {} m/s", signed(speed, 3)));
    }
    if !strip.note.is_empty() {
        text.push_str(if strip.speed_m_s.is_some() { ", " } else { ": " });
        text.push_str(&strip.note);
    }
    if let (Some(last), View::Side) = (row.last(), view) {
        text.push_str(&format!("; {} m ahead after {} s", signed(last.way_m[0], 2), number(last.time_s, 3)));
    }
    text + "."
}

#[cfg(test)]
mod tests {
    use super::*;
    use stridemap_record::Frame;
    use stridemap_robot::{Pose, Shape, ShapeKind};

    /// A post of 1 m on a foot that walks at 0.5 m/s (or stands).
    fn walking(speed_m_s: f64) -> Recording {
        let shape = |name: &str, half_extents_m: [f64; 3], z: f64| Shape {
            name: name.into(),
            body: 0,
            kind: ShapeKind::Box { half_extents_m },
            pose: Pose { position_m: [0.0, 0.0, z], orientation: [1.0, 0.0, 0.0, 0.0] },
            rgba: [1.0; 4],
        };
        Recording {
            format: 1,
            shapes: vec![shape("post", [0.05, 0.1, 0.45], 0.55), shape("foot", [0.1, 0.05, 0.01], 0.01)],
            period_s: 0.5,
            frames: (0..=20)
                .map(|i| Frame {
                    time_s: 0.5 * f64::from(i),
                    poses: vec![[speed_m_s * 0.5 * f64::from(i), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]],
                    ..Frame::default()
                })
                .collect(),
        }
    }

    fn lapse(stem: &str, name: &str, speed_m_s: f64) -> TimeLapse {
        TimeLapse {
            stem: stem.into(),
            title: "A post".into(),
            lead: "Lead.".into(),
            strips: vec![Strip {
                name: name.into(),
                speed_m_s: Some(speed_m_s),
                note: String::new(),
                recording: walking(speed_m_s),
            }],
        }
    }

    const SHOT: Shot = Shot { view: View::Side, interval_s: 2.0, moments: 4 };

    /// First pixel of each outline of one tone, in the order drawn.
    fn corners(figure: &Figure) -> Vec<[f64; 2]> {
        let outlines = figure.svg.split("<path class=\"trunk sbg\"").skip(1);
        outlines
            .map(|o| {
                let d = o.split(" d=\"M").nth(1).unwrap();
                let mut numbers = d.split(['L', ' ']);
                let mut next = || numbers.next().unwrap().parse::<f64>().unwrap();
                [next(), next()]
            })
            .collect()
    }

    #[test]
    fn silhouettes_are_as_far_apart_as_was_recorded_and_both_figures_share_the_scale() {
        let figures = time_lapses(&[lapse("a", "still", 0.0), lapse("b", "going", 0.5)], SHOT);
        let figures = figures.unwrap();
        let (still, going) = (corners(&figures[0]), corners(&figures[1]));
        // Two pieces a moment; the last moment comes first.
        assert_eq!((still.len(), going.len()), (8, 8));
        let scale = {
            // The floor reaches 0.05 m of air (6 % of 1 m) beyond the leftmost and rightmost outlines,
            // and each of four lanes is 0.95 of 0.2 m to the right of the one before.
            let reach = (3.1 + 0.1) + 2.0 * 0.06 + 4.0 * 0.95 * 0.2;
            Sheet::FREE_WIDTH / reach
        };
        for lane in 0..4 {
            let at = |corners: &[[f64; 2]]| corners[2 * (3 - lane)];
            let (a, b) = (at(&still), at(&going));
            let way_m = 0.5 * 2.0 * lane as f64;
            assert!((b[0] - a[0] - scale * way_m).abs() < 0.02, "lane {lane}: {a:?} {b:?}");
            assert!((a[1] - b[1]).abs() < 0.02, "same floor");
        }
    }

    #[test]
    fn the_caption_has_the_recorded_speed_and_the_table_the_poses() {
        let figure = time_lapses(&[lapse("a", "going", 0.5)], SHOT).unwrap().remove(0);
        assert!(figure.caption.contains("going: 0.500 m/s; 3.00 m ahead after 6 s."), "{}", figure.caption);
        assert!(figure.svg.contains(">0.500 m/s<") && figure.svg.contains(">start<"));
        assert_eq!(figure.csv.lines().count(), 1 + 4 * 2);
        assert!(figure.csv.contains("\ngoing,4,2,0,foot,middle,2,0,0.01\n"));
        assert_eq!(figure.hover.len(), 4);
    }

    #[test]
    fn a_recording_that_ends_early_is_drawn_as_far_as_it_goes_and_an_empty_one_is_an_error() {
        let mut early = lapse("a", "going", 0.5);
        early.strips[0].recording.frames.truncate(6);
        let figure = time_lapses(&[early], SHOT).unwrap().remove(0);
        assert!(figure.caption.contains("1.00 m ahead after 2 s."));
        let mut none = lapse("a", "going", 0.5);
        none.strips[0].recording.frames.clear();
        let error = time_lapses(&[none], SHOT).unwrap_err().to_string();
        assert!(error.contains("recorded poses of going"), "{error}");
    }
}
