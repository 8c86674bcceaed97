"""Compare known linkages and linkages of the map: cost of transport against climbing.

Run the example as follows. It prints a table and writes a robot file for every machine.

    python examples/front.py [STARTS] [MACHINES]

STARTS is the number of initial states per walk, 16 by default. MACHINES is the number of machines
from the map, 12 by default.

Every machine walks at 0.3 m/s under the best of six speed controllers. The cost is measured on
level ground. The measure `climb` is that of ../docs/design.md, with links that collide. Linkages
other than Jansen's are as tall and heavy as the built robot and have its feet, motor and mean
bearing friction.
"""

import sys
from dataclasses import replace

import numpy as np
from linkage_map import BASE, SPEED, controlled, load, robot_of

from agents.design.measures import Walker, geometry_measures
from jansen_env.robot.designs import with_built_feet
from jansen_env.robot.lengths import lengths, with_lengths
from jansen_env.robot.robot_file import write_robot
from jansen_env.world.settings import load_robot

starts = int(sys.argv[1]) if len(sys.argv) > 1 else 16
count = int(sys.argv[2]) if len(sys.argv) > 2 else 12


def as_built(name):
    """Return a linkage with the mass, feet, motor and mean bearing friction of the built robot."""
    robot = load_robot("robot", name)
    if robot.linkage == BASE.linkage:
        return with_lengths(BASE, lengths(robot))
    share, pins = BASE.mass / robot.mass, len(robot.damping)
    bodies = [replace(b, mass=share * b.mass, inertia=share * b.inertia) for b in robot.bodies]
    bearing = (float(np.mean(BASE.bearing_friction)),) * pins
    robot = replace(robot, bodies=tuple(bodies), damping=(0.0,) * pins, bearing_friction=bearing)
    return with_built_feet(robot)


def rank(walk):
    """Return a sort key: the cost of a walk, after all others if the robot falls or is too slow."""
    late = not walk["steady_speed_error"] < 0.02 or walk["falls"] > 0
    return late, walk["steady_cost_of_transport"]


GAINS = [(gain, bias) for gain in (1.0, 3.0, 9.0) for bias in (0.0, 2.0)]  # in N m s/rad and N m
data = load()
cost = np.where(data["slip"] < 0.2, data["cost"], np.inf)
ranges = np.linspace(0.04, 0.28, count + 1)[:count]
cheapest = [np.where(data["opening"] < least, np.inf, cost).argmin() for least in ranges]
machines = {
    "paper": BASE,
    **{name: load_robot("robot", name) for name in ("economy", "climber")},
    **{name: as_built(name) for name in ("holy", "klann", "strider", "chebyshev", "trotbot")},
    **{f"map {k}": robot_of(data, k) for k in dict.fromkeys(cheapest)},
}
print("| machine | cost | slip (m/m) | speed error (m/s) | falls | climb (m) | opening (m) |")
print("| --- |" + 6 * " ---: |")
for name, robot in machines.items():
    write_robot(f"{name.replace(' ', '_')}.json", robot)  # input of codesign.py
    shape = geometry_measures(robot)
    world = {"robot": robot, "links_collide": True}
    walker = Walker("JansenWalkerBuilt-v0", world, SPEED, starts, 1)
    candidates = [controlled(robot, shape["advance"], *gains) for gains in GAINS]
    walks = [walker.walk([candidate])[0] for candidate in candidates]
    k = min(range(len(walks)), key=lambda k: rank(walks[k]))
    climb, walk = walker.measure("climb", candidates[k : k + 1])["climb"][0], walks[k]
    names = "steady_cost_of_transport", "steady_slip_per_metre", "steady_speed_error", "falls"
    numbers = [*(walk[key] for key in names), climb, shape["opening"]]
    print(f"| {name} | " + " | ".join(f"{number:.2g}" for number in numbers) + " |", flush=True)
