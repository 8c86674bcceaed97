"""Published problems of multibody dynamics.

Their sources are in experiments/reference_problems.py and experiments/contact_problems.py.
"""

import contact_problems as contacts
import pytest
import reference_problems as problems


def test_andrews_squeezer_by_the_tables(measured):
    """IFToMM A03: the reduced equations on a linkage of ternary links with an off-axis spring."""
    motion = problems.squeezer_by_tables()
    error = abs(motion.angle - problems.SQUEEZER_END)
    measured("A03 squeezer by tables: error of the crank angle", error, 1e-8, "rad")
    error = abs(motion.speed / problems.SQUEEZER_SPEED - 1.0)
    measured("A03 squeezer by tables: relative error of the crank speed", error, 1e-9)
    measured("A03 squeezer by tables: energy error", motion.drift, 1e-11, "J")


@pytest.mark.slow
def test_andrews_squeezer_by_the_projection(measured):
    """IFToMM A03: the projection method on all eight bodies."""
    motion = problems.squeezer_by_projection(tolerance=1e-12)
    error = abs(motion.angle - problems.SQUEEZER_END)
    measured("A03 squeezer by projection: error of the crank angle", error, 1e-8, "rad")
    measured("A03 squeezer by projection: energy error", motion.drift, 1e-10, "J")


def test_the_published_start_is_the_position_of_the_linkage():
    """The angles of K3, K5 and K7 at the start, as the source gives them to 30 digits."""
    robot = problems.squeezer()
    x = problems.coordinates(robot, "fore", problems.SQUEEZER_START)
    angles = dict(zip(robot.linkage.names, x[::3], strict=True))
    assert angles["K3"] == pytest.approx(0.455279819163070380, abs=1e-14)
    assert angles["K5"] == pytest.approx(0.487364979543842550, abs=1e-14)
    assert angles["K7"] == pytest.approx(1.23054744454982119, abs=1e-14)


def test_n_four_bars_keep_their_energy(measured):
    """IFToMM A02 with 4 windows through nine singular positions; test_four_bar.py has two."""
    motion = problems.FourBars(4).solve(1e-10)
    measured("A02 four-bar, 4 windows: energy error", motion.drift, 1e-7, "J")


@pytest.mark.slow
def test_rocking_block(measured):
    """Housner's block: the contact law finds the impact that keeps angular momentum."""
    exact = contacts.rocking_block_closed_form()
    errors = []
    for step in (4e-4, 1e-4, 2.5e-5):
        ours = contacts.rocking_block(step)
        errors.append(abs(ours.ratio - exact.ratio))
        measured(
            "rocking block: time of the impact, in steps",
            abs(ours.period - exact.period) / step,
            0.3,
        )
    measured("rocking block: speed after / before the impact", errors[-1], 3e-4)
    assert errors[0] > errors[1] > errors[2]


@pytest.mark.parametrize("name", contacts.DISCS)
def test_disc_comes_to_roll(name, measured):
    """A solid disc slides until it rolls, with two thirds of the speed if it had no spin."""
    exact = contacts.disc_closed_form(*contacts.DISCS[name])
    ours = contacts.roll_disc(*contacts.DISCS[name])
    measured("disc: time until it rolls", abs(ours.time - exact.time), 1e-13, "s")
    measured("disc: speed when it rolls", abs(ours.speed - exact.speed), 1e-13, "m/s")


@pytest.mark.slow
def test_bouncing_ball(measured):
    """The third bounce has its height, and infinitely many bounces end in time."""
    exact = contacts.bouncing_ball_closed_form()
    ours = contacts.bounce_ball()
    measured(
        "bouncing ball: height of the third bounce", abs(ours.height - exact.height), 1e-6, "m"
    )
    measured("bouncing ball: time of the last bounce", abs(ours.rest - exact.rest), 4e-4, "s")


def test_painleve_rod(measured):
    """A uniform rod cannot slide if the friction is above 4/3; it is stopped at once."""
    exact = contacts.rod_closed_form()
    ours = contacts.slide_rod()
    error = abs(ours.friction - exact.friction)
    measured("Painleve's rod: friction without sliding", error, 1e-5)
    measured("Painleve's rod: spin after the stop", abs(ours.spin - exact.spin), 2e-6, "rad/s")


@pytest.mark.slow
def test_woodpecker_toy(measured):
    """The trajectory is that of Siconos, and the period is near the published one."""
    ours = contacts.woodpecker()
    errors = [abs(a - b) for a, b in zip(ours.position, contacts.TOY_SICONOS, strict=True)]
    measured("woodpecker toy: height after 0.3 s, to Siconos", errors[0], 5e-12, "m")
    measured("woodpecker toy: angles after 0.3 s, to Siconos", max(errors[1:]), 1e-10, "rad")
    error = abs(ours.period / contacts.TOY_PERIOD - 1.0)
    measured("woodpecker toy: period, relative to the published one", error, 0.01)
    error = abs(ours.period / contacts.TOY_EVENTS_PERIOD - 1.0)
    measured("woodpecker toy: period, relative to an event-driven solution", error, 1.5e-3)


def test_woodpecker_toy_jams(measured):
    """The sleeve jams from the published friction coefficient on."""
    error = abs(contacts.least_jam_friction() - contacts.TOY_JAM)
    measured("woodpecker toy: least friction that jams, to the published digits", error, 5e-4)
