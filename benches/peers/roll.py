"""Imagined strides in jitted JAX: mean, variance and a draw of every output, each stride starting
where the last one ended. The counterpart is the example `stride` of stridemap-gp."""
import os
import statistics
import time

os.environ.update(JAX_PLATFORMS="cpu", JAX_ENABLE_X64="1")
os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")

import jax
import jax.numpy as jnp
from jax.scipy.linalg import solve_triangular

STRIDES, LENGTH_SCALE, NOISE = 1000, 0.8, 0.01


def make(n, dims, outputs):
    keys = jax.random.split(jax.random.PRNGKey(0), 3)
    x = jax.random.uniform(keys[0], (n, dims), minval=-1)
    y = jnp.sin(x @ jax.random.normal(keys[1], (dims, outputs)))
    scales = jnp.full((outputs, dims), LENGTH_SCALE)

    def covariance(a, b, scale):
        return jnp.exp(-0.5 * (((a[:, None] - b) / scale) ** 2).sum(-1))

    def condition(scale, y):
        lower = jnp.linalg.cholesky(covariance(x, x, scale) + NOISE * jnp.eye(n))
        whitener = solve_triangular(lower, jnp.eye(n), lower=True)
        return whitener, whitener.T @ (whitener @ y)

    whiteners, alphas = jax.vmap(condition)(scales, y.T)
    size = max(outputs, dims - 1)

    def stride(state, key):
        action = jnp.tanh(0.1 * state[: dims - 1].sum())
        point = jnp.concatenate([state[: dims - 1], action[None]])
        k = jnp.exp(-0.5 * (((point - x)[None] / scales[:, None]) ** 2).sum(-1))
        mean = (k * alphas).sum(-1)
        variance = 1 - (jnp.einsum("eij,ej->ei", whiteners, k) ** 2).sum(-1)
        draw = mean + jnp.sqrt(jnp.maximum(variance, 1e-9)) * jax.random.normal(key, (outputs,))
        return jnp.clip(jnp.pad(draw, (0, size - outputs)), -1, 1), (mean, variance)

    return stride, jnp.zeros(size)


for n, dims, outputs in [(20, 2, 1), (100, 4, 3)]:
    stride, state = make(n, dims, outputs)
    roll = jax.jit(lambda key: jax.lax.scan(stride, state, jax.random.split(key, STRIDES)))
    jax.block_until_ready(roll(jax.random.PRNGKey(1)))
    seconds = []
    for i in range(51):
        begin = time.process_time()
        jax.block_until_ready(roll(jax.random.PRNGKey(i)))
        seconds.append((time.process_time() - begin) / STRIDES)
    us = 1e6 * statistics.median(seconds)
    print(f"N={n} d={dims} outputs={outputs}: {us:.3f} us a stride (min {1e6 * min(seconds):.3f})")
