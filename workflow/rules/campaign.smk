# Campaigns: measured runs of a rig against its model, from the files to a verdict. `make campaign` runs one alone. What the
# stages read and write stands in their records (jointgap.campaign.stages), and as a picture in docs/workflow.md.


rule campaigned:
    input:
        lambda wildcards: whole(path for name in CAMPAIGNS for path in made_of_campaign(name)),
    message:
        "every campaign has its verdict"


# Never run: the rules of the stages inherit from it.
rule campaign_stage:
    input:
        plan=plan,
    output:
        campaign_place("<stage>/inherited"),
    log:
        campaign_place("logs/<stage>.log"),
    benchmark:
        campaign_place("benchmarks/<stage>.tsv")
    pathvars:
        stage="campaign_stage",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        folder=subpath(output[0], ancestor=2),
        more=[],
    message:
        "campaign {wildcards.campaign}: {rule}"
    shell:
        "jointgap {params.stage} {input.plan[0]:q} --folder {params.folder:q} {params.more:q} {params.then:q} > {log:q} 2>&1"


use rule campaign_stage as campaign_measure with:
    input:
        plan=plan,
        tables=campaign_input("measure"),
        data=recordings,
    output:
        campaign_output("measure"),
    pathvars:
        stage="measure",
    params:
        **of_campaign_stages("measure"),
    message:
        "campaign {wildcards.campaign}: read and look at the data"


use rule campaign_stage as campaign_preflight with:
    input:
        plan=plan,
        tables=campaign_input("preflight"),
        data=recordings,
    output:
        campaign_output("preflight"),
    pathvars:
        stage="preflight",
    params:
        **of_campaign_stages("preflight"),
        more=["--go-on"],
    message:
        "campaign {wildcards.campaign}: what can be detected and told apart"


use rule campaign_stage as campaign_recalibrate with:
    input:
        plan=plan,
        tables=campaign_input("noise", "recalibrate"),
    output:
        campaign_output("noise", "recalibrate"),
    pathvars:
        stage="recalibrate",
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        **of_campaign_stages("noise", "recalibrate"),
        more=["--anyway"] if config.get("anyway") else [],
    message:
        "campaign {wildcards.campaign}: find the noise, re-fit uncertain parameters"


use rule campaign_stage as campaign_screen with:
    input:
        plan=plan,
        tables=campaign_input("screen"),
    output:
        campaign_output("screen"),
    pathvars:
        stage="screen",
    params:
        **of_campaign_stages("screen"),
    message:
        "campaign {wildcards.campaign}: screen the candidates"


use rule campaign_stage as campaign_fit with:
    input:
        plan=plan,
        tables=campaign_input("fit"),
    output:
        campaign_output("fit"),
    pathvars:
        stage="fit_{part}",
    resources:
        mem_mb=1500,
        runtime=120,
    params:
        **of_campaign_stages("fit"),
        folder=subpath(output[0], ancestor=3),
        more=lambda wildcards: ["--part", wildcards.part, "--parts", fit_parts(wildcards)],
    message:
        "campaign {wildcards.campaign}: fit candidates, part {wildcards.part}"


use rule campaign_stage as campaign_pair with:
    input:
        plan=plan,
        tables=campaign_input("pair"),
    output:
        campaign_output("pair"),
    pathvars:
        stage="pair_{part}",
    resources:
        mem_mb=1500,
        runtime=120,
    params:
        **of_campaign_stages("pair"),
        folder=subpath(output[0], ancestor=3),
        more=lambda wildcards: ["--part", wildcards.part, "--parts", fit_parts(wildcards)],
    message:
        "campaign {wildcards.campaign}: fit pairs, part {wildcards.part}"


use rule campaign_stage as campaign_decide with:
    input:
        plan=plan,
        tables=campaign_input("decide", "locate", "regress", "confirm", "augment"),
    output:
        campaign_output("decide", "locate", "regress", "confirm", "augment"),
        mechanism=campaign_place(MECHANISM),
    pathvars:
        stage="decide",
    resources:
        mem_mb=1500,
        runtime=90,
    params:
        **of_campaign_stages("decide", "locate", "regress", "confirm", "augment"),
        more=lambda wildcards: ["--go-on", "--parts", fit_parts(wildcards)],
    message:
        "campaign {wildcards.campaign}: weigh the fits, map the disagreement, predict the held-out runs, write the augmented mechanism"


use rule campaign_stage as campaign_reoptimise with:
    input:
        plan=plan,
        tables=campaign_input("reoptimise"),
        mechanism=campaign_place(MECHANISM),
    output:
        campaign_output("reoptimise"),
    pathvars:
        stage="reoptimise",
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        **of_campaign_stages("reoptimise"),
        more=["--go-on"],
    message:
        "campaign {wildcards.campaign}: optimise again, before and after"


use rule campaign_stage as campaign_conclude with:
    input:
        plan=plan,
        tables=campaign_input("conclude"),
    output:
        verdict=campaign_place(VERDICT),
        summaries=campaign_place(SUMMARIES[0]),
        page=campaign_place(SUMMARIES[1]),
        figures=expand(
            campaign_place("figures/{figure}.{ending}"),
            figure=CAMPAIGN_FIGURES,
            ending=["png", "svg", "parquet"],
            allow_missing=True,
        ),
    pathvars:
        stage="conclude",
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        **of_campaign_stages("conclude"),
        more=["--go-on"],
        folder=subpath(output.verdict, parent=True),
    message:
        "campaign {wildcards.campaign}: verdict, summary and figures"


use rule campaign_stage as campaign_track with:
    input:
        plan=plan,
        tables=campaign_input("track-campaign"),
        verdict=rules.campaign_conclude.output.verdict,
        figures=rules.campaign_conclude.output.figures,
    output:
        published=campaign_place("track/published.json"),
    benchmark:
        campaign_place("track/benchmark.tsv")
    pathvars:
        stage="track",
    resources:
        mlflow_store=1,
        mem_mb=2000,
        runtime=20,
    params:
        **of_campaign_stages("track-campaign"),
        more=lambda wildcards, output: [
            *("--store", str(Path(output.published).parents[3]), "--published", output.published),
        ],
    message:
        "campaign {wildcards.campaign}: publish to MLflow"
