"""The committed data of the example campaigns are those that their script writes."""

import pandas as pd

from examples import demonstration
from tests.config.mechanisms import ROOT


def test_the_script_writes_the_committed_data(tmp_path, monkeypatch):
    campaigns = ROOT / "config/campaigns"
    for name in demonstration.HIDDEN:
        text = (campaigns / f"{name}.yaml").read_text()
        (tmp_path / f"{name}.yaml").write_text(
            text.replace("../mechanisms", f"{ROOT}/config/mechanisms")
        )
    monkeypatch.setattr(demonstration, "CAMPAIGNS", tmp_path)
    demonstration.main()
    for name in demonstration.HIDDEN:
        written = sorted((tmp_path / name).glob("*.csv"))
        assert [path.name for path in written] == ["fast.csv", "mid.csv", "slow.csv"]
        for path in written:
            committed = pd.read_csv(campaigns / name / path.name)
            # a few steps of the last digit, by rounding on another machine
            pd.testing.assert_frame_equal(pd.read_csv(path), committed, rtol=0.0, atol=5e-3)
