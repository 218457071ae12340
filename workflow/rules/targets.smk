# Targets of the Makefile, and the messages at the end of a run.

from snakemake.logging import logger

from jointgap.core.results_folder import ResultsFolder


rule overview:
    input:
        lambda wildcards: [
            f"results/{name}/{path}"
            for name in COMPARED
            for path in ("comparison.parquet", "figures/resimulation.png")
        ],
    output:
        multiext("results/overview", ".md", ".html", ".parquet"),
    log:
        "results/logs/overview.log",
    conda:
        "../envs/jointgap.yaml"
    params:
        scenarios=lambda wildcards: option_arguments("--scenario", COMPARED, "compare"),
        code=digest_of_overview,
    message:
        "compare the scenarios"
    shell:
        "jointgap overview --results results {params.scenarios:q} > {log:q} 2>&1"


rule whole_report:
    input:
        all_scenario_files,
        all_campaign_files,
    output:
        "results/{kind}report.html",
    log:
        "results/logs/{kind}report.log",
    wildcard_constraints:
        kind="|smoke-",
    conda:
        "../envs/jointgap.yaml"
    params:
        shown=lambda wildcards: [
            *option_arguments("--scenario", SCENARIOS, "compare"),
            *CAMPAIGN_ARGUMENTS,
        ],
        code=digest_of_report,
    message:
        "write {output}"
    shell:
        "jointgap report --results results --report {output:q} {params.shown:q} > {log:q} 2>&1"


use rule whole_report as campaign_report with:
    input:
        all_campaign_files,
    output:
        "results/campaign-report.html",
    log:
        "results/logs/campaign-report.log",
    params:
        shown=CAMPAIGN_ARGUMENTS,
        code=digest_of_report,


rule campaigned:
    input:
        all_campaign_files,
    message:
        "every campaign has its verdict"


# Failed optional stages of a campaign, and scenarios without an optimum, make the run fail.
onsuccess:
    from jointgap.app.run_summary import optimum_lines, scenarios_without_optimum, verdict_lines
    from jointgap.campaign.campaign_files import failures

    made = {(job.rule.name, *job.wildcards) for job in workflow.dag.jobs}
    failed = []
    summarised = [name for name in SCENARIOS if ("summarise", name) in made]
    lines = optimum_lines(summarised, Path("results"))
    for name in CAMPAIGNS:
        if ("campaign_show", name) in made:
            folder = Path("results/campaigns", name)
            lines += ["", *verdict_lines(folder)]
            failed += [
                f"campaign {name}: {what}: {why}"
                for what, why in failures(ResultsFolder(folder)).items()
            ]
    if lines:
        logger.info("\n".join(["", *lines, ""]))
    reasons = ["could not be made: " + "; ".join(failed)] if failed else []
    if unmet := scenarios_without_optimum(summarised, Path("results")):
        reasons.append("no optimum: " + ", ".join(unmet))
    if reasons:
        raise WorkflowError("; ".join(reasons))
