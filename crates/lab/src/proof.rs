//! A policy is proven on the robot before it is called final.
//!
//! From a fresh start the policy walks a trial. If it is no faster than the best proven one it ends
//! there; otherwise it goes on to the full proof, because a slow flip shows only after many strides. A
//! warning of the guard ends it: the robot backs off to what is proven. A first policy that warned is
//! not discarded but shrunk towards stepping in place and tried again.

use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use stridemap_learn::{ConstantPolicy, Policy, SavedPolicy};
use stridemap_process::{Action, Next, Situation, StrideEnd};
use stridemap_record::{Proof, Transition, Verdict, Warning};

use crate::caution::ProofConfig;
use crate::error::LabError;
use crate::guard::{Guard, GuardConfig, GuardThresholds};
use crate::strides::Act;

/// Walks a policy until it is proven, given up, or the guard warns.
pub struct Prover<'a> {
    config: &'a ProofConfig,
    dither_std: &'a [f64],
    policy: &'a dyn Policy,
    fallback: &'a dyn Policy,
    back_off: Vec<f64>,
    guard: Guard,
    beat_m_s: Option<f64>,
    walked: usize,
    forward_m: f64,
    time_s: f64,
    actions: Vec<f64>,
    backing_off: Option<usize>,
    verdict: Verdict,
    warning: Option<Warning>,
}

impl<'a> Prover<'a> {
    /// A proof of `policy` from a fresh start.
    ///
    /// # Arguments
    ///
    /// - `dither_std` – standard deviations of what is added to the action during the trial; empty: none.
    /// - `fallback` – what the robot backs off to, less `back_off`.
    /// - `beat_m_s` – speed of the best proven policy; without one every policy goes on to the proof.
    #[must_use]
    pub fn new(
        config: &'a ProofConfig,
        guard: (&GuardConfig, GuardThresholds),
        dither_std: &'a [f64],
        policy: &'a dyn Policy,
        (fallback, back_off): (&'a dyn Policy, Vec<f64>),
        beat_m_s: Option<f64>,
    ) -> Self {
        Self {
            config,
            dither_std,
            policy,
            fallback,
            actions: vec![0.0; back_off.len()],
            back_off,
            guard: Guard::new(guard.0, guard.1),
            beat_m_s,
            walked: 0,
            forward_m: 0.0,
            time_s: 0.0,
            backing_off: None,
            verdict: Verdict::Unfinished,
            warning: None,
        }
    }

    /// What the strides so far came to.
    #[must_use]
    pub fn proof(&self) -> Proof {
        let settled = self.walked.saturating_sub(self.config.settle_strides);
        Proof {
            verdict: self.verdict,
            warning: self.warning,
            speed_m_s: if self.time_s > 0.0 { self.forward_m / self.time_s } else { 0.0 },
            strides: self.walked,
            attempts: 1,
            action: self.actions.iter().map(|a| a / settled.max(1) as f64).collect(),
        }
    }

    fn warned(&mut self) -> Next {
        self.verdict = Verdict::Warned;
        self.backing_off = Some(self.config.back_off_strides);
        if self.config.back_off_strides == 0 { Next::Stop } else { Next::Go }
    }
}

impl Act for Prover<'_> {
    fn act(&mut self, at: &Situation, rng: &mut ChaCha8Rng) -> Action {
        if self.backing_off.is_none() {
            let mut action = self.policy.mean(at);
            if self.walked < self.config.trial_strides {
                for (u, std) in action.iter_mut().zip(self.dither_std) {
                    let z: f64 = StandardNormal.sample(rng);
                    *u += std * z;
                }
            }
            return action;
        }
        let safe = self.fallback.mean(at);
        safe.iter().zip(&self.back_off).map(|(u, less)| u - less).collect()
    }

    fn saw(&mut self, transition: &Transition) -> Next {
        if transition.end != StrideEnd::Crossing {
            self.verdict = Verdict::Fell;
            return Next::Stop;
        }
        if let Some(left) = self.backing_off {
            self.backing_off = Some(left - 1);
            return if left <= 1 { Next::Stop } else { Next::Go };
        }
        self.walked += 1;
        if self.walked > self.config.settle_strides {
            self.forward_m += transition.measures.forward_m;
            self.time_s += transition.measures.duration_s;
            for (sum, u) in self.actions.iter_mut().zip(&transition.action) {
                *sum += u;
            }
        }
        self.warning = self.guard.watch(&transition.measures);
        if self.warning.is_some() {
            return self.warned();
        }
        let speed_m_s = self.forward_m / self.time_s.max(f64::MIN_POSITIVE);
        if self.walked == self.config.trial_strides && self.beat_m_s.is_some_and(|beat| speed_m_s <= beat) {
            self.verdict = Verdict::Slower;
            return Next::Stop;
        }
        if self.walked >= self.config.proof_strides {
            self.verdict = Verdict::Proven;
            return Next::Stop;
        }
        Next::Go
    }
}

/// A policy's constants pulled towards the neutral action by a factor, without their feedback: what
/// warned may have been either. A network is not shrunk: `None`.
///
/// # Errors
///
/// [`LabError::Learn`] if the constants leave the policy's domain.
pub fn shrunk(policy: &SavedPolicy, neutral: &[f64], factor: f64) -> Result<Option<SavedPolicy>, LabError> {
    let pulled = |action: &[f64]| -> Vec<f64> {
        let both = action.iter().zip(neutral);
        both.map(|(u, n)| n + factor * (u - n)).collect()
    };
    Ok(match policy {
        SavedPolicy::Constant(p) => {
            Some(SavedPolicy::Constant(ConstantPolicy::new(policy.spec().clone(), &pulled(p.action()))?))
        }
        SavedPolicy::Linear(p) => {
            Some(SavedPolicy::Constant(ConstantPolicy::new(policy.spec().clone(), &pulled(p.action()))?))
        }
        _ => None,
    })
}
