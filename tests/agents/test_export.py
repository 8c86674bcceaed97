"""Policies taken along: ONNX and C that act as the policy does."""

import json
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pytest
from small_runs import NETWORKS, made_run

from agents import export, pack
from agents.export import c_source, onnx_model
from jansen_env.policies import pretrained
from jansen_env.policies.pretrained import PretrainedPolicy
from jansen_env.scoring.rollout import make_env

STRICT = (
    "-std=c99",
    "-O1",
    "-Wall",
    "-Wextra",
    "-Wconversion",
    "-Wdouble-promotion",
    "-Wshadow",
    "-Wunused-macros",
    "-pedantic",
    "-Werror",
)
SINGLE = (*STRICT, "-DMINE_SINGLE_PRECISION")
WALKER = "JansenWalker-v0"
CRANK = "JansenCrank-v0"
needs_cc = pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")

HARMONICS = (
    "ppo",
    {},
    {**NETWORKS["normalized"][2], "activation": "elu", "harmonics": 2, "half_turn": True},
)


def make_cases(policy, count):
    """Observations: half within two standard deviations of their mean in training, a quarter within
    twenty, a quarter far beyond the clip of the scaling."""
    rng = np.random.default_rng(0)
    spread = rng.normal(size=(count, len(policy.observed)))
    spread *= np.repeat([1.0, 10.0, 1e4], [count // 2, count // 4, count - 3 * count // 4])[:, None]
    return pack.random_observations(policy, spread, rng)


def run_c(sources, seen, options):
    """Compile C sources, and return what the program prints for observations, as numbers."""
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            (Path(folder) / file).write_text(text, encoding="ascii")
        build = ["cc", *options, "-o", "main", "mine_main.c", "mine.c", "-lm"]
        made = subprocess.run(build, cwd=folder, capture_output=True, text=True)
        assert made.returncode == 0, made.stderr
        numbers = " ".join(f"{x:.9g}" for x in np.ravel(seen).tolist())
        program = [str(Path(folder) / "main")]
        answer = subprocess.run(program, input=numbers, capture_output=True, text=True, check=True)
    return np.array(answer.stdout.split(), float)


def agree(policy, count, limit=1e-6, single=1e-5):
    """Check that C, in double and float, and onnxruntime act as the policy and as PyTorch."""
    cases = make_cases(policy, count)
    model = pack.in_float64(pack.to_sb3(policy).policy)
    expected = model.predict(cases, deterministic=True)[0][:, 0]
    assert np.ptp(expected) > 0.1 and np.abs(expected).min() < 0.99
    actions = [policy.predict(cases)[0][:, 0]]
    if shutil.which("cc"):
        sources = c_source.sources(policy, "mine")
        actions.append(run_c(sources, cases, STRICT))
        rounded = run_c(sources, cases, SINGLE)
        assert np.abs(rounded - expected).max() < single
    runtime = pytest.importorskip("onnxruntime")
    session = runtime.InferenceSession(onnx_model.build(policy, "mine").SerializeToString())
    actions.append(session.run(["action"], {"observation": cases})[0][:, 0])
    for computed in actions:
        assert np.abs(computed - expected).max() < limit


@pytest.mark.slow
@pytest.mark.parametrize("network", [HARMONICS, NETWORKS["sac"]], ids=["harmonics", "sac"])
def test_onnx_and_c_act_as_pytorch(network, tmp_path):
    agree(pack.from_run(made_run(tmp_path / "run", *network, WALKER)), 300)


@pytest.mark.slow
@pytest.mark.parametrize("network", NETWORKS)
def test_networks_act_as_pytorch(network, tmp_path):
    agree(pack.from_run(made_run(tmp_path / "run", *NETWORKS[network])), 10_000)


EVIL = '*/ int evil(void); /* \\\n #include "evil.h" ??/ `rm` \u2028 <b>|</b>'


@needs_cc
def test_no_text_of_a_file_becomes_code():
    """Names, units and ids end no comment, and nothing but letters is left of names."""
    policy = pretrained.load(CRANK)
    given = policy.description["observation"]
    rows = [{"name": row["name"] + EVIL, "unit": EVIL} for row in given]
    described = {**policy.description, "observation": rows}
    evil = PretrainedPolicy(described, policy.tensors)
    evil.env_id = EVIL  # which no file gets through
    sources = c_source.sources(evil, "mine")
    for source in sources.values():
        assert source.isascii() and "evil.h" not in source.replace("_evil.h", "")
        code = re.sub(r"/\*.*?\*/", "", source, flags=re.S)
        assert "evil" not in code and "?" not in code.replace(" ? ", "")
        assert "`" not in source and ("\\" not in source or source == sources["mine_main.c"])
    assert re.search(r"OBS_COS_CRANK_ANGLE_INT_EVIL_\w+ = 0, /\* _/ int evil", sources["mine.h"])
    seen = np.ones((1, 5), np.float32)
    expected = policy.predict(seen)[0][:, 0]
    assert run_c(sources, seen, STRICT) == pytest.approx(expected, abs=1e-6)
    rows[1] = rows[0]
    with pytest.raises(ValueError, match="observations must have different names in C"):
        c_source.sources(PretrainedPolicy(described, policy.tensors), "mine")
    for name in ("main", "math", "a-b", "1a", "a" * 64, "", "a\nb", "ä"):
        with pytest.raises(ValueError, match="name must be a letter and up to 62 letters, digits"):
            c_source.sources(policy, name)


STOP = """
#include <math.h>
#include <stdio.h>
#include "mine.h"
int main(void)
{
    const float values[4] = {0.5f, NAN, INFINITY, -INFINITY};
    float seen[MINE_OBSERVATIONS], action;
    int place, which, wrong;
    for (place = 0; place < MINE_OBSERVATIONS; ++place) {
        for (which = 0; which < 4; ++which) {
            for (wrong = 0; wrong < MINE_OBSERVATIONS; ++wrong) {
                seen[wrong] = 0.5f;
            }
            seen[place] = values[which];
            action = 9.0f;
            wrong = mine_step(seen, &action);
            printf("%d %d\\n", wrong, fabsf(action) > 0.0f);
        }
    }
    printf("%g %g", (double)MINE_TORQUE_LIMIT, (double)MINE_CONTROL_PERIOD);
    return 0;
}
"""


@needs_cc
@pytest.mark.parametrize("options", [STRICT, SINGLE], ids=["double", "float"])
def test_what_is_not_finite_gets_an_action_of_0(options):
    """This holds for NaN or infinity in any place of an observation.

    Compilers whose arithmetic does not know NaN are refused.
    """
    sources = {**c_source.sources(pretrained.load(CRANK), "mine"), "mine_main.c": STOP}
    printed = run_c(sources, np.zeros((0, 1)), options)
    assert printed[-2:].tolist() == [5.0, 0.01]
    returned, acts = printed[:-2].reshape(5, 4, 2).T
    assert (returned[0] == 0.0).all() and (returned[1:] == -1.0).all()
    assert (acts[0] == 1.0).all() and (acts[1:] == 0.0).all()
    with pytest.raises(AssertionError, match="ffast-math leaves out the test"):
        run_c(sources, np.zeros((0, 1)), (*options, "-ffast-math"))


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "name"), [("JansenWalkerBuilt-v0", "onboard"), (CRANK, "ppo")])
def test_onnx_gives_nan_for_what_is_not_finite(env_id, name):
    """NaN or infinity in any place makes the action and the torque of that robot NaN, and of no
    other.
    """
    runtime = pytest.importorskip("onnxruntime")
    policy = pretrained.load(env_id, name)
    session = runtime.InferenceSession(onnx_model.build(policy, "mine").SerializeToString())
    width = len(policy.observed)
    seen = np.full((width + 1, width), 0.5, np.float32)
    expected = policy.predict(seen[-1:])[0][0]
    for value in (np.nan, np.inf, -np.inf):
        seen[np.arange(width), np.arange(width)] = value
        for output in session.run(["action", "torque"], {"observation": seen}):
            assert np.isnan(output[:-1]).all() and np.isfinite(output[-1]).all()
        action = session.run(["action"], {"observation": seen})[0]
        assert action[-1] == pytest.approx(expected, abs=1e-6)


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    pytest.importorskip("onnx")
    folder = tmp_path_factory.mktemp("exported")
    run = made_run(folder / "run", *NETWORKS["apart"], WALKER)
    to = [word for kind in ("onnx", "c") for word in ("--to", kind)]
    export.main([str(run), *to, "--out", str(folder / "out"), "--name", "mine"])
    return run, folder / "out"


@pytest.mark.slow
@needs_cc
def test_the_program_of_an_export_runs(exported, tmp_path):
    """It runs as its comment says, and it refuses input that is no observation."""
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
