//! Where a robot went on the floor, beside where it was told to go.

use super::check::some;
use super::of_run::recorded;
use crate::draw::{Axis, Dash, Key, Mark, N, Sheet};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_process::StrideEnd;
use stridemap_record::{Run, Transition};

/// Height of a panel over its width, as it is where there are two: metres are as long along both axes.
const ASPECT: f64 = 1.0;

/// A way on the floor: places at the strides' ends, from the origin along +x, and where the robot fell.
#[derive(Default)]
struct Way {
    places: Vec<(f64, f64)>,
    falls: Vec<(f64, f64)>,
}

impl Way {
    /// Sums speeds forward and to the left (m/s) and yaw rates (rad/s) over the strides' times, half of the turn before the way.
    fn of(strides: &[&Transition], speeds: impl Fn(&Transition) -> [f64; 3]) -> Self {
        let (mut x, mut y, mut heading) = (0.0, 0.0, 0.0_f64);
        let mut way = Self { places: vec![(x, y)], falls: Vec::new() };
        for stride in strides {
            let [forward, left, yaw] = speeds(stride).map(|rate| rate * stride.measures.duration_s);
            let (sin, cos) = (heading + 0.5 * yaw).sin_cos();
            x += cos * forward - sin * left;
            y += sin * forward + cos * left;
            heading += yaw;
            way.places.push((x, y));
            if stride.end == StrideEnd::Fell {
                way.falls.push((x, y));
            }
        }
        way
    }

    fn length_m(&self) -> f64 {
        self.places.windows(2).map(|p| (p[1].0 - p[0].0).hypot(p[1].1 - p[0].1)).sum()
    }
}

/// Draws the way of the nominal gait and of the final policy on the floor, and the way that their goals would have made.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if the goals hold no speed, or no stride of either was recorded.
pub fn path(run: &Run) -> Result<Figure> {
    let stem = "path";
    let place = |name: &str| run.columns.goal.iter().position(|goal| goal == name);
    let goals = ["forward_speed_m_s", "lateral_speed_m_s", "yaw_rate_rad_s"].map(place);
    some(stem, "the goals hold no speed", goals.iter().flatten().count())?;
    let told = |t: &Transition| goals.map(|at| at.and_then(|at| t.goal.get(at)).copied().unwrap_or(0.0));
    let walked = |t: &Transition| {
        let m = &t.measures.true_motion;
        [m.forward_speed_m_s, m.lateral_speed_m_s, m.yaw_rate_rad_s]
    };
    let policies: Vec<(&str, Vec<&Transition>)> = [("nominal", "nominal"), ("learned", "final")]
        .into_iter()
        .map(|(name, what)| (name, recorded(run, what)))
        .filter(|(_, strides)| !strides.is_empty())
        .collect();
    some(stem, "no stride of the nominal gait or the final policy was recorded", policies.len())?;
    let ways: Vec<(&str, Way, Way)> =
        policies.iter().map(|(name, strides)| (*name, Way::of(strides, told), Way::of(strides, walked))).collect();
    let mut sheet = Sheet::new(stem, "Where it went, and where it was told to go");
    let all = || ways.iter().flat_map(|(_, told, walked)| told.places.iter().chain(&walked.places));
    let middle = |of: &dyn Fn(&(f64, f64)) -> f64| {
        let (low, high) = all().map(of).fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(v), high.max(v)));
        (0.5 * (low + high), 0.5 * (high - low))
    };
    let ((x, half_x), (y, half_y)) = (middle(&|p| p.0), middle(&|p| p.1));
    let half = 1.06 * half_x.max(half_y / ASPECT).max(0.5);
    let axes = |name| {
        let along = |label: &str, at: f64, half: f64| Axis::linear_with(label, at - half, at + half, 5.0);
        (1.0, along("x (m)", x, half), along("y (m)", y, half * ASPECT), Some(name))
    };
    let panels = sheet.row(300.0, ways.iter().map(|(name, ..)| axes(*name)).collect());
    let mut csv = String::from("policy,stride,told_x_m,told_y_m,walked_x_m,walked_y_m\n");
    let mut said = Vec::new();
    for ((name, told, walked), mut panel) in ways.iter().zip(panels) {
        panel.line(&told.places, "ref", Dash::Dashed, 1.6);
        panel.line(&walked.places, "s0", Dash::Solid, 1.8);
        panel.marks(&walked.falls, "s1", Mark::Cross, 5.0);
        panel.key("told", Key::Line("ref", Dash::Dashed));
        panel.key("walked", Key::Line("s0", Dash::Solid));
        if !walked.falls.is_empty() {
            panel.key("fall", Key::Mark("s1", Mark::Cross));
        }
        for (k, (a, b)) in told.places.iter().zip(&walked.places).enumerate() {
            let [tx, ty, wx, wy] = [a.0, a.1, b.0, b.1].map(N);
            panel.hover(b.0, b.1, format!("{name}, stride {k}: at ({wx:.2}, {wy:.2}) m, told ({tx:.2}, {ty:.2}) m"));
            csv += &format!("{name},{k},{},{},{},{}\n", a.0, a.1, b.0, b.1);
        }
        sheet.add(panel);
        if let (Some(a), Some(b)) = (told.places.last(), walked.places.last()) {
            let off = (a.0 - b.0).hypot(a.1 - b.1);
            let strides = walked.places.len() - 1;
            said.push(format!("{name}: {off:.1} m off after {:.1} m told, {strides} strides", told.length_m()));
        }
    }
    let caption = format!(
        "Solid: the base by the simulator's truth (or what the robot measures, where nobody knows better). Dashed: the goals of the same \
         strides, summed. {}. The goals of both are drawn by the same rule.",
        said.join("; ")
    );
    let alt = format!("Ways on the floor, walked beside told. {}.", said.join("; "));
    Ok(sheet.finish(&caption, &alt, csv))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four strides of a metre, each with a quarter turn, close a square's round; a way without turns is straight.
    #[test]
    fn ways_are_summed_over_strides() {
        let mut stride = Transition::default();
        stride.measures.duration_s = 2.0;
        let strides = [&stride; 4];
        let quarter = std::f64::consts::FRAC_PI_4;
        let round = Way::of(&strides, |_| [0.5, 0.0, quarter]);
        let (x, y) = *round.places.last().unwrap();
        assert!(x.abs() < 1e-12 && y.abs() < 1e-12 && (round.length_m() - 4.0).abs() < 1e-12);
        let straight = Way::of(&strides, |_| [0.5, 0.1, 0.0]);
        let (x, y) = *straight.places.last().unwrap();
        assert!((x - 4.0).abs() < 1e-12 && (y - 0.8).abs() < 1e-12);
    }
}
