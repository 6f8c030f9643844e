//! How well goals were followed: what docs/goals.md defines.

use serde::{Deserialize, Serialize};
use stridemap_process::StrideEnd;

use crate::stride::Transition;

/// Gravity, for powers and the cost of transport.
const GRAVITY_M_S2: f64 = 9.81;
/// Speed at which a power is set beside the weight.
const SPEED_M_S: f64 = 0.5;
/// The error of a speed or a yaw rate, and the lean, that count as one.
const UNIT: f64 = 0.1;

/// The goals that the figures are about, by the name of their measure.
const AXES: [&str; 3] = ["forward_speed_m_s", "lateral_speed_m_s", "yaw_rate_rad_s"];

/// Strides made under goals drawn at random, by the simulator's truth where there is one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RandomGoals {
    /// Mean over strides of `Σ (error / 0.1)² + ¼ ((roll / 0.1)² + (pitch / 0.1)²) + 4 P / (m g 0.5)`.
    #[serde(rename = "J")]
    pub cost: f64,
    /// Its standard deviation from stride to stride.
    #[serde(rename = "J_sd", default, skip_serializing_if = "Option::is_none")]
    pub cost_sd: Option<f64>,
    /// Root mean square of the error; null where the task does not ask for it.
    pub rms_vx_m_s: Option<f64>,
    /// Likewise.
    pub rms_vy_m_s: Option<f64>,
    /// Likewise.
    pub rms_wz_rad_s: Option<f64>,
    /// Energy over weight and way.
    pub cost_of_transport: f64,
    /// Falls and stalls.
    pub falls: usize,
    /// Strides, those that ended in a fall as well; these are left out of the means.
    pub strides: usize,
}

fn mean(values: impl Iterator<Item = f64> + Clone) -> f64 {
    values.clone().sum::<f64>() / values.count().max(1) as f64
}

/// Goal and truth of one of the [`AXES`].
fn error(goals: &[String], axis: usize, t: &Transition) -> Option<f64> {
    let component = goals.iter().position(|name| name == AXES[axis])?;
    Some(t.measures.true_motion.values()[axis] - t.goal[component])
}

impl RandomGoals {
    /// Sums up strides.
    ///
    /// # Arguments
    ///
    /// - `goals` – names of the goal's components.
    #[must_use]
    pub fn of(transitions: &[Transition], goals: &[String], mass_kg: f64) -> Self {
        let made: Vec<&Transition> = transitions.iter().filter(|t| t.end == StrideEnd::Crossing).collect();
        let rms = |axis: usize| {
            let errors: Option<Vec<f64>> = made.iter().map(|t| error(goals, axis, t)).collect();
            errors.filter(|e| !e.is_empty()).map(|e| mean(e.iter().map(|e| e * e)).sqrt())
        };
        let cost = |t: &Transition| {
            let m = &t.measures.true_motion;
            let errors = (0..AXES.len()).filter_map(|axis| error(goals, axis, t));
            let lean = m.mean_roll_rad.powi(2) + m.mean_pitch_rad.powi(2);
            let power = m.power_w / (mass_kg * GRAVITY_M_S2 * SPEED_M_S);
            (errors.map(|e| e * e).sum::<f64>() + 0.25 * lean) / (UNIT * UNIT) + 4.0 * power
        };
        let costs: Vec<f64> = made.iter().map(|t| cost(t)).collect();
        let cost = mean(costs.iter().copied());
        let squares: f64 = costs.iter().map(|c| (c - cost).powi(2)).sum();
        let energy: f64 = made.iter().map(|t| t.measures.true_motion.power_w * t.measures.duration_s).sum();
        let way: f64 = made
            .iter()
            .map(|t| {
                let m = &t.measures.true_motion;
                m.forward_speed_m_s.hypot(m.lateral_speed_m_s) * t.measures.duration_s
            })
            .sum();
        Self {
            cost,
            cost_sd: (costs.len() > 1).then(|| (squares / (costs.len() as f64 - 1.0)).sqrt()),
            rms_vx_m_s: rms(0),
            rms_vy_m_s: rms(1),
            rms_wz_rad_s: rms(2),
            cost_of_transport: energy / (mass_kg * GRAVITY_M_S2 * way.max(0.01)),
            falls: transitions.len() - made.len(),
            strides: transitions.len(),
        }
    }
}

/// One axis of a sweep.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SweepAxis {
    /// Mean magnitude of the error of strides.
    pub mean: f64,
    /// Root mean square of the error at every control tick.
    pub rms: f64,
    /// Root mean square of the error of strides.
    pub rms_stride: f64,
}

/// One axis driven at a time, the others asked to be zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Sweep {
    /// Speed forward, m/s; null where the task does not ask for it.
    pub vx: Option<SweepAxis>,
    /// Speed to the left, m/s; likewise.
    pub vy: Option<SweepAxis>,
    /// Yaw rate, rad/s; likewise.
    pub wz: Option<SweepAxis>,
    /// Falls and stalls.
    pub falls: usize,
}

impl SweepAxis {
    /// Sums up errors of strides and of ticks.
    ///
    /// # Example
    ///
    /// ```
    /// let axis = stridemap_record::SweepAxis::of(&[0.1, -0.1], &[0.3, -0.4]);
    /// assert!((axis.mean - 0.1).abs() < 1e-15 && (axis.rms - 0.125_f64.sqrt()).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn of(strides: &[f64], ticks: &[f64]) -> Self {
        let rms = |errors: &[f64]| mean(errors.iter().map(|e| e * e)).sqrt();
        Self { mean: mean(strides.iter().map(|e| e.abs())), rms: rms(ticks), rms_stride: rms(strides) }
    }
}

/// A straight walk.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Straightness {
    /// The speed that was asked for.
    pub asked_m_s: f64,
    /// Way along the first heading.
    pub walked_m: f64,
    /// Way to the left of the first heading per metre walked.
    pub off_m_per_m: f64,
    /// Change of heading, + to the left, per metre walked.
    pub turned_deg_per_m: f64,
    /// Falls and stalls.
    pub falls: usize,
}
