"""Policies taken along: ONNX and C that act as the policy does."""

import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from small_runs import NETWORKS, made_run

from agents import export, pack
from agents.export import c_source, onnx_model
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.scoring.benchmarks import BENCHMARKS
from jansen_env.scoring.rollout import make_env

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


def agree(policy, count, limit=1e-6, single=1e-5):
    """Check that C, in double and float, and onnxruntime act as the policy and as PyTorch."""
    cases = export.make_cases(policy, count)
    model = pack.in_float64(pack.to_sb3(policy).policy)
    expected = model.predict(cases, deterministic=True)[0][:, 0]
    assert np.ptp(expected) > 0.1 and np.abs(expected).min() < 0.99
    actions = [policy.predict(cases)[0][:, 0]]
    if shutil.which("cc"):
        sources = c_source.sources(policy, "mine")
        actions.append(c_source.run(sources, "mine", cases, STRICT))
        rounded = c_source.run(sources, "mine", cases, SINGLE)
        assert np.abs(rounded - expected).max() < single
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(onnx_model.build(policy, "mine").SerializeToString())
    actions.append(session.run(["action"], {"observation": cases})[0][:, 0])
    for found in actions:
        assert np.abs(found - expected).max() < limit


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
        assert "`" not in source and ("\\" not in source or source == sources["mine_main.c"])
    assert re.search(
        r"MINE_OBS_COS_CRANK_ANGLE_INT_EVIL_\w+ = 0, /\* _/ int evil", sources["mine.h"]
    )
    seen = np.ones((1, 5), np.float32)
    expected = policy.predict(seen)[0][:, 0]
    assert c_source.run(sources, "mine", seen, STRICT) == pytest.approx(expected, abs=1e-6)
    described["observation"][1] = described["observation"][0]
    with pytest.raises(ValueError, match="several observations would be"):
        c_source.sources(PretrainedPolicy(described, policy.tensors), "mine")
    for name in ("main", "math", "a-b", "1a", "a" * 64, "", "a\nb", "ä"):
        with pytest.raises(ValueError, match="must be letters, digits and _"):
            c_source.sources(policy, name)


@needs_cc
def test_what_is_not_finite_is_refused_by_the_controller(tmp_path):
    """By an action of 0, without an effect on the next step."""
    policy = pack.from_run(made_run(tmp_path / "run", *NETWORKS["squashed"], WALKER))
    sources = c_source.sources(policy, "mine")
    sources["mine_main.c"] = """
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
"""
    printed = c_source.run(sources, "mine", np.zeros((0, 1)), STRICT)
    seen = np.zeros((2, len(policy.observed)))
    seen[:, 0], seen[1, 2] = 1.0, 0.5
    first, last = policy.predict(seen)[0][:, 0].tolist()
    numbers = [first, -1.0, 0.0, last, 20.0, 0.02]
    assert printed == pytest.approx(numbers, abs=1e-6)
    assert len({*numbers}) == len(numbers)


@needs_cc
def test_arithmetic_that_does_not_know_nan_is_refused():
    sources = c_source.sources(pretrained.load(CRANK), "mine")
    with pytest.raises(ValueError, match="ffast-math leaves out the test"):
        c_source.run(sources, "mine", np.ones((1, 5), np.float32), (*STRICT, "-ffast-math"))


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    pytest.importorskip("onnx")
    folder = tmp_path_factory.mktemp("exported")
    run = made_run(folder / "run", *NETWORKS["apart"], WALKER)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(export, "CASES", 600)
        to = [word for kind in export.KINDS for word in ("--to", kind)]
        export.main([str(run), *to, "--out", str(folder / "out"), "--name", "mine"])
    return run, folder / "out"


@needs_cc
def test_the_program_of_an_export_runs(exported, tmp_path):
    """As its comment says; it refuses what is no observation."""
    run, folder = exported
    names = {"mine.onnx", "mine.h", "mine.c", "mine_main.c"}
    assert {path.name for path in folder.iterdir()} == names
    (command,) = re.findall(r"Compile: (.*) \*/", (folder / "mine_main.c").read_text())
    program = tmp_path / "main"
    subprocess.run([*command.split(), "-o", program], cwd=folder, check=True)
    expected = pack.from_run(run).predict(np.full(20, 0.5))[0]
    done = subprocess.run([program], input="0.5 " * 20, capture_output=True, text=True, check=True)
    assert float(done.stdout) == pytest.approx(*expected, abs=1e-6)
    for given, message in (
        ("nan " * 20, "an observation is not finite"),
        ("1 " * 21, "an observation must have 20 numbers"),
        ("1 " * 20 + "two", "an observation must have 20 numbers"),
    ):
        again = subprocess.run([program], input=given, capture_output=True, text=True)
        assert again.returncode == 1 and again.stderr == f"{message}\n"


def test_an_onnx_model_says_what_it_takes(exported):
    onnx = pytest.importorskip("onnx")
    model = onnx.load(exported[1] / "mine.onnx")
    onnx.checker.check_model(model, full_check=True)
    notes = {entry.key: entry.value for entry in model.metadata_props}
    observed = make_env(WALKER, {}).unwrapped.observed
    entries = [{"name": entry.name, "unit": entry.unit} for entry in observed]
    assert json.loads(notes["observation"]) == entries
    assert notes["env_id"] == WALKER
    assert (notes["torque_limit"], notes["control_dt"]) == ("20.0", "0.02")
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(exported[1] / "mine.onnx")
    for n in (1, 7):
        seen = np.ones((n, len(entries)), np.float32)
        action, torque = session.run(["action", "torque"], {"observation": seen})
        assert torque == pytest.approx(20.0 * action) and action.shape == (n, 1)


def test_what_does_not_agree_is_not_written(exported, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out"
    monkeypatch.setattr(export, "CASES", 200)

    def refused(*words):
        with pytest.raises(SystemExit):
            export.main([*map(str, words), "--out", str(out)])
        return capsys.readouterr().err

    assert "--env is JansenCrank-v0, but" in refused(exported[0], "--to", "c", "--env", CRANK)
    assert "no model at" in refused(tmp_path, "--to", "c")
    assert "policy is 'none', must be one of" in refused("pretrained:none", "--to", "c")
    assert "name is 'a b', must be letters" in refused("pretrained", "--to", "c", "--name", "a b")
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "which", lambda _: None)
        assert export.export("pretrained", ("c",), tmp_path, env_id=CRANK)[1] == {"c": None}
    if shutil.which("cc"):
        original, policy = c_source.sources, pretrained.load(CRANK)
        wrong = {**policy.tensors, "action_net.weight": 1.01 * policy.tensors["action_net.weight"]}
        other = PretrainedPolicy(policy.description, wrong)
        monkeypatch.setattr(c_source, "sources", lambda _, name: original(other, name))
        message = refused("pretrained", "--to", "c", "--env", CRANK)
        assert "actions of c differ by" in message and "nothing was written" in message
    assert not out.exists()
