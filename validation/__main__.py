"""Blind trials, as `make blind` calls them; only the score reads what was sealed.

python -m validation conceal SETS NAME TRIAL CAMPAIGN SEALED: draw one trial of a set, write its campaign, and seal the
ground truth elsewhere; analyse CAMPAIGN FOUND: identify what is missing in a campaign, in a folder that holds it alone;
score NAME FOLDER TRIALS: open the seals in results/blind/SET, write the score, and publish it to MLflow; collect FOLDER
TABLE CODE: add the trials of a folder to a table of all that one version of the code has analysed; report NAME TABLE
FOLDER: write the score of such a table.
"""

import json
import os
import sys
from pathlib import Path

from jointgap.core.errors import InputError


def _write(path: str | Path, record: object) -> None:
    Path(path).write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def conceal(sets: str, name: str, trial: str, campaign: str, sealed: str) -> None:
    from validation.kinds import plan_trials, read_set
    from validation.trial import make_trial

    chosen = read_set(sets, name)
    plans = {plan.id: plan for plan in plan_trials(chosen)}
    _write(sealed, make_trial(plans[trial], chosen.seed, Path(campaign)))


def analyse(campaign: str, found: str) -> None:
    from validation.analyse import analyse_trial

    record = analyse_trial(Path(campaign))
    _write(found, record)
    print(record["id"], record.get("verdict", {}).get("verdict", record.get("error")), record["seconds"], "s")


def score(name: str, folder: str, *trials: str) -> None:
    from jointgap.core.publish import publish_records
    from validation.report import DESCRIPTION, mlflow_records, write_score
    from validation.score import score_trials

    own = Path(folder)
    print(write_score(name, score_trials(own, trials), own / "score"))
    records = mlflow_records(own / "score")
    _write(own / "score/published.json", publish_records(name, DESCRIPTION, records, None, own.parents[1]))


def collect(folder: str, table: str, code: str) -> None:
    import pandas as pd

    from validation.score import score_trials

    trials, path = score_trials(Path(folder)).assign(code=code), Path(table)
    known = pd.read_csv(path, dtype={"id": str}) if path.is_file() else trials[:0]
    if others := sorted({*known["code"]} - {code}):
        raise InputError(f"{table}: holds trials of {', '.join(others)}; give another file for those of {code}")
    whole = pd.concat([known[~known["id"].isin(trials["id"])], trials]).sort_values("id")
    beside = path.with_name(f".{path.name}")
    whole.to_csv(beside, index=False, float_format="%.6g")
    beside.replace(path)
    print(f"{len(whole)} trials in {table}")


def report(name: str, table: str, folder: str) -> None:
    import pandas as pd

    from validation.report import write_score

    words = ("named", "verdict", "cause", "reason")
    trials = pd.read_csv(table, dtype={"id": str, **dict.fromkeys(words, str)})
    trials = trials.fillna(dict.fromkeys(words, ""))
    print(write_score(name, trials, Path(folder)))


if __name__ == "__main__":
    for library in ("OPENBLAS", "OMP", "MKL"):  # sums in another order would change the last bits
        os.environ[f"{library}_NUM_THREADS"] = "1"
    verbs = {verb.__name__: verb for verb in (conceal, analyse, score, collect, report)}
    if sys.argv[1:2] == [] or sys.argv[1] not in verbs:
        sys.exit(__doc__)
    try:
        verbs[sys.argv[1]](*sys.argv[2:])
    except InputError as error:
        sys.exit(f"validation: error: {error}")
