//! Tasks in the robot's own units: what a file leaves to the robot (`"auto"`) is read off its nominal gait and a careful ramp.

mod explore;

use stridemap_process::{StrideEnd, StrideProcess};

use crate::error::{Invalid, LabError};
use crate::nominal::{NominalGait, nominal_gait};
use crate::plant::Plant;
use crate::reward::RewardQuantity;
use crate::seed::{Role, stream};
use crate::state::StateComponent;
use crate::stepping::{GaitVerdict, Stepping, mean, spread};
use crate::task::Task;

/// Seed of what is asked of the robot: a task has one set of numbers, whatever the seed of the run.
const SEED: u64 = 1;
/// Strides for which a ramp holds a value; twice as many where the nominal gait's `psi_roll` spreads by more than this.
const HELD: usize = 6;
const HELD_LONGER_FROM_DEG: f64 = 0.2;
/// First of them that are not averaged: the way from the value before.
const SETTLING: usize = 2;
/// Steps of a ramp to its furthest value, either way.
const STEPS: [usize; 2] = [4, 10];
/// A step of the ramp, as a share of the nominal gait's pitch amplitude.
const STEP_SHARE: f64 = 0.08;
/// A tilt so far beyond the nominal gait's greatest is a warning.
const TILT_DEG: f64 = 4.0;
/// A stride so many times as long, or as short, as a nominal one is a warning.
const LONGER: f64 = 1.4;
/// Standard deviations of the nominal gait's `psi_roll` that a target must be away from it.
const CLEARLY: f64 = 1.5;
/// Share of what a ramp reached that is asked of a policy.
const ASKED: f64 = 0.6;
/// Where irregular strides would keep more than this share of the nominal gait's loss at such a target, it is put where they
/// keep least.
const KEPT: f64 = 0.1;
/// From this spread on, as a share of the way to the target, twice as many strides are made.
const IRREGULAR: f64 = 0.2;

/// One value of a ramp, held for some strides.
#[derive(Clone, Copy, Debug, PartialEq)]
struct RampStep {
    /// The action's value.
    value: f64,
    /// Mean `psi_roll` at the section in the last strides.
    psi_roll_deg: f64,
    /// Standard deviation of that.
    spread_deg: f64,
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
    let held = held(nominal);
    for k in 0..=steps {
        let value = neutral + step * k as f64;
        let mut seen = Vec::with_capacity(held);
        for _ in 0..held {
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
        let last = &seen[SETTLING..];
        let extreme = |pick: fn(f64, f64) -> f64| seen.iter().copied().reduce(pick).unwrap_or(0.0);
        out.steps.push(RampStep {
            value,
            psi_roll_deg: mean(last),
            spread_deg: spread(last),
            passed_deg: [extreme(f64::min), extreme(f64::max)],
        });
    }
    Ok(out)
}

/// Strides for which a ramp holds a value.
fn held(nominal: &Stepping) -> usize {
    if nominal.psi_roll_spread_deg > HELD_LONGER_FROM_DEG { 2 * HELD } else { HELD }
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
        let key = self.auto[0].clone();
        if self.link.is_some() {
            return Err(refuse(&key, "\"auto\" is for a simulated robot; give a number".into()));
        }
        let gait = self.stepping_gait(&key)?;
        self.tell_falls(&gait);
        if self.auto.iter().any(|key| !FALLS.contains(&key.as_str())) {
            if self.action.len() > 1 { self.tell_exploration()? } else { self.tell_ramp(&key, &gait)? }
        }
        self.auto.clear();
        self.validate()?;
        Ok(true)
    }

    /// Within bounds whatever stands where the robot is to tell it.
    pub(crate) fn fit_stand_ins(&mut self) {
        for (i, action) in self.action.iter_mut().enumerate() {
            let [low, high] = action.bounds;
            if self.auto.iter().any(|key| *key == format!("action.{i}.explore.center")) {
                action.explore.center = [low, high];
            }
            if self.auto.iter().any(|key| *key == format!("action.{i}.explore.std")) {
                action.explore.std = 0.01 * (high - low);
            }
        }
    }

    /// The nominal gait, if it steps.
    fn stepping_gait(&self, key: &str) -> Result<NominalGait, LabError> {
        let gait = nominal_gait(self, SEED)?;
        if gait.verdict() == GaitVerdict::Steps {
            return Ok(gait);
        }
        let how = if gait.fell.is_some() { "falls" } else { "only shuffles" };
        let why = format!("is read off the nominal gait, which {how}: `stridemap tune FILE` searches one that steps");
        Err(refuse(key, why))
    }

    /// Thresholds of a fall that any body passes only when it is down, from what the nominal gait passed. Those of `stepping`
    /// follow for the biped.
    fn tell_falls(&mut self, gait: &NominalGait) {
        let s = &gait.stepping;
        let numbers = [
            (FALLS[0], rounded(0.77 * gait.least_height), format!("the nominal gait keeps {:.2}", gait.least_height)),
            (FALLS[1], rounded((s.tilt_deg + 40.0).min(60.0)), format!("the nominal gait tilts by {:.1}", s.tilt_deg)),
            (
                FALLS[2],
                rounded((4.0 * s.stride_s).max(1.5 * gait.longest_wait_s)),
                format!("a stride takes {:.2}", s.stride_s),
            ),
        ];
        for ((key, number, why), place) in numbers.into_iter().zip([
            &mut self.failure.com_height_below,
            &mut self.failure.tilt_above_deg,
            &mut self.failure.no_section_s,
        ]) {
            if self.auto.iter().any(|asked| asked == key) {
                *place = number;
                self.told.push(format!("{key} = {number}: {why}"));
            }
        }
    }

    /// What is read off a ramp of the one action of a task about `psi_roll`.
    fn tell_ramp(&mut self, key: &str, gait: &NominalGait) -> Result<(), LabError> {
        let rewards_psi = self.reward[0].quantity == RewardQuantity::PSI_ROLL_SQUARED_ERROR;
        let asks_reward = self.auto.iter().any(|key| key.starts_with("reward."));
        if self.action.len() != 1 || self.state != [StateComponent::PSI_ROLL_DEG] || (asks_reward && !rewards_psi) {
            let why = "\"auto\" is for tasks with one action, psi_roll_deg as the state and its error as the reward; give a number";
            return Err(refuse(key, why.into()));
        }
        let step = STEP_SHARE * self.gait.amplitude_deg.pitch;
        let mut wide = self.clone();
        let reach = [-step * (STEPS[0] as f64 + 1.0), step * (STEPS[1] as f64 + 1.0)];
        wide.action[0].bounds = reach;
        let [down, up] =
            [ramp(&wide, &gait.stepping, -step, STEPS[0], SEED)?, ramp(&wide, &gait.stepping, step, STEPS[1], SEED)?];
        let measured = Measured::of(&gait.stepping, [down, up]).map_err(|found| {
            refuse(
                key,
                format!(
                    "is \"auto\", and no step of the ramp moves psi_roll clearly ({found}); `stridemap tune FILE --seed N` may find a \
                     more regular gait, or give numbers: action.0.bounds, reward.0.target_deg, reward.0.weight"
                ),
            )
        })?;
        measured.fill(self);
        Ok(())
    }
}

/// Keys of the thresholds of a fall.
const FALLS: [&str; 3] = ["failure.com_height_below", "failure.tilt_above_deg", "failure.no_section_s"];

fn refuse(key: &str, requirement: String) -> LabError {
    LabError::Invalid(Invalid { key: key.into(), requirement })
}

/// What was read off the robot.
struct Measured {
    /// Nominal `psi_roll` and its spread.
    psi_deg: f64,
    spread_deg: f64,
    target_deg: f64,
    /// How far the target is from nominal.
    unit_deg: f64,
    /// Strides for which the ramp held a value.
    held: usize,
    bounds: [f64; 2],
    passed_deg: [f64; 2],
    ramps: [Ramp; 2],
}

impl Measured {
    /// What the ramps show; in words, where that is not enough.
    fn of(nominal: &Stepping, ramps: [Ramp; 2]) -> Result<Self, String> {
        let (psi_deg, spread_deg) = (nominal.psi_roll_deg, nominal.psi_roll_spread_deg);
        let ended = |ramp: &Ramp| ramp.warning.clone().unwrap_or_else(|| "its end".into());
        let [below, above] = [ended(&ramps[0]), ended(&ramps[1])];
        let steps = || ramps.iter().flat_map(|ramp| &ramp.steps);
        if steps().next().is_none() {
            return Err(format!("the nominal gait itself gave a warning: {above}"));
        }
        let bounds =
            [0.9 * steps().map(|s| s.value).fold(0.0, f64::min), 0.9 * steps().map(|s| s.value).fold(0.0, f64::max)];
        let low = steps().map(|s| s.psi_roll_deg - psi_deg).fold(0.0, f64::min);
        let high = steps().map(|s| s.psi_roll_deg - psi_deg).fold(0.0, f64::max);
        // Nearer to over the stance foot, as in the paper, unless hardly anything leads there.
        let reach = if -low >= 0.5 * high { low } else { high };
        let away = Self::well_told(psi_deg, spread_deg, &ramps, &bounds, ASKED * reach);
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
            held: held(nominal),
            bounds: bounds.map(rounded),
            passed_deg: [
                steps().map(|s| s.passed_deg[0]).fold(f64::INFINITY, f64::min),
                steps().map(|s| s.passed_deg[1]).fold(f64::NEG_INFINITY, f64::max),
            ],
            ramps,
        })
    }

    /// How far from nominal to ask for: as far as is wanted, or, where irregular strides would keep much of the loss there, as
    /// far as the step of the ramp where they keep the least: `s^2 / (d^2 + s0^2)`, with d the way to it and s, s0 the spreads
    /// there and nominal.
    fn well_told(psi_deg: f64, spread_deg: f64, ramps: &[Ramp; 2], bounds: &[f64; 2], wanted: f64) -> f64 {
        let told = |ramp: &Ramp| -> Vec<(f64, f64)> {
            let square = |i: usize| ramp.steps.get(i).map(|step| step.spread_deg * step.spread_deg);
            (1..ramp.steps.len())
                .filter(|&i| (bounds[0]..=bounds[1]).contains(&ramp.steps[i].value))
                .map(|i| {
                    // With its neighbours: the spread of some strides is not well known.
                    let near: Vec<f64> = [i - 1, i, i + 1].into_iter().filter_map(square).collect();
                    let away = ramp.steps[i].psi_roll_deg - psi_deg;
                    (away, mean(&near) / (away * away + spread_deg * spread_deg).max(1e-12))
                })
                .collect()
        };
        let all: Vec<(f64, f64)> = ramps.iter().flat_map(told).collect();
        let near = all.iter().min_by(|a, b| (a.0 - wanted).abs().total_cmp(&(b.0 - wanted).abs()));
        if near.is_none_or(|(_, kept)| *kept <= KEPT) {
            return wanted;
        }
        all.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)).map_or(wanted, |(away, _)| away)
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
                "action.0.bounds = [{low}, {high}]: nine tenths of a ramp in steps of {} strides that ended at {} below and \
                 {} above",
                self.held,
                end(&self.ramps[0]),
                end(&self.ramps[1])
            ));
        }
        if on("reward.0.target_deg") {
            task.reward[0].target_deg = Some(self.target_deg);
            told.push(format!(
                "reward.0.target_deg = {}: from the nominal gait's {:.3} (spread {:.3}) {:.0} % of the way to what the ramp reached, \
                 or less or the other way where strides there are too irregular",
                self.target_deg,
                self.psi_deg,
                self.spread_deg,
                100.0 * ASKED
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
        if self.spread_deg > IRREGULAR * unit && on("collect.strides") {
            task.collect.strides.iter_mut().for_each(|strides| *strides *= 2);
            told.push(format!(
                "collect.strides = {:?}: the nominal gait's strides are irregular",
                task.collect.strides
            ));
        }
        if self.spread_deg > IRREGULAR * unit && on("algorithm.evaluation_strides") {
            task.algorithm.evaluation_strides *= 2;
            told.push(format!(
                "algorithm.evaluation_strides = {}: for the same reason",
                task.algorithm.evaluation_strides
            ));
        }
        told.push(format!(
            "exploration, ranges of the map and units of the learner: those of `stepping` for {unit:.3} deg instead of 1 and \
             bounds {range:.3} apart instead of 6.5"
        ));
        task.told.extend(told);
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
