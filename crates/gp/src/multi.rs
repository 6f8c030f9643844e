//! Several outputs over the same inputs, predicted and sampled together: one imagined stride.

use rand::Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

use crate::error::{GpError, Result, check_len};
use crate::gp::Gp;
use crate::options::FitOptions;
use crate::points::Points;
use crate::predict::{Scratch, at_row};

/// What a draw contains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Draw {
    /// The latent function.
    Latent,
    /// The next observation: the latent function and the noise \[MA09, eq. (13)\].
    Observation,
}

/// Independent Gaussian processes, one an output, over the same `N` inputs.
///
/// Each output has its own kernel, mean and hyperparameters. Given the input the outputs are
/// independent, as in \[MA09, sec. 4.2\].
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(into = "crate::saved::SavedMultiGp", try_from = "crate::saved::SavedMultiGp")]
pub struct MultiGp {
    models: Vec<Gp>,
}

impl MultiGp {
    /// Fits one model an output, all with the same options.
    ///
    /// # Arguments
    ///
    /// - `points` – inputs, shape `(N, D)`.
    /// - `outputs` – `E ≥ 1` slices of `N` targets.
    ///
    /// # Errors
    ///
    /// As [`Gp::fit`]; [`GpError::Empty`] if there is no output.
    ///
    /// # Example
    ///
    /// ```
    /// use rand_chacha::{ChaCha8Rng, rand_core::SeedableRng};
    /// use stridemap_gp::{Draw, FitOptions, MultiGp, Points};
    ///
    /// let x: Vec<f64> = (0..20).map(|i| 0.3 * f64::from(i)).collect();
    /// let sine: Vec<f64> = x.iter().map(|x| x.sin()).collect();
    /// let cosine: Vec<f64> = x.iter().map(|x| x.cos()).collect();
    /// let mut rng = ChaCha8Rng::seed_from_u64(1);
    /// let options = FitOptions::default();
    /// let map = MultiGp::fit(Points::new(&x, 1)?, &[&sine, &cosine], &options, &mut rng)?;
    ///
    /// let (mut mean, mut latent_variance) = ([0.0; 2], [0.0; 2]);
    /// map.predict_into(&[2.0], &mut mean, &mut latent_variance)?;
    /// assert!((mean[0] - 2.0_f64.sin()).abs() < 1e-3 && (mean[1] - 2.0_f64.cos()).abs() < 1e-3);
    ///
    /// let mut next = [0.0; 2];
    /// map.sample_into(&[2.0], Draw::Observation, &mut rng, &mut next)?;
    /// assert!((next[0] - mean[0]).abs() < 0.01);
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    pub fn fit<R: Rng + ?Sized>(
        points: Points<'_>,
        outputs: &[&[f64]],
        options: &FitOptions,
        rng: &mut R,
    ) -> Result<Self> {
        let models: Result<Vec<Gp>> = outputs.iter().map(|y| Gp::fit(points, y, options, rng)).collect();
        Self::from_models(models?)
    }

    /// Puts together models that were made one by one.
    ///
    /// # Errors
    ///
    /// [`GpError::Empty`] if there is no model, [`GpError::Shape`] if they do not all have the same
    /// number of inputs and points, [`GpError::Parameter`] if the inputs differ in value.
    pub fn from_models(models: Vec<Gp>) -> Result<Self> {
        let Some(first) = models.first() else {
            return Err(GpError::Empty { what: "outputs" });
        };
        for model in &models {
            check_len("input dimensions of the models", first.dims(), model.dims())?;
            check_len("points of the models", first.len(), model.len())?;
            let differs = |(a, b): &(&f64, &f64)| a.to_bits() != b.to_bits();
            if let Some((_, other)) = first.inputs().iter().zip(model.inputs()).find(differs) {
                return Err(GpError::Parameter {
                    name: "inputs of the models",
                    requirement: "the same for all outputs",
                    value: *other,
                });
            }
        }
        Ok(Self { models })
    }

    /// The models, one an output.
    #[must_use]
    pub fn models(&self) -> &[Gp] {
        &self.models
    }

    /// Number of outputs `E`.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.models.len()
    }

    /// Number of input dimensions `D`.
    #[must_use]
    pub fn dims(&self) -> usize {
        self.models[0].dims()
    }

    /// Number of training points `N`.
    #[must_use]
    pub fn len(&self) -> usize {
        self.models[0].len()
    }

    /// Always false: a model has at least one point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.models[0].is_empty()
    }

    /// Predicts all outputs at one input, on the stack up to 1,000 points.
    ///
    /// # Errors
    ///
    /// As [`Gp::predict`], a `Variance` error naming the output as its row; [`GpError::Shape`] if
    /// `mean` or `latent_variance` is not of length `E`.
    pub fn predict_into(&self, x: &[f64], mean: &mut [f64], latent_variance: &mut [f64]) -> Result<()> {
        self.each(mean, latent_variance, |model| model.predict(x))
    }

    /// [`predict_into`](Self::predict_into) in the caller's scratch memory.
    ///
    /// # Errors
    ///
    /// As [`predict_into`](Self::predict_into).
    pub fn predict_into_with(
        &self,
        x: &[f64],
        mean: &mut [f64],
        latent_variance: &mut [f64],
        scratch: &mut Scratch,
    ) -> Result<()> {
        self.each(mean, latent_variance, |model| model.predict_with(x, scratch))
    }

    #[inline]
    fn each(
        &self,
        mean: &mut [f64],
        latent_variance: &mut [f64],
        mut predict: impl FnMut(&Gp) -> Result<crate::predict::Prediction>,
    ) -> Result<()> {
        check_len("length of mean", self.models.len(), mean.len())?;
        check_len("length of latent_variance", self.models.len(), latent_variance.len())?;
        for (e, model) in self.models.iter().enumerate() {
            let at = predict(model).map_err(|error| at_row(error, e))?;
            mean[e] = at.mean;
            latent_variance[e] = at.latent_variance;
        }
        Ok(())
    }

    /// Draws all outputs at one input: an imagined stride.
    ///
    /// One standard normal number is drawn an output, in order, whatever the variance.
    ///
    /// # Errors
    ///
    /// As [`predict_into`](Self::predict_into).
    pub fn sample_into<R: Rng + ?Sized>(&self, x: &[f64], draw: Draw, rng: &mut R, out: &mut [f64]) -> Result<()> {
        check_len("length of out", self.models.len(), out.len())?;
        for (e, (model, out)) in self.models.iter().zip(out).enumerate() {
            let at = model.predict(x).map_err(|error| at_row(error, e))?;
            let noise = match draw {
                Draw::Latent => 0.0,
                Draw::Observation => model.hyperparameters().noise_variance,
            };
            let normal: f64 = StandardNormal.sample(rng);
            *out = at.mean + (at.latent_variance + noise).sqrt() * normal;
        }
        Ok(())
    }
}
