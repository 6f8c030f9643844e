//! Figs. 7, 8 and 9 of Morimoto and Atkeson (2009).

use super::check::{column, some};
use crate::draw::{Anchor, Axis, Dash, Key, Mark, Sheet, number, signed};
use crate::error::Result;
use crate::figure::Figure;

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
    let pairs = |y: &[f64]| -> Vec<(f64, f64)> { data.x.iter().copied().zip(y.iter().copied()).collect() };
    let all = at(2.0).into_iter().chain(at(-2.0)).chain(data.sample_y.iter().copied());
    let mut sheet = Sheet::new(stem, "Gaussian-process regression of a sine from a few samples");
    let mut p =
        sheet.single(300.0, Axis::linear("input z (rad)", data.x[0], data.x[n - 1]), Axis::covering("output", all));
    p.band(&data.x, &at(-2.0), &at(2.0), "s0", 0.12);
    p.band(&data.x, &at(-1.0), &at(1.0), "s0", 0.2);
    for k in [-2.0, -1.0, 1.0, 2.0] {
        p.line(&pairs(&at(k)), "s0", Dash::Dashed, 1.0);
    }
    p.line(&pairs(&data.target), "s1", Dash::Chain, 2.0);
    p.line(&pairs(&data.mean), "s0", Dash::Solid, 2.4);
    let samples: Vec<(f64, f64)> = data.sample_x.iter().copied().zip(data.sample_y.iter().copied()).collect();
    p.marks(&samples, "s6", Mark::Circle, 4.5);
    for i in (0..n).step_by((n / 60).max(1)) {
        p.hover(
            data.x[i],
            data.mean[i],
            format!(
                "z = {} rad: mean {} ± {} (target {})",
                signed(data.x[i], 2),
                signed(data.mean[i], 3),
                signed(data.std[i], 3),
                signed(data.target[i], 3)
            ),
        );
    }
    for (x, y) in &samples {
        p.hover(*x, *y, format!("sample: z = {} rad, {}", signed(*x, 2), signed(*y, 3)));
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
        csv.push_str(&format!("curve,{},{},{},{}\n", data.x[i], data.mean[i], data.std[i], data.target[i]));
    }
    for (x, y) in &samples {
        csv.push_str(&format!("sample,{x},{y},,\n"));
    }
    let alt = format!(
        "Line plot of a sine and its Gaussian-process estimate from {} samples; the uncertainty band is \
         narrow at the samples and wide between them.",
        data.sample_x.len()
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// Mean and standard deviation over seeds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanSd {
    /// Mean over seeds.
    pub mean: f64,
    /// Standard deviation over seeds (of the sample, n - 1).
    pub sd: f64,
}

/// One trial of the comparison: an entry of `trials` of `compare --json`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrialComparison {
    /// Learning trials done; 0 is before any learning.
    pub trial: u32,
    /// Learned on the Gaussian-process map.
    pub gp: MeanSd,
    /// Learned on the full model.
    pub full: MeanSd,
    /// Student's t, two-sided; `None` where it is not defined.
    pub p_value: Option<f64>,
}

/// Learning on the map against learning on the full model, as in Fig. 8.
#[derive(Clone, Debug, PartialEq)]
pub struct Fig8 {
    /// One entry per trial, the first before any learning.
    pub trials: Vec<TrialComparison>,
    /// Seeds over which mean and standard deviation are taken.
    pub seeds: u32,
    /// Strides on the plant over which one seed's average reward is taken.
    pub strides: u32,
}

/// Draws Fig. 8 on an axis that is even near zero and logarithmic beyond.
///
/// # Errors
///
/// [`ReportError`](crate::ReportError) if there is no trial or a value is not finite.
pub fn fig8(data: &Fig8) -> Result<Figure> {
    let stem = "fig8";
    some(stem, "trials", data.trials.len())?;
    let pick = |f: fn(&TrialComparison) -> f64| data.trials.iter().map(f).collect::<Vec<f64>>();
    let (gp, gp_sd) = (pick(|t| t.gp.mean), pick(|t| t.gp.sd));
    let (full, full_sd) = (pick(|t| t.full.mean), pick(|t| t.full.sd));
    for (name, values) in [("gp.mean", &gp), ("gp.sd", &gp_sd), ("full.mean", &full), ("full.sd", &full_sd)] {
        column(stem, name, values, data.trials.len())?;
    }
    // Half of the 95 % interval of a mean over the seeds.
    let of_mean = 1.96 / (data.seeds.max(1) as f64).sqrt();
    let [gp_half, full_half] = [&gp_sd, &full_sd].map(|sd| sd.iter().map(|sd| of_mean * sd).collect::<Vec<f64>>());
    let trial: Vec<f64> = data.trials.iter().map(|t| f64::from(t.trial)).collect();
    let last_trial = trial.iter().copied().fold(1.0, f64::max);

    // The even part reaches down to the decade of the best mean, a thousandth at least.
    let best = gp.iter().chain(&full).map(|v| v.abs()).fold(f64::INFINITY, f64::min).max(1e-4);
    let linear = 10f64.powf(best.log10().floor()).max(1e-3);
    let low =
        (0..trial.len()).flat_map(|i| [gp[i] - gp_half[i], full[i] - full_half[i]]).fold(-linear * 10.0, f64::min);
    let y = Axis::symlog("average reward per stride", low * 1.25, linear * 0.55, linear);
    let mut sheet = Sheet::new(stem, "Learning on the Gaussian-process map and on the full model");
    let mut p = sheet.single(330.0, Axis::counting("learning trials", -0.5, last_trial + 0.5), y);

    for (values, half, class, dash, mark, shift, name) in [
        (&full, &full_half, "s1", Dash::Dashed, Mark::Diamond, 0.09, "full model"),
        (&gp, &gp_half, "s0", Dash::Solid, Mark::Disc, -0.09, "GP map"),
    ] {
        let points: Vec<(f64, f64)> = trial.iter().zip(values).map(|(t, v)| (t + shift, *v)).collect();
        let bars: Vec<(f64, f64, f64)> =
            (0..trial.len()).map(|i| (trial[i] + shift, values[i] - half[i], values[i] + half[i])).collect();
        p.error_bars(&bars, class, 3.0);
        p.line(&points, class, dash, 2.0);
        p.marks(&points, class, mark, 3.6);
        for i in 0..trial.len() {
            p.hover(
                points[i].0,
                points[i].1,
                format!("{name}, after {} trials: {} ± {}", trial[i], number(values[i], 3), number(half[i], 2)),
            );
        }
    }
    let mut significant = Vec::new();
    for (t, x) in data.trials.iter().zip(&trial) {
        if let Some(value) = t.p_value.filter(|v| *v < 0.05) {
            significant.push(t.trial.to_string());
            let row = p.top + 11.0;
            let column = p.px(*x);
            p.note_px(column, row + 4.0, Anchor::Middle, "pnl", "*");
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
    let end = data.trials[data.trials.len() - 1];
    let caption = format!(
        "Fig. 8 of the paper. Reward on the plant of the frozen stochastic policy, averaged over {} strides; mean \
         over n = {} seeds with its 95 % interval (bars: 1.96 sd/√n). Vertical axis linear within ±{}, logarithmic beyond. \
         Student's t per trial, two-sided: {tested}. After trial {}, mean ± sd: GP map {} ± {}, full model {} ± {}. \
         The paper (5 runs): the GP map varies more early, is comparable after 10 trials and slightly better after \
         the 8th (p < .05).",
        data.strides,
        data.seeds,
        number(linear, 1),
        end.trial,
        number(end.gp.mean, 3),
        number(end.gp.sd, 2),
        number(end.full.mean, 3),
        number(end.full.sd, 2)
    );
    let mut csv = String::from("trial,gp_mean,gp_sd,full_mean,full_sd,p_value\n");
    for t in &data.trials {
        let p_value = t.p_value.map_or_else(String::new, |v| v.to_string());
        csv.push_str(&format!("{},{},{},{},{},{p_value}\n", t.trial, t.gp.mean, t.gp.sd, t.full.mean, t.full.sd));
    }
    let alt = format!(
        "Learning curves over {} trials: average reward with the GP map rises from {} to {}, with the full model from {} to {}.",
        end.trial,
        number(gp[0], 2),
        number(end.gp.mean, 2),
        number(full[0], 2),
        number(end.full.mean, 2)
    );
    Ok(sheet.finish(&caption, &alt, csv))
}

/// A policy over one state, averaged over seeds.
#[derive(Clone, Debug, PartialEq)]
pub struct PolicyCurve {
    /// Mean over seeds of the policy's mean action, at each state.
    pub mean: Vec<f64>,
    /// Standard deviation over seeds of the policy's mean action.
    pub sd: Vec<f64>,
    /// States visited while learning on the plant, for the rug.
    pub visited: Vec<f64>,
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
    pub seeds: u32,
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
    for (name, curve) in [("gp", &data.gp), ("full", &data.full)] {
        column(stem, &format!("{name}.mean"), &curve.mean, x.len())?;
        column(stem, &format!("{name}.sd"), &curve.sd, x.len())?;
        column(stem, &format!("{name}.visited"), &curve.visited, curve.visited.len())?;
    }
    let edge = |c: &PolicyCurve, k: f64| -> Vec<f64> { c.mean.iter().zip(&c.sd).map(|(m, s)| m + k * s).collect() };
    let mut values = Vec::new();
    for c in [&data.gp, &data.full] {
        values.extend(edge(c, 1.0));
        values.extend(edge(c, -1.0));
    }
    let (lo, hi) = (
        values.iter().copied().fold(f64::INFINITY, f64::min),
        values.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    );
    // Room below for two rows of rug.
    values.push(lo - 0.09 * (hi - lo));
    let mut sheet = Sheet::new(stem, "Policies learned on the Gaussian-process map and on the full model");
    let mut p = sheet.single(
        310.0,
        Axis::linear(&format!("{PSI} (deg)"), x[0], x[x.len() - 1]),
        Axis::covering(&format!("mean action {}", data.action_label), values),
    );
    for (row, (c, class, dash, name)) in
        [(&data.full, "s1", Dash::Dashed, "full model"), (&data.gp, "s0", Dash::Solid, "GP map")]
            .into_iter()
            .enumerate()
    {
        p.band(x, &edge(c, -1.0), &edge(c, 1.0), class, 0.16);
        let points: Vec<(f64, f64)> = x.iter().copied().zip(c.mean.iter().copied()).collect();
        p.line(&points, class, dash, 2.4);
        p.rug(&c.visited, class, row);
        for i in (0..x.len()).step_by((x.len() / 40).max(1)) {
            p.hover(
                x[i],
                c.mean[i],
                format!(
                    "{name}: {PSI} = {} deg, action {} ± {}",
                    signed(x[i], 2),
                    signed(c.mean[i], 2),
                    signed(c.sd[i], 2)
                ),
            );
        }
    }
    p.key("GP map", Key::Line("s0", Dash::Solid));
    p.key("GP map ± 1 sd", Key::Band("s0", 0.2));
    p.key("full model", Key::Line("s1", Dash::Dashed));
    p.key("full model ± 1 sd", Key::Band("s1", 0.2));
    sheet.add(p);
    let caption = format!(
        "Fig. 9 of the paper. Mean action of the policy over the state: mean and standard deviation (bands) over \
         n = {} seeds. Ticks along the bottom: states visited while learning, GP map above (n = {}), full model below \
         (n = {}); where there are few, the policies are not determined. The paper (5 runs): similar policies between \
         0 and 4 deg, different beyond.",
        data.seeds,
        data.gp.visited.len(),
        data.full.visited.len()
    );
    let mut csv = String::from("psi_roll_deg,gp_mean,gp_sd,full_mean,full_sd\n");
    for (i, psi) in x.iter().enumerate() {
        csv.push_str(&format!(
            "{psi},{},{},{},{}\n",
            data.gp.mean[i], data.gp.sd[i], data.full.mean[i], data.full.sd[i]
        ));
    }
    let alt = format!(
        "Two curves of the mean action over psi_roll from {} to {} degrees with bands of one standard deviation over {} seeds.",
        number(x[0], 3),
        number(x[x.len() - 1], 3),
        data.seeds
    );
    Ok(sheet.finish(&caption, &alt, csv))
}
