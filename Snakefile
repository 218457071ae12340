# jointgap: contact in clearance joints -> networks -> optimum -> figures, comparison, tracked runs.
# Configuration in config/config.yaml; rules by stage in workflow/rules; every command is one subcommand of `jointgap`.

from snakemake.utils import min_version

min_version("9.0")


configfile: "config/config.yaml"


report: "workflow/report/workflow.rst"


include: "workflow/rules/common.smk"
include: "workflow/rules/campaign_common.smk"


rule all:
    default_target: True
    input:
        comparison=expand("results/{scenario}/comparison.md", scenario=LOOSE),
        figures=expand("results/{scenario}/figures/{figure}.svg", scenario=LOOSE, figure=FIGURES),
        animation=expand("results/{scenario}/figures/animation.gif", scenario=SCENARIOS),
        overview=["results/overview.md"] if len(LOOSE) > 1 else [],
        published=expand("results/{scenario}/track/published.json", scenario=LOOSE),
        campaigns=expand("results/campaigns/{campaign}/track/published.json", campaign=CAMPAIGNS),
    message:
        "every scenario is complete"


include: "workflow/rules/simulate.smk"
include: "workflow/rules/surrogate.smk"
include: "workflow/rules/kinematics.smk"
include: "workflow/rules/optimise.smk"
include: "workflow/rules/figures.smk"
include: "workflow/rules/compare.smk"
include: "workflow/rules/study.smk"
include: "workflow/rules/track.smk"
include: "workflow/rules/campaign.smk"
include: "workflow/rules/campaign_verdict.smk"
