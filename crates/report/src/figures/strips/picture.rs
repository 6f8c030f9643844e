//! One strip: floor, lanes, start and robots as SVG.

use super::silhouette::{Silhouette, Tone, View};
use super::{Shot, Strip};
use crate::draw::{Anchor, N, Sheet, coord, number, path_data, text_svg, width};
use crate::figure::HoverPoint;

/// Size of small text, px.
const SMALL: f64 = 11.0;

/// Where lanes and metres lie in the picture, the same in every strip of every figure of a shot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stage {
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
    pub(super) fn fitting(all: &[Vec<Silhouette>], shot: Shot, width: f64) -> Self {
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
    pub(super) fn rise_px(&self) -> f64 {
        self.up_px(self.height_m, self.moments as f64 - 1.0)
    }

    /// Distance between the lines on the floor: as many metres as leave them 45 px apart or more.
    pub(super) fn ruler_m(&self) -> f64 {
        [0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0].into_iter().find(|m| m * self.scale >= 45.0).unwrap_or(10.0)
    }
}

/// A strip whose floor's front left corner is at a pixel.
pub(super) fn picture(
    strip: &Strip,
    row: &[Silhouette],
    stage: &Stage,
    view: View,
    [left, floor]: [f64; 2],
) -> (String, Vec<HoverPoint>) {
    let x = |along_m: f64, lane: f64| left + stage.right_px(along_m, lane);
    let y = |up_m: f64, lane: f64| floor - stage.up_px(up_m, lane);
    let (front, back) = (-0.5, stage.moments as f64 - 0.5);
    let end = |along_m: f64, lane: f64| [x(along_m, lane), y(0.0, lane)];
    let across = |along_m: f64| path_data([end(along_m, front), end(along_m, back)]);
    let floor_of = [(stage.near_m, front), (stage.near_m, back), (stage.far_m, back), (stage.far_m, front)];
    let mut svg = format!("<path class=\"floor\" d=\"{}Z\"/>", path_data(floor_of.map(|(m, lane)| end(m, lane))));
    // The ruler, and the start.
    let step = stage.ruler_m();
    let first = (stage.near_m / step).ceil() as i64;
    let last = (stage.far_m / step).floor() as i64;
    let mut ruler = String::new();
    for i in (first..=last).filter(|i| *i != 0) {
        let along = i as f64 * step;
        ruler.push_str(&across(along));
        svg.push_str(&text(x(along, front), floor + 14.0, Anchor::Middle, "mut", &format!("{} m", number(along, 3))));
    }
    svg.push_str(&format!("<path class=\"l axis\" stroke-width=\"0.8\" stroke-opacity=\"0.55\" d=\"{ruler}\"/>"));
    for lane in 0..stage.moments {
        let lane = lane as f64;
        svg.push_str(&format!(
            "<path class=\"l axis\" stroke-width=\"0.6\" stroke-opacity=\"0.35\" d=\"M{} {}H{}\"/>",
            coord(x(stage.near_m, lane)),
            coord(y(0.0, lane)),
            coord(x(stage.far_m, lane))
        ));
    }
    svg.push_str(&format!("<path class=\"l s1\" stroke-width=\"4\" d=\"{}\"/>", across(0.0)));
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
        svg += &format!(
            "<path class=\"l s1\" stroke-width=\"2\" stroke-opacity=\"0.6\" d=\"M{} {}H{}\"/>",
            coord(x(0.0, lane)),
            coord(y(0.0, lane)),
            coord(x(along, lane))
        );
        svg += &robot(silhouette, &|u| x(u, lane), &|v| y(v, lane));
        let (middle, over) = (x(along, lane), y(silhouette.extent_m(1)[1], lane));
        let (name, [ahead, left]) = (&strip.name, silhouette.way_m.map(N));
        let time = format!("{:#.3} s", N(silhouette.time_s));
        if view == View::Side {
            svg += &text(middle, over - 20.0, Anchor::Middle, "pnl", &time);
            svg += &text(middle, over - 7.0, Anchor::Middle, "mut", &format!("{ahead:.2} m"));
        } else {
            svg += &text(middle, over - 7.0, Anchor::Middle, "pnl", &time);
        }
        hover.push(HoverPoint {
            x: middle,
            y: y(0.5 * stage.height_m, lane),
            text: format!("{name}, {time}: {ahead:.2} m ahead, {left:.2} m to the left"),
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
    text_svg(class, x, y, SMALL, anchor, text)
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
        let d = path_data(piece.outline_m.iter().map(|p| [x(p[0]), y(p[1])]));
        svg.push_str(&format!(
            "<path class=\"{class} sbg\" stroke-width=\"0.7\" stroke-linejoin=\"round\" d=\"{d}Z\"/>"
        ));
    }
    svg
}
