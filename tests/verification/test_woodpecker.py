"""The woodpecker toy by an event-driven solution, which shares no solver with the package.

Between two events, the modes of the contacts are constant, and SciPy integrates the equations of
motion. At an event, the modes are found by trying all of them.
"""

import itertools

import numpy as np
import pytest
from contact_problems import TOY_EVENTS_PERIOD, TOY_START, Toy, Woodpecker
from scipy.integrate import solve_ivp

REST = 1e-9  # m/s or m, below which a speed or a gap counts as 0
DIRECTIONS = {"forward": 1.0, "backward": -1.0}


class EventDriven:
    """The toy with the position ``q``, the velocity ``u`` and the set of ``closed`` contacts."""

    def __init__(self):
        toy = Woodpecker(1e-5)
        self.springs, self.weight, self.gaps = toy.springs, toy.weight, toy.gaps
        self.normal, self.tangential = toy.jacobian[0::2], toy.jacobian[1::2]
        self.inverse = np.linalg.inv(toy.mass)
        self.mu, self.restitution = Toy().friction, np.array(Toy().restitution)
        self.q, self.u = (np.array(start) for start in TOY_START)
        self.closed = {i for i in range(3) if self.gaps[i] + self.normal[i] @ self.q <= REST}
        self.time = 0.0
        self.turns = []  # times at which the bird hangs farthest backwards
        self.slides = {}  # contacts that begin to slide, and where to

    def rows(self, modes):
        """Directions in which contacts do not move, and those of their forces."""
        fixed, forces = [], []
        for i, mode in modes.items():
            n, t = self.normal[i], self.tangential[i]
            if mode == "stick":
                fixed += [n, t]
                forces += [n, t]
            elif mode != "open":
                fixed.append(n)
                forces.append(n - DIRECTIONS[mode] * self.mu * t)
        return np.reshape(fixed, (-1, 3)), np.reshape(forces, (-1, 3))

    def law(self, free, slip=None, bounce=0.0):
        """Modes of the closed contacts, and the change of the rate ``free`` by their forces.

        Args:
            free: Velocity or acceleration without contacts.
            slip: Velocities of contacts that slide already, if ``free`` is an acceleration.
            bounce: Normal velocities (3,) that the contacts must reach, with the sign changed.
        """
        normal, tangential = self.normal @ free + bounce, self.tangential @ free
        contacts = sorted(self.closed)
        for trial in itertools.product(("open", "stick", *DIRECTIONS), repeat=len(contacts)):
            modes = dict(zip(contacts, trial, strict=True))
            fixed, forces = self.rows(modes)
            wanted = []
            for i, mode in modes.items():
                wanted += {"open": [], "stick": [normal[i], tangential[i]]}.get(mode, [normal[i]])
            loads = np.linalg.solve(fixed @ self.inverse @ forces.T, -np.array(wanted))
            change = self.inverse @ forces.T @ loads
            if self.fits(modes, loads, normal, tangential, change, slip or {}):
                return modes, change
        raise AssertionError("no modes fit")

    def fits(self, modes, loads, normal, tangential, change, slip):
        """Whether modes obey the contact law."""
        loads = iter(loads)
        for i, mode in modes.items():
            slack = 1e-10 * max(1.0, abs(normal[i]), abs(tangential[i]))
            if mode == "open":
                if normal[i] + self.normal[i] @ change < -slack:
                    return False
                continue
            load = next(loads)
            if load < 0.0:
                return False
            if mode == "stick":
                if abs(next(loads)) > self.mu * load * (1.0 + 1e-12) or slip.get(i):
                    return False
                continue
            way = slip.get(i) or tangential[i] + self.tangential[i] @ change + slack
            if DIRECTIONS[mode] * way < (0.0 if slip.get(i) else -2.0 * slack):
                return False
        return True

    def run(self, duration):
        """Simulate from event to event."""
        while self.time < duration:
            slip = {i: self.tangential[i] @ self.u for i in self.closed}
            slip = {i: speed for i, speed in slip.items() if abs(speed) > REST} | self.slides
            modes, _ = self.law(self.inverse @ (self.weight - self.springs @ self.q), slip)
            modes = {i: mode for i, mode in modes.items() if mode != "open"}
            self.closed, self.slides = set(modes), {}
            event = self.advance(modes, duration)
            if event is not None:
                self.handle(*event)

    def advance(self, modes, duration):
        """Integrate with constant modes; return the event that ends them, and its contact."""
        fixed, directions = self.rows(modes)
        effect = np.linalg.inv(fixed @ self.inverse @ directions.T)

        def loads(q):
            return -effect @ fixed @ self.inverse @ (self.weight - self.springs @ q)

        def rate(_, state):
            q, u = state[:3], state[3:]
            force = self.weight - self.springs @ q + directions.T @ loads(q)
            return np.concatenate([u, self.inverse @ force])

        events = {("turn", 0): (lambda _, s: s[5], 1.0)}
        for i in {0, 1, 2} - self.closed:
            events["hit", i] = (lambda _, s, i=i: self.gaps[i] + self.normal[i] @ s[:3], -1.0)
        k = 0
        for i, mode in modes.items():
            events["open", i] = (lambda _, s, k=k: loads(s[:3])[k], -1.0)
            if mode == "stick":
                events["slide", i] = (
                    lambda _, s, k=k: self.mu * loads(s[:3])[k] - abs(loads(s[:3])[k + 1]),
                    -1.0,
                )
            else:
                way = DIRECTIONS[mode]
                events["stick", i] = (lambda _, s, i=i: self.tangential[i] @ s[3:], -way)
            k += 2 if mode == "stick" else 1
        for name, (function, direction) in events.items():
            function.direction, function.terminal = direction, name[0] != "turn"
        solved = solve_ivp(
            rate,
            (self.time, duration),
            np.concatenate([self.q, self.u]),
            method="DOP853",
            events=[function for function, _ in events.values()],
            rtol=1e-10,
            atol=1e-13,
            max_step=2e-4,
        )
        turns = zip(solved.t_events[0], solved.y_events[0], strict=True)
        self.turns += [time for time, state in turns if state[2] < -0.4]
        self.time, self.q, self.u = solved.t[-1], solved.y[:3, -1], solved.y[3:, -1]
        happened = [name for name, t in zip(events, solved.t_events, strict=True) if len(t)]
        happened = [name for name in happened if name[0] != "turn"]
        if not happened:
            return None
        kind, i = happened[0]
        if kind == "slide":  # against the friction, which is the second load of the contact
            before = sum(
                2 if modes[c] == "stick" else 1 for c in list(modes)[: list(modes).index(i)]
            )
            self.slides = {i: -1e-12 * np.sign(loads(self.q)[before + 1])}
        return kind, i

    def handle(self, kind, i):
        """Change the contacts at an event, and the velocity if it is an impact."""
        if kind == "open":
            self.closed.discard(i)
        elif kind == "hit":
            self.closed.add(i)
            _, change = self.law(self.u, bounce=self.restitution * (self.normal @ self.u))
            self.u = self.u + change
            self.closed = {c for c in self.closed if abs(self.normal[c] @ self.u) < REST}


@pytest.mark.slow
def test_period_by_an_event_driven_solution(measured):
    """The period of the limit cycle, as a mean of two pairs: deviations alternate in sign."""
    toy = EventDriven()
    toy.run(1.5)
    period = np.diff(toy.turns)[-4:].mean()
    error = abs(period - TOY_EVENTS_PERIOD)
    measured("woodpecker toy: period of the event-driven solution", error, 1e-5, "s")
