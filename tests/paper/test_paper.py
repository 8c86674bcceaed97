"""The paper reproduced: every claim's number, the tolerance it is held to, and why that one.

Numbers of walks come from chaotic motions: where one is held, the reason says how far it may move.
"""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jansen_env.commands import paper as command
from jansen_env.paper import claims, errata, fixed_model, free_walk, toes
from jansen_env.paper.results import FRICTIONS, LOADS, Results, compute
from jansen_env.robot import holy_numbers_robot, paper_robot

DOCS = Path(__file__).parents[2] / "docs" / "paper.md"
VERDICTS = {
    "leg_degrees_of_freedom": "holds",
    "system_degrees_of_freedom": "holds",
    "torque_is_periodic": "holds",
    "torque_level": "does not hold",
    "constant_torque": "holds with a condition",
    "toe_paths": "holds",
    "stable_walking": "holds with a condition",
    "toe_speeds": "holds with a condition",
    "no_walking_without_slip": "does not hold",
    "heave": "holds with a condition",
    "more_legs": "holds with a condition",
    "rotation": "holds with a condition",
    "translation": "holds with a condition",
}


@pytest.fixture(scope="module")
def results() -> Results:
    return compute()


@pytest.fixture(scope="module")
def judged(results) -> dict[str, claims.Claim]:
    return {claim.key: claim for claim in claims.check_claims(results)}


def test_documentation(judged, results):
    """The page has every claim, verdict and number."""
    text = DOCS.read_text()
    assert {key: claim.verdict for key, claim in judged.items()} == VERDICTS
    for table in (
        claims.claims_table([*judged.values()]),
        claims.levels_table(results.levels),
        claims.pid_table(results.pid_levels),
        claims.errata_table(errata.errata()),
    ):
        head, _, *rows = table.splitlines()
        assert all(f"\n{row}\n" in text for row in (head, *rows))


def test_projection_and_tables_agree(results):
    def rate(state, torque):
        projected = fixed_model.fixed_base_projection(paper_robot(), *state, torque)
        return np.array([state[1], projected.acceleration()[0]])

    def advance(angle, speed, torque):
        h, start = fixed_model.SAMPLING, np.array([angle, speed])
        k1 = rate(start, torque)
        k2 = rate(start + 0.5 * h * k1, torque)
        k3 = rate(start + 0.5 * h * k2, torque)
        k4 = rate(start + h * k3, torque)
        return tuple((start + h * (k1 + 2.0 * k2 + 2.0 * k3 + k4) / 6.0).tolist())

    dense = fixed_model.simulate_pid(advance)
    for name in ("angle", "speed", "torque"):
        assert np.abs(getattr(dense, name) - getattr(results.run, name)).max() <= 5e-9, name


def test_time_step_of_the_fixed_model(results):
    """A tenth of the step moves the angle by less than 1e-9 rad; ten times the step, by h^2."""
    for factor, most in ((0.1, 1e-9), (10.0, 5e-8)):
        step = factor * fixed_model.TIME_STEP
        other = fixed_model.simulate_pid(fixed_model.tables_advance(paper_robot(), step))
        assert np.abs(other.angle - results.run.angle).max() <= most


def test_torque_level(judged, results):
    """Mean torque x speed = mean friction loss, from the joints' rates: differences, so 1e-9."""
    numbers = judged["torque_level"].numbers
    assert numbers["mean"] == pytest.approx(1.562154, abs=1e-6)
    signs = {"reference turning the other way, r = pi - t": -1.0,
             "torque counted positive on the frame": -1.0,
             "tau in the h of one leg a side: two motors": 2.0,
             "two motors, positive on the frame": -2.0,
             "tau in the h of every leg: four motors": 4.0,
             "four motors, positive on the frame": -4.0}  # fmt: skip
    assert signs.keys() <= {level.name for level in results.levels} and len(results.levels) == 17
    # Of (13) as printed after 10 s, on theta_rf1: the frame's angle, a constant.
    turned = math.pi - paper_robot().frame_angle
    printed = 10.0 * (turned + 10.0) + 10.0 * turned + 0.5 * 10.0**2 + 1.0
    assert printed == pytest.approx(211.0, abs=0.05)
    for level in results.levels:
        if level.name.startswith("no C58"):
            assert level.mean == pytest.approx(level.loss - 0.0702, abs=1e-4)
        else:
            mean = level.mean * signs.get(level.name, 1.0)
            assert mean == pytest.approx(level.loss, abs=1e-9), level.name


def test_constant_torque(judged, results):
    """Ripple of the speed on a fixed base: 67 % to 8 %, slender links 41 %, to 1 % of the mean."""
    numbers = judged["constant_torque"].numbers
    assert numbers["mean"] == pytest.approx(1.0, abs=0.01)
    assert numbers["ripple"] == pytest.approx(0.203, abs=0.01)
    assert numbers["slowest"] == pytest.approx(0.67, abs=0.01)
    assert numbers["fastest"] == pytest.approx(0.076, abs=0.01)
    assert numbers["slender_ripple"] == pytest.approx(0.41, abs=0.01)
    assert 0.15 < numbers["walking_low"] < 0.3 and 0.3 < numbers["walking_high"] < 1.6
    assert any(ripple.fell for ripple in results.walking_ripples.values())


def test_toe_paths_are_mirror_images(judged):
    """The mirrored fore leg fulfils the back leg's constraints to rounding; itself it does not."""
    assert judged["toe_paths"].numbers["error"] < 1e-14
    robot = paper_robot()
    x = toes.coordinates(robot, "fore", 1.0)
    assert np.abs(toes.constraints(robot, "back", x)).max() > 0.01


def test_standing_toes_part(judged, results):
    numbers, support = judged["toe_speeds"].numbers, results.support
    assert np.sort(support.zeros()) == pytest.approx(0.5 * math.pi * np.arange(1, 5), abs=2e-3)
    assert numbers["slip_per_turn"] == pytest.approx(0.7087, abs=7e-4)
    assert numbers["slip_of_points"] == pytest.approx(0.664, abs=2e-3)
    point = toes.double_support(replace(paper_robot(), pad_radius=1e-9), samples=720)
    assert point.per_turn == pytest.approx(numbers["slip_of_points"], rel=5e-3)
    assert numbers["apart"] > 0.9
    # The paper's own argument, x speeds on a fixed base: 0 at the same four angles.
    assert numbers["mean_x_speed"] == pytest.approx(0.1056, abs=1e-3)
    assert numbers["smallest_x_speed"] < 5e-4  # half a crank angle's step off
    coarse = toes.double_support(paper_robot(), samples=720)
    assert coarse.per_turn == pytest.approx(support.per_turn, rel=3e-3)
    assert numbers["mean"] == pytest.approx(support.per_turn / (2.0 * math.pi), rel=1e-12)


def test_a_slow_walk_slips_as_its_geometry_says(results):
    """No dynamics against all of it: 2 % (a turn is not quite slow); half of it where toes grip."""
    certain = results.support.per_turn
    for mu, walk in results.slow.items():
        grips = mu > 0.58
        assert not walk.fell and walk.no_toe < 1e-3
        assert walk.slip == pytest.approx(
            0.5 * certain if grips else certain, rel=0.05 if grips else 0.02
        )
        assert walk.one_toe == pytest.approx(0.5 if grips else 0.045, abs=0.03 if grips else 0.01)
    assert set(results.slow) == set(FRICTIONS)


def test_sliding_on_two_toes_breaks_down_above_a_friction_of_0525():
    """With a quarter of the time step: all of the slip at 0.525, less at 0.55, as in the page."""
    certain = toes.double_support(paper_robot()).per_turn
    for mu, step, slides in ((0.525, 2.5e-4, True), (0.55, 2.5e-4, False), (0.55, 1e-3, True)):
        walk = free_walk.walk(paper_robot(), 0.25, turns=2, friction=mu, time_step=step)
        if slides:
            assert walk.slip == pytest.approx(certain, rel=0.02), (mu, step)
        else:
            assert walk.slip < 0.9 * certain, (mu, step)


def test_slip_of_a_rattling_walk_is_not_the_time_steps(results):
    """Friction 0.8, half the time step: the same slip within 4 % (a chaotic rattle, two turns)."""
    walk = free_walk.walk(paper_robot(), 0.25, turns=2, time_step=5e-4)
    assert walk.slip == pytest.approx(results.slow[0.8].slip, rel=0.04)


def test_slip_of_walks_at_constant_crank_speed(results):
    """Falls somewhere from 2 to 3.5 rad/s (chaotic: rounding says where); slides below, on one toe
    at a time above, slides again faster."""
    by_speed = {walk.speed: walk for walk in results.walks}
    assert any(by_speed[s].fell for s in (2.0, 2.5, 3.0, 3.5))
    assert not any(by_speed[s].fell for s in (0.5, 1.0, 1.5, 4.0, 5.0))
    assert all(by_speed[s].slip_per_metre > 0.3 for s in (0.5, 1.0, 1.5))
    assert all(by_speed[s].slip_per_metre < 0.02 for s in (3.5, 4.0, 5.0))
    assert by_speed[6.0].slip_per_metre > 0.05 and by_speed[8.0].no_toe > 0.1
    assert all(by_speed[s].one_toe > 0.99 for s in (3.5, 4.0, 5.0))
    assert by_speed[1.0].torque == pytest.approx(1.92, rel=0.05)


def test_a_walk_without_slip(results):
    """Twelve turns at 4 rad/s, more than 10 m, without a toe sliding by a micrometre a metre."""
    walk = results.no_slip
    assert not walk.fell and walk.turns == 12 and walk.turns * walk.distance > 10.0
    assert walk.slip_per_metre < 1e-6


def test_slip_of_a_walk_backwards():
    """Theo Jansen's own numbers walk 1.01 m a turn backwards and slip a tenth of it: chaotic."""
    walk = free_walk.walk(holy_numbers_robot(), 1.0, turns=3)
    assert not walk.fell and walk.distance == pytest.approx(-1.01, abs=0.05)
    assert walk.slip_per_metre == walk.slip / -walk.distance == pytest.approx(0.11, abs=0.05)
    assert math.isnan(replace(walk, distance=0.0).slip_per_metre)


def test_odd_numbers_of_phases_interleave(results):
    """Odd: both sides together heave less than half as much as one; even: nearly as much."""
    for phases, heave in zip(toes.PHASES[2:7], results.heaves[2:7], strict=True):
        share = heave.level / heave.one_side
        assert (share < 0.5) == (phases % 2 == 1), phases
    fore, back = toes.lowest_toes(paper_robot(4), toes.turn(720))
    assert back == pytest.approx(np.roll(fore[::-1], 1), abs=1e-12)  # even: the mirror in psi = 0
    fore, back = toes.lowest_toes(paper_robot(3), toes.turn(720))
    assert back == pytest.approx(
        np.roll(np.roll(fore[::-1], 1), 120), abs=1e-12
    )  # half a period on


def test_constraint_forces_are_the_projections(results):
    for k in (0, 400, 999):
        run = results.run
        p = fixed_model.fixed_base_projection(
            paper_robot(), run.angle[k], run.speed[k], run.torque[k]
        )
        expected = p.constraint_forces().reshape(4, 8, 3)[0]
        assert results.forces[k] == pytest.approx(expected, abs=1e-12)


def test_loads_of_the_walking_robot(judged, results):
    """Link 4 bears most at P, 48 N to 121 N by friction: smooth phases, so 3 %; 10 % when fast."""
    numbers = judged["translation"].numbers
    for mu, force in ((0.3, 47.8), (0.5, 50.8), (0.8, 120.5)):
        assert numbers[f"walking_1_{mu}"] == pytest.approx(force, rel=0.03)
        assert numbers[f"walking_3.5_{mu}"] == pytest.approx(105.0, rel=0.15)
    for at in LOADS:
        loads = results.walking_loads[at]
        assert loads.place == "link 4 at P" and loads.force.argmax() == 7
        assert loads.moment.argmax() == (7 if at == (1.0, 0.8) else 0), at
    assert judged["rotation"].numbers["others"] == 1


def test_loads_do_not_depend_on_the_time_step():
    """With half the time step the largest joint force of a walk is the same within 1 %."""
    peaks = []
    for step in (1e-3, 5e-4):
        forces = free_walk.walking_forces(paper_robot(), 1.0, turns=1, every=2, time_step=step)
        peaks.append(free_walk.largest_loads(forces).bearing.max())
    assert peaks[1] == pytest.approx(peaks[0], rel=0.01)


def test_command(results, monkeypatch, tmp_path, capsys):
    """Writes the claims and eleven figures, and says so; nothing is left half written."""
    monkeypatch.setattr(command, "compute", lambda: results)
    command.main(["--out", str(tmp_path / "new" / "folder")])
    verdicts = capsys.readouterr().out.splitlines()[: len(VERDICTS)]  # one a line
    assert all(line.startswith(v) for line, v in zip(verdicts, VERDICTS.values(), strict=True))
    assert max(map(len, verdicts)) <= 80
    command.main(["--out", str(tmp_path / "new" / "folder"), "--all"])
    printed = capsys.readouterr().out
    folder = tmp_path / "new" / "folder"
    data = json.loads((folder / "claims.json").read_text())
    assert [claim["key"] for claim in data["claims"]] == list(VERDICTS)
    assert all(claim["why"] in printed for claim in data["claims"])
    table = (folder / "claims.md").read_text()
    assert table.count("\n| ") == 4 + 13 + 4 + 17 + 3  # heads, claims, errata, interpretations
    assert [erratum["name"] for erratum in data["errata"]] == [e.name for e in errata.errata()]
    pictures = sorted(folder.glob("*.png"))
    assert len(pictures) == 11 and all(p.stat().st_size > 20_000 for p in pictures)
    assert {p.suffix for p in folder.iterdir()} == {".md", ".json", ".png"}
