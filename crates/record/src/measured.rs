//! What a policy achieved over a batch of strides.

use serde::{Deserialize, Serialize};
use stridemap_process::StrideEnd;

use crate::goals::{RandomGoals, Straightness, Sweep};
use crate::return_line::ReturnMapLine;
use crate::stride::Transition;

/// What a policy achieved over a batch: the numbers of a measured policy.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Performance {
    /// Strides averaged.
    pub strides: usize,
    /// Mean reward over them; a fall scores its own reward.
    pub mean_reward: f64,
    /// Standard deviation of the reward over them, with n − 1; `None` for fewer than two.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reward_sd: Option<f64>,
    /// Mean `ψ_roll` at the section over those that reached one; `None` if none did.
    pub mean_psi_roll_deg: Option<f64>,
    /// The same as a simulator knows it, where the robot only estimates it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub true_mean_psi_roll_deg: Option<f64>,
    /// Falls, among the strides left out of the mean as well.
    pub falls: usize,
    /// Stalls, likewise.
    pub stalls: usize,
    /// Speed on the ground, where the task measures it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub walk: Option<Walk>,
    /// Return map k to k + 1 over all strides, the ones left out of the means as well: they show how the
    /// gait settles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub return_map_1: Option<ReturnMapLine>,
    /// Return map k to k + 2, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub return_map_2: Option<ReturnMapLine>,
    /// How goals drawn at random were followed, in tasks with goals.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub random_goals: Option<RandomGoals>,
    /// How one axis after the other was followed, of the nominal gait and the final policy.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sweep: Option<Sweep>,
    /// A straight walk, likewise.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub straightness: Option<Straightness>,
}

impl Performance {
    /// Sums up a batch, leaving its first `discard` strides out of the means.
    ///
    /// # Example
    ///
    /// ```
    /// let nothing = stridemap_record::Performance::of(&[], 0);
    /// assert_eq!((nothing.strides, nothing.mean_psi_roll_deg), (0, None));
    /// ```
    #[must_use]
    pub fn of(transitions: &[Transition], discard: usize) -> Self {
        let counted = |end| transitions.iter().filter(|t| t.end == end).count();
        let kept = transitions.get(discard..).unwrap_or(&[]);
        let mean = |values: Vec<f64>| {
            let count = values.len();
            (count > 0).then(|| values.into_iter().fold(0.0, |sum, v| sum + v) / count as f64)
        };
        let crossed = || kept.iter().filter(|t| t.end == StrideEnd::Crossing);
        let rewards: Vec<f64> = kept.iter().map(|t| t.reward).collect();
        let Spread { mean: mean_reward, sd: reward_sd } = Spread::of(&rewards);
        let truth: Option<Vec<f64>> = crossed().map(|t| t.true_psi_roll_deg).collect();
        Self {
            true_mean_psi_roll_deg: truth.and_then(mean),
            strides: kept.len(),
            mean_reward,
            reward_sd,
            mean_psi_roll_deg: mean(crossed().map(|t| t.measures.psi_roll_deg).collect()),
            falls: counted(StrideEnd::Fell),
            stalls: counted(StrideEnd::NoCrossing),
            walk: None,
            return_map_1: ReturnMapLine::of(transitions, 1),
            return_map_2: ReturnMapLine::of(transitions, 2),
            random_goals: None,
            sweep: None,
            straightness: None,
        }
    }

    /// Mean `ψ_roll` as one reads it.
    #[must_use]
    pub fn psi_roll(&self) -> String {
        self.mean_psi_roll_deg.map_or_else(
            || "psi_roll unknown: no stride reached the section".into(),
            |mean| format!("psi_roll {mean:.2} deg"),
        )
    }
}

impl Performance {
    /// Whether this is better than `other`: fewer falls and stalls per stride; with as many, a mean reward that
    /// is higher by more than so many standard errors of the difference (as if strides were independent). Where both followed
    /// random goals, fewer falls and then the lower cost.
    ///
    /// # Example
    ///
    /// Means 0.1 apart with standard errors of 0.03 and 0.04: the difference has 0.05.
    ///
    /// ```
    /// use stridemap_record::Performance;
    ///
    /// let of = |mean_reward, sd, falls| Performance {
    ///     strides: 100,
    ///     mean_reward,
    ///     reward_sd: Some(sd),
    ///     falls,
    ///     ..Performance::default()
    /// };
    /// let (a, b) = (of(-0.2, 0.3, 0), of(-0.1, 0.4, 0));
    /// assert!(b.beats(&a, 1.9) && !b.beats(&a, 2.1));
    /// // Falls come first.
    /// assert!(!of(-0.1, 0.4, 1).beats(&a, 0.0) && a.beats(&of(-0.1, 0.4, 1), 2.0));
    /// ```
    #[must_use]
    pub fn beats(&self, other: &Self, standard_errors: f64) -> bool {
        if let (Some(own), Some(others)) = (&self.random_goals, &other.random_goals) {
            // The same goals were asked of both: what they cost is compared as it is.
            return own.falls < others.falls || (own.falls == others.falls && own.cost < others.cost);
        }
        // a / n against b / m, without dividing by nothing.
        let failures = |p: &Self, q: &Self| (p.falls + p.stalls) * q.strides.max(1);
        let variance = |p: &Self| p.reward_sd.unwrap_or(0.0).powi(2) / p.strides.max(1) as f64;
        let (own, others) = (failures(self, other), failures(other, self));
        let margin = standard_errors * (variance(self) + variance(other)).sqrt();
        own < others || (own == others && self.mean_reward > other.mean_reward + margin)
    }
}

/// A measured policy.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Measured {
    /// What was achieved over the strides averaged.
    #[serde(flatten)]
    pub performance: Performance,
    /// Forward speed; null where the task does not measure it.
    pub speed_m_s: Option<f64>,
    /// Time upright, up to 60 s; null where the task does not measure it.
    pub upright_s: Option<f64>,
    /// Way to the left of the first heading; null where the task does not measure it.
    pub drift_m: Option<f64>,
}

impl From<Performance> for Measured {
    fn from(performance: Performance) -> Self {
        let walk = performance.walk;
        Self {
            performance,
            speed_m_s: walk.map(|w| w.speed_m_s),
            upright_s: walk.map(|w| w.upright_s),
            drift_m: walk.map(|w| w.drift_m),
        }
    }
}

/// How long a measured policy walks from stepping on the spot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WalkTimes {
    /// In all: who is still up then has not fallen.
    pub walk_s: f64,
    /// The first part, over which the speed is taken.
    pub speed_s: f64,
}

/// What a walk from stepping on the spot came to.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Walk {
    /// Ground distance along the first heading over the time since the first section, up to the time
    /// asked for, or to the fall if one came before.
    pub speed_m_s: f64,
    /// The same as a simulator knows it, where the robot only estimates its way.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub true_speed_m_s: Option<f64>,
    /// Time upright since the first section, up to the time asked for.
    pub upright_s: f64,
    /// Way to the left of the first heading.
    pub drift_m: f64,
    /// Change of heading, + to the left.
    pub heading_change_deg: f64,
}

impl Walk {
    /// Sums up the strides of the first episode. The way counts as often as it was made on the
    /// ground: the last stride of a fall is left out of it, its time is not.
    ///
    /// # Arguments
    ///
    /// - `transitions` – strides from a fresh start, of which those of episode 0 are looked at.
    /// - `times` – the times asked for; the stride during which one passes is the last that counts.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_record::{Walk, WalkTimes};
    ///
    /// let times = WalkTimes { walk_s: 60.0, speed_s: 30.0 };
    /// assert_eq!(Walk::of(&[], times).speed_m_s, 0.0);
    /// ```
    #[must_use]
    pub fn of(transitions: &[Transition], times: WalkTimes) -> Self {
        let mut walk = Self::default();
        let (mut time_s, mut speed_time_s) = (0.0, 0.0);
        let (mut forward_m, mut true_forward_m) = (0.0, Some(0.0));
        for t in transitions.iter().filter(|t| t.episode == 0) {
            let counts = time_s < times.speed_s;
            time_s += t.measures.duration_s;
            if counts {
                speed_time_s = time_s;
            }
            if t.end == StrideEnd::Crossing {
                if counts {
                    forward_m += t.measures.forward_m;
                    true_forward_m = true_forward_m.zip(t.true_forward_m).map(|(s, m)| s + m);
                }
                walk.drift_m += t.measures.left_m;
                walk.heading_change_deg += t.measures.turn_deg;
            }
        }
        if speed_time_s > 0.0 {
            walk.speed_m_s = forward_m / speed_time_s;
            walk.true_speed_m_s = true_forward_m.map(|m| m / speed_time_s);
        }
        walk.upright_s = time_s.min(times.walk_s);
        walk
    }
}

/// Mean and standard deviation over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Spread {
    /// Mean.
    pub mean: f64,
    /// Standard deviation, with n − 1; null for one seed.
    pub sd: Option<f64>,
}

impl Spread {
    /// Mean and standard deviation of numbers; zero for none.
    ///
    /// # Example
    ///
    /// ```
    /// let s = stridemap_record::Spread::of(&[1.0, 2.0, 3.0]);
    /// assert_eq!((s.mean, s.sd), (2.0, Some(1.0)));
    /// ```
    #[must_use]
    pub fn of(values: &[f64]) -> Self {
        let n = values.len() as f64;
        let mean = if values.is_empty() { 0.0 } else { values.iter().sum::<f64>() / n };
        let squares: f64 = values.iter().map(|v| (v - mean).powi(2)).sum();
        Self { mean, sd: (values.len() > 1).then(|| (squares / (n - 1.0)).sqrt()) }
    }
}

/// One point of two learning curves, over seeds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ComparePoint {
    /// Trials learned; 0 is before any.
    pub trial: usize,
    /// Learned in the Gaussian-process map.
    pub gp: Spread,
    /// Learned on the robot itself.
    pub full: Spread,
    /// Two-sided Student's t-test of equal means, pooled variance; null where undefined.
    pub p_value: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stride::{StrideMeasures, StridePhase, StrideRole};

    fn stride(end: StrideEnd) -> Transition {
        Transition {
            iteration: 1,
            phase: StridePhase::Record,
            role: StrideRole::Record,
            episode: 0,
            k: 0,
            time_s: 0.0,
            stance: None,
            state: smallvec::smallvec![0.0],
            last_action: smallvec::smallvec![0.0],
            action: smallvec::smallvec![0.0],
            goal: Default::default(),
            next_state: smallvec::smallvec![0.0],
            reward: 0.0,
            end,
            fall: None,
            true_psi_roll_deg: None,
            true_forward_m: None,
            measures: StrideMeasures {
                duration_s: 0.5,
                forward_m: 0.2,
                left_m: -0.01,
                turn_deg: 1.0,
                ..Default::default()
            },
        }
    }

    /// Three strides of 0.2 m in 0.5 s are 0.4 m/s; with a fall after them 0.6 m in 2 s are 0.3 m/s.
    #[test]
    fn speed_is_distance_over_time_to_the_fall() {
        let mut strides = vec![stride(StrideEnd::Crossing); 3];
        let asked = |walk_s, speed_s| WalkTimes { walk_s, speed_s };
        let walk = Walk::of(&strides, asked(60.0, 60.0));
        assert!((walk.speed_m_s - 0.4).abs() < 1e-12 && (walk.upright_s - 1.5).abs() < 1e-12);
        assert!((walk.drift_m + 0.03).abs() < 1e-12);
        assert!((walk.heading_change_deg - 3.0).abs() < 1e-12);
        assert_eq!(walk.true_speed_m_s, None);
        // Over the first 0.8 s: the stride in which they pass is the last that counts.
        strides[2].measures.forward_m = 9.0;
        let first = Walk::of(&strides, asked(60.0, 0.8));
        assert!((first.speed_m_s - 0.4).abs() < 1e-12 && (first.upright_s - 1.5).abs() < 1e-12);
        strides[2].measures.forward_m = 0.2;
        strides.push(stride(StrideEnd::Fell));
        let fell = Walk::of(&strides, asked(60.0, 60.0));
        assert!((fell.speed_m_s - 0.3).abs() < 1e-12 && (fell.upright_s - 2.0).abs() < 1e-12);
        assert!((Walk::of(&strides, asked(1.0, 1.0)).upright_s - 1.0).abs() < 1e-12);
        // The simulator's way, where it knows every stride's.
        strides.iter_mut().for_each(|s| s.true_forward_m = Some(0.1));
        let known = Walk::of(&strides, asked(60.0, 60.0));
        assert!((known.true_speed_m_s.unwrap() - 0.15).abs() < 1e-12);
    }
}
