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
    state.model, state.inconsistent_channels = chain.model, ()
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
