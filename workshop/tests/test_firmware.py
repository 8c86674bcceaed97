"""Firmware: it walks the simulator as Python's policy does, and stops when it must, not else."""

import ctypes
import math
import os
import re
import shutil
import subprocess
from pathlib import Path
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from agents.export import export
from jansen_env import ROBOTS
from jansen_env.engine.onboard_estimates import estimate_onboard
from jansen_env.engine.walk_reward import (
    ACCOUNTS,
    STEPS_PER_TURN,
    keep_accounts,
    mean_fraction,
)
from jansen_env.policies import pretrained
from jansen_env.robot.kinematics import advance_per_turn
from jansen_env.robot.motor import MOTORS
from jansen_env.tasks.walking.tuned import gains_of
from jansen_env.world.onboard import ESTIMATES, onboard_columns, toe_paths

ID, NAME = "JansenWalkerBuilt-v0", "onboard"
STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow",
          "-pedantic", "-Werror")  # fmt: skip
FAULTS = ("fine", "tilted", "no encoder", "no imu", "no motor", "stalled", "low battery",
          "too late", "no number", "against torque", "no gravity", "wrong gyro")  # fmt: skip
FIELDS = ("period", "speed_command", "crank_angle", "pitch_rate", "acceleration_x",
          "acceleration_y", "crank_torque", "battery")  # fmt: skip
PERIOD, RATE = 0.02, 60.0  # s, N m/s
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")


class Sensors(ctypes.Structure):
    _fields_ = [
        (name, ctypes.c_double if name == "crank_angle" else ctypes.c_float) for name in FIELDS
    ]


class Memory(ctypes.Structure):
    """The first fields of ``struct jansen``, and room for the rest."""

    _fields_ = [
        ("fault", ctypes.c_int),
        ("action", ctypes.c_float),
        ("cos_pitch", ctypes.c_float),
        ("sin_pitch", ctypes.c_float),
        ("crank_angle", ctypes.c_float),
        ("crank_speed", ctypes.c_float),
        ("rest", ctypes.c_double * 60),
    ]


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    """Firmware of the shipped policy, compiled."""
    return compiled(tmp_path_factory.mktemp("firmware"), NAME)


def compiled(folder, name):
    header, source = export(f"pretrained:{name}", ("firmware",), folder, "mine", ID)
    assert (header.name, source.name) == ("mine_firmware.h", "mine_firmware.c")
    built = folder / "mine.so"
    subprocess.run(["cc", *STRICT, "-shared", "-fPIC", "-o", built, source, "-lm"], check=True)
    made = ctypes.CDLL(str(built))
    made.jansen_step.restype = made.jansen_watchdog.restype = ctypes.c_float
    made.jansen_watchdog.argtypes = ctypes.POINTER(Memory), ctypes.c_float
    return made


class Firmware:
    """A machine's own computer."""

    def __init__(self, library):
        self.memory, self._library = Memory(), library
        library.jansen_init(ctypes.byref(self.memory))

    @property
    def fault(self):
        return FAULTS[self.memory.fault]

    def step(self, **readings):
        """The torque for readings, N m."""
        return self._library.jansen_step(
            ctypes.byref(self.memory), ctypes.byref(Sensors(*(readings[name] for name in FIELDS)))
        )

    def watchdog(self, elapsed):
        return self._library.jansen_watchdog(ctypes.byref(self.memory), elapsed)


def quantised(value, step):
    return step * round(value / step)


def walk(controller, command, seed, seconds=10.0, name=NAME, fallen=None, **world):
    """The return of an episode whose sensors are read early or late by up to 1 ms, and torques.

    ``world``: arguments of the environment, such as terrain, friction and pushes. ``fallen``: a
    list for the size of the pitch after each step.

    ``controller``: of the readings, torque in N m. Encoder of 14 bits, gyro and accelerometer of
    16 bits (2000 degrees/s, 16 g), torque of 12 bits (the limit), all with the errors of the
    policy's training; each torque comes a control step late.
    """
    policy = pretrained.load(ID, name)
    env = gym.make(ID, **{**policy.env_kwargs, "delay": PERIOD, "torque_rate": None, **world})
    seen, _ = env.reset(seed=seed, options={"speed_command": command})
    rng, late, angle = np.random.default_rng(seed), 0.0, 0.0
    names = [entry.name for entry in env.unwrapped.observed]
    torques, total = [], 0.0
    for _ in range(round(seconds / PERIOD)):
        now = dict(zip(names, seen.tolist(), strict=True))
        before, late = late, rng.uniform(-1e-3, 1e-3)
        angle = math.atan2(now["sin_crank_angle"], now["cos_crank_angle"])
        torque = controller(
            period=PERIOD + late - before, speed_command=command,
            crank_angle=quantised(angle + now["crank_speed"] * late, math.tau / 2**14),
            pitch_rate=quantised(now["pitch_rate"], math.radians(4000.0) / 2**16),
            acceleration_x=quantised(now["acceleration_x"], 32.0 * 9.81 / 2**16),
            acceleration_y=quantised(now["acceleration_y"], 32.0 * 9.81 / 2**16),
            crank_torque=quantised(now["crank_torque"], policy.torque_limit / 2**11), battery=24.0,
        )  # fmt: skip
        torques.append(torque)
        seen, reward, ended, _, info = env.step([torque / policy.torque_limit])
        if fallen is not None:
            fallen.append(abs(info["pitch"]))
        total += reward
        if ended:
            break
    return total, np.array(torques)


class Wrong:
    """Firmware whose sensors have another sign or unit; ``steps``: until a fault."""

    def __init__(self, library, change):
        self.firmware, self._change, self.steps = Firmware(library), change, 0

    def __call__(self, **readings):
        self.steps += self.firmware.fault == "fine"
        return self.firmware.step(**{**readings, **self._change(**readings)})


def scaled(factor, *names):
    return lambda **readings: {name: factor * readings[name] for name in names}


WRONG = {
    # The faults that it may be, within how many seconds, and what is wrong.
    "reversed encoder": (("against torque",), 1.5, scaled(-1.0, "crank_angle")),
    "degrees": (("wrong gyro", "tilted"), 0.5, scaled(math.degrees(1.0), "pitch_rate")),
    "g": (("no gravity",), 0.06, scaled(1.0 / 9.81, "acceleration_x", "acceleration_y")),
    "half": (("no gravity",), 0.06, scaled(0.5, "acceleration_x", "acceleration_y")),
    "twice": (("no gravity",), 0.06, scaled(2.0, "acceleration_x", "acceleration_y")),
    "milli-g": (("no gravity",), 0.06, scaled(1e3 / 9.81, "acceleration_x", "acceleration_y")),
}


@pytest.mark.parametrize("case", WRONG)
def test_sensors_of_another_sign_or_unit_stop_the_machine(library, case):
    """In the simulator, at the slowest and the fastest command; the torque is 0 from then on."""
    faults, seconds, change = WRONG[case]
    for command in (0.05, 0.3):
        wrong = Wrong(library, change)
        _, torques = walk(wrong, command, seed=1, seconds=2.0)
        assert wrong.firmware.fault in faults
        assert wrong.steps <= round(seconds / PERIOD)
        assert not torques[wrong.steps :].any()
        assert case in ("reversed encoder", "degrees") or not torques.any()


def test_a_reversed_motor_is_as_a_reversed_encoder(library):
    firmware = Firmware(library)
    walk(lambda **readings: -firmware.step(**readings), 0.3, seed=0, seconds=4.0)
    assert firmware.fault == "against torque"


FALSE = ("against torque", "no gravity", "wrong gyro", "no number")
GROUNDS = ("rough", "mixed", "stairs", "slope:0.1", "slope:-0.1", "slope:0.2", "slope:-0.2",
           "slope:0.35", "slope:-0.35")  # fmt: skip


def hard_world(seed, strength):
    """Ground, grip, pushes and load that are drawn; ``strength``: of the machine, beside economy.

    Slopes on which it slides or the load drives the crank, pushes that throw it over.
    """
    rng = np.random.default_rng(seed)
    ground = GROUNDS[seed % len(GROUNDS)]
    world = {"terrain": ground, "friction": rng.choice([0.1, 0.2, 0.4, 0.8, 1.2]).item()}
    if not ground.startswith("slope"):
        world["terrain_level"] = rng.integers(0, 10 if strength == 1.0 else 4).item()
    if rng.random() < 0.6:
        impulse = strength * rng.choice([2.0, 5.0, 10.0]), strength * rng.choice([0.0, 4.0])
        world["push"] = {"impulse": impulse, "interval": rng.choice([1.0, 2.0, 5.0]).item()}
    if rng.random() < 0.3:
        world["payload"] = strength * rng.uniform(0.0, 4.0)
    return world


@pytest.mark.parametrize(("name", "episodes"), [
    (NAME, 9), pytest.param(NAME, 100, marks=pytest.mark.slow),
    pytest.param("weekend", 100, marks=pytest.mark.slow),
])  # fmt: skip
def test_no_honest_machine_has_wrong_sensors(name, episodes, tmp_path):
    """It slips, is pushed, climbs, slides down and is driven by its load; it may stall or fall.

    A fall that a push begins may look like a wrong gyro: the machine lies then, too.
    """
    library, faults = compiled(tmp_path, name), []
    for seed in range(episodes):
        firmware, pitch = Firmware(library), []
        command = COMMANDS[name][seed % len(COMMANDS[name])]
        world = hard_world(seed, 1.0 if name == NAME else 0.1)
        walk(firmware.step, command, seed, name=name, fallen=pitch, **world)
        faults.append(firmware.fault)
        assert firmware.fault not in FALSE or (firmware.fault == "wrong gyro" and max(pitch) > 0.6)
    print({fault: faults.count(fault) for fault in FAULTS})
    assert faults.count("fine") > episodes / 2 and faults.count("wrong gyro") <= episodes / 50


@pytest.mark.parametrize("turns", [-3, 1_000, 10**9])
def test_the_turn_of_the_crank_does_not_matter(library, turns):
    """A billion turns give the torques of none, 1e-4 N m; as a float they would be no angle."""
    expected = run(library, 100).torques
    torques = run(library, 100, crank_angle=lambda k: turning(k) + math.tau * turns).torques
    assert np.ptp(expected) > 1.0 and torques == pytest.approx(expected, abs=1e-4)


class InPython:
    """The shipped policy behind the sensors' filters of the environment."""

    def __init__(self, name=NAME):
        self.policy, self.action = pretrained.load(ID, name), 0.0
        robot = ROBOTS[self.policy.env_kwargs["robot"]]()
        path = abs(advance_per_turn(robot)) / STEPS_PER_TURN
        accounts = dict.fromkeys(ACCOUNTS.names, 0.0)
        self.walk, self.kept = SimpleNamespace(mean_path=path), SimpleNamespace(**accounts)
        self.paths = toe_paths(robot)
        memory = SimpleNamespace(estimates=np.zeros(ESTIMATES), is_first=True)
        self.robot = SimpleNamespace(onboard=memory)
        self.seen = np.zeros((1, len(self.policy.observed)), np.float32)
        self.columns = {name: k for k, name in enumerate(self.policy.observed)}

    def __call__(self, period, speed_command, crank_angle, battery, **now):
        now |= {"cos_crank_angle": math.cos(crank_angle), "sin_crank_angle": math.sin(crank_angle)}
        now |= {"last_action": self.action, "speed_command": speed_command}
        for name, value in now.items():
            self.seen[0, self.columns[name]] = value
        first, columns = self.robot.onboard.is_first, onboard_columns(self.columns)
        estimate_onboard(period, not first, self.robot, self.paths, columns, self.seen[0])
        velocity = float(self.seen[0, self.columns["crank_axis_x_velocity"]])
        if not first:
            fraction = mean_fraction(period, speed_command, self.walk)
            keep_accounts(velocity, 0.0, 0.0, 0.0, period, speed_command, fraction, self.kept)
        self.seen[0, self.columns["lag"]] = self.kept.lag
        self.seen[0, self.columns["mean_speed"]] = self.kept.mean_speed
        action = float(self.policy.predict(self.seen)[0][0, 0])
        most = self.policy.env_kwargs["torque_rate"] * PERIOD / self.policy.torque_limit
        self.action += most * float(np.clip(action - self.action, -1.0, 1.0))
        return self.action * self.policy.torque_limit


def test_it_acts_as_the_policy_in_python_does(library):
    """The same readings, rounded, noisy and jittering, give the same torque, 1e-4 N m."""
    firmware, policy, differences = Firmware(library), InPython(), []

    def both(**readings):
        torque = firmware.step(**readings)
        differences.append(abs(torque - policy(**readings)))
        return torque

    _, torques = walk(both, 0.3, 1)
    assert len(torques) == 500 and np.ptp(torques) > 1.0 and max(differences) < 1e-4
    assert np.abs(np.diff(torques, prepend=0.0)).max() <= RATE * PERIOD


COMMANDS = {NAME: (0.05, 0.1, 0.2, 0.25, 0.3), "weekend": (0.03, 0.06, 0.09, 0.12)}  # m/s


@pytest.mark.slow
@pytest.mark.parametrize("name", [NAME, pytest.param("weekend", marks=pytest.mark.slow)])
def test_it_walks_as_the_policy_in_python_does(name, tmp_path):
    """The return within 2 %, mean of 10 walks, as each is chaotic; nothing stops them."""
    library, returns = compiled(tmp_path, name), []
    for command in COMMANDS[name]:
        for seed in range(2):
            firmware = Firmware(library)
            both = firmware.step, InPython(name)
            returns.append([walk(each, command, seed, name=name)[0] for each in both])
            assert firmware.fault == "fine"
    walked, expected = np.mean(returns, axis=0)
    assert walked == pytest.approx(expected, rel=0.02) and walked > 230.0


STANDING = dict(
    period=PERIOD, speed_command=0.3, crank_angle=0.0, pitch_rate=0.0, acceleration_x=0.0,
    acceleration_y=9.81, crank_torque=0.0, battery=24.0,
)  # fmt: skip


def turning(k):
    """The crank angle in a step at 3 rad/s."""
    return 3.0 * PERIOD * k % math.tau


def run(library, steps, **changes):
    """Firmware after ``steps`` of a turning crank, and the torques; ``changes``: of readings,
    functions of the step."""
    firmware, torques = Firmware(library), []
    for k in range(steps):
        more = {name: change(k) for name, change in changes.items()}
        torques.append(firmware.step(**{**STANDING, "crank_angle": turning(k), **more}))
    return SimpleNamespace(fault=firmware.fault, torques=torques, firmware=firmware)


def missing(first, last, value):
    """A reading that does not come in some steps."""
    return lambda k: math.nan if first <= k < last else value(k)


def fallen_by(k):
    """Pitch in a step of a fall at 2 rad/s that begins in step START."""
    return 2.0 * PERIOD * max(0, k + 1 - START)


START = 100  # steps before something goes wrong
TRIPS = {
    # The fault, within how many steps, and what the readings are.
    "falls": (
        "tilted",
        23,
        {
            "pitch_rate": lambda k: 2.0 * (k >= START),
            "acceleration_x": lambda k: 9.81 * math.sin(fallen_by(k)),
            "acceleration_y": lambda k: 9.81 * math.cos(fallen_by(k)),
        },
    ),
    "gyro alone": ("wrong gyro", 25, {"pitch_rate": lambda k: 2.0 * (k >= START)}),
    "gyro's range": ("wrong gyro", 1, {"pitch_rate": lambda k: 1e38 * (k >= START)}),
    "range changes": ("no gravity", 165, {"acceleration_y": lambda k: 9.81 / (1 + (k >= START))}),
    "too large": ("no gravity", 3, {"acceleration_y": lambda k: 1e6 if k >= START else 9.81}),
    "driven back": (
        "against torque",
        75,
        {"crank_angle": lambda k: turning(2 * min(k, START) - k)},
    ),
    "no encoder": ("no encoder", 3, {"crank_angle": missing(START, 999, turning)}),
    "slipped": ("no encoder", 3, {"crank_angle": lambda k: turning(k) + 2.0 * (k >= START)}),
    "no imu": ("no imu", 3, {"pitch_rate": missing(START, 999, lambda k: 0.0)}),
    "no accelerometer": ("no imu", 3, {"acceleration_y": missing(START, 999, lambda k: 9.81)}),
    "no motor": ("no motor", 3, {"crank_torque": missing(START, 999, lambda k: 0.0)}),
    "stall": ("stalled", 251, {"crank_angle": lambda k: turning(min(k, START))}),
    "battery": ("low battery", 51, {"battery": lambda k: 24.0 if k < START else 19.0}),
    "no voltage": ("low battery", 51, {"battery": missing(START, 999, lambda k: 24.0)}),
    "late": ("too late", 1, {"period": lambda k: PERIOD if k < START else 0.07}),
    "time stands": ("too late", 1, {"period": lambda k: PERIOD if k < START else 0.0}),
    "no time": ("too late", 1, {"period": missing(START, 999, lambda k: PERIOD)}),
}
PASSES = {
    "leaning": {"acceleration_x": lambda k: 6.0, "acceleration_y": lambda k: 7.7},
    "two readings lost": {"crank_angle": missing(START, START + 2, turning)},
    "imu twice lost": {"pitch_rate": missing(START, START + 2, lambda k: 0.0)},
    "every other reading": {"crank_angle": lambda k: math.nan if k % 2 else turning(k)},
    "motor twice lost": {"crank_torque": missing(START, START + 2, lambda k: 0.0)},
    "a pause": {"crank_angle": lambda k: turning(k if k < START else max(START, k - 140))},
    "standing": {"crank_angle": lambda k: 1.0, "speed_command": lambda k: 0.0},
    "no command": {"speed_command": lambda k: math.nan},
    "a dip": {"battery": lambda k: 19.0 if START <= k < START + 49 else 24.0},
    "braking downhill": {"crank_angle": lambda k: 4.0 * turning(k)},
    "rolls back": {"crank_angle": lambda k: turning(k if k < START else START)
                   - (0.4 * math.sin(0.1 * (k - START)) if k > START else 0.0)},
    "infinite command": {"speed_command": lambda k: math.inf},
    "jitter": {"period": lambda k: PERIOD + 0.015 * (-1) ** k},
}  # fmt: skip


@pytest.mark.parametrize("case", TRIPS)
def test_what_must_stop_it_stops_it_in_time(library, case):
    """The torque is 0 from then on, whatever comes; only jansen_init begins again."""
    fault, within, changes = TRIPS[case]
    assert run(library, START, **changes).fault == "fine"
    stopped = run(library, START + within, **changes)
    assert stopped.fault == fault and stopped.torques[-1] == 0.0
    assert any(stopped.torques[:START])
    for _ in range(5):
        assert stopped.firmware.step(**STANDING) == stopped.firmware.watchdog(0.0) == 0.0
    assert stopped.firmware.fault == fault
    early = run(library, START + within - (1 if within <= 3 else 5), **changes)
    assert early.fault == "fine"


@pytest.mark.parametrize("case", PASSES)
def test_what_must_not_stop_it_does_not(library, case):
    passed = run(library, START + 200, **PASSES[case])
    assert passed.fault == "fine"
    assert any(passed.torques[-20:]) == ("command" not in case and case != "standing")


def test_a_loop_that_hangs_is_stopped_by_the_timer(library):
    walking = run(library, START)
    assert walking.firmware.watchdog(0.05) == pytest.approx(walking.torques[-1]) != 0.0
    assert walking.firmware.watchdog(0.061) == 0.0 and walking.firmware.fault == "too late"
    assert walking.firmware.step(**STANDING) == 0.0


def test_nothing_moves_before_each_sensor_was_read(library):
    assert run(library, 2, crank_angle=lambda k: math.nan).torques == [0.0, 0.0]
    assert run(library, 3, pitch_rate=lambda k: math.nan).fault == "no imu"
    faster, fast = (run(library, 60, speed_command=lambda k, v=v: v).torques for v in (9.0, 0.6))
    assert faster == fast  # commands end at the fastest one that it was trained for


def test_policies_that_no_machine_can_run_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"must be one of .*, got 'crank_axis_y_velocity'"):
        export("pretrained", ("firmware",), tmp_path, "mine", ID)
    assert not [*tmp_path.iterdir()]


def test_the_example_of_a_port_compiles_and_its_frames_are_read_back(tmp_path):
    export(f"pretrained:{NAME}", ("firmware",), tmp_path, "walker", ID)
    example = Path(__file__).parents[1] / "firmware" / "ak80_6.c"
    built = tmp_path / "port.so"
    build = ["cc", *STRICT, "-I", tmp_path, "-shared", "-fPIC", "-o", built, example]
    subprocess.run(build, check=True)
    port = ctypes.CDLL(str(built), mode=os.RTLD_LAZY)  # the board's functions are not there
    port.torque_frame.argtypes = ctypes.c_float, ctypes.c_char_p
    port.answered_torque.restype = ctypes.c_float
    for torque, bits in ((-12.0, 0), (12.0, 0xFFF), (20.0, 0xFFF), (3.0, 0xA00)):
        frame = ctypes.create_string_buffer(8)
        port.torque_frame(torque, frame)
        assert frame.raw[:6] == bytes.fromhex("7fff7ff00000")
        assert int.from_bytes(frame.raw[6:], "big") == pytest.approx(bits, abs=1)
        answer = bytes([1, 0x7F, 0xFF, 0x7F, 0xF0 | frame.raw[6], frame.raw[7]])
        assert port.answered_torque(answer) == pytest.approx(np.clip(torque, -12, 12), abs=0.006)


def test_the_weekend_robots_port_compiles_and_its_motor_gives_the_torque(tmp_path):
    """The current settles within 20 ms, moving or not; angles go from 0 to a turn."""
    export("pretrained:weekend", ("firmware",), tmp_path, "weekend", ID)
    example = Path(__file__).parents[1] / "firmware" / "weekend_esp32.c"
    built = tmp_path / "port.so"
    build = ["cc", *STRICT, "-I", tmp_path, "-shared", "-fPIC", "-o", built, example, "-lm"]
    subprocess.run(build, check=True)
    port = ctypes.CDLL(str(built), mode=os.RTLD_LAZY)  # the board's functions are not there
    port.crank_angle.restype, port.motor_duty.restype = ctypes.c_double, ctypes.c_float
    hours = 359_184 * 5_000, 0.0  # 500,000 turns
    for count, turns in ((0, 0.0), (898, 0.25), (3592, 0.0), (-898, 0.75), (359_184, 0.0), hours):
        angle = port.crank_angle(count + 7, 7)
        assert np.cos(angle - 2.0 * np.pi * turns) == pytest.approx(1.0, abs=1e-6)
    motor = MOTORS["lp_25d_75"]
    volts, resistance, inductance = 11.1, 13.3, 5e-3  # the inductance is not in the sheet
    constant = motor.stall_torque / (volts / resistance)
    for torque, speed in ((0.35, 0.0), (0.2, 4.0), (-0.1, 4.0), (0.0, 4.0)):
        current, total = 0.0, ctypes.c_float(0.0)
        for _ in range(20):
            duty = port.motor_duty(
                *map(ctypes.c_float, (torque, speed, current, volts)), ctypes.byref(total)
            )
            assert abs(duty) <= 1.0
            for _ in range(20):  # of 50 us
                induced = volts / motor.no_load_speed * speed
                current += 5e-5 / inductance * (volts * duty - resistance * current - induced)
        assert constant * current == pytest.approx(torque, abs=0.02)
    assert port.motor_duty(
        *map(ctypes.c_float, (0.3, 0.0, 0.0, 0.0)), ctypes.byref(ctypes.c_float(1.0))
    ) == 0.0  # fmt: skip


LIMITS = {"built": 12.0, "weekend": 0.35}  # N m, of the table of gains in measure.md


class Gains(ctypes.Structure):
    """``struct steady_gains``."""

    _fields_ = [(name, ctypes.c_float) for name in ("kp", "ki", "kd", "limit")]


class Steady(ctypes.Structure):
    """``struct steady``."""

    _fields_ = [
        ("angle", ctypes.c_double),
        ("error", ctypes.c_float),
        ("integral", ctypes.c_float),
        ("begun", ctypes.c_int),
    ]


@pytest.fixture(scope="module")
def steady_torque(tmp_path_factory):
    """Return the function of steady.h, compiled into a library."""
    folder = tmp_path_factory.mktemp("steady")
    arguments = "struct steady *s, struct steady_gains *g, float w, double a, float c, float t"
    source = f"""#include "steady.h"
float it({arguments});
float it({arguments})
{{ return steady_torque(s, g, w, a, c, t); }}
"""
    file = folder / "it.c"
    file.write_text(source)
    library = folder / "it.so"
    include = Path(__file__).parents[1] / "firmware"
    options = [*STRICT, "-I", include, "-shared", "-fPIC"]
    subprocess.run(["cc", *options, "-o", library, file, "-lm"], check=True)
    function = ctypes.CDLL(str(library)).it
    real = ctypes.c_float
    structures = ctypes.POINTER(Steady), ctypes.POINTER(Gains)
    function.restype = real
    function.argtypes = *structures, real, ctypes.c_double, real, real
    return function


def test_the_pid_in_c_is_the_one_in_python(steady_torque, rng):
    """Both compute the same torques for a crank whose speed varies. The ports have the gains of the
    robots.
    """
    for name, port in (("built", "ak80_6.c"), ("weekend", "weekend_esp32.c")):
        pid = gains_of(ROBOTS[name](), "steady")
        limit = LIMITS[name]
        text = (Path(__file__).parents[1] / "firmware" / port).read_text()
        written = re.search(r"GAINS = \{ (.*) \};", text)[1].replace("TORQUE_RANGE", "12.0f")
        written = [float(word.rstrip("f")) for word in written.split(", ")]
        assert written == [pid.kp, pid.ki, pid.kd, limit]
        gains = Gains(pid.kp, pid.ki, pid.kd, limit)
        state = Steady()
        speeds = 2.0 + 0.1 * rng.normal(size=400)
        angles = np.cumsum(PERIOD * speeds)
        integral = 0.0
        for k, (angle, speed) in enumerate(zip(angles.tolist(), speeds.tolist(), strict=True)):
            error = angles[0] + 2.0 * PERIOD * k - angle
            expected, integral = pid.torque(error, 2.0 - speed, integral, PERIOD, limit)
            torque = steady_torque(state, gains, 2.0, angle % math.tau, speed, PERIOD)
            assert torque == pytest.approx(float(expected), abs=1e-3 * limit)
        held = [steady_torque(state, gains, 2.0, angle, 0.0, PERIOD) for _ in range(500)]
        assert held[-1] == pytest.approx(limit)
        assert pid.kp * state.error < 1.5 * limit  # it does not wind up


def walk_steadily(library, steady_torque, speed, delay=0.005, sign=1.0):
    """Let the built robot walk as its port does, and return crank speeds, torques and firmware."""
    gains = Gains(10.0, 1.0, 1.0, 12.0)
    state = Steady()
    firmware = Firmware(library)
    speeds = []

    def controller(**readings):
        readings["crank_angle"] *= sign
        torque = firmware.step(**{**readings, "speed_command": 0.05})
        if firmware.fault == "fine":
            speeds.append(firmware.memory.crank_speed)
            torque = steady_torque(
                state, gains, speed, readings["crank_angle"], speeds[-1], readings["period"]
            )
            firmware.memory.action = torque / 12.0
        return torque

    _, torques = walk(controller, 0.1, 1, robot="built", delay=delay)
    return np.array(speeds), torques, firmware


def test_the_built_robot_walks_at_a_constant_crank_speed(library, steady_torque):
    """At 1 rad/s under the firmware's watch; a reversed encoder stops it.

    Torques that come a control period late make it unstable: the ports send them at once.
    """
    speeds, torques, firmware = walk_steadily(library, steady_torque, 1.0)
    assert firmware.fault == "fine" and len(speeds) > 480
    assert speeds[-314:].mean() == pytest.approx(1.0, abs=0.02)  # over a turn
    assert np.abs(torques).max() < 12.0
    speeds, torques, firmware = walk_steadily(library, steady_torque, 1.0, sign=-1.0)
    assert firmware.fault == "against torque" and len(speeds) < 100 and torques[-1] == 0.0
    prompt, late = (walk_steadily(library, steady_torque, 2.0, ms)[0].max() for ms in (0.0, 0.02))
    assert prompt < 6.0 and late > 10.0


ARM, RISC_V = ("arm-none-eabi-", "qemu-system-arm"), ("riscv64-unknown-elf-", "qemu-system-riscv32")
CORES = {
    "Cortex-M0+": (ARM, "microbit", "-mcpu=cortex-m0plus -mfloat-abi=soft", 2e6, 52_000),
    "Cortex-M4F": (ARM, "mps2-an386", "-mcpu=cortex-m4 -mfloat-abi=hard -mfpu=fpv4-sp-d16", 6e4,
                   41_000),
    "ESP32-C3": (RISC_V, "virt", "-march=rv32imac -mabi=ilp32 -mcmodel=medany", 2e6, 60_000),
}  # fmt: skip
"""Tools, QEMU's machine, compiler's flags, most instructions of a step, and most bytes of flash."""


@pytest.mark.slow
@pytest.mark.parametrize("core", CORES)
def test_it_runs_on_a_microcontroller(library, core, tmp_path):
    """It acts there as here, without a fault; prints what the page on firmware says of its size."""
    (prefix, qemu), machine, flags, most, flash = CORES[core]
    for tool in (f"{prefix}gcc", qemu):
        if shutil.which(tool) is None:
            pytest.skip(f"there is no {tool}")
    _, source = export(f"pretrained:{NAME}", ("firmware",), tmp_path, "mine", ID)
    here, arm = Path(__file__).parent, prefix == ARM[0]
    flash_at, ram_at = (0, 0x20000000) if arm else (0x80000000, 0x80100000)
    symbols = [f"-Wl,--defsym,FLASH={flash_at:#x}", f"-Wl,--defsym,RAM={ram_at:#x}"]
    library_flags = ["-mthumb", "--specs=nano.specs"] if arm else ["--specs=picolibc.specs"]
    build = [f"{prefix}gcc", *flags.split(), *library_flags, "-O2", "-ffunction-sections",
             "-std=gnu99", "-nostartfiles", "-Wl,--gc-sections", *symbols, "-T", here / "cortex.ld",
             "-I", tmp_path, here / "cortex.c", source, "-lm", "-o", tmp_path / "it"]  # fmt: skip
    subprocess.run(build, check=True)
    run_it = [qemu, "-M", machine, "-nographic", "-monitor", "none", "-serial", "none",
              "-semihosting-config", "enable=on,target=native", "-icount", "shift=0",
              *(() if arm else ("-bios", "none")), "-kernel", tmp_path / "it"]  # fmt: skip
    done = subprocess.run(run_it, capture_output=True, text=True, timeout=60)
    ticks, of_200_000, stack, fault, torque = map(int, (done.stdout + done.stderr).split())
    size = subprocess.run([f"{prefix}size", tmp_path / "it"], capture_output=True, text=True)
    text, data = map(int, size.stdout.splitlines()[1].split()[:2])
    instructions = 200_000 * ticks / of_200_000
    print(f"{core}: {instructions:.3g} instructions, flash {text + data} B, stack {stack} B")
    firmware = Firmware(library)
    for k in range(1, 101):
        expected = firmware.step(**{**STANDING, "crank_angle": 0.06 * k})
    assert FAULTS[fault] == "fine" and torque == pytest.approx(1e3 * abs(expected), abs=2)
    assert instructions < most and text + data < flash
