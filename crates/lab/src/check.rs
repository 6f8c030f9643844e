//! Can a task work? Looked at before anything is learned.

use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};
use stridemap_mujoco::{JointReport, MujocoRobot};
use stridemap_process::{ActionLimits, ProcessError, StrideEnd};
use stridemap_record::{Recording, StridePhase, StrideRole};
use stridemap_robot::{Hold, Robot, Side};

use crate::error::LabError;
use crate::nominal::{DOWN, NOMINAL_S, nominal_gait, nominal_gait_on_film};
use crate::plant::Batch;
use crate::preflight::preflight;
use crate::seed::{Role, stream};
use crate::stepping::{CLEARANCE_SHARE, GaitVerdict, Stepping};
use crate::strides::{ActionSource, Exploration, ExploreRange, make_strides};
use crate::task::Task;

/// Strides with random actions to see whether the action moves the map.
const EXCITED_STRIDES: usize = 40;
/// ... or so many for each component of the action, if that is more.
const STRIDES_PER_ACTION: usize = 20;
/// Strides with the task's own exploration.
const EXPLORED_STRIDES: usize = 40;
/// Share of an action's bounds, about its neutral value, over which it is excited.
const EXCITED_SHARE: f64 = 0.25;

/// One question and its answer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CheckItem {
    /// What was looked at.
    pub what: String,
    /// Whether it is as it must be.
    pub ok: bool,
    /// What was found; where it is not ok, what to do.
    pub found: String,
}

/// How strongly an action moves the next state, from a linear fit over excited strides.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gain {
    /// Component of the next state.
    pub state: String,
    /// Component of the action.
    pub action: String,
    /// Change of the next state per unit of the action.
    pub gain: f64,
    /// Its standard error.
    pub std_error: f64,
}

/// Everything that a check found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct CheckReport {
    /// Whether every item is ok.
    pub ok: bool,
    /// The items, in the order in which they were looked at; it ends at the first that makes the next
    /// ones meaningless.
    pub items: Vec<CheckItem>,
    /// The joint map.
    pub joints: Vec<JointReport>,
    /// How the actions move the section map.
    pub gains: Vec<Gain>,
    /// Whether the nominal gait steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<GaitVerdict>,
    /// How it steps.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub stepping: Option<Stepping>,
    /// How far each leg joint sags under the robot's weight at rest, in degrees, by its name in the model.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sag_deg: Vec<(String, f64)>,
    /// Why the task is refused, where a threshold or price of its falls does not fit the robot: `learn`
    /// refuses it as well.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub refused: Option<String>,
}

impl CheckReport {
    fn item(&mut self, what: &str, ok: bool, found: String) -> bool {
        self.ok &= ok;
        self.items.push(CheckItem { what: what.into(), ok, found });
        ok
    }
}

/// Looks at a task: joints found and plausible, feet on the floor, the nominal gait steps for 20 s,
/// sections seen, the section map moved by every action.
///
/// # Errors
///
/// [`LabError`] if the robot cannot be built or driven; that it does not walk is an answer.
pub fn check(task: &Task, seed: u64) -> Result<CheckReport, LabError> {
    check_on_film(task, seed, None)
}

/// The same; `film` gets the nominal gait, whatever becomes of it, if it comes to that.
///
/// # Errors
///
/// As [`check`].
pub fn check_on_film(task: &Task, seed: u64, film: Option<&mut Recording>) -> Result<CheckReport, LabError> {
    let mut report = CheckReport { ok: true, ..CheckReport::default() };

    let mut robot = MujocoRobot::new(task.robot.clone()).map_err(|error| task.located(error))?;
    report.joints = robot.joint_report()?;
    let problems: Vec<String> = report
        .joints
        .iter()
        .filter_map(|j| {
            let problem = j.problem.as_ref()?;
            Some(format!("{:?} {} ({}): {problem}", j.side, j.joint.name(), j.model_joint))
        })
        .collect();
    let found = if problems.is_empty() {
        let count = report.joints.len();
        format!("{count} joints found, axes and signs plausible")
    } else {
        problems.join("; ")
    };
    let joints_ok = report.item("joints", problems.is_empty(), found);

    if task.robot.sensors.is_some() {
        let faults = preflight(task, &mut stream(seed, Role::Check, 4))?;
        let found: Vec<String> = faults.iter().map(|fault| format!("{}: {}", fault.kind, fault.found)).collect();
        let found = match found[..] {
            [] => "sensors and joints answer as the model's, held in the air and let down".into(),
            _ => found.join("; "),
        };
        if !report.item("wiring", faults.is_empty(), found) {
            return Ok(report);
        }
    }

    let rest = robot.description().rest();
    let start = robot.reset(&rest, &mut stream(seed, Role::Check, 0))?;
    let first_height_m = start.com.position_m[2];
    // Who senses no forces is held upright: its servos alone need not balance it.
    let held = task.robot.sensors.as_ref().map(|_| Hold::default());
    if held.is_some() {
        robot.hold(held)?;
    }
    let stand_s = 1.0;
    let ticks = (stand_s / task.robot.control_period_s).ceil() as usize;
    // Over the second half of the time: contacts come and go from tick to tick, on a height field above all.
    let mut loads_n = [0.0; 2];
    for tick in 0..ticks {
        robot.step(&rest)?;
        if tick >= ticks / 2 {
            let seen = (ticks - ticks / 2) as f64;
            for side in Side::BOTH {
                loads_n[side.index()] += robot.state().foot(side).load_n / seen;
            }
        }
    }
    let state = robot.state();
    let legs = robot.description().legs.roles();
    report.sag_deg = legs
        .map(|(.., role)| {
            let joint = &robot.description().joints[role.joint];
            (joint.name.clone(), (state.joints[role.joint].position_rad - joint.rest_rad).to_degrees())
        })
        .collect();
    let weight_n = robot.description().mass_kg * robot.gravity_m_s2().iter().map(|g| g * g).sum::<f64>().sqrt();
    let carried_n: f64 = loads_n.iter().sum();
    let stands = DOWN.of_body(state, first_height_m).is_none()
        && (carried_n - weight_n).abs() < 0.1 * weight_n
        && loads_n.iter().all(|load_n| *load_n > 0.2 * weight_n);
    let most = report.sag_deg.iter().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    let sag = most.map(|(joint, deg)| format!(", {joint} sags most, by {deg:.1} deg")).unwrap_or_default();
    let found = format!(
        "after {stand_s} s at rest: feet carry {:.0} + {:.0} N of {weight_n:.0} N, tilt {:.1} deg{sag}",
        loads_n[Side::Left.index()],
        loads_n[Side::Right.index()],
        state.base.tilt_rad().to_degrees()
    );
    let stands = report.item("feet touch", stands, found);
    if !(joints_ok && stands) {
        return Ok(report);
    }

    if let Some(task) = check_nominal(task, seed, &mut report, film)? {
        check_excitation(&task, seed, &mut report)?;
        if report.ok && task.caution.is_none() {
            check_exploration(&task, seed, &mut report)?;
        }
    }
    Ok(report)
}

/// What to try where the nominal gait does not carry the robot.
const TRY: &str = "`stridemap tune FILE` searches amplitudes, rest posture and gains that step";

/// The nominal gait steps, every step shows a section, and the task's thresholds and prices fit it.
/// `None` where it cannot work; else the task, with what it left to the robot told.
fn check_nominal(
    task: &Task,
    seed: u64,
    report: &mut CheckReport,
    film: Option<&mut Recording>,
) -> Result<Option<Task>, LabError> {
    let mut gait = match nominal_gait_on_film(task, seed, film) {
        Ok(gait) => gait,
        Err(LabError::NominalGaitFails { time_s, fall, how, .. }) => {
            let found = format!("falls in its start, after {time_s:.1} s: {fall}{how}; {TRY}");
            report.verdict = Some(GaitVerdict::Falls);
            report.item("nominal gait", false, found);
            return Ok(None);
        }
        Err(LabError::Process(error)) => {
            report.item("nominal gait", false, error.to_string());
            return Ok(None);
        }
        Err(error) => return Err(error),
    };
    let s = &gait.stepping;
    let found = match (gait.verdict(), &gait.fell) {
        (GaitVerdict::Steps, _) => format!(
            "steps for {NOMINAL_S} s: feet clear {:.1} mm, both carry load {:.0} % of the time",
            1e3 * s.clearance_m,
            100.0 * s.both_feet_share
        ),
        (_, Some((time_s, fall))) => {
            let how = s.falling.as_ref().map(|how| format!(", {how}")).unwrap_or_default();
            format!("falls after {time_s:.1} s: {fall}{how}; {TRY}")
        }
        (_, None) => format!(
            "shuffles: it sways for {NOMINAL_S} s, but the feet clear {:.1} mm ({:.1} % of its height; a step is {:.1} %), \
             both carry load {:.0} % of the time, and {} supports alternate in {} sections; {TRY}",
            1e3 * s.clearance_m,
            100.0 * s.clearance_share,
            100.0 * CLEARANCE_SHARE,
            100.0 * s.both_feet_share,
            s.supports,
            s.sections
        ),
    };
    report.stepping = Some(gait.stepping.clone());
    report.verdict = Some(gait.verdict());
    if !report.item("nominal gait", gait.verdict() == GaitVerdict::Steps, found) {
        return Ok(None);
    }
    let mut task = task.clone();
    if !task.auto.is_empty() {
        let told = task.tell().map(|_| task.told.join("; "));
        let (ok, found) = told.map_or_else(|error| (false, error.to_string()), |told| (true, told));
        if !report.item("auto", ok, found) {
            return Ok(None);
        }
        gait = nominal_gait(&task, seed)?;
    }
    let [left, right] = gait.stances;
    let both = left > 0 && right > 0 && left.abs_diff(right) <= 1 + gait.strides / 10;
    let found = format!("{} strides, {left} from the left leg and {right} from the right", gait.strides);
    let both = report.item("sections", both, found);
    report.refused = gait.refuse(&task.failure).err().map(|e| task.located(e).to_string());
    let found = report.refused.clone().unwrap_or_else(|| {
        format!(
            "the nominal gait stays within the thresholds; a stride of it earns {:.3}, a fall {}",
            gait.mean_reward, task.failure.reward
        )
    });
    let priced = report.item("falls", report.refused.is_none(), found);
    Ok((both && priced).then_some(task))
}

/// The first strides as `learn` would make them do not spend its budget of falls. (Under a guard it does not let it come so far.)
fn check_exploration(task: &Task, seed: u64, report: &mut CheckReport) -> Result<(), LabError> {
    let mut plant = task.plant()?;
    let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: EXPLORED_STRIDES };
    let source = ActionSource::Explore(task.exploration());
    let mut rng = stream(seed, Role::Check, 3);
    let made = make_strides(&mut plant, &source, batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()))?;
    let falls = made.iter().filter(|t| t.end != StrideEnd::Crossing).count();
    let most = task.algorithm.falls_at_most;
    let found = format!("{falls} falls in {EXPLORED_STRIDES} strides of exploration as `learn` makes them");
    let ok = falls <= most;
    let why = format!(
        ", where algorithm.falls_at_most allows {most} in a run: bring bounds and explore.center of the actions nearer to the \
         nominal gait, or extend \"stepping-auto\", which measures them"
    );
    report.item("exploration", ok, if ok { found } else { found + &why });
    Ok(())
}

/// Random actions move the next state: rank and gain of a linear fit.
fn check_excitation(task: &Task, seed: u64, report: &mut CheckReport) -> Result<(), LabError> {
    let mut plant = task.plant()?;
    let limits = task.action_limits()?;
    let range = |l: &ActionLimits| {
        let half = 0.5 * EXCITED_SHARE * (l.upper - l.lower);
        ExploreRange { center: [(l.neutral - half).max(l.lower), (l.neutral + half).min(l.upper)], std: 0.0 }
    };
    let explore = Exploration {
        ranges: limits.iter().map(range).collect(),
        // Actions of limited rate need some strides to get anywhere.
        hold: if limits.iter().any(|l| l.rate_per_stride.is_finite()) { 4 } else { 1 },
    };
    let excited_strides = EXCITED_STRIDES.max(STRIDES_PER_ACTION * limits.len());
    let batch = Batch { iteration: 0, phase: StridePhase::Record, role: StrideRole::Record, strides: excited_strides };
    let mut rng = stream(seed, Role::Check, 2);
    let transitions =
        make_strides(&mut plant, &ActionSource::Explore(explore), batch, &mut rng, &mut |_, _| {}, &mut |_| Ok(()));
    let transitions = match transitions {
        Ok(transitions) => transitions,
        Err(LabError::Process(error)) => {
            let found = match &error {
                ProcessError::World(cause) => match cause.downcast_ref() {
                    Some(LabError::NominalGaitFails { time_s, fall, .. }) => {
                        format!("the nominal gait falls in its start, after {time_s:.1} s: {fall}; {TRY}")
                    }
                    _ => error.to_string(),
                },
                _ => error.to_string(),
            };
            report.item("section map", false, found);
            return Ok(());
        }
        Err(error) => return Err(error),
    };
    let falls = transitions.iter().filter(|t| t.end != StrideEnd::Crossing).count();
    let rows: Vec<_> = transitions.iter().filter(|t| t.end == StrideEnd::Crossing).collect();
    let (n, states, actions) = (rows.len(), task.state.len(), task.action.len());
    let columns = 1 + states + actions;
    if n <= columns + 2 {
        report.item("section map", false, format!("{falls} falls in {excited_strides} strides"));
        return Ok(());
    }
    let design = DMatrix::from_fn(n, columns, |i, j| match j {
        0 => 1.0,
        j if j <= states => rows[i].state[j - 1],
        j => rows[i].action[j - 1 - states],
    });
    let gram = design.transpose() * &design;
    let Some(inverse) = gram.clone().try_inverse() else {
        let found = "the actions do not vary independently; widen their bounds".to_string();
        report.item("section map", false, found);
        return Ok(());
    };
    let mut strongest = vec![0.0_f64; actions];
    for (c, component) in task.state.iter().enumerate() {
        let y = DVector::from_fn(n, |i, _| rows[i].next_state[c]);
        let beta = &inverse * design.transpose() * &y;
        let residual = &y - &design * &beta;
        let variance = residual.norm_squared() / (n - columns) as f64;
        for (a, action) in task.action.iter().enumerate() {
            let j = 1 + states + a;
            let std_error = (variance * inverse[(j, j)]).sqrt();
            strongest[a] = strongest[a].max((beta[j] / std_error).abs());
            report.gains.push(Gain {
                state: component.name().into(),
                action: action.modulates.clone(),
                gain: beta[j],
                std_error,
            });
        }
    }
    let weak: Vec<&str> = task
        .action
        .iter()
        .zip(&strongest)
        .filter(|(_, t)| **t < 2.0)
        .map(|(action, _)| action.modulates.as_str())
        .collect();
    let found = if weak.is_empty() {
        format!("every action moves the next state; {falls} falls in {excited_strides} strides")
    } else {
        format!("no effect seen of {} beyond the noise; give it wider bounds, or choose another", weak.join(", "))
    };
    report.item("section map", weak.is_empty(), found);
    Ok(())
}
