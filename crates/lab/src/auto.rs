//! Tasks in the robot's own units: what a file leaves to the robot (`"auto"`) is read off its nominal gait and a careful ramp.

use stridemap_process::{StrideEnd, StrideProcess};

use crate::error::{Invalid, LabError};
use crate::nominal::nominal_gait;
use crate::plant::Plant;
use crate::reward::RewardQuantity;
use crate::seed::{Role, stream};
use crate::state::StateComponent;
use crate::stepping::{GaitVerdict, Stepping};
use crate::task::Task;

/// Seed of what is asked of the robot: a task has one set of numbers, whatever the seed of the run.
const SEED: u64 = 1;
/// Strides for which a ramp holds a value, and the last of them that are averaged.
const HELD: usize = 6;
const AVERAGED: usize = 4;
/// Steps of a ramp to its furthest value, either way.
const STEPS: [usize; 2] = [4, 10];
/// A step of the ramp, as a share of the nominal gait's pitch amplitude.
const STEP_SHARE: f64 = 0.08;
/// A tilt so far beyond the nominal gait's greatest is a warning.
const TILT_DEG: f64 = 4.0;
/// A stride so many times as long, or as short, as a nominal one is a warning.
const LONGER: f64 = 1.4;
/// Standard deviations of the nominal gait's `psi_roll` that a target must be away from it.
const CLEARLY: f64 = 2.0;
/// Share of what a ramp reached that is asked of a policy.
const ASKED: f64 = 0.6;

/// One value of a ramp, held for some strides.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RampStep {
    /// The action's value.
    value: f64,
    /// Mean `psi_roll` at the section in the last strides.
    psi_roll_deg: f64,
    /// Least and greatest `psi_roll` in all of them.
    passed_deg: [f64; 2],
}

/// What a robot does as one action moves away from the nominal gait.
#[derive(Clone, Debug, Default, PartialEq)]
struct Ramp {
    /// From the nominal value outwards.
    steps: Vec<RampStep>,
    /// Why it ended before its furthest value.
    warning: Option<String>,
}

/// Moves the first action of a task away from its neutral value, step by step, and stops at the first warning: a fall, a
/// tilt, a stride much longer or shorter than the nominal gait's.
///
/// # Errors
///
/// [`LabError`] if the plant cannot be built or reset.
fn ramp(task: &Task, nominal: &Stepping, step: f64, steps: usize, seed: u64) -> Result<Ramp, LabError> {
    let mut plant = task.plant()?;
    let neutral = task.action_limits()?[0].neutral;
    let mut rng = stream(seed, Role::Check, if step > 0.0 { 20 } else { 21 });
    plant.reset(&mut rng)?;
    let mut out = Ramp::default();
    // Irregular strides are no warning where the nominal gait has them.
    let usual_s = 3.0 * nominal.stride_spread_s;
    let within = [(nominal.stride_s - usual_s) / LONGER, (nominal.stride_s + usual_s) * LONGER];
    for k in 0..=steps {
        let value = neutral + step * k as f64;
        let mut seen = Vec::with_capacity(HELD);
        for _ in 0..HELD {
            let stride = plant.stride(&[value], &mut rng)?;
            let m = *plant.last_measures();
            let tilt_deg = plant.robot().state().base.tilt_rad().to_degrees();
            out.warning = match (stride.end, k) {
                (StrideEnd::Crossing, 0) => None,
                (end, _) => warning(&plant, end, m.duration_s, within, tilt_deg - nominal.tilt_deg),
            };
            if out.warning.is_some() {
                return Ok(out);
            }
            seen.push(m.psi_roll_deg);
        }
        let last = &seen[HELD - AVERAGED..];
        let extreme = |pick: fn(f64, f64) -> f64| seen.iter().copied().reduce(pick).unwrap_or(0.0);
        out.steps.push(RampStep {
            value,
            psi_roll_deg: last.iter().sum::<f64>() / last.len() as f64,
            passed_deg: [extreme(f64::min), extreme(f64::max)],
        });
    }
    Ok(out)
}

/// Why a ramp must end here, in words: a stride that is no crossing, one whose duration is not within bounds, a tilt beyond the
/// nominal gait's greatest.
fn warning(plant: &Plant, end: StrideEnd, stride_s: f64, within: [f64; 2], beyond_deg: f64) -> Option<String> {
    if end != StrideEnd::Crossing {
        return Some(plant.last_fall().map_or_else(|| "it stopped".into(), |fall| fall.to_string()));
    }
    if beyond_deg > TILT_DEG {
        return Some(format!("a tilt {beyond_deg:.1} deg beyond the nominal gait's"));
    }
    (stride_s < within[0] || stride_s > within[1]).then(|| format!("a stride of {stride_s:.2} s"))
}

impl Task {
    /// Asks the robot for the values that the file leaves to it; whether there were any. The task then says where they came
    /// from ([`told`](Self::told)), and asks no more.
    ///
    /// # Errors
    ///
    /// [`LabError::Invalid`] if the nominal gait does not step, or nothing that the action does moves `psi_roll`.
    pub fn tell(&mut self) -> Result<bool, LabError> {
        if self.auto.is_empty() {
            return Ok(false);
        }
        let refuse = |key: &str, requirement: String| LabError::Invalid(Invalid { key: key.into(), requirement });
        let key = self.auto[0].clone();
        let rewards_psi = self.reward[0].quantity == RewardQuantity::PSI_ROLL_SQUARED_ERROR;
        let asks_reward = self.auto.iter().any(|key| key.starts_with("reward."));
        if self.link.is_some()
            || self.action.len() != 1
            || self.state != [StateComponent::PSI_ROLL_DEG]
            || (asks_reward && !rewards_psi)
        {
            let why = "\"auto\" is for a simulated robot and tasks with one action, psi_roll_deg as the state and its error as the reward; give a number";
            return Err(refuse(&key, why.into()));
        }
        let gait = nominal_gait(self, SEED)?;
        if gait.verdict() != GaitVerdict::Steps {
            let why = format!(
                "is read off the nominal gait, which {}: `stridemap tune FILE` searches one that steps",
                if gait.fell.is_some() { "falls" } else { "only shuffles" }
            );
            return Err(refuse(&key, why));
        }
        let step = STEP_SHARE * self.gait.amplitude_deg.pitch;
        let mut wide = self.clone();
        let reach = [-step * (STEPS[0] as f64 + 1.0), step * (STEPS[1] as f64 + 1.0)];
        wide.action[0].bounds = reach;
        let [down, up] =
            [ramp(&wide, &gait.stepping, -step, STEPS[0], SEED)?, ramp(&wide, &gait.stepping, step, STEPS[1], SEED)?];
        let spread_deg = gait.stepping.psi_roll_spread_deg;
        let measured = Measured::of(spread_deg, [down, up]).map_err(|found| {
            refuse(
                &key,
                format!(
                    "is \"auto\", and no step of the ramp moves psi_roll clearly ({found}); `stridemap tune FILE --seed N` may find a \
                     more regular gait, or give numbers: action.0.bounds, reward.0.target_deg, reward.0.weight"
                ),
            )
        })?;
        measured.fill(self);
        self.auto.clear();
        self.validate()?;
        Ok(true)
    }
}

/// What was read off the robot.
struct Measured {
    /// Nominal `psi_roll` and its spread.
    psi_deg: f64,
    spread_deg: f64,
    target_deg: f64,
    /// How far the target is from nominal.
    unit_deg: f64,
    bounds: [f64; 2],
    passed_deg: [f64; 2],
    ramps: [Ramp; 2],
}

impl Measured {
    /// What the ramps show; in words, where that is not enough.
    fn of(spread_deg: f64, ramps: [Ramp; 2]) -> Result<Self, String> {
        let ended = |ramp: &Ramp| ramp.warning.clone().unwrap_or_else(|| "its end".into());
        let [below, above] = [ended(&ramps[0]), ended(&ramps[1])];
        let steps = || ramps.iter().flat_map(|ramp| &ramp.steps);
        let nominal = ramps.iter().find_map(|ramp| ramp.steps.first());
        let Some(psi_deg) = nominal.map(|step| step.psi_roll_deg) else {
            return Err(format!("the nominal gait itself gave a warning: {above}"));
        };
        let bounds =
            [0.9 * steps().map(|s| s.value).fold(0.0, f64::min), 0.9 * steps().map(|s| s.value).fold(0.0, f64::max)];
        let low = steps().map(|s| s.psi_roll_deg - psi_deg).fold(0.0, f64::min);
        let high = steps().map(|s| s.psi_roll_deg - psi_deg).fold(0.0, f64::max);
        // Nearer to over the stance foot, as in the paper, unless hardly anything leads there.
        let away = if -low >= 0.5 * high { ASKED * low } else { ASKED * high };
        if bounds[0] >= bounds[1] || away.abs() <= CLEARLY * spread_deg || away.abs() <= 1e-3 {
            return Err(format!(
                "psi_roll moves by {low:+.3} to {high:+.3} deg about {psi_deg:.3}, its spread from stride to stride is \
                 {spread_deg:.3}; the ramp ended at {below} below and {above} above"
            ));
        }
        Ok(Self {
            psi_deg,
            spread_deg,
            target_deg: rounded(psi_deg + away),
            unit_deg: away.abs(),
            bounds: bounds.map(rounded),
            passed_deg: [
                steps().map(|s| s.passed_deg[0]).fold(f64::INFINITY, f64::min),
                steps().map(|s| s.passed_deg[1]).fold(f64::NEG_INFINITY, f64::max),
            ],
            ramps,
        })
    }

    /// Fills in what the file leaves open; `stepping`'s own numbers are those of a nominal 3 deg, a target 1 deg below and
    /// bounds from −1.5 to 5.
    fn fill(&self, task: &mut Task) {
        let [low, high] = self.bounds;
        let (range, unit) = (high - low, self.unit_deg);
        let asked = task.auto.clone();
        let on = |key: &str| asked.iter().any(|asked| asked == key);
        let mut told = Vec::new();
        if on("action.0.bounds") {
            task.action[0].bounds = self.bounds;
            let end = |ramp: &Ramp| ramp.warning.clone().unwrap_or_else(|| "its end".into());
            told.push(format!(
                "action.0.bounds = [{low}, {high}]: nine tenths of a ramp in steps of {HELD} strides that ended at {} below and \
                 {} above",
                end(&self.ramps[0]),
                end(&self.ramps[1])
            ));
        }
        if on("reward.0.target_deg") {
            task.reward[0].target_deg = Some(self.target_deg);
            told.push(format!(
                "reward.0.target_deg = {}: {:.0} % of the way from the nominal gait's {:.3} (spread {:.3}) to what the ramp reached",
                self.target_deg,
                100.0 * ASKED,
                self.psi_deg,
                self.spread_deg
            ));
        }
        let error_deg = task.reward[0].target_deg.unwrap_or(0.0) - self.psi_deg;
        if on("reward.0.weight") {
            task.reward[0].weight = rounded(0.1 / (error_deg * error_deg + self.spread_deg * self.spread_deg));
            told.push(format!("reward.0.weight = {}: a nominal stride earns -0.1", task.reward[0].weight));
        }
        if on("failure.psi_roll_below_deg") {
            let least = self.passed_deg[0].min(self.psi_deg - unit);
            let below = rounded(least - unit.max(1.0));
            task.failure.psi_roll_below_deg = Some(below);
            told.push(format!("failure.psi_roll_below_deg = {below}: the ramp passed {:.3}", self.passed_deg[0]));
        }
        if on("action.0.explore.center") {
            task.action[0].explore.center = [low, 0.8 * high].map(rounded);
        }
        if on("action.0.explore.std") {
            task.action[0].explore.std = rounded(0.046 * range);
        }
        if on("map.state_range") {
            task.map.state_range = vec![[-90.0, rounded(self.passed_deg[1].max(self.psi_deg) + 4.0 * unit)]];
        }
        if on("map.start_range") {
            let (least, most) = (self.passed_deg[0].min(self.target_deg), self.passed_deg[1].max(self.target_deg));
            task.map.start_range = vec![[rounded(least - 0.5 * unit), rounded(most + 0.5 * unit)]];
        }
        if on("action.0.unit") {
            task.action[0].unit = rounded(0.31 * range);
        }
        if on("action.0.output_unit") {
            task.action[0].output_unit = rounded(0.31 * range);
        }
        if on("learner.actor_critic.basis_widths") {
            task.learner.actor_critic.basis_widths = vec![rounded(0.5 * unit)];
        }
        if on("success.psi_roll_within_deg") {
            task.success.psi_roll_within_deg = Some(rounded(0.3 * unit));
        }
        told.push(format!(
            "exploration, ranges of the map and units of the learner: those of `stepping` for {unit:.3} deg instead of 1 and \
             bounds {range:.3} apart instead of 6.5"
        ));
        task.told = told;
    }
}

/// Three digits, as one would write it.
fn rounded(value: f64) -> f64 {
    if value.abs() < 1e-12 { 0.0 } else { format!("{value:.2e}").parse().unwrap_or(value) }
}

#[cfg(test)]
mod tests {
    use crate::builtin;

    /// The biped settles near 3 deg; a fall costs ten nominal strides.
    #[test]
    fn the_biped_tells_its_numbers() {
        let mut task = builtin::load("stepping-auto", &["success.psi_roll_within_deg=0.2".into()]).unwrap().task;
        assert_eq!(task.auto.len(), builtin::KEYS.len() - 1);
        assert!(task.tell().unwrap() && !task.tell().unwrap());
        let [low, high] = task.action[0].bounds;
        assert!(low < -0.5 && high > 1.0, "{low} {high}");
        let target = task.target_deg().unwrap();
        assert!((1.0..2.8).contains(&target), "{target}");
        let nominal = crate::nominal::nominal_gait(&task, 1).unwrap();
        assert!((nominal.mean_reward + 0.1).abs() < 0.02, "{}", nominal.mean_reward);
        assert_eq!(task.success.psi_roll_within_deg, Some(0.2), "a number of one's own stays");
        let file = task.to_toml().unwrap();
        assert!(file.contains("told = [") && !file.contains("\"auto\""), "{file}");
    }

    #[test]
    fn auto_is_a_word_only_where_the_robot_can_tell() {
        let error = builtin::load("stepping-auto", &["robot.friction=auto".into()]).unwrap_err().to_string();
        assert!(error.contains("robot.friction"), "{error}");
    }
}
