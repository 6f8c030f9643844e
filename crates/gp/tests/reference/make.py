"""Reference values for tests/reference.rs, from scikit-learn and GPflow.

    python3 -m venv venv && venv/bin/pip install scikit-learn==1.9.1 gpflow==2.11.2 tensorflow-cpu==2.21.0
    venv/bin/python make.py          # rewrites the CSV files beside this script

Data are a formula, so nothing is drawn. exact.csv: one line a model, with its log marginal
likelihood, then means and latent variances at the queries. sparse.csv likewise, with the bound (VFE)
or log marginal likelihood (FITC) of the approximation. GPflow adds 1e-6 to the diagonal of K_uu.
"""
import csv
import os

import numpy as np

HERE = os.path.dirname(os.path.abspath(__file__))
LENGTH_SCALES, SIGNAL, NOISE = [0.7, 1.3], 1.0, 0.02


def points(n, phase):
    i = np.arange(1, n + 1)
    return np.c_[np.sin(1.7 * i + phase), np.cos(2.3 * i * i + phase)] * [1.5, 2.0]


X, Q, Z = points(40, 0.0), points(9, 0.4), points(8, 1.1)
Y = np.sin(2 * X[:, 0]) + 0.5 * X[:, 1] + 0.1 * np.sin(37.0 * np.arange(40))


def write(name, rows):
    with open(os.path.join(HERE, name), "w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def line(library, kernel, value, mean, variance):
    return [library, kernel] + ["%.17g" % v for v in [value, *np.ravel(mean), *np.ravel(variance)]]


def scikit_learn():
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

    for name, kernel in [
        ("squared_exponential", RBF(LENGTH_SCALES)),
        ("matern32", Matern(LENGTH_SCALES, nu=1.5)),
        ("matern52", Matern(LENGTH_SCALES, nu=2.5)),
    ]:
        whole = ConstantKernel(SIGNAL) * kernel + WhiteKernel(NOISE)
        gp = GaussianProcessRegressor(whole, alpha=0.0, optimizer=None).fit(X, Y)
        mean, covariance = gp.predict(Q, return_cov=True)
        value = gp.log_marginal_likelihood(gp.kernel_.theta)
        yield line("scikit-learn", name, value, mean, np.diag(covariance) - NOISE)


def gpflow_kernel(name):
    import gpflow

    make = {
        "squared_exponential": gpflow.kernels.SquaredExponential,
        "matern32": gpflow.kernels.Matern32,
        "matern52": gpflow.kernels.Matern52,
    }[name]
    return make(variance=SIGNAL, lengthscales=LENGTH_SCALES)


def gpflow_exact():
    import gpflow

    for name in ["squared_exponential", "matern32", "matern52"]:
        gp = gpflow.models.GPR((X, Y[:, None]), gpflow_kernel(name), noise_variance=NOISE)
        mean, variance = gp.predict_f(Q)
        yield line("gpflow", name, gp.log_marginal_likelihood().numpy(), mean, variance)


def gpflow_sparse():
    import gpflow

    for method, model in [("vfe", gpflow.models.SGPR), ("fitc", gpflow.models.GPRFITC)]:
        for name in ["squared_exponential", "matern32", "matern52"]:
            gp = model((X, Y[:, None]), gpflow_kernel(name), inducing_variable=Z, noise_variance=NOISE)
            mean, variance = gp.predict_f(Q)
            yield line(method, name, gp.maximum_log_likelihood_objective().numpy(), mean, variance)


if __name__ == "__main__":
    write("train.csv", [["%.17g" % v for v in row] for row in np.c_[X, Y]])
    write("queries.csv", [["%.17g" % v for v in row] for row in Q])
    write("inducing.csv", [["%.17g" % v for v in row] for row in Z])
    write("exact.csv", [*scikit_learn(), *gpflow_exact()])
    write("sparse.csv", list(gpflow_sparse()))
