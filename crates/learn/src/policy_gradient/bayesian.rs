//! The gradient by Bayesian quadrature over paths \[GE07, model 2\].

use nalgebra::{DMatrix, DVector};

use super::batch::{Batch, Seen};

/// Added to the diagonal of G, as a share of its mean.
const RIDGE: f64 = 1e-6;

/// What a batch says of the gradient.
pub(super) struct Posterior {
    /// E[∇J]; one entry per mean and logit weight, base by base.
    pub gradient: DVector<f64>,
    /// G⁻¹ E[∇J].
    pub natural: DVector<f64>,
    /// Cov[∇J].
    #[cfg_attr(not(test), expect(dead_code, reason = "what is known of the direction is summed up in `doubt`"))]
    pub covariance: DMatrix<f64>,
    /// tr(G⁻¹ Cov[∇J]).
    doubt: f64,
}

impl Posterior {
    /// How sure the direction of the gradient is, from 0 to 1.
    pub fn certainty(&self) -> f64 {
        let square = self.gradient.dot(&self.natural).max(0.0);
        (square / (square + self.doubt).max(f64::MIN_POSITIVE)).sqrt()
    }
}

/// The posterior of the gradient of the discounted reward of an episode; `None` with fewer than three paths, or
/// where all of them are alike.
pub(super) fn posterior(batch: &Batch, discount: f64) -> Option<Posterior> {
    let d = batch.parameters();
    let paths: Vec<&[Seen]> = batch.episodes().collect();
    let count = paths.len();
    if count < 3 {
        return None;
    }
    let (mut u, mut fisher) = (DMatrix::zeros(d, count), DMatrix::zeros(d, d));
    let mut returns = DVector::zeros(count);
    let explains = if count >= 3 * batch.bases { batch.bases } else { 1 };
    let mut starts = DMatrix::from_element(count, explains, 1.0);
    for (i, path) in paths.iter().enumerate() {
        let mut weight = 1.0;
        for stride in *path {
            let mut score = DVector::zeros(d);
            batch.add_gradient(stride, score.as_mut_slice());
            // Scores are uncorrelated from stride to stride, so that a path's Fisher information is their sum's.
            fisher.ger(1.0 / count as f64, &score, &score, 1.0);
            let mut of_path = u.column_mut(i);
            of_path += score;
            returns[i] += weight * stride.reward;
            weight *= discount;
        }
        if explains > 1 {
            starts.row_mut(i).copy_from_slice(&path[0].here);
        }
    }
    let ridge = RIDGE * fisher.trace() / d as f64;
    for k in 0..d {
        fisher[(k, k)] += ridge;
    }
    // What the mean function explains is taken from returns and scores alike.
    let normal = starts.transpose() * &starts + DMatrix::identity(explains, explains) * 1e-9;
    let onto = normal.cholesky()?.inverse() * starts.transpose();
    let returns = &returns - &starts * (&onto * &returns);
    let u = &u - (&u * &starts) * &onto;
    let whitened = fisher.clone().cholesky()?.solve(&u);
    let kernel = u.transpose() * &whitened;
    let (ratio, signal_variance) = evidence(&kernel, &returns, count - explains)?;
    let noisy = (kernel + DMatrix::identity(count, count) * ratio).cholesky()?;
    let weights = noisy.solve(&returns);
    let covariance = signal_variance * (&fisher - &u * noisy.solve(&u.transpose()));
    let doubt = fisher.cholesky()?.solve(&covariance).trace().max(0.0);
    Some(Posterior { gradient: &u * &weights, natural: whitened * weights, covariance, doubt })
}

/// The ratio of noise to signal variance where the evidence of the returns is largest, and the signal variance.
fn evidence(kernel: &DMatrix<f64>, returns: &DVector<f64>, degrees: usize) -> Option<(f64, f64)> {
    let eigen = (0.5 * (kernel + kernel.transpose())).symmetric_eigen();
    let along = eigen.eigenvectors.transpose() * returns;
    let mut order: Vec<usize> = (0..returns.len()).collect();
    // The mean function has taken as many directions as it has coefficients.
    order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
    order.truncate(degrees);
    let typical = order.iter().map(|i| eigen.eigenvalues[*i].max(0.0)).sum::<f64>() / degrees as f64;
    let of_ratio = |ratio: f64| {
        let spread = |i: &usize| eigen.eigenvalues[*i].max(0.0) + ratio;
        let signal = order.iter().map(|i| along[*i].powi(2) / spread(i)).sum::<f64>() / degrees as f64;
        let log = order.iter().map(|i| spread(i).ln()).sum::<f64>();
        (-0.5 * (degrees as f64 * signal.ln() + log), signal)
    };
    let ratios = (-8..=8).map(|e| typical * 10f64.powf(0.5 * f64::from(e)));
    let best = ratios.map(|ratio| (ratio, of_ratio(ratio))).max_by(|a, b| a.1.0.total_cmp(&b.1.0))?;
    (best.0 > 0.0 && best.1.1 > 0.0).then_some((best.0, best.1.1))
}
