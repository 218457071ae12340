"""Facts before and after a change."""

from jointgap.core.facts import Fact, changes, document, frame, lines

FACTS = [
    Fact("force_N/crank_pin", 500.0, "N", "force", before=400.0),
    Fact("force_N/crank_pin/after_at_deg", 35.0, "deg", "crank angle of the force"),
    Fact("stroke_mm", None, "mm", before=50.0),
]


def test_a_change_has_both_values_in_every_form():
    assert document(FACTS) == {
        "force_N": {"crank_pin": {"before": 400.0, "after": 500.0, "after_at_deg": 35.0}},
        "stroke_mm": {"before": 50.0, "after": None},
    }
    assert [line.split() for line in lines(FACTS)[::2]] == [
        ["force", "400", "→", "500", "N"],
        ["stroke", "mm", "50.000", "→", "–", "mm"],
    ]
    assert list(frame(FACTS)["before"][[0, 2]]) == [400.0, 50.0]
    assert "before" not in frame(FACTS[1:2])
    assert changes(FACTS[:2]).rows == (
        ("force", "N", "400", "500", "+100", "+25.00"),
        ("crank angle of the force", "deg", "–", "35", "–", "–"),
    )
