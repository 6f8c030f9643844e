//! How far a task of several actions may explore: as far as a careful ramp came before the guard's first warning.

use stridemap_process::{StrideEnd, StrideProcess};

use super::{HELD, SEED, rounded};
use crate::error::LabError;
use crate::guard::Guard;
use crate::seed::{Role, stream};
use crate::task::Task;

/// A step of the ramp, as a share of the way from the neutral action to its farther bounds.
const STEP_SHARE: f64 = 0.05;
/// Its end: about as far as `walking` explores on the biped.
const MOST_SHARE: f64 = 0.65;
/// Share of what was reached that is explored: components then move each by themselves.
const EXPLORED: f64 = 0.75;
/// Standard deviation of each draw, as a share of the range explored.
const NOISE: f64 = 0.04;
/// What makes the robot walk.
const WALK: &str = "walk_amplitude_deg";

impl Task {
    /// Exploration of a task of several actions: from the neutral action towards the farther bounds, as far as the guard lets
    /// the robot go with all of them together; the walk amplitude half of the way to where it comes alone.
    pub(super) fn tell_exploration(&mut self) -> Result<(), LabError> {
        let limits = self.action_limits()?;
        let neutral: Vec<f64> = limits.iter().map(|l| l.neutral).collect();
        let way: Vec<f64> = limits
            .iter()
            .map(|l| if l.upper - l.neutral >= l.neutral - l.lower { l.upper } else { l.lower } - l.neutral)
            .collect();
        let walks: Vec<bool> = self.action.iter().map(|action| action.modulates == WALK).collect();
        let alone: Vec<f64> = (0..way.len()).map(|i| if walks[i] { way[i] } else { 0.0 }).collect();
        let (together, why) = self.guarded_ramp(&neutral, &way)?;
        let (mut walk, mut said) = (together, String::new());
        if alone.iter().any(|w| w.abs() > 0.0) {
            let (share, why) = self.guarded_ramp(&neutral, &alone)?;
            walk = 0.5 * (walk + share);
            said = format!(", {WALK} alone to {:.0} % ({why})", 100.0 * share);
        }
        for i in 0..way.len() {
            let far = neutral[i] + EXPLORED * if walks[i] { walk } else { together } * way[i];
            let center = [rounded(neutral[i].min(far)), rounded(neutral[i].max(far))];
            let on = |what: &str| self.auto.iter().any(|asked| *asked == format!("action.{i}.explore.{what}"));
            let (centers, stds) = (on("center"), on("std"));
            if stds {
                self.action[i].explore.std = rounded(NOISE * (center[1] - center[0])).max(1e-6);
            }
            if centers {
                self.action[i].explore.center = center;
            }
        }
        self.told.push(format!(
            "explore of each action: {:.0} % of a ramp in steps of {HELD} strides, all actions together to {:.0} % of the way to \
             their bounds ({why}){said}",
            100.0 * EXPLORED,
            100.0 * together
        ));
        Ok(())
    }

    /// The share of a way that the robot went, and why it went no farther.
    fn guarded_ramp(&self, neutral: &[f64], way: &[f64]) -> Result<(f64, String), LabError> {
        let mut plant = self.plant()?;
        let mut rng = stream(SEED, Role::Check, 22);
        plant.reset(&mut rng)?;
        let mut guard = self.caution.as_ref().map(|caution| {
            let thresholds = caution.guard.thresholds(plant.in_place(), 0.0);
            Guard::new(&caution.guard, thresholds.exploring(caution.guard.exploring_factor))
        });
        let mut share = STEP_SHARE;
        while share <= MOST_SHARE + 1e-9 {
            let action: Vec<f64> = neutral.iter().zip(way).map(|(n, w)| n + share * w).collect();
            for _ in 0..HELD {
                let end = plant.stride(&action, &mut rng)?.end;
                let warning = guard.as_mut().and_then(|guard| guard.watch(plant.last_measures()));
                let why = match (end, warning) {
                    (StrideEnd::Crossing, None) => continue,
                    (StrideEnd::Crossing, Some(warning)) => format!("the guard warned: {}", warning.name()),
                    _ => plant.last_fall().map_or_else(|| "it stopped".into(), |fall| fall.to_string()),
                };
                return Ok(((share - STEP_SHARE).max(0.5 * STEP_SHARE), why));
            }
            share += STEP_SHARE;
        }
        Ok((MOST_SHARE, "its end".into()))
    }
}
