"""What Python costs: `python python/tests/bench.py`. Processor time, of a quiet machine or a busy one."""

import time

import numpy as np

import stridemap


def seconds(work) -> float:
    started = time.process_time()
    work()
    return time.process_time() - started


def main() -> None:
    small = {"algorithm.iterations": 1, "record.strides": 20, "record.iteration_strides": 20, "record.pose_seconds": 0.0}
    import tempfile

    with tempfile.TemporaryDirectory() as dir:
        run = stridemap.learn("stepping", seed=3, out=f"{dir}/run", set=small, report=False)
        strides, map, policy = 60, run.map, run.policy
        env = stridemap.StrideEnv(run.task, physical=True)

        def by_hand() -> None:
            state, _ = env.reset(seed=1)
            for _ in range(strides):
                state, *_ = env.step(policy(state))

        def by_rust() -> None:
            stridemap.evaluate(run, strides=strides - 10, seed=1)

        by_hand(), by_rust()
        ratios = sorted(seconds(by_hand) / seconds(by_rust) for _ in range(5))
        print(f"a stride of the robot through StrideEnv: {ratios[2]:.3f} of Rust's cost (median of 5: {ratios})")

        robots, steps = 1000, 100
        envs = stridemap.MapVectorEnv(robots, map, physical=True, max_episode_steps=steps + 1)
        actions = np.full((robots, 1), float(policy([2.0])[0]))
        start = envs.reset(seed=1)[0]

        def imagined() -> None:
            envs.reset(seed=1)
            for _ in range(steps):
                envs.step(actions)

        held = stridemap.Policy.constant(run.task, [float(actions[0, 0])])
        pairs = [(seconds(imagined), seconds(lambda: map.rollout(held, start, n=steps, rng=1))) for _ in range(5)]
        ratios = sorted(rust / python for python, rust in pairs)
        rate = robots * steps / min(python for python, _ in pairs)
        print(f"{robots * steps} imagined strides through MapVectorEnv: {rate:.3g} a second of processor time,")
        print(f"  {ratios[2]:.2f} of the rate of Rust's own loop (median of 5: {ratios})")


if __name__ == "__main__":
    main()
