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

mod silhouette;
mod solid;

use super::check::some;
use crate::draw::{Anchor, Sheet, coord, number, signed, spans, width};
use crate::error::Result;
use crate::figure::{Figure, HoverPoint};
use crate::run::{Recording, Run};

pub use silhouette::View;
use silhouette::{Scene, Silhouette, Tone};
pub use solid::{Solid, solids};

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
/// Size of small text, px.
const SMALL: f64 = 11.0;

/// Where lanes and metres lie in the picture, the same in every strip of every figure of a shot.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Stage {
    /// Pixels to a metre.
    scale: f64,
    /// Left edge of the floor, metres along it.
    near_m: f64,
    /// Right edge.
    far_m: f64,
    /// Height of the highest head.
    height_m: f64,
    /// From one lane to the next: to the right, upward.
    lane_m: [f64; 2],
    moments: usize,
}

impl Stage {
    /// The largest scale at which everything of all strips is inside of `width` pixels.
    fn fitting(all: &[Vec<Silhouette>], shot: Shot, width: f64) -> Self {
        let [mut near_m, mut far_m, mut height_m, mut broad_m] = [0.0_f64; 4];
        for silhouette in all.iter().flatten() {
            let [left, right] = silhouette.extent_m(0);
            near_m = near_m.min(left);
            far_m = far_m.max(right);
            height_m = height_m.max(silhouette.extent_m(1)[1]);
            let along = silhouette.along_m(shot.view);
            broad_m = broad_m.max(2.0 * (right - along).max(along - left));
        }
        let air = 0.06 * height_m;
        let lane_m = [0.95 * broad_m, 0.075 * height_m];
        let reach_m = far_m - near_m + 2.0 * air + shot.moments as f64 * lane_m[0];
        Self {
            scale: width / reach_m.max(1e-6),
            near_m: near_m - air,
            far_m: far_m + air,
            height_m,
            lane_m,
            moments: shot.moments,
        }
    }

    /// Pixels from the left edge: a place along the floor in a lane.
    fn right_px(&self, along_m: f64, lane: f64) -> f64 {
        self.scale * (along_m - self.near_m + self.lane_m[0] * (lane + 0.5))
    }

    /// Pixels above the front edge of the floor: a height in a lane.
    fn up_px(&self, up_m: f64, lane: f64) -> f64 {
        self.scale * (up_m + self.lane_m[1] * (lane + 0.5))
    }

    /// Height of the picture from the front edge of the floor to the highest head.
    fn rise_px(&self) -> f64 {
        self.up_px(self.height_m, self.moments as f64 - 1.0)
    }

    /// Distance between the lines on the floor: as many metres as leave them 45 px apart or more.
    fn ruler_m(&self) -> f64 {
        [0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0]
            .into_iter()
            .find(|m| m * self.scale >= 45.0)
            .unwrap_or(10.0)
    }
}

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
                (0..shot.moments)
                    .map_while(|i| scene.at(i as f64 * shot.interval_s))
                    .collect()
            });
            some(
                &figure.stem,
                &format!("recorded poses of {}", strip.name),
                row.len(),
            )?;
            rows.push(row);
        }
        seen.push(rows);
    }
    let everything: Vec<Vec<Silhouette>> = seen.iter().flatten().cloned().collect();
    let stage = Stage::fitting(&everything, shot, Sheet::FREE_WIDTH);
    Ok(figures
        .iter()
        .zip(&seen)
        .map(|(figure, rows)| draw(figure, rows, &stage, shot))
        .collect())
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
    let mut csv =
        String::from("strip,time_s,way_ahead_m,way_left_m,piece,side,ahead_m,left_m,up_m\n");
    let mut said = Vec::new();
    for (index, (strip, row)) in figure.strips.iter().zip(rows).enumerate() {
        let head = letter(index, figure.strips.len());
        let height = TITLE + ABOVE + stage.rise_px() + BELOW;
        let [left, top] = sheet.free(height);
        let floor = top + height - BELOW;
        let (svg, hover) = picture(strip, row, stage, shot.view, [left, floor]);
        let title = spans(&format!("{head}{}", strip.name), 13.0);
        let speed = strip
            .speed_m_s
            .map(|v| format!("{} m/s", signed(v, 3)))
            .unwrap_or_default();
        sheet.draw(
            &format!(
                "<text class=\"pnl\" x=\"{0}\" y=\"{1}\" font-size=\"13\">{title}</text>\
                 <text class=\"pnl\" x=\"{2}\" y=\"{1}\" font-size=\"13\" text-anchor=\"end\">{speed}</text>{svg}",
                coord(left),
                coord(top + 15.0),
                coord(left + Sheet::FREE_WIDTH),
            ),
            hover,
        );
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
                format!(
                    "{}, {} m from the start at the end. ",
                    strip.name,
                    signed(way, 2)
                )
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
        text.push_str(if strip.speed_m_s.is_some() {
            ", "
        } else {
            ": "
        });
        text.push_str(&strip.note);
    }
    if let (Some(last), View::Side) = (row.last(), view) {
        text.push_str(&format!(
            "; {} m ahead after {} s",
            signed(last.way_m[0], 2),
            number(last.time_s, 3)
        ));
    }
    text + "."
}

/// A strip whose floor's front left corner is at a pixel.
fn picture(
    strip: &Strip,
    row: &[Silhouette],
    stage: &Stage,
    view: View,
    [left, floor]: [f64; 2],
) -> (String, Vec<HoverPoint>) {
    let x = |along_m: f64, lane: f64| left + stage.right_px(along_m, lane);
    let y = |up_m: f64, lane: f64| floor - stage.up_px(up_m, lane);
    let (front, back) = (-0.5, stage.moments as f64 - 0.5);
    let across = |along_m: f64| {
        format!(
            "M{} {}L{} {}",
            coord(x(along_m, front)),
            coord(y(0.0, front)),
            coord(x(along_m, back)),
            coord(y(0.0, back))
        )
    };
    let mut svg = format!(
        "<path class=\"floor\" d=\"{}L{} {}L{} {}Z\"/>",
        across(stage.near_m),
        coord(x(stage.far_m, back)),
        coord(y(0.0, back)),
        coord(x(stage.far_m, front)),
        coord(y(0.0, front))
    );
    // The ruler, and the start.
    let step = stage.ruler_m();
    let first = (stage.near_m / step).ceil() as i64;
    let last = (stage.far_m / step).floor() as i64;
    let mut ruler = String::new();
    for i in (first..=last).filter(|i| *i != 0) {
        let along = i as f64 * step;
        ruler.push_str(&across(along));
        svg.push_str(&text(
            x(along, front),
            floor + 14.0,
            Anchor::Middle,
            "mut",
            &format!("{} m", number(along, 3)),
        ));
    }
    svg.push_str(&format!(
        "<path class=\"l axis\" stroke-width=\"0.8\" stroke-opacity=\"0.55\" d=\"{ruler}\"/>"
    ));
    for lane in 0..stage.moments {
        let lane = lane as f64;
        svg.push_str(&format!(
            "<path class=\"l axis\" stroke-width=\"0.6\" stroke-opacity=\"0.35\" d=\"M{} {}H{}\"/>",
            coord(x(stage.near_m, lane)),
            coord(y(0.0, lane)),
            coord(x(stage.far_m, lane))
        ));
    }
    svg.push_str(&format!(
        "<path class=\"l s1\" stroke-width=\"4\" d=\"{}\"/>",
        across(0.0)
    ));
    svg.push_str(&text(
        x(0.0, front),
        floor + 14.0,
        Anchor::Middle,
        "pnl",
        match view {
            View::Side => "start",
            View::Front => "middle",
        },
    ));
    // The last moment is the farthest lane: drawn first.
    let mut hover = Vec::new();
    for (i, silhouette) in row.iter().enumerate().rev() {
        let lane = i as f64;
        let along = silhouette.along_m(view);
        svg.push_str(&format!(
            "<path class=\"l s1\" stroke-width=\"2\" stroke-opacity=\"0.6\" d=\"M{} {}H{}\"/>",
            coord(x(0.0, lane)),
            coord(y(0.0, lane)),
            coord(x(along, lane))
        ));
        svg.push_str(&robot(silhouette, &|u| x(u, lane), &|v| y(v, lane)));
        let over = y(silhouette.extent_m(1)[1], lane);
        let middle = x(along, lane);
        let time = format!("{} s", number(silhouette.time_s, 3));
        if view == View::Side {
            svg.push_str(&text(middle, over - 20.0, Anchor::Middle, "pnl", &time));
            let way = format!("{} m", signed(silhouette.way_m[0], 2));
            svg.push_str(&text(middle, over - 7.0, Anchor::Middle, "mut", &way));
        } else {
            svg.push_str(&text(middle, over - 7.0, Anchor::Middle, "pnl", &time));
        }
        hover.push(HoverPoint {
            x: middle,
            y: y(0.5 * stage.height_m, lane),
            text: format!(
                "{}, {time}: {} m ahead, {} m to the left",
                strip.name,
                signed(silhouette.way_m[0], 2),
                signed(silhouette.way_m[1], 2)
            ),
        });
    }
    hover.reverse();
    (svg, hover)
}

fn text(x: f64, y: f64, anchor: Anchor, class: &str, text: &str) -> String {
    // `width` keeps a label inside of the sheet.
    let half = 0.5 * width(text, SMALL, false);
    let x = match anchor {
        Anchor::Middle => x.clamp(Sheet::LEFT + half, Sheet::LEFT + Sheet::FREE_WIDTH - half),
        _ => x,
    };
    format!(
        "<text class=\"{class}\" x=\"{}\" y=\"{}\" font-size=\"{SMALL}\" text-anchor=\"{}\">{}</text>",
        coord(x),
        coord(y),
        anchor.name(),
        spans(text, SMALL)
    )
}

/// A robot, its pieces from the far side to the near one, above a soft shadow.
fn robot(seen: &Silhouette, x: &dyn Fn(f64) -> f64, y: &dyn Fn(f64) -> f64) -> String {
    let [left, right] = seen.standing_m();
    let half = 0.5 * (x(right) - x(left));
    let mut svg = if half > 0.0 {
        format!(
            "<ellipse class=\"shade\" cx=\"{}\" cy=\"{}\" rx=\"{}\" ry=\"{}\"/>",
            coord(x(0.5 * (left + right))),
            coord(y(0.0)),
            coord(1.15 * half),
            coord(0.17 * half)
        )
    } else {
        String::new() // In the air, or falling.
    };
    for piece in &seen.pieces {
        let class = match piece.tone {
            Tone::Far => "far",
            Tone::Middle => "trunk",
            Tone::Near => "near",
        };
        let points = piece.outline_m.iter().enumerate();
        let d: String = points
            .map(|(i, p)| {
                let pen = if i == 0 { 'M' } else { 'L' };
                format!("{pen}{} {}", coord(x(p[0])), coord(y(p[1])))
            })
            .collect();
        svg.push_str(&format!(
            "<path class=\"{class} sbg\" stroke-width=\"0.7\" stroke-linejoin=\"round\" d=\"{d}Z\"/>"
        ));
    }
    svg
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::{Frame, Pose, Shape, ShapeKind};

    /// A post of 1 m on a foot that walks at 0.5 m/s (or stands).
    fn walking(speed_m_s: f64) -> Recording {
        let shape = |name: &str, half_extents_m: [f64; 3], z: f64| Shape {
            name: name.into(),
            body: 0,
            kind: ShapeKind::Box { half_extents_m },
            pose: Pose {
                position_m: [0.0, 0.0, z],
                orientation: [1.0, 0.0, 0.0, 0.0],
            },
            rgba: [1.0; 4],
        };
        Recording {
            format: 1,
            shapes: vec![
                shape("post", [0.05, 0.1, 0.45], 0.55),
                shape("foot", [0.1, 0.05, 0.01], 0.01),
            ],
            period_s: 0.5,
            frames: (0..=20)
                .map(|i| Frame {
                    time_s: 0.5 * f64::from(i),
                    poses: vec![[speed_m_s * 0.5 * f64::from(i), 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]],
                    cop_m: None,
                    loads_n: [0.0; 2],
                    crossing: false,
                    push_n: None,
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

    const SHOT: Shot = Shot {
        view: View::Side,
        interval_s: 2.0,
        moments: 4,
    };

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
            assert!(
                (b[0] - a[0] - scale * way_m).abs() < 0.02,
                "lane {lane}: {a:?} {b:?}"
            );
            assert!((a[1] - b[1]).abs() < 0.02, "same floor");
        }
    }

    #[test]
    fn the_caption_has_the_recorded_speed_and_the_table_the_poses() {
        let figure = time_lapses(&[lapse("a", "going", 0.5)], SHOT)
            .unwrap()
            .remove(0);
        assert!(
            figure
                .caption
                .contains("going: 0.500 m/s; 3.00 m ahead after 6 s."),
            "{}",
            figure.caption
        );
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
