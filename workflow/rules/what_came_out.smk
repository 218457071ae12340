# At the end of a run, what came of it: the verdict of each campaign and the optimum of each scenario that was
# summarised.

from snakemake.logging import logger


onsuccess:
    from jointgap.stages.what_came_out import optimum_lines, verdict_lines

    asked = {(job.rule.name, *job.wildcards) for job in workflow.dag.jobs}
    lines = optimum_lines([name for name in SCENARIOS if ("summarise", name) in asked], Path("results"))
    for name in CAMPAIGNS:
        if ("campaign_conclude", name) in asked:
            lines += ["", *verdict_lines(Path("results/campaigns", name))]
    if lines:
        logger.info("\n".join(["", *lines, ""]))
