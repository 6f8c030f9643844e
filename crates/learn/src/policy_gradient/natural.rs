//! The natural gradient by LSTD-Q(λ) with compatible features \[PS08, sec. 3.2\].

use nalgebra::{DMatrix, DVector};

use super::Estimate;
use super::batch::{Batch, Seen};

/// Added to the diagonal, as a share of the sum of squares of each feature.
const RIDGE: f64 = 1e-3;

/// The natural gradient and the value function of a batch; `None` where the features determine neither.
pub(super) fn estimate(batch: &Batch, discount: f64, lambda: f64) -> Option<Estimate> {
    let (n, d) = (batch.bases, batch.parameters());
    let features = |stride: &Seen| {
        let mut all = DVector::zeros(n + d);
        all.as_mut_slice()[..n].copy_from_slice(&stride.here);
        batch.add_gradient(stride, &mut all.as_mut_slice()[n..]);
        all
    };
    let mut a = DMatrix::zeros(n + d, n + d);
    let mut c = DVector::zeros(n + d);
    let mut trace = DVector::zeros(n + d);
    let mut squares: DVector<f64> = DVector::zeros(n + d);
    for stride in &batch.strides {
        let here = features(stride);
        trace = lambda * trace + &here;
        let mut change = here.clone();
        if let Some(next) = &stride.next {
            for (value, b) in change.iter_mut().zip(next) {
                *value -= discount * b;
            }
        }
        a.ger(1.0, &trace, &change, 1.0);
        c.axpy(stride.reward, &trace, 1.0);
        squares += here.component_mul(&here);
        if stride.is_last {
            trace.fill(0.0);
        }
    }
    for (k, square) in squares.iter().enumerate() {
        a[(k, k)] += RIDGE * square + f64::MIN_POSITIVE;
    }
    let found = a.lu().solve(&c)?;
    let (values, natural) = found.as_slice().split_at(n);
    found.iter().all(|v| v.is_finite()).then(|| Estimate {
        natural: natural.to_vec(),
        values: Some(values.to_vec()),
        certainty: 1.0,
    })
}
