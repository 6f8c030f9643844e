"""A learner of one's own: the best of some constant actions in the map, all tried at once."""

import numpy as np

import stridemap


class BestConstant:
    def improve(self, known):
        """`known` has the map, the strides so far, the action's bounds, the iteration and the seed."""
        (low, high), *_ = known.bounds
        actions = np.linspace(low, high, 40)[:, None]
        env = stridemap.MapVectorEnv(40, known.map, physical=True)
        env.reset(seed=known.seed)
        total = np.zeros(40)
        for _ in range(30):
            _, reward, fell, _, _ = env.step(actions)
            total += np.where(fell, -100.0, reward)
        return actions[total.argmax()]


def main(out=None, set=None):
    stridemap.register_learner("best_constant", BestConstant(), "the best of 40 constant actions in the map")
    return stridemap.learn("stepping", out=out, set={"learner.kind": "best_constant", **(set or {})})


if __name__ == "__main__":
    print(main().summary["final"])
