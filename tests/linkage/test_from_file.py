"""Files of linkages give bodies, joints and their order; what cannot be meant is refused."""

import copy

import pytest
import yaml

import jointgap as jg
from jointgap.config.linkage_file import LinkageFile
from jointgap.config.load import validate
from jointgap.core.errors import InputError
from jointgap.linkage.from_file import linkage_of_file, linkage_of_slider_crank

FOUR_BAR = yaml.safe_load("""
frame: {points: {O: [0 mm, 0 mm], C: [300 mm, 0 mm]}}
bodies:
  crank:   {length: 100 mm, ends: [O, A], mass: 1 kg, inertia: 8.3e-4 kg*m^2, mass_centre: 50 mm}
  coupler: {length: 400 mm, ends: [A, B], mass: 1 kg, inertia: 1.3e-2 kg*m^2, mass_centre: 0.2 m}
  rocker:  {points: {C: [0 mm, 0 mm], B: [250 mm, 0 mm]}, mass: 1 kg, inertia: 5.2e-3 kg*m^2,
            mass_centre: [125 mm, 5 mm], angle: 100 deg}
joints:
  A: {journal: crank, journal_radius: 9.95 mm, bearing_radius: 10 mm, contact: steel}
  C: {journal: frame, journal_radius: 9.95 mm, bearing_radius: 10 mm, contact: steel}
contacts:
  steel: {law: lankarani_nikravesh, restitution: 0.46, friction: 0.05}
effects: [{name: gravity}]
drive: O
""")
QUICK_RETURN = yaml.safe_load("""
frame: {points: {O: [0 mm, 0 mm], C: [0 mm, -300 mm]}}
bodies:
  crank:  {length: 100 mm, ends: [O, A], mass: 1 kg, inertia: 8.3e-4 kg*m^2, mass_centre: 50 mm}
  block:  {points: {A: [0 mm, 0 mm]}, mass: 0.2 kg, inertia: 5e-5 kg*m^2}
  rocker: {length: 500 mm, ends: [C, B], mass: 2 kg, inertia: 5e-2 kg*m^2, mass_centre: 250 mm}
  rod:    {length: 250 mm, ends: [B, D], mass: 0.4 kg, inertia: 2e-3 kg*m^2, mass_centre: 120 mm,
           angle: 10 deg}
  ram:    {points: {D: [0 mm, 0 mm]}, mass: 3 kg}
joints:
  track: {slide: [rocker, block], at: [0 mm, 0 mm], direction: 0 deg}
  guide: {slide: [frame, ram], at: [0 mm, 250 mm], direction: right}
  D: {journal: ram, journal_radius: 5.95 mm, bearing_radius: 6 mm, contact: steel}
contacts: {steel: {law: exact_restitution, restitution: 0.5, friction: 0.08}}
drive: O
""")


def read(data, **changes):
    """The linkage of a file with changed entries, by their path with dots."""
    data = copy.deepcopy(data)
    for path, value in changes.items():
        *keys, last = path.split("__")
        entry = data
        for key in keys:
            entry = entry[key]
        if value is None:
            del entry[last]
        else:
            entry[last] = value
    return linkage_of_file(validate(LinkageFile, data, "mine.yaml"))


def test_shared_points_are_revolute_joints_and_entries_make_them_loose():
    linkage = read(FOUR_BAR)
    assert {name: joint.bodies for name, joint in linkage.joints.items()} == {
        "O": ("frame", "crank"),
        "A": ("crank", "coupler"),
        "B": ("rocker", "coupler"),
        "C": ("frame", "rocker"),
    }
    assert [joint.name for joint in linkage.loose] == ["A", "C"]
    assert linkage.bodies["coupler"].points == {"A": (None, None), "B": (0.4, None)}
    assert linkage.bodies["rocker"].centre == (0.125, 0.005)
    assert linkage.gravity == pytest.approx((0.0, -9.80665))
    assert linkage.kinds == {"crank": "pivoted", "coupler": "free", "rocker": "free"}


def test_a_slide_runs_through_the_origin_of_its_body():
    linkage = read(QUICK_RETURN)
    assert [dyad.kind for dyad in linkage.dyads] == ["RPR", "RRP"]
    assert linkage.bodies["frame"].points["guide"] == (0.0, 0.25)
    assert linkage.bodies["ram"].points["guide"] == (None, None)
    assert linkage.joints["guide"].bodies == ("frame", "ram")


def test_the_short_form_is_the_linkage_of_a_slider_crank():
    linkage = linkage_of_slider_crank(jg.load_mechanism("erkaya2009"))
    assert [joint.name for joint in linkage.loose] == ["crank_pin", "piston_pin"]
    assert [dyad.kind for dyad in linkage.dyads] == ["RRP"] and linkage.crank == "crank"
    assert linkage.joints["piston_pin"].bodies == ("slider", "rod")


COULOMB = {"name": "slider_coulomb_friction", "parameters": {"force_N": 5.0}}
REFUSED = {
    "there is no body 'blok'; did you mean 'block'": {"joints__track__slide": ["rocker", "blok"]},
    "joints.guide: guide is a point of frame; give the slide": {
        "frame__points__guide": ["0 mm", "0 mm"]
    },
    "joints.D.journal must be rod or ram": {"joints__D__journal": "crank"},
    "bodies.rod: it turns; give its inertia": {"bodies__rod__inertia": None},
    "point D belongs to rocker, rod and ram; a joint connects two bodies": {
        "bodies__rocker__length": None,
        "bodies__rocker__ends": None,
        "bodies__rocker__points": {"C": ["0 m", "0 m"], "B": ["0.5 m", "0 m"], "D": ["1 m", "0 m"]},
    },
    "length without ends; a link needs both": {"bodies__rod__ends": None},
    "needs either length with ends, or points": {
        "bodies__rod__length": None,
        "bodies__rod__ends": None,
    },
    "there is no point 'E'": {"joints__E": QUICK_RETURN["joints"]["D"]},
    "contact of D: no entry 'brass' in contacts": {"joints__D__contact": "brass"},
    "frame does not move": {"bodies__frame": QUICK_RETURN["bodies"]["ram"]},
    "rod cannot slide on itself": {"joints__track__slide": ["rod", "rod"]},
    "'slider_coulomb_friction': no such effect of this linkage; did you mean": {
        "effects": [COULOMB]
    },
    "effects: gravity at all bodies is listed more than once": {
        "effects": [{"name": "gravity"}, {"name": "gravity"}]
    },
    "joints.B: B is a point of rocker and rod; give the slide another name": {
        "joints__B": {"slide": ["frame", "ram"]}
    },
    "bodies.rod: B and D are at the same place; give them a distance": {
        "bodies__rod__length": None,
        "bodies__rod__ends": None,
        "bodies__rod__points": {"B": ["0 m", "0 m"], "D": ["0 m", "0 m"]},
        "bodies__rod__mass_centre": None,
    },
    "bodies.crank: O and A are at the same place": {
        "bodies__crank__length": None,
        "bodies__crank__ends": None,
        "bodies__crank__points": {"O": ["0 m", "0 m"], "A": ["0 m", "0 m"]},
        "bodies__crank__mass_centre": None,
    },
    "slide D_normal and joint D would both have the column D_normal_force; rename one": {
        "joints__guide": None,
        "joints__D_normal": QUICK_RETURN["joints"]["guide"],
    },
    "bodies.rod.mass_centre = '200 kg': has the unit 'kilogram' and requires m": {
        "bodies__rod__mass_centre": "200 kg"
    },
    "must be a distance, or a point [x, y]": {"bodies__rod__mass_centre": ["1 mm"]},
    "length, clearance and contact without width; a loose slide needs all": {
        "joints__guide__length": "0.1 m",
        "joints__guide__clearance": "1 mm",
        "joints__guide__contact": "steel",
    },
    "a loose slide needs the frame as carrier, not rocker": {
        "joints__track__length": "0.1 m",
        "joints__track__width": "0.05 m",
        "joints__track__clearance": "1 mm",
        "joints__track__contact": "steel",
    },
    "contact needs a stiffness; corners have no radii": {
        "joints__guide__length": "0.1 m",
        "joints__guide__width": "0.05 m",
        "joints__guide__clearance": "1 mm",
        "joints__guide__contact": "steel",
    },
    "drive: must be the name of a joint; how it turns": {"drive": {"joint": "O", "kind": "free"}},
    "unknown key 'bodies.rod.angel'; did you mean 'angle'": {"bodies__rod__angel": "10 deg"},
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_cannot_be_meant_is_refused_with_key_value_and_way_out(message):
    with pytest.raises(InputError) as error:
        read(QUICK_RETURN, **REFUSED[message])
    assert message in str(error.value)
    assert "mine.yaml" in str(error.value) or message.startswith("bodies.")


def test_a_point_of_one_body_only_is_no_joint():
    with pytest.raises(InputError, match=r"joints\.P: P is a point of coupler only; name a"):
        read(
            FOUR_BAR,
            bodies__coupler__length=None,
            bodies__coupler__ends=None,
            bodies__coupler__points={
                "A": ["0 m", "0 m"],
                "B": ["0.4 m", "0 m"],
                "P": ["0.2 m", "0 m"],
            },
            joints__P=FOUR_BAR["joints"]["A"],
        )


@pytest.mark.parametrize(
    ("body", "other", "message"),
    [
        ("crank", "lead", None),
        ("rocker", "crank", "body crank is not the driven one"),
    ],
)
def test_a_body_called_crank_is_the_driven_one(body, other, message):
    text = yaml.safe_dump(FOUR_BAR)
    data = yaml.safe_load(text)
    if message:  # the driven body is lead, another one crank
        data["bodies"]["lead"] = data["bodies"].pop("crank")
        data["joints"]["A"]["journal"] = "lead"
    data["bodies"][other] = data["bodies"].pop(body)
    if not message:
        data["joints"]["A"]["journal"] = other
        assert validate(LinkageFile, data, "mine.yaml").bodies[other]
        return
    with pytest.raises(InputError, match=message):
        validate(LinkageFile, data, "mine.yaml")


def test_a_joint_called_shaking_is_refused():
    data = yaml.safe_load(
        yaml.safe_dump(FOUR_BAR).replace("- B", "- shaking").replace(" B:", " shaking:")
    )
    with pytest.raises(InputError, match="joint shaking and the frame would both have the column"):
        validate(LinkageFile, data, "mine.yaml")
