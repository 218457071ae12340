"""Settings that are given to an analysis reach every stage: what they change comes out differently."""

from dataclasses import replace

import pytest

from benchmarks.project import ROOT
from jointgap.campaign import stages
from jointgap.campaign.analyse import analyse
from jointgap.campaign.state import CampaignState
from jointgap.identification.settings import DEFAULT_SETTINGS

DEMONSTRATION = ROOT / "config/campaigns/demonstration.yaml"


def state_with(chain, folder, settings=DEFAULT_SETTINGS) -> CampaignState:
    """A campaign whose model is the closed form of `chain` instead of a slider-crank."""
    state = CampaignState(DEMONSTRATION, folder, settings)
    state.model, state.doubted_channels = chain.model, ()
    return state


def with_changed(group: str, **numbers):
    return replace(DEFAULT_SETTINGS, **{group: replace(getattr(DEFAULT_SETTINGS, group), **numbers)})


def test_an_effect_has_to_gain_as_much_as_the_settings_ask_for(chain, tmp_path):
    assert chain.outcome.verdict == "named"
    demanding = state_with(chain, tmp_path, with_changed("decision", min_delta_bic=1e9))
    demanding.noise, demanding.noise_with_numerics = chain.noise, chain.noise
    stages.recalibrate(demanding)
    stages.screen(demanding)
    stages.fit(demanding)
    stages.pair(demanding)
    stages.decide(demanding)
    assert demanding.outcome("decide").verdict != "named"


def test_noise_is_compared_with_what_is_stated_by_the_settings(chain, tmp_path):
    tolerant, strict = (
        state_with(chain, tmp_path / name, with_changed("noise", reported_mismatch=factor))
        for name, factor in (("tolerant", 1e6), ("strict", 1.0))
    )
    for state in (tolerant, strict):
        stages.measure(state, pictures=False)
        stages.noise(state)
    assert not any("is stated to have" in text for each in tolerant.noise.values() for text in each.remarks)
    assert any("is stated to have" in text for each in strict.noise.values() for text in each.remarks)


def test_intervals_of_a_confirmation_come_from_as_many_samples_as_the_settings_say(chain, tmp_path):
    widths = {}
    for draws in (1, 400):
        state = state_with(chain, tmp_path / str(draws), with_changed("confirmation", draws=draws))
        state.noise_with_numerics, state.baseline, state.screening = chain.noise, chain.recalibrated, chain.screening
        state.verdict_baseline = chain.recalibrated
        state.write_fits([chain.recalibrated.base], "decide/base")
        state.write_outcome(chain.outcome, "regress")
        stages.confirm(state)
        gap = state.folder.read("gaps").query("role == 'confirm' and run == 'all'").iloc[0]
        widths[draws] = gap["after_high"] - gap["after_low"]
    assert widths[1] == 0.0
    assert widths[400] > 0.0


def test_an_analysis_gives_its_settings_to_every_stage(tmp_path, monkeypatch):
    given = with_changed("decision", min_delta_bic=20.0)

    class Reached(Exception):
        pass

    def check(state, **_):
        assert state.settings is given
        raise Reached

    monkeypatch.setitem(stages.CAMPAIGN_STAGES, "noise", replace(stages.CAMPAIGN_STAGES["noise"], function=check))
    with pytest.raises(Reached):
        analyse(DEMONSTRATION, tmp_path, settings=given)
