//! The components of the action: all that a task says of one stands in its `[[action]]`.

use serde::{Deserialize, Serialize};
use stridemap_config::Components;
use stridemap_learn::ActionRole;

use crate::dither::Dither;
use crate::error::{LabError, unless};
use crate::strides::{ActionSource, Exploration, ExploreRange};
use crate::task::Task;

/// How the entries of `[[action]]` inherit, and where earlier versions had a list with a value per component.
pub(crate) const COMPONENTS: Components<'_> = Components {
    key: "action",
    name: "modulates",
    own: &["rate_per_stride", "gain"],
    moved: &[
        ("learner.actor_critic.action_unit", "output_unit"),
        ("caution.trust.unit", "unit"),
        ("collect.explore.center", "explore.center"),
        ("collect.explore.std", "explore.std"),
        ("collect.later_noise_std", "later_noise_std"),
        ("learner.actor_critic.mean_weight_limit", "mean_weight_limit"),
        ("caution.proof.dither_std", "dither_std"),
        ("caution.proof.back_off", "back_off"),
    ],
};

/// Standard deviation of exploration about its centre where a file does not say it, in units.
const EXPLORE_STD_UNITS: f64 = 0.15;

/// One component of the action.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "ActionFile")]
pub struct ActionConfig {
    /// The gait's modulation that it sets, by name; its own unit, that of all lengths here, is in the name.
    pub modulates: String,
    /// Smallest and largest value, on the robot and in the map.
    pub bounds: [f64; 2],
    /// Largest change from one stride to the next; no limit if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rate_per_stride: Option<f64>,
    /// Share of the way to the wanted value that is gone in one stride, in (0, 1].
    pub gain: f64,
    /// What counts as one step of it: the trust region, searches and feedback reckon in these. Left out: `output_unit`.
    pub unit: f64,
    /// How much of it output 1 of the actor-critic is; left out: `unit`.
    pub output_unit: f64,
    /// Bound on every mean weight of the actor-critic; no bound if left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_weight_limit: Option<f64>,
    /// Standard deviation of normal noise added to what the policy draws from the second iteration on; left out: 0.
    pub later_noise_std: f64,
    /// Standard deviation of what is added to the policy's value during the trial of a proof: a map needs to see actions vary
    /// to know what they do. Left out: nothing is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dither_std: Option<f64>,
    /// What is taken from the proven value while backing off after a warning; left out: 0.
    pub back_off: f64,
    /// How the first batch explores it.
    pub explore: ExploreRange,
    /// Whether it follows the goal from stride to stride, or is a constant of the robot that is chosen with the map.
    #[serde(skip_serializing_if = "is_command")]
    pub role: ActionRole,
}

fn is_command(role: &ActionRole) -> bool {
    *role == ActionRole::Command
}

/// What a file says of a component.
#[derive(Deserialize)]
struct ActionFile {
    modulates: String,
    bounds: [f64; 2],
    rate_per_stride: Option<f64>,
    gain: Option<f64>,
    unit: Option<f64>,
    output_unit: Option<f64>,
    mean_weight_limit: Option<f64>,
    later_noise_std: Option<f64>,
    dither_std: Option<f64>,
    back_off: Option<f64>,
    explore: ExploreFile,
    role: Option<ActionRole>,
}

#[derive(Deserialize)]
struct ExploreFile {
    center: [f64; 2],
    std: Option<f64>,
}

impl TryFrom<ActionFile> for ActionConfig {
    type Error = &'static str;

    fn try_from(file: ActionFile) -> Result<Self, Self::Error> {
        let unit = file.unit.or(file.output_unit).ok_or("needs a `unit`: how much of it counts as one step")?;
        let std = file.explore.std.unwrap_or(EXPLORE_STD_UNITS * unit);
        Ok(Self {
            modulates: file.modulates,
            bounds: file.bounds,
            rate_per_stride: file.rate_per_stride,
            gain: file.gain.unwrap_or(1.0),
            unit,
            output_unit: file.output_unit.unwrap_or(unit),
            mean_weight_limit: file.mean_weight_limit,
            later_noise_std: file.later_noise_std.unwrap_or(0.0),
            dither_std: file.dither_std,
            back_off: file.back_off.unwrap_or(0.0),
            explore: ExploreRange { center: file.explore.center, std },
            role: file.role.unwrap_or_default(),
        })
    }
}

impl ActionConfig {
    /// Checks what the types and the gait cannot; `at` is its place in the list.
    pub(super) fn check(&self, at: usize) -> Result<(), LabError> {
        let key = |name: &str| format!("action.{at}.{name}");
        let [low, high] = self.explore.center;
        unless(low <= high, key("explore.center"), format!("[{low}, {high}] must be finite and in order"))?;
        unless(self.gain > 0.0 && self.gain <= 1.0, key("gain"), "must lie in (0, 1]")?;
        for (name, value, positive) in [
            ("rate_per_stride", self.rate_per_stride, true),
            ("unit", Some(self.unit), true),
            ("output_unit", Some(self.output_unit), true),
            ("mean_weight_limit", self.mean_weight_limit, true),
            ("explore.std", Some(self.explore.std), false),
            ("later_noise_std", Some(self.later_noise_std), false),
            ("dither_std", self.dither_std, false),
        ] {
            let fits = value.is_none_or(|v| v > 0.0 || (!positive && v >= 0.0));
            let must = if positive { "positive" } else { "not negative" };
            unless(fits, key(name), format!("is {}, must be {must}", value.unwrap_or_default()))?;
        }
        Ok(())
    }

    /// Multiplies everything that has the component's unit, but for what belongs to the learner's network alone.
    pub(super) fn scale(&mut self, ratio: f64) {
        self.bounds = self.bounds.map(|bound| ratio * bound);
        self.explore.center = self.explore.center.map(|end| ratio * end);
        let optional = self.rate_per_stride.iter_mut().chain(&mut self.dither_std);
        let given = [
            &mut self.unit,
            &mut self.output_unit,
            &mut self.explore.std,
            &mut self.later_noise_std,
            &mut self.back_off,
        ];
        optional.chain(given).for_each(|value| *value *= ratio);
    }
}

impl Task {
    /// What of each component of the action.
    pub(crate) fn of_each(&self, what: impl Fn(&ActionConfig) -> f64) -> Vec<f64> {
        self.action.iter().map(what).collect()
    }

    /// How the first batch explores.
    #[must_use]
    pub fn exploration(&self) -> Exploration {
        Exploration { ranges: self.action.iter().map(|a| a.explore).collect(), hold: self.collect.explore.hold }
    }

    /// Noise about a policy that follows goals. In the first batch commands that the goal names are what the policy asks for,
    /// and all else moves about its own centre; later everything is what the policy asks for.
    ///
    /// # Arguments
    ///
    /// - `neutral` – of each component, in the first batch.
    /// - `constants` – whether the robot's constants are explored.
    pub(crate) fn dither(&self, neutral: Option<&[f64]>, constants: bool) -> Dither {
        let explore = self.collect.explore;
        let moves = |a: &ActionConfig| constants || a.role == ActionRole::Command;
        let followed = |a: &ActionConfig| self.goal.iter().any(|g| g.command.as_ref() == Some(&a.modulates));
        let of = |j: usize, a: &ActionConfig| {
            let own = moves(a) && !followed(a);
            neutral.filter(|_| own).map(|neutral| (a.explore.center, neutral[j]))
        };
        let std = |a: &ActionConfig| match neutral {
            Some(_) => a.explore.std,
            None => a.later_noise_std,
        };
        Dither {
            std: self.of_each(|a| if moves(a) { std(a) } else { 0.0 }),
            centre: self.action.iter().enumerate().map(|(j, a)| of(j, a)).collect(),
            hold: explore.hold,
            memory: explore.memory.unwrap_or(0.0),
            fade_in: if neutral.is_some() { explore.fade_in.unwrap_or(0) } else { 0 },
        }
    }

    /// How it explores first: in its own ranges, or around the policy from which it begins, a quarter as far.
    pub(crate) fn first_exploration(&self) -> ActionSource<'_> {
        const SHARE: f64 = 0.25;
        let mut explore = self.exploration();
        let Some(proven) = &self.proven else { return ActionSource::Explore(explore) };
        for range in &mut explore.ranges {
            let half = 0.5 * SHARE * (range.center[1] - range.center[0]);
            range.center = [-half, half];
        }
        ActionSource::Around(proven, explore)
    }

    /// Standard deviations of what is added to a policy's action during a trial; nothing, not even zeros, without any.
    pub(crate) fn dither_std(&self) -> Vec<f64> {
        let any = self.action.iter().any(|a| a.dither_std.is_some());
        if any { self.of_each(|a| a.dither_std.unwrap_or(0.0)) } else { Vec::new() }
    }
}
