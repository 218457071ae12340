"""The page with what each stage reads and writes agrees with the records of the stages."""

from benchmarks.project import ROOT, run


def test_the_page_is_what_the_records_say():
    done = run(ROOT, "scripts/workflow-page")
    assert done.returncode == 0, done.stderr
    assert (ROOT / "docs/workflow.md").read_text(encoding="utf-8") == done.stdout
