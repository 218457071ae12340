# Campaigns, from the fits to a verdict; what the rules share: campaign_common.smk.


rule campaign_decide:
    input:
        plan=plan,
        tables=handed_on("measure", "noise", "recalibrate", "screen"),
        fits=all_parts("fit"),
        pairs=all_parts("pair"),
    output:
        handed_on("decide", "locate", "regress", "confirm", "augment"),
        mechanism=campaign_place(MECHANISM),
    log:
        campaign_place("logs/decide.log"),
    benchmark:
        campaign_place("benchmarks/decide.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=90,
    params:
        code=CAMPAIGN_STAGES["decide"].digest,
        folder=subpath(output[0], ancestor=2),
        parts=fit_parts,
    message:
        "campaign {wildcards.campaign}: weigh the fits, map the disagreement, predict the held-out runs, write the augmented mechanism"
    shell:
        "jointgap decide {input.plan[0]:q} --folder {params.folder:q} --parts {params.parts}"
        " --then locate --then regress --then confirm --then augment > {log:q} 2>&1"


rule campaign_reoptimise:
    input:
        plan=plan,
        tables=handed_on("measure", "noise", "recalibrate", "decide", "regress"),
        mechanism=campaign_place(MECHANISM),
    output:
        handed_on("reoptimise"),
    log:
        campaign_place("logs/reoptimise.log"),
    benchmark:
        campaign_place("benchmarks/reoptimise.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        code=CAMPAIGN_STAGES["reoptimise"].digest,
        folder=subpath(output[0], ancestor=2),
    message:
        "campaign {wildcards.campaign}: optimise again, before and after"
    shell:
        "jointgap reoptimise {input.plan[0]:q} --folder {params.folder:q} > {log:q} 2>&1"


rule campaign_conclude:
    input:
        plan=plan,
        tables=handed_on(
            "measure",
            "preflight",
            "noise",
            "recalibrate",
            "decide",
            "locate",
            "regress",
            "confirm",
            "augment",
            "reoptimise",
        ),
    output:
        verdict=campaign_place(VERDICT),
        summaries=campaign_place(SUMMARIES[0]),
        page=report(
            campaign_place(SUMMARIES[1]),
            caption="../report/campaign_summary.rst",
            category=campaign_section,
            subcategory="Verdict",
            labels={"figure": "The verdict on one page"},
        ),
        figures=[
            report(
                campaign_place(f"figures/{name}.png"),
                caption=caption(f"campaign_{name}", figure.rst("campaign")),
                category=campaign_section,
                subcategory=figure.category,
                labels={"figure": figure.title},
            )
            for name, figure in CAMPAIGN_FIGURES.items()
        ],
        more=expand(
            campaign_place("figures/{figure}.{ending}"),
            figure=CAMPAIGN_FIGURES,
            ending=["svg", "parquet"],
            allow_missing=True,
        ),
    log:
        campaign_place("logs/conclude.log"),
    benchmark:
        campaign_place("benchmarks/conclude.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=2000,
        runtime=20,
    params:
        code=CAMPAIGN_STAGES["conclude"].digest,
        folder=subpath(output.verdict, parent=True),
    message:
        "campaign {wildcards.campaign}: verdict, summary and figures"
    shell:
        "jointgap conclude {input.plan[0]:q} --folder {params.folder:q} > {log:q} 2>&1"


rule campaign_track:
    input:
        plan=plan,
        verdict=rules.campaign_conclude.output.verdict,
        figures=rules.campaign_conclude.output.figures,
        tables=handed_on("regress", "confirm"),
    output:
        published=campaign_place("track/published.json"),
    log:
        campaign_place("logs/track.log"),
    conda:
        "../envs/jointgap.yaml"
    resources:
        mlflow_store=1,
        mem_mb=2000,
        runtime=20,
    params:
        code=CAMPAIGN_STAGES["track-campaign"].digest,
        folder=subpath(input.verdict, parent=True),
        store=subpath(input.verdict, ancestor=3),
    message:
        "campaign {wildcards.campaign}: publish to MLflow"
    shell:
        "jointgap track-campaign {input.plan[0]:q} --folder {params.folder:q} --store {params.store:q}"
        " --published {output.published:q} > {log:q} 2>&1"
