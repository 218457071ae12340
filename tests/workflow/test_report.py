"""The HTML report, opened in a browser and clicked through."""

import html
import json
import re

import pytest

from benchmarks.project import SMOKE_REPORT

# Walks through every category of the report (`app` and `categories` are the report's own) and writes down what can
# be read there.
WALK = """
<script>
const pause = () => new Promise(done => setTimeout(done, 300));
(async () => {
    const seen = {};
    await pause();
    seen["start"] = document.body.innerText;
    seen["graphics"] = document.querySelectorAll("#rulegraph canvas, #rulegraph svg").length;
    for (const category of Object.keys(categories)) {
        for (const subcategory of Object.keys(categories[category])) {
            app.setView({navbarMode: "subcategory", category: category, subcategory: subcategory});
            await pause();
            const list = document.querySelector("#app").innerText;
            const captions = [];
            for (const path of categories[category][subcategory]) {
                app.showResultInfo(path);
                await pause();
                captions.push(document.querySelector("#app").innerText);
            }
            seen[category + "/" + subcategory] = {list: list, captions: captions};
        }
    }
    const note = document.createElement("pre");
    note.id = "seen";
    note.textContent = JSON.stringify(seen);
    document.body.append(note);
})();
</script>
"""


@pytest.fixture(scope="module")
def report(smoke):
    return (smoke.folder / SMOKE_REPORT).read_text(encoding="utf-8")


@pytest.fixture
def seen(report, tmp_path, page_text):
    """What a reader of the report sees, by category and subcategory."""
    end = report.rindex("</body>")
    page = tmp_path / "report.html"
    page.write_text(report[:end] + WALK + report[end:], encoding="utf-8")
    noted = re.search(r'<pre id="seen">(.*?)</pre>', page_text(page.as_uri(), patience_ms=60_000), re.DOTALL)
    assert noted, "the report's own scripts did not get through"
    return json.loads(html.unescape(noted[1]))


def test_the_report_is_one_file_that_loads_nothing(report):
    assert not re.search(r"<(script|img|iframe)[^>]*\ssrc=[\"']?(https?:)?//", report)
    assert not re.search(r"<link[^>]*\shref=[\"']?(https?:)?//", report)


def test_a_browser_shows_the_rule_graph_the_figures_their_captions_and_the_comparison(seen, smoke):
    assert seen.pop("graphics") > 0
    assert "Workflow" in seen.pop("start")
    assert all(place.startswith("1. smoke/") for place in seen)

    listed = "\n".join(place["list"] for place in seen.values())
    captions = [caption for place in seen.values() for caption in place["captions"]]
    figures = {path.stem for path in (smoke.folder / "results/smoke/figures").glob("*.png")}
    assert figures
    for figure in figures:
        assert any(f"figures/{figure}." in caption for caption in captions), figure
    assert "comparison" in listed.lower()
    for caption in captions:
        described = re.search(r"DESCRIPTION\s+(.*?)\s+SIZE", caption, re.DOTALL)
        assert described, f"no caption: {caption}"
        assert len(described[1]) > 40, f"hardly a caption: {described[1]}"
