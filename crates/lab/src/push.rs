//! The return map under pushes \[MA09, fig. 10\].

use rand::Rng;
use serde::{Deserialize, Serialize};
use stridemap_learn::Policy;
use stridemap_process::StrideEnd;
use stridemap_record::{PushOutcome, PushPair, ReturnMapLine, StridePhase, StrideRole, Transition};

use crate::error::LabError;
use crate::plant::Batch;
use crate::plant::{Plant, Push};
use crate::seed::{Role, stream};
use crate::strides::{ActionSource, make_strides};

/// Every how many strides the robot is pushed.
const EVERY: usize = 4;

/// How the robot is pushed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PushConfig {
    /// F: forces are uniform in \[−F, F\], lateral, on the torso's centre of mass.
    pub force_n: f64,
    /// For how long each acts, from the moment when the load passes from one foot to the other.
    pub duration_s: f64,
    /// Strides in all; every fourth is pushed.
    pub strides: usize,
}

/// Change of velocity that a push gives where no force is named: half of what the paper's 40 N for 0.2 s give
/// 95 kg, so that robots of any mass are pushed alike.
pub const PUSH_VELOCITY_CHANGE_M_S: f64 = 0.04;

impl PushConfig {
    /// Pushes of so much force, or, without one, of [`PUSH_VELOCITY_CHANGE_M_S`] for a robot of this mass.
    ///
    /// # Example
    ///
    /// 95 kg · 0.04 m/s in 0.2 s are 19 N:
    ///
    /// ```
    /// let push = stridemap_lab::PushConfig::of(None, 95.0, 0.2, 160);
    /// assert!((push.force_n - 19.0).abs() < 1e-12);
    /// ```
    #[must_use]
    pub fn of(force_n: Option<f64>, mass_kg: f64, duration_s: f64, strides: usize) -> Self {
        Self { force_n: force_n.unwrap_or(mass_kg * PUSH_VELOCITY_CHANGE_M_S / duration_s), duration_s, strides }
    }
}

/// Pushes a walking robot and fits its return map ψ(k) → ψ(k+2).
///
/// At every 4th stride a lateral force, uniform in \[−F, F\], acts on the torso. k is the first section
/// after the push, and neither of the two strides that follow is pushed. The first 10 strides only let
/// the policy settle.
///
/// # Errors
///
/// [`LabError::Process`] if the plant fails, or cannot push.
pub fn push(
    plant: &mut Plant,
    policy: &dyn Policy,
    config: PushConfig,
    seed: u64,
    observe: &mut dyn FnMut(&Transition) -> Result<(), LabError>,
) -> Result<PushOutcome, LabError> {
    const SETTLE: usize = 10;
    let mut forces = stream(seed, Role::Push, 1);
    let mut rng = stream(seed, Role::Push, 0);
    let mut pushed: Vec<Option<f64>> = Vec::with_capacity(SETTLE + config.strides);
    let batch =
        Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: SETTLE + config.strides };
    let fell_before = plant.falls().len();
    let transitions = make_strides(
        plant,
        &ActionSource::Mean(policy),
        batch,
        &mut rng,
        &mut |plant, index| {
            let push = index >= SETTLE && (index - SETTLE).is_multiple_of(EVERY);
            let left_n = push.then(|| config.force_n * (2.0 * forces.random::<f64>() - 1.0));
            if let Some(left_n) = left_n {
                plant.push_in_next_stride(Push::sideways(left_n, config.duration_s));
            }
            pushed.truncate(index); // an aborted stride is asked for again
            pushed.push(left_n);
        },
        observe,
    )?;

    let psi_deg = |i: usize| transitions[i].measures.psi_roll_deg;
    let reached = |i: usize| transitions.get(i).is_some_and(|t| t.end == StrideEnd::Crossing);
    let data: Vec<PushPair> = pushed
        .iter()
        .enumerate()
        .filter_map(|(k, force)| {
            let force_n = (*force)?;
            (reached(k) && reached(k + 1) && reached(k + 2)).then(|| PushPair {
                k,
                psi_roll_deg: psi_deg(k),
                psi_roll_after_1_deg: psi_deg(k + 1),
                psi_roll_after_2_deg: psi_deg(k + 2),
                force_n,
            })
        })
        .collect();
    let impulse_n_s = config.force_n * config.duration_s;
    let line = |after: fn(&PushPair) -> f64| {
        let pairs: Vec<(f64, f64)> = data.iter().map(|p| (p.psi_roll_deg, after(p))).collect();
        ReturnMapLine::fit(&pairs)
    };
    let after_1 = line(|p| p.psi_roll_after_1_deg)?;
    let after_2 = line(|p| p.psi_roll_after_2_deg)?;
    Ok(PushOutcome {
        slope: after_2.map(|l| l.slope),
        slope_std_error: after_2.map(|l| l.slope_std_error),
        fixed_point_deg: after_2.and_then(|l| l.fixed_point_deg),
        after_1,
        falls: transitions.iter().filter(|t| t.end == StrideEnd::Fell).count(),
        causes: plant.falls()[fell_before..].iter().map(|f| f.1).collect(),
        pairs: data.len(),
        strides: config.strides,
        force_n: config.force_n,
        duration_s: config.duration_s,
        impulse_n_s,
        velocity_change_m_s: impulse_n_s / plant.robot().description().mass_kg,
        data,
    })
}
