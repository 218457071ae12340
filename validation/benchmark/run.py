"""The benchmark by one command: this package and its peers on the same campaigns."""

import argparse
import json
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from jointgap.core.errors import InputError
from validation.benchmark import greedy, optimiser, sparse
from validation.benchmark.network import MODEL, answer, train
from validation.benchmark.pool import in_parallel
from validation.benchmark.score import PACKAGE, answer_of_verdict, score
from validation.benchmark.training import simulate
from validation.kinds import Trial, plan_trials, read_set
from validation.runner import analyse_within, draw_trial, run_trials, write_record

SETS = "config/blind.yaml"
SET = "v0_1_0rc2"
"""The newest published set."""

# Names of a campaign folder by a method, which also gets the record of the package's analysis
Method = Callable[[Path, Mapping[str, Any]], list[str] | None]


def run(
    plans: Sequence[Trial],
    trial_set: Any,
    folder: Path,
    training: Path,
    count: int,
    seconds: float,
    cores: int,
) -> str:
    """Draw and analyse the trials, answer them by all peers, and score; the table as Markdown.

    `folder` has the layout of `validation.runner.run_trials`, so verdicts that it holds are used.
    Answers of peers are ``peers/{method}/{trial}.json``. The network is trained on `count`
    campaigns in the folder `training`, unless that holds a model. Interrupted runs resume.
    """
    model = training / MODEL
    if not model.is_file():
        simulate(training, count, trial_set, cores)
        print(train(training), flush=True)
    peers: dict[str, Method] = {
        "greedy": greedy.answer,
        "sparse": sparse.answer,
        "optimiser": optimiser.answer,
        "network": partial(answer, model),
    }
    run_trials(plans, trial_set.seed, folder, seconds, cores=cores)
    task = partial(_ask, folder, peers, seconds)
    for line in in_parallel(task, [plan.id for plan in plans], cores):
        print(line, flush=True)
    return collect(plans, folder, list(peers))


def _ask(folder: Path, peers: Mapping[str, Method], seconds: float, trial: str) -> str:
    """Let the peers answer a trial whose package verdict exists; a line on their answers."""
    campaign, analysis = folder / "campaigns" / trial, folder / "verdicts" / f"{trial}.json"
    if not analysis.is_file():
        return f"{trial}: not analysed"
    record, lines = json.loads(analysis.read_bytes()), []
    for method, names_of in peers.items():
        path = folder / "peers" / method / f"{trial}.json"
        if not path.is_file():
            # the optimiser spends the time of the package after it has started
            limit = seconds + record["seconds"] if method == "optimiser" else seconds
            analyse_within(path, trial, partial(_named, names_of, campaign, record), limit)
        peer = json.loads(path.read_bytes())
        lines.append(f"{method} {peer.get('error') or peer['named']}")
    return f"{trial}: {', '.join(lines)}"


def _named(names_of: Method, campaign: Path, analysis: Mapping[str, Any]) -> dict[str, Any]:
    begin = time.process_time()
    named = names_of(campaign, analysis)
    seconds = round(time.process_time() - begin, 3)
    return {"id": campaign.name, "named": named, "seconds": seconds}


def collect(plans: Sequence[Trial], folder: Path, methods: Sequence[str]) -> str:
    """Write ``answers/{method}.json`` of the package and the peers, then score all files there."""
    names, costs = [f"{plan.id}.json" for plan in plans], {}
    for method in (PACKAGE, *methods):
        place = folder / ("verdicts" if method == PACKAGE else f"peers/{method}")
        records = {
            Path(name).stem: json.loads((place / name).read_bytes())
            for name in names
            if (place / name).is_file()
        }
        answers = {
            trial: answer_of_verdict(record.get("verdict"))
            if method == PACKAGE
            else record.get("named")
            for trial, record in records.items()
        }
        write_record(folder / "answers" / f"{method}.json", answers)
        costs[method] = [record["seconds"] for record in records.values()]
    return score(folder, [plan.id for plan in plans], costs)


def draw(plans: Sequence[Trial], seed: int, folder: Path, cores: int) -> None:
    """Write the campaigns and truths of trials, without analyses."""
    for number, _ in enumerate(in_parallel(partial(_drawn, seed, folder), plans, cores), 1):
        print(f"{number} of {len(plans)} campaigns", flush=True)


def _drawn(seed: int, folder: Path, plan: Trial) -> None:
    truth = folder / "truth" / f"{plan.id}.json"
    draw_trial(plan, seed, folder / "campaigns" / plan.id, truth)


def main(arguments: Sequence[str]) -> None:
    """The command ``python -m validation benchmark``."""
    parser = argparse.ArgumentParser("python -m validation benchmark", description=__doc__)
    verbs = parser.add_subparsers(dest="verb", required=True)
    of_set = argparse.ArgumentParser(add_help=False)
    of_set.add_argument("--set", default=SET, help=f"of {SETS} (default: {SET})")
    of_set.add_argument("--seed", type=partial(int, base=0), help="of a set without one")
    of_set.add_argument("--cores", type=int, default=2)
    for verb, words in (
        ("run", "draw, analyse, let all peers answer, and score; resumes"),
        ("draw", "write the campaigns and truths only"),
        ("score", "score all files in FOLDER/answers"),
    ):
        part = verbs.add_parser(verb, parents=[of_set], help=words)
        part.add_argument("folder", type=Path)
        part.add_argument("count", nargs="?", type=int, default=100, help="of trials: the first")
        if verb == "run":
            part.add_argument("--seconds", type=float, default=120.0, help="limit of an analysis")
            part.add_argument("--training", type=Path, default=Path("results/benchmark_training"))
            part.add_argument("--campaigns", type=int, default=3000, help="for the training")
    part = verbs.add_parser("simulate", parents=[of_set], help="training campaigns of the network")
    part.add_argument("folder", type=Path)
    part.add_argument("count", type=int)
    part = verbs.add_parser("train", help=f"train the network on FOLDER; writes FOLDER/{MODEL}")
    part.add_argument("folder", type=Path)
    chosen = parser.parse_args(arguments)
    for name in ("cores", "count", "campaigns", "seconds"):
        if not (value := getattr(chosen, name, 1)) > 0:
            raise InputError(f"{name}: is {value}; give a number above 0")
    if chosen.verb == "train":
        print(train(chosen.folder))
        return
    trial_set = read_set(SETS, chosen.set, chosen.seed)
    if chosen.verb == "simulate":
        simulate(chosen.folder, chosen.count, trial_set, chosen.cores)
        return
    plans = plan_trials(trial_set, chosen.count)
    if chosen.verb == "draw":
        draw(plans, trial_set.seed, chosen.folder, chosen.cores)
    elif chosen.verb == "score":
        print(score(chosen.folder, [plan.id for plan in plans]))
    else:
        training = (chosen.training, chosen.campaigns)
        print(run(plans, trial_set, chosen.folder, *training, chosen.seconds, chosen.cores))
