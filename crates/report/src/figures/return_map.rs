//! Fig. 10 of the paper: the return map under pushes.

use super::check::{column, some};
use super::names::{label, quantity};
use super::paper::PSI;
use crate::draw::{Anchor, Axis, Dash, Key, Mark, Panel, Sheet, extent, signed};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::ReturnMapLine;

/// A pair of states two strides apart, the first being the section after a push.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ReturnPair {
    /// State at section k, degrees.
    pub psi_roll_deg: f64,
    /// State at section k + 2, degrees.
    pub psi_roll_after_2_deg: f64,
    /// The push before section k, newtons; `None` if there was none.
    pub force_n: Option<f64>,
}

/// Pairs and the line through them.
#[derive(Clone, Debug, PartialEq)]
pub struct ReturnMap {
    /// What was run: `nominal gait`, `learned policy`.
    pub name: String,
    /// The pairs, falls excluded.
    pub pairs: Vec<ReturnPair>,
    /// Slope of the least-squares line; `None` if there were too few pairs.
    pub slope: Option<f64>,
    /// Where the line meets the identity, degrees: intercept / (1 - slope).
    pub fixed_point_deg: Option<f64>,
    /// Falls under the pushes, which give no pair.
    pub falls: usize,
}

/// Return maps of one or more policies beside each other.
#[derive(Clone, Debug, PartialEq)]
pub struct Fig10 {
    /// In the order in which they stand, at most three.
    pub maps: Vec<ReturnMap>,
    /// The desired state, degrees, if the task has one.
    pub target_deg: Option<f64>,
    /// Greatest force of a push, newtons.
    pub force_n: Option<f64>,
    /// Duration of a push, seconds.
    pub duration_s: Option<f64>,
}

/// Draws Fig. 10: pairs, linear fit (dashed), identity, fixed point (circle), all panels on equal axes.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no map, no pair in any, or a value that is not finite.
pub fn fig10(data: &Fig10) -> Result<Figure> {
    pushed("fig10", 2, data)
}

/// The same as [`fig10`] one stride after the push: `psi_roll_after_2_deg` of each pair is read as the state
/// at section k + 1, and slope and fixed point as those of that map.
///
/// # Errors
///
/// As [`fig10`].
pub fn pushed_one_stride(data: &Fig10) -> Result<Figure> {
    pushed("push-1", 1, data)
}

fn pushed(stem: &str, lag: usize, data: &Fig10) -> Result<Figure> {
    some(stem, "pairs", data.maps.iter().map(|m| m.pairs.len()).sum())?;
    for map in &data.maps {
        let flat: Vec<f64> = map.pairs.iter().flat_map(|p| [p.psi_roll_deg, p.psi_roll_after_2_deg]).collect();
        column(stem, &map.name, &flat, 2 * map.pairs.len())?;
    }
    let values =
        || data.maps.iter().flat_map(|m| m.pairs.iter().flat_map(|p| [p.psi_roll_deg, p.psi_roll_after_2_deg]));
    let axis = |label: String| Axis::covering(&label, values());
    let panels = data
        .maps
        .iter()
        .map(|m| (1.0, axis(format!("{PSI}(k) (deg)")), axis(format!("{PSI}(k + {lag}) (deg)")), Some(m.name.as_str())))
        .collect();
    let title = match lag {
        1 => "Return map under pushes, one stride on",
        _ => "Return map under pushes",
    };
    let mut sheet = Sheet::new(stem, title);
    let height = if data.maps.len() > 2 { 200.0 } else { 285.0 };
    let drawn = sheet.row(height, panels);
    for (mut p, map) in drawn.into_iter().zip(&data.maps) {
        draw(&mut p, map, data.target_deg);
        sheet.add(p);
    }
    Ok(sheet.finish(&caption(data, lag), &alt(data, lag), csv(data, lag)))
}

fn draw(p: &mut Panel, map: &ReturnMap, target: Option<f64>) {
    p.line(&[(p.x.min, p.x.min), (p.x.max, p.x.max)], "ref", Dash::Solid, 1.1);
    if let Some(target) = target {
        p.upward(target, "ref", Dash::Dotted);
        p.across(target, "ref", Dash::Dotted);
        p.key("desired state", Key::Line("ref", Dash::Dotted));
    }
    let points: Vec<(f64, f64)> = map.pairs.iter().map(|q| (q.psi_roll_deg, q.psi_roll_after_2_deg)).collect();
    p.marks(&points, "s0", Mark::Dot, 4.2);
    for pair in &map.pairs {
        let force = pair.force_n.map_or_else(String::new, |f| format!(", push {} N", signed(f, 1)));
        p.hover(
            pair.psi_roll_deg,
            pair.psi_roll_after_2_deg,
            format!(
                "{}: {} to {} deg{force}",
                map.name,
                signed(pair.psi_roll_deg, 2),
                signed(pair.psi_roll_after_2_deg, 2)
            ),
        );
    }
    if let (Some(slope), Some(fixed)) = (map.slope, map.fixed_point_deg) {
        let at = |x: f64| fixed + slope * (x - fixed);
        p.line(&[(p.x.min, at(p.x.min)), (p.x.max, at(p.x.max))], "s1", Dash::Dashed, 2.2);
        p.marks(&[(fixed, fixed)], "s1", Mark::Circle, 6.0);
        p.hover(fixed, fixed, format!("{}: fixed point {} deg", map.name, signed(fixed, 2)));
        let (x, y) = (p.left + p.width - 6.0, p.top + p.height - 26.0);
        p.note_px(x, y, Anchor::End, "", &format!("slope {}", signed(slope, 2)));
        p.note_px(x, y + 16.0, Anchor::End, "", &format!("fixed point {}°", signed(fixed, 2)));
    }
    p.key("pairs", Key::Mark("s0", Mark::Dot));
    p.key("linear fit", Key::Line("s1", Dash::Dashed));
    p.key("fixed point", Key::Mark("s1", Mark::Circle));
    p.key("identity", Key::Line("ref", Dash::Solid));
}

fn caption(data: &Fig10, lag: usize) -> String {
    let push = match (data.force_n, data.duration_s) {
        (Some(force), Some(duration)) => {
            format!(" Lateral pushes, uniform within ±{} N, for {} s.", signed(force, 0), signed(duration, 1))
        }
        _ => String::new(),
    };
    let each: Vec<String> = data
        .maps
        .iter()
        .map(|m| {
            let line = match (m.slope, m.fixed_point_deg) {
                (Some(slope), Some(fixed)) => {
                    format!("slope {}, fixed point {} deg", signed(slope, 2), signed(fixed, 2))
                }
                _ => "too few pairs for a line".to_owned(),
            };
            let falls = match m.falls {
                0 => "no fall".to_owned(),
                1 => "1 fall".to_owned(),
                n => format!("{n} falls"),
            };
            format!("{}: {line} (n = {} pairs, {falls})", m.name, m.pairs.len())
        })
        .collect();
    let target =
        data.target_deg.map_or_else(String::new, |t| format!(" Dotted: the desired state, {} deg.", signed(t, 1)));
    let each = each.join("; ");
    let how = "Each point is one pair, without averaging; dashed: least squares; circle: where it meets the identity";
    if lag == 1 {
        return format!(
            "State at a section against the state one stride later, on the other leg, k being the first section after a \
             push.{push} {how}. {each}.{target}"
        );
    }
    format!(
        "Fig. 10 of the paper. State at a section against the state two strides later, k being the first section after a \
         push.{push} {how}. {each}.{target} The paper: \u{201c}coefficient much smaller than one\u{201d}, fixed point 2.3 deg \
         for a target of 2.0 deg."
    )
}

fn alt(data: &Fig10, lag: usize) -> String {
    let each: Vec<String> = data
        .maps
        .iter()
        .map(|m| match m.slope {
            Some(slope) => format!("{} with slope {}", m.name, signed(slope, 2)),
            None => m.name.clone(),
        })
        .collect();
    format!(
        "Scatter plots of psi_roll {} against psi_roll after a push: {}.",
        if lag == 1 { "one stride later" } else { "two strides later" },
        each.join("; ")
    )
}

fn csv(data: &Fig10, lag: usize) -> String {
    let mut csv = format!("map,psi_roll_deg,psi_roll_after_{lag}_deg,force_n\n");
    for map in &data.maps {
        for pair in &map.pairs {
            let force = pair.force_n.map_or_else(String::new, |f| f.to_string());
            csv.push_str(&format!(
                "{},{},{},{force}\n",
                map.name.replace(',', " "),
                pair.psi_roll_deg,
                pair.psi_roll_after_2_deg
            ));
        }
    }
    csv
}

/// Consecutive states of a gait that was not pushed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Undisturbed {
    /// What was run: `nominal gait`, `final policy`.
    pub name: String,
    /// Unbroken stretches of states at successive sections.
    pub stretches: Vec<Vec<f64>>,
    /// Lines through the pairs k to k + 1 and k to k + 2, where the run directory has them.
    pub lines: [Option<ReturnMapLine>; 2],
}

/// Return maps of gaits that were not pushed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct UndisturbedReturnMaps {
    /// Name of the state component, with its unit: `psi_roll_deg`.
    pub name: String,
    /// What was run, at most three.
    pub runs: Vec<Undisturbed>,
    /// The desired state, if the task has one.
    pub target: Option<f64>,
}

fn pairs(stretches: &[Vec<f64>], lag: usize) -> Vec<(f64, f64)> {
    stretches
        .iter()
        .flat_map(|s| s.iter().zip(s.iter().skip(lag)).map(|(a, b)| (*a, *b)))
        .filter(|(a, b)| a.is_finite() && b.is_finite())
        .collect()
}

/// Draws the return maps k to k + 1 and k to k + 2 without pushes: the pairs, their lines and fixed points,
/// and the identity.
///
/// # Errors
///
/// [`ReportError::Empty`](crate::ReportError::Empty) if no stretch has two states.
pub fn undisturbed_return_maps(data: &UndisturbedReturnMaps) -> Result<Figure> {
    let stem = "return-map";
    const CLASSES: [(&str, Mark, Dash); 3] =
        [("s1", Mark::Diamond, Dash::Dashed), ("s2", Mark::Disc, Dash::Solid), ("s0", Mark::Disc, Dash::Chain)];
    some(stem, "no two strides in a row", data.runs.iter().map(|r| pairs(&r.stretches, 1).len()).sum())?;
    let values = || data.runs.iter().flat_map(|r| r.stretches.iter().flatten().copied()).chain(data.target);
    let axis = |argument: &str| Axis::covering(&label(&data.name, argument), values());
    let mut sheet = Sheet::new(stem, "Return maps without pushes");
    let panels = sheet.row(
        285.0,
        vec![
            (1.0, axis("(k)"), axis("(k + 1)"), Some("One stride on")),
            (1.0, axis("(k)"), axis("(k + 2)"), Some("Two strides on")),
        ],
    );
    let mut csv = format!("run,lag,{0},next_{0}\n", data.name);
    let unit = quantity(&data.name).1;
    let mut said = Vec::new();
    for (lag, mut p) in panels.into_iter().enumerate().map(|(i, p)| (i + 1, p)) {
        p.line(&[(p.x.min, p.x.min), (p.x.max, p.x.max)], "ref", Dash::Solid, 1.1);
        if let Some(target) = data.target {
            p.upward(target, "ref", Dash::Dotted);
            p.across(target, "ref", Dash::Dotted);
            p.key("desired state", Key::Line("ref", Dash::Dotted));
        }
        for (run, (class, mark, dash)) in data.runs.iter().zip(CLASSES) {
            let points = pairs(&run.stretches, lag);
            let line = run.lines[lag - 1].and_then(|l| Some((l, l.fixed_point_deg?)));
            if let Some((line, fixed)) = line {
                let (lo, hi) = extent(points.iter().map(|q| q.0));
                let air = 0.05 * (hi - lo);
                let at = |x: f64| (x, fixed + line.slope * (x - fixed));
                p.line(&[at(lo - air), at(hi + air)], class, dash, 1.8);
            }
            p.marks(&points, class, mark, 3.2);
            for (a, b) in &points {
                p.hover(*a, *b, format!("{}: {} to {} after {lag}", run.name, signed(*a, 2), signed(*b, 2)));
                csv.push_str(&format!("{},{lag},{a},{b}\n", run.name.replace(',', " ")));
            }
            if let Some((line, fixed)) = line {
                p.marks(&[(fixed, fixed)], class, Mark::Circle, 6.0);
                p.hover(
                    fixed,
                    fixed,
                    format!(
                        "{}: fixed point {} {unit}, slope {} ± {}",
                        run.name,
                        signed(fixed, 2),
                        signed(line.slope, 2),
                        signed(line.slope_std_error, 2)
                    ),
                );
                p.key("fixed point", Key::Mark("s6", Mark::Circle));
            }
            p.key(&run.name, Key::Both(class, dash, mark));
            said.push(match line {
                Some((line, fixed)) => format!(
                    "{} to k + {lag}: slope {} ± {}, fixed point {} {unit} (n = {} pairs)",
                    run.name,
                    signed(line.slope, 2),
                    signed(line.slope_std_error, 2),
                    signed(fixed, 2),
                    points.len()
                ),
                None => format!("{} to k + {lag}: no line (n = {} pairs)", run.name, points.len()),
            });
        }
        p.key("identity", Key::Line("ref", Dash::Solid));
        sheet.add(p);
    }
    let said = said.join("; ");
    let caption = format!(
        "State at a section against the state one (left) and two (right) strides later, without pushes, deterministic policy, \
         strides run only to report, the start-up included; each point is one pair, without averaging. Lines: least squares, \
         slope ± its standard error; circles: where they meet the identity, the state to which the gait returns. {said}. A slope \
         within ±1 says that it does return; little spread, as in a gait that has settled, makes it uncertain."
    );
    let alt = format!("Return maps one and two strides on, without pushes. {said}.");
    Ok(sheet.finish(&caption, &alt, csv))
}
