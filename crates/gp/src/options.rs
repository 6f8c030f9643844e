//! What a fit may be told: kernel, mean, starts, bounds and priors.

use serde::{Deserialize, Serialize};

use crate::error::{GpError, Result, check_len, check_positive};
use crate::hyper::Hyperparameters;
use crate::kernel::Kernel;
use crate::mean::{Frame, Mean};

/// Default lower end of a length scale, in standard deviations of its input.
const LENGTH_SCALE_LOWER: f64 = 1e-2;
/// Default upper end of a length scale, in standard deviations of its input: a function that is
/// flat over the data.
const LENGTH_SCALE_UPPER: f64 = 1e3;
/// Default range of the signal variance, in variances of `y`.
const SIGNAL_VARIANCE_RANGE: (f64, f64) = (1e-6, 1e4);
/// Default range of the noise variance, in variances of `y`. Below the lower end the covariance of
/// a hundred smooth points stops being positive definite in double precision.
const NOISE_VARIANCE_RANGE: (f64, f64) = (1e-8, 1e1);
/// Default start of the noise variance, in variances of `y`.
const NOISE_VARIANCE_START: f64 = 0.1;
/// Squared scales outside this range would leave no room for products in double precision.
const SCALE_RANGE: (f64, f64) = (1e-100, 1e100);

/// A closed range of a positive parameter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Range {
    /// Smallest value allowed; positive.
    pub lower: f64,
    /// Largest value allowed; not below `lower`.
    pub upper: f64,
}

impl Range {
    /// The range from `lower` to `upper`.
    #[must_use]
    pub const fn new(lower: f64, upper: f64) -> Self {
        Self { lower, upper }
    }

    /// The range of one value: the parameter is not fitted.
    #[must_use]
    pub const fn fixed(value: f64) -> Self {
        Self { lower: value, upper: value }
    }

    fn check(self, name: &'static str) -> Result<()> {
        check_positive(name, self.lower)?;
        check_positive(name, self.upper)?;
        if self.lower <= self.upper {
            Ok(())
        } else {
            Err(GpError::Range { name, lower: self.lower, upper: self.upper })
        }
    }
}

/// Bounds of the search; `None` takes the default, which follows the spread of the data.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Bounds {
    /// One range a dimension. Default: 0.01 to 1,000 standard deviations of the input.
    pub length_scales: Option<Vec<Range>>,
    /// Default: 10⁻⁶ to 10⁴ variances of `y`.
    pub signal_variance: Option<Range>,
    /// Default: 10⁻⁸ to 10 variances of `y`.
    pub noise_variance: Option<Range>,
}

/// Prior density of a positive parameter.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Prior {
    /// `log θ ~ N(log median, log_std²)`, as a density over `log θ`: its mode is the median.
    LogNormal {
        /// Median of the parameter.
        median: f64,
        /// Standard deviation of its logarithm.
        log_std: f64,
    },
    /// `p(θ) ∝ θ^(shape − 1) e^(−rate θ)`, as a density over `θ`.
    Gamma {
        /// Shape, dimensionless.
        shape: f64,
        /// Rate, in the inverse unit of the parameter.
        rate: f64,
    },
}

impl Prior {
    /// Log density without its constant, and its derivative by `log θ`, at `θ = value`.
    ///
    /// # Example
    ///
    /// ```
    /// use stridemap_gp::Prior;
    ///
    /// let prior = Prior::LogNormal { median: 1.0, log_std: 0.5 };
    /// let (log_density, slope) = prior.log_density(f64::exp(0.5));
    /// assert!((log_density + 0.5).abs() < 1e-15 && (slope + 2.0).abs() < 1e-15);
    /// ```
    #[must_use]
    pub fn log_density(&self, value: f64) -> (f64, f64) {
        match *self {
            Self::LogNormal { median, log_std } => {
                let deviation = (value.ln() - median.ln()) / log_std;
                (-0.5 * deviation * deviation, -deviation / log_std)
            }
            Self::Gamma { shape, rate } => ((shape - 1.0) * value.ln() - rate * value, (shape - 1.0) - rate * value),
        }
    }

    fn check(&self) -> Result<()> {
        match *self {
            Self::LogNormal { median, log_std } => {
                check_positive("median of prior", median)?;
                check_positive("log_std of prior", log_std)
            }
            Self::Gamma { shape, rate } => {
                check_positive("shape of prior", shape)?;
                check_positive("rate of prior", rate)
            }
        }
    }
}

/// Priors of the search; `None` is flat.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Priors {
    /// One prior a dimension.
    pub length_scales: Option<Vec<Prior>>,
    /// Prior of `σ_f²`.
    pub signal_variance: Option<Prior>,
    /// Prior of `σₙ²`.
    pub noise_variance: Option<Prior>,
}

/// How a Gaussian process is fitted.
///
/// Start, bounds and priors are read in the user's units, or, where the inputs or outputs are
/// standardized, in those of the standardized data. The fitted model always speaks the user's units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitOptions {
    /// Covariance function.
    pub kernel: Kernel,
    /// Mean function.
    pub mean: Mean,
    /// Where the first search starts. Default: the standard deviations of the inputs, the variance
    /// of `y`, and a tenth of that as noise.
    pub start: Option<Hyperparameters>,
    /// Bounds of the search.
    pub bounds: Bounds,
    /// Priors; with any, the search maximises the posterior density of the parameters.
    pub priors: Priors,
    /// Read length scales in standard deviations of the inputs.
    pub standardize_inputs: bool,
    /// Subtract the mean of `y`, and read variances in variances of `y`.
    pub standardize_outputs: bool,
    /// Number of searches; the first from `start`, the others from random places; at least 1. Default: 5, since
    /// one alone may end where everything is noise.
    pub starts: usize,
    /// Evaluations of the evidence after which one search stops.
    pub max_evaluations: usize,
    /// A search has converged when a further step would gain less than this, in nats.
    pub tolerance_nats: f64,
}

impl Default for FitOptions {
    fn default() -> Self {
        Self {
            kernel: Kernel::default(),
            mean: Mean::default(),
            start: None,
            bounds: Bounds::default(),
            priors: Priors::default(),
            standardize_inputs: false,
            standardize_outputs: false,
            starts: 5,
            max_evaluations: 200,
            tolerance_nats: 1e-6,
        }
    }
}

/// Options made definite for one set of data, in the user's units and in logarithms.
pub(crate) struct Resolved {
    /// Constant subtracted from `y`.
    pub(crate) offset: f64,
    pub(crate) start: Vec<f64>,
    pub(crate) lower: Vec<f64>,
    pub(crate) upper: Vec<f64>,
    /// Log of the unit in which each prior is stated.
    pub(crate) log_unit: Vec<f64>,
    pub(crate) priors: Vec<Option<Prior>>,
    /// Log of the data's own scale of each parameter.
    pub(crate) log_scale: Vec<f64>,
}

impl Resolved {
    /// Log prior density and its gradient by the log parameters.
    pub(crate) fn log_prior(&self, theta: &[f64]) -> (f64, Vec<f64>) {
        let mut total = 0.0;
        let mut slopes = vec![0.0; self.priors.len()];
        for (p, prior) in self.priors.iter().enumerate() {
            if let Some(prior) = prior {
                let (value, slope) = prior.log_density((theta[p] - self.log_unit[p]).exp());
                total += value;
                slopes[p] = slope;
            }
        }
        (total, slopes)
    }
}

impl FitOptions {
    /// Checks the options and makes them definite for inputs in `frame` and targets `y`.
    pub(crate) fn resolve(&self, frame: &Frame, y: &[f64]) -> Result<Resolved> {
        let dims = frame.spread.len();
        if self.starts == 0 {
            return Err(GpError::Empty { what: "starts" });
        }
        if self.max_evaluations == 0 {
            return Err(GpError::Empty { what: "max_evaluations" });
        }
        check_positive("tolerance_nats", self.tolerance_nats)?;

        let columns = Frame::of(y, 1);
        let offset = if self.standardize_outputs { columns.centre[0] } else { 0.0 };
        let about = if self.mean == Mean::Zero { offset } else { columns.centre[0] };
        let size = y.iter().fold(0.0_f64, |m, v| m.max((v - about).abs()));
        let constant = columns.spread[0] <= 0.0 && (self.standardize_outputs || self.mean != Mean::Zero);
        let y_scale = if size > 0.0 && !constant {
            let squares: f64 = y.iter().map(|v| ((v - about) / size).powi(2)).sum();
            size * (squares / y.len() as f64).sqrt()
        } else {
            1.0
        };
        check_scale("scale of y", y_scale)?;
        let x_scale: Vec<f64> = (0..dims).map(|d| frame.spread_or_one(d)).collect();
        for &scale in &x_scale {
            check_scale("spread of x", scale)?;
        }

        let y_variance = y_scale * y_scale;
        let unit_y = if self.standardize_outputs { y_variance } else { 1.0 };
        let unit_x = |d: usize| {
            if self.standardize_inputs { x_scale[d] } else { 1.0 }
        };
        let mut unit = vec![unit_y; 2];
        unit.extend((0..dims).map(unit_x));
        let mut scale = vec![y_variance; 2];
        scale.extend(&x_scale);

        let ranges = self.ranges(&scale, &unit)?;
        let (lower, upper): (Vec<f64>, Vec<f64>) =
            ranges.iter().map(|range| (range.lower.ln(), range.upper.ln())).unzip();
        let start = self.start_in(&scale, &unit, &ranges)?;
        Ok(Resolved {
            offset,
            start,
            lower,
            upper,
            log_unit: unit.iter().map(|u| u.ln()).collect(),
            priors: self.priors(dims)?,
            log_scale: scale.iter().map(|s| s.ln()).collect(),
        })
    }

    /// Bounds of `(σ_f², σₙ², ℓ…)` in the user's units.
    fn ranges(&self, scale: &[f64], unit: &[f64]) -> Result<Vec<Range>> {
        let dims = scale.len() - 2;
        let default = |p: usize, (lower, upper): (f64, f64)| Range::new(lower * scale[p], upper * scale[p]);
        let given = |p: usize, range: Range, name| {
            range.check(name)?;
            let range = Range::new(range.lower * unit[p], range.upper * unit[p]);
            range.check(name).map(|()| range)
        };
        let mut ranges = vec![
            match self.bounds.signal_variance {
                Some(range) => given(0, range, "signal_variance")?,
                None => default(0, SIGNAL_VARIANCE_RANGE),
            },
            match self.bounds.noise_variance {
                Some(range) => given(1, range, "noise_variance")?,
                None => default(1, NOISE_VARIANCE_RANGE),
            },
        ];
        match &self.bounds.length_scales {
            Some(bounds) => {
                check_len("bounds of length_scales", dims, bounds.len())?;
                for (d, range) in bounds.iter().enumerate() {
                    ranges.push(given(2 + d, *range, "length scale")?);
                }
            }
            None => ranges.extend((2..2 + dims).map(|p| default(p, (LENGTH_SCALE_LOWER, LENGTH_SCALE_UPPER)))),
        }
        Ok(ranges)
    }

    /// Logarithms of the start in the user's units, inside the bounds.
    fn start_in(&self, scale: &[f64], unit: &[f64], ranges: &[Range]) -> Result<Vec<f64>> {
        let Some(start) = &self.start else {
            return Ok(scale
                .iter()
                .zip(ranges)
                .enumerate()
                .map(|(p, (scale, range))| {
                    let value = if p == 1 { NOISE_VARIANCE_START * scale } else { *scale };
                    value.clamp(range.lower, range.upper).ln()
                })
                .collect());
        };
        start.check(scale.len() - 2)?;
        let mut theta = start.to_log();
        for (p, theta) in theta.iter_mut().enumerate() {
            *theta += unit[p].ln();
            let (lower, upper) = (ranges[p].lower.ln(), ranges[p].upper.ln());
            // A start at its bound may miss it by the rounding of a logarithm.
            let slack = 1e-12 * (1.0 + theta.abs());
            if *theta < lower - slack || *theta > upper + slack {
                return Err(GpError::Parameter {
                    name: "start of the search",
                    requirement: "inside its bounds",
                    value: theta.exp() / unit[p],
                });
            }
            *theta = theta.clamp(lower, upper);
        }
        Ok(theta)
    }

    fn priors(&self, dims: usize) -> Result<Vec<Option<Prior>>> {
        let mut priors = vec![self.priors.signal_variance, self.priors.noise_variance];
        match &self.priors.length_scales {
            Some(given) => {
                check_len("priors of length_scales", dims, given.len())?;
                priors.extend(given.iter().map(|prior| Some(*prior)));
            }
            None => priors.resize(2 + dims, None),
        }
        for prior in priors.iter().flatten() {
            prior.check()?;
        }
        Ok(priors)
    }
}

fn check_scale(name: &'static str, value: f64) -> Result<()> {
    if (SCALE_RANGE.0..=SCALE_RANGE.1).contains(&value) {
        Ok(())
    } else {
        Err(GpError::Parameter { name, requirement: "between 1e-100 and 1e100", value })
    }
}
