//! Figs. 7 to 10: the sine, learning in the map against learning on the robot, return maps under pushes.

use std::path::Path;

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points};
use stridemap_lab::seed::{Role, stream};
use stridemap_lab::{Algorithm, LabError, PushConfig, builtin, push};
use stridemap_learn::SavedPolicy;
use stridemap_record::{ComparePoint, Performance, PushOutcome, Spread};
use stridemap_report::figures::{Fig7, fig7, fig8, fig9, fig10};

use super::{Row, row};
use crate::args::Common;
use crate::commands::compare::{Comparison, fig8_data, fig9_data, run_arms};
use crate::commands::learn::median;
use crate::commands::learners::interval;
use crate::failure::Failure;
use crate::parallel;

/// The paper's pushes \[MA09, sec. 6.1\].
const PUSHES: PushConfig = PushConfig { force_n: 40.0, duration_s: 0.2, strides: 160 };

/// Draws Fig. 7.
pub fn sine(dir: &Path, seed: u64) -> Result<(), Failure> {
    Ok(fig7(&fig7_data(seed)?)?.write(dir)?)
}

/// Draws Fig. 8 or 9 or both, and returns the rows of the table.
pub fn learning(dir: &Path, curves: bool, policies: bool, seeds: u64, common: &Common) -> Result<Vec<Row>, Failure> {
    let (comparison, arms) = run_arms("stepping-paper", seeds, common)?;
    if curves {
        fig8(&fig8_data(&comparison))?.write(dir)?;
    }
    if policies {
        fig9(&fig9_data(&arms))?.write(dir)?;
    }
    Ok(rows_of_comparison(&comparison))
}

/// Draws Fig. 10, and returns the rows of the table.
pub fn pushes(dir: &Path, seeds: u64, common: &Common) -> Result<Vec<Row>, Failure> {
    let pushed = pushed_policies(seeds, common)?;
    let maps = [("nominal gait", &pushed[0].nominal), ("learned policy", &pushed[0].learned)];
    fig10(&maps, pushed[0].target_deg)?.write(dir)?;
    Ok(rows_of_pushes(&pushed))
}

/// The paper's simple example \[MA09, sec. 4.1\]: ten samples of a sine with noise of variance 0.01,
/// under v₀ = 1, v₁ = 0.01, v_k = 1.
fn fig7_data(seed: u64) -> Result<Fig7, Failure> {
    let mut rng = stream(seed, Role::Fit, 0);
    let sample_x: Vec<f64> = (0..10).map(|_| 2.0 * std::f64::consts::PI * rng.random::<f64>()).collect();
    let sample_y: Vec<f64> = sample_x
        .iter()
        .map(|x| {
            let z: f64 = StandardNormal.sample(&mut rng);
            x.sin() + 0.1 * z
        })
        .collect();
    let hyperparameters = Hyperparameters { length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.01 };
    let fitted = Points::new(&sample_x, 1)
        .and_then(|points| Gp::condition(points, &sample_y, Kernel::SquaredExponential, Mean::Zero, hyperparameters));
    let gp = fitted.map_err(|error| Failure::working(error.to_string()))?;
    let x: Vec<f64> = (0..=200).map(|i| 2.0 * std::f64::consts::PI * f64::from(i) / 200.0).collect();
    let (mut mean, mut std) = (Vec::new(), Vec::new());
    for x in &x {
        let p = gp.predict(&[*x]).map_err(|error| Failure::working(error.to_string()))?;
        mean.push(p.mean);
        std.push(p.latent_variance.sqrt());
    }
    Ok(Fig7 { target: x.iter().map(|x| x.sin()).collect(), x, mean, std, std_with_noise: false, sample_x, sample_y })
}

/// Pushes of one seed's nominal gait and learned policy.
struct Pushed {
    nominal: PushOutcome,
    learned: PushOutcome,
    nominal_performance: Performance,
    final_performance: Performance,
    strides: usize,
    target_deg: Option<f64>,
}

/// Learns `stepping` and pushes the result, per seed.
fn pushed_policies(seeds: u64, common: &Common) -> Result<Vec<Pushed>, Failure> {
    let task = builtin::load("stepping", &common.sets)?.task;
    let list = parallel::seeds(common.seed, seeds)?;
    let work = |seed: &u64| -> Result<Pushed, LabError> {
        let seed = *seed;
        let mut algorithm = Algorithm::new(&task, seed)?;
        algorithm.learn(&mut stridemap_lab::NoRecorder)?;
        let no_policy = || LabError::TooFewStrides { found: 0, needed: 1 };
        let policy: SavedPolicy = algorithm.progress.final_policy(&task)?;
        let nominal_policy = task.nominal_policy()?;
        let (nominal_performance, final_performance) = (
            algorithm.progress.nominal.ok_or_else(no_policy)?,
            algorithm.progress.final_performance.ok_or_else(no_policy)?,
        );
        let strides = algorithm.progress.transitions.len();
        let plant = algorithm.plant_mut();
        let nominal = push(plant, &nominal_policy, PUSHES, seed, &mut |_| Ok(()))?;
        let learned = push(plant, &policy, PUSHES, seed, &mut |_| Ok(()))?;
        Ok(Pushed { nominal, learned, nominal_performance, final_performance, strides, target_deg: task.target_deg() })
    };
    parallel::over(&list, common.threads, |seed, _| format!("seed {seed}"), work)
}

fn rows_of_comparison(c: &Comparison) -> Vec<Row> {
    let command = format!("compare stepping-paper --seeds {}", c.seeds);
    let last = c.trials.last();
    let reward = |of: &dyn Fn(&ComparePoint) -> Spread| {
        last.map_or("-".into(), |t| {
            let s = of(t);
            format!("{:+.4} (sd {:.4}, n = {})", s.mean, s.sd.unwrap_or(0.0), c.seeds)
        })
    };
    let (gp, full) = (reward(&|t| t.gp), reward(&|t| t.full));
    let finding = &c.finding;
    vec![
        row("Fig. 8: reward after the last trial, learned in the GP map", "about 0 (read off)", gp, &command),
        row("Fig. 8: reward after the last trial, full model", "about 0 (read off)", full, &command),
        row(
            "Fig. 8: spread over seeds in the first half of the trials, GP map and full model",
            "the map's is larger",
            format!("{:.4}, {:.4}", finding.early_sd.gp, finding.early_sd.full),
            &command,
        ),
        row(
            "Fig. 8: GP map less full model after the last trial, 95 %",
            "slightly above 0",
            interval(&finding.last_difference, 4),
            &command,
        ),
    ]
}

fn rows_of_pushes(pushed: &[Pushed]) -> Vec<Row> {
    let median = |values: Vec<f64>| median(&values);
    let command = format!("reproduce fig10 --seeds {}", pushed.len());
    let n = pushed.len();
    let slopes = |of: &dyn Fn(&Pushed) -> Option<f64>| pushed.iter().filter_map(of).collect::<Vec<_>>();
    let falls: usize = pushed.iter().map(|p| p.learned.falls).sum();
    vec![
        row(
            "Fig. 10: slope of the return map k -> k+2 under pushes",
            "much smaller than one",
            format!(
                "{:.2} (median, n = {n}); nominal gait {:.2}",
                median(slopes(&|p| p.learned.slope)),
                median(slopes(&|p| p.nominal.slope))
            ),
            &command,
        ),
        row(
            "Fig. 10: fixed point, target 2.0 deg",
            "2.3 deg",
            format!("{:.2} deg (median)", median(slopes(&|p| p.learned.fixed_point_deg))),
            &command,
        ),
        row("Fig. 10: falls under pushes", "none reported", format!("{falls} in {n} runs"), &command),
        row(
            "Sec. 6.1: mean reward of the final policy",
            "about 0 (Fig. 8)",
            format!(
                "{:+.4} (median) from {} strides; nominal gait {:+.4}",
                median(pushed.iter().map(|p| p.final_performance.mean_reward).collect()),
                pushed.first().map_or(0, |p| p.strides),
                median(pushed.iter().map(|p| p.nominal_performance.mean_reward).collect())
            ),
            "learn stepping",
        ),
    ]
}
