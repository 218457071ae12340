"""Blind trials and the benchmark; `make blind` calls these commands.

python -m validation ...
conceal SETS NAME TRIAL CAMPAIGN TRUTH: write a trial's campaign and ground truth
analyse CAMPAIGN VERDICT: identify missing effects, in a folder without the ground truth
score NAME FOLDER TRIALS: score the trials in results/blind/SET and publish to MLflow
collect FOLDER TABLE CODE: add scored trials to a table of one code version
report NAME TABLE FOLDER: write rates and figures of such a table
ablate SETS NAME FOLDER: what each step and setting is worth (--help: trials, variants, limits)
optimiser CAMPAIGN VERDICT OUT: effects named by a global optimiser in the same processor time
benchmark draw FOLDER [COUNT]: write the campaigns and truth.zip, on CORES=2
benchmark answers RECORDS OUT [METHOD]: collect the answers of a method
benchmark score ANSWERS TRUTH FOLDER: score them
"""

import json
import os
import sys
from pathlib import Path

from jointgap.core.errors import InputError


def _write(path: str | Path, record: object) -> None:
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text(json.dumps(record, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def conceal(sets: str, name: str, trial: str, campaign: str, truth: str) -> None:
    from validation.kinds import plan_trials, read_set
    from validation.trial import make_trial

    trial_set = read_set(sets, name)
    (plan,) = (plan for plan in plan_trials(trial_set) if plan.id == trial)
    _write(truth, make_trial(plan, trial_set.seed, Path(campaign)))


def analyse(campaign: str, verdict: str) -> None:
    from validation.analyse import analyse_trial

    record = analyse_trial(Path(campaign))
    _write(verdict, record)
    outcome = record["verdict"]["verdict"] if "verdict" in record else record.get("error")
    print(record["id"], outcome, record["seconds"], "s")


def score(name: str, folder: str, *trials: str) -> None:
    from jointgap.core.publish import publish_records
    from validation.report import DESCRIPTION, mlflow_records, write_score
    from validation.score import score_trials

    scores = Path(folder) / "score"
    print(write_score(name, score_trials(Path(folder), trials), scores))
    results = Path(folder).parents[1]
    published = publish_records(name, DESCRIPTION, mlflow_records(scores), None, results)
    _write(scores / "published.json", published)


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
    trials = pd.concat([known[~known["id"].isin(trials["id"])], trials]).sort_values("id")
    temporary = path.with_name(f".{path.name}")
    trials.to_csv(temporary, index=False, float_format="%.6g")
    temporary.replace(path)
    print(f"{len(trials)} trials in {table}")


def report(name: str, table: str, folder: str) -> None:
    import pandas as pd

    from validation.report import write_score

    if not Path(table).is_file():
        raise InputError(f"{table}: no such file; `python -m validation collect` writes it")
    texts = ("named", "verdict", "cause", "reason")
    trials = pd.read_csv(table, dtype={"id": str, "code": str, **dict.fromkeys(texts, str)})
    print(write_score(name, trials.fillna(dict.fromkeys(texts, "")), Path(folder)))


def ablate(*arguments: str) -> None:
    import argparse

    from validation.ablation import ablate, chosen_trials, chosen_variants, write_ablation
    from validation.kinds import plan_trials, read_set

    parser = argparse.ArgumentParser("python -m validation ablate")
    for name in ("sets", "name", "folder"):
        parser.add_argument(name)
    parser.add_argument("--trials", default="even", help="even, odd, all, or numbers or ids")
    parser.add_argument(
        "--variants", default="steps", help="complete, steps, sections, settings, or 'stopping.*'"
    )
    parser.add_argument("--seconds", type=float, default=150.0, help="limit of an analysis")
    parser.add_argument("--budget", type=float, default=3600.0, help="then no analysis begins")
    chosen = parser.parse_args(arguments)
    for name in ("seconds", "budget"):
        if not (value := getattr(chosen, name)) > 0.0:
            raise InputError(f"--{name}: is {value:g}; give CPU-seconds above 0")
    trial_set = read_set(chosen.sets, chosen.name)
    plans = chosen_trials(plan_trials(trial_set), chosen.trials)
    folder, variants = Path(chosen.folder), chosen_variants(chosen.variants)
    analyses = ablate(plans, trial_set.seed, folder, variants, chosen.seconds, chosen.budget)
    print(write_ablation(chosen.name, analyses, folder))


def optimiser(campaign: str, verdict: str, out: str) -> None:
    from validation.global_optimiser import answer

    record = answer(Path(campaign), Path(verdict))
    _write(out, record)
    print(record["id"], record["optimiser"], record["seconds"], "s")


def benchmark(verb: str, first: str, *more: str) -> None:
    from validation.benchmark import draw
    from validation.benchmark.score import score

    if verb == "draw":
        draw.draw(Path(first), int(more[0]) if more else 100, int(os.environ.get("CORES", "2")))
    elif verb == "answers":
        _write(more[0], draw.answers(Path(first), *more[1:]))
    else:
        print(score(Path(first), *map(Path, more)))


if __name__ == "__main__":
    for library in ("OPENBLAS", "OMP", "MKL"):  # another order of sums would change the last bits
        os.environ[f"{library}_NUM_THREADS"] = "1"
    functions = (conceal, analyse, score, collect, report, ablate, optimiser, benchmark)
    commands = {function.__name__: function for function in functions}
    if sys.argv[1:2] == [] or sys.argv[1] not in commands:
        sys.exit(__doc__)
    try:
        commands[sys.argv[1]](*sys.argv[2:])
    except InputError as error:
        sys.exit(f"validation: error: {error}")
