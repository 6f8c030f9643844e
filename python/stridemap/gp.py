"""The Gaussian-process engine with scikit-learn's conventions. Needs scikit-learn."""

from __future__ import annotations

from typing import Any

import numpy as np
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils import check_random_state
from sklearn.utils.validation import check_is_fitted, validate_data

from ._native import GpModel

__all__ = ["GaussianProcess"]


class GaussianProcess(RegressorMixin, BaseEstimator):  # type: ignore[misc]
    """Gaussian-process regression: hyperparameters and noise by type-II maximum likelihood, one length scale an input.

    Parameters:
        method: ``"exact"`` up to some thousand points, ``"sparse"`` (100 inducing inputs) for any number.
        kernel: ``"squared_exponential"``, ``"matern32"`` or ``"matern52"``.
        mean: ``"zero"``, ``"constant"`` or ``"linear"``; its coefficients are integrated out.
        starts: searches for the hyperparameters, the first from the spread of the data.
        random_state: places the other starts.

    Attributes:
        length_scales_: one an input, in its unit.
        signal_variance_: of the latent function.
        noise_variance_: of an observation about it.
        log_marginal_likelihood_value_: ``log p(y | X)``, or its lower bound, in nats.
    """

    def __init__(
        self,
        *,
        method: str = "exact",
        kernel: str = "squared_exponential",
        mean: str = "constant",
        starts: int = 3,
        random_state: Any = None,
    ) -> None:
        self.method = method
        self.kernel = kernel
        self.mean = mean
        self.starts = starts
        self.random_state = random_state

    def fit(self, X: Any, y: Any) -> GaussianProcess:
        """Fits hyperparameters to ``X`` (N, D) and ``y`` (N,), and conditions on them."""
        X, y = validate_data(self, X, y, y_numeric=True, dtype=np.float64)
        seed = int(check_random_state(self.random_state).randint(2**31 - 1))
        self._model = GpModel.fit(X, y, self.method, self.kernel, self.mean, self.starts, seed)
        found = self._model.hyperparameters
        self.X_train_, self.y_train_ = X, y
        self.length_scales_ = np.asarray(found["length_scales"])
        self.signal_variance_ = found["signal_variance"]
        self.noise_variance_ = found["noise_variance"]
        self.log_marginal_likelihood_value_ = self._model.log_marginal_likelihood
        return self

    def predict(self, X: Any, return_std: bool = False, return_cov: bool = False) -> Any:
        """The mean at ``X``; if asked for, the standard deviation or joint covariance of the latent function too."""
        check_is_fitted(self)
        if return_std and return_cov:
            raise RuntimeError("either return_std or return_cov, not both")
        X = validate_data(self, X, reset=False, dtype=np.float64)
        if return_cov:
            return self._model.predict_joint(X)
        mean, variance = self._model.predict(X)
        return (mean, np.sqrt(variance)) if return_std else mean

    def sample_y(self, X: Any, n_samples: int = 1, random_state: Any = 0, noise: bool = False) -> Any:
        """Draws of the function (of observations, with ``noise``) at the rows of ``X`` together, (N, n_samples)."""
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=np.float64)
        seed = int(check_random_state(random_state).randint(2**31 - 1))
        return self._model.sample(X, n_samples, seed, noise)

    def log_marginal_likelihood(
        self,
        length_scales: Any = None,
        signal_variance: float | None = None,
        noise_variance: float | None = None,
    ) -> float:
        """``log p(y | X)`` of the training data, in nats: at the hyperparameters found, or (exactly) at others."""
        check_is_fitted(self)
        if length_scales is None and signal_variance is None and noise_variance is None:
            return float(self.log_marginal_likelihood_value_)
        own = self.length_scales_
        scales = own if length_scales is None else np.broadcast_to(length_scales, own.shape)
        model = GpModel.condition(
            self.X_train_,
            self.y_train_,
            self.kernel,
            self.mean,
            scales.tolist(),
            self.signal_variance_ if signal_variance is None else signal_variance,
            self.noise_variance_ if noise_variance is None else noise_variance,
        )
        return model.log_marginal_likelihood
