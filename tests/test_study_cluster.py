"""Studies on Ray: as local processes run them, also where a node is killed half way."""

from __future__ import annotations

import json
import os
import secrets
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from test_study import (
    ROOT,
    SMALL,
    assert_same_results,
    command,
    output,
    perform_here,
    start,
    wait_for_checkpoint,
    wait_until,
)

from agents import study, study_runs
from agents.config import load_config
from agents.study_plan import make_study

os.environ |= {  # before Ray is loaded, for its clusters here and the studies that join them
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": secrets.token_hex(32),
}
pytest.importorskip("ray", reason="Ray is not installed; the extra 'distributed' brings it")
from ray.cluster_utils import Cluster

EIGHT = {**SMALL, "seeds": 4, "timesteps": 32_768, "save_freq": 1024, "eval_freq": 16_384}
"""Eight runs of some seconds each."""
NODE = {"num_cpus": 1, "object_store_memory": 80_000_000, "include_dashboard": False}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a study that nothing has happened to."""
    folder = tmp_path_factory.mktemp("studies") / "small"
    perform_here(EIGHT, folder)
    return folder


@pytest.fixture
def cluster():
    """Three nodes, one core each."""
    nodes = Cluster(initialize_head=True, head_node_args=NODE)
    for _ in range(2):
        nodes.add_node(**NODE)
    nodes.wait_for_nodes()
    yield nodes
    nodes.shutdown()


def test_a_node_is_killed_and_another_added(whole, cluster, tmp_path):
    """Eight runs, all finished in the end, with the weights and scores of an untroubled study."""
    runs = make_study(EIGHT).runs(tmp_path / "small")
    driver = start(command(EIGHT, tmp_path, "--address", cluster.address))
    wait_until(lambda: sum(study_runs.is_finished(run.folder) for run in runs) >= 2, driver)
    victim, run = wait_until(lambda: at_work(cluster, runs), driver)
    pid = study_runs.read_status(run.folder)["pid"]
    cluster.remove_node(victim, allow_graceful=False)
    cluster.add_node(**NODE)
    assert driver.wait(300) == 0, output(driver)
    assert study_runs.read_status(run.folder)["pid"] != pid
    assert_same_results(whole, tmp_path / "small")


def at_work(cluster, runs):
    """A node but the first that trains a run which has a checkpoint and far to go, and this run."""
    nodes = {
        info.process.pid: node
        for node in cluster.worker_nodes
        for infos in [node.all_processes["raylet"]]
        for info in infos
    }
    for run in runs:
        status = study_runs.read_status(run.folder)
        saved = [int(path.stem.split("_")[1]) for path in run.folder.glob("checkpoints/model_*")]
        # Its state is written every two seconds only, which may be most of a run.
        if "pid" in status and saved and max(saved) < EIGHT["timesteps"] // 2:
            parent = int(
                Path(f"/proc/{status['pid']}/stat").read_text().rsplit(")", 1)[1].split()[1]
            )
            if parent in nodes:
                return nodes[parent], run
    return None


def test_killed_driver_loses_nothing(whole, tmp_path):
    """On a Ray of its own, which ends with it; the same command goes on."""
    plan = {**EIGHT, "seeds": 2}
    folders = [run.folder for run in make_study(plan).runs(tmp_path / "small")]
    arguments = command(plan, tmp_path)
    driver = start(arguments)
    wait_for_checkpoint(folders[1], 512, driver)
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    again = start(arguments)
    assert again.wait(300) == 0, output(again)
    assert_same_results(tmp_path / "small", whole)


def test_an_end_by_signal_saves_checkpoints(tmp_path):
    """SIGTERM is taken as Ctrl-C, and is never ignored as that is in a shell's background."""
    # So long that on no machine it is over before the signal arrives.
    plan = {**SMALL, "seeds": 1, "timesteps": 1_000_000, "save_freq": 0, "eval_freq": 0}
    folders = [run.folder for run in make_study(plan).runs(tmp_path / "small")]
    driver = start(command(plan, tmp_path))
    wait_until(
        lambda: any(study_runs.read_status(folder).get("steps") for folder in folders), driver
    )
    driver.send_signal(signal.SIGTERM)
    assert driver.wait(180) == 130, output(driver)
    assert list((tmp_path / "small").glob("*/seed_0/checkpoints/model_*_steps.zip"))


def test_an_address_without_a_cluster_is_refused(tmp_path, capsys):
    arguments = command({**SMALL, "seeds": 1}, tmp_path, "--address", "127.0.0.1:1")[2:]
    with pytest.raises(SystemExit):
        study.main(arguments)
    assert "no Ray cluster answers at 127.0.0.1:1" in capsys.readouterr().err


def test_a_cluster_that_asks_for_no_token_is_refused(tmp_path, monkeypatch):
    """In one line that says how to begin it."""
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    nodes = Cluster(initialize_head=True, head_node_args=NODE)
    try:
        arguments = command({**SMALL, "seeds": 1}, tmp_path, "--address", nodes.address)
        ended = subprocess.run(
            [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=120
        )
        last = ended.stderr.splitlines()[-1]
        assert ended.returncode != 0 and "Traceback" not in ended.stderr
        assert f"at {nodes.address} asks for no token" in last and "RAY_AUTH_MODE=token" in last
    finally:
        nodes.shutdown()


@pytest.mark.slow
def test_a_search_stops_what_is_hopeless_and_goes_on(tmp_path):
    """Six trials, some of them stopped early; the same command finds all of them done."""
    plan = {**SMALL, "seeds": 1, "timesteps": 32_768, "eval_freq": 4096, "save_freq": 4096}
    plan["variants"] = {"plain": SMALL["variants"]["plain"]}
    space = {
        "trials": 6, "reduction_factor": 2, "grace_steps": 4096,
        "hyperparameters": {"learning_rate": {"loguniform": [1e-4, 1e-1], "schedule": "linear"}},
        "policy_kwargs": {"net_arch": {"choice": [[8], [16]]}},
    }  # fmt: skip
    (tmp_path / "space.yml").write_text(yaml.safe_dump(space))
    arguments = command(plan, tmp_path, "--tune", str(tmp_path / "space.yml"))
    search = start(arguments)
    assert search.wait(300) == 0, output(search)
    trials = json.loads((tmp_path / "small" / "search.json").read_text())
    states = {trial["trial"]: (trial["state"], trial["steps"]) for trial in trials}
    assert len(states) == 6
    assert {state for state, _ in states.values()} == {"finished", "stopped early"}
    assert all((state == "finished") == (steps >= 32_768) for state, steps in states.values())
    best = load_config(tmp_path / "small" / "best.yml")
    assert best["hyperparameters"]["learning_rate"] == trials[0]["learning_rate"]
    assert trials[0]["return"] == max(trial["return"] for trial in trials)
    again = start(arguments)
    assert again.wait(300) == 0, output(again)
    assert json.loads((tmp_path / "small" / "search.json").read_text()) == trials
