//! Thousands of imagined robots at once: what `MapVectorEnv` steps.

use numpy::ndarray::IxDyn;
use numpy::{IntoPyArray, PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use stridemap_lab::LabError;
use stridemap_lab::seed::{Role, stream};
use stridemap_map::{LearnedMap, MapFailure};
use stridemap_process::{Situation, StrideEnd, StrideProcess};

use crate::arrays::{Matrix, Numbers, array};
use crate::error::{of_lab, request};
use crate::map::{Map, draw_named};
use crate::policy::situation;

/// Fewer robots than this stride one after another: other threads cost more than they bring, and a process that was
/// forked has none.
const FEW: usize = 32;

/// One imagined robot.
struct Robot {
    map: LearnedMap,
    rng: ChaCha8Rng,
    at: Situation,
    reward: f64,
    fell: bool,
}

impl Robot {
    fn reset(&mut self, start: Option<&Situation>) -> Result<(), LabError> {
        self.at = match start {
            Some(start) => {
                self.map.start_at(start.clone())?;
                start.clone()
            }
            None => self.map.reset(&mut self.rng)?,
        };
        (self.reward, self.fell) = (0.0, false);
        Ok(())
    }

    fn stride(&mut self, action: &[f64], rewarded: bool) -> Result<(), LabError> {
        let stride = match rewarded {
            true => self.map.stride(action, &mut self.rng)?,
            false => self.map.imagine(action, &mut self.rng)?,
        };
        (self.at, self.reward, self.fell) = (stride.next, stride.reward, stride.end != StrideEnd::Crossing);
        Ok(())
    }
}

/// Robots in a learned map, each with a random stream of its own: stream i of `Role::Run` of the seed. They stride in
/// parallel, with the same numbers as one by one.
#[pyclass(module = "stridemap")]
pub struct MapBatch {
    robots: Vec<Robot>,
    states: usize,
    actions: usize,
    rewarded: bool,
}

impl MapBatch {
    fn each(
        &mut self,
        py: Python<'_>,
        work: impl Fn(usize, &mut Robot) -> Result<(), LabError> + Sync,
    ) -> PyResult<()> {
        let robots = &mut self.robots;
        py.detach(|| match robots.len() {
            ..FEW => robots.iter_mut().enumerate().try_for_each(|(i, robot)| work(i, robot)),
            _ => robots.par_iter_mut().with_min_len(FEW / 2).enumerate().try_for_each(|(i, robot)| work(i, robot)),
        })
        .map_err(of_lab)
    }

    fn matrix<'py>(&self, py: Python<'py>, width: usize, of: impl Fn(&Robot) -> &[f64]) -> PyResult<Bound<'py, PyAny>> {
        let mut values = Vec::with_capacity(self.robots.len() * width);
        self.robots.iter().for_each(|robot| values.extend_from_slice(of(robot)));
        Ok(array(py, IxDyn(&[self.robots.len(), width]), values)?.into_any())
    }

    fn chosen(&self, mask: Option<&PyReadonlyArray1<'_, bool>>) -> PyResult<Option<Vec<bool>>> {
        let Some(mask) = mask else { return Ok(None) };
        let mask: Vec<bool> = mask.as_array().iter().copied().collect();
        match mask.len() == self.robots.len() {
            true => Ok(Some(mask)),
            false => Err(request(format!("the mask has {} entries for {} robots", mask.len(), self.robots.len()))),
        }
    }
}

#[pymethods]
impl MapBatch {
    /// So many robots in a map. `draw` is "full", "latent" or "mean"; `falls` says whether the task's own falls end a
    /// stride; `rewarded` whether the task's own reward is drawn.
    #[new]
    #[pyo3(signature = (map, robots, draw="full", falls=true, rewarded=true))]
    fn new(map: &Map, robots: usize, draw: &str, falls: bool, rewarded: bool) -> PyResult<Self> {
        let mut one = (*map.map).clone().drawing(draw_named(draw)?);
        if !falls {
            one = one.failing(MapFailure { component: None, below: f64::NEG_INFINITY, reward: 0.0 });
        }
        let spec = &one.world().spec;
        let (states, actions) = (spec.state.len(), spec.action.len());
        let robot = |i| Robot {
            map: one.clone(),
            rng: stream(0, Role::Run, i),
            at: Situation::default(),
            reward: 0.0,
            fell: false,
        };
        Ok(Self { robots: (0..robots as u64).map(robot).collect(), states, actions, rewarded })
    }

    /// Begins the random streams anew, from a seed for all or one for each.
    fn seed(&mut self, seed: Vec<u64>) -> PyResult<()> {
        let same = seed.len() == 1;
        if !same && seed.len() != self.robots.len() {
            return Err(request(format!("{} seeds for {} robots", seed.len(), self.robots.len())));
        }
        for (i, robot) in self.robots.iter_mut().enumerate() {
            robot.rng = if same { stream(seed[0], Role::Run, i as u64) } else { stream(seed[i], Role::Run, 0) };
        }
        Ok(())
    }

    /// Starts the robots anew, or those of the mask: in states (and after last actions) of the caller's choice, or
    /// where the task says. Returns the states.
    #[pyo3(signature = (mask=None, state=None, last_action=None))]
    fn reset<'py>(
        &mut self,
        py: Python<'py>,
        mask: Option<PyReadonlyArray1<'py, bool>>,
        state: Option<Numbers<'py>>,
        last_action: Option<Numbers<'py>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let mask = self.chosen(mask.as_ref())?;
        let state = state.map(|x| Matrix::read(&x, self.states, "state")).transpose()?;
        let last = last_action.map(|u| Matrix::read(&u, self.actions, "last_action")).transpose()?;
        for (what, given) in [("state", &state), ("last_action", &last)] {
            if let Some(given) = given.as_ref().filter(|m| !m.is_single && m.len() != self.robots.len()) {
                return Err(request(format!("{what} has {} rows for {} robots", given.len(), self.robots.len())));
            }
        }
        self.each(py, |i, robot| {
            if mask.as_ref().is_some_and(|mask| !mask[i]) {
                return Ok(());
            }
            let start = state.as_ref().map(|state| {
                let neutral: Vec<f64> = robot.map.world().limits.iter().map(|l| l.neutral).collect();
                situation(state.row(i), Some(last.as_ref().map_or(&neutral, |u| u.row(i))))
            });
            robot.reset(start.as_ref())
        })?;
        self.states(py)
    }

    /// A stride of each robot with its action; those of the mask start anew instead. Returns states, rewards, and who
    /// fell.
    #[pyo3(signature = (actions, reset=None))]
    #[expect(clippy::type_complexity, reason = "three arrays")]
    fn step<'py>(
        &mut self,
        py: Python<'py>,
        actions: Numbers<'py>,
        reset: Option<PyReadonlyArray1<'py, bool>>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>)> {
        let reset = self.chosen(reset.as_ref())?;
        let actions = Matrix::read(&actions, self.actions, "actions")?;
        if actions.is_single || actions.len() != self.robots.len() {
            return Err(request(format!("actions need a row for each of {} robots", self.robots.len())));
        }
        let rewarded = self.rewarded;
        self.each(py, |i, robot| match reset.as_ref().is_some_and(|reset| reset[i]) {
            true => robot.reset(None),
            false => robot.stride(actions.row(i), rewarded),
        })?;
        let rewards: Vec<f64> = self.robots.iter().map(|r| r.reward).collect();
        let fell: Vec<bool> = self.robots.iter().map(|r| r.fell).collect();
        Ok((self.states(py)?, rewards.into_pyarray(py), fell.into_pyarray(py)))
    }

    /// Where the robots are, `(N, n)`.
    fn states<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.matrix(py, self.states, |robot| &robot.at.state)
    }

    /// The actions applied last, after bounds and rate limits, `(N, m)`.
    fn last_actions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.matrix(py, self.actions, |robot| &robot.at.last_action)
    }
}
