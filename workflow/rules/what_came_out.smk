# At the end of a run, what came of it: the verdict of each campaign and the optimum of each scenario that was
# summarised. What could not be made beside a verdict makes the run a failed one, though all is there.

from snakemake.exceptions import WorkflowError
from snakemake.logging import logger

from jointgap.core.results_folder import ResultsFolder


onsuccess:
    from jointgap.campaign.campaign_files import failures
    from jointgap.app.report import optimum_lines, verdict_lines

    asked = {(job.rule.name, *job.wildcards) for job in workflow.dag.jobs}
    failed = []
    lines = optimum_lines([name for name in SCENARIOS if ("summarise", name) in asked], Path("results"))
    for name in CAMPAIGNS:
        if ("campaign_conclude", name) in asked:
            folder = Path("results/campaigns", name)
            lines += ["", *verdict_lines(folder)]
            failed += [
                f"campaign {name}: {what}: {why}" for what, why in failures(ResultsFolder(folder)).items()
            ]
    if lines:
        logger.info("\n".join(["", *lines, ""]))
    if failed:
        raise WorkflowError("could not be made: " + "; ".join(failed))
