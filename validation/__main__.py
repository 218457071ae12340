"""Blind trials, as `make blind` calls them; only the score reads what was sealed.

python -m validation conceal SETS NAME TRIAL CAMPAIGN SEALED: draw one trial of a set, write its
campaign, and seal the ground truth elsewhere; analyse CAMPAIGN FOUND: identify what is missing in a
campaign, in a folder that holds it alone; score NAME FOLDER TRIALS: open the seals in
results/blind/SET, write the score, and publish it to MLflow; collect FOLDER TABLE CODE: add the
trials of a folder to a table of all that one version of the code has analysed; report NAME TABLE
FOLDER: write the score of such a table.

Other methods: train FEATURES WEIGHTS [SECONDS]: draw rigs for so long, on CORES=2, write FEATURES
(used as they are if they exist), train the classifier; peer WHICH CAMPAIGN GIVEN OUT: what the
`optimiser` names (GIVEN: what `analyse` wrote, whose processor time it has), or the `network`
(GIVEN: WEIGHTS).

Benchmark: benchmark draw FOLDER [COUNT]: write its campaigns and truth.zip, on CORES=2; benchmark
answers RECORDS OUT [METHOD]: collect what a method found into one file; benchmark score ANSWERS
TRUTH FOLDER: score it.
"""

import json
import os
import sys
from pathlib import Path

from jointgap.core.errors import InputError


def _write(path: str | Path, record: object) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
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
    print(
        record["id"],
        record.get("verdict", {}).get("verdict", record.get("error")),
        record["seconds"],
        "s",
    )


def train(features: str, weights: str, seconds: str = "3000") -> None:
    from validation.peers import draw_features, train

    for path in (features, weights):
        Path(path).parent.mkdir(parents=True, exist_ok=True)
    if not Path(features).is_file():
        draw_features(Path(features), float(seconds), int(os.environ.get("CORES", "2")))
    print(f"classified right, of rigs held out: {train(Path(features), Path(weights)):.3f}")


def peer(which: str, campaign: str, given: str, out: str) -> None:
    from validation.peers import ask

    record = ask(which, Path(campaign), Path(given))
    _write(out, record)
    print(record["id"], record[which], record["seconds"], "s")


def benchmark(verb: str, first: str, *more: str) -> None:
    from validation.benchmark import draw
    from validation.benchmark.score import score

    if verb == "draw":
        draw.draw(Path(first), int(more[0]) if more else 100, int(os.environ.get("CORES", "2")))
    elif verb == "answers":
        _write(more[0], draw.answers(Path(first), *more[1:]))
    else:
        print(score(Path(first), *map(Path, more)))


def score(name: str, folder: str, *trials: str) -> None:
    from jointgap.core.publish import publish_records
    from validation.report import DESCRIPTION, mlflow_records, write_score
    from validation.score import score_trials

    own = Path(folder)
    print(write_score(name, score_trials(own, trials), own / "score"))
    records = mlflow_records(own / "score")
    _write(
        own / "score/published.json",
        publish_records(name, DESCRIPTION, records, None, own.parents[1]),
    )


def collect(folder: str, table: str, code: str) -> None:
    import pandas as pd

    from validation.score import score_trials

    trials, path = score_trials(Path(folder)).assign(code=code), Path(table)
    if trials.empty:
        raise InputError(
            f"{folder}: holds no verdicts/*.json; give the folder that `make blind` writes for"
            " a set"
        )
    known = pd.read_csv(path, dtype={"id": str, "code": str}) if path.is_file() else trials[:0]
    if others := sorted({*known["code"]} - {code}):
        raise InputError(
            f"{table}: holds trials of {', '.join(others)}; give another file for those of {code}"
        )
    whole = pd.concat([known[~known["id"].isin(trials["id"])], trials]).sort_values("id")
    beside = path.with_name(f".{path.name}")
    whole.to_csv(beside, index=False, float_format="%.6g")
    beside.replace(path)
    print(f"{len(whole)} trials in {table}")


def report(name: str, table: str, folder: str) -> None:
    import pandas as pd

    from validation.report import write_score

    if not Path(table).is_file():
        raise InputError(f"{table}: no such file; `python -m validation collect` writes it")
    words = ("named", "verdict", "cause", "reason")
    trials = pd.read_csv(table, dtype={"id": str, "code": str, **dict.fromkeys(words, str)})
    trials = trials.fillna(dict.fromkeys(words, ""))
    print(write_score(name, trials, Path(folder)))


if __name__ == "__main__":
    for library in ("OPENBLAS", "OMP", "MKL"):  # sums in another order would change the last bits
        os.environ[f"{library}_NUM_THREADS"] = "1"
    verbs = {
        one.__name__: one
        for one in (conceal, analyse, score, collect, report, train, peer, benchmark)
    }
    if sys.argv[1:2] == [] or sys.argv[1] not in verbs:
        sys.exit(__doc__)
    try:
        verbs[sys.argv[1]](*sys.argv[2:])
    except InputError as error:
        sys.exit(f"validation: error: {error}")
