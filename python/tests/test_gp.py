import pickle

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn.utils.estimator_checks import check_estimator  # noqa: E402

from stridemap.gp import GaussianProcess  # noqa: E402

X = np.linspace(0, 6, 40)[:, None]
Y = np.sin(X[:, 0])


@pytest.mark.parametrize("method", ["exact", "sparse"])
def test_scikit_learns_checks_pass(method: str):
    check_estimator(GaussianProcess(method=method, starts=1))


def test_a_smooth_function_is_found_with_small_noise():
    rng = np.random.default_rng(0)
    gp = GaussianProcess(random_state=0).fit(X, Y + 0.05 * rng.normal(size=len(X)))
    mean, std = gp.predict(X, return_std=True)
    assert np.sqrt(np.mean((mean - Y) ** 2)) < 0.04
    assert 0.03 < np.sqrt(gp.noise_variance_) < 0.08
    assert np.all(np.abs(mean - Y) < 4 * std)
    assert gp.predict([[30.0]], return_std=True)[1][0] > 10 * std.mean()
    joint, covariance = gp.predict(X[:5], return_cov=True)
    assert np.allclose(joint, mean[:5]) and np.allclose(np.sqrt(np.diag(covariance)), std[:5])


def test_the_evidence_by_hand():
    """One observation, y = 1 at x = 0: log N(1; 0, 1.25)."""
    gp = GaussianProcess(mean="zero", starts=1).fit([[0.0], [1.0]], [1.0, 1.0])
    gp.X_train_, gp.y_train_ = np.array([[0.0]]), np.array([1.0])
    expected = -0.5 / 1.25 - 0.5 * np.log(2 * np.pi * 1.25)
    assert gp.log_marginal_likelihood([1.0], 1.0, 0.25) == pytest.approx(expected, abs=1e-14)


def test_the_fit_is_at_a_top_of_the_evidence():
    gp = GaussianProcess(random_state=0).fit(X, Y + 0.05 * np.random.default_rng(0).normal(size=len(X)))
    top = gp.log_marginal_likelihood()
    assert top == pytest.approx(gp.log_marginal_likelihood_value_)
    for scale in (0.9, 1.1):
        assert gp.log_marginal_likelihood(length_scales=scale * gp.length_scales_) < top
        assert gp.log_marginal_likelihood(noise_variance=scale * gp.noise_variance_) < top


@pytest.mark.parametrize("method", ["exact", "sparse"])
def test_draws_have_the_predicted_moments(method: str):
    gp = GaussianProcess(method=method, random_state=0).fit(X[::4], Y[::4])
    at = np.array([[0.7], [3.3], [7.0]])
    mean, covariance = gp.predict(at, return_cov=True)
    draws = gp.sample_y(at, n_samples=4000, random_state=2)
    assert draws.shape == (3, 4000)
    std = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(draws.mean(1) - mean) < 5 * std / np.sqrt(4000) + 1e-9)
    assert np.allclose(np.cov(draws), covariance, atol=0.1 * covariance.max())
    assert np.array_equal(draws, gp.sample_y(at, n_samples=4000, random_state=2))


def test_models_can_be_pickled_to_the_bit():
    gp = GaussianProcess(random_state=0).fit(X, Y)
    other = pickle.loads(pickle.dumps(gp))
    assert np.array_equal(other.predict(X), gp.predict(X))
