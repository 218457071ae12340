"""The lengths of a campaign's linkage, optimised without and with the identified effects."""

from types import SimpleNamespace

import pytest

import jointgap as jg
from benchmarks.project import ROOT
from jointgap.campaign import page, reoptimise
from jointgap.config import OptimiseLinkage
from jointgap.config.load import load_campaign
from jointgap.core import parquet
from jointgap.core.errors import InputError
from jointgap.core.page import Page, to_markdown
from jointgap.core.schema import CAMPAIGN_OPTIMUM

LENGTHS = {"coupler.length": ("0.35 m", "0.45 m"), "frame.C.y": ("-5 mm", "20 mm")}
OPTIONS = OptimiseLinkage(
    objective="rms_torque",
    lengths=LENGTHS,
    genetic={"population": 8, "generations": 4},
    ensemble={"members": 2, "settled_revolution": 2},
)
IDEAL = jg.load_mechanism("four_bar").with_ideal_joints()
LOOSE = jg.change(IDEAL, {"joints.B.loose": True})


def campaign_with(options, **of_runs):
    campaign = load_campaign(ROOT / "config/campaigns/four_bar.yaml")
    runs = tuple(run.model_copy(update=of_runs) for run in campaign.runs)
    return campaign.model_copy(update={"optimise_linkage": options, "runs": runs})


def models_of(campaign, monkeypatch, sensor=False):
    monkeypatch.setattr(reoptimise, "mechanisms", lambda *_: (IDEAL, LOOSE))
    chosen = SimpleNamespace(hypothesis=[SimpleNamespace(sensor=sensor)])
    return reoptimise.models_to_optimise(campaign, SimpleNamespace(chosen=chosen), {})


def of_angle(objective):
    return OPTIONS.model_copy(update={"objective": objective})


def test_the_models_are_those_whose_optimum_the_effects_may_change(monkeypatch):
    models, speed = models_of(campaign_with(OPTIONS), monkeypatch)
    assert models == {"base": IDEAL, "augmented": LOOSE}
    assert speed == pytest.approx(jg.Simulate(speed="250 rpm").speed)  # fastest that is fitted
    models, _ = models_of(campaign_with(of_angle("transmission_angle")), monkeypatch)
    assert list(models) == ["augmented"]  # the angle of ideal joints depends on the lengths only
    assert models_of(campaign_with(None), monkeypatch)[0] == {}
    assert models_of(campaign_with(OPTIONS), monkeypatch, sensor=True)[0] == {}


def test_each_model_has_the_lengths_that_jointgap_optimise_finds():
    found = reoptimise.optimal_lengths({"base": IDEAL, "augmented": LOOSE}, 26.0, OPTIONS)
    parquet.to_arrow(CAMPAIGN_OPTIMUM, found)
    assert found["length"].tolist() == [*LENGTHS] * 2 and found["failed"].isna().all()
    for name, model in (("base", IDEAL), ("augmented", LOOSE)):
        rows = found[found["model"] == name].set_index("length")
        simulate = reoptimise._simulate(model, 26.0, OPTIONS.ensemble)
        best = jg.optimise(model, simulate, **OPTIONS.model_dump(exclude_unset=True))
        assert rows["optimum"].to_dict() == best.lengths
        assert rows["resimulated"].iloc[0] == best.gain > 0.05
        assert rows["original"].tolist() == [0.4, 0.0]
        assert (rows["after"] / rows["before"]).iloc[0] == pytest.approx(1 - best.gain, rel=0.05)


def test_a_clockwise_crank_has_the_same_optimum_with_coordinates_of_the_file(monkeypatch):
    ahead = reoptimise.optimal_lengths({"base": IDEAL}, 26.0, OPTIONS)
    # of the mirror image with a clockwise crank the motion is the same
    bounds = OPTIONS.lengths | {"frame.C.y": tuple(-y for y in OPTIONS.lengths["frame.C.y"][::-1])}
    options = OPTIONS.model_copy(update={"lengths": bounds})
    back = reoptimise.optimal_lengths({"base": IDEAL}, -26.0, options)
    signs = [1.0, -1.0]
    expected = [sign * value for sign, value in zip(signs, ahead["optimum"], strict=True)]
    assert back["optimum"].tolist() == pytest.approx(expected, abs=1e-12)
    models, speed = models_of(campaign_with(OPTIONS, direction="clockwise"), monkeypatch)
    assert models["base"] == IDEAL.mirrored() and speed < 0.0


def test_a_model_that_cannot_be_optimised_has_the_reason():
    options = OPTIONS.model_copy(update={"largest_force": {"B": 1.0}})
    found = reoptimise.optimal_lengths({"base": IDEAL}, 26.0, options)
    assert found["failed"].iloc[0].startswith("largest_force: no lengths within the bounds keep")


def test_the_page_has_a_row_for_each_length():
    found = reoptimise.optimal_lengths({"base": IDEAL}, 26.0, OPTIONS)
    blocks = page._optimum([{"name": "B_clearance", "site": "B"}], found, campaign_with(OPTIONS))
    text = to_markdown(Page("", tuple(blocks), "", ""))
    assert "| before | ideal joints | coupler.length | 400 |" in text
    assert "Smallest RMS torque of the drive: reduction in the search, and re-simulated." in text
    assert page._optimum([{"name": "B_clearance"}], found.head(0), campaign_with(None)) == []


@pytest.mark.parametrize(
    "options, words",
    [
        ({"lengths": {"cuopler.length": (0.3, 0.4)}}, "lengths.cuopler.length: is no length; did"),
        ({"objective": "Q_peak_force"}, "objective: 'Q_peak_force' is not known"),
        ({"lengths": {"crank.length": (0.3, 0.35)}}, "no lengths satisfy .* give wider bounds"),
    ],
)
def test_wrong_lengths_are_reported_before_the_analysis(options, words):
    options = OptimiseLinkage(**({"lengths": LENGTHS} | options))
    with pytest.raises(InputError, match=f"optimise_linkage: .*{words}"):
        reoptimise.check_lengths(campaign_with(options))


def test_a_slider_crank_has_no_such_key(tmp_path):
    text = (ROOT / "config/campaigns/four_bar.yaml").read_text(encoding="utf-8")
    text = text.replace("../mechanisms/four_bar_without_clearance.yaml", "erkaya2009")
    text = "\n".join(line for line in text.splitlines() if not line.startswith("nuisance"))
    text = text.replace("rocker_angular_velocity", "rod_angular_velocity")
    file = tmp_path / "rig.yaml"
    file.write_text(f"{text}\noptimise_linkage: {{lengths: {{rod.length: [0.5, 0.6]}}}}\n")
    with pytest.raises(InputError, match=r"optimise_linkage is for general linkages; .* remove it"):
        load_campaign(file)
