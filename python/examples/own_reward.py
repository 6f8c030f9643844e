"""A reward of one's own: -|psi_roll - 2 deg| instead of the square."""

import stridemap


def inside_by_2_deg(psi_roll_deg, _target):
    return -abs(psi_roll_deg - 2.0)


def main(out=None, set=None):
    stridemap.register_reward("inside_by_2_deg", inside_by_2_deg, component="psi_roll_deg")
    task = stridemap.Task.builtin("stepping").set({"reward": [{"quantity": "inside_by_2_deg", "weight": 0.1}]})
    task = task.set({"success.psi_roll_within_deg": 180.0})
    return stridemap.learn(task, out=out, set=set)


if __name__ == "__main__":
    print(main().summary["final"])
