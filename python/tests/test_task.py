import copy
import pickle
import subprocess
import sys
import time
from pathlib import Path

import pytest

import stridemap
from stridemap import Task


def test_a_built_in_task_knows_its_parts_and_takes_other_values():
    task = Task.builtin("stepping")
    assert task.name == "stepping" and "stepping" in Task.builtins()
    assert task.state_names[0] == "psi_roll_deg"
    assert task.action_names == ["step_amplitude_deg"]
    (low, high), = task.action_bounds
    assert low < 0 < high
    other = task.set({"robot.friction": 0.6}).set(robot__mass_scale=1.05)
    assert "friction = 0.6" in other.to_toml() and "mass_scale = 1.05" in other.to_toml()
    assert "friction = 0.6" not in task.to_toml()
    assert repr(other) == "Task('stepping', set=['robot.friction=0.6', 'robot.mass_scale=1.05'])"


def test_values_of_every_kind_come_as_toml():
    import numpy as np

    task = Task.builtin("stepping").set(
        {"about": 'a "name"', "collect.strides": (8, 4), "robot.mass_scale": np.float64(1.5), "action.0.bounds": np.array([-1.0, 5.0])}
    )
    assert task.about == 'a "name"' and task.action_bounds == [(-1.0, 5.0)]


def test_errors_say_where(tmp_path: Path):
    file = tmp_path / "mine.toml"
    file.write_text('extends = "stepping"\nname = "mine"\nrobot.frictoin = 0.6\n')
    with pytest.raises(stridemap.RequestError, match="did you mean `friction`") as caught:
        Task.from_file(file)
    assert (caught.value.file, caught.value.line, caught.value.key) == (str(file), 3, "robot.frictoin")
    assert isinstance(caught.value, ValueError) and isinstance(caught.value, stridemap.StridemapError)
    with pytest.raises(stridemap.RequestError) as caught:
        Task.builtin("stepping").set({"map.starts": 0})
    assert caught.value.key == "map.starts" and caught.value.file == "--set map.starts=0"
    with pytest.raises(stridemap.RequestError, match="no built-in task"):
        Task.builtin("stepp")
    with pytest.raises(stridemap.RequestError, match="stepping"):
        stridemap.learn("steping")
    with pytest.raises(stridemap.RequestError) as caught:
        stridemap.Run(tmp_path)
    assert caught.value.file == str(tmp_path)


def test_tasks_can_be_copied_and_pickled():
    task = Task.builtin("walking").set({"robot.friction": 0.9})
    for other in (pickle.loads(pickle.dumps(task)), copy.deepcopy(task)):
        assert other.to_toml() == task.to_toml()


def test_import_is_quick_and_needs_no_mujoco_module():
    code = (
        "import time; t = time.process_time(); import stridemap, sys; "
        "print(time.process_time() - t, 'mujoco' in sys.modules)"
    )
    done = [subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True) for _ in range(3)]
    print("import stridemap, CPU s:", *(d.stdout.split()[0] for d in done))
    assert all(d.stdout.split()[1] == "False" for d in done)


def test_python_runs_while_the_robot_learns(tmp_path: Path, small: dict):
    """The GIL is released: another thread counts meanwhile."""
    import threading

    ticks, going = 0, True

    def count() -> None:
        nonlocal ticks
        while going:
            time.sleep(0.001)
            ticks += 1

    thread = threading.Thread(target=count)
    thread.start()
    try:
        stridemap.learn("stepping", out=tmp_path / "run", set=small, report=False)
    finally:
        going = False
        thread.join()
    assert ticks > 10
