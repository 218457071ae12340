# The report of a run: one page in one file, written by `jointgap report` once all that it shows is there. What people
# ask for decides which: results/report.html holds every scenario and campaign, results/smoke-report.html the same of the
# small configuration; results/campaign-report.html holds campaigns alone.


rule whole_report:
    input:
        lambda wildcards: whole(
            [
                *(path for name in SCENARIOS for path in made_of_scenario(name)),
                *(rules.overview.output if len(LOOSE) > 1 else []),
                *(path for name in CAMPAIGNS for path in made_of_campaign(name)),
            ]
        ),
    output:
        report="results/{kind}report.html",
    log:
        "results/logs/{kind}report.log",
    wildcard_constraints:
        kind="|smoke-",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        shown=lambda wildcards: [
            *named_options("--scenario", SCENARIOS, "report"),
            *(text for name in CAMPAIGNS for text in ("--campaign", name)),
        ],
        code=digest_of("report"),
        results=subpath(output.report, parent=True),
    message:
        "write {output.report}"
    shell:
        "jointgap report --results {params.results:q} --report {output.report:q} {params.shown:q} > {log:q} 2>&1"


use rule whole_report as campaign_report with:
    input:
        lambda wildcards: whole(path for name in CAMPAIGNS for path in made_of_campaign(name)),
    output:
        report="results/campaign-report.html",
    log:
        "results/logs/campaign-report.log",
    params:
        shown=[text for name in CAMPAIGNS for text in ("--campaign", name)],
        code=digest_of("report"),
        results=subpath(output.report, parent=True),
