//! The Gaussian-process engine; `stridemap.gp` gives it scikit-learn's conventions.

use numpy::ndarray::IxDyn;
use pyo3::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rayon::prelude::*;
use serde::de::DeserializeOwned;
use stridemap_gp::{Draw, FitOptions, Fitted, Gp, GpError, Hyperparameters, Points, RegressorKind, Scratch};

use crate::arrays::{Matrix, Numbers, array};
use crate::error::{request, working};
use crate::policy::python;

/// Points predicted by one thread at a time.
const CHUNK: usize = 256;

fn refused(error: GpError) -> PyErr {
    request(error.to_string())
}

/// A word of the engine's options.
fn word<T: DeserializeOwned>(key: &str, word: &str) -> PyResult<T> {
    serde_json::from_value(word.into()).map_err(|error| request(format!("{key} = {word:?}: {error}")))
}

/// A Gaussian process conditioned on data: exact or sparse.
#[pyclass(module = "stridemap.gp", frozen)]
pub struct GpModel(Fitted);

/// The rows of X, and their width.
fn read(x: &Numbers<'_>) -> PyResult<Matrix> {
    let width = x.as_array().shape().last().copied().unwrap_or(0);
    let rows = Matrix::read(x, width, "X")?;
    match rows.is_single {
        true => Err(request("X needs shape (N, D)")),
        false => Ok(rows),
    }
}

#[pymethods]
impl GpModel {
    /// Fits the hyperparameters by type-II maximum likelihood from so many starts.
    #[staticmethod]
    #[pyo3(signature = (x, y, method, kernel, mean, starts, seed))]
    #[expect(clippy::too_many_arguments, reason = "the estimator's settings")]
    fn fit(
        py: Python<'_>,
        x: Numbers<'_>,
        y: Vec<f64>,
        method: &str,
        kernel: &str,
        mean: &str,
        starts: usize,
        seed: u64,
    ) -> PyResult<Self> {
        let rows = read(&x)?;
        let kind: RegressorKind = word("method", method)?;
        let (kernel, mean) = (word("kernel", kernel)?, word("mean", mean)?);
        let options = FitOptions { kernel, mean, starts, ..FitOptions::default() };
        let fitted = py.detach(|| {
            let mut rng = ChaCha8Rng::seed_from_u64(seed);
            Fitted::fit(kind, Points::new(&rows.values, rows.width)?, &y, &options, &mut rng)
        });
        fitted.map(Self).map_err(refused)
    }

    /// An exact one with given hyperparameters.
    #[staticmethod]
    #[expect(clippy::too_many_arguments, reason = "the estimator's settings")]
    fn condition(
        py: Python<'_>,
        x: Numbers<'_>,
        y: Vec<f64>,
        kernel: &str,
        mean: &str,
        length_scales: Vec<f64>,
        signal_variance: f64,
        noise_variance: f64,
    ) -> PyResult<Self> {
        let rows = read(&x)?;
        let (kernel, mean) = (word("kernel", kernel)?, word("mean", mean)?);
        let hyperparameters = Hyperparameters { length_scales, signal_variance, noise_variance };
        let gp = py.detach(|| Gp::condition(Points::new(&rows.values, rows.width)?, &y, kernel, mean, hyperparameters));
        gp.map(|gp| Self(Fitted::Exact(Box::new(gp)))).map_err(refused)
    }

    /// Mean and latent variance at the rows of X, in parallel.
    fn predict<'py>(&self, py: Python<'py>, x: Numbers<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let rows = read(&x)?;
        let count = rows.len();
        let found = py.detach(|| {
            Points::new(&rows.values, rows.width)?;
            let chunk = |from: usize| {
                let mut scratch = Scratch::new();
                let own = from * CHUNK..count.min((from + 1) * CHUNK);
                own.map(|i| self.0.predict_with(rows.row(i), &mut scratch)).collect::<Result<Vec<_>, _>>()
            };
            (0..count.div_ceil(CHUNK)).into_par_iter().map(chunk).collect::<Result<Vec<_>, GpError>>()
        });
        let found = found.map_err(refused)?.concat();
        let means = found.iter().map(|p| p.mean).collect();
        let variances = found.iter().map(|p| p.latent_variance).collect();
        Ok((array(py, IxDyn(&[count]), means)?.into_any(), array(py, IxDyn(&[count]), variances)?.into_any()))
    }

    /// Joint mean and latent covariance at the rows of X.
    fn predict_joint<'py>(&self, py: Python<'py>, x: Numbers<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let rows = read(&x)?;
        let count = rows.len();
        let joint = py.detach(|| self.0.predict_joint(Points::new(&rows.values, rows.width)?)).map_err(refused)?;
        Ok((
            array(py, IxDyn(&[count]), joint.mean)?.into_any(),
            array(py, IxDyn(&[count, count]), joint.covariance)?.into_any(),
        ))
    }

    /// Draws of the function, or of observations of it, at the rows of X together: `(N, draws)`. Draw j is stream j of
    /// the seed.
    fn sample<'py>(
        &self,
        py: Python<'py>,
        x: Numbers<'py>,
        draws: usize,
        seed: u64,
        noise: bool,
    ) -> PyResult<Bound<'py, PyAny>> {
        let rows = read(&x)?;
        let count = rows.len();
        let drawn = py.detach(|| {
            let joint = self.0.predict_joint(Points::new(&rows.values, rows.width)?)?;
            let one = |j: usize| {
                let mut rng = ChaCha8Rng::seed_from_u64(seed);
                rng.set_stream(j as u64);
                let mut out = vec![0.0; count];
                let what = if noise { Draw::Observation } else { Draw::Latent };
                joint.clone().draw(self.0.hyperparameters(), what, &mut rng, &mut out)?;
                Ok(out)
            };
            (0..draws).into_par_iter().map(one).collect::<Result<Vec<_>, GpError>>()
        });
        let drawn = drawn.map_err(refused)?.concat();
        Ok(array(py, IxDyn(&[draws, count]), drawn)?.getattr("T")?)
    }

    /// `log p(y | X)`, or its lower bound, in nats.
    #[getter]
    fn log_marginal_likelihood(&self) -> f64 {
        self.0.log_marginal_likelihood()
    }

    /// Length scales, signal variance and noise variance, in the user's units.
    #[getter]
    fn hyperparameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        python(py, self.0.hyperparameters())
    }

    /// What the model says against itself.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.card().warnings.iter().map(ToString::to_string).collect()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String,))> {
        let text = serde_json::to_string(&self.0).map_err(working)?;
        Ok((py.get_type::<Self>().getattr("_rebuild")?, (text,)))
    }

    #[staticmethod]
    fn _rebuild(text: &str) -> PyResult<Self> {
        serde_json::from_str(text).map(Self).map_err(working)
    }
}
