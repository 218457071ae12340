"""The global optimiser as a comparison method."""

import pytest

pytest.importorskip("cma", reason="needs pymoo's cma: the extra learn")

from jointgap.core.candidates import Parameter
from validation.benchmark import optimiser
from validation.kinds import Trial
from validation.trial import make_trial


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place = tmp_path_factory.mktemp("campaign")
    hidden = ("slider_constant_force",)
    make_trial(Trial("single", "ideal", 8.0, hidden, number=3, id="0123456789ab"), 5, place)
    return place


@pytest.mark.slow
def test_the_global_optimiser_finds_the_hidden_effect(folder):
    named, bic = optimiser.optimiser_names(folder / "campaign.yaml", 25.0)
    assert named == ["slider_constant_force"]
    assert bic["base"] > bic["slider_constant_force"] + 100.0


def test_scaled_coordinates_are_invertible():
    for parameter, amplitude in (
        (Parameter("force", 0.0, step=0.5), True),
        (Parameter("length", 0.0, -0.01, 0.02, 1e-3), True),
        (Parameter("mass", 1.0, 0.9, 1.2), False),
        (Parameter("frequency", 1.0, 0.1, 100.0), False),
        (Parameter("free", 2.0), False),
    ):
        place, value = optimiser.scale(parameter, amplitude)
        for x in (parameter.nominal, parameter.nominal + 0.01):
            assert -1.0 <= place(x) <= 1.0
            assert value(place(x)) == pytest.approx(x, abs=1e-12)
    _, value = optimiser.scale(Parameter("force", 0.0, step=0.5), True)
    assert (value(-1.0), value(1.0)) == (pytest.approx(-300.0), pytest.approx(300.0))
    assert value(0.5) < 20.0
