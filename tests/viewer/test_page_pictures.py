"""Pages draw with the colours of Python's pictures; Node.js runs the page's modules."""

from browser import in_node

from jansen_env.engine import contact_frames
from jansen_env.world import rendering

SCRIPT = """
import { AIR, GRIP, SLIP, THEMES } from "FOLDER/scene.js";
console.log(JSON.stringify([THEMES.light, [AIR, GRIP, SLIP]]));
"""
OTHER_NAMES = {"groundText": "GROUND_TEXT", "paper": "WHITE", "grip": "GREEN", "slip": "RED"}


def test_colours_and_states_of_toes_are_those_of_python():
    theme, states = in_node(SCRIPT)
    for name, colour in theme.items():
        assert tuple(colour) == getattr(rendering, OTHER_NAMES.get(name, name.upper())), name
    assert states == [contact_frames.AIR, contact_frames.GRIP, contact_frames.SLIP]
