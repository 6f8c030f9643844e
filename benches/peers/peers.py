"""The peers: each a function of (x, y) that fits, and returns its parameters and a predictor.

    python peers.py NAME TRAIN.csv TEST.csv [M]       one line of JSON, as README.md says
"""
import json
import statistics
import sys
import time

import numpy as np

START_NOISE, LEAST_NOISE = 0.1, 1e-6


def start(dims):
    """(log signal variance, log noise variance, log length scales) and their bounds."""
    bounds = [(-12, 9), (np.log(LEAST_NOISE), 5)] + [(-5, 7)] * dims
    return np.r_[0.0, np.log(START_NOISE), np.zeros(dims)], bounds


def parameters(theta):
    return {"s2": np.exp(theta[0]), "noise": np.exp(theta[1]), "ell": list(np.exp(theta[2:]))}


def fit_numpy(x, y, _):
    """By hand: analytic gradient, LAPACK's potrf and potri, SciPy's L-BFGS-B."""
    import scipy.optimize
    from scipy.linalg.lapack import dpotrf, dpotri, dtrtri

    n, dims = x.shape
    squares = [(x[:, d, None] - x[:, d]) ** 2 for d in range(dims)]

    def covariance(theta):
        weights = np.exp(-2 * theta[2:])
        return np.exp(theta[0] - 0.5 * sum(w * s for w, s in zip(weights, squares)))

    def objective(theta):
        prior = covariance(theta)
        factor, failed = dpotrf(prior + np.exp(theta[1]) * np.eye(n), lower=1)
        if failed:
            return 1e25, np.zeros_like(theta)
        inverse = np.tril(dpotri(factor, lower=1)[0])
        inverse += np.tril(inverse, -1).T
        alpha = inverse @ y
        gap = np.outer(alpha, alpha) - inverse
        weighted = gap * prior
        slopes = [0.5 * np.exp(-2 * t) * np.vdot(weighted, s) for t, s in zip(theta[2:], squares)]
        gradient = np.r_[0.5 * weighted.sum(), 0.5 * np.exp(theta[1]) * np.trace(gap), slopes]
        value = 0.5 * y @ alpha + np.log(np.diag(factor)).sum() + 0.5 * n * np.log(2 * np.pi)
        return value, -gradient

    theta, bounds = start(dims)
    theta = scipy.optimize.minimize(objective, theta, jac=True, method="L-BFGS-B", bounds=bounds).x
    signal, scales = np.exp(theta[0]), np.exp(theta[2:])
    factor, _ = dpotrf(covariance(theta) + np.exp(theta[1]) * np.eye(n), lower=1)
    whitener = np.tril(dtrtri(factor, lower=1)[0])
    alpha = whitener.T @ (whitener @ y)
    scaled = x / scales
    norms = (scaled**2).sum(1)

    def predict(queries):
        q = queries / scales
        k = signal * np.exp(-0.5 * ((q**2).sum(1)[:, None] + norms - 2 * q @ scaled.T))
        return k @ alpha, signal - ((k @ whitener.T) ** 2).sum(1)

    return parameters(theta), predict


def fit_sklearn(x, y, _):
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    shape = RBF(np.ones(x.shape[1]), (1e-2, 1e3))
    kernel = ConstantKernel(1.0, (1e-5, 1e4)) * shape + WhiteKernel(START_NOISE, (LEAST_NOISE, 1e2))
    gp = GaussianProcessRegressor(kernel, alpha=1e-10).fit(x, y)
    k = gp.kernel_
    found = {"s2": k.k1.k1.constant_value, "noise": k.k2.noise_level, "ell": list(k.k1.k2.length_scale)}

    def predict(queries):
        mean, std = gp.predict(queries, return_std=True)
        return mean, std**2 - k.k2.noise_level

    return found, predict


_JAX = {}


def fit_jax(x, y, _):
    """By hand: jitted value and gradient, SciPy's L-BFGS-B, jitted prediction."""
    import jax
    import jax.numpy as jnp
    import scipy.optimize
    from jax.scipy.linalg import solve_triangular

    def covariance(t, a, b):
        a, b = a * jnp.exp(-t[2:]), b * jnp.exp(-t[2:])
        return jnp.exp(t[0] - 0.5 * ((a[:, None] - b) ** 2).sum(-1))

    def factor(t, x):
        return jnp.linalg.cholesky(covariance(t, x, x) + jnp.exp(t[1]) * jnp.eye(len(x)))

    def objective(t, x, y):
        lower = factor(t, x)
        v = solve_triangular(lower, y, lower=True)
        return 0.5 * v @ v + jnp.log(jnp.diag(lower)).sum() + 0.5 * len(y) * jnp.log(2 * jnp.pi)

    def condition(t, x, y):
        whitener = solve_triangular(factor(t, x), jnp.eye(len(y)), lower=True)
        return t, x, whitener, whitener.T @ (whitener @ y)

    def moments(model, queries):
        t, x, whitener, alpha = model
        k = covariance(t, queries, x)
        return k @ alpha, jnp.exp(t[0]) - ((k @ whitener.T) ** 2).sum(1)

    if not _JAX:
        _JAX.update(
            objective=jax.jit(jax.value_and_grad(objective)),
            condition=jax.jit(condition),
            moments=jax.jit(moments),
        )
    x, y = jnp.asarray(x), jnp.asarray(y)

    def numpy_objective(theta):
        value, gradient = _JAX["objective"](theta, x, y)
        return float(value), np.asarray(gradient)

    theta, bounds = start(x.shape[1])
    theta = scipy.optimize.minimize(
        numpy_objective, theta, jac=True, method="L-BFGS-B", bounds=bounds
    ).x
    model = jax.block_until_ready(_JAX["condition"](theta, x, y))

    def predict(queries):
        mean, variance = _JAX["moments"](model, jnp.asarray(queries))
        return np.asarray(mean), np.asarray(variance)

    return parameters(theta), predict


def fit_gpflow(x, y, inducing):
    """SGPR from the first points of a fixed permutation, 200 iterations of L-BFGS-B."""
    import gpflow
    import tensorflow as tf

    tf.config.threading.set_intra_op_parallelism_threads(1)
    tf.config.threading.set_inter_op_parallelism_threads(1)
    kernel = gpflow.kernels.SquaredExponential(variance=1.0, lengthscales=[1.0] * x.shape[1])
    first = np.random.default_rng(0).permutation(len(x))[:inducing]
    model = gpflow.models.SGPR(
        (x, y[:, None]), kernel, inducing_variable=x[first].copy(), noise_variance=START_NOISE
    )
    gpflow.optimizers.Scipy().minimize(
        model.training_loss, model.trainable_variables, options={"maxiter": 200}
    )
    posterior = model.posterior()
    signature = [tf.TensorSpec([None, x.shape[1]], tf.float64)]
    moments = tf.function(posterior.predict_f, input_signature=signature)
    found = {
        "s2": float(kernel.variance.numpy()),
        "noise": float(model.likelihood.variance.numpy()),
        "ell": kernel.lengthscales.numpy().tolist(),
        "Z": model.inducing_variable.Z.numpy().tolist(),
    }

    def predict(queries):
        mean, variance = moments(tf.constant(queries))
        return mean.numpy()[:, 0], variance.numpy()[:, 0]

    return found, predict


PEERS = {"numpy": fit_numpy, "sklearn": fit_sklearn, "jax": fit_jax, "gpflow": fit_gpflow}
# Fits stop when they have taken this long together.
BUDGET_S = 12


def timed(clock, body, times, budget_s):
    """Median seconds of up to `times` calls."""
    seconds = []
    while len(seconds) < times and sum(seconds) < budget_s:
        begin = clock()
        body(len(seconds))
        seconds.append(clock() - begin)
    return statistics.median(seconds)


def main(name, train, test, inducing):
    data, queries = np.loadtxt(train, delimiter=","), np.loadtxt(test, delimiter=",")[:, :-1]
    x, y = np.ascontiguousarray(data[:, :-1]), data[:, -1].copy()
    fit = PEERS[name]
    begin = time.process_time()
    found, predict = fit(x, y, inducing)
    first = time.process_time() - begin
    fit_s = first
    if first < BUDGET_S:
        fit_s = timed(time.process_time, lambda _: fit(x, y, inducing), 5, BUDGET_S)
    predict(queries), predict(queries[:1])
    one = timed(time.perf_counter, lambda i: predict(queries[i % 1000 : i % 1000 + 1]), 2000, 2)
    many = timed(time.process_time, lambda _: predict(queries), 50, 2)
    mean, variance = predict(queries)
    found["ell"] = [float(scale) for scale in found["ell"]]
    found.update(
        s2=float(found["s2"]), noise=float(found["noise"]), fit_s=fit_s, fit_first_s=first,
        pred1_us=1e6 * one, pred1000_us=1e6 * many,
        mu=[float(m) for m in mean], var=[float(v) for v in variance],
    )
    print(json.dumps(found))


if __name__ == "__main__":
    main(*sys.argv[1:4], int(sys.argv[4]) if len(sys.argv) > 4 else None)
