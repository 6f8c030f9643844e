"""Runs peers and stridemap-gp on the same data, and prints a table and ratios; see README.md."""
import argparse
import json
import os
import pathlib
import subprocess

import numpy as np
from scipy.linalg import cholesky, solve_triangular

HERE = pathlib.Path(__file__).parent
OURS = HERE.parent.parent / "target" / "release" / "examples" / "peer"
THREADS = ["OMP", "OPENBLAS", "MKL", "RAYON", "TF_NUM_INTRAOP", "TF_NUM_INTEROP"]
JITTER = 1e-6  # of K_uu, in signal variances


def kernel(a, b, found):
    a, b = a / found["ell"], b / found["ell"]
    squared = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2 * a @ b.T
    return found["s2"] * np.exp(-0.5 * np.maximum(squared, 0))


def log_marginal_likelihood(x, y, found):
    lower = cholesky(kernel(x, x, found) + found["noise"] * np.eye(len(y)), lower=True)
    v = solve_triangular(lower, y, lower=True)
    return -0.5 * v @ v - np.log(np.diag(lower)).sum() - 0.5 * len(y) * np.log(2 * np.pi)


def bound(x, y, found):
    z, noise = np.asarray(found["Z"]), found["noise"]
    lower = cholesky(kernel(z, z, found) + JITTER * found["s2"] * np.eye(len(z)), lower=True)
    a = solve_triangular(lower, kernel(z, x, found), lower=True) / np.sqrt(noise)
    lower = cholesky(a @ a.T + np.eye(len(z)), lower=True)
    c = solve_triangular(lower, a @ y, lower=True) / np.sqrt(noise)
    rest = len(y) * found["s2"] / noise - (a**2).sum()
    fit = y @ y / noise - c @ c + len(y) * np.log(2 * np.pi * noise)
    return -0.5 * (fit + rest) - np.log(np.diag(lower)).sum()


def run(command, core):
    # OpenBLAS must choose its own kernel: a core type forced from outside would slow numpy.
    environment = {k: v for k, v in os.environ.items() if not k.startswith("OPENBLAS_")}
    environment.update({f"{name}_NUM_THREADS": "1" for name in THREADS})
    environment.update(
        JAX_PLATFORMS="cpu", JAX_ENABLE_X64="1", TF_CPP_MIN_LOG_LEVEL="3", CUDA_VISIBLE_DEVICES="",
        XLA_FLAGS="--xla_cpu_multi_thread_eigen=false",
    )
    command = ["taskset", "-c", core, *map(str, command)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"{' '.join(command)}\n{done.stderr}")
    return json.loads(done.stdout.strip().splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sets", default="2x20,4x100,2x500", help="DIMSxPOINTS, comma-separated")
    parser.add_argument("--peers", help="default: numpy,sklearn,jax; gpflow with --inducing")
    parser.add_argument("--inducing", type=int)
    parser.add_argument("--extra", action="append", default=[], metavar="NAME=COMMAND")
    parser.add_argument("--core", default="1")
    arguments = parser.parse_args()
    sparse = arguments.inducing
    names = (arguments.peers or ("gpflow" if sparse else "numpy,sklearn,jax")).split(",")
    print(f"{'peer':12}{'N':>7}{'d':>3}{'fit s':>12}{'evidence':>12}{'one us':>11}{'1000 us':>11}{'rmse':>9}")
    for entry in arguments.sets.split(","):
        dims, n = map(int, entry.split("x"))
        files = [HERE / "data" / f"train_d{dims}_n{n}.csv", HERE / "data" / f"test_d{dims}.csv"]
        train = np.loadtxt(files[0], delimiter=",")
        x, y = train[:, :-1], train[:, -1]
        target = np.loadtxt(files[1], delimiter=",")[:, -1]
        target = (target - np.mean(target)) / np.std(target)
        commands = {}
        for name in names:
            python = HERE / ("venvtf" if name == "gpflow" else "venv") / "bin" / "python"
            commands[name] = [python, HERE / "peers.py", name, *files, *([sparse] if sparse else [])]
        for extra in arguments.extra:
            name, command = extra.split("=", 1)
            commands[name] = [*command.split(), *files]
        commands["stridemap"] = [OURS, *files, *(["--inducing", sparse] if sparse else [])]
        rows = {}
        for name, command in commands.items():
            found = run(command, arguments.core)
            value = bound(x, y, found) if "Z" in found else log_marginal_likelihood(x, y, found)
            mean = np.asarray(found["mu"])
            rmse = np.sqrt(np.mean(((mean - mean.mean()) / mean.std() - target) ** 2))
            rows[name] = [found["fit_s"], value, found["pred1_us"], found["pred1000_us"]]
            print(
                f"{name:12}{n:7}{dims:3}{found['fit_s']:12.4g}{value:12.3f}"
                f"{found['pred1_us']:11.4g}{found['pred1000_us']:11.4g}{rmse:9.4f}", flush=True,
            )
        ours = rows.pop("stridemap")
        best = [min(row[i] for row in rows.values()) for i in (0, 2, 3)]
        ratios = [ours[i] / b for i, b in zip((0, 2, 3), best)]
        gain = ours[1] - max(row[1] for row in rows.values())
        print(f"{'ratio':12}{'':10}{ratios[0]:12.3f}{gain:+12.4f}{ratios[1]:11.4f}{ratios[2]:11.3f}\n")


if __name__ == "__main__":
    main()
