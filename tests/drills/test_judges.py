"""Every judge notices the fault that is planted for it, and nothing where there is none."""

import base64
import json
import math

import numpy as np
import pytest

from drills import configurations, data_files, documents, formulas
from drills.full_disk import half_written, told
from drills.harness import Sitting
from drills.kills import other
from drills.names import crashed_in
from drills.pages import live
from drills.plain_quantities import read
from jointgap.rig.recording import Recording

READ = configurations.load


def read_as(reader, text, monkeypatch, tmp_path):
    """Answers about a configuration `text` when a `reader` makes something of it."""
    monkeypatch.setattr(configurations, "load", reader)
    case = {"kind": "config", "content": base64.b64encode(text.encode()).decode()}
    return configurations.judge(case, tmp_path)


CONFIG = """
mechanism: {base: mechanism.yaml, slider: {mass: 448.2 g, offset: -2 mm}}
scenarios:
  one: {simulate: {speed: 600 rpm}}
"""


def test_a_reader_that_reads_rightly_has_no_failure(monkeypatch, tmp_path):
    answers = read_as(READ, CONFIG, monkeypatch, tmp_path)
    assert len(answers) == 3
    assert set(answers.values()) == {None}


def test_a_reader_that_loses_a_minus_is_found(monkeypatch, tmp_path):
    def careless(kind, path):
        path.write_text(path.read_text().replace("-2 mm", "2 mm"))
        models = READ(kind, path)
        path.write_text(CONFIG)
        return models

    answers = read_as(careless, CONFIG, monkeypatch, tmp_path)
    assert "another size" in answers["what is accepted means what is written"].kind


def test_a_reader_that_raises_a_key_error_is_found(monkeypatch, tmp_path):
    def raising(kind, path):
        raise KeyError("slider")

    (complaint,) = read_as(raising, CONFIG, monkeypatch, tmp_path).values()
    assert complaint.kind.startswith("KeyError in")


def test_a_reader_that_takes_the_last_of_two_keys_is_found(monkeypatch, tmp_path):
    text = CONFIG.replace("{mass: 448.2 g,", "{mass: 1 kg, mass: 448.2 g,")

    def last(kind, path):
        path.write_text(CONFIG)
        models = READ(kind, path)
        path.write_text(text)
        return models

    answers = read_as(last, text, monkeypatch, tmp_path)
    assert "written twice" in answers["what is accepted means what is written"].kind


def test_a_key_that_is_new_in_a_schema_is_written_by_itself():
    root = json.loads(json.dumps(documents.schema("config")))
    root["$defs"]["Slider"]["properties"]["stickiness"] = {
        "unit": "m",
        "anyOf": [{"type": "number"}],
        "examples": [0.5],
    }
    texts = []
    for n in range(20):
        writer = documents.Writer(Sitting().random("new", n), root)
        whole = documents.Pairs([("mechanism", documents.shipped("config/mechanisms/erkaya2009.yaml"))])
        texts.append(documents.written(writer.vary(whole, [root], more=0.5)))
    assert any("stickiness:" in text for text in texts)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("7 mm", "m", 0.007),
        ("\N{MINUS SIGN}7 mm", "m", -0.007),
        ("600 rpm", "rad/s", 20 * math.pi),
        ("2 N\N{MIDDLE DOT}m", "N*m", 2.0),
        ("1 kg\N{MIDDLE DOT}m\N{SUPERSCRIPT TWO}", "kg*m^2", 1.0),
        ("turn/3600", "rad", math.tau / 3600),
        ("5 %", "", 0.05),
        ("1e3", "m", 1000.0),
    ],
)
def test_the_independent_reading_reads_what_people_write(text, unit, value):
    assert read(text, unit).value == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("1 500 mm", "m"),
        ("7 kg", "m"),
        ("7 * 2 mm", "m"),
        ("10 Hz", "rad/s"),
        ("7 8", "m"),
        ("nan", ""),
        ("7,5 mm", "m"),
    ],
)
def test_the_independent_reading_reads_nothing_else(text, unit):
    assert read(text, unit) == (None, True)


# ----------------------------------------------------------------------------------------------------------------------


def recording(case, **changes):
    """What a reader makes of the samples of a `case`, with `changes` to channels."""
    truth = data_files._of_cells(case["truth"])
    values = {
        name: np.array(truth[column], float) * data_files.UNITS[name][1] for name, column in data_files.HEADINGS.items()
    }
    values |= {name: change(values[name]) for name, change in changes.items()}
    channels = {name: values[name] for name in ("slider_acceleration", "crank_torque")}
    return Recording("one", values["time"], values["crank_angle"], channels, {}, np.zeros(len(truth["t"]), bool))


@pytest.fixture
def sheet():
    """A file of samples without damage."""
    plain = data_files._Sheet(np.random.default_rng(0))
    truth = {"headings": plain.headings, "cells": plain.cells, "separator": plain.separator, "decimal": plain.decimal}
    return {"kind": "csv", "truth": truth}


def test_samples_that_are_read_rightly_are_no_failure(sheet):
    assert data_files.compare(sheet, recording(sheet)) is None


@pytest.mark.parametrize(
    ("change", "kind"),
    [
        (lambda values: np.abs(values), "another number"),
        (lambda values: np.where(np.arange(values.size) == 5, np.nan, values), "a gap"),
        (lambda values: values * 1e-3, "another number"),
    ],
)
def test_samples_that_are_read_wrongly_are_found(sheet, change, kind):
    assert kind in data_files.compare(sheet, recording(sheet, crank_torque=change)).kind


def test_text_that_is_read_as_a_number_is_found(sheet):
    read_before = recording(sheet)
    sheet["truth"]["cells"][3][2] = "1.5 mm"
    assert "no number is read" in data_files.compare(sheet, read_before).kind


def test_a_formula_with_another_value_is_found():
    points = zip(*formulas.POINTS.values(), strict=True)
    right = np.array([-v * abs(v) + math.sin(theta) for v, _, _, theta, _ in points])
    assert formulas._other_value(right, "-v * abs(v) + sin(theta)", {}) is None
    assert "another value" in formulas._other_value(-right, "-v * abs(v) + sin(theta)", {}).kind
    assert "cannot read" in formulas._other_value(right, "__import__('os')", {}).kind
    assert formulas._other_value(right * math.inf, "sqrt(0 - 1) + v * 0", {}) is None
    assert "another value" in formulas._other_value(right, "sqrt(0 - 1) + v * 0", {}).kind


def test_a_coefficient_that_is_called_as_a_number_may_be_refused():
    case = {"formula": "v/1", "python": "v / 1", "coefficients": {"1": 2.0}}
    assert formulas._refused(case, "coefficient '1' cannot be told from the formula's own words") == {}


# ----------------------------------------------------------------------------------------------------------------------

PLAIN = "<html><body><p>a name</p></body></html>"


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("<script>alert(1)</script>", "live element script"),
        ("<p onmouseover=alert(1)>x</p>", "live element p"),
        ("<a href='javascript:alert(1)'>x</a>", "runs a script"),
        ("<b>x</b>", "markup"),
        ("canary", "takes in a file"),
    ],
)
def test_a_page_with_a_live_name_is_found(name, kind):
    assert kind in live(PLAIN.replace("a name", name), PLAIN, "canary").kind


def test_a_page_that_shows_a_name_as_it_is_has_no_failure():
    assert live(PLAIN.replace("a name", "&lt;script&gt;alert(1)&lt;/script&gt; <code>b</code>"), PLAIN) is None


def test_what_differs_after_a_kill_is_found():
    wanted = {"a.parquet": "1", "b.parquet": "2"}
    assert other(wanted, wanted) is None
    assert "missing" in other({"a.parquet": "1"}, wanted).kind
    assert "more results" in other({**wanted, "c.parquet": "3"}, wanted).kind
    assert "differ" in other({**wanted, "b.parquet": "3"}, wanted).kind


def test_an_error_of_a_full_disk_names_its_cause():
    good = "jointgap: error: disk/results/a.parquet: cannot be written (No space left on device); check permission"
    assert told(good) is None
    assert "not told" in told("").kind
    assert "does not name the cause" in told("jointgap: error: disk/results/a.parquet: failed").kind
    assert "traceback" in told("Traceback (most recent call last):\nOSError: [Errno 28] No space left on device").kind
    assert crashed_in("all is well") is None


def test_a_half_written_file_is_found(tmp_path):
    (tmp_path / "mine.json").write_text("{")
    assert half_written(tmp_path, {}) == "mine.json"
    (tmp_path / "mine.json").unlink()
    (tmp_path / ".mine-x1.json").touch()
    assert half_written(tmp_path, {}) == ".mine-x1.json"
