"""What pages are made of: a scene's numbers, arrays that are exact enough, text that stays text."""

import base64
import hashlib
import json
import re
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from jansen_env import paper_robot
from jansen_env.dynamics.gravity import GRAVITY
from jansen_env.robot.robot_file import robot_to_json
from jansen_env.viewer.recorder import Recorder
from jansen_env.viewer.saved_walk import FORMAT, walk_again
from jansen_env.viewer.web import page as module
from jansen_env.viewer.web.page import VERTEX_BYTES, page


@pytest.fixture(scope="module")
def recording():
    env = Recorder(gym.make("JansenWalker-v0"), "<b>me</b>")
    env.reset(seed=0)
    for k in range(500):
        env.step(np.array([0.1 + 0.2 * np.sin(0.1 * k)], np.float32))
    return env.recording


def recordings_of(text):
    return json.loads(re.search(r'id="data">(.*?)</script>', text)[1])["recordings"]


def unpacked(array):
    return np.frombuffer(base64.b64decode(array), "<f4")


def test_arrays_are_exact_enough(recording):
    packed = recordings_of(page(recording))[0]["arrays"]
    arrays = {name: unpacked(array) for name, array in packed.items()}
    pose = arrays["pose"].reshape(-1, 4)
    np.testing.assert_allclose(pose[:, :3], recording.pose[:, :3], atol=1e-6)
    turned = np.exp(1j * (pose[:, 3] - recording.pose[:, 3]))
    np.testing.assert_allclose(turned, 1.0, atol=1e-5)
    axis = recording.pose[:, None, :2]
    points = arrays["contactPoint"].reshape(recording.contact_point.shape) + axis
    np.testing.assert_allclose(points, recording.contact_point, atol=1e-6)
    joints = arrays["joints"].reshape(recording.joints.shape) + axis[:, None]
    np.testing.assert_allclose(joints, recording.joints, atol=1e-6)
    forces = arrays["contactForce"].reshape(recording.contact_force.shape)
    np.testing.assert_allclose(forces, recording.contact_force, rtol=1e-6)
    for name in ("torque", "speed", "command", "time"):
        np.testing.assert_allclose(arrays[name], getattr(recording, name), rtol=1e-6)
    np.testing.assert_allclose(arrays["power"][1:], recording.power, rtol=1e-6)
    np.testing.assert_allclose(arrays["returned"][-1], recording.reward.sum(), rtol=1e-6)
    assert arrays["contact"].tolist() == recording.contact.ravel().tolist()


def test_a_page_that_would_be_too_large_is_refused(recording, monkeypatch):
    """Its size is known before it is made, and is that of its arrays and ground."""
    content = recordings_of(page(recording))[0]
    size = sum(map(len, content["arrays"].values())) + len(json.dumps(content["scene"]["terrain"]))
    largest = replace(recording, terrain=1e-3 / 3.0 + np.arange(20_000).reshape(-1, 2) * 1e-3)
    assert (
        len(json.dumps(recordings_of(page(largest))[0]["scene"]["terrain"])) < 10_000 * VERTEX_BYTES
    )
    monkeypatch.setattr(module, "MAX_BYTES", int(1.01 * size))
    page(recording)
    monkeypatch.setattr(module, "MAX_BYTES", int(0.99 * size))
    with pytest.raises(ValueError, match=r"got \d+ MB \(500 steps of 4 legs with 8 joints each"):
        page(recording)
    monkeypatch.setattr(module, "MAX_BYTES", size + VERTEX_BYTES * 1_000)
    with pytest.raises(ValueError, match="10000 vertices of ground"):
        page(largest)


def test_a_small_walk_file_of_a_large_page_is_refused_at_once(tmp_path):
    """The file of 700 kB has 20,000 steps of 200 legs, which would take minutes and 450 MB."""
    content = {
        "format": FORMAT,
        "label": "",
        "robot": robot_to_json(paper_robot(100)),
        "ground": [[-1.0, 0.0], [1.0, 0.0]],
        "start": {"crank_angle": 0.0, "command": 0.3, "changes": {}},
        "steps": [{"action": 0.1, "command": 0.3}] * 20_000,
    }
    path = tmp_path / "walk.json"
    path.write_text(json.dumps(content, separators=(",", ":")))
    assert path.stat().st_size < 700_000
    with pytest.raises(ValueError, match=r"at most 67 MB of recordings, got 4\d\d MB") as error:
        walk_again(path)
    assert "20000 steps of 200 legs with 8 joints each" in str(error.value)


def test_sums_are_those_of_each_step():
    """The mass of the robot is sampled and changed, and its command turns round while it walks."""
    env = Recorder(gym.make("JansenWalker-v0", randomize={"mass_scale": 1.3}, speed_command=0.3))
    env.reset(seed=0)
    x = distance = slipped = lifted = 0.0
    for k in range(150):
        sign = 1.0 if k < 100 else -1.0
        env.unwrapped.set_parameters(payload=0.0 if k < 50 else 2.0, command=0.3 * sign)
        info = env.step(np.array([0.3 * sign], np.float32))[4]
        distance += sign * (info["x_position"] - x)
        x = info["x_position"]
        slipped += info["slip"].sum()
        lifted += abs(info["energy"]["motor_work"]) / env.unwrapped.weight
    recording = env.recording
    weights = (1.3 * 3.2 + np.repeat([0.0, 2.0], [51, 100])) * GRAVITY
    np.testing.assert_allclose(recording.weight, weights)
    (track,) = recordings_of(page(recording))
    assert track["scene"]["weight"] == pytest.approx(weights[0])
    packed = track["arrays"]
    ratios = [unpacked(packed[name]) for name in ("slipPerMetre", "costOfTransport")]
    assert np.isnan(ratios)[:, 0].all()
    expected = slipped / distance, lifted / distance
    np.testing.assert_allclose(np.array(ratios)[:, -1], expected, rtol=1e-6)
    still = replace(recording, command=np.zeros(151))
    packed = recordings_of(page(still))[0]["arrays"]
    assert unpacked(packed["slipPerMetre"])[-1] == pytest.approx(slipped / x)


def test_nothing_else_may_run(recording):
    text = page(recording)
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)[1]
    assert policy.startswith("default-src 'none';") and "unsafe" not in policy
    for kind in ("style", "script"):
        (content,) = re.findall(rf"<{kind}>(.*?)</{kind}>", text, re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in policy
    assert not re.search(r"https?:|\bsrc=|<style |@import|url\(|\bfetch\(|XMLHttp|eval\(", text)
    assert "<b>" not in text
    assert "<title>&lt;b&gt;me&lt;/b&gt;</title>" in text


def test_far_walks_have_the_ground_they_see(recording):
    """They do not have thousands of vertices elsewhere; the two at the ends of a segment are
    enough.
    """
    x = np.linspace(-5000.0, 5000.0, 100_001)
    ground = np.stack([x, np.sin(x)], axis=1)
    (track,) = recordings_of(page(replace(recording, terrain=ground)))
    seen = np.array(track["scene"]["terrain"])
    assert len(seen) < 1000 and seen[0, 0] < -30.0 and seen[-1, 0] > 30.0
    beside = np.array([[100.0, 0.0], [101.0, 0.0], [102.0, 1.0]])
    (track,) = recordings_of(page(replace(recording, terrain=beside)))
    assert track["scene"]["terrain"] == [[100.0, 0.0], [101.0, 0.0]]
