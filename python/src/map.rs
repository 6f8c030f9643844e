//! The learned map: predictions, draws, slopes and roll-outs over many rows at once, in parallel.

use std::sync::Arc;

use numpy::ndarray::IxDyn;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use stridemap_lab::{Algorithm, LabError, NoRecorder, Task as LabTask};
use stridemap_learn::Policy as _;
use stridemap_map::{LearnedMap, MapDraw};
use stridemap_process::{Action, Situation, StrideEnd, StrideProcess};

use crate::arrays::{Matrix, Numbers, answered, array, rows_together, shaped};
use crate::error::{of_lab, request};
use crate::interrupt::interruptible;
use crate::policy::{Policy, check_fits, row_rng, seed_of, situation};
use crate::task::TaskLike;

/// The stride-to-stride map learned of a robot: x(k+1) = f(x(k), u(k)) + n(k).
///
/// Every method takes single states, shape `(n,)`, or rows of them, `(N, n)`; rows are worked on in parallel, with
/// the same numbers as one by one. Row i draws from stream i of the seed.
#[pyclass(module = "stridemap", frozen, from_py_object)]
#[derive(Clone)]
pub struct Map {
    pub map: Arc<LearnedMap>,
    pub task: Arc<LabTask>,
}

/// Rows of states, actions and last actions that belong together.
struct Asked {
    state: Matrix,
    action: Matrix,
    last_action: Option<Matrix>,
    rows: usize,
    is_single: bool,
}

impl Asked {
    fn at(&self, i: usize) -> Situation {
        // Without a last action the action is taken to have been the last one as well.
        situation(self.state.row(i), Some(self.last_action.as_ref().unwrap_or(&self.action).row(i)))
    }

    /// Asks for every row, in parallel; the numbers of all rows, one after another.
    fn each(
        &self,
        py: Python<'_>,
        of: impl Fn(&Situation, &[f64], usize) -> Result<Vec<f64>, LabError> + Sync,
    ) -> PyResult<Vec<f64>> {
        let one = |i: usize| of(&self.at(i), self.action.row(i), i);
        let all = py.detach(|| (0..self.rows).into_par_iter().map(one).collect::<Result<Vec<_>, _>>());
        Ok(all.map_err(of_lab)?.concat())
    }
}

impl Map {
    /// A map of the lab's.
    pub fn of(map: LearnedMap, task: Arc<LabTask>) -> Self {
        Self { map: Arc::new(map), task }
    }

    fn sizes(&self) -> (usize, usize) {
        let spec = &self.map.world().spec;
        (spec.state.len(), spec.action.len())
    }

    fn asked(&self, x: &Numbers<'_>, u: &Numbers<'_>, last: Option<&Numbers<'_>>) -> PyResult<Asked> {
        let (n, m) = self.sizes();
        let (state, action) = (Matrix::read(x, n, "x")?, Matrix::read(u, m, "u")?);
        let last_action = last.map(|u| Matrix::read(u, m, "last_action")).transpose()?;
        let mut all = vec![("x", &state), ("u", &action)];
        all.extend(last_action.as_ref().map(|u| ("last_action", u)));
        let (rows, is_single) = rows_together(&all)?;
        Ok(Asked { state, action, last_action, rows, is_single })
    }
}

/// What a stride draws, by name.
pub fn draw_named(name: &str) -> PyResult<MapDraw> {
    match name {
        "full" => Ok(MapDraw::Full),
        "latent" => Ok(MapDraw::Latent),
        "mean" => Ok(MapDraw::Mean),
        _ => Err(request(format!("draw = {name:?}; it is one of \"full\", \"latent\", \"mean\""))),
    }
}

/// A roll-out of one particle.
#[derive(Default)]
struct Rolled {
    states: Vec<f64>,
    actions: Vec<f64>,
    rewards: Vec<f64>,
    length: usize,
    fell: bool,
}

impl Rolled {
    /// Fills what a particle that fell did not make.
    fn padded(mut self, strides: usize, n: usize, m: usize) -> Self {
        self.states.resize((strides + 1) * n, f64::NAN);
        self.actions.resize(strides * m, f64::NAN);
        self.rewards.resize(strides, f64::NAN);
        self
    }

    fn saw(&mut self, stride: &stridemap_process::Stride) {
        self.actions.extend(stride.action());
        self.states.extend(&stride.next.state);
        self.rewards.push(stride.reward);
        self.length += 1;
        self.fell = stride.end != StrideEnd::Crossing;
    }
}

#[pymethods]
impl Map {
    /// Components of the state.
    #[getter]
    fn state_names(&self) -> Vec<String> {
        self.map.world().spec.state.iter().map(|d| d.name.clone()).collect()
    }

    /// Components of the action.
    #[getter]
    fn action_names(&self) -> Vec<String> {
        self.map.world().spec.action.iter().map(|d| d.name.clone()).collect()
    }

    /// Smallest and largest value of each component of the action.
    #[getter]
    fn action_bounds(&self) -> Vec<(f64, f64)> {
        self.map.world().spec.action.iter().map(|d| (d.lower, d.upper)).collect()
    }

    /// Strides that it was fitted to.
    #[getter]
    fn samples(&self) -> usize {
        self.map.samples().len()
    }

    /// `log p(y | X)` of each output, nats.
    #[getter]
    fn log_marginal_likelihoods(&self) -> Vec<f64> {
        self.map.log_marginal_likelihoods()
    }

    /// Mean and covariance of the next state, `(N, n)` and `(N, n, n)`: of the latent function, or with `noise` of the
    /// next observation. The components are independent given x and u. The action is taken as it is.
    #[pyo3(signature = (x, u, last_action=None, noise=false))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        x: Numbers<'py>,
        u: Numbers<'py>,
        last_action: Option<Numbers<'py>>,
        noise: bool,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (asked, n) = (self.asked(&x, &u, last_action.as_ref())?, self.sizes().0);
        let noises: Vec<f64> = self.map.outputs().iter().map(|gp| gp.hyperparameters().noise_variance).collect();
        let both = asked.each(py, |at, action, _| {
            let p = self.map.predict(at, action)?;
            let variances = p.latent_variances.iter().zip(&noises);
            let variances = variances.map(|(v, noise_variance)| if noise { v + noise_variance } else { *v });
            Ok(p.means.iter().copied().chain(variances).collect())
        })?;
        let (mut means, mut covariances) = (Vec::new(), vec![0.0; asked.rows * n * n]);
        for (row, both) in both.chunks_exact(2 * n).enumerate() {
            means.extend(&both[..n]);
            for i in 0..n {
                covariances[row * n * n + i * n + i] = both[n + i];
            }
        }
        Ok((
            shaped(py, asked.is_single, asked.rows, &[n], means)?.into_any(),
            shaped(py, asked.is_single, asked.rows, &[n, n], covariances)?.into_any(),
        ))
    }

    /// Draws the next state, as a stride in the map does. `rng` is a seed, or a numpy generator that draws one.
    #[pyo3(signature = (x, u, rng, last_action=None))]
    fn sample<'py>(
        &self,
        py: Python<'py>,
        x: Numbers<'py>,
        u: Numbers<'py>,
        rng: &Bound<'py, PyAny>,
        last_action: Option<Numbers<'py>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (asked, seed) = (self.asked(&x, &u, last_action.as_ref())?, seed_of(rng)?);
        let drawn = asked.each(py, |at, action, i| {
            Ok(self.map.sample(at, action, &mut row_rng(seed, i))?.iter().copied().collect())
        })?;
        Ok(shaped(py, asked.is_single, asked.rows, &[self.sizes().0], drawn)?.into_any())
    }

    /// Derivatives of the mean by state and by action, `(N, n, n)` and `(N, n, m)`: the matrices A and B.
    #[pyo3(signature = (x, u, last_action=None))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        x: Numbers<'py>,
        u: Numbers<'py>,
        last_action: Option<Numbers<'py>>,
    ) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let (asked, (n, m)) = (self.asked(&x, &u, last_action.as_ref())?, self.sizes());
        let both = asked.each(py, |at, action, _| {
            let found = self.map.linearized(at, action)?;
            // Column by column in the matrices, row by row in numpy.
            Ok(found.state.transpose().iter().chain(found.action.transpose().iter()).copied().collect())
        })?;
        let (mut by_state, mut by_action) = (Vec::new(), Vec::new());
        for both in both.chunks_exact(n * (n + m)) {
            by_state.extend(&both[..n * n]);
            by_action.extend(&both[n * n..]);
        }
        Ok((
            shaped(py, asked.is_single, asked.rows, &[n, n], by_state)?.into_any(),
            shaped(py, asked.is_single, asked.rows, &[n, m], by_action)?.into_any(),
        ))
    }

    /// Rolls a policy out from states `x0`: `n` strides of `particles` particles each, with the action law, falls and
    /// reward of the task.
    ///
    /// `policy` is a `Policy`, whose particles run in parallel, or a function from states `(P, n)` to actions `(P, m)`,
    /// which is called once per stride. Particle j of row i draws from stream `i * particles + j` of the seed `rng`.
    ///
    /// Returns a dictionary: `states` (N, particles, n + 1, d), `actions`, `rewards`, `lengths`, `fell`; without the
    /// axis of rows for a single `x0`. What comes after a fall is NaN.
    #[pyo3(signature = (policy, x0, n, particles=1, rng=None, last_action=None, draw="full", sample_policy=false))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn rollout<'py>(
        &self,
        py: Python<'py>,
        policy: &Bound<'py, PyAny>,
        x0: Numbers<'py>,
        n: usize,
        particles: usize,
        rng: Option<&Bound<'py, PyAny>>,
        last_action: Option<Numbers<'py>>,
        draw: &str,
        sample_policy: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let (states, actions) = self.sizes();
        let start = Matrix::read(&x0, states, "x0")?;
        let last = last_action.map(|u| Matrix::read(&u, actions, "last_action")).transpose()?;
        let mut all = vec![("x0", &start)];
        all.extend(last.as_ref().map(|u| ("last_action", u)));
        let (rows, single) = rows_together(&all)?;
        let (seed, draw) = (rng.map_or(Ok(0), seed_of)?, draw_named(draw)?);
        let neutral: Vec<f64> = self.map.world().limits.iter().map(|l| l.neutral).collect();
        let begin = |i: usize| -> Result<LearnedMap, LabError> {
            let mut map = (*self.map).clone().drawing(draw);
            let row = i / particles.max(1);
            map.start_at(situation(start.row(row), Some(last.as_ref().map_or(&neutral, |u| u.row(row)))))?;
            Ok(map)
        };
        let x0 = |i: usize| start.row(i / particles.max(1)).to_vec();
        let count = rows * particles;
        let rolled: Vec<Rolled> = if let Ok(policy) = policy.extract::<Policy>() {
            let policy = policy.0;
            check_fits(&policy, &self.task).map_err(of_lab)?;
            let one = |i: usize| -> Result<Rolled, LabError> {
                let (mut map, mut rng) = (begin(i)?, row_rng(seed, i));
                let mut rolled = Rolled { states: x0(i), ..Rolled::default() };
                let mut at = situation(&rolled.states, Some(last.as_ref().map_or(&neutral, |u| u.row(i / particles))));
                while rolled.length < n && !rolled.fell {
                    let action = if sample_policy { policy.sample(&at, &mut rng) } else { policy.mean(&at) };
                    let stride = map.stride(&action, &mut rng)?;
                    rolled.saw(&stride);
                    at = stride.next;
                }
                Ok(rolled.padded(n, states, actions))
            };
            py.detach(|| (0..count).into_par_iter().map(one).collect::<Result<_, _>>()).map_err(of_lab)?
        } else {
            let mut maps = (0..count).map(begin).collect::<Result<Vec<_>, _>>().map_err(of_lab)?;
            let mut rngs: Vec<_> = (0..count).map(|i| row_rng(seed, i)).collect();
            let mut rolled: Vec<Rolled> = (0..count).map(|i| Rolled { states: x0(i), ..Rolled::default() }).collect();
            for _ in 0..n {
                let on: Vec<usize> = (0..count).filter(|i| !rolled[*i].fell).collect();
                let at: Vec<f64> =
                    on.iter().flat_map(|i| rolled[*i].states[rolled[*i].length * states..].to_vec()).collect();
                let answer = policy.call1((array(py, IxDyn(&[on.len(), states]), at)?,))?;
                let wanted = answered(&answer, &[on.len(), actions], "policy")?;
                let wanted = &wanted;
                py.detach(|| {
                    let going = maps.par_iter_mut().zip(&mut rngs).zip(&mut rolled).filter(|(_, rolled)| !rolled.fell);
                    let going: Vec<_> = going.collect();
                    going.into_par_iter().enumerate().try_for_each(|(j, ((map, rng), rolled))| {
                        let action = Action::from_slice(&wanted[j * actions..(j + 1) * actions]);
                        rolled.saw(&map.stride(&action, rng)?);
                        Ok::<(), LabError>(())
                    })
                })
                .map_err(of_lab)?;
            }
            rolled.into_iter().map(|r| r.padded(n, states, actions)).collect()
        };
        let shape = |more: &[usize]| -> Vec<usize> {
            let rows = (!single).then_some(rows);
            rows.into_iter().chain([particles]).chain(more.iter().copied()).collect()
        };
        let gather = |of: fn(&Rolled) -> &[f64]| rolled.iter().flat_map(of).copied().collect::<Vec<f64>>();
        let out = PyDict::new(py);
        out.set_item("states", array(py, IxDyn(&shape(&[n + 1, states])), gather(|r| &r.states))?)?;
        out.set_item("actions", array(py, IxDyn(&shape(&[n, actions])), gather(|r| &r.actions))?)?;
        out.set_item("rewards", array(py, IxDyn(&shape(&[n])), gather(|r| &r.rewards))?)?;
        let lengths: Vec<f64> = rolled.iter().map(|r| r.length as f64).collect();
        let fell: Vec<f64> = rolled.iter().map(|r| f64::from(u8::from(r.fell))).collect();
        for (name, values, kind) in [("lengths", lengths, "int64"), ("fell", fell, "bool")] {
            out.set_item(name, array(py, IxDyn(&shape(&[])), values)?.call_method1("astype", (kind,))?)?;
        }
        Ok(out)
    }

    /// The map of the first strides of a task: the robot explores as the task says, and the map is fitted to it.
    #[staticmethod]
    #[pyo3(signature = (task, seed=1))]
    fn of_task(py: Python<'_>, task: TaskLike, seed: u64) -> PyResult<Self> {
        let task = task.load(None)?;
        interruptible(py, &Arc::default(), move || {
            let task = task.ready(seed)?.task;
            let mut algorithm = Algorithm::new(&task, seed)?;
            algorithm.collect(&mut NoRecorder)?;
            let map = algorithm.fit(&mut NoRecorder)?;
            drop(algorithm);
            Ok(Self::of(map, Arc::new(task)))
        })
    }

    fn __copy__(&self) -> Self {
        self.clone()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> Self {
        self.clone() // It never changes.
    }

    fn __repr__(&self) -> String {
        format!("<stridemap.Map of {} strides: {}>", self.samples(), self.state_names().join(", "))
    }
}
