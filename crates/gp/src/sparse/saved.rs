//! Saved sparse models: what determines a prediction, factors included, so that no data are needed.

use serde::{Deserialize, Serialize};

use super::{SparseGp, SparseMethod};
use crate::aligned::Aligned;
use crate::error::{GpError, Result, check_finite, check_len};
use crate::hyper::Hyperparameters;
use crate::kernel::Kernel;
use crate::optimize::FitReport;
use crate::panels::InverseFactor;
use crate::points::Points;
use crate::saved::{check_header, digest_of, parse, write};
use crate::vector::padded;

const FORMAT: &str = "stridemap-sparse-gp";

/// The saved form of a [`SparseGp`].
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct SavedSparseGp {
    format: String,
    version: u32,
    kernel: Kernel,
    method: SparseMethod,
    hyperparameters: Hyperparameters,
    bound: f64,
    report: Option<FitReport>,
    offset: f64,
    points: usize,
    centre: Vec<f64>,
    inducing: Vec<Vec<f64>>,
    weights: Vec<f64>,
    factors: [Vec<f64>; 2],
    checksum: String,
}

impl SavedSparseGp {
    fn digest(&self) -> String {
        let h = &self.hyperparameters;
        let scalars = [h.signal_variance, h.noise_variance, self.offset, self.bound];
        let [first, second] = &self.factors;
        let vectors = h.length_scales.iter().chain(&self.centre).chain(&self.weights);
        let numbers = scalars.iter().chain(vectors).chain(self.inducing.iter().flatten()).chain(first).chain(second);
        digest_of([self.kernel as u64, self.method as u64, self.points as u64], numbers)
    }
}

impl From<SparseGp> for SavedSparseGp {
    fn from(gp: SparseGp) -> Self {
        let m = gp.inducing.len() / gp.dims;
        let mut saved = Self {
            format: FORMAT.to_owned(),
            version: crate::saved::VERSION,
            kernel: gp.kernel,
            method: gp.method,
            bound: gp.bound,
            offset: gp.offset,
            points: gp.points,
            inducing: gp.inducing.chunks_exact(gp.dims).map(<[f64]>::to_vec).collect(),
            weights: gp.alpha[..m].to_vec(),
            factors: gp.factors.map(|factor| factor.entries_slice().to_vec()),
            hyperparameters: gp.hyperparameters,
            report: gp.report,
            centre: gp.centre,
            checksum: String::new(),
        };
        saved.checksum = saved.digest();
        saved
    }
}

impl TryFrom<SavedSparseGp> for SparseGp {
    type Error = GpError;

    fn try_from(saved: SavedSparseGp) -> Result<Self> {
        check_header(&saved.format, saved.version, FORMAT)?;
        let found = saved.digest();
        if found != saved.checksum {
            return Err(GpError::Corrupt { what: "checksum", expected: saved.checksum, found });
        }
        let dims = saved.hyperparameters.length_scales.len();
        saved.hyperparameters.check(dims)?;
        for row in &saved.inducing {
            check_len("length of an inducing input", dims, row.len())?;
        }
        check_len("centre", dims, saved.centre.len())?;
        let m = saved.inducing.len();
        check_len("weights", m, saved.weights.len())?;
        let inducing = saved.inducing.concat();
        Points::new(&inducing, dims)?;
        let [first, second] = &saved.factors;
        for values in [&saved.weights, &saved.centre, first, second] {
            check_finite("saved numbers", values, 1)?;
        }
        let factor = |entries: &[f64]| {
            InverseFactor::from_entries(m, entries).ok_or(GpError::Corrupt {
                what: "length of a factor",
                expected: format!("that of {m} points"),
                found: entries.len().to_string(),
            })
        };
        let stride = padded(m);
        let h = &saved.hyperparameters;
        let mut gp = Self {
            arch: pulp::Arch::new(),
            kernel: saved.kernel,
            method: saved.method,
            inverse_scales: h.length_scales.iter().map(|l| 1.0 / l).collect(),
            offset: saved.offset,
            points: saved.points,
            dims,
            stride,
            z: Aligned::zeros(dims * stride),
            factors: [factor(first)?, factor(second)?],
            alpha: Aligned::zeros_with(stride, &saved.weights),
            bound: saved.bound,
            bytes: 0,
            hyperparameters: saved.hyperparameters,
            centre: saved.centre,
            inducing,
            report: saved.report,
        };
        gp.scale_inducing();
        Ok(gp)
    }
}

impl SparseGp {
    /// The model as JSON; it holds the inducing inputs and factors, not the data.
    ///
    /// # Errors
    ///
    /// As [`Gp::to_json`](crate::Gp::to_json).
    pub fn to_json(&self) -> Result<String> {
        write(self)
    }

    /// Reads a model that [`to_json`](Self::to_json) wrote; predictions are bit-identical.
    ///
    /// # Errors
    ///
    /// As [`Gp::from_json`](crate::Gp::from_json).
    pub fn from_json(text: &str) -> Result<Self> {
        crate::saved::check_text(text, FORMAT)?;
        parse::<SavedSparseGp>(text)?.try_into()
    }
}
