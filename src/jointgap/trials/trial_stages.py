"""The stages of blind trials: conceal, analyse, score, publish. Only the score reads what was sealed."""

import json
from collections.abc import Sequence
from pathlib import Path

from jointgap import tables
from jointgap.core.stage import Stages

TRIAL_STAGES = Stages()


@TRIAL_STAGES.stage()
def blind_conceal(
    sets: Path, name: str, batch: int, campaigns: Path, sealed: Path, listed: Path, truth: Path, code: str
) -> str:
    """Draw the campaigns of one batch, hide effects in their data, and seal the truth elsewhere."""
    from jointgap.trials.batches import cached_record, folder_digest
    from jointgap.trials.make_trial import make_trial
    from jointgap.trials.trial_plan import plan_batch, read_sets, trial_set

    chosen = trial_set(read_sets(sets), name)
    plans, records, code = plan_batch(chosen, batch), [], f"{code} {chosen.model_dump_json()}"
    for plan in plans:
        campaign = campaigns / plan.id

        def make(plan=plan, campaign=campaign) -> dict:
            return make_trial(plan, chosen.seed, campaign) | {"files": folder_digest(campaign)}

        required = {"files": folder_digest(campaign)}
        records.append(cached_record(sealed / f"{plan.id}.json", code, make, required))
    tables.write_text(truth, json.dumps(records) + "\n")
    tables.write_text(listed, "".join(f"{plan.id}\n" for plan in plans))
    return "\n".join(plan.id for plan in plans)


@TRIAL_STAGES.stage()
def blind_analyse(listed: Path, campaigns: Path, verdicts: Path, found: Path, code: str) -> None:
    """Name what is missing in the campaigns of one batch, each in a folder that holds it alone."""
    from jointgap.trials.analyse_trial import analyse_trial
    from jointgap.trials.batches import cached_record, folder_digest, listed_trials

    records = []
    for trial in listed_trials(listed, campaigns):
        campaign, results = campaigns / trial, verdicts / trial
        digest = f"{code} {folder_digest(campaign)}"
        record = cached_record(
            results / "trial.json", digest, lambda campaign=campaign, results=results: analyse_trial(campaign, results)
        )
        records.append(record)
        print(trial, record.get("verdict", {}).get("verdict", record.get("error")), record["seconds"], "s", flush=True)
    tables.write_text(found, json.dumps(records) + "\n")


@TRIAL_STAGES.stage()
def blind_score(name: str, truths: Sequence[Path], founds: Sequence[Path], folder: Path) -> str:
    """Open the seals: how often the naming was right, wrong or silent, with intervals, and what the baselines do."""
    from jointgap.core import plot
    from jointgap.core.page import to_html, to_markdown
    from jointgap.trials.score import TRIALS, score_batches
    from jointgap.trials.trial_figures import draw_score
    from jointgap.trials.trials_report import metrics, page

    frame = score_batches(truths, founds)
    tables.write(TRIALS, frame, folder / "trials.parquet")
    for stem, drawing in draw_score(frame).items():
        plot.save(drawing, folder / stem)
    tables.write_text(folder / "metrics.json", json.dumps(metrics(frame), indent=2) + "\n")
    summary = page(name, frame)
    tables.write_text(folder / "summary.html", to_html(summary, folder))
    text = to_markdown(summary, ".")
    tables.write_text(folder / "summary.md", text)
    return text


@TRIAL_STAGES.stage()
def blind_track(name: str, folder: Path, store: Path, published: Path) -> None:
    """Publish the score of a set of blind trials to MLflow; nothing twice."""
    from jointgap.track.publish import publish_records
    from jointgap.trials.trials_report import DESCRIPTION, mlflow_records

    summary = publish_records(name, DESCRIPTION, mlflow_records(folder), None, store)
    tables.write_text(published, json.dumps(summary, indent=2) + "\n")
