"""Large networks of the walking page: in it, or in files that it loads when one is chosen."""

import base64
import gzip
import json
import re

import numpy as np
import pytest
from browser import WAIT, reads, wait_for_walk

from jansen_env.cli.play import parse, start_of
from jansen_env.policies import pretrained
from jansen_env.viewer.web.walk import write_walk
from jansen_env.viewer.web.walk_data import ENVIRONMENTS, controller_name, page_policies

SECONDS = re.compile(r"^[1-9]\.\d s$")
LARGEST = 640_000  # bytes of the page on a server, compressed by gzip
HIKERS = {
    "hiker policy": "JansenWalkerRough-v0",
    "hardcore hiker policy": "JansenWalkerHardcore-v0",
}


@pytest.fixture(scope="module")
def apart(tmp_path_factory):
    return write_walk(tmp_path_factory.mktemp("apart") / "walk.html", apart=True)


def policies_of(path):
    text = path.read_text(encoding="utf-8")
    return json.loads(re.search(r'id="data">(.*?)</script>', text)[1])["policies"]


def weights_in(path):
    """Weights of a file beside the page."""
    text = re.fullmatch(r'.*\["(.*)"\] = "(.*)";\n', path.read_text())
    assert text[1] == path.name
    return text[2]


def test_every_policy_has_a_name_of_its_own():
    names = [controller_name(env, n) for env in ENVIRONMENTS for n in page_policies(env)]
    assert len({*names}) == len(names) and {*HIKERS} <= {*names}


def test_the_page_of_a_server_is_small_and_has_all_bits(apart, tmp_path):
    assert len(gzip.compress(apart.read_bytes())) < LARGEST
    policies, whole = policies_of(apart), policies_of(write_walk(tmp_path / "walk.html"))
    files = {each["file"] for each in policies.values() if "file" in each}
    assert {name for name, each in policies.items() if "file" in each} == {*HIKERS}
    assert files == {path.name for path in apart.parent.glob("*.js")}
    assert [*tmp_path.iterdir()] == [tmp_path / "walk.html"]
    for name, env_id in HIKERS.items():
        weights = weights_in(apart.parent / policies[name]["file"])
        assert weights == whole[name]["weights"]
        expected = pretrained.load(env_id, "hiker").network.weights
        assert np.array_equal(np.frombuffer(base64.b64decode(weights), "<f4"), expected)


def test_a_network_is_loaded_when_it_is_chosen(open_window, apart):
    """It is loaded from a file, without a server; the robot walks by it then."""
    window = open_window(reduced_motion="reduce", offline=True)
    page = window.page
    page.goto(apart.as_uri())
    wait_for_walk(page)
    assert len(window.requests) == 1
    page.get_by_label("robot", exact=True).select_option("hiker")
    page.locator("figcaption b", has_text="hiker, hiker policy").wait_for(timeout=WAIT)
    (network,) = window.requests[1:]
    assert network.endswith(policies_of(apart)["hiker policy"]["file"])
    assert "robot=hiker" in page.evaluate("location.hash")
    page.keyboard.press("p")
    page.locator("figcaption dd", has_text=re.compile(r"^[1-9]\.\d s$")).first.wait_for(
        timeout=WAIT
    )
    page.locator("#reset").click()
    page.get_by_label("control", exact=True).select_option("hand")
    page.get_by_label("control", exact=True).select_option("hiker policy")
    page.locator("figcaption b", has_text="hiker, hiker policy").wait_for(timeout=WAIT)
    assert len(window.requests) == 2


def test_choices_that_follow_fast_are_all_taken(open_window, apart):
    """They are taken while a network is loading, too."""
    page = open_window(reduced_motion="reduce", offline=True).page
    page.goto(apart.as_uri())
    wait_for_walk(page)
    page.evaluate(
        """() => {
          for (const [name, value] of [["robot", "hiker"], ["terrain", "rough"], ["level", "3"]]) {
            const choice = document.getElementById(name);
            choice.value = value;
            choice.dispatchEvent(new Event("change"));
          }
        }"""
    )
    page.locator("figcaption b", has_text="hiker, hiker policy").wait_for(timeout=WAIT)
    link = page.evaluate("location.hash")
    assert all(part in link for part in ("robot=hiker", "terrain=rough", "level=3"))


def test_a_missing_file_is_named(browser, tmp_path):
    page = browser.new_context(reduced_motion="reduce").new_page()
    path = write_walk(tmp_path / "walk.html", apart=True)
    for network in tmp_path.glob("*.js"):
        network.unlink()
    page.goto(f"{path.as_uri()}#robot=hiker")
    reads(page, "message", r"^The network of the hiker policy is in the file network-\w+\.js")
    page.locator("figcaption b", has_text="built, built policy").wait_for(timeout=WAIT)
    page.get_by_label("control", exact=True).select_option("hardcore hiker policy")
    reads(page, "message", "^The network of the hardcore hiker policy")
    assert page.locator("#control").input_value() == "built policy"
    page.context.close()


def test_a_policy_starts_on_its_robot():
    for policy, robot in (("hiker", "hiker"), ("ppo", "built")):
        start = start_of(parse(["--env", "JansenWalkerRough-v0", "--policy", policy]))
        assert start["robot"] == robot
