"""The large stages of a time step, to be compiled before it, side by side."""

from __future__ import annotations

import numpy as np

from jansen_env.engine.accumulators import accumulate_contacts, accumulate_step
from jansen_env.engine.collision import detect, list_planes
from jansen_env.engine.compliance import accumulate_compliant, add_compliance, limit_springs
from jansen_env.engine.contacts import assemble, correct_penetration, find_contacts, outruns
from jansen_env.engine.integrator import split, work_space
from jansen_env.engine.jit import Kernel
from jansen_env.engine.records import (
    CONTACT_STATISTICS,
    PAD,
    PLANE,
    ROBOT,
    WORLD,
    Ground,
    Inertia,
    Model,
    Push,
    Velocity,
)
from jansen_env.engine.restitution import Outcome, solve_velocities
from jansen_env.engine.tables import mechanical_energy


def parts() -> list[Kernel]:
    """Return stages with arguments like those they get; first what takes longest.

    With others they would be compiled with the time step.
    """
    h, n, flag = 0.0, 0, False
    velocity, push = Velocity(h, h, h, h), Push(h, h, h, h)
    inertia = Inertia((h, h), (h, h), (h, h), *[h] * 10)
    outcome = Outcome(velocity, velocity, h, h, h, flag)
    robot, world = np.zeros(1, ROBOT)[0], np.zeros(1, WORLD)[0]
    params, status, total = robot["params"], robot["status"], robot["accumulators"]
    planes, pads = np.zeros(2, PLANE), np.zeros(2, CONTACT_STATISTICS)
    body, table = np.zeros((2, 8, 8)), np.zeros((2, 2, 8, 3))
    model = Model(body, table, np.zeros(2, PAD), np.zeros(2))
    ground, state = Ground(np.zeros((2, 2)), np.zeros(2)), np.zeros(8)
    work = split.py_func(*work_space(2))
    contacts = work.contacts
    springs = h, n, velocity, params, planes, contacts
    at_pad = h, h, n, status, ground.surface, world, planes
    law = h, h, h, push, velocity, inertia, params, n, flag, flag, contacts
    found = h, (h, h, h, h), velocity, inertia, robot, model, planes, work
    step = h, h, h, h, push, velocity, outcome, inertia, n, params, contacts, total
    sums = h, n, velocity, velocity, contacts, planes, total, pads
    spring_sums = h, flag, n, velocity, velocity, params, contacts, planes, robot, pads
    return [
        Kernel("velocities", solve_velocities, law),
        Kernel("collision detection", detect, (state, robot, model, ground, world, planes)),
        Kernel("contacts", find_contacts, found),
        Kernel("planes of a pad", list_planes, at_pad),
        Kernel("energies", mechanical_energy, (body, params, state, work.sums)),
        Kernel("sums of compliant pads", accumulate_compliant, spring_sums),
        Kernel("limits of springs", limit_springs, (*springs, pads)),
        Kernel("springs", add_compliance, springs),
        Kernel("Delassus matrix", assemble, (n, params, inertia, planes, contacts)),
        Kernel("penetration", correct_penetration, (h, n, state, velocity, contacts)),
        Kernel("travel of pads", outruns, (h, h, state, params, model, work)),
        Kernel("sums", accumulate_step, step),
        Kernel("sums of pads", accumulate_contacts, sums),
    ]
