"""Markup and shell as names, headings and descriptions: refused, or shown as what they are."""

import csv
import io
import json
import re
import time
from pathlib import Path

import numpy as np

from drills.documents import ROOT
from drills.harness import Answers, Case, Complaint, Drill, Failure, Row, Sitting, Sweep, crashed, unclear
from drills.pages import live
from drills.project import clean_folder, jointgap, snakemake

CANARY = "canary-of-the-drills"
HARMLESS = "a plain name"
_CANARY_FILE = "drill-canary.txt"
_SHELL_FILE = "drill-was-here"

_CLEAR = "ends in a clear error or a result"
_DEAD = "pages hold no markup that comes of a name"
_ANALYSED = "the pages of a campaign hold no markup of its headings and files"
_SHELL = "no shell obeys the path of a campaign or of its files"

NAMES = [
    "<script>alert(1)</script>", "<img src=x onerror=alert(1)>", "<svg/onload=alert(1)>",
    "</title><script>alert(1)</script>", "</script><script>alert(1)</script>", "<iframe src=javascript:alert(1)>",
    "\" onmouseover=\"alert(1)", "' onmouseover='alert(1)", "<a href='javascript:alert(1)'>x</a>", "<!--", "-->",
    "<![CDATA[<b>]]>", "&lt;script&gt;alert(1)&lt;/script&gt;", "&#60;b&#62;", "`<b>x</b>`", "``<b>x</b>``",
    "`a` `<script>alert(1)</script>`", "`", "a`b", "**bold**", "*it*", "__x__", "# head", "- point", "1. point",
    "| a | b |", "[x](javascript:alert(1))", "![x](http://example.org/x.png)", "<http://example.org>",
    "<javascript:alert(1)>", "[x]: javascript:alert(1)", "\\<b>", "\\\\<b>x", "\\`<b>`",
    ".. raw:: html\n\n   <script>alert(1)</script>", "x\n\n.. raw:: html\n\n   <script>alert(1)</script>\n\ny",
    f"x\n\n.. include:: {_CANARY_FILE}\n", f"x\n\n.. raw:: html\n   :file: {_CANARY_FILE}\n",
    f"x\n\n.. literalinclude:: {_CANARY_FILE}\n", f"x\n\n.. csv-table::\n   :file: {_CANARY_FILE}\n",
    "`x <javascript:alert(1)>`_", "|x|\n\n.. |x| raw:: html\n\n   <script>alert(1)</script>", ":raw:`x`",
    "x\n\n.. role:: r(raw)\n   :format: html\n\n:r:`<script>alert(1)</script>`", ".. image:: javascript:alert(1)",
    "=====\nHead\n=====", "::\n\n   x", "x_", "|x|", "[1]_", "{{ 7 * 7 }}", "{% for x in () %}",
    "{{ snakemake.config }}", "{% raw %}", "{# x #}", "{{", "{x}", "{0}", "{", "}", "%s", "%(x)s", "${x}", "$HOME",
    f"$(touch {_SHELL_FILE})", f"`touch {_SHELL_FILE}`", f"; touch {_SHELL_FILE} #", f"' ; touch {_SHELL_FILE} ; '",
    f'" ; touch {_SHELL_FILE} ; "', f"| touch {_SHELL_FILE}", f"&& touch {_SHELL_FILE}", f"\n touch {_SHELL_FILE}\n",
    "-rf", "--help", "-", "~", "*", "?", "!", "#", "..", ".", "../../etc/passwd", "/etc/passwd", "con", "nul", "a/b",
    "a\\b", " ", "  x  ", "\t", "a\tb", "a\nb", "a\r\nb", "\x00", "a\x00b", "\x1b[31mred", "\x07", "\x7f",
    "\u202egnp.exe", "\u200f\u05e9\u05dc\u05d5\u05dd", "\u0645\u0631\u062d\u0628\u0627", "😀", "👩‍🔬", "e\u0301",
    "\ufeffx", "\u200b", "\u2028", "\x85", "\ufffe", "𝕏", "ſ", "İ", "ß", "Ω", "z" * 255, "z" * 300, "z" * 5000,
    "<b>" * 2000, "$x^2$", "$\\frac{1}{0}$", "\\input{x}", "$", "$$", "_", "^", "null", "true", "1", "1.5", "01",
    "2026-03-01", "yes", "", "all", "look", "=1+1", "@x", "+x",
]  # fmt: skip
"""Texts that some reader of text obeys."""

PLACES = {
    "scenario": "scenario",
    "description": "config",
    "box": "config",
    "contact": "config",
    "vary": "config",
    "run list": "config",
    "mechanism": "config",
    "effect": "config",
    "coefficient": "config",
    "campaign": "campaign",
    "run": "campaign",
    "heading": "campaign",
    "file": "campaign",
    "channel": "campaign",
    "unit": "campaign",
    "folder": "campaign",
    "key": "config",
}
"""Where a name is written, and in which kind of file."""


def make(random: np.random.Generator) -> Case:
    """A name, two joined now and then, and its place."""
    name = NAMES[int(random.integers(len(NAMES)))]
    if random.random() < 0.2:
        name += NAMES[int(random.integers(len(NAMES)))]
    return {"place": list(PLACES)[int(random.integers(len(PLACES)))], "name": name}


def prepare() -> None:
    """Load what reads and shows."""
    import markdown_it  # noqa: F401

    from jointgap.config.load import load_campaign, resolve  # noqa: F401
    from jointgap.paper.pages import comparison_page  # noqa: F401
    from jointgap.rig.read_files import read_measurements  # noqa: F401


def config(place: str, name: str) -> str:
    """A configuration, as JSON, which is YAML, with a `name` in a `place`."""
    mechanism: object = str(ROOT / "config/mechanisms/erkaya2009.yaml")
    over: dict = {"description": name if place == "description" else "one sentence"}
    boxes = {"paper": None, "wide": None, name: {"crank_length": [0.147, 0.153], "rod_length": [0.555, 0.5649]}}
    if place == "box":
        over["optimise"] = {"boxes": boxes}
    if place == "vary":
        over["ensemble"] = {"vary": {name: [1, 2]}}
    if place == "mechanism":
        mechanism = name
    if place == "contact":
        steel = {"restitution": 0.46}
        mechanism = {"base": mechanism, "contacts": {name: steel}, "joints": {"crank_pin": {"contact": name}}}
    if place in ("effect", "coefficient"):
        formula = {
            "formula": "-a*v" if place == "coefficient" else name,
            "coefficients": {name if place == "coefficient" else "a": 1.0},
        }
        mechanism = {"base": mechanism, "effects": [{"name": "discovered_slider_force", "parameters": formula}]}
    content = {"mechanism": mechanism, "scenarios": {name if place == "scenario" else "one": over}}
    if place == "run list":
        content["run"] = [name]
    if place == "key":
        content[name] = 1
    return _yaml(content)


def _yaml(content: object) -> str:
    """JSON that YAML reads too: without pairs of surrogates, without signs that YAML refuses unescaped."""
    text = json.dumps(content, ensure_ascii=False)
    return re.sub(
        r"[^\x20-\x7e\xa0-\ud7ff\ue000-\ufdff\U00010000-\U0010ffff]", lambda sign: f"\\u{ord(sign[0]):04x}", text
    )


def campaign(place: str, name: str, folder: Path) -> str:
    """A campaign file, its samples in `folder`, with a `name` in a `place`."""
    heading = name if place == "heading" else "torque_Nm"
    file = name if place == "file" else "slow.csv"
    where = ROOT / "config/campaigns/demonstration"
    for run in ("slow", "mid", "fast"):
        rows = list(csv.reader((where / f"{run}.csv").read_text().splitlines()))
        rows[0] = [heading if cell == "torque_Nm" else cell for cell in rows[0]]
        rows[len(rows) // 2][rows[0].index(heading)] = (
            "1e9" if run == "slow" else rows[len(rows) // 2][rows[0].index(heading)]
        )
        text = io.StringIO()
        csv.writer(text).writerows(rows)
        try:
            (folder / (file if run == "slow" else f"{run}.csv")).write_text(text.getvalue(), encoding="utf-8")
        except (OSError, ValueError):  # no file can be called so
            continue
    channels = {
        "time": {"column": "t_ms", "unit": "ms"},
        "crank_angle": {"column": "angle_deg", "unit": "deg", "noise": 0.1},
        "crank_torque": {"column": heading, "unit": name if place == "unit" else "N*m"},
        "slider_acceleration": {"column": "acc_g", "unit": "g_n"},
    }
    if place == "channel":
        channels[name] = {"column": "x", "unit": "m"}
    content = {
        "name": name if place == "campaign" else "mine",
        "mechanism": str(ROOT / "config/mechanisms/ideal_joints.yaml"),
        "runs": [
            {"id": name if place == "run" else "slow", "file": file, "speed": "150 rpm", "role": "identify"},
            {"id": "mid", "file": "mid.csv", "speed": "280 rpm", "role": "identify"},
            {"id": "fast", "file": "fast.csv", "speed": "400 rpm", "role": "confirm"},
        ],
        "channels": channels,
        "nuisance": {"slider_mass": "5 %", "rod_mass": "5 %"},
    }
    if place == "folder":
        content["folder"] = name
    return _yaml(content)


def judge(case: Case, folder: Path) -> Answers:
    """Read a file with the name in its place, and look at the pages that come of it."""
    from jointgap.core.errors import InputError

    place, name = case["place"], case["name"]
    try:
        if PLACES[place] == "campaign":
            return {_CLEAR: None, _DEAD: _of_campaign(place, name, folder)}
        return {_CLEAR: None, _DEAD: _of_config(place, name, folder)}
    except InputError as error:
        return {_CLEAR: unclear(str(error), _file_in(str(error), case["name"], folder))}
    except Exception as error:
        return {_CLEAR: crashed(error)}


def _of_config(place: str, name: str, folder: Path) -> Complaint | None:
    from jointgap.config import read_yaml, resolve

    path = folder / "drill.yaml"
    path.write_text(config(place, name), encoding="utf-8")
    scenarios = resolve(read_yaml(path), (folder,), str(path))
    key, scenario = next(iter(scenarios.items()))
    if place == "scenario" and not re.fullmatch(r"[\w-]+", key):
        return Complaint("a scenario may be called so, and its folder", repr(key))
    plain = scenario.model_copy(update={"description": HARMLESS if scenario.description else ""})
    return _alive(_comparison(scenario, name), _comparison(plain, HARMLESS))


def _comparison(scenario, name: str):
    """The page of comparison with a `name` wherever a table may hold one."""
    import pandas as pd

    from jointgap.paper.pages import comparison_page

    row = {"unit": name, "paper": 1.0, "ours": 2.0, "ratio": 2.0, "verdict": "agrees", "sentence": f"In box {name}."}
    rows = [
        {"kind": "number", "item": name} | row,
        {"kind": "claim", "item": f"L2, {name}"} | row | {"verdict": "holds"},
    ]
    return comparison_page(pd.DataFrame(rows), scenario)


def _of_campaign(place: str, name: str, folder: Path) -> Complaint | None:
    from jointgap.config.load import load_campaign
    from jointgap.core.page import Bullets, Heading, Page
    from jointgap.rig.read_files import read_measurements

    pages = []
    for each in (HARMLESS, name):
        own = folder / ("plain" if each is HARMLESS else "hostile")
        own.mkdir()
        path = own / "drill.yaml"
        path.write_text(campaign(place, each, own), encoding="utf-8")
        if each is HARMLESS and place in ("campaign", "run", "channel", "unit", "folder"):
            continue  # refused, as it should be
        measured = read_measurements(load_campaign(path))
        pages.append(Page(f"Campaign {each}", (Heading(each), Bullets(measured.remarks))))
    return _alive(pages[-1], pages[0])


def _alive(page, harmless) -> Complaint | None:
    """What is alive in a page, as HTML or as Markdown that a reader of Markdown shows."""
    from markdown_it import MarkdownIt

    from jointgap.core.page import to_html, to_markdown

    shown = MarkdownIt("commonmark", {"html": True}).enable("table").render
    return live(to_html(page), to_html(harmless)) or _in_markdown(
        shown(to_markdown(page)), shown(to_markdown(harmless))
    )


def _in_markdown(html: str, harmless: str) -> Complaint | None:
    found = live(html, harmless)
    return None if found is None else Complaint(f"in Markdown, {found.kind}", found.details)


# ----------------------------------------------------------------------------------------------------------------------
# the workflow itself, run as users run it


def _file_in(message: str, name: str, folder: Path) -> str:
    """What an error has to name: the configuration, or the file that it was told to read."""
    return next((file for file in ("drill.yaml", name) if file and file in message), str(folder))


def crashed_in(said: str) -> Complaint | None:
    """A traceback in what a command printed."""
    if "Traceback (most recent call last)" not in said:
        return None
    last = [line for line in said.splitlines() if re.match(r"\w+(\.\w+)*(Error|Exception|Warning)\b", line)]
    return Complaint("a traceback of the workflow", (last or [said[-300:]])[-1][:500])


def _analysed(name: str) -> Complaint | None:
    """The pages of a whole analysis of a campaign with a `name` as heading and as file."""
    with clean_folder(project=False) as folder:
        path = folder / "drill.yaml"
        path.write_text(campaign("heading", name, folder), encoding="utf-8")
        done = jointgap(folder, "analyse", str(path), "--folder", "found")
        if done.returncode:
            return crashed_in(done.stdout + done.stderr)
        pages = [path.read_text(encoding="utf-8") for path in (folder / "found").glob("*.html")]
        found = [
            live(re.sub(r"<img alt='[^']*' src='data:image/png;base64,[^']*'>", "", page), _PAGE) for page in pages
        ]
        return next(filter(None, found), None if pages else Complaint("there is no page", str(done.stdout[-300:])))


def _obeyed(name: str) -> Complaint | None:
    """The workflow on a campaign in a folder, with a file, of that `name`."""
    with clean_folder() as folder:
        own = folder / name.replace("/", "_")
        try:
            own.mkdir()
        except (OSError, ValueError):
            return None  # no folder can be called so
        (own / f"{own.name}.yaml").write_text(campaign("file", f"{own.name}.csv", own), encoding="utf-8")
        given = json.dumps([f"{own.name}/{own.name}.yaml"], ensure_ascii=False)
        target = "results/campaigns/mine/measured/measured.parquet"
        done = snakemake(folder, "--config", f"campaigns={given}", "--quiet", "all", "--", _measured() or target)
        if list(folder.rglob(f"{_SHELL_FILE}*")):
            return Complaint("a shell obeys a name", done.stderr[-500:])
        return crashed_in(done.stdout + done.stderr)


def _measured() -> str:
    from jointgap.campaign.stages import CAMPAIGN_STAGES

    return f"results/campaigns/mine/{next(iter(CAMPAIGN_STAGES['measure'].outputs()))}"


_PAGE = (
    "<html><head><meta><title></title><style></style></head><body><h1><h2><p><ul><li>"
    "<table><thead><tbody><tr><th><td><b><i>"
)
"""Elements that a campaign's page has of its own."""

_WHOLE, _PATHS = 4, 8
_SHELL_NAMES = [name for name in NAMES if _SHELL_FILE in name] + [
    "$HOME",
    "*",
    "{x}",
    "a b",
    "<b>",
    "'",
    '"',
    "😀",
    "-x",
]


def run(sitting: Sitting) -> list[Row]:
    """Names in every place, then some through the workflow."""
    rows = SWEEP.run(sitting)
    random = sitting.random("names of the workflow", 0)
    many = [str(name) for name in random.permutation(NAMES)]
    markup = [name for name in many if "<" in name and len(name) < 100][: sitting.of(_WHOLE)]
    rows.append(_row(_ANALYSED, sitting, ({name: _analysed(name)} for name in markup)))
    shell = [str(name) for name in random.permutation(_SHELL_NAMES)][: sitting.of(_PATHS)]
    rows.append(_row(_SHELL, sitting, ({name: _obeyed(name)} for name in shell)))
    return rows


def _row(question: str, sitting: Sitting, found) -> Row:
    began, row = time.monotonic(), Row(f"names: {question}", seed=sitting.seed)
    for name, complaint in ((name, each) for answers in found for name, each in answers.items()):
        row.count += 1
        if complaint is not None:
            row.failures.append(Failure(question, complaint, row.count, {"place": question, "name": name}))
    row.seconds = time.monotonic() - began
    return row


def judge_again(case: Case) -> Answers:
    """Judge a kept name again."""
    name, place = case["name"], case["place"]
    whole = {_ANALYSED: lambda: _analysed(name), _SHELL: lambda: _obeyed(name)}
    return {place: whole[place]()} if place in whole else SWEEP.judge_again(case)


SWEEP = Sweep("names", 2000, make, judge, prepare)
DRILL = Drill("names", run, judge_again)
