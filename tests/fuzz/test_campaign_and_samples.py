"""Randomly damaged data files are refused by name or read correctly where undamaged."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jointgap.config.load import load_campaign
from jointgap.core.errors import InputError
from jointgap.rig.inspection import _numbers
from jointgap.rig.read_files import read_measurements
from jointgap.rig.recording import to_frame
from tests.fuzz.command import damaged, fuzz
from tests.rig.recorded_files import CAMPAIGN, table, write_rig

pytestmark = pytest.mark.slow

COUNT = 48
GOOD = table(200, count=COUNT)
LINES = GOOD.to_csv(index=False).splitlines()
JUNK = "nan inf -inf 1e400 1e300 -1e15 1e-320 -- x 1_0 1,5 1;5 \" ' # ٣".split()
JUNK += ["", "\t", "\x00", "5 mm"]
ENCODINGS = ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "latin-1", "utf-32"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("rig")


@pytest.fixture(scope="module")
def campaign(folder):
    return load_campaign(write_rig(folder))


def read_or_refused(folder, campaign, content: bytes, touched: set[int] | None):
    """Read the slow run from `content`: refused by its name, or right in all samples but the
    `touched` (None: all are).
    """
    (folder / "slow.csv").write_bytes(content)
    try:
        measurements = read_measurements(campaign)
    except InputError as error:
        assert str(folder / "slow.csv") in str(error)
        return
    to_frame(measurements)
    recording = measurements.runs["slow"]
    _numbers(campaign.runs[0], recording)  # it can be inspected
    assert np.isfinite(recording.time).all()
    assert (np.diff(recording.time) > 0).all()
    if touched is None:
        return
    for sample, time in enumerate(recording.time):
        origin = int(np.argmin(np.abs(GOOD.t - time)))
        if GOOD.t[origin] == time and origin not in touched:
            assert recording.channels["crank_torque"][sample] == GOOD.M[origin]
            assert recording.channels["slider_position"][sample] == pytest.approx(
                1e-3 * GOOD.x[origin], rel=1e-14
            )
            exact = np.cos(np.radians(GOOD.theta[origin]))
            assert np.isclose(np.cos(recording.crank_angle[sample]), exact, atol=1e-9)


def joined(lines) -> bytes:
    return ("\n".join(lines) + "\n").encode()


rows = st.integers(0, COUNT - 1)


@fuzz
@given(
    st.lists(
        st.tuples(rows, st.integers(0, 3), st.sampled_from(JUNK) | st.text(max_size=6)),
        min_size=1,
        max_size=4,
    )
)
def test_text_put_into_cells(folder, campaign, damages):
    lines = list(LINES)
    for row, column, text in damages:
        cells = lines[row + 1].split(",")
        cells[min(column, len(cells) - 1)] = text
        lines[row + 1] = ",".join(cells)
    content = ("\n".join(lines) + "\n").encode("utf-8", "surrogatepass")
    read_or_refused(folder, campaign, content, {row for row, _, _ in damages})


@fuzz
@given(st.sets(st.integers(0, COUNT), max_size=COUNT))
def test_lines_lost(folder, campaign, lost):
    content = joined(line for place, line in enumerate(LINES) if place not in lost)
    read_or_refused(folder, campaign, content, set())


@fuzz
@given(
    st.sampled_from([";", "\t", "|", " ", ":", "%", ",,", " , "]),
    st.booleans(),
    st.sampled_from(ENCODINGS),
)
def test_other_separators_decimal_marks_and_encodings(folder, campaign, separator, comma, encoding):
    lines = [line.replace(",", separator) for line in LINES]
    if comma:
        lines = [line.replace(".", ",") for line in lines]
    read_or_refused(folder, campaign, ("\n".join(lines) + "\n").encode(encoding), set())


@fuzz
@given(
    st.lists(
        st.tuples(st.integers(0, len(joined(LINES)) - 1), st.integers(0, 255)),
        min_size=1,
        max_size=5,
    )
)
def test_bytes_overwritten(folder, campaign, damages):
    content = bytearray(joined(LINES))
    touched = set()
    for place, byte in damages:
        touched |= {content[:place].count(b"\n") - 1 + shift for shift in (-1, 0, 1)}
        content[place] = byte
    read_or_refused(folder, campaign, bytes(content), touched)


FULL = CAMPAIGN | {
    "drive": "motor",
    "motor": {"stall_torque": "12 N*m", "no_load_speed": "700 rpm", "inertia": 0.1},
    "nuisance": {"slider_mass": "5 %", "restitution": [0.3, 0.9], "speed": "1 %"},
    "csv": {"separator": ",", "decimal": "."},
}


@settings(fuzz, max_examples=150)
@given(damaged(FULL))
def test_a_damaged_campaign_file_is_read_or_refused(folder, text):
    write_rig(folder)
    (folder / "damaged.yaml").write_bytes(text.encode("utf-8", "surrogatepass"))
    try:
        read_measurements(load_campaign(folder / "damaged.yaml"))
    except InputError as error:
        assert str(folder) in str(error)
