//! A task whose numbers are those of one gait, scaled to another: by the gaits themselves, without a stride.

use serde::{Deserialize, Serialize};
use stridemap_robot::Side;

use super::Task;

/// The gait for which a task's actions were chosen. A task that says so gets bounds, rates, exploration, units, dither and
/// corrections of its actions in proportion to its own gait: walk and pitch amplitudes by the pitch amplitude, frequencies by
/// the frequency, crouches by the crouch; leans stay. What the guard allows of the pitch rate goes with the frequency, penalties in
/// m/s against it.
///
/// # Example
///
/// ```
/// // Half of the biped's pitch amplitude: half of its A_walk.
/// let sets = ["gait.amplitude_deg.pitch=3.5".to_owned()];
/// let own = stridemap_lab::builtin::load("walking-auto", &sets)?.task;
/// let biped = stridemap_lab::builtin::load("walking", &[])?.task;
/// assert_eq!(own.action[0].bounds, biped.action[0].bounds.map(|a| 0.5 * a));
/// # Ok::<(), stridemap_lab::LabError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaleConfig {
    /// Its pitch amplitude.
    pub pitch_deg: f64,
    /// Its natural frequency.
    pub natural_frequency_rad_s: f64,
    /// Its crouch: half of the knees' flexion at rest.
    pub crouch_deg: f64,
}

impl Task {
    /// Scales what belongs to the actions to the task's own gait, once.
    pub(crate) fn rescale(&mut self) {
        let Some(of) = self.scale.take() else { return };
        let crouch_deg = self.robot.rest_deg.get("knee").map_or(of.crouch_deg, |knee| -0.5 * knee.of(Side::Left));
        let ratio = |modulation: &str| {
            let ratio = match modulation {
                "walk_amplitude_deg" | "pitch_amplitude_deg" | "step_amplitude_deg" => {
                    self.gait.amplitude_deg.pitch / of.pitch_deg
                }
                "natural_frequency_rad_s" => self.gait.natural_frequency_rad_s / of.natural_frequency_rad_s,
                "crouch_deg" => crouch_deg / of.crouch_deg,
                _ => 1.0,
            };
            if ratio.is_finite() && ratio > 0.0 { ratio } else { 1.0 }
        };
        if let Some(feedback) = self.learner.search.as_mut().and_then(|search| search.feedback.as_mut()) {
            let own: Vec<f64> = feedback.modulates.iter().map(|name| ratio(name)).collect();
            feedback.limit.iter_mut().zip(own).for_each(|(limit, ratio)| *limit *= ratio);
        }
        for action in &mut self.action {
            action.scale(ratio(&action.modulates));
        }
        // Rates of change go with the frequency, and speeds, with legs of a pendulum's length, against it.
        let quick = ratio("natural_frequency_rad_s");
        if let Some(caution) = &mut self.caution {
            caution.guard.pitch_rate_change_deg_s = caution.guard.pitch_rate_change_deg_s.map(|rate| quick * rate);
            caution.pessimism.flip_free_deg_s *= quick;
            caution.pessimism.unsafe_penalty /= quick;
            caution.pessimism.flip_penalty /= quick * quick;
        }
    }
}
