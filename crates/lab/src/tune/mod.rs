//! A stepping gait for a robot that has none: the rule, a ladder over the pitch amplitude, then CMA-ES; among gaits that step
//! the most robust, then the most regular.

mod scale;

use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use stridemap_learn::CmaEs;
use stridemap_process::{StrideEnd, StrideProcess};

pub use scale::{COORDINATES, GaitSetting, Scale};

use crate::error::LabError;
use crate::nominal::{DOWN, NOMINAL_S, nominal_gait};
use crate::plant::Push;
use crate::seed::{Role, stream};
use crate::stepping::{GaitTrace, GaitVerdict, Stepping};
use crate::task::Task;

/// Rungs of the ladder.
const RUNGS: usize = 7;
/// Rungs that are looked at below the first that steps.
const BELOW: usize = 2;
/// Gaits that are tried between a rung that falls and one that shuffles.
const BISECTIONS: usize = 3;
/// Standard deviation of the first generation, in units of the search.
const SPREAD: f64 = 0.6;
/// ... of one about a gait that steps and is not robust.
const NARROW: f64 = 0.3;
/// Gaits whose robustness is looked at, each time.
const CANDIDATES: usize = 4;
/// Generations about a gait that steps, until one is robust and regular; so many at least where walking chooses.
const GENERATIONS: usize = 5;
const GENERATIONS_TO_WALK: usize = 2;
/// Variants in which a gait must stay up.
pub const VARIANTS: usize = 8;
/// Variants survived by a gait that needs no further search.
const ROBUST: usize = 7;
/// [`irregularity`] of a gait that needs no further search: strides alike enough to see what an action does.
const REGULAR: f64 = 0.4;
/// Gaits with which walking is tried, the most regular ones.
const WALKERS: usize = 8;
/// Forward amplitudes that are tried, in degrees.
const WALKS_DEG: [f64; 8] = [2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0];

/// What is wanted of a search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TuneOptions {
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Gaits tried at most, variants not counted.
    pub most_tries: usize,
    /// Whether forward speed chooses among robust gaits.
    pub walk: bool,
}

impl Default for TuneOptions {
    fn default() -> Self {
        Self { seed: 1, most_tries: 100, walk: false }
    }
}

/// One gait that was tried.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Try {
    /// Where it came from: `ladder` or `search`.
    pub from: String,
    /// The gait.
    pub setting: GaitSetting,
    /// Whether it steps.
    pub verdict: GaitVerdict,
    /// For how long it stayed up, at most 20 s.
    pub survived_s: f64,
    /// How it stepped.
    pub stepping: Stepping,
    /// Variants survived of [`VARIANTS`], where they were looked at.
    pub robust: Option<usize>,
    /// Largest forward amplitude with which it stays up, and its speed, where that was looked at.
    pub walk: Option<(f64, f64)>,
    /// The gait over time.
    #[serde(skip)]
    pub trace: GaitTrace,
}

/// What a search found.
#[derive(Clone, Debug)]
pub struct Tuned {
    /// Everything that was tried, in order.
    pub tries: Vec<Try>,
    /// Number of tries up to the first gait that steps.
    pub first_step: Option<usize>,
    /// Simulated time up to that, and in all, variants included.
    pub simulated_s: [f64; 2],
    /// The gait to take, among `tries`: one that steps, or else the one that came nearest.
    pub chosen: usize,
}

impl Tuned {
    /// The gait to take.
    #[must_use]
    pub fn best(&self) -> &Try {
        &self.tries[self.chosen]
    }
}

/// Searches a gait for a task's robot. `watch` sees each try.
///
/// # Errors
///
/// [`LabError`] if the robot cannot be built or simulated.
pub fn tune(task: &Task, options: &TuneOptions, watch: &mut dyn FnMut(usize, &Try)) -> Result<Tuned, LabError> {
    let scale = Scale::of(task)?;
    let mut search = Search { task, options, tries: Vec::new(), simulated_s: 0.0, first: None, watch };
    let mut below = None;
    for rung in 0..RUNGS {
        if below == Some(0) || search.tries.len() >= options.most_tries {
            break;
        }
        search.try_all("ladder", &[scale.rung(rung)])?;
        let stepped = search.tries.iter().any(|t| t.verdict == GaitVerdict::Steps);
        below = if stepped { Some(below.map_or(BELOW, |left: usize| left - 1)) } else { None };
    }
    search.bisect(&scale)?;
    if search.first.is_none() {
        search.evolve(&scale, SPREAD, &mut |search, _| Ok(search.first.is_some()))?;
    }
    search.look_at_robustness()?;
    if search.first.is_some() {
        search.evolve(&scale, NARROW, &mut |search, generation| {
            if generation > 0 {
                search.look_at_robustness()?;
            }
            let enough = generation >= if options.walk { GENERATIONS_TO_WALK } else { 0 };
            Ok((enough && search.tries.iter().any(good)) || generation == GENERATIONS)
        })?;
    }
    if options.walk {
        search.walk_forward()?;
    }
    let nearest =
        || (0..search.tries.len()).max_by(|&a, &b| score(&search.tries[a]).total_cmp(&score(&search.tries[b])));
    let chosen = search.most_robust().or_else(nearest).unwrap_or(0);
    let (first_step, first_s) = search.first.map_or((None, search.simulated_s), |(tries, s)| (Some(tries), s));
    Ok(Tuned { first_step, simulated_s: [first_s, search.simulated_s], chosen, tries: search.tries })
}

/// How far a gait is from stepping: time up, then supports and clearance.
fn score(tried: &Try) -> f64 {
    let s = &tried.stepping;
    let alternation = (s.supports as f64 / s.sections.max(1) as f64).min(1.0);
    let steps = f64::from(u8::from(tried.verdict == GaitVerdict::Steps));
    let regular = steps * (1.0 - irregularity(tried)).max(-1.0);
    tried.survived_s / NOMINAL_S + alternation + (s.clearance_share / 0.01).min(1.0) + 2.0 * steps + regular
        - 0.02 * s.tilt_deg
}

/// Whether a gait needs no further search.
fn good(tried: &Try) -> bool {
    tried.robust >= Some(ROBUST) && irregularity(tried) < REGULAR
}

struct Search<'a> {
    task: &'a Task,
    options: &'a TuneOptions,
    tries: Vec<Try>,
    simulated_s: f64,
    first: Option<(usize, f64)>,
    watch: &'a mut dyn FnMut(usize, &Try),
}

impl Search<'_> {
    /// Tries settings at once; the record does not depend on the number of threads.
    fn try_all(&mut self, from: &str, settings: &[GaitSetting]) -> Result<(), LabError> {
        let seed = self.options.seed;
        let tried: Result<Vec<Try>, LabError> =
            settings.par_iter().map(|setting| attempt(self.task, from, setting.rounded(), seed)).collect();
        for tried in tried? {
            self.simulated_s += tried.survived_s;
            self.tries.push(tried);
            let last = &self.tries[self.tries.len() - 1];
            (self.watch)(self.tries.len(), last);
            if self.first.is_none() && last.verdict == GaitVerdict::Steps {
                self.first = Some((self.tries.len(), self.simulated_s));
            }
        }
        Ok(())
    }

    /// Looks between the lowest rung that falls and the highest that shuffles, where none steps.
    fn bisect(&mut self, scale: &Scale) -> Result<(), LabError> {
        for _ in 0..BISECTIONS {
            let pitches = |verdict| {
                let of = self.tries.iter().filter(move |t| t.verdict == verdict);
                of.map(|t| t.setting.pitch_deg)
            };
            let shuffles = pitches(GaitVerdict::Shuffles).fold(f64::NAN, f64::max);
            let falls = pitches(GaitVerdict::Falls).filter(|&p| p > shuffles).fold(f64::NAN, f64::min);
            let enough = self.first.is_some() || self.tries.len() >= self.options.most_tries;
            if enough || shuffles.is_nan() || falls.is_nan() {
                break;
            }
            let between = GaitSetting { pitch_deg: (shuffles * falls).sqrt(), ..scale.rung(0) };
            self.try_all("ladder", &[between])?;
        }
        Ok(())
    }

    /// CMA-ES about the best gait so far, or the rule; `enough` is asked before each generation.
    fn evolve(
        &mut self,
        scale: &Scale,
        spread: f64,
        enough: &mut dyn FnMut(&mut Self, usize) -> Result<bool, LabError>,
    ) -> Result<(), LabError> {
        let best = (0..self.tries.len()).max_by(|&a, &b| score(&self.tries[a]).total_cmp(&score(&self.tries[b])));
        let pitch_deg = best.map_or(4.0, |best| self.tries[best].setting.pitch_deg);
        let mut search = CmaEs::new(&[0.0; COORDINATES], &[spread; COORDINATES], None)?;
        let mut rng = stream(self.options.seed, Role::RobotSearch, u64::from(self.first.is_none()));
        for generation in 0.. {
            let points = search.ask(&mut rng);
            if enough(self, generation)? || self.tries.len() + points.len() > self.options.most_tries {
                return Ok(());
            }
            let settings: Vec<GaitSetting> = points.iter().map(|point| scale.at(point, pitch_deg)).collect();
            let first = self.tries.len();
            self.try_all("search", &settings)?;
            let values: Vec<f64> = self.tries[first..].iter().map(score).collect();
            search.tell(&points, &values)?;
        }
        Ok(())
    }

    /// Counts the variants that the most regular gaits that step survive.
    fn look_at_robustness(&mut self) -> Result<(), LabError> {
        let mut stepping: Vec<usize> = (0..self.tries.len())
            .filter(|&i| self.tries[i].verdict == GaitVerdict::Steps && self.tries[i].robust.is_none())
            .collect();
        stepping.sort_by(|&a, &b| irregularity(&self.tries[a]).total_cmp(&irregularity(&self.tries[b])));
        stepping.truncate(CANDIDATES);
        let pairs: Vec<(usize, usize)> = stepping.iter().flat_map(|&i| (0..VARIANTS).map(move |v| (i, v))).collect();
        let up: Result<Vec<(usize, f64)>, LabError> = (pairs.par_iter())
            .map(|&(i, variant)| {
                let mut task = self.task.clone();
                self.tries[i].setting.put_into(&mut task);
                Ok((i, variant_s(&task, variant, self.options.seed)?))
            })
            .collect();
        for (i, survived_s) in up? {
            self.simulated_s += survived_s;
            *self.tries[i].robust.get_or_insert(0) += usize::from(survived_s >= NOMINAL_S);
        }
        Ok(())
    }

    /// Tries forward amplitudes on the gaits that are robust, from small to large, until one falls.
    fn walk_forward(&mut self) -> Result<(), LabError> {
        let robust = |t: &Try| t.robust >= Some(ROBUST);
        let mut some: Vec<usize> = (0..self.tries.len()).filter(|&i| robust(&self.tries[i])).collect();
        some.sort_by(|&a, &b| irregularity(&self.tries[a]).total_cmp(&irregularity(&self.tries[b])));
        some.truncate(WALKERS);
        let found: Result<Vec<_>, LabError> = (some.par_iter())
            .map(|&i| {
                let (mut best, mut simulated_s) = (None, 0.0);
                for walk_deg in WALKS_DEG {
                    let mut task = self.task.clone();
                    self.tries[i].setting.put_into(&mut task);
                    task.gait.amplitude_deg.walk = walk_deg;
                    let gait = nominal_gait(&task, self.options.seed);
                    let Some((survived_s, stepping)) = walked(gait)? else { break };
                    simulated_s += survived_s;
                    if survived_s < NOMINAL_S {
                        break;
                    }
                    if best.is_none_or(|(_, speed)| stepping.speed_m_s > speed) {
                        best = Some((walk_deg, stepping.speed_m_s));
                    }
                }
                Ok((i, best, simulated_s))
            })
            .collect();
        for (i, best, simulated_s) in found? {
            self.simulated_s += simulated_s;
            self.tries[i].walk = best;
        }
        Ok(())
    }

    /// The gait that steps and survives most variants; the fastest where walking was looked at, then the most regular. One whose
    /// strides are so irregular that nobody sees what an action does comes after those that are not.
    fn most_robust(&self) -> Option<usize> {
        let rank = |t: &Try| {
            let robust = if t.walk.is_some() { Some(VARIANTS) } else { t.robust };
            ((good(t), robust), t.walk.map_or(0.0, |(_, speed)| speed), -irregularity(t))
        };
        (0..self.tries.len()).filter(|&i| self.tries[i].robust.is_some()).max_by(|&a, &b| {
            let (a, b) = (rank(&self.tries[a]), rank(&self.tries[b]));
            a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2))
        })
    }
}

/// Spread from stride to stride: of `psi_roll` in degrees and of the stride's time in tenths of itself.
fn irregularity(tried: &Try) -> f64 {
    tried.stepping.psi_roll_spread_deg + 10.0 * tried.stepping.stride_spread_s / tried.stepping.stride_s.max(1e-9)
}

/// How long a gait stayed up, and how it stepped; `None` where it did not get through its start.
fn walked(gait: Result<crate::nominal::NominalGait, LabError>) -> Result<Option<(f64, Stepping)>, LabError> {
    match gait {
        Ok(gait) => {
            let survived_s = gait.fell.map_or(NOMINAL_S, |(time_s, _)| time_s.min(NOMINAL_S - 0.01));
            Ok(Some((survived_s, gait.stepping)))
        }
        Err(LabError::NominalGaitFails { .. } | LabError::Process(_)) => Ok(None),
        Err(error) => Err(error),
    }
}

fn attempt(task: &Task, from: &str, setting: GaitSetting, seed: u64) -> Result<Try, LabError> {
    let mut task = task.clone();
    setting.put_into(&mut task);
    let gait = nominal_gait(&task, seed);
    let early_s = match &gait {
        Err(LabError::NominalGaitFails { time_s, .. }) => *time_s,
        _ => 0.0,
    };
    let trace = gait.as_ref().map_or_else(|_| GaitTrace::default(), |gait| gait.trace.clone());
    let (survived_s, stepping) = walked(gait)?.unwrap_or((early_s, Stepping::default()));
    let verdict = stepping.verdict(survived_s < NOMINAL_S);
    Ok(Try { from: from.into(), setting, verdict, survived_s, stepping, robust: None, walk: None, trace })
}

/// For how long a gait stays up on a changed robot: started with noise (three times), on a slippery floor, heavier, lighter,
/// with softer joints, pushed.
fn variant_s(task: &Task, variant: usize, seed: u64) -> Result<f64, LabError> {
    const PUSH_SHARE: f64 = 0.04;
    const PUSH_S: f64 = 0.1;
    const PUSH_EVERY: usize = 4;
    let mut task = task.clone();
    let robot = &mut task.robot;
    match variant {
        0..3 => (robot.start_joint_noise_deg, robot.start_velocity_noise_m_s) = (1.0, 0.05),
        3 => robot.friction = Some(0.6),
        4 => robot.mass_scale *= 1.05,
        5 => robot.mass_scale *= 0.95,
        6 => robot.kp_nm_rad = robot.kp_nm_rad.take().map(|kp| kp.scaled(0.8)),
        _ => {}
    }
    task.failure = DOWN;
    let mut plant = task.plant()?;
    let push_n = PUSH_SHARE * plant.robot().description().mass_kg * 9.81;
    let neutral: Vec<f64> = task.action_limits()?.iter().map(|limits| limits.neutral).collect();
    let mut rng = stream(seed, Role::Check, 10 + variant as u64);
    if plant.reset(&mut rng).is_err() {
        return Ok(0.0);
    }
    for stride in 0.. {
        let time_s = plant.robot().state().time_s;
        if time_s >= NOMINAL_S {
            return Ok(time_s);
        }
        if variant == VARIANTS - 1 && stride % PUSH_EVERY == 0 {
            let left_n = if stride % (2 * PUSH_EVERY) == 0 { push_n } else { -push_n };
            plant.push_in_next_stride(Push::sideways(left_n, PUSH_S));
        }
        if plant.stride(&neutral, &mut rng)?.end != StrideEnd::Crossing {
            return Ok(plant.robot().state().time_s.min(NOMINAL_S - 0.01));
        }
    }
    Ok(0.0)
}
