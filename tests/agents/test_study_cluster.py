"""Studies on Ray: as local processes run them, also where a node is killed half way."""

import os
import secrets
import signal
import subprocess
import sys
from pathlib import Path

import psutil
import pytest
from small_studies import (
    ROOT,
    SMALL,
    assert_same_results,
    command,
    output,
    perform_here,
    start,
    wait_until,
)

from agents import study
from agents.studies.plan import make_study
from agents.studies.run import read_status

os.environ |= {  # before Ray is loaded, for its clusters here and the studies that join them
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_AUTH_MODE": "token",
    "RAY_AUTH_TOKEN": secrets.token_hex(32),
}
pytest.importorskip("ray", reason="Ray is not installed; the extra 'distributed' brings it")
from ray.cluster_utils import Cluster

FOUR = {**SMALL, "timesteps": 24_576, "save_freq": 1024, "eval_freq": 12_288}
"""Four runs of some seconds each."""
NODE = {"num_cpus": 1, "object_store_memory": 80_000_000, "include_dashboard": False}


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder of a study that nothing has happened to."""
    folder = tmp_path_factory.mktemp("studies") / "small"
    perform_here(FOUR, folder)
    return folder


@pytest.fixture
def cluster():
    nodes = Cluster(initialize_head=True, head_node_args=NODE)
    nodes.add_node(**NODE)
    nodes.wait_for_nodes()
    yield nodes
    nodes.shutdown()


def steps_saved(run):
    """Of a run's last checkpoint; 0 without one."""
    paths = run.folder.glob("checkpoints/model_*")
    return max((int(path.stem.split("_")[1]) for path in paths), default=0)


@pytest.mark.slow
def test_a_node_is_killed_and_another_added(whole, cluster, tmp_path):
    """Four runs, all finished in the end, with the weights and scores of an untroubled study."""
    runs = make_study(FOUR).runs(tmp_path / "small")
    driver = start(command(FOUR, tmp_path, "--address", cluster.address))
    (victim,) = cluster.worker_nodes
    raylets = {info.process.pid for info in victim.all_processes["raylet"]}

    def at_work():
        """A run on the second node that has a checkpoint and far to go."""
        for run in runs:
            pid = read_status(run.folder).get("pid")
            if pid and 0 < steps_saved(run) < FOUR["timesteps"] // 2 and parent(pid) in raylets:
                return run
        return None

    run = wait_until(at_work, driver)
    pid = read_status(run.folder)["pid"]
    cluster.remove_node(victim, allow_graceful=False)
    cluster.add_node(**NODE)
    assert driver.wait(300) == 0, output(driver)
    assert read_status(run.folder)["pid"] != pid
    assert_same_results(whole, tmp_path / "small")


def parent(pid):
    """The process that began a process; 0 where that has ended."""
    try:
        return int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1])
    except FileNotFoundError:
        return 0


def test_killed_driver_and_end_by_signal_lose_nothing(whole, tmp_path):
    """On a Ray of its own, which ends with it; runs go on wherever the study does."""
    runs = make_study(FOUR).runs(tmp_path / "small")
    arguments = command(FOUR, tmp_path)
    driver = start(arguments)
    wait_until(lambda: any(map(steps_saved, runs)), driver)
    children = psutil.Process(driver.pid).children(recursive=True)
    workers = [one for one in children if "Agent" not in one.name()]  # Ray's own, which stay longer
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    assert not psutil.wait_procs(workers, timeout=60)[1]  # whose runs would go on meanwhile
    again = start(arguments)
    wait_until(lambda: " to do on Ray" in output(again), again)  # the first one's statuses are gone
    wait_until(lambda: "training" in {read_status(run.folder).get("state") for run in runs}, again)
    again.send_signal(signal.SIGTERM)  # taken as Ctrl-C
    assert again.wait(180) == 130, output(again)
    states = {read_status(run.folder).get("state") for run in runs}
    assert states <= {"stopped", "finished", None} and states != {"finished"}  # some are to do
    perform_here(FOUR, tmp_path / "small")
    assert_same_results(whole, tmp_path / "small")


def test_an_address_without_a_cluster_is_refused(tmp_path, capsys):
    arguments = command({**SMALL, "seeds": 1}, tmp_path, "--address", "127.0.0.1:1")[2:]
    with pytest.raises(SystemExit):
        study.main(arguments)
    assert "no Ray cluster answers at 127.0.0.1:1" in capsys.readouterr().err


def test_a_cluster_that_asks_for_no_token_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("RAY_AUTH_MODE", "disabled")
    nodes = Cluster(initialize_head=True, head_node_args=NODE)
    try:
        arguments = command({**SMALL, "seeds": 1}, tmp_path, "--address", nodes.address)
        ended = subprocess.run(
            [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, timeout=120
        )
        said = ended.stderr
        assert ended.returncode != 0 and "Traceback" not in said
        assert f"at {nodes.address} asks for no token" in said and "RAY_AUTH_MODE=token" in said
    finally:
        nodes.shutdown()
