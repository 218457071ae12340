# The workflow stands in workflow/, where the catalogue of workflows looks for it; here it is found by `snakemake` too.
include: "workflow/Snakefile"


# The default target of an included file does not count.
rule everything:
    default_target: True
    input:
        rules.all.input,
    message:
        "every scenario and every campaign is complete"
