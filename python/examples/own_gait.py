"""A gait of one's own: the paper's stepping, with one oscillator for both legs (MA09, eqs. 1 to 5).

The oscillator is locked to the phase of the robot's own sway, which its centre of pressure tells.
"""

import time

import numpy as np

import stridemap


class OneOscillator:
    modulations = [("step_amplitude_deg", 0.0, -20.0, 20.0)]  # name, neutral, lowest, highest
    start_up_s = 4.0

    def __init__(self, robot, own):
        self.rest, self.natural_rad_s = robot.rest_rad, own.get("natural_frequency_rad_s", 3.5)
        self.roll, self.right, self.left = np.zeros((3, len(self.rest)))
        for (side, joint), (index, sign) in robot.legs.items():
            self.roll[index] = sign * {"hip_roll": -1.0, "ankle_roll": 1.0}.get(joint, 0.0)
            pitch = self.right if side == "right" else self.left
            pitch[index] = sign * {"hip_pitch": 1.0, "knee": -2.0, "ankle_pitch": 1.0}.get(joint, 0.0)

    def reset(self):
        self.phase, self.sway_m, self.rate_m_s = PHASE_OF_RIGHT, None, 0.0

    def targets(self, state, dt):
        right_m = state.foot_centre_m[:, 1].mean() - state.cop_m[1]  # where the weight rests, + right
        if self.sway_m is None:
            self.sway_m = 0.0 if np.isnan(right_m) else right_m
        elif not np.isnan(right_m):
            before, self.sway_m = self.sway_m, self.sway_m + (right_m - self.sway_m) * dt / (0.05 + dt)
            self.rate_m_s += ((self.sway_m - before) / dt - self.rate_m_s) * dt / (0.03 + dt)
        robot_phase = -np.arctan2(self.rate_m_s, self.sway_m)
        lag = robot_phase - self.phase + PHASE_OF_RIGHT
        self.phase += (self.natural_rad_s + 10.0 * np.sin(lag)) * dt
        t, s = state.time_s[0], np.sin(self.phase)
        roll = np.radians(4.0) * np.clip(t, 0.0, 1.0)
        pitch = np.radians(6.0 + state.modulation[0]) * np.clip((t - 1.0) / 3.0, 0.0, 1.0)
        return self.rest + roll * s * self.roll + pitch * s * (self.right - self.left)

    def phase_rad(self, side):
        return self.phase if side == "right" else self.phase + np.pi


PHASE_OF_RIGHT = -np.pi / 2  # phi_d of the right leg


def seconds_per_stride(task, strides):
    env = stridemap.StrideEnv(task, physical=True)
    env.reset(seed=1)
    started = time.process_time()
    ends = [env.step(np.zeros(1))[4]["end"] for _ in range(strides)]
    assert set(ends) == {"crossing"}, ends
    return (time.process_time() - started) / strides


def main(strides=20):
    stridemap.register_gait("one_oscillator", OneOscillator, "the paper's stepping in Python")
    task = stridemap.Task.builtin("stepping")
    own = seconds_per_stride(task.set({"gait.kind": "one_oscillator"}), strides)
    rust = seconds_per_stride(task, strides)
    cost_s = own - rust
    print(f"{1e3 * own:.1f} ms of a stride with the gait in Python, {1e3 * rust:.1f} ms with Rust's own")
    return cost_s


if __name__ == "__main__":
    main()
