//! The model card: what a model is, how well it predicts, and what to be wary of.

use std::fmt;

use serde::{Deserialize, Serialize};

use crate::gp::Gp;
use crate::hyper::Hyperparameters;
use crate::kernel::Kernel;
use crate::mean::{Mean, spread};
use crate::optimize::FitReport;
use crate::optimize::Stop;
use crate::scores::{LeaveOneOut, LeaveOneOutScores};
use crate::sparse::SparseGp;

/// Points a parameter below which a fit is called poor in data.
const POINTS_PER_PARAMETER: usize = 3;
/// Condition number above which predictions lose more than half their digits.
const ILL_CONDITIONED: f64 = 1e12;
/// Relative distance from a bound that counts as being at it.
const AT_BOUND: f64 = 1e-6;
/// Mean square standardized residual outside this range is called dishonest.
const HONEST: (f64, f64) = (0.5, 2.0);
/// Steps of the power iteration for `‖K⁻¹‖`.
const POWER_STEPS: usize = 30;

/// Something a user of the model should know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
#[non_exhaustive]
pub enum Warning {
    /// Fewer than three points a hyperparameter.
    TooFewPoints {
        /// Number of points `N`.
        points: usize,
        /// Number of hyperparameters.
        parameters: usize,
    },
    /// All targets are equal, to rounding.
    ConstantOutputs,
    /// An input never changes beyond rounding, so its length scale means nothing.
    ConstantInput {
        /// Zero-based column.
        dimension: usize,
    },
    /// Points that repeat an earlier one exactly.
    RepeatedInputs {
        /// Number of such points.
        points: usize,
    },
    /// A fitted parameter ended at a bound.
    AtBound {
        /// `signal_variance`, `noise_variance` or `length_scales[d]`.
        parameter: String,
        /// Its value.
        value: f64,
        /// Whether the bound is the upper one.
        upper: bool,
    },
    /// The search did not converge.
    NotConverged {
        /// Why it stopped.
        stop: Stop,
    },
    /// Predictions lose digits to rounding.
    IllConditioned {
        /// Estimate of the condition number of `K + σₙ² I`.
        condition_number: f64,
    },
    /// Leave-one-out residuals are much larger or smaller than their predicted spread.
    Miscalibrated {
        /// Mean square standardized residual; 1 is honest.
        mean_square_standardized: f64,
    },
    /// Points that are left out are predicted no better than by the mean of the others: the fit is all noise.
    AllNoise,
    /// Without one of the points the mean's coefficients are not determined.
    LeaveOneOutUndetermined,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFewPoints { points, parameters } => {
                write!(f, "{points} points are few for {parameters} hyperparameters")
            }
            Self::ConstantOutputs => write!(f, "all targets are equal"),
            Self::ConstantInput { dimension } => write!(f, "input {dimension} never changes"),
            Self::RepeatedInputs { points } => write!(f, "{points} points repeat an earlier one"),
            Self::AtBound { parameter, value, upper } => {
                let end = if *upper { "upper" } else { "lower" };
                write!(f, "{parameter} = {value:.3e} is at its {end} bound")
            }
            Self::NotConverged { stop } => write!(f, "the search did not converge: {stop:?}"),
            Self::IllConditioned { condition_number } => {
                write!(f, "condition number {condition_number:.1e}: predictions lose digits")
            }
            Self::Miscalibrated { mean_square_standardized } => {
                write!(f, "squared leave-one-out residuals are {mean_square_standardized:.2} times their variance")
            }
            Self::AllNoise => {
                write!(f, "points that are left out are predicted no better than by the mean: the fit is all noise")
            }
            Self::LeaveOneOutUndetermined => {
                write!(f, "without one of the points the mean is not determined")
            }
        }
    }
}

/// What a model is, how well it predicts, and what to be wary of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Card {
    /// Number of training points `N`.
    pub points: usize,
    /// Number of input dimensions `D`.
    pub dims: usize,
    /// Covariance function.
    pub kernel: Kernel,
    /// Mean function.
    pub mean: Mean,
    /// Hyperparameters, in the user's units.
    pub hyperparameters: Hyperparameters,
    /// Coefficients of the mean, in the user's units.
    pub mean_coefficients: Vec<f64>,
    /// Log marginal likelihood, in nats.
    pub log_marginal_likelihood: f64,
    /// Leave-one-out scores; `None` if they are not determined.
    pub leave_one_out: Option<LeaveOneOutScores>,
    /// Estimate of the condition number of `K + σₙ² I`, within a factor of `√N`; `None` for a sparse model.
    pub condition_number: Option<f64>,
    /// Points added or dropped since the last factorisation.
    pub updates: usize,
    /// What to be wary of.
    pub warnings: Vec<Warning>,
}

impl fmt::Display for Card {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let h = &self.hyperparameters;
        writeln!(f, "{} points, {} inputs, {:?}, mean {:?}", self.points, self.dims, self.kernel, self.mean)?;
        writeln!(f, "length scales            {:.4?}", h.length_scales)?;
        writeln!(f, "signal variance          {:.6e}", h.signal_variance)?;
        writeln!(f, "noise variance           {:.6e}", h.noise_variance)?;
        if !self.mean_coefficients.is_empty() {
            writeln!(f, "mean coefficients        {:.4?}", self.mean_coefficients)?;
        }
        writeln!(f, "log marginal likelihood  {:.3} nat", self.log_marginal_likelihood)?;
        if let Some(loo) = &self.leave_one_out {
            writeln!(f, "leave-one-out rmse       {:.6e}", loo.rmse)?;
            writeln!(f, "leave-one-out density    {:.3} nat a point", loo.mean_log_density)?;
            let (half, most) = (100.0 * loo.coverage_50, 100.0 * loo.coverage_90);
            writeln!(f, "coverage of 50 %, 90 %   {half:.0} %, {most:.0} %")?;
        }
        if let Some(condition_number) = self.condition_number {
            write!(f, "condition number         {condition_number:.1e}")?;
        }
        for warning in &self.warnings {
            write!(f, "\nwarning: {warning}")?;
        }
        Ok(())
    }
}

impl Gp {
    /// What this model is, how well it predicts, and what to be wary of.
    ///
    /// # Cost
    ///
    /// `O(N² D)`.
    ///
    /// # Example
    ///
    /// ```
    /// # use stridemap_gp::{Gp, Hyperparameters, Kernel, Mean, Points, Warning};
    /// # let hyperparameters = Hyperparameters {
    /// #     length_scales: vec![1.0], signal_variance: 1.0, noise_variance: 0.25 };
    /// // The same point twice, with the same target.
    /// let points = Points::new(&[2.0, 2.0], 1)?;
    /// let gp = Gp::condition(points, &[3.0, 3.0], Kernel::Matern52, Mean::Zero, hyperparameters)?;
    /// let warnings = gp.card().warnings;
    /// assert!(warnings.contains(&Warning::RepeatedInputs { points: 1 }));
    /// assert!(warnings.contains(&Warning::ConstantOutputs));
    /// # Ok::<(), stridemap_gp::GpError>(())
    /// ```
    #[must_use]
    pub fn card(&self) -> Card {
        let leave_one_out = self.leave_one_out().ok().map(|loo| loo.scores());
        let condition_number = self.condition_number();
        let mut warnings = Vec::new();
        let parameters = 2 + self.dims;
        if self.y.len() < POINTS_PER_PARAMETER * parameters {
            warnings.push(Warning::TooFewPoints { points: self.y.len(), parameters });
        }
        if spread(&self.y) <= 0.0 {
            warnings.push(Warning::ConstantOutputs);
        }
        for (dimension, spread) in self.frame.spread.iter().enumerate() {
            if *spread <= 0.0 {
                warnings.push(Warning::ConstantInput { dimension });
            }
        }
        let points = self.repeated_inputs();
        if points > 0 {
            warnings.push(Warning::RepeatedInputs { points });
        }
        warn_of_the_search(self.report.as_ref(), &self.hyperparameters, &mut warnings);
        if condition_number.is_nan() || condition_number > ILL_CONDITIONED {
            warnings.push(Warning::IllConditioned { condition_number });
        }
        warn_of_the_scores(leave_one_out.as_ref(), &self.y, &mut warnings);
        Card {
            points: self.y.len(),
            dims: self.dims,
            kernel: self.kernel,
            mean: self.mean,
            hyperparameters: self.hyperparameters.clone(),
            mean_coefficients: self.mean_coefficients(),
            log_marginal_likelihood: self.log_marginal_likelihood,
            leave_one_out,
            condition_number: Some(condition_number),
            updates: self.updates,
            warnings,
        }
    }

    fn repeated_inputs(&self) -> usize {
        let mut rows: Vec<&[f64]> = self.x.chunks_exact(self.dims).collect();
        let order = |a: &&[f64], b: &&[f64]| {
            a.iter().zip(*b).map(|(a, b)| a.total_cmp(b)).find(|o| o.is_ne()).unwrap_or(std::cmp::Ordering::Equal)
        };
        rows.sort_by(|a, b| order(a, b));
        rows.windows(2).filter(|pair| order(&pair[0], &pair[1]).is_eq()).count()
    }

    /// `‖K‖_∞ ‖K⁻¹‖₂`, the second by power iteration.
    fn condition_number(&self) -> f64 {
        let (n, stride) = (self.y.len(), self.stride);
        let mut v = vec![0.0; stride];
        for (i, v) in v.iter_mut().take(n).enumerate() {
            // Any start that is not symmetric to the data.
            *v = 1.0 + 0.1 * (i as f64).sin();
        }
        let mut product = vec![0.0; stride];
        let mut norm = 0.0;
        for _ in 0..POWER_STEPS {
            let length = v.iter().map(|v| v * v).sum::<f64>().sqrt();
            v.iter_mut().for_each(|v| *v /= length);
            self.factor.product(&v, &mut product);
            norm = product.iter().map(|p| p * p).sum::<f64>();
            self.factor.transposed_product(&product, &mut v);
        }
        let mut largest = 0.0_f64;
        for i in 0..n {
            let mut sum = self.hyperparameters.noise_variance;
            for j in 0..n {
                let squared: f64 =
                    (0..self.dims).map(|d| (self.z[d * stride + i] - self.z[d * stride + j]).powi(2)).sum();
                sum += self.kernel.covariance(squared, self.hyperparameters.signal_variance);
            }
            largest = largest.max(sum);
        }
        norm * largest
    }
}

/// What the search for the hyperparameters says against itself.
fn warn_of_the_search(report: Option<&FitReport>, h: &Hyperparameters, warnings: &mut Vec<Warning>) {
    let Some(report) = report else { return };
    let values = [h.signal_variance, h.noise_variance];
    for (p, &value) in values.iter().chain(&h.length_scales).enumerate() {
        let (lower, upper) = (report.lower[p], report.upper[p]);
        let at_lower = value <= lower * (1.0 + AT_BOUND);
        let at_upper = value >= upper * (1.0 - AT_BOUND);
        // A parameter that was fixed is not at a bound.
        if at_lower != at_upper {
            let parameter = match p {
                0 => "signal_variance".to_owned(),
                1 => "noise_variance".to_owned(),
                _ => format!("length_scales[{}]", p - 2),
            };
            warnings.push(Warning::AtBound { parameter, value, upper: at_upper });
        }
    }
    let stop = report.best_start().stop;
    if stop != Stop::Converged {
        warnings.push(Warning::NotConverged { stop });
    }
}

/// What leaving one out says against a model.
fn warn_of_the_scores(scores: Option<&LeaveOneOutScores>, y: &[f64], warnings: &mut Vec<Warning>) {
    let Some(LeaveOneOutScores { mean_square_standardized, rmse, .. }) = scores else {
        return warnings.push(Warning::LeaveOneOutUndetermined);
    };
    let spread_of_y = spread(y);
    if spread_of_y > 0.0 && *rmse >= spread_of_y {
        warnings.push(Warning::AllNoise);
    }
    if !(HONEST.0..=HONEST.1).contains(mean_square_standardized) {
        let mean_square_standardized = *mean_square_standardized;
        warnings.push(Warning::Miscalibrated { mean_square_standardized });
    }
}

impl SparseGp {
    /// The card of a model about a mean with these coefficients.
    pub(crate) fn card(&self, mean: Mean, coefficients: &[f64], y: &[f64], leave_one_out: &LeaveOneOut) -> Card {
        let scores = leave_one_out.scores();
        let mut warnings = Vec::new();
        if spread(y) <= 0.0 {
            warnings.push(Warning::ConstantOutputs);
        }
        warn_of_the_search(self.report(), self.hyperparameters(), &mut warnings);
        warn_of_the_scores(Some(&scores), y, &mut warnings);
        Card {
            points: self.len(),
            dims: self.dims(),
            kernel: self.kernel(),
            mean,
            hyperparameters: self.hyperparameters().clone(),
            mean_coefficients: coefficients.to_vec(),
            log_marginal_likelihood: self.bound(),
            leave_one_out: Some(scores),
            condition_number: None,
            updates: 0,
            warnings,
        }
    }
}
