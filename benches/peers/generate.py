"""Writes data/: noisy samples of two smooth functions, with fixed seeds."""
import pathlib

import numpy as np

HERE = pathlib.Path(__file__).parent
NOISE_STD = 0.1
SIZES = [20, 100, 500, 2000, 10000, 50000]


def two(x):
    return np.sin(3 * x[:, 0]) * np.cos(1.5 * x[:, 1]) + 0.6 * x[:, 1] ** 2 + 0.5 * x[:, 0] * x[:, 1]


def four(x):
    wave = np.sin(2.5 * x[:, 0] + 0.5 * x[:, 1])
    return wave + 0.7 * np.cos(2 * x[:, 1]) * x[:, 2] + 0.5 * x[:, 3] ** 2 - 0.4 * x[:, 0] * x[:, 3]


def save(name, columns):
    np.savetxt(HERE / "data" / name, columns, delimiter=",", fmt="%.17g")


if __name__ == "__main__":
    (HERE / "data").mkdir(exist_ok=True)
    for dims, function in [(2, two), (4, four)]:
        rng = np.random.default_rng(20090 + dims)
        many = function(rng.uniform(-1, 1, (200000, dims)))
        mean, std = many.mean(), many.std()
        x = rng.uniform(-1, 1, (1000, dims))
        save(f"test_d{dims}.csv", np.c_[x, (function(x) - mean) / std])
        for n in SIZES:
            rng = np.random.default_rng([2009, dims, n])
            x = rng.uniform(-1, 1, (n, dims))
            y = (function(x) - mean) / std + NOISE_STD * rng.standard_normal(n)
            save(f"train_d{dims}_n{n}.csv", np.c_[x, (y - y.mean()) / y.std()])
