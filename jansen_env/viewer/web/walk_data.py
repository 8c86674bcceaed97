"""Data of the walking page: engine, kernels, records, robots and policies."""

import base64
import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, fields, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jansen_env import gravity
from jansen_env.baselines.policy import PAPER_PID
from jansen_env.dynamics import reduced
from jansen_env.engine import (
    collision,
    integrator,
    kernel,
    link_shapes,
    machines,
    pcg64,
    pushes,
    records,
    reduction,
    walk_reward,
)
from jansen_env.parameters import TABLE, nominal
from jansen_env.plants import base, batch, design_tables, grounds, robot_parameters
from jansen_env.policies import pretrained
from jansen_env.robot import (
    ROBOTS,
    Bar,
    Compliance,
    Leg,
    Payload,
    Plate,
    Robot,
    Triangle,
    buildable,
    kinematics,
    zoo,
)
from jansen_env.robot.designs import built_parts_of, is_of_built_parts
from jansen_env.robot.motor import Motor
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.tasks.walking import tuned, walker_env
from jansen_env.tasks.walking.presets import ROUGH
from jansen_env.terrain import Terrain
from jansen_env.viewer.web.bench import design_of
from jansen_env.viewer.web.terrain_data import terrain_data
from jansen_env.world import push, world
from jansen_env.world.observations import Noise

Json = dict[str, Any]
RECORDS = {
    "ROBOT": records.ROBOT, "STATISTICS": records.CONTACT_STATISTICS, "PAD": records.PAD,
    "WORLD": records.WORLD, "PLANE": records.PLANE, "MACHINE": records.MACHINE,
    "LINK": link_shapes.LINK, "BUILD": link_shapes.BUILD, "CHASSIS": machines.CHASSIS,
    "WALK": walk_reward.ROW, "SETTINGS": walk_reward.SETTINGS, "PUSHES": pushes.PUSHES,
}  # fmt: skip
NUMBERS = {
    reduction: "SAMPLES HARMONICS INTERVALS ORDER BEARING_SAMPLES BODY_SUMS PAD_FUNCTIONS",
    reduced: "TAIL_TOLERANCE WORK_ARRAYS",
    kinematics: "TURN_SAMPLES",
    zoo: "HEIGHT_SAMPLES",
    design_tables: "PITCHES",
    collision: "SPECULATIVE_MARGIN LARGEST_MARGIN MARGIN WAY_OUT",
    grounds: "FASTEST STRETCH MOST_STRETCHES",
    batch: "TIME_STEP PLANES_PER_PAD",
    base: "DEEPEST",
    gravity: "GRAVITY",
    push: "MOST_PUSHES",
    walker_env: "FASTEST_COMMAND",
    world: "TOUCHING SLIPPING",
}
OF_PAGES = (pcg64,)
"""Modules of the engine that pages alone call: their kernels are there once they are imported."""
MOST_TOES = 24
"""Largest number of toes of a robot on the page."""
ENVIRONMENTS = (
    "JansenWalkerBuilt-v0", "JansenWalker-v0", "JansenWalkerRough-v0", "JansenWalkerHardcore-v0",
)  # fmt: skip
SENSORS = "speeds", "angles", "deviation", "low", "high"  # of Observing
CONTROLLERS = ("hand", "constant speed", "pid")  # those that are no policies
SLIDER = ("name", "label", "unit", "low", "high")
SLIDERS = (
    ("friction", "friction", "", 0.0, 1.2), ("payload", "payload", "kg", 0.0, 6.0),
    ("restitution", "restitution", "", 0.0, 0.9), ("tilt", "slope", "rad", -0.25, 0.25),
    ("motor_strength", "motor strength", "", 0.1, 1.5),
    ("gravity_scale", "gravity", "g", 0.1, 2.0), ("noise_level", "sensor noise", "", 0.0, 3.0),
)  # fmt: skip
"""Parameters that a user can change while a robot walks."""
PARTS = (Bar, Triangle, Plate, Payload, Motor, Compliance)
"""Parts of robot files whose numbers kernels read under their names."""
FEATURE = ("clip", "multiples")  # of a policy's features, where they have it


def check_page_robot(robot: Robot) -> Robot:
    """Return a robot after checking that the page has observations for it.

    Raises:
        ValueError: If it has too many toes.
    """
    if len(robot.toes) > MOST_TOES:
        raise ValueError(
            f"a robot on the page must have at most {MOST_TOES} toes, got {len(robot.toes)}"
        )
    return robot


def walk_data(robots: Mapping[str, Robot] | None = None) -> Json:
    """Return all that a page needs, for JSON: ``machine.js`` says what is what.

    Args:
        robots: Robots of the page by name; None for the built-in designs.
    """
    paper = ROBOTS["paper"]()
    designs = {name: make() for name, make in ROBOTS.items()} if robots is None else robots
    policies = dict(policy_data(env, name) for env in ENVIRONMENTS for name in page_policies(env))
    baselines = json.loads(tuned.DATA.read_text(encoding="utf-8"))
    module = kernel.built_library("wasm").read_bytes()
    return {
        "engine": _packed(np.frombuffer(module, np.uint8), "u1"),
        "layout": {
            **engine_data(),
            "tasks": {toes: task_data(_of_toes(toes)) for toes in range(1, MOST_TOES + 1)},
        },
        "robots": {name: {"name": name, **robot_to_json(each)} for name, each in designs.items()},
        "designs": {name: design_of(each) for name, each in designs.items()},
        "built": {
            name: built_parts_of(each).tolist()
            for name, each in designs.items()
            if is_of_built_parts(each)
        },
        "policies": policies,
        "controllers": [*CONTROLLERS, *policies],
        "control": {
            "topSpeed": walker_env.SPEED_COMMAND[1],
            "shortestTurn": tuned.SHORTEST_TURN,
            "mostLag": tuned.MOST_LAG,
            "paper": {
                "gains": [PAPER_PID.kp, PAPER_PID.ki, PAPER_PID.kd],
                "mass": paper.links_mass,
                "height": zoo.standing_height(paper),
            },
            "baselines": {
                name: {**of_design["pid"], "steady": of_design["steady"]["gains"]}
                for name, of_design in baselines.items()
            },
        },
        "sliders": [dict(zip(SLIDER, values, strict=True)) for values in SLIDERS],
        "terrain": terrain_data(),
    }


def controller_name(env_id: str, name: str) -> str:
    """Return the name that a policy of an environment has on the page.

    Where several environments have a policy of a name, the first one's is called by it alone.
    """
    preset = env_id.removeprefix("JansenWalker").removesuffix("-v0").lower() or "paper"
    if name == pretrained.DEFAULT:
        return f"{preset} policy"
    first = next(each for each in ENVIRONMENTS if name in pretrained.names(each))
    return f"{name} policy" if env_id == first else f"{preset} {name} policy"


def page_policies(env_id: str) -> list[str]:
    """Return the names of an environment's policies whose observations the page has."""
    names = pretrained.names(env_id)
    known = [pretrained.load(env_id, name).env_kwargs.get("observe", "all") for name in names]
    return [name for name, observe in zip(names, known, strict=True) if observe == "all"]


def policy_data(env_id: str, name: str) -> tuple[str, Json]:
    """Return a policy's name on the page, and its network, observations and fastest command."""
    policy = pretrained.load(env_id, name)
    arguments = {**pretrained.arguments_of(env_id), **policy.env_kwargs}
    mean, deviation = policy.scale
    return controller_name(env_id, name), {
        "robot": arguments["robot"],
        "fastest": float(np.max(np.abs(arguments["speed_command"]))),
        "observed": policy.observed,
        "features": [
            {name: getattr(part, name) for name in FEATURE if hasattr(part, name)}
            for part in policy.features
        ],
        "mean": _packed(mean, "<f8"),
        "deviation": _packed(deviation, "<f8"),
        "layers": policy.network.layers.tolist(),
        "weights": _packed(policy.network.weights, "<f4"),
        "limit": policy.limit if math.isfinite(policy.limit) else None,
        "squash": pretrained.SQUASH[policy.squash],
    }


def engine_data() -> Json:
    """Return arguments of the kernels, layouts of records, and numbers of plant, world and task."""
    env = walker_env.JansenWalkerEnv(
        height_scan=ROUGH["height_scan"], terminate_when_fallen=False, push=push.Push(0.0)
    )
    task, ground, steps = env.task, Terrain.flat(), env.task.world.steps
    return {
        "kernels": {each.symbol: _arguments(each) for each in kernel.kernels},
        "records": {name: _layout(dtype) for name, dtype in RECORDS.items()},
        "numbers": {n: getattr(part, n) for part, names in NUMBERS.items() for n in names.split()},
        "expansion": _packed(reduced._expansion(), "<f8"),
        "links": link_shapes.KINDS,
        "jointsOf": {"Bar": 2, "Triangle": 3},
        "parts": {kind.__name__: _defaults(kind) for kind in PARTS},
        "build": _values(buildable.build_row()[0]),
        "flat": ground.points,
        "limits": {
            p.name: [p.least, p.most]
            for p in TABLE
            if p.settable and (p.of_robot or p.name == "noise_level")
        },
        "ground": {name: getattr(ground, name) for name in robot_parameters.ON_TERRAINS},
        "nominal": _values(nominal(env.robot, ground)),
        "period": env.control_dt,
        "steps": steps,
        "stride": max(1, round(batch.DETECTION_INTERVAL / batch.TIME_STEP)),
        "workSpace": _work_space(steps),
        "push": _values(task.world._push[0]),
        "settings": _values(task.world.weights[0]),
        "scan": task.world.scan.tolist(),
    }


def _defaults(kind: type) -> Json:
    """Return the numbers of a part of a robot file that may be left out; None is infinite."""
    return {
        field.name: 0.0 if field.default is MISSING else _finite(field.default)
        for field in fields(kind)
        if field.name != "points"
    }


def _of_toes(count: int) -> Robot:
    """Return a robot with so many toes."""
    robot = ROBOTS["paper"]()
    return replace(robot, legs=(Leg("fore"),) * count)


def task_data(robot: Robot) -> Json:
    """Return the columns of a robot's observation, and its sensors' noise."""
    env = walker_env.JansenWalkerEnv(robot=robot, height_scan=ROUGH["height_scan"], noise=Noise())
    task, observing = env.task, env.task.world._observing
    return {
        "observed": [each.name for each in task.observed],
        "columns": observing.columns.tolist(),
        "taskColumns": observing.task_columns.tolist(),
        "onboardColumns": observing.onboard_columns.tolist(),
        # Of what has no limits the largest number stands for infinity.
        **{name: np.nan_to_num(getattr(observing, name)).tolist() for name in SENSORS},
    }


def _work_space(steps: int) -> list[Json]:
    """Return type and shape of each array of a thread's memory but the flags.

    A length is a number, and what it grows by per contact plane and per pad.
    """
    spaces = [integrator.work_space(*counts, steps) for counts in ((0, 0), (1, 0), (0, 1))]
    told = list[Json]()
    for least, per_plane, per_pad in zip(*(space[:-1] for space in spaces), strict=True):
        lengths = zip(least.shape, per_plane.shape, per_pad.shape, strict=True)
        shape = [(base, plane - base, pad - base) for base, plane, pad in lengths]
        kind = "PLANE" if least.dtype.names else least.dtype.str[1:]
        told.append({"type": kind, "shape": shape})
    return told


def _packed(values: ArrayLike, dtype: str) -> str:
    """Return numbers as base64."""
    return base64.b64encode(np.ascontiguousarray(values, dtype).tobytes()).decode()


def _finite(value: Any) -> Any:
    """Return a value, None for infinity."""
    return None if value is None or value == math.inf else value


def _values(row: np.void) -> Json:
    return dict(zip(row.dtype.names or (), row.item(), strict=True))


def _arguments(made: kernel.Kernel) -> list[tuple[str, str, int, bool]]:
    """Return name, type and number of axes of each argument, and whether its rows lie apart."""
    named: dict[Any, str] = {dtype: name for name, dtype in RECORDS.items()}
    return [
        (p.name, named.get(p.dtype) or p.dtype.str[1:], p.ndim, p.apart) for p in made.parameters
    ]


def _layout(dtype: np.dtype[Any]) -> Json:
    """Return the size of a record, and offset, type and length of each field."""
    fields = {name: _field(*place[:2]) for name, place in (dtype.fields or {}).items()}
    return {"size": dtype.itemsize, "fields": fields}


def _field(dtype: np.dtype[Any], offset: int) -> tuple[int, str | Json, int]:
    kind, shape = dtype.subdtype or (dtype, ())
    return offset, _layout(kind) if kind.names else kind.str[1:], math.prod(shape)
