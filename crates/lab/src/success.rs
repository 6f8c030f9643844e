//! When a run counts as a success, and what it lacks.

use crate::reward::RewardQuantity;
use crate::task::Task;
use stridemap_record::Performance;

impl Task {
    /// Whether the reward is the speed and nothing else, so that it reads in m/s.
    #[must_use]
    pub fn rewards_speed(&self) -> bool {
        matches!(&self.reward[..], [term] if term.quantity == RewardQuantity::SPEED_M_S
            && (term.weight - 1.0).abs() < 1e-12)
    }

    /// Whether a measured policy, found with these strides and falls on the robot, is a success.
    #[must_use]
    pub fn is_success(&self, measured: &Performance, strides: usize, falls: usize) -> bool {
        self.shortfalls(measured, strides, falls).is_empty()
    }

    /// What a measured policy, found with these strides and falls on the robot, lacks of a success: each
    /// criterion with its value and limit, in words.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_lab::builtin;
    /// use stridemap_record::Performance;
    ///
    /// let task = builtin::load("stepping", &[])?.task;
    /// let measured = Performance { mean_psi_roll_deg: Some(2.5), ..Performance::of(&[], 0) };
    /// assert_eq!(
    ///     task.shortfalls(&Performance { mean_reward: 0.0, ..measured }, 60, 0),
    ///     ["psi_roll is 0.50 deg from its target of 2, at most 0.12 (psi_roll_within_deg)"]
    /// );
    /// # Ok::<(), stridemap_lab::LabError>(())
    /// ```
    #[must_use]
    pub fn shortfalls(&self, measured: &Performance, strides: usize, falls: usize) -> Vec<String> {
        let s = &self.success;
        let mut lacks = Vec::new();
        let mean = measured.mean_reward;
        // (A mean that is not a number is no success.)
        if mean.is_nan() || s.mean_reward_at_least.is_some_and(|least| mean < least) {
            let least = s.mean_reward_at_least.map_or("a number".into(), |least| format!("at least {least}"));
            lacks.push(format!("mean reward is {mean:+.5}, {least} (mean_reward_at_least)"));
        }
        if let (Some(within), Some(target)) = (s.psi_roll_within_deg, self.target_deg()) {
            match measured.mean_psi_roll_deg.map(|mean| (mean - target).abs()) {
                None => lacks.push(format!("{} (psi_roll_within_deg)", measured.psi_roll())),
                Some(off) if off.is_nan() || off > within => lacks.push(format!(
                    "psi_roll is {off:.2} deg from its target of {target}, at most {within} (psi_roll_within_deg)"
                )),
                Some(_) => {}
            }
        }
        match (s.speed_m_s_at_least, measured.walk) {
            (Some(least), Some(walk)) if walk.speed_m_s.is_nan() || walk.speed_m_s < least => {
                lacks.push(format!("speed is {:.3} m/s, at least {least} (speed_m_s_at_least)", walk.speed_m_s));
            }
            // A walk that does not fall (below) or stall goes on for as long as it was asked to.
            (Some(_), Some(_)) if measured.stalls > 0 => {
                lacks.push(format!("{} stalls while measured, at most 0", measured.stalls));
            }
            (Some(least), None) => lacks
                .push(format!("no speed is measured, at least {least} m/s (speed_m_s_at_least); give record.walk_s")),
            _ => {}
        }
        if measured.falls > 0 {
            lacks.push(format!("{} falls while measured, at most 0", measured.falls));
        }
        if falls > s.falls_at_most {
            let most = s.falls_at_most;
            lacks.push(format!("{falls} falls while learning, at most {most} (falls_at_most)"));
        }
        if strides > s.strides_at_most {
            let most = s.strides_at_most;
            lacks.push(format!("{strides} strides on the robot, at most {most} (strides_at_most)"));
        }
        lacks
    }
}
