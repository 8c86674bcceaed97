"""Data of the walking page: engine, kernels, records, robots and policies."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import cache

import numpy as np

from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.engine import collision, integrator
from jansen_env.plants import batched_plant, grounds, robot_parameters
from jansen_env.plants.parameters import TABLE, Parameter, argument_values
from jansen_env.policies import pretrained
from jansen_env.policies.policy import PAPER_PID
from jansen_env.robot import ROBOTS, Leg, Payload, Robot, zoo
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.scoring import metrics
from jansen_env.tasks.walking import tuned, walker_env
from jansen_env.tasks.walking.presets import ROUGH
from jansen_env.terrain import Terrain
from jansen_env.terrain.ground import STEEPEST
from jansen_env.viewer import saved_walk
from jansen_env.viewer.web.bench import design_of
from jansen_env.viewer.web.engine_data import (
    Json,
    engine_layout,
    engine_module,
    packed,
    values_of,
)
from jansen_env.viewer.web.geometry import STYLE
from jansen_env.viewer.web.terrain_data import terrain_data
from jansen_env.world import push
from jansen_env.world.observations import Noise

MOST_TOES = 24
"""Largest number of toes of a robot on the page."""
ENVIRONMENTS = (
    "JansenWalkerBuilt-v0",
    "JansenWalker-v0",
    "JansenWalkerRough-v0",
    "JansenWalkerHardcore-v0",
)
EXACT = {"noise_level": 0.0}  # sensors are exact until the user adds noise
CONTROLLERS = ("hand", "constant speed", "pid")  # controllers that are not trained policies
MOST_SEED = 2**32 - 1
FEATURE = ("clip", "multiples")  # attributes that a feature of a policy may have


def check_page_robot(robot: Robot) -> Robot:
    """Check that the page has observations for a robot, and return the robot.

    Args:
        robot: Robot to check.

    Raises:
        ValueError: If the robot has more than :data:`MOST_TOES` toes.
    """
    if len(robot.toes) > MOST_TOES:
        raise ValueError(
            f"a robot on the page must have at most {MOST_TOES} toes, got {len(robot.toes)}"
        )
    return robot


def walk_data(robots: Mapping[str, Robot] | None = None) -> Json:
    """Return all data that the page needs, ready for JSON; ``machine.js`` documents them.

    Args:
        robots: Robots on the page, by name. None selects the built-in designs.
    """
    paper = ROBOTS["paper"]()
    designs = {name: make() for name, make in ROBOTS.items()} if robots is None else robots
    policies = dict(policy_data(env, name) for env in ENVIRONMENTS for name in page_policies(env))
    return {
        "engine": engine_module(),
        "layout": {
            **engine_data(),
            "tasks": {toes: task_data(_of_toes(toes)) for toes in range(1, MOST_TOES + 1)},
        },
        "robots": {name: {"name": name, **robot_to_json(each)} for name, each in designs.items()},
        "designs": {name: design_of(each) for name, each in designs.items()},
        "policies": policies,
        "controllers": [*CONTROLLERS, *policies],
        "control": {
            "topSpeed": walker_env.SPEED_COMMAND[1],
            "mostLag": tuned.MOST_LAG,
            "paper": {
                "gains": [PAPER_PID.kp, PAPER_PID.ki, PAPER_PID.kd],
                "mass": paper.links_mass,
                "height": zoo.standing_height(paper),
            },
            "baselines": {
                name: found for name, each in designs.items() if (found := _measured(each))
            },
        },
        "sliders": [
            {
                "name": row.name,
                "label": row.label or row.name.replace("_", " "),
                "unit": "" if row.unit == "1" else row.unit,
                "meaning": f"{row.meaning[0].upper()}{row.meaning[1:]}.",
                "low": row.slider[0],
                "high": row.slider[1],
            }
            for row in TABLE
            if row.slider is not None
        ],
        "walkFormat": saved_walk.FORMAT,
        "mostSeed": MOST_SEED,
        "leastDistance": metrics.MIN_DISTANCE,
        "steepest": STEEPEST,
        "terrain": terrain_data(),
    }


def _measured(robot: Robot) -> Json | None:
    """Return the tuned parameters of a robot's baselines, or None if its design has none."""
    pid, steady = (tuned.measured(name, robot) for name in ("pid", "steady"))
    return None if pid is None or steady is None else {**pid, "steady": steady["gains"]}


def controller_name(env_id: str, name: str) -> str:
    """Return the name that a policy of an environment has on the page.

    If several environments have a policy of the same name, only the policy of the first environment
    is shown without the name of its environment.

    Args:
        env_id: Id of the environment.
        name: Name of the policy in that environment.
    """
    preset = env_id.removeprefix("JansenWalker").removesuffix("-v0").lower() or "paper"
    if name == pretrained.DEFAULT:
        return f"{preset} policy"
    first = next(each for each in ENVIRONMENTS if name in pretrained.names(each))
    return f"{name} policy" if env_id == first else f"{preset} {name} policy"


def page_policies(env_id: str) -> list[str]:
    """Return the names of those policies that can run on the page.

    The page must provide all observations of a policy, and its robot must be a built-in design: the
    page has no robots with other numbers of legs.

    Args:
        env_id: Id of the environment that the policies belong to.
    """
    policies = {name: pretrained.load(env_id, name) for name in pretrained.names(env_id)}
    return [
        name
        for name, policy in policies.items()
        if policy.env_kwargs.get("observe", "all") == "all"
        and policy.env_kwargs.get("robot", "built") in ROBOTS
        and _page_observations().issuperset(policy.observed)
    ]


@cache
def _page_observations() -> frozenset[str]:
    """Return the names of all observations that the page provides."""
    return frozenset(task_data(_of_toes(MOST_TOES))["observed"])


def policy_data(env_id: str, name: str) -> tuple[str, Json]:
    """Return the name of a policy on the page, and its network, observations and fastest command.

    Args:
        env_id: Id of the environment that the policy belongs to.
        name: Name of the policy in that environment.
    """
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
        "mean": packed(mean, "<f8"),
        "deviation": packed(deviation, "<f8"),
        "layers": policy.network.layers.tolist(),
        "weights": packed(policy.network.weights, "<f4"),
        "limit": policy.limit if math.isfinite(policy.limit) else None,
        "squash": pretrained.SQUASH[policy.squash],
    }


def engine_data() -> Json:
    """Return the layout of the engine, and values of the simulation backend, world and task."""
    env = walker_env.JansenWalkerEnv(
        height_scan=ROUGH["height_scan"], terminate_when_fallen=False, push=push.Push(0.0)
    )
    task, ground, steps = env.task, Terrain.flat(), env.task.world.steps
    return {
        **engine_layout(),
        "style": STYLE,
        "flat": ground.points,
        "parameters": {row.name: _limits(row) for row in TABLE if row.slider is not None},
        "ground": {name: getattr(ground, name) for name in robot_parameters.ON_TERRAINS},
        "nominal": {row.name: row.nominal for row in TABLE} | EXACT,
        "period": env.control_dt,
        "gravity": [*task.world.plant.gravity, GRAVITY],
        "room": collision.MARGIN + grounds.FASTEST * env.control_dt,
        # The kernels do the whole step.
        "world": values_of(task.world.plant.engine_settings[0]) | {"fully_compiled": True},
        "delayed": task.world.records.torques.shape[1],
        "capacity": [0, batched_plant.PLANES_PER_PAD],
        "workSpace": _work_space(steps),
        "push": values_of(task.world.pushes.settings[0]),
        "settings": values_of(task.world.reward_settings[0]),
    }


def _limits(row: Parameter) -> Json:
    """Return the limits of a parameter, and the other parameters that change with it."""
    sets = argument_values(row.name, Payload()) if row.name == "payload" else {}
    return {
        "least": row.least,
        "most": row.most,
        "zeroWhere": row.zero_where,
        "onlyZero": robot_parameters.ONLY_ZERO[row.zero_where] if row.zero_where else "",
        "sets": {name: low for name, (low, _) in sets.items()},
    }


def _of_toes(count: int) -> Robot:
    """Return a robot with ``count`` toes."""
    robot = ROBOTS["paper"]()
    return replace(robot, legs=(Leg("fore"),) * count)


def task_data(robot: Robot) -> Json:
    """Return the columns of a robot's observation, and the noise of its sensors.

    Args:
        robot: Robot that is observed.
    """
    env = walker_env.JansenWalkerEnv(robot=robot, height_scan=ROUGH["height_scan"], noise=Noise())
    task, observing = env.task, env.task.world._observing
    # Observations that the kernels compute.
    filled = {each.name for each in task.world.observations} | {*task.COMPILED}
    return {
        "observed": [each.name if each.name in filled else "" for each in task.observed],
        "observing": {name: _array(values) for name, values in observing._asdict().items()},
    }


def _array(values: np.ndarray) -> Json:
    """Return the type, shape and values of an array; the values are None if all are zero."""
    # JSON has no infinity: the largest float represents a missing limit.
    listed = np.nan_to_num(values).ravel().tolist() if values.any() else None
    return {"type": values.dtype.str[1:], "shape": values.shape, "values": listed}


def _work_space(steps: int) -> list[Json]:
    """Return the type and shape of each array of a thread's memory, except the flags.

    A length in a shape is a pair: a constant, and its increase per contact pad.
    """
    capacities = (pads * batched_plant.PLANES_PER_PAD for pads in (0, 1))
    spaces = [integrator.work_space(each, pads, steps) for pads, each in enumerate(capacities)]
    told = list[Json]()
    for least, per_pad in zip(*(space[:-1] for space in spaces), strict=True):
        lengths = zip(least.shape, per_pad.shape, strict=True)
        shape = [(base, pad - base) for base, pad in lengths]
        kind = "PLANE" if least.dtype.names else least.dtype.str[1:]
        told.append({"type": kind, "shape": shape})
    return told
