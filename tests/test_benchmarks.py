"""The benchmarks: how walks and speeds are measured and judged, and what is written."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from benchmarks import (
    convergence,
    convergence_figures,
    plants,
    rounds,
    speed,
    speed_figures,
    speed_kernel,
    speed_ppo,
    speed_single,
)
from benchmarks.plant_tables import ALLOWED
from benchmarks.plant_walks import Comparison, Walk, Way, make, measure
from jansen_env import Terrain, paper_robot
from jansen_env.plants.projected import ProjectionPlant


def way(distance, cost=1.0, fell=False):
    """A walk's outcome."""
    return Way(distance, cost, 5.0, 0.03, 0.1, 1e-5, fell)


def test_verdicts():
    """Agree within 5 % in distance and cost; chaotic if the projection plant itself is."""

    def verdict(ensemble, rigid, others=()):
        return Comparison(Walk(1.0), ensemble, list(others), rigid).verdict(ALLOWED)

    steady, wild = [way(1.0), way(1.01), way(1.02)], [way(1.0), way(1.2), way(1.5)]
    assert verdict(steady, [way(9.0), way(1.05)]) == "agree"
    assert verdict(steady, [way(1.0), way(1.1)]) == "differ"
    assert verdict(steady, [way(1.0), way(1.0, cost=1.1)]) == "differ"
    assert verdict(steady, [way(1.0), way(1.1)], [way(1.6), way(1.12)]) == "other gait"
    assert verdict(steady, [way(1.0), way(1.1)], [way(1.12, cost=2.0)]) == "differ"
    assert verdict(wild, [way(1.0), way(2.0)]) == verdict(wild, [way(1.2)]) == "chaotic"
    assert verdict(steady, [way(1.0), way(1.0, fell=True)]) == "falls at times"
    assert verdict([way(1.0, fell=True)] * 3, [way(1.0, fell=True)] * 2) == "falls on both"
    assert Comparison(Walk(1.0), [way(1.0, fell=True)], [], []).spread == math.inf


def test_a_walk_is_measured():
    """At 4 rad/s on friction 0.3: the motor's power is about torque times speed, 10 %."""
    walk = Walk(4.0, friction=0.3, duration=4.0)
    plant = make(walk, "projection")
    out = measure(walk, plant)
    assert not out.fell and out.joint_gap == 0.0 and 0.4 < out.distance / 4.0 < 0.7
    power = out.cost_of_transport * paper_robot().mass * 9.81 * out.distance / 4.0
    assert power == pytest.approx(out.rms_torque * 4.0, rel=0.1)
    assert make(walk, "rigid_body", 1).time_step == make(walk, "rigid_body").time_step / 2.0
    uphill = make(Walk(1.0, slope=0.1, payload=2.0), "projection")
    assert uphill.robot.payload.mass == 2.0 and uphill.terrain.height(1.0) == pytest.approx(
        math.tan(0.1)
    )


@pytest.mark.slow
def test_report(tmp_path, capsys):
    """The short form: both plants agree, and tables and pictures are written."""
    plants.main(["--quick", "--out", str(tmp_path)])
    assert "agree: 2" in capsys.readouterr().out
    result = json.loads((tmp_path / "plants.json").read_text())
    assert all(row["difference"] < 3e-3 * row["of"] for row in result["fixed"])
    for picture in ("walks.png", "torque.png"):
        assert (tmp_path / picture).stat().st_size > 10_000
    with pytest.raises(SystemExit):
        plants.main(["--jobs", "0"])


def timed(middle, key="steps_per_second", **more):
    """A made-up measurement, two rounds around its median."""
    return {key: middle, "rounds": [0.9 * middle, 1.1 * middle], **more}


def invented():
    """A result of all parts of the speed measurement."""
    env = dict(resets_per_round=1, step_duration=0.02, simulated_seconds_per_second=100.0)
    ours, box2d, mujoco = speed_single.OURS, speed_single.BOX2D, speed_single.MUJOCO
    flat, rough = speed_single.FLAT, speed_single.ROUGH
    names = (flat, rough, mujoco, box2d)
    ratios = {"ratio": 3.0, "range": [2.9, 3.1], "simulated_ratio": 5.0}
    trained = dict(
        vector_environment="VecEnv", environment_share=0.08, environment_shares=[0.07, 0.09]
    )
    sweep = [timed(1e-5 * n, "seconds", count=n, toes_down=2.0, distance=1.0) for n in (4, 24)]
    parts = {
        "single": {
            "steps_per_round": 10,
            "environments": {name: timed(5000.0, **env) for name in names},
            "ratios": {name: {mujoco: ratios, box2d: ratios} for name in (flat, rough)},
        },
        "kernel": {
            "time_step": timed(8e-7, "seconds", around=1e-5, crank_angle=0.0),
            "legs": sweep,
            "segments": sweep,
        },
        "batch": {
            "vector_environment": "VectorEnv",
            "compared": 4,
            "batches": [timed(1000.0 * n, count=n) for n in (1, 4)],
            "rough": timed(3000.0),
            "peers": [
                timed(300.0, name=mujoco, threads=1, count=1, ratio=13.0, range=[12.0, 14.0]),
                timed(1e3, name="envpool 1", threads=1, count=4, ratio=4.0, range=[3.9, 4.1]),
                timed(2e3, name="envpool 2", threads=2, count=4, ratio=2.0, range=[1.9, 2.1]),
            ],
            "memory": [{"count": 4, "bytes": 2048.0}],
        },
        "ppo": {
            "environments": 64,
            "setting": {"n_steps": 64},
            "trained": {ours: timed(4000.0, **trained), mujoco: timed(2000.0, **trained)},
            "ratio": 2.0,
            "range": [1.9, 2.1],
        },
        "startup": {
            "seconds": {
                "import": {"import": 0.3},
                "first": {"make": 1.0, "reset and step": 40.0},
                "later": {"make": 0.4, "reset and step": 0.7},
            },
            "said": "compiles",
        },
    }
    machine = {"cpu": "some", "cores": 2, "load_average": 0.1, "versions": {"numpy": "2"}}
    return {"machine": machine, "rounds": 2, "quick": True, "parts": parts}


def test_contestants_take_turns():
    """A warm-up that does not count, then the order turns every round."""
    called = []
    plays = {name: lambda name=name: called.append(name) or len(called) for name in "ab"}
    assert rounds.take_turns(plays, 2) == {"a": [3, 6], "b": [4, 5]}
    assert called == list("ababba")
    assert rounds.ratio([2.0, 4.0, 6.0], [1.0, 2.0, 1.0]) == {"ratio": 4.0, "range": [2.0, 6.0]}


def test_goals():
    """At least and at most include the limit, above does not."""
    met = [rounds.Goal("x", 1.0, bound, 1.0).met for bound in ("at least", "at most", "above")]
    assert met == [True, True, False]
    assert not rounds.Goal("x", math.nan, "at least", 1.0).met


def test_what_is_missing_is_said():
    """Modules that are not there, and the command that brings them."""
    assert rounds.missing(["json"]) == ""
    said = rounds.missing(["json", "no_such_module"])
    assert "no_such_module" in said and "json" not in said and "pip install" in said


@pytest.mark.parametrize(
    "arguments", (["--rounds", "4"], ["--quick", "--rounds", "0"], ["--only", "x"], ["--out", "F"])
)
def test_speed_refuses(arguments, tmp_path, capsys):
    """Too few rounds, an unknown part, a file for a folder."""
    (tmp_path / "F").touch()
    with pytest.raises(SystemExit):
        speed.main([str(tmp_path / "F") if a == "F" else a for a in arguments])
    assert arguments[-1] in capsys.readouterr().err


def test_speed_is_written_down(tmp_path):
    """Tables of all parts, the goals met and missed, a panel or two for each part."""
    result = invented()
    text = speed.report(result)
    assert all(f"## {part.title}" in text for part in speed.PARTS.values())
    goals = {goal.what: goal.met for goal in speed.goals(result)}
    assert len(goals) == 11
    assert goals["steps/s over Walker2d-v5's"] and not goals["simulated s/s over Walker2d-v5's"]
    assert not goals["4 robots, steps/s over envpool Walker2d-v5, 2 threads"]  # on all cores
    json.dumps(result)
    assert len(speed_figures.panels(result["parts"])) == 6
    speed_figures.draw(result, tmp_path / "speed.png")
    assert (tmp_path / "speed.png").stat().st_size > 10_000
    speed_figures.draw({"parts": {"startup": result["parts"]["startup"]}}, tmp_path / "none.png")
    assert not (tmp_path / "none.png").exists()


def test_rough_ground():
    """As many segments as asked for, around x = 0, as steep whatever their length."""
    for segments, spacing in ((5, 1.0), (100, 0.2), (1000, 0.1)):
        ground = speed_single.rough_ground(segments, spacing, friction=0.3)
        assert len(ground.points) == segments + 1 and ground.friction == 0.3
        assert abs(ground.points[0][0] + ground.points[-1][0]) < 2.0 * spacing
        assert np.abs(np.diff(np.array(ground.points)[:, 1])).max() <= 0.2 * spacing
    with pytest.raises(ValueError, match="segments is 4"):
        speed_single.rough_ground(4)


def test_single_environments_are_measured():
    """A tiny real run beside the peers."""
    pytest.importorskip("mujoco")
    pytest.importorskip("Box2D")
    result = speed_single.measure(1, True)
    durations = [env["step_duration"] for env in result["environments"].values()]
    assert durations == pytest.approx([0.02, 0.02, 0.008, 0.02])
    ratio = result["ratios"][speed_single.FLAT][speed_single.MUJOCO]
    assert ratio["simulated_ratio"] == pytest.approx(2.5 * ratio["ratio"])
    json.dumps(result)


def test_kernel_is_measured():
    """Two toes down at rest; a replayed walk is the same walk."""
    standing = speed_kernel.Standing()
    standing.plant.state = standing.state
    assert (standing.plant.step(0.0, 0.1).contact_force[:, 1] > 0.0).sum() == 2
    assert all(seconds > 0.0 for seconds in standing.play())
    walk = speed_kernel.Replay(ProjectionPlant(paper_robot(), Terrain.flat()), duration=0.4)
    end = walk.plant.state
    assert walk.play() > 0.0 and (walk.plant.state == end).all() and walk.distance == end[0]
    assert not walk.fell and len(walk.torques) == 20
    uphill = ProjectionPlant(paper_robot(), Terrain.slope(0.7))
    fallen = speed_kernel.Replay(uphill, duration=10.0)
    assert fallen.fell and len(fallen.torques) < 500


def test_training_is_timed():
    """The environments' share of the time is part of it."""
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.env_util import make_vec_env

    trainee = speed_ppo.Trainee(make_vec_env("CartPole-v1", 2), speed_ppo.QUICK_SETTING)
    rate, share = trainee.play()
    assert rate > 0.0 and 0.0 < share < 1.0
    assert trainee.model.num_timesteps == trainee.steps == 80
    trainee.play()
    assert trainee.model.num_timesteps == 160


def test_penetration():
    """How deep the deepest toe is; negative above the ground."""
    plant = convergence.Setting(0.8).plant()
    plant.reset()
    state = plant.state
    assert convergence.penetration(plant) == pytest.approx(0.0, abs=1e-8)
    for depth in (1e-3, -1e-3, 0.03):  # the last beyond the pad's centre
        state[1] -= depth
        plant.state = state
        assert convergence.penetration(plant) == pytest.approx(depth, abs=1e-8)
        state[1] += depth


def test_walks_are_compared(tmp_path):
    """Errors and changes of made-up walks, start by start; tables and pictures of them."""
    reference = np.array([[1.0, 2.0, 0.5, 10.0, 1e-6, 1e-4, 0.0]] * 3)
    found = reference.copy()
    found[:, 0] += (0.001, 0.002, -0.003)
    found[:, 1] *= 1.1
    row = convergence.compare(1e-3, found, reference)
    assert row["error"]["median"] == pytest.approx(0.002)
    assert row["changes"]["distance"]["mean"] == pytest.approx(0.1)
    assert row["changes"]["slip"] == {"mean": 0.0, "standard_error": 0.0}
    rows = [convergence.compare(value, found, reference) for value in (1e-3, 2e-3)]
    study = dict(default=1e-3, cost={"0.001": 1e-4, "0.002": 8e-5}, grounds={"a": rows, "b": rows})
    own = {"a": 1e-3, "b": 1e-3}
    result = {
        "machine": {"cpu": "some"},
        "starts": 3,
        "duration": 1.0,
        "studies": [
            dict(study, what="time_step", finest=1e-4),
            dict(study, what="detection_interval", finest=1e-3, time_step_error=own),
        ],
    }
    text = convergence.report(json.loads(json.dumps(result)))
    assert "## Time step: 1 ms" in text and "+10.00 ± 0.00" in text
    convergence_figures.draw(result, tmp_path)
    for picture in ("time_step.png", "detection_interval.png"):
        assert (tmp_path / picture).stat().st_size > 10_000


def test_convergence_refuses(tmp_path):
    """No processes, a file for a folder."""
    (tmp_path / "F").touch()
    for arguments in (["--jobs", "0"], ["--out", str(tmp_path / "F")]):
        with pytest.raises(SystemExit):
            convergence.main(arguments)


def test_a_finer_time_step_is_nearer():
    """The audit and the depth of landings shrink with the time step: half a second, two starts."""
    coarse, fine = (
        [convergence.walk(convergence.Setting(0.3, time_step=h), n, 2, 0.5) for n in range(2)]
        for h in (4e-3, 5e-4)
    )
    assert sum(w.audit for w in fine) < 0.2 * sum(w.audit for w in coarse)
    assert max(w.penetration for w in fine) < max(w.penetration for w in coarse)
