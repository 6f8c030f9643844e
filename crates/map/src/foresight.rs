//! The learned map as it is asked for the distribution of a stride.

use statrs::distribution::{ContinuousCDF, Normal};
use stridemap_process::{ActionLaw, Foreseen, Foresight, ProcessError, Situation, State};

use crate::learned::{LearnedMap, MapPrediction, StateReward};
use crate::map_config::{MapDraw, MapInput};

impl LearnedMap {
    /// [`Foresight::foresee`] with another reward of a stride that does not fall: what `reward` says of the prediction.
    ///
    /// # Errors
    ///
    /// [`ProcessError`] for a bad state or action.
    pub fn foresee_by(
        &self,
        at: &Situation,
        action: &[f64],
        reward: &dyn Fn(&MapPrediction) -> f64,
    ) -> Result<Foreseen, ProcessError> {
        let world = self.world();
        let mut law = ActionLaw::new(world.limits.clone())?;
        law.reset_to(at.last_action.clone());
        let applied = law.apply(action)?;
        let predicted = self.predict(at, &applied)?;
        let variance = self.drawn(&predicted);
        let failure = world.failure;
        let fall = failure.component.map_or(0.0, |c| {
            let sd = variance[c].sqrt().max(f64::MIN_POSITIVE);
            Normal::standard().cdf((failure.below - predicted.means[c]) / sd)
        });
        let reward = (1.0 - fall) * reward(&predicted) + fall * failure.reward;
        Ok(Foreseen { applied, mean: predicted.means, variance, reward, fall })
    }

    /// The variances that a stride draws, of a prediction.
    fn drawn(&self, predicted: &MapPrediction) -> State {
        let latent = &predicted.latent_variances;
        let outputs = self.outputs().iter().map(|gp| gp.hyperparameters().noise_variance);
        match self.config().draw {
            MapDraw::Mean => latent.iter().map(|_| 0.0).collect(),
            MapDraw::Latent => latent.clone(),
            MapDraw::Full => latent.iter().zip(outputs).map(|(v, noise)| v + noise).collect(),
        }
    }
}

/// `E[f(x)]` of `x ~ N(mean, diag(variance))`: Gauss–Hermite with three points along each component in turn,
/// exact for sums of polynomials of one component up to the fifth degree.
fn expected(of_state: &StateReward, mean: &State, variance: &State) -> f64 {
    let (at_mean, mut moved) = (of_state(mean), mean.clone());
    let mut sum = at_mean;
    for (i, v) in variance.iter().enumerate().filter(|(_, v)| **v > 0.0) {
        let reach = (3.0 * v).sqrt();
        moved[i] = mean[i] + reach;
        let above = of_state(&moved);
        moved[i] = mean[i] - reach;
        sum += (above + of_state(&moved) - 2.0 * at_mean) / 6.0;
        moved[i] = mean[i];
    }
    sum
}

/// A fall is seen in the component of the state that means one; strides that do not fall are taken to be spread as all.
impl Foresight for LearnedMap {
    fn foresee(&self, at: &Situation, action: &[f64]) -> Result<Foreseen, ProcessError> {
        let of_state = self.world().reward.as_ref();
        self.foresee_by(at, action, &|predicted| match (of_state, predicted.reward) {
            (Some(f), _) => expected(f, &predicted.means, &self.drawn(predicted)),
            (None, reward) => reward.map_or(0.0, |(mean, _)| mean),
        })
    }

    fn remembers(&self) -> bool {
        let lags = self.world().limits.iter().any(|l| l.gain < 1.0 || l.rate_per_stride.is_finite());
        lags || self.config().inputs.contains(&MapInput::LastAction)
    }
}
