//! The push atlas: the largest push that a policy survives, by phase of the gait, direction and duration.
//!
//! A push is a true horizontal force on the torso. Its size is the change of velocity that it gives the whole robot,
//! `Δv = F · duration / mass`, so that robots of any mass, and pushes of any duration, are compared in m/s. For each cell the
//! border between what is survived and what is not is found by bisection: it is one border only if a push that
//! is survived is survived at every smaller size as well, which bisection takes for granted.
//!
//! A fall is a robot that is down: its height, its tilt, or no section for too long. The threshold of `ψ_roll` at a section, beyond
//! which a task calls a stride a fall while it learns, is left aside ([`for_pushes`]): a pushed robot often comes back
//! from beyond it.

use std::f64::consts::TAU;

use stridemap_learn::Policy;
use stridemap_process::{Action, Next, Situation, StrideEnd};
use stridemap_record::{AtlasCell, FORMAT, Fall, PushAtlas, StridePhase, StrideRole, Transition};

use crate::error::{LabError, unless};
use crate::fall::FailureConfig;
use crate::plant::Batch;
use crate::plant::{Plant, Push, PushBegins};
use crate::seed::{Role, stream};
use crate::state::StateComponent;
use crate::strides::{Act, drive};
use crate::task::Task;

/// What is tried.
#[derive(Clone, Debug, PartialEq)]
pub struct AtlasSetting {
    /// Phases of the gait, evenly over a stride from section to section.
    pub phases: usize,
    /// Directions, evenly over a turn from forward.
    pub directions: usize,
    /// For how long forces act.
    pub durations_s: Vec<f64>,
    /// The largest change of velocity.
    pub largest_m_s: f64,
    /// The bisection ends when survived and fallen are this near.
    pub tolerance_m_s: f64,
    /// Strides before the push.
    pub settle_strides: usize,
    /// Strides after the pushed one that must come without a fall.
    pub after_strides: usize,
    /// The body that is pushed; `None`: the torso.
    pub body: Option<String>,
}

impl Default for AtlasSetting {
    fn default() -> Self {
        Self {
            phases: 8,
            directions: 8,
            durations_s: vec![0.08, 0.2],
            largest_m_s: 1.2,
            tolerance_m_s: 0.01,
            settle_strides: 14,
            after_strides: 12,
            body: None,
        }
    }
}

impl AtlasSetting {
    /// Duration, phase and direction of every cell, in the order of the table.
    ///
    /// # Example
    ///
    /// ```
    /// let cells = stridemap_lab::AtlasSetting::default().cells();
    /// assert_eq!(cells.len(), 2 * 8 * 8);
    /// assert_eq!(cells[9], (0.08, 0.125, 45.0));
    /// ```
    #[must_use]
    pub fn cells(&self) -> Vec<(f64, f64, f64)> {
        let phases = || (0..self.phases).map(|i| i as f64 / self.phases as f64);
        let directions_deg = || (0..self.directions).map(|i| 360.0 * i as f64 / self.directions as f64);
        let mut cells = Vec::with_capacity(self.durations_s.len() * self.phases * self.directions);
        for &duration_s in &self.durations_s {
            for phase in phases() {
                cells.extend(directions_deg().map(|direction_deg| (duration_s, phase, direction_deg)));
            }
        }
        cells
    }
}

/// A task in which a robot that is pushed has fallen when it is down, and not before.
#[must_use]
pub fn for_pushes(task: &Task) -> Task {
    let failure = FailureConfig { psi_roll_below_deg: None, psi_roll_relative: false, ..task.failure };
    Task { failure, ..task.clone() }
}

/// A policy's walk without a push, beside which pushed ones are set.
#[derive(Clone, Debug, PartialEq)]
pub struct Unpushed {
    /// Mean duration of the settled strides.
    pub stride_s: f64,
    /// Mean and standard deviation of each component of the state at the settled sections; `None` for one on which
    /// nothing depends.
    components: Vec<Option<(f64, f64)>>,
}

/// A policy's mean, until the robot is down.
struct Steps<'a>(&'a dyn Policy);

impl Act for Steps<'_> {
    fn act(&mut self, at: &Situation, _: &mut rand_chacha::ChaCha8Rng) -> Action {
        self.0.mean(at)
    }

    fn saw(&mut self, transition: &Transition) -> Next {
        if transition.end == StrideEnd::Crossing { Next::Go } else { Next::Stop }
    }
}

/// Walks from the same start as every other walk of the atlas, pushed or not.
fn walk(
    plant: &mut Plant,
    policy: &dyn Policy,
    setting: &AtlasSetting,
    seed: u64,
    push: &dyn Fn(&Plant) -> Option<Push>,
) -> Result<Vec<Transition>, LabError> {
    const STREAM: u64 = 2;
    let settle = setting.settle_strides;
    let batch = Batch {
        iteration: 0,
        phase: StridePhase::Record,
        role: StrideRole::Record,
        strides: settle + 1 + setting.after_strides,
    };
    let before = &mut |plant: &mut Plant, index: usize| {
        if index == settle
            && let Some(push) = push(plant)
        {
            plant.push_in_next_stride(push);
        }
    };
    let mut rng = stream(seed, Role::Push, STREAM);
    drive(plant, &mut Steps(policy), batch, &mut rng, before, &mut |_| Ok(()))
}

/// Walks without a push.
///
/// # Errors
///
/// [`LabError::Invalid`] if the policy falls by itself; [`LabError::Robot`] if there is no body of that name; as
/// [`drive`].
pub fn unpushed(
    plant: &mut Plant,
    policy: &dyn Policy,
    setting: &AtlasSetting,
    state: &[StateComponent],
    seed: u64,
) -> Result<Unpushed, LabError> {
    /// Strides that say how much the state scatters by itself.
    const SETTLED: usize = 8;
    if let Some(body) = &setting.body {
        plant.push_on(body)?;
    }
    let made = walk(plant, policy, setting, seed, &|_| None)?;
    let fell = made.iter().position(|t| t.end != StrideEnd::Crossing);
    let why = fell.and_then(|i| Some((i, made[i].fall?)));
    unless(
        fell.is_none(),
        "push --atlas",
        why.map_or_else(String::new, |(i, fall)| {
            format!("the policy falls without a push, in stride {}: {fall}; there is nothing to tell of pushes", i + 1)
        }),
    )?;
    let settled = &made[made.len() - SETTLED.min(made.len())..];
    let n = settled.len() as f64;
    let of = |component: usize| {
        let mean = settled.iter().map(|t| t.next_state[component]).sum::<f64>() / n;
        let square = settled.iter().map(|t| (t.next_state[component] - mean).powi(2)).sum::<f64>();
        (mean, (square / (n - 1.0)).sqrt())
    };
    Ok(Unpushed {
        stride_s: settled.iter().map(|t| t.measures.duration_s).sum::<f64>() / n,
        components: state.iter().enumerate().map(|(i, c)| (!c.invariant).then(|| of(i))).collect(),
    })
}

impl Unpushed {
    /// Strides after a push until every component of the state stays where it is without one: within three
    /// standard deviations, or a tenth of how far the push moved it. `None` if it does not within these.
    fn strides_to_recover(&self, pushed: &[Transition]) -> Option<usize> {
        let slowest = self.components.iter().enumerate().filter_map(|(i, component)| {
            let (mean, std) = (*component)?;
            let off = |t: &Transition| (t.next_state[i] - mean).abs();
            let largest = pushed.iter().map(off).fold(0.0, f64::max);
            let band = (3.0 * std).max(0.1 * largest);
            // From the first stride after the last one outside.
            Some(pushed.iter().rposition(|t| off(t) > band).map_or(0, |last| last + 1))
        });
        slowest.max().filter(|n| *n < pushed.len())
    }
}

/// What came of a push.
enum Trial {
    Survived { strides_to_recover: Option<usize> },
    Fell { cause: Option<Fall> },
}

/// Finds the largest push that is survived in one cell: duration, phase and direction of [`AtlasSetting::cells`].
///
/// The largest size is tried first; then the interval between what is survived (zero at first) and what is not is
/// halved until it is no longer than the tolerance.
///
/// # Errors
///
/// [`LabError::Robot`] if there is no body of that name; as [`drive`].
pub fn atlas_cell(
    plant: &mut Plant,
    policy: &dyn Policy,
    setting: &AtlasSetting,
    beside: &Unpushed,
    seed: u64,
    (duration_s, phase, direction_deg): (f64, f64, f64),
) -> Result<AtlasCell, LabError> {
    if let Some(body) = &setting.body {
        plant.push_on(body)?;
    }
    let mass_kg = plant.robot().description().mass_kg;
    let (sideways, ahead) = (direction_deg / 360.0 * TAU).sin_cos();
    let (mut trials, mut strides) = (0, 0);
    let mut at = |size_m_s: f64| -> Result<Trial, LabError> {
        let force_n = mass_kg * size_m_s / duration_s;
        let push = |plant: &Plant| {
            let to_stance = plant.stance().map_or(1.0, stridemap_robot::Side::lateral_sign);
            Some(Push {
                forward_n: force_n * ahead,
                left_n: force_n * sideways * to_stance,
                duration_s,
                begins: PushBegins::AfterSection { seconds: phase * beside.stride_s },
            })
        };
        let made = walk(plant, policy, setting, seed, &push)?;
        trials += 1;
        strides += made.len();
        Ok(match made.last().filter(|t| t.end != StrideEnd::Crossing) {
            Some(last) => Trial::Fell { cause: last.fall },
            None => {
                let pushed = &made[setting.settle_strides.min(made.len())..];
                Trial::Survived { strides_to_recover: beside.strides_to_recover(pushed) }
            }
        })
    };
    let (mut survived_m_s, mut fallen_m_s) = (0.0, None);
    let (mut strides_to_recover, mut fall_criterion) = (Some(0), None);
    let mut size_m_s = setting.largest_m_s;
    loop {
        match at(size_m_s)? {
            Trial::Survived { strides_to_recover: after } => (survived_m_s, strides_to_recover) = (size_m_s, after),
            Trial::Fell { cause } => (fallen_m_s, fall_criterion) = (Some(size_m_s), cause.map(|f| f.criterion)),
        }
        match fallen_m_s {
            Some(fallen_m_s) if fallen_m_s - survived_m_s > setting.tolerance_m_s => {
                size_m_s = 0.5 * (survived_m_s + fallen_m_s);
            }
            _ => break,
        }
    }
    Ok(AtlasCell {
        duration_s,
        phase,
        direction_deg,
        survived_m_s,
        fallen_m_s,
        strides_to_recover,
        fall_criterion,
        trials,
        strides,
    })
}

/// The atlas of these cells.
#[must_use]
pub fn push_atlas(
    setting: &AtlasSetting,
    beside: &Unpushed,
    (policy, made_of): (&str, String),
    mass_kg: f64,
    seed: u64,
    cells: Vec<AtlasCell>,
) -> PushAtlas {
    PushAtlas {
        format: FORMAT,
        policy: policy.into(),
        seed,
        made_of,
        body: setting.body.clone().unwrap_or_default(),
        mass_kg,
        largest_m_s: setting.largest_m_s,
        tolerance_m_s: setting.tolerance_m_s,
        settle_strides: setting.settle_strides,
        after_strides: setting.after_strides,
        stride_s: beside.stride_s,
        ..PushAtlas::default()
    }
    .with(cells)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::builtin;

    /// On the biped stepping in place, small versions of the atlas: what is survived and what is not stand as near as the
    /// tolerance says, a push of half the size is survived as well and one of twice the size is not, and
    /// the same seed gives the same cell.
    #[test]
    fn the_border_of_a_cell_lies_between_a_push_survived_and_one_that_is_not() {
        let task = for_pushes(&builtin::load("stepping", &[]).unwrap().task);
        let policy = task.nominal_policy().unwrap();
        let mut plant = task.plant().unwrap();
        let setting =
            AtlasSetting { settle_strides: 4, after_strides: 6, tolerance_m_s: 0.05, ..AtlasSetting::default() };
        let beside = unpushed(&mut plant, &policy, &setting, &task.state, 1).unwrap();
        let place = (0.2, 0.5, 0.0);
        let cell = atlas_cell(&mut plant, &policy, &setting, &beside, 1, place).unwrap();
        let fallen_m_s = cell.fallen_m_s.unwrap();
        assert!(cell.survived_m_s > 0.0 && fallen_m_s - cell.survived_m_s <= 0.05, "{cell:?}");
        assert!(cell.fall_criterion.is_some());
        let mut again = task.plant().unwrap();
        assert_eq!(atlas_cell(&mut again, &policy, &setting, &beside, 1, place).unwrap(), cell);
        for (largest_m_s, survives) in [(0.5 * cell.survived_m_s, true), (2.0 * fallen_m_s, false)] {
            let one = AtlasSetting { largest_m_s, tolerance_m_s: 10.0, ..setting.clone() };
            let cell = atlas_cell(&mut plant, &policy, &one, &beside, 1, place).unwrap();
            assert_eq!((cell.fallen_m_s.is_none(), cell.trials), (survives, 1));
        }
        let nobody = AtlasSetting { body: Some("toe".into()), ..setting };
        let error = unpushed(&mut plant, &policy, &nobody, &task.state, 1).unwrap_err().to_string();
        assert!(error.contains("no body \"toe\"; it has torso"), "{error}");
    }

    /// Deviations of 8, 4, 2, 1, 0.5, 0.2 from a state that scatters by 0.1: three strides bring it to 1 of 8, four within
    /// a tenth (0.8).
    #[test]
    fn recovered_is_who_stays_near() {
        let beside = Unpushed { stride_s: 0.6, components: vec![Some((2.0, 0.1)), None] };
        let strides = |off: &[f64]| -> Vec<Transition> {
            let stride =
                |o: &f64| Transition { next_state: [2.0 + o, 99.0].as_slice().into(), ..Transition::default() };
            off.iter().map(stride).collect()
        };
        assert_eq!(beside.strides_to_recover(&strides(&[8.0, 4.0, 2.0, 1.0, 0.5, 0.2])), Some(4));
        assert_eq!(beside.strides_to_recover(&strides(&[0.2, 0.1])), Some(0));
        assert_eq!(beside.strides_to_recover(&strides(&[8.0, 4.0])), None);
    }
}
