//! How far a policy may go from what was tried or proven.
//!
//! A map measures the robot where its data are and knows nothing of the cliff beyond. So the first
//! policy stays in the box of the actions tried, a margin wider; later ones stay within a radius about
//! the best proven action, which grows with each success and shrinks with each failure.

use serde::{Deserialize, Serialize};
use stridemap_process::ActionLimits;
use stridemap_record::{Proof, Region, Verdict};

/// Parameters of the trust region.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrustConfig {
    /// How far the first policy may leave the box of the actions tried, in the components' units.
    pub first_margin: f64,
    /// Radius about the best proven action, in units, before any success or failure.
    pub radius: f64,
    /// The radius grows by this factor when a policy is proven to be faster.
    pub grow: f64,
    /// The radius shrinks by this factor when a policy is not.
    pub shrink: f64,
}

impl TrustConfig {
    /// The region of the next policy: within the limits; about the best proven action, or without one
    /// about the actions tried.
    ///
    /// # Arguments
    ///
    /// - `unit` – what counts as one unit, per component of the action.
    /// - `tried` – lowest and highest action tried, per component; at least the neutral ones.
    /// - `proofs` – what became of the policies so far, in their order.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_lab::TrustConfig;
    /// use stridemap_process::ActionLimits;
    ///
    /// let config = TrustConfig { first_margin: 0.1, radius: 0.5, grow: 1.15, shrink: 0.7 };
    /// let limits = ActionLimits {
    ///     lower: 0.0,
    ///     upper: 12.0,
    ///     rate_per_stride: 0.8,
    ///     gain: 1.0,
    ///     neutral: 0.0,
    /// };
    /// let region = config.region(&[limits], &[2.0], &[[0.0, 6.0]], &[]);
    /// assert_eq!((region.lower[0], region.upper[0]), (0.0, 6.2));
    /// ```
    #[must_use]
    pub fn region(&self, limits: &[ActionLimits], unit: &[f64], tried: &[[f64; 2]], proofs: &[&Proof]) -> Region {
        let best = Proof::best(proofs);
        let radius = proofs.iter().enumerate().fold(self.radius, |radius, (i, p)| {
            let before = Proof::best(&proofs[..i]).map(|b| proofs[b].speed_m_s);
            match (p.verdict, before) {
                // The first success sets the centre; it says nothing of the radius.
                (Verdict::Proven, None) => radius,
                (Verdict::Proven, Some(speed)) if p.speed_m_s > speed => radius * self.grow,
                (_, None) => radius,
                _ => radius * self.shrink,
            }
        });
        let range = |i: usize| match best {
            Some(b) => {
                let reach = radius * unit[i];
                [proofs[b].action[i] - reach, proofs[b].action[i] + reach]
            }
            None => {
                // Nothing proven and something failed: the box shrinks towards the nominal gait.
                let margin = self.first_margin * unit[i];
                let neutral = limits[i].neutral;
                let share = self.shrink.powi(proofs.len() as i32);
                [tried[i][0] - margin, tried[i][1] + margin].map(|edge| neutral + share * (edge - neutral))
            }
        };
        let within = |i: usize, v: f64| v.clamp(limits[i].lower, limits[i].upper);
        Region {
            lower: (0..limits.len()).map(|i| within(i, range(i)[0])).collect(),
            upper: (0..limits.len()).map(|i| within(i, range(i)[1])).collect(),
        }
    }

    /// The fixed region of a search on the robot that has no centre of its own: the actions that the
    /// first batch would explore, a radius wider.
    #[must_use]
    pub fn searched(&self, limits: &[ActionLimits], unit: &[f64], tried: &[[f64; 2]]) -> Region {
        let edge = |i: usize, v: f64| v.clamp(limits[i].lower, limits[i].upper);
        let reach = |i: usize| self.radius * unit[i];
        let all = 0..limits.len();
        Region {
            lower: all.clone().map(|i| edge(i, tried[i][0] - reach(i))).collect(),
            upper: all.map(|i| edge(i, tried[i][1] + reach(i))).collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn proof(verdict: Verdict, speed_m_s: f64, action: f64) -> Proof {
        Proof { verdict, warning: None, speed_m_s, strides: 60, attempts: 1, action: vec![action] }
    }

    #[test]
    fn the_region_follows_the_best_proven_action_and_breathes() {
        let config = TrustConfig { first_margin: 0.1, radius: 0.5, grow: 1.2, shrink: 0.5 };
        let limits = [ActionLimits { lower: 0.0, upper: 12.0, rate_per_stride: 1.0, gain: 1.0, neutral: 0.0 }];
        let upper = |proofs: &[Proof]| {
            let list: Vec<&Proof> = proofs.iter().collect();
            config.region(&limits, &[2.0], &[[0.0, 6.0]], &list).upper[0]
        };
        let first = proof(Verdict::Proven, 0.3, 6.0);
        let faster = proof(Verdict::Proven, 0.4, 7.0);
        let warned = proof(Verdict::Warned, 0.5, 8.0);
        assert!((upper(std::slice::from_ref(&warned)) - 3.1).abs() < 1e-12);
        assert!((upper(std::slice::from_ref(&first)) - 7.0).abs() < 1e-12);
        assert!((upper(&[first.clone(), faster.clone()]) - 8.2).abs() < 1e-12);
        assert!((upper(&[first, faster, warned]) - 7.6).abs() < 1e-12);
    }
}
