//! Figs. 7, 8 and 9 of Morimoto and Atkeson (2009).

use super::check::{column, some};
use crate::draw::{Anchor, Axis, Dash, Key, Mark, N, Sheet, extent, number, pairs};
use crate::error::Result;
use crate::figure::Figure;
use stridemap_record::{ComparePoint, Spread};

/// Label of the pendulum's roll angle.
pub(crate) const PSI: &str = "ψ_{roll}";

/// Gaussian-process regression of a sine, as in Fig. 7.
///
/// `target`, `mean` and `std` stand at the inputs `x`; `sample_y` at `sample_x`.
#[derive(Clone, Debug, PartialEq)]
pub struct Fig7 {
    /// Inputs at which the curves are given, ascending, radians.
    pub x: Vec<f64>,
    /// The true function.
    pub target: Vec<f64>,
    /// Mean of the predictive distribution.
    pub mean: Vec<f64>,
    /// Standard deviation of the predictive distribution.
    pub std: Vec<f64>,
    /// Whether `std` includes the noise of an observation, or is that of the function alone.
    pub std_with_noise: bool,
    /// Inputs of the samples, radians.
    pub sample_x: Vec<f64>,
    /// The samples, with their noise.
    pub sample_y: Vec<f64>,
}

/// Draws Fig. 7: target dash-dotted, samples as circles, mean solid, one and two standard deviations.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if columns differ in length, hold a value that is not finite, or are empty.
pub fn fig7(data: &Fig7) -> Result<Figure> {
    let stem = "fig7";
    some(stem, "curves", data.x.len())?;
    let n = data.x.len();
    for (name, values) in [("x", &data.x), ("target", &data.target), ("mean", &data.mean), ("std", &data.std)] {
        column(stem, name, values, n)?;
    }
    column(stem, "sample_x", &data.sample_x, data.sample_x.len())?;
    column(stem, "sample_y", &data.sample_y, data.sample_x.len())?;

    let at = |k: f64| -> Vec<f64> { (0..n).map(|i| data.mean[i] + k * data.std[i]).collect() };
    let all = at(2.0).into_iter().chain(at(-2.0)).chain(data.sample_y.iter().copied());
    let mut sheet = Sheet::new(stem, "Gaussian-process regression of a sine from a few samples");
    let mut p = sheet.single(
        300.0,
        Axis::linear("input z (rad)", data.x[0], data.x[n - 1]),
        Axis::covering("output", all),
        None,
    );
    p.band(&data.x, &at(-2.0), &at(2.0), "s0", 0.12);
    p.band(&data.x, &at(-1.0), &at(1.0), "s0", 0.2);
    for k in [-2.0, -1.0, 1.0, 2.0] {
        p.line(&pairs(&data.x, &at(k)), "s0", Dash::Dashed, 1.0);
    }
    p.line(&pairs(&data.x, &data.target), "s1", Dash::Chain, 2.0);
    p.line(&pairs(&data.x, &data.mean), "s0", Dash::Solid, 2.4);
    let samples = pairs(&data.sample_x, &data.sample_y);
    p.marks(&samples, "s6", Mark::Circle, 4.5);
    for i in (0..n).step_by((n / 60).max(1)) {
        let [z, mean, std, target] = [data.x[i], data.mean[i], data.std[i], data.target[i]].map(N);
        p.hover(z.0, mean.0, format!("z = {z:.2} rad: mean {mean:.3} ± {std:.3} (target {target:.3})"));
    }
    for (x, y) in &samples {
        p.hover(*x, *y, format!("sample: z = {:.2} rad, {:.3}", N(*x), N(*y)));
    }
    p.key("target", Key::Line("s1", Dash::Chain));
    p.key("samples", Key::Mark("s6", Mark::Circle));
    p.key("predictive mean", Key::Line("s0", Dash::Solid));
    p.key("mean ± 1 and ± 2 sd", Key::Band("s0", 0.22));
    sheet.add(p);

    let spread = if data.std_with_noise {
        "predictive distribution of a new observation (function and noise)"
    } else {
        "predictive distribution of the function (without the noise of an observation)"
    };
    let caption = format!(
        "Fig. 7 of the paper. Target function (dash-dotted), n = {} samples with additive noise (circles), \
         mean (solid) and ±1 and ±2 standard deviations (bands with dashed edges) of the {spread}. \
         The paper: 10 samples, uniform on 0 to 2π; the deviation is large where no sample is.",
        data.sample_x.len()
    );
    let mut csv = String::from("series,z_rad,value,std,target\n");
    for i in 0..n {
        csv += &format!("curve,{},{},{},{}\n", data.x[i], data.mean[i], data.std[i], data.target[i]);
    }
    for (x, y) in &samples {
        csv += &format!("sample,{x},{y},,\n");
    }
    let alt = format!(
        "Line plot of a sine and its Gaussian-process estimate from {} samples; the uncertainty band is \
         narrow at the samples and wide between them.",
        data.sample_x.len()
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// Learning on the map against learning on the full model, as in Fig. 8.
#[derive(Clone, Debug, PartialEq)]
pub struct Fig8 {
    /// One entry per trial, the first before any learning.
    pub trials: Vec<ComparePoint>,
    /// Seeds over which mean and standard deviation are taken.
    pub seeds: u64,
    /// Strides on the plant over which one seed's average reward is taken.
    pub strides: usize,
}

/// The standard deviation over seeds; of one seed there is none.
fn sd(spread: &Spread) -> f64 {
    spread.sd.unwrap_or(0.0)
}

/// Draws Fig. 8 on an axis that is even near zero and logarithmic beyond.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no trial or a value is not finite.
pub fn fig8(data: &Fig8) -> Result<Figure> {
    let stem = "fig8";
    let n = data.trials.len();
    some(stem, "trials", n)?;
    // Mean and half of the 95 % interval of a mean over the seeds.
    let of_mean = 1.96 / (data.seeds.max(1) as f64).sqrt();
    let arm = |name: &str, of: fn(&ComparePoint) -> &Spread| -> Result<[Vec<f64>; 2]> {
        let spreads: Vec<&Spread> = data.trials.iter().map(of).collect();
        let mean: Vec<f64> = spreads.iter().map(|s| s.mean).collect();
        let half: Vec<f64> = spreads.iter().map(|s| of_mean * sd(s)).collect();
        column(stem, &format!("{name}.mean"), &mean, n)?;
        column(stem, &format!("{name}.sd"), &half, n)?;
        Ok([mean, half])
    };
    let ([gp, gp_half], [full, full_half]) = (arm("gp", |t| &t.gp)?, arm("full", |t| &t.full)?);
    let trial: Vec<f64> = data.trials.iter().map(|t| t.trial as f64).collect();
    let last_trial = trial.iter().copied().fold(1.0, f64::max);

    // The even part reaches down to the decade of the best mean, a thousandth at least.
    let best = gp.iter().chain(&full).map(|v| v.abs()).fold(f64::INFINITY, f64::min).max(1e-4);
    let linear = 10f64.powf(best.log10().floor()).max(1e-3);
    let low = (0..n).flat_map(|i| [gp[i] - gp_half[i], full[i] - full_half[i]]).fold(-linear * 10.0, f64::min);
    let y = Axis::symlog("average reward per stride", low * 1.25, linear * 0.55, linear);
    let mut sheet = Sheet::new(stem, "Learning on the Gaussian-process map and on the full model");
    let mut p = sheet.single(330.0, Axis::counting("learning trials", -0.5, last_trial + 0.5), y, None);

    for (values, half, class, dash, mark, shift, name) in [
        (&full, &full_half, "s1", Dash::Dashed, Mark::Diamond, 0.09, "full model"),
        (&gp, &gp_half, "s0", Dash::Solid, Mark::Disc, -0.09, "GP map"),
    ] {
        let points: Vec<(f64, f64)> = trial.iter().zip(values).map(|(t, v)| (t + shift, *v)).collect();
        let bars: Vec<(f64, f64, f64)> = points.iter().zip(half).map(|((t, v), h)| (*t, v - h, v + h)).collect();
        p.error_bars(&bars, class, 3.0);
        p.line(&points, class, dash, 2.0);
        p.marks(&points, class, mark, 3.6);
        for ((trial, (x, y)), half) in trial.iter().zip(&points).zip(half) {
            let text = format!("{name}, after {trial} trials: {:#.3} ± {:#.2}", N(*y), N(*half));
            p.hover(*x, *y, text);
        }
    }
    let mut significant = Vec::new();
    for (t, x) in data.trials.iter().zip(&trial) {
        if let Some(value) = t.p_value.filter(|v| *v < 0.05) {
            significant.push(t.trial.to_string());
            p.note_px(p.px(*x), p.top + 15.0, Anchor::Middle, "pnl", "*");
            p.hover(*x, p.y.max, format!("trial {}: p = {}", t.trial, number(value, 2)));
        }
    }
    p.key("GP map", Key::Both("s0", Dash::Solid, Mark::Disc));
    p.key("full model", Key::Both("s1", Dash::Dashed, Mark::Diamond));
    sheet.add(p);

    let tested = if significant.is_empty() {
        "no trial has p < .05".to_owned()
    } else {
        format!("* marks p < .05, at trial {}", significant.join(", "))
    };
    let end = &data.trials[n - 1];
    let (trials, seeds, strides) = (end.trial, data.seeds, data.strides);
    let [gp_first, full_first] = [gp[0], full[0]].map(N);
    let [gp_mean, gp_sd, full_mean, full_sd] = [end.gp.mean, sd(&end.gp), end.full.mean, sd(&end.full)].map(N);
    let caption = format!(
        "Fig. 8 of the paper. Reward on the plant of the frozen stochastic policy, averaged over {strides} strides; mean \
         over n = {seeds} seeds with its 95 % interval (bars: 1.96 sd/√n). Vertical axis linear within ±{:#.1}, logarithmic beyond. \
         Student's t per trial, two-sided: {tested}. After trial {trials}, mean ± sd: GP map {gp_mean:#.3} ± {gp_sd:#.2}, \
         full model {full_mean:#.3} ± {full_sd:#.2}. The paper (5 runs): the GP map varies more early, is comparable after \
         10 trials and slightly better after the 8th (p < .05).",
        N(linear)
    );
    let mut csv = String::from("trial,gp_mean,gp_sd,full_mean,full_sd,p_value\n");
    for t in &data.trials {
        let p_value = t.p_value.map_or_else(String::new, |v| v.to_string());
        csv += &format!("{},{},{},{},{},{p_value}\n", t.trial, t.gp.mean, sd(&t.gp), t.full.mean, sd(&t.full));
    }
    let alt = format!(
        "Learning curves over {trials} trials: average reward with the GP map rises from {gp_first:#.2} to {gp_mean:#.2}, \
         with the full model from {full_first:#.2} to {full_mean:#.2}."
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// A policy over one state, averaged over seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct PolicyCurve {
    /// The policy's mean action over seeds, at each state.
    pub spread: Vec<Spread>,
    /// States visited while learning on the plant, for the rug.
    pub visited: Vec<f64>,
}

impl PolicyCurve {
    /// Mean over seeds and so many standard deviations.
    fn edge(&self, k: f64) -> Vec<f64> {
        self.spread.iter().map(|s| s.mean + k * sd(s)).collect()
    }
}

/// The policies learned on map and full model, as in Fig. 9.
#[derive(Clone, Debug, PartialEq)]
pub struct Fig9 {
    /// States at which both policies are given, ascending, degrees.
    pub psi_roll_deg: Vec<f64>,
    /// Learned on the Gaussian-process map.
    pub gp: PolicyCurve,
    /// Learned on the full model.
    pub full: PolicyCurve,
    /// Seeds over which mean and standard deviation are taken.
    pub seeds: usize,
    /// The action and its unit, for the axis: `A_{step} (deg)`.
    pub action_label: String,
}

/// Draws Fig. 9, with a rug of the visited states of each learner.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if columns differ in length, hold a value that is not finite, or are empty.
pub fn fig9(data: &Fig9) -> Result<Figure> {
    let stem = "fig9";
    let x = &data.psi_roll_deg;
    some(stem, "states", x.len())?;
    column(stem, "psi_roll_deg", x, x.len())?;
    let mut values = Vec::new();
    for (name, curve) in [("gp", &data.gp), ("full", &data.full)] {
        column(stem, &format!("{name}.mean"), &curve.edge(0.0), x.len())?;
        column(stem, &format!("{name}.sd"), &curve.edge(1.0), x.len())?;
        column(stem, &format!("{name}.visited"), &curve.visited, curve.visited.len())?;
        values.extend([1.0, -1.0].into_iter().flat_map(|k| curve.edge(k)));
    }
    let (lo, hi) = extent(values.iter().copied());
    // Room below for two rows of rug.
    values.push(lo - 0.09 * (hi - lo));
    let (first, last) = (x[0], x[x.len() - 1]);
    let mut sheet = Sheet::new(stem, "Policies learned on the Gaussian-process map and on the full model");
    let x_axis = Axis::linear(&format!("{PSI} (deg)"), first, last);
    let y_axis = Axis::covering(&format!("mean action {}", data.action_label), values);
    let mut p = sheet.single(310.0, x_axis, y_axis, None);
    let curves = [(&data.full, "s1", Dash::Dashed, "full model"), (&data.gp, "s0", Dash::Solid, "GP map")];
    for (row, (c, class, dash, name)) in curves.into_iter().enumerate() {
        p.band(x, &c.edge(-1.0), &c.edge(1.0), class, 0.16);
        p.line(&pairs(x, &c.edge(0.0)), class, dash, 2.4);
        p.rug(&c.visited, class, row);
        for (x, s) in x.iter().zip(&c.spread).step_by((x.len() / 40).max(1)) {
            let [psi, mean, sd] = [*x, s.mean, sd(s)].map(N);
            p.hover(*x, s.mean, format!("{name}: {PSI} = {psi:.2} deg, action {mean:.2} ± {sd:.2}"));
        }
    }
    for (_, class, dash, name) in curves.into_iter().rev() {
        p.key(name, Key::Line(class, dash));
        p.key(&format!("{name} ± 1 sd"), Key::Band(class, 0.2));
    }
    sheet.add(p);
    let (seeds, [on_map, on_robot]) = (data.seeds, [&data.gp, &data.full].map(|c| c.visited.len()));
    let caption = format!(
        "Fig. 9 of the paper. Mean action of the policy over the state: mean and standard deviation (bands) over \
         n = {seeds} seeds. Ticks along the bottom: states visited while learning, GP map above (n = {on_map}), full model below \
         (n = {on_robot}); where there are few, the policies are not determined. The paper (5 runs): similar policies between \
         0 and 4 deg, different beyond."
    );
    let mut csv = String::from("psi_roll_deg,gp_mean,gp_sd,full_mean,full_sd\n");
    for ((psi, gp), full) in x.iter().zip(&data.gp.spread).zip(&data.full.spread) {
        csv += &format!("{psi},{},{},{},{}\n", gp.mean, sd(gp), full.mean, sd(full));
    }
    let alt = format!(
        "Two curves of the mean action over psi_roll from {:#.3} to {:#.3} degrees with bands of one standard deviation \
         over {seeds} seeds.",
        N(first),
        N(last)
    );
    Ok(sheet.finish(&caption, &alt, csv))
}
