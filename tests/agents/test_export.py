"""Policies taken along: ONNX and C that act as PyTorch does, and what is said of them."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from small_runs import NETWORKS, made_run

from agents import export, pack
from agents.export import c_source, model_card, onnx_model
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.robot import kinematics
from jansen_env.scoring.benchmarks import BENCHMARKS
from jansen_env.scoring.rollout import make_env
from jansen_env.viewer.web import geometry

STRICT = (
    "-std=c99", "-O1", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Wshadow",
    "-Wunused-macros", "-pedantic", "-Werror",
)  # fmt: skip
SINGLE = (*STRICT, "-DMINE_SINGLE_PRECISION")
WALKER, CRANK = "JansenWalker-v0", "JansenCrank-v0"
needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

RUNS = {
    "harmonics": ("ppo", {}, {"net_arch": [8, 8], "activation": "elu", "normalize": True,
                              "harmonics": 2}),
    "sac": ("sac", {}, {"net_arch": [8, 8], "activation": "relu", "normalize": True}),
}  # fmt: skip


def program(policy):
    """The sources of a policy with those of its example program."""
    return {**c_source.sources(policy, "mine"), "main.c": c_source.example(policy, "mine")}


def agree(policy, count, limit=1e-6, single=1e-5):
    """Whether all that can run a policy acts as PyTorch does in float64."""
    cases = export.make_cases(policy, count)
    expected = export.actions_of(pack.in_float64(pack.to_policy(policy)), cases)
    assert cases.shape == (count, len(policy.observed))
    assert np.ptp(expected) > 0.1 and np.abs(expected).min() < 0.99
    found = [export.actions_of(policy, cases)]
    if shutil.which("cc"):
        sources = program(policy)
        found.append(c_source.run(sources, "mine", cases, STRICT))
        rounded = c_source.run(sources, "mine", cases, SINGLE)
        assert np.abs(rounded - expected).max() < single
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(onnx_model.build(policy, "mine").SerializeToString())
    found.append(session.run(["action"], {"observation": cases})[0][:, 0])
    for actions in found:
        assert np.abs(actions - expected).max() < limit


@pytest.mark.parametrize("kind", [*RUNS])
def test_onnx_and_c_act_as_pytorch(kind, tmp_path):
    agree(pack.from_run(made_run(tmp_path / "run", *RUNS[kind], WALKER)), 300)


@pytest.mark.slow
@pytest.mark.parametrize("env_id", [*filter(pretrained.names, BENCHMARKS)])
def test_shipped_policies_act_as_pytorch(env_id):
    agree(pretrained.load(env_id), 10_000, single=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("network", NETWORKS)
def test_networks_act_as_pytorch(network, tmp_path):
    agree(pack.from_run(made_run(tmp_path / "run", *NETWORKS[network])), 10_000)


EVIL = '*/ int evil(void); /* \\\n #include "evil.h" ??/ `rm` \u2028 <b>|</b>'


@needs_cc
def test_no_text_of_a_file_becomes_code():
    """Of names, units and ids: comments do not end, nothing but letters is left of names."""
    policy = pretrained.load(CRANK)
    given = policy.description["observation"]
    described = {
        **policy.description,
        "observation": [{"name": row["name"] + EVIL, "unit": EVIL} for row in given],
    }
    evil = PretrainedPolicy(described, policy.tensors)
    evil.env_id = EVIL  # which no file gets through
    sources = c_source.sources(evil, "mine")
    for source in sources.values():
        assert source.isascii() and "evil.h" not in source.replace("_evil.h", "")
        code = re.sub(r"/\*.*?\*/", "", source, flags=re.S)
        assert "evil" not in code and "?" not in code.replace(" ? ", "")
        assert "`" not in source and "\\" not in source
    assert re.search(
        r"MINE_OBS_COS_CRANK_ANGLE_INT_EVIL_\w+ = 0, /\* _/ int evil", sources["mine.h"]
    )
    seen = np.ones((1, 5), np.float32)
    expected = policy.predict(seen)[0][:, 0]
    sources["main.c"] = c_source.example(evil, "mine")
    assert c_source.run(sources, "mine", seen, STRICT) == pytest.approx(expected, abs=1e-6)
    described["observation"][1] = described["observation"][0]
    with pytest.raises(ValueError, match="several observations would be"):
        c_source.sources(PretrainedPolicy(described, policy.tensors), "mine")
    for name in ("main", "math", "a-b", "1a", "a" * 64, "", "a\nb", "ä"):
        with pytest.raises(ValueError, match="must be letters, digits and _"):
            c_source.sources(policy, name)


def test_no_text_of_a_file_becomes_markdown():
    assert re.fullmatch("`[^`|\n]+`", model_card.code(EVIL)) and model_card.code("") == "` `"
    lines = model_card.block(f"a\n```\n# b\n\n<script>\n\r{EVIL}").split("\n")
    assert len(lines) == 7 and all(re.match("    [^\r\u2028]*$", line) for line in lines)


@needs_cc
def test_what_is_not_finite_is_refused_by_the_controller(tmp_path):
    policy = pack.from_run(made_run(tmp_path / "run", *NETWORKS["squashed"], WALKER))
    (tmp_path / "main.c").write_text("""
#include <math.h>
#include <stdio.h>
#include "mine.h"
int main(void)
{
    float seen[MINE_OBSERVATIONS] = {1.0f, 0.0f}, action = 9.0f;
    int wrong;
    mine_step(seen, &action);
    printf("%.9g ", (double)action);
    seen[2] = NAN;
    wrong = mine_step(seen, &action);
    printf("%d %.9g ", wrong, (double)action);
    seen[2] = 0.5f;
    mine_step(seen, &action);
    printf("%.9g %g %g", (double)action, (double)MINE_TORQUE_LIMIT, (double)MINE_CONTROL_PERIOD);
    return 0;
}
""")
    for file, source in c_source.sources(policy, "mine").items():
        (tmp_path / file).write_text(source)
    build = ["cc", *STRICT, "-o", "main", "main.c", "mine.c", "-lm"]
    subprocess.run(build, cwd=tmp_path, check=True)
    found = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True).stdout
    seen = np.zeros((2, len(policy.observed)))
    seen[:, 0], seen[1, 2] = 1.0, 0.5
    first, last = policy.predict(seen)[0][:, 0].tolist()
    numbers = [first, -1.0, 0.0, last, 20.0, 0.02]
    assert [float(word) for word in found.split()] == pytest.approx(numbers, abs=1e-6)
    assert len({*numbers}) == len(numbers)


@needs_cc
def test_arithmetic_that_does_not_know_nan_is_refused():
    cases = np.ones((1, 5), np.float32)
    with pytest.raises(ValueError, match="ffast-math leaves out the test"):
        c_source.run(program(pretrained.load(CRANK)), "mine", cases, (*STRICT, "-ffast-math"))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    pytest.importorskip("onnx")
    folder = tmp_path_factory.mktemp("exported")
    run = made_run(folder / "run", *NETWORKS["apart"], WALKER)
    to = [word for kind in export.KINDS for word in ("--to", kind)]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "CASES", 600)
        export.main([str(run), *to, "--out", str(folder), "--name", "mine", "--episodes", "2"])
    return run, folder


def test_everything_is_written_with_its_card(exported):
    run, folder = exported
    names = {"mine.onnx", "mine.h", "mine.c", "mine.md"}
    assert {path.name for path in folder.iterdir()} == names | {"run"}
    card = (folder / "mine.md").read_text(encoding="utf-8")
    for name in names - {"mine.md"}:
        data = (folder / name).read_bytes()
        assert f"{len(data)}" in card and pretrained.checksum(data) in card
    for name in pack.from_run(run).observed:
        assert f"`{name}`" in card
    for words in (
        "not tested on a machine", "python train.py --seed 0", "speed_command: (0.05, 0.8)",
        "20 N m", "0.02 s", "2 at each of the commands 0.05, 0.1,", "| pid", "| profile",
        f"--policy {run} --policy pid", "lag        <-", "MIT", "clips at 10 of them",
        "over 600 random observations", "max_episode_steps: 50", "-x, 180 degrees",
        "cosine of the crank angle (crank relative to chassis)",
    ):  # fmt: skip
        assert words in card, words


def test_the_examples_of_a_card_run(exported, tmp_path, capsys, monkeypatch):
    folder = exported[1]
    card = (folder / "mine.md").read_text(encoding="utf-8")
    expected = {float(number) for number in re.findall(r"prints (-?[\d.]+?)\.\n", card)}
    assert len(expected) == 1
    monkeypatch.chdir(folder)
    for source in re.findall(r"```python\n(.*?)```", card, re.S):
        if "onnxruntime" in source:
            pytest.importorskip("onnxruntime")
        exec(source, {})
        assert float(capsys.readouterr().out) in expected
    if shutil.which("cc") is None:
        pytest.skip("there is no C compiler")
    for name in ("mine.h", "mine.c"):
        shutil.copy(folder / name, tmp_path)
    (main,) = re.findall(r"```c\n(.*?)```", card, re.S)
    (tmp_path / "main.c").write_text(main)
    (commands,) = re.findall(r"```bash\n(.*?)```", card, re.S)
    found = subprocess.run(
        ["bash", "-e", "-c", commands], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert float(found.stdout) == pytest.approx(*expected, abs=1e-4)
    for given, said in (
        ("nan " * 20, "an observation is not finite"),
        ("1 " * 21, "an observation must have 20 numbers"),
        ("1 " * 20 + "two", "an observation must have 20 numbers"),
    ):
        again = subprocess.run([tmp_path / "main"], input=given, capture_output=True, text=True)
        assert again.returncode == 1 and again.stderr == f"{said}\n"


def test_an_onnx_model_says_what_it_takes(exported):
    onnx = pytest.importorskip("onnx")
    model = onnx.load(exported[1] / "mine.onnx")
    onnx.checker.check_model(model, full_check=True)
    told = {entry.key: entry.value for entry in model.metadata_props}
    observed = make_env(WALKER, {}).unwrapped.observed
    rows = [{"name": entry.name, "unit": entry.unit} for entry in observed]
    assert json.loads(told["observation"]) == rows
    assert told["env_id"] == WALKER
    assert (told["torque_limit"], told["control_dt"]) == ("20.0", "0.02")
    assert [value.name for value in model.graph.input] == ["observation"]
    assert [value.name for value in model.graph.output] == ["action", "torque"]
    assert str(Path(__file__).parents[2]).encode() not in model.SerializeToString()
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(exported[1] / "mine.onnx")
    for n in (1, 7):
        action, torque = session.run(None, {"observation": np.ones((n, len(rows)), np.float32)})
        assert torque == pytest.approx(20.0 * action) and action.shape == (n, 1)


def test_what_does_not_agree_is_not_written(exported, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(export, "CASES", 200)

    def refused(*words):
        with pytest.raises(SystemExit):
            export.main([*map(str, words), "--out", str(out), "--episodes", "1"])
        return capsys.readouterr().err

    assert "--env is JansenCrank-v0, but" in refused(exported[0], "--to", "c", "--env", CRANK)
    assert "no model at" in refused(tmp_path, "--to", "c")
    assert "policy is 'none', must be one of" in refused("pretrained:none", "--to", "c")
    assert "name is 'a b', must be letters" in refused("pretrained", "--to", "c", "--name", "a b")
    original, policy = c_source.sources, pretrained.load(CRANK)
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "which", lambda _: None)
        found = export.export("pretrained", ("c",), tmp_path, env_id=CRANK, episodes=1)
    assert found[1]["C in double"] is None and "not compared here" in found[0][-1].read_text()
    if shutil.which("cc"):
        wrong = {**policy.tensors, "action_net.weight": 1.01 * policy.tensors["action_net.weight"]}
        other = PretrainedPolicy(policy.description, wrong)
        monkeypatch.setattr(c_source, "sources", lambda _, name: original(other, name))
        message = refused("pretrained", "--to", "c", "--env", CRANK)
        assert "actions of C in double differ by" in message and "nothing was written" in message
    assert not out.exists()


@pytest.mark.parametrize("robot", ["paper", "holy"])
def test_angles_and_toes_are_where_a_card_says(robot):
    env = make_env(WALKER, {"robot": robot}).unwrapped
    told = model_card.facts(env)
    seen, _ = env.reset(seed=0, options={"crank_angle": 0.0, "speed_command": 0.3})
    sine, pins, pivots = 0.0, [], []
    for _ in range(8):
        state = geometry.state_of_frame(env.unwrapped.robot, env.unwrapped.frame())
        joints = np.array(state["joints"]) - [state["x"], state["y"]]
        pins.append(joints[:, kinematics.A])
        pivots.append(joints[:, kinematics.P, 0])
        seen, _, _, _, info = env.step(np.full(1, 0.4, np.float32))
        assert seen[1] > sine and seen[2] > 0.0
        sine = seen[1]
    assert pins[0][0] == pytest.approx([env.robot.crank.length, 0.0], abs=1e-9)
    assert told["path"] == pytest.approx(abs(kinematics.advance_per_turn(env.robot)) / 4.0)
    assert told["clockwise"] == (pins[-1][0, 1] < 0.0) == (info["crank_speed"] < 0.0)
    assert info["x_position"] > 0.0
    for toe in range(len(env.robot.legs)):
        side, angle = told["toes"][toe].split(", ")
        assert (side == "+x") == (pivots[0][toe] > 0.0)
        same = np.allclose(pins[0][toe], pins[0][0], atol=1e-9)
        assert (angle == "0 degrees") == same == (angle != "180 degrees")
