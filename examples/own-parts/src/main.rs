//! A gait, a learner, a reward and a state component of one's own, each registered by name and then named by a
//! task file (own.toml). Everything else (robot, section, map, guard, proof, budget) is Stridemap's.

use std::error::Error;

use rand::Rng;
use rand_chacha::ChaCha8Rng;
use stridemap_gait::{Gait, GaitError, Modulation, OscillatorGait};
use stridemap_lab::{
    Algorithm, GaitPart, Known, LabError, LearnerPart, NoRecorder, Part, RewardOf, RewardPart, StateComponent,
    StatePart, builtin, gaits, learners, rewards, states,
};
use stridemap_learn::{ConstantPolicy, LearnError, LearnOutcome, Learner, SavedPolicy, TrialReport, TrialSummary};
use stridemap_process::{Action, Next, StrideProcess, walk};
use stridemap_record::Summary;
use stridemap_robot::{JointTargets, LegRole, Legs, RobotState};

/// The paper's gait, with the knees some degrees straighter.
struct StiffKnees {
    inner: OscillatorGait,
    legs: Legs<Option<LegRole>>,
    straighter_rad: f64,
}

impl Gait for StiffKnees {
    fn modulations(&self) -> &[Modulation] {
        self.inner.modulations()
    }
    fn rest(&self) -> &JointTargets {
        self.inner.rest()
    }
    fn reset(&mut self) {
        self.inner.reset();
    }
    fn modulate(&mut self, index: usize, value: f64) -> Result<(), GaitError> {
        self.inner.modulate(index, value)
    }
    fn targets(&mut self, state: &RobotState, dt_s: f64, out: &mut JointTargets) {
        self.inner.targets(state, dt_s, out);
        for (_, joint, role) in self.legs.roles() {
            // In the order of `LEG_JOINTS`: the knee, and half of it back in hip and ankle.
            let share = [0.0, 0.0, -0.5, 1.0, -0.5, 0.0][joint.index()];
            out.joints[role.joint].position_rad += role.sign * share * self.straighter_rad;
        }
    }
    fn start_up_s(&self) -> f64 {
        self.inner.start_up_s()
    }
}

static STIFF_KNEES: GaitPart = GaitPart {
    name: "stiff_knees",
    about: "the paper's gait with straighter knees",
    build: |task, robot| {
        let knee_deg = task.gait.own.get("knee_deg").copied().unwrap_or(0.0);
        let inner = OscillatorGait::new(task.gait.clone(), robot)?;
        Ok(Box::new(StiffKnees { inner, legs: robot.legs, straighter_rad: knee_deg.to_radians() }))
    },
};

static PELVIS_HEIGHT: StatePart = StatePart {
    name: "pelvis_height_m",
    about: "height of the pelvis at the section, m",
    invariant: false,
    of: |at| at.robot.base.position_m[2],
};

static INSIDE: RewardPart = RewardPart {
    name: "inside_by_2_deg",
    about: "-|psi_roll - 2 deg|",
    has_target: false,
    of: RewardOf::State(StateComponent::PSI_ROLL_DEG, &|psi, _| -(psi - 2.0).abs()),
};

/// Tries constant actions in the process and keeps the best.
struct RandomSearch(usize);

impl Learner for RandomSearch {
    fn improve(
        &mut self,
        process: &mut dyn StrideProcess,
        _initial: Option<&SavedPolicy>,
        rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialReport<'_>),
    ) -> Result<LearnOutcome, LearnError> {
        let spec = process.spec().clone();
        let (mut best, mut most, mut strides) = (Action::new(), f64::NEG_INFINITY, 0);
        for _ in 0..self.0 {
            let bounds = spec.action.iter().map(|a| (a.lower, a.upper - a.lower));
            let action: Action = bounds.map(|(l, w)| l + w * rng.random::<f64>()).collect();
            let (mut sum, act) = (0.0, |_: &_| action.clone());
            walk(process, 24, rng, act, |_, made| {
                let fell = made.stride.end.is_terminal();
                sum += if fell { f64::NEG_INFINITY } else { made.stride.reward };
                strides += 1;
                if fell { Next::Stop } else { Next::Go }
            })?;
            if best.is_empty() || sum > most {
                (best, most) = (action, sum);
            }
        }
        let policy = SavedPolicy::Constant(ConstantPolicy::new(spec, &best)?);
        Ok(LearnOutcome { policy, trials: Vec::new(), strides })
    }
}

impl Part for RandomSearch {
    fn name(&self) -> &'static str {
        "random_search"
    }
    fn about(&self) -> &'static str {
        "constant actions at random, in the map"
    }
}

impl LearnerPart for RandomSearch {
    fn needs_caution(&self) -> bool {
        false
    }
    fn propose(
        &self,
        known: &Known<'_>,
        rng: &mut ChaCha8Rng,
        observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        let candidates = known.task.learner.own.get("candidates").map_or(self.0, |n| *n as usize);
        known.in_map(&mut RandomSearch(candidates), None, true, rng, observer)
    }
}

/// Registers the parts and learns a task file that names them.
pub fn learn(task: &str) -> Result<Summary, Box<dyn Error>> {
    gaits().add(&STIFF_KNEES)?;
    states().add(&PELVIS_HEIGHT)?;
    rewards().add(&INSIDE)?;
    learners().add(&RandomSearch(20))?;
    let task = builtin::load(task, &[])?.task;
    let mut algorithm = Algorithm::new(&task, 1)?;
    algorithm.learn(&mut NoRecorder)?;
    Ok(algorithm.progress.summary(&task, 1))
}

fn main() -> Result<(), Box<dyn Error>> {
    let summary = learn(concat!(env!("CARGO_MANIFEST_DIR"), "/own.toml"))?;
    let [nominal, last] = [summary.nominal, summary.final_policy].map(|m| m.map(|m| m.performance.mean_reward));
    println!("nominal {nominal:.4?}, final {last:.4?}, {} strides", summary.strides.training);
    Ok(())
}
