"""Blind trials and the benchmark; `make blind` calls these commands.

python -m validation ...
conceal SETS NAME TRIAL CAMPAIGN TRUTH: write a trial's campaign and ground truth
analyse CAMPAIGN VERDICT [SECONDS]: identify missing effects, in a folder without the ground truth
run SETS NAME FOLDER: both for many trials (--help: trials, seed, cores, limits); resumes
score NAME FOLDER TRIALS: score the trials in results/blind/SET and publish to MLflow
collect FOLDER TABLE: add scored trials to a table of one code version
report NAME TABLE FOLDER: write rates and figures of such a table
ablate SETS NAME FOLDER: what each step and setting is worth (--help: trials, variants, limits)
optimiser CAMPAIGN VERDICT OUT: effects named by a global optimiser in the same processor time
benchmark draw FOLDER [COUNT]: write the campaigns and truth.zip, on CORES=2
benchmark answers RECORDS OUT [METHOD]: collect the answers of a method
benchmark score ANSWERS TRUTH FOLDER: score them
"""

import argparse
import math
import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from jointgap.core.errors import InputError


def conceal(sets: str, name: str, trial: str, campaign: str, truth: str) -> None:
    from validation.kinds import chosen_trials, plan_trials, read_set
    from validation.runner import draw_trial

    trial_set = read_set(sets, name)
    (plan,) = chosen_trials(plan_trials(trial_set), trial)
    draw_trial(plan, trial_set.seed, Path(campaign), Path(truth))


def analyse(campaign: str, verdict: str, seconds: str = "0") -> None:
    from validation.analyse import analyse_trial
    from validation.runner import analyse_within, summary

    folder = Path(campaign)
    within = partial(analyse_trial, folder)
    print(summary(analyse_within(Path(verdict), folder.name, within, float(seconds))))


def run(*arguments: str) -> None:
    from validation.kinds import chosen_trials, plan_trials, read_set
    from validation.runner import run_trials

    parser = _parser("run", trials="all", seconds=120.0, budget=math.inf)
    parser.add_argument("--seed", type=_seed, help="of a set without one, such as 0x1a2b3c4d")
    parser.add_argument("--cores", type=int, default=1, help="number of trials at a time")
    chosen = _parsed(parser, arguments)
    if chosen.cores < 1:
        raise InputError(f"--cores: is {chosen.cores}; give a whole number from 1")
    trial_set = read_set(chosen.sets, chosen.name, chosen.seed)
    plans, folder = chosen_trials(plan_trials(trial_set), chosen.trials), Path(chosen.folder)
    run_trials(plans, trial_set.seed, folder, chosen.seconds, chosen.budget, chosen.cores)
    done = sum((folder / "verdicts" / f"{plan.id}.json").is_file() for plan in plans)
    print(f"{done} of {len(plans)} trials have a verdict in {folder}")


def _seed(text: str) -> int:
    try:
        return int(text, base=0)
    except ValueError:
        message = f"is {text!r}; give a whole number, such as eight digits of a hash: 0x1a2b3c4d"
        raise argparse.ArgumentTypeError(message) from None


def _parser(command: str, trials: str, seconds: float, budget: float) -> argparse.ArgumentParser:
    """Options of a command that analyses trials of a set, with defaults."""
    parser = argparse.ArgumentParser(f"python -m validation {command}")
    for name in ("sets", "name", "folder"):
        parser.add_argument(name)
    parser.add_argument("--trials", default=trials, help="even, odd, all, 2/4, or numbers or ids")
    parser.add_argument("--seconds", type=float, default=seconds, help="limit of an analysis")
    parser.add_argument("--budget", type=float, default=budget, help="then no analysis begins")
    return parser


def _parsed(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> argparse.Namespace:
    chosen = parser.parse_args(arguments)
    for name in ("seconds", "budget"):
        if not (value := getattr(chosen, name)) > 0.0:
            raise InputError(f"--{name}: is {value:g}; give CPU-seconds above 0")
    return chosen


def score(name: str, folder: str, *trials: str) -> None:
    from jointgap.core.publish import publish_records
    from validation.report import DESCRIPTION, mlflow_records, write_score
    from validation.runner import write_record
    from validation.score import score_trials

    scores = Path(folder) / "score"
    print(write_score(name, score_trials(Path(folder), trials), scores))
    results = Path(folder).parents[1]
    published = publish_records(name, DESCRIPTION, mlflow_records(scores), None, results)
    write_record(scores / "published.json", published)


def collect(folder: str, table: str) -> None:
    import pandas as pd

    from validation.score import score_trials

    trials, path = score_trials(Path(folder)), Path(table)
    if trials.empty:
        raise InputError(
            f"{folder}: holds no verdicts/*.json; give the folder that `make blind` writes for"
            " a set"
        )
    known = pd.read_csv(path, dtype={"id": str, "code": str}) if path.is_file() else trials[:0]
    trials = pd.concat([known[~known["id"].isin(trials["id"])], trials]).sort_values("id")
    if len(codes := sorted({*trials["code"].fillna("")})) > 1:
        raise InputError(
            f"{folder}: {table} would contain trials of {' and '.join(codes)}; give a file and a"
            " folder of one code version"
        )
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
    from validation.ablation import ablate, chosen_variants, write_ablation
    from validation.kinds import chosen_trials, plan_trials, read_set

    parser = _parser("ablate", trials="even", seconds=150.0, budget=3600.0)
    parser.add_argument(
        "--variants", default="steps", help="complete, steps, sections, settings, or 'stopping.*'"
    )
    chosen = _parsed(parser, arguments)
    trial_set = read_set(chosen.sets, chosen.name)
    plans = chosen_trials(plan_trials(trial_set), chosen.trials)
    folder, variants = Path(chosen.folder), chosen_variants(chosen.variants)
    analyses = ablate(plans, trial_set.seed, folder, variants, chosen.seconds, chosen.budget)
    print(write_ablation(chosen.name, analyses, folder))


def optimiser(campaign: str, verdict: str, out: str) -> None:
    from validation.global_optimiser import answer
    from validation.runner import write_record

    record = answer(Path(campaign), Path(verdict))
    write_record(Path(out), record)
    print(record["id"], record["optimiser"], record["seconds"], "s")


def benchmark(verb: str, first: str, *more: str) -> None:
    from validation.benchmark import draw
    from validation.benchmark.score import score
    from validation.runner import write_record

    if verb == "draw":
        draw.draw(Path(first), int(more[0]) if more else 100, int(os.environ.get("CORES", "2")))
    elif verb == "answers":
        write_record(Path(more[0]), draw.answers(Path(first), *more[1:]))
    else:
        print(score(Path(first), *map(Path, more)))


if __name__ == "__main__":
    for library in ("OPENBLAS", "OMP", "MKL"):  # another order of sums would change the last bits
        os.environ[f"{library}_NUM_THREADS"] = "1"
    functions = (conceal, analyse, run, score, collect, report, ablate, optimiser, benchmark)
    commands = {function.__name__: function for function in functions}
    if sys.argv[1:2] == [] or sys.argv[1] not in commands:
        sys.exit(__doc__)
    try:
        commands[sys.argv[1]](*sys.argv[2:])
    except InputError as error:
        sys.exit(f"validation: error: {error}")
