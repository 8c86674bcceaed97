"""Model cards: what a policy that is taken along is for, how to run it, and what it is worth.

After Mitchell et al., "Model Cards for Model Reporting", FAT* 2019. The template is ``card.md.in``.
Texts of a policy's file stand as code, in which Markdown finds nothing to act on.
"""

from __future__ import annotations

import inspect
import json
import math
import shlex
from importlib.metadata import metadata
from typing import Any

import numpy as np

import jansen_env
from agents.export.c_source import footprint, render
from jansen_env.engine.walk_reward import FURTHEST_TARGET, LONGEST_MEAN, SHORTEST_MEAN
from jansen_env.policies.network import Normalized
from jansen_env.policies.pretrained import PretrainedPolicy, arguments_of, checksum
from jansen_env.robot.kinematics import advance_per_turn, toe_positions
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import INTERVALS, score_table
from jansen_env.scoring.rollout import make_env


def code(text: Any) -> str:
    """Return text of any source as code within a line, also of a table."""
    plain = "".join(c if c.isprintable() else "_" for c in " ".join(str(text).split()))
    return f"`{plain.replace('`', chr(39)).replace('|', '/') or ' '}`"


def block(text: str) -> str:
    """Return text of any source as a block of code: lines indented, of which none can end it."""
    lines = ["".join(c if c.isprintable() else "_" for c in line) for line in text.split("\n")]
    return "\n".join(f"    {line}" for line in lines)


def card(policy: PretrainedPolicy, files: dict[str, bytes], told: dict[str, Any]) -> str:
    """Return the model card in Markdown, with what :func:`agents.export.export` has told."""
    env: Any = make_env(policy.env_id, policy.env_kwargs).unwrapped
    documents = [inspect.cleandoc(kind.__doc__ or "") for kind in type(env).__mro__]
    benchmark, training = find_benchmark(policy.env_id), policy.description["training"]
    numbers = [float(f"{x:.4g}") for x in told["observation"].tolist()]
    commands = training.get("command")
    own = {
        "version": jansen_env.__version__,
        "summary": documents[0].split("\n")[0],
        "documented": [
            document.split("## Observation Space\n")[1].split("\n## ")[0].strip()
            for document in documents
            if "## Observation Space\n" in document
        ],
        "clips": [block.clip for block in policy.features if isinstance(block, Normalized)],
        "units": [policy.layers[0].weight.shape[1], *(len(a.bias) for a in policy.layers)],
        "numbers": numbers,
        "footprint": footprint(policy),
        "answer": f"{policy.predict(np.array(numbers, np.float32))[0][0]:.4f}",
        "files": [("file", "bytes", "SHA-256")]
        + [(code(file), len(data), code(checksum(data))) for file, data in files.items()],
        "observation": _observation(policy),
        "differences": [("computed by", "largest difference")]
        + [
            (what, "not compared here" if value is None else f"{value:.2g}")
            for what, value in told["differences"].items()
        ],
        "arguments": "\n".join(
            f"{name}: {value}"
            for name, value in {**arguments_of(policy.env_id), **policy.env_kwargs}.items()
            if value is not None
        ),
        "training": {"steps": None, **training}
        | {"command": commands if isinstance(commands, list) else ["(not recorded)"]},
        "versions": json.dumps(policy.description.get("versions")),
        "config": json.dumps(training["config"], indent=1),
        "intervals": INTERVALS,
        "scores": score_table(benchmark.metrics, told["scores"]),
        "evaluation": _evaluation(policy, told),
        "licence": " ".join(metadata("jansen-env").get_all("License-Expression") or ["unknown"]),
    }
    values = {**told, **facts(env), **own, "policy": policy, "benchmark": benchmark}
    env.close()
    return render("card.md.in", {"code": code, "block": block}, **values)


def facts(env: Any) -> dict[str, Any]:
    """Return facts on an unwrapped environment's robot and sensors for the card.

    walks: whether it is a walker. clockwise: whether a positive action turns the crank so.
    toes: of each one the side on which it walks and how far, in degrees, its crank pin is ahead of
    the first one's. path: m, what a quarter turn of the crank advances. noisy: whether sensors are.
    """
    advance = advance_per_turn(env.robot)
    walks = "lag" in [entry.name for entry in env.observed]
    sign, turn = math.copysign(1.0, advance), 2.0 * math.pi * np.arange(360) / 360
    ahead = [round(math.degrees(sign * leg.phase) % 360.0, 3) for leg in env.robot.legs]
    sides = ["-x" if x < 0.0 else "+x" for x in toe_positions(env.robot, turn)[..., 0].mean(axis=0)]
    toes = zip(sides, (ahead[leg] for leg, _ in env.robot.toes), strict=True)
    return {
        "walks": walks, "clockwise": walks and sign < 0.0, "path": abs(advance) / 4.0,
        "toes": [f"{side}, {angle:g} degrees" for side, angle in toes] if walks else [],
        "furthest": FURTHEST_TARGET, "shortest": SHORTEST_MEAN, "longest": LONGEST_MEAN,
        "noisy": env.spec.kwargs.get("noise", arguments_of(env.spec.id).get("noise")) is not None,
    }  # fmt: skip


def _observation(policy: PretrainedPolicy) -> list[tuple[Any, ...]]:
    """Return a row for each number: its place, name, unit and spread in training."""
    mean, deviation = (np.broadcast_to(each, len(policy.observed)) for each in policy.scale)
    rows = zip(policy.observed, policy.units, mean, deviation, strict=True)
    return [("place", "name", "unit", "in training, if normalized")] + [
        (i, code(name), code(unit), f"{m:.3g} +- {s:.3g}")
        for i, (name, unit, m, s) in enumerate(rows)
    ]


def _evaluation(policy: PretrainedPolicy, told: dict[str, Any]) -> str:
    """Return the command that scores alike."""
    words = ["jansen-env", "evaluate", "--env", policy.env_id]
    if policy.env_kwargs:
        words += ["--env-kwargs", json.dumps(policy.env_kwargs)]
    for name in (told["run"], *(name for name in told["scores"] if name != told["name"])):
        words += ["--policy", name]
    return shlex.join([*words, "--episodes", str(told["episodes"]), "--seed", str(told["seed"])])
