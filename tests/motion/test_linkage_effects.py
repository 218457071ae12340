"""Effects in general linkages: their work, their mirror images and the short form."""

import copy
import math

import numpy as np
import pytest

from jointgap.config import Simulate, load_mechanism, read_yaml, shipped_mechanisms
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import validate
from jointgap.core.joints import JOINT
from jointgap.effects import CRANK_SIGN_SPEED, EFFECTS, SLIDER_SIGN_SPEED, effects_of
from jointgap.effects.base import example
from jointgap.motion.linkage import linkage_model, simulate_linkage
from jointgap.motion.simulation import integrate_to_angles, observed
from jointgap.motion.slider_crank import simulate
from tests.effects.test_mirrored import OWN
from tests.motion.cases import effect, mechanism, options
from tests.motion.test_linkage_motion import as_linkage

SPEED = 10.0 * math.pi
SHIPPED = ("four_bar", "quick_return", "six_bar")


def linkage(name, *effects, is_ideal=False, **bodies):
    """A shipped linkage with effects, and with changed entries of bodies."""
    content = copy.deepcopy(read_yaml(shipped_mechanisms()[name]))
    if is_ideal:
        for joint in content["joints"].values():
            if "slide" not in joint:
                joint["loose"] = False
    for body, changes in bodies.items():
        content["bodies"][body] |= changes
    return validate(LinkageFile, content | {"effects": list(effects)}, f"{name}.yaml")


def revolution(given, points=720, **keys):
    """Samples of the revolution after the first; without its end, which is its beginning."""
    asked = {"speed": SPEED, "revolutions": 2, "samples_per_revolution": points} | keys
    return simulate_linkage(given, Simulate(**asked)).samples.iloc[points : 2 * points]


def slip(samples):
    """Speed of the block along the rocker of the quick return, on a line through its pivot."""
    angle = samples["rocker_angle"]
    along = samples["block_velocity_x"] * np.cos(angle) + samples["block_velocity_y"] * np.sin(
        angle
    )
    return along


SPEEDS = {
    "crank": lambda samples: samples["crank_speed"],
    "rocker": lambda samples: samples["rocker_angular_velocity"],
    "output": lambda samples: samples["output_angular_velocity"],
    "ram": lambda samples: samples["ram_velocity"],
    "track": slip,
}
PLACES = [
    ("four_bar", "crank"),
    ("four_bar", "rocker"),
    ("six_bar", "rocker"),
    ("six_bar", "output"),
    ("quick_return", "rocker"),
    ("quick_return", "ram"),
    ("quick_return", "track"),
]
SLIDING = ("ram", "track")


def dissipating(site, law, size):
    """An effect at a site, and its dissipated power [W] at a speed."""
    slides = site in SLIDING
    width = SLIDER_SIGN_SPEED if slides else CRANK_SIGN_SPEED
    if law == "viscous_friction":
        key, power = "damping_N_s_m" if slides else "damping_N_m_s", lambda v: size * v**2
    else:
        key, power = "force_N" if slides else "torque_N_m", lambda v: size * v * np.tanh(v / width)
    return effect(f"{site}_{law}", **{key: size}), power


@pytest.mark.parametrize("law, size", [("viscous_friction", 3.0), ("coulomb_friction", 5.0)])
@pytest.mark.parametrize("name, site", PLACES)
def test_friction_dissipates_in_a_revolution_what_the_torque_of_the_crank_delivers(
    name, site, law, size
):
    rubbing, power = dissipating(site, law, size)
    samples = revolution(linkage(name, rubbing, is_ideal=True))
    # the mean over equal steps of a periodic function
    delivered = np.mean(samples["crank_torque"] * samples["crank_speed"])
    lost = np.mean(power(SPEEDS[site](samples)))
    assert delivered == pytest.approx(lost, rel=1e-6)
    assert lost > 1.0


@pytest.mark.parametrize("law, size", [("viscous_friction", 3.0), ("coulomb_friction", 5.0)])
@pytest.mark.parametrize("name, site", PLACES)
def test_friction_costs_its_power_at_every_angle_of_an_ideal_linkage(name, site, law, size):
    rubbing, power = dissipating(site, law, size)
    with_it, without = (
        revolution(linkage(name, *effects, is_ideal=True), 72) for effects in ((rubbing,), ())
    )
    added = (with_it["crank_torque"] - without["crank_torque"]) * SPEED
    lost = power(SPEEDS[site](with_it))
    np.testing.assert_allclose(added, lost, atol=1e-9 * np.abs(lost).max())


@pytest.mark.parametrize("law", ["viscous_friction", "coulomb_friction"])
@pytest.mark.parametrize("name, site", [place for place in PLACES if place[1] != "crank"])
def test_friction_slows_a_motor_by_the_energy_that_it_takes(name, site, law):
    """A free crank: what the motor gives is the change of kinetic energy, and friction."""
    rubbing, power = dissipating(site, law, 1.5)
    motor = {"kind": "motor", "stall_torque": 30.0, "no_load_speed": 60.0, "inertia": 0.02}
    given, points = linkage(name, rubbing, is_ideal=True), 2880
    asked = Simulate(
        speed=SPEED,
        revolutions=1,
        samples_per_revolution=points,
        drive=motor,
        tolerance=1e-10,
    )
    samples = simulate_linkage(given, asked).samples
    time, speed = samples["time"].to_numpy(), samples["crank_speed"].to_numpy()
    gained = np.trapezoid(30.0 * (1.0 - speed / 60.0) * speed, time)
    lost = np.trapezoid(power(SPEEDS[site](samples)), time)
    stored = kinetic_energy(given, samples, 0.02)
    change = stored[-1] - stored[0]
    assert gained - lost == pytest.approx(change, rel=2e-5, abs=2e-5 * gained)
    assert lost > 0.005 * gained


def kinetic_energy(given, samples, rotor_inertia):
    """[J] of all bodies and the rotor."""
    total = 0.5 * rotor_inertia * samples["crank_speed"].to_numpy() ** 2
    for name, body in given.bodies.items():
        if f"{name}_angular_velocity" in samples:
            squares = samples[f"{name}_velocity_x"] ** 2 + samples[f"{name}_velocity_y"] ** 2
            spin = body.inertia * samples[f"{name}_angular_velocity"] ** 2
        elif f"{name}_velocity" in samples:
            squares, spin = samples[f"{name}_velocity"] ** 2, 0.0
        else:
            speed = samples["crank_speed"]
            squares, spin = (body.mass_centre * speed) ** 2, body.inertia * speed**2
        total = total + 0.5 * (body.mass * squares + spin).to_numpy()
    return total


@pytest.mark.parametrize(
    "name, site", [place for place in PLACES if place[1] not in ("track", "crank")]
)
def test_a_formula_minus_c_times_v_is_viscous_friction_to_the_last_bit(name, site):
    viscous, _ = dissipating(site, "viscous_friction", 0.37)
    kind = "force" if site in SLIDING else "torque"
    formula = effect(f"discovered_{site}_{kind}", formula="-c*v", coefficients={"c": 0.37})
    one, other = (revolution(linkage(name, each), 60) for each in (viscous, formula))
    for column in one:
        assert one[column].equals(other[column]), column


@pytest.mark.parametrize("other", ["track_viscous_friction", "ram_viscous_friction"])
def test_the_variables_of_a_formula_at_the_crank_are_those_of_the_ram_whatever_else_acts(other):
    formula = effect("discovered_crank_torque", formula="20*x + 3*v")
    friction, _ = dissipating(other.removesuffix("_viscous_friction"), "viscous_friction", 2.0)
    for beside in ((), (friction,)):
        with_it, without = (
            revolution(linkage("quick_return", *effects, *beside, is_ideal=True), 72)
            for effects in ((formula,), ())
        )
        torque = 20.0 * with_it["ram_position"] + 3.0 * with_it["ram_velocity"]
        added = with_it["crank_torque"] - without["crank_torque"]
        np.testing.assert_allclose(added, -torque, atol=1e-9 * np.abs(added).max())


def test_the_variables_of_a_formula_at_the_crank_are_its_own_in_a_linkage_without_slides():
    formula = effect("discovered_crank_torque", formula="0.1*v + sin(x)")
    with_it, without = (
        revolution(linkage("four_bar", *effects, is_ideal=True), 72) for effects in ((formula,), ())
    )
    torque = 0.1 * SPEED + np.sin(with_it["crank_angle"])
    added = with_it["crank_torque"] - without["crank_torque"]
    np.testing.assert_allclose(added, -torque, atol=1e-9 * np.abs(added).max())


def test_the_variables_of_a_formula_at_a_pivot_are_those_of_its_body_and_of_the_crank():
    formula = effect("discovered_rocker_torque", formula="2*x - 0.1*v + 0.3*sin(theta) - 0.02*w")
    with_it, without = (
        revolution(linkage("four_bar", *effects, is_ideal=True), 72) for effects in ((formula,), ())
    )
    turn, angle = with_it["rocker_angular_velocity"], with_it["crank_angle"]
    torque = 2.0 * with_it["rocker_angle"] - 0.1 * turn + 0.3 * np.sin(angle) - 0.02 * SPEED
    added = (with_it["crank_torque"] - without["crank_torque"]) * SPEED
    np.testing.assert_allclose(added, -torque * turn, atol=1e-9 * np.abs(added).max())


ANGLES = 0.4 + np.linspace(0.0, 2.5, 61)
FORMULA = "3*x - 0.4*v + 2*sin(theta) - 0.03*w + 0.02*w*v"
NOT_MIRRORED = ("speed_fluctuation", "force_table")  # a drive; tests of tables mirror them


def listed(given, law):
    """An effect as in its example, a contact's at a loose joint."""
    placed = effects_of(given.sites)[law]
    made = example(placed)
    if "site" in made:
        made["site"] = next(iter(given.loose_pins))
    if law.startswith("discovered"):
        made["parameters"] = {"formula": FORMULA}
    return made


def acting(name):
    """Effects of a shipped linkage that can act with its data."""
    given = load_mechanism(name)
    for law, placed in effects_of(given.sites).items():
        if placed.LAW_NAME == "clearance":
            if given.joint(law.removesuffix("_clearance")) is None:
                continue
        if placed.LAW_NAME not in NOT_MIRRORED:
            yield name, law


@pytest.mark.parametrize("name, law", [pair for name in SHIPPED for pair in acting(name)])
def test_the_mirrored_linkage_moves_as_the_mirror_image_of_the_clockwise_one(name, law):
    """The clockwise one is integrated backwards, not mirrored."""
    given = linkage(name)
    is_of_contacts = effects_of(given.sites)[law].GROUP in ("pins", "clearances")
    given = linkage(name, effect("gravity"), is_ideal=not is_of_contacts)
    entries = [*(each.model_dump() for each in given.effects)]
    entries = [each for each in entries if each["name"] != law]
    given = linkage(name, *entries, listed(load_mechanism(name), law), is_ideal=not is_of_contacts)
    span = ANGLES[:13] if is_of_contacts else ANGLES  # impacts amplify rounding
    clockwise = linkage_model(given, Simulate(speed=SPEED, start_angle=-span[0]))
    clockwise.drive.speed = -SPEED
    front = motion(clockwise, -span)
    seen = linkage_model(given.mirrored(), Simulate(speed=SPEED, start_angle=span[0]))
    behind = motion(seen, span)
    for column, unit in seen.units.items():
        odd = column.endswith("_y") or unit.startswith(("rad", "N*m"))
        odd |= column in {f"{slide}_force" for slide in given.slides}
        odd |= column in {f"{pin}_friction_force" for pin in given.loose_pins}
        sign = -1.0 if odd and column != "time" else 1.0
        if unit == "rad":  # an angle, perhaps by turns
            apart = np.angle(np.exp(1j * (sign * behind[column] - front[column])))
            assert np.abs(apart[np.isfinite(apart)]).max(initial=0.0) < 1e-6, column
            continue
        apart, size = np.abs(sign * behind[column] - front[column]), np.abs(front[column])
        assert (np.isfinite(apart) == np.isfinite(size)).all(), column
        assert np.nanmax(apart) < 1e-6 * max(np.nanmax(size), 1e-6), column


def motion(model, angles):
    return observed(model, integrate_to_angles(model, model.start(), angles, 1e-12))


@pytest.mark.parametrize("name, body", [("four_bar", "coupler"), ("six_bar", "link")])
def test_a_length_error_is_the_changed_file(name, body):
    length, centre = {"coupler": (0.4, 0.2), "link": (0.46, 0.23)}[body]
    longer = length + 1e-3
    changed = {"length": f"{longer} m", "mass_centre": f"{centre * longer / length} m"}
    wrong = effect("link_length_error", **{f"{body}_m": 1e-3})
    found, expected = (
        revolution(given, 60)
        for given in (
            linkage(name, wrong, is_ideal=True),
            linkage(name, is_ideal=True, **{body: changed}),
        )
    )
    for column in expected.select_dtypes("number"):
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-9, atol=1e-9)


def test_a_mass_error_is_the_changed_file():
    found = revolution(linkage("six_bar", effect("added_output_mass", mass_kg=0.05)), 60)
    expected = revolution(linkage("six_bar", output={"mass": f"{0.8 + 0.05} kg"}), 60)
    for column in expected:
        assert found[column].equals(expected[column]), column


def test_an_offset_moves_the_slide_across_its_direction():
    """Along the normal of its direction, as seen in the position of the ram's pin."""
    plain = revolution(linkage("quick_return", is_ideal=True), 72)
    content = copy.deepcopy(read_yaml(shipped_mechanisms()["quick_return"]))
    content["joints"]["D"]["loose"] = False
    content["joints"]["guide"]["at"] = ["0 mm", "260 mm"]
    moved = revolution(validate(LinkageFile, content, "moved.yaml"), 72)
    found = revolution(
        linkage("quick_return", effect("ram_offset", offset_m=0.01), is_ideal=True), 72
    )
    np.testing.assert_allclose(found["ram_position"], moved["ram_position"], rtol=0, atol=1e-15)
    assert np.abs(found["ram_position"] - plain["ram_position"]).max() > 1e-4


@pytest.mark.parametrize(
    "law, parameters",
    [
        ("gas_pressure", {"force_N": 100.0, "dead_length_m": 0.02, "exponent": 1.3}),
        ("spring", {"stiffness_N_m": 2000.0, "rest_position_m": 0.1}),
        ("constant_force", {"force_N": 50.0}),
    ],
)
def test_a_conservative_force_on_the_ram_does_no_work_in_a_cycle(law, parameters):
    samples = revolution(linkage("quick_return", effect(f"ram_{law}", **parameters), is_ideal=True))
    plain = revolution(linkage("quick_return", is_ideal=True))
    added = samples["crank_torque"] - plain["crank_torque"]
    assert abs(added.mean()) < 1e-9 * np.abs(added).max()
    assert np.abs(added).max() > 1.0


def test_the_gas_pressure_on_the_ram_is_largest_where_it_is_farthest_out():
    gas = effect("ram_gas_pressure", force_N=100.0, dead_length_m=0.02, exponent=1.3)
    samples, plain = (
        revolution(linkage("quick_return", *effects, is_ideal=True)) for effects in ((gas,), ())
    )
    place, speed = plain["ram_position"], plain["ram_velocity"]
    fine = revolution(linkage("quick_return", is_ideal=True), 7200)["ram_position"].to_numpy()
    around = fine[np.argmax(fine) + np.arange(-2, 3)]
    curve = np.polynomial.Polynomial.fit(np.arange(-2, 3), around, 4)
    outermost = curve(curve.deriv().roots()[np.abs(curve.deriv().roots()).argmin()].real)
    force = -100.0 * (0.02 / (0.02 + outermost - place)) ** 1.3
    added = (samples["crank_torque"] - plain["crank_torque"]) * SPEED
    np.testing.assert_allclose(added, -force * speed, atol=1e-9 * np.abs(added).max())


SHORT = [
    name
    for name, placed in EFFECTS.items()
    if placed.LAW_NAME not in ("rod_flexibility", "force_table", "link_length_error")
]


@pytest.mark.parametrize("drive", ["constant", "motor"])
@pytest.mark.parametrize("name", SHORT)
def test_effects_of_a_slider_crank_move_its_general_form_alike(name, drive):
    """To 1e-12 m and 1e-8 of the largest value of other columns."""
    if drive == "motor" and name == "speed_fluctuation":
        pytest.skip("an effect of the constant drive")
    listed = OWN.get(name, example(EFFECTS[name]))
    is_of_contacts = EFFECTS[name].GROUP in ("pins", "clearances")
    loose = ("crank_pin", "piston_pin") if is_of_contacts else ()
    made = mechanism(loose=loose, offset=0.03)
    run = {"samples_per_revolution": 60, "revolutions": 1, "start_angle": 0.4, "tolerance": 1e-13}
    if drive == "motor":
        motor = {"kind": "motor", "stall_torque": 60.0, "no_load_speed": 94.0, "inertia": 0.02}
        run["drive"] = motor
    asked = options(**run)
    short = simulate(type(made).model_validate(made.model_dump() | {"effects": [listed]}), asked)
    general = with_bearings(as_linkage(made), made)
    content = general.model_dump()
    content["effects"] = [listed]
    found = simulate_linkage(LinkageFile.model_validate(content), asked).samples
    rows = 12 if is_of_contacts else len(found)  # impacts amplify rounding
    for column in ("slider_position", "slider_velocity", "crank_torque", "rod_angle"):
        expected, other = (each[column].to_numpy()[:rows] for each in (short.samples, found))
        bound = 1e-12 if column == "slider_position" else 1e-8 * np.abs(expected).max()
        assert np.abs(other - expected).max() <= bound, column


def with_bearings(general, made):
    """The general form with the bearings of ideal joints too."""
    content = general.model_dump()
    for name in JOINT:
        joint = made.joint(name)
        if joint is not None and name not in content["joints"]:
            content["joints"][name] = joint.model_dump()
    return LinkageFile.model_validate(content)


@pytest.mark.parametrize("turned", [0, 55, 75, 95, 180])
def test_a_torsion_spring_has_no_jump_wherever_its_rocker_points(turned):
    """The whole linkage turned by an angle, with the spring's formula, moves and pushes alike; the
    rocker swings between 66 and 131 deg before."""
    content = copy.deepcopy(read_yaml(shipped_mechanisms()["four_bar"]))
    shift, (cosine, sine) = math.radians(turned), np.cos(np.radians([turned, turned - 90]))
    x, y = 0.3 * cosine, 0.3 * sine
    content["frame"]["points"] = {"O": [0.0, 0.0], "C": [x, y]}
    for joint in content["joints"].values():
        joint["loose"] = False
    rocker = content["bodies"]["rocker"]
    rocker["angle"] = math.radians(100.0) + shift
    middle = math.remainder(math.radians(87.0) + shift, 2 * math.pi)
    formula = {"formula": f"-2.0*(x - {middle:.15f})", "coefficients": {}}
    content["effects"] = [{"name": "discovered_rocker_torque", "parameters": formula}]
    found = revolution(validate(LinkageFile, content, "turned.yaml"), start_angle=shift, points=360)
    swing = found["rocker_angle"] - middle
    assert np.ptp(swing) < 1.2 and abs(swing.mean()) < 0.2
    without = revolution(
        validate(LinkageFile, content | {"effects": []}, "turned.yaml"),
        start_angle=shift,
        points=360,
    )
    added = found["crank_torque"] - without["crank_torque"]
    power = 2.0 * swing * found["rocker_angular_velocity"]
    np.testing.assert_allclose(added * SPEED, power, atol=1e-9)
