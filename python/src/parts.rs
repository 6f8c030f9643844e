//! Parts of one's own in Python: gaits, rewards, learners, policies. They are registered by name, and a task names them.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError, RwLock};

use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PySlice};
use rand_chacha::ChaCha8Rng;
use stridemap_gait::{Gait, GaitError, Modulation};
use stridemap_lab::{
    GaitPart, Invalid, Known, LabError, LearnerPart, Part, RewardOf, RewardPart, StateComponent, Task as LabTask,
    gaits, learners, rewards, states,
};
use stridemap_learn::{SavedPolicy, TrialSummary};
use stridemap_process::{Action, Situation};
use stridemap_robot::{JointTargets, RobotDescription, RobotState, Side};

use crate::arrays::answered;
use crate::error::{Fault, of_lab, request};
use crate::map::Map;
use crate::policy::{Policy, python};

/// An exception that was raised where the lab has no room for it: the call that it spoils raises it.
static RAISED: Mutex<Option<PyErr>> = Mutex::new(None);

/// Keeps an exception; the first one counts.
fn keep(error: PyErr) {
    RAISED.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
}

/// The exception of a part that spoiled a call, instead of what the lab says of it.
pub fn blamed<T>(result: Result<T, Fault>) -> Result<T, Fault> {
    let raised = RAISED.lock().unwrap_or_else(PoisonError::into_inner).take();
    raised.map_or(result, |error| Err(Fault::Python(error)))
}

fn leaked(text: String) -> &'static str {
    text.leak() // A part is registered once in a program's life.
}

/// Classes of gaits with their modulations, by name.
static GAITS: RwLock<BTreeMap<String, (Py<PyAny>, Vec<Modulation>)>> = RwLock::new(BTreeMap::new());

/// The state of a robot as a Python gait sees it: views of one array, which is written anew every control period.
struct Shown {
    all: Py<PyArray1<f64>>,
    state: Py<PyAny>,
    modulation: Py<PyArray1<f64>>,
}

impl Shown {
    /// Numbers of a state that are not the joints'.
    const FIXED: [(&'static str, usize); 8] = [
        ("base_position_m", 3),
        ("base_orientation", 4),
        ("base_angular_velocity_rad_s", 3),
        ("com_position_m", 3),
        ("com_velocity_m_s", 3),
        ("foot_load_n", 2),
        ("foot_centre_m", 6),
        ("cop_m", 2),
    ];

    fn new(py: Python<'_>, joints: usize, modulations: &[Modulation]) -> PyResult<Self> {
        let own = ["position_rad", "velocity_rad_s", "torque_nm"].map(|name| (name, joints));
        let fields: Vec<(&str, usize)> = [("time_s", 1)].into_iter().chain(own).chain(Self::FIXED).collect();
        let all = PyArray1::<f64>::zeros(py, fields.iter().map(|f| f.1).sum::<usize>(), false);
        let state = py.import("types")?.getattr("SimpleNamespace")?.call0()?;
        let mut from = 0;
        for (name, width) in fields {
            let view = all.get_item(PySlice::new(py, from as isize, (from + width) as isize, 1))?;
            let view = if name == "foot_centre_m" { view.call_method1("reshape", ((2, 3),))? } else { view };
            state.setattr(name, view)?;
            from += width;
        }
        let neutral: Vec<f64> = modulations.iter().map(|m| m.neutral).collect();
        let modulation = PyArray1::from_vec(py, neutral);
        state.setattr("modulation", &modulation)?;
        Ok(Self { all: all.unbind(), state: state.unbind(), modulation: modulation.unbind() })
    }

    fn write(&self, py: Python<'_>, state: &RobotState) -> PyResult<()> {
        let mut all = self.all.bind(py).try_readwrite()?;
        let cop_m = state.cop_m.unwrap_or([f64::NAN; 2]);
        let joints = state.joints.iter();
        let numbers = std::iter::once(state.time_s)
            .chain(joints.clone().map(|j| j.position_rad))
            .chain(joints.clone().map(|j| j.velocity_rad_s))
            .chain(joints.map(|j| j.torque_nm))
            .chain(state.base.position_m)
            .chain(state.base.orientation)
            .chain(state.base.angular_velocity_rad_s)
            .chain(state.com.position_m)
            .chain(state.com.velocity_m_s)
            .chain(state.feet.map(|f| f.load_n))
            .chain(state.feet.iter().flat_map(|f| f.centre_m))
            .chain(cop_m);
        all.as_slice_mut()?.iter_mut().zip(numbers).for_each(|(to, from)| *to = from);
        Ok(())
    }
}

/// A gait written in Python.
struct PythonGait {
    gait: Py<PyAny>,
    shown: Shown,
    modulations: Vec<Modulation>,
    values: Vec<f64>,
    rest: JointTargets,
    start_up_s: f64,
    has_phase: bool,
}

/// What a gait is told of its robot.
fn description<'py>(py: Python<'py>, robot: &RobotDescription) -> PyResult<Bound<'py, PyAny>> {
    let told = PyDict::new(py);
    told.set_item("name", &robot.name)?;
    told.set_item("control_period_s", robot.control_period_s)?;
    told.set_item("mass_kg", robot.mass_kg)?;
    told.set_item("joint_names", robot.joints.iter().map(|j| j.name.as_str()).collect::<Vec<_>>())?;
    let rest_rad: Vec<f64> = robot.joints.iter().map(|j| j.rest_rad).collect();
    told.set_item("rest_rad", PyArray1::from_vec(py, rest_rad))?;
    let legs = PyDict::new(py);
    for (side, joint, role) in robot.legs.roles() {
        legs.set_item((side.name(), joint.name()), (role.joint, role.sign))?;
    }
    told.set_item("legs", legs)?;
    py.import("types")?.getattr("SimpleNamespace")?.call((), Some(&told))
}

impl PythonGait {
    fn new(
        class: &Py<PyAny>,
        modulations: Vec<Modulation>,
        task: &LabTask,
        robot: &RobotDescription,
    ) -> PyResult<Self> {
        Python::attach(|py| {
            let own = python(py, &task.gait.own)?;
            let gait = class.bind(py).call1((description(py, robot)?, own))?;
            let start_up_s = gait.getattr_opt("start_up_s")?.map_or(Ok(0.0), |s| s.extract())?;
            Ok(Self {
                shown: Shown::new(py, robot.joints.len(), &modulations)?,
                values: modulations.iter().map(|m| m.neutral).collect(),
                has_phase: gait.hasattr("phase_rad")?,
                gait: gait.unbind(),
                modulations,
                rest: robot.rest(),
                start_up_s,
            })
        })
    }

    fn call(&self, state: &RobotState, dt_s: f64, out: &mut JointTargets) -> PyResult<()> {
        Python::attach(|py| {
            self.shown.write(py, state)?;
            let answer = self.gait.call_method1(py, "targets", (&self.shown.state, dt_s))?;
            let angles = answered(answer.bind(py), &[self.rest.joints.len()], "targets")?;
            out.joints.iter_mut().zip(angles).for_each(|(joint, angle)| joint.position_rad = angle);
            Ok(())
        })
    }
}

impl Gait for PythonGait {
    fn modulations(&self) -> &[Modulation] {
        &self.modulations
    }

    fn rest(&self) -> &JointTargets {
        &self.rest
    }

    fn reset(&mut self) {
        self.values = self.modulations.iter().map(|m| m.neutral).collect();
        let reset = Python::attach(|py| {
            self.shown.modulation.bind(py).try_readwrite()?.as_slice_mut()?.copy_from_slice(&self.values);
            match self.gait.bind(py).hasattr("reset")? {
                true => self.gait.call_method0(py, "reset").map(|_| ()),
                false => Ok(()),
            }
        });
        reset.unwrap_or_else(keep);
    }

    fn modulate(&mut self, index: usize, value: f64) -> Result<(), GaitError> {
        let count = self.modulations.len();
        let m = self.modulations.get(index).ok_or(GaitError::NoSuchModulation { index, count })?;
        if !(m.lower..=m.upper).contains(&value) {
            let (name, lower, upper) = (m.name, m.lower, m.upper);
            return Err(GaitError::ModulationOutOfRange { name, value, lower, upper });
        }
        self.values[index] = value;
        let set = Python::attach(|py| {
            self.shown.modulation.bind(py).try_readwrite()?.as_slice_mut()?[index] = value;
            Ok(())
        });
        set.unwrap_or_else(keep);
        Ok(())
    }

    fn targets(&mut self, state: &RobotState, dt_s: f64, out: &mut JointTargets) {
        out.clone_from(&self.rest);
        if let Err(error) = self.call(state, dt_s, out) {
            keep(error);
            // No robot takes this command: the stride ends here.
            out.joints.iter_mut().for_each(|joint| joint.position_rad = f64::NAN);
        }
    }

    fn start_up_s(&self) -> f64 {
        self.start_up_s
    }

    fn phase_rad(&self, leg: Side) -> Option<f64> {
        if !self.has_phase {
            return None;
        }
        let phase = Python::attach(|py| self.gait.call_method1(py, "phase_rad", (leg.name(),))?.extract(py));
        phase.map_err(keep).ok()
    }
}

fn invalid(key: &str, requirement: String) -> LabError {
    LabError::Invalid(Invalid { key: key.into(), requirement })
}

fn build(task: &LabTask, robot: &RobotDescription) -> Result<Box<dyn Gait>, LabError> {
    let (class, modulations) = Python::attach(|py| {
        let gaits = GAITS.read().unwrap_or_else(PoisonError::into_inner);
        gaits.get(&task.gait.kind).map(|(class, modulations)| (class.clone_ref(py), modulations.clone()))
    })
    .ok_or_else(|| invalid("gait.kind", format!("there is no gait {:?}", task.gait.kind)))?;
    match PythonGait::new(&class, modulations, task, robot) {
        Ok(gait) => Ok(Box::new(gait)),
        Err(error) => {
            let told = invalid("gait.kind", format!("{} cannot be built: {error}", task.gait.kind));
            keep(error);
            Err(told)
        }
    }
}

/// Registers a gait, to be named by `gait.kind`: a class with
///
/// - `modulations`: a list of (name with unit, neutral, lowest, highest);
/// - `__init__(self, robot, own)`: the robot (`joint_names`, `rest_rad`, `legs[side, joint] = (index, sign)`,
///   `control_period_s`; when a task is read an outline with its leg joints alone) and the numbers of `gait.own`;
/// - `targets(self, state, dt)`: an angle for each joint, rad. `state` holds numpy views that are written anew every
///   control period (`time_s`, `position_rad`, `foot_load_n`, `cop_m`, ..., and `modulation`, in the order of the list);
/// - if it likes `reset(self)`, `start_up_s`, and `phase_rad(self, side)`.
#[pyfunction]
#[pyo3(signature = (name, gait, about=""))]
pub fn register_gait(py: Python<'_>, name: String, gait: Py<PyAny>, about: &str) -> PyResult<()> {
    let listed: Vec<(String, f64, f64, f64)> = gait.getattr(py, "modulations")?.extract(py)?;
    let modulations = listed.into_iter().map(|(name, neutral, lower, upper)| Modulation {
        name: leaked(name),
        neutral,
        lower,
        upper,
        about: "of a gait in Python",
    });
    let entry = (gait, modulations.collect());
    let part = GaitPart { name: leaked(name.clone()), about: leaked(about.into()), build };
    if gaits().find(&name).is_none() || !GAITS.read().unwrap_or_else(PoisonError::into_inner).contains_key(&name) {
        gaits().add(Box::leak(Box::new(part))).map_err(of_lab)?;
    }
    // The same name again takes the place of the old class: a notebook's cell is run more than once.
    GAITS.write().unwrap_or_else(PoisonError::into_inner).insert(name, entry);
    Ok(())
}

/// A number that a Python function answered; NaN after an exception, which is kept.
fn number(answer: PyResult<Py<PyAny>>, py: Python<'_>) -> f64 {
    let number = answer.and_then(|answer| answer.extract(py));
    number.unwrap_or_else(|error| {
        keep(error);
        f64::NAN
    })
}

/// Registers a quantity of the reward, to be named by a `[[reward]]`.
///
/// With `component`, a component of the state, it is `reward(value, target)` of that component at the section, and the
/// map of the state tells it. Without, it is `reward(measures)` of a dictionary of all that is measured of the stride,
/// and learns a map of its own.
#[pyfunction]
#[pyo3(signature = (name, reward, component=None, about="", has_target=false))]
pub fn register_reward(
    name: String,
    reward: Py<PyAny>,
    component: Option<&str>,
    about: &str,
    has_target: bool,
) -> PyResult<()> {
    let of = match component {
        Some(component) => {
            let part = states().find(component).ok_or_else(|| {
                let names: Vec<&str> = states().all().iter().map(|s| s.name).collect();
                request(format!("there is no component of the state {component:?} (there are: {})", names.join(", ")))
            })?;
            let of = move |value: f64, target: f64| Python::attach(|py| number(reward.call1(py, (value, target)), py));
            RewardOf::State(StateComponent(part), Box::leak(Box::new(of)))
        }
        None => RewardOf::Stride(Box::leak(Box::new(move |at: &stridemap_lab::AtSection<'_>| {
            Python::attach(|py| {
                let measures = python(py, at.measures);
                number(measures.and_then(|measures| reward.call1(py, (measures,))), py)
            })
        }))),
    };
    let part = RewardPart { name: leaked(name), about: leaked(about.into()), has_target, of };
    rewards().add(Box::leak(Box::new(part))).map_err(of_lab)
}

/// A learner written in Python.
struct PythonLearner {
    name: &'static str,
    about: &'static str,
    learner: Py<PyAny>,
    uses_map: bool,
    explores: bool,
}

impl Part for PythonLearner {
    fn name(&self) -> &'static str {
        self.name
    }
    fn about(&self) -> &'static str {
        self.about
    }
}

impl PythonLearner {
    fn ask(&self, known: &Known<'_>) -> PyResult<SavedPolicy> {
        Python::attach(|py| {
            let told = PyDict::new(py);
            let map = known.map.map(|map| Map::of(map.clone(), Arc::new(known.task.clone())));
            told.set_item("map", map)?;
            told.set_item("iteration", known.iteration())?;
            told.set_item("seed", known.seed)?;
            told.set_item("own", python(py, &known.task.learner.own)?)?;
            told.set_item("bounds", known.limits.iter().map(|l| (l.lower, l.upper)).collect::<Vec<_>>())?;
            let region = known.region.as_ref().map(|r| (r.lower.clone(), r.upper.clone()));
            told.set_item("region", region)?;
            let strides = known.progress.transitions.iter().map(|t| crate::stride::stride(py, t, None));
            told.set_item("strides", strides.collect::<PyResult<Vec<_>>>()?)?;
            let told = py.import("types")?.getattr("SimpleNamespace")?.call((), Some(&told))?;
            let answer = self.learner.call_method1(py, "improve", (told,))?;
            if let Ok(policy) = answer.extract::<Policy>(py) {
                return Ok((*policy.0).clone());
            }
            let action = answered(answer.bind(py), &[known.limits.len()], "improve")?;
            known.constant(&action).map_err(of_lab)
        })
    }
}

impl LearnerPart for PythonLearner {
    fn uses_map(&self) -> bool {
        self.uses_map
    }
    fn explores(&self) -> bool {
        self.explores
    }
    fn needs_caution(&self) -> bool {
        false
    }
    fn propose(
        &self,
        known: &Known<'_>,
        _rng: &mut ChaCha8Rng,
        _observer: &mut dyn FnMut(&TrialSummary),
    ) -> Result<SavedPolicy, LabError> {
        self.ask(known).map_err(|error| {
            let told = invalid("learner.kind", format!("{} failed: {error}", self.name));
            keep(error);
            told
        })
    }
}

/// Registers a learner, to be named by `learner.kind`: an object with `improve(self, known)`, which answers with a
/// `Policy`, or with an action to be taken always. `known` has `map`, `strides`, `bounds`, `region` (with caution),
/// `iteration`, `seed` and `own`.
#[pyfunction]
#[pyo3(signature = (name, learner, about="", uses_map=true, explores=true))]
pub fn register_learner(name: String, learner: Py<PyAny>, about: &str, uses_map: bool, explores: bool) -> PyResult<()> {
    let (name, about) = (leaked(name), leaked(about.into()));
    learners().add(Box::leak(Box::new(PythonLearner { name, about, learner, uses_map, explores }))).map_err(of_lab)
}

/// A policy written in Python: a function from the state to an action.
pub struct PythonPolicy {
    /// The function.
    pub policy: Py<PyAny>,
    /// Components of the action.
    pub actions: usize,
}

impl stridemap_learn::Policy for PythonPolicy {
    fn mean(&self, at: &Situation) -> Action {
        let action = Python::attach(|py| {
            let answer = self.policy.call1(py, (PyArray1::from_slice(py, &at.state),))?;
            answered(answer.bind(py), &[self.actions], "policy")
        });
        match action {
            Ok(action) => Action::from_slice(&action),
            Err(error) => {
                keep(error);
                std::iter::repeat_n(f64::NAN, self.actions).collect() // Refused by every process.
            }
        }
    }

    fn std(&self, _at: &Situation) -> Action {
        std::iter::repeat_n(0.0, self.actions).collect()
    }
}
