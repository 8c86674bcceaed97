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
from agents.export.c_source import render, width_of
from jansen_env.engine.walk_reward import FURTHEST_TARGET, LONGEST_MEAN, SHORTEST_MEAN
from jansen_env.policies.network import Normalized
from jansen_env.policies.pretrained import PretrainedPolicy, arguments_of, checksum
from jansen_env.robot.kinematics import advance_per_turn, toe_positions
from jansen_env.scoring.benchmarks import find_benchmark
from jansen_env.scoring.metrics import INTERVALS, score_table
from jansen_env.scoring.rollout import make_env


def code(text: object) -> str:
    """Return text of any source as code within a line, also of a table."""
    plain = "".join(c if c.isprintable() else "_" for c in " ".join(str(text).split()))
    return f"`{plain.replace('`', chr(39)).replace('|', '/') or ' '}`"


def block(text: str) -> str:
    """Return text of any source as a block of code: lines indented, of which none can end it."""
    lines = ["".join(c if c.isprintable() else "_" for c in line) for line in text.split("\n")]
    return "\n".join(f"    {line}" for line in lines)


def card(policy: PretrainedPolicy, files: dict[str, bytes], **given: Any) -> str:
    """Return the model card in Markdown; ``given`` is what :func:`agents.export.export` knows."""
    env: Any = make_env(policy.env_id, policy.env_kwargs).unwrapped
    documents = [inspect.cleandoc(kind.__doc__ or "") for kind in type(env).__mro__]
    training = {"steps": None, **policy.description["training"]}
    lines = training.get("command")
    numbers = [float(f"{x:.4g}") for x in given["seen"].tolist()]
    mean, deviation = (np.broadcast_to(each, len(policy.observed)) for each in policy.scale)
    arguments = {**arguments_of(policy.env_id), **policy.env_kwargs}
    evaluation = ["jansen-env", "evaluate", "--env", policy.env_id]
    if policy.env_kwargs:
        evaluation += ["--env-kwargs", json.dumps(policy.env_kwargs)]
    for name in given["scores"]:
        evaluation += ["--policy", given["run"] if name == given["name"] else name]
    evaluation += ["--episodes", str(given["episodes"]), "--seed", str(given["seed"])]
    benchmark = find_benchmark(policy.env_id)
    weights = sum(layer.weight.size + layer.bias.size for layer in policy.layers)
    given |= facts(env)
    given |= {
        "policy": policy, "benchmark": benchmark, "version": jansen_env.__version__,
        "summary": documents[0].split("\n")[0], "numbers": numbers, "training": training,
        "documented": [
            document.split("## Observation Space\n")[1].split("\n## ")[0].strip()
            for document in documents if "## Observation Space\n" in document
        ],
        "clips": [block.clip for block in policy.features if isinstance(block, Normalized)],
        "units": [policy.layers[0].weight.shape[1], *(len(a.bias) for a in policy.layers)],
        "answer": f"{policy.predict(np.array(numbers, np.float32))[0][0]:.4f}",
        "files": [(file, len(data), checksum(data)) for file, data in files.items()],
        "observation": list(zip(policy.observed, policy.units, mean, deviation, strict=True)),
        "arguments": "\n".join(f"{k}: {v}" for k, v in arguments.items() if v is not None),
        "command_lines": lines if isinstance(lines, list) else ["(not recorded)"],
        "flash": 4 * weights / 1000, "stack": 8 * (len(mean) + 2 * width_of(policy)) / 1000,
        "intervals": INTERVALS, "evaluation": shlex.join(evaluation),
        "table_of_scores": score_table(benchmark.metrics, given["scores"]),
        "licence": " ".join(metadata("jansen-env").get_all("License-Expression") or ["unknown"]),
        "versions": json.dumps(policy.description.get("versions")),
        "config": json.dumps(training["config"], indent=1),
    }  # fmt: skip
    env.close()
    return render("card.md.in", {"code": code, "block": block}, **given)


def facts(env: Any) -> dict[str, Any]:
    """Return facts on an unwrapped environment's robot and sensors for the card.

    walks: whether it is a walker. clockwise: whether a positive action turns the crank so.
    toes: of each the side on which it walks and how far, in degrees, its crank pin is ahead of
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
