# Campaigns: measured runs of a rig against its model, from the files to a verdict. `make campaign` runs one alone.


rule campaigned:
    input:
        expand("results/campaigns/{campaign}/track/published.json", campaign=CAMPAIGNS),
    message:
        "every campaign has its verdict"


rule campaign_measure:
    input:
        plan=plan,
        data=recordings,
    output:
        handed_on("measure"),
    log:
        campaign_place("logs/measure.log"),
    benchmark:
        campaign_place("benchmarks/measure.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        code=CAMPAIGN_STAGES["measure"].digest,
        folder=subpath(output[0], ancestor=2),
    message:
        "campaign {wildcards.campaign}: read and look at the data"
    shell:
        "jointgap measure {input.plan[0]:q} --folder {params.folder:q} > {log:q} 2>&1"


rule campaign_preflight:
    input:
        plan=plan,
        data=recordings,
    output:
        handed_on("preflight"),
    log:
        campaign_place("logs/preflight.log"),
    benchmark:
        campaign_place("benchmarks/preflight.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        code=CAMPAIGN_STAGES["preflight"].digest,
        folder=subpath(output[0], ancestor=2),
    message:
        "campaign {wildcards.campaign}: what can be detected and told apart"
    shell:
        "jointgap preflight {input.plan[0]:q} --folder {params.folder:q} > {log:q} 2>&1"


rule campaign_recalibrate:
    input:
        plan=plan,
        tables=handed_on("measure"),
    output:
        handed_on("noise", "recalibrate"),
    log:
        campaign_place("logs/recalibrate.log"),
    benchmark:
        campaign_place("benchmarks/recalibrate.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        code=CAMPAIGN_STAGES["recalibrate"].digest,
        folder=subpath(output[0], ancestor=2),
    message:
        "campaign {wildcards.campaign}: find the noise, re-fit uncertain parameters"
    shell:
        "jointgap noise {input.plan[0]:q} --folder {params.folder:q} --then recalibrate > {log:q} 2>&1"


rule campaign_screen:
    input:
        plan=plan,
        tables=handed_on("measure", "noise", "recalibrate"),
    output:
        handed_on("screen"),
    log:
        campaign_place("logs/screen.log"),
    benchmark:
        campaign_place("benchmarks/screen.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        code=CAMPAIGN_STAGES["screen"].digest,
        folder=subpath(output[0], ancestor=2),
    message:
        "campaign {wildcards.campaign}: screen the candidates"
    shell:
        "jointgap screen {input.plan[0]:q} --folder {params.folder:q} > {log:q} 2>&1"


rule campaign_fit:
    input:
        plan=plan,
        tables=handed_on("measure", "noise", "recalibrate", "screen"),
    output:
        handed_on("fit"),
    log:
        campaign_place("logs/fit_{part}.log"),
    benchmark:
        campaign_place("benchmarks/fit_{part}.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=120,
    params:
        code=CAMPAIGN_STAGES["fit"].digest,
        folder=subpath(output[0], ancestor=3),
        parts=fit_parts,
    message:
        "campaign {wildcards.campaign}: fit candidates, part {wildcards.part}"
    shell:
        "jointgap fit {input.plan[0]:q} --folder {params.folder:q} --part {wildcards.part} --parts {params.parts} > {log:q} 2>&1"


rule campaign_pair:
    input:
        plan=plan,
        tables=handed_on("measure", "noise", "recalibrate", "screen"),
        fits=all_parts("fit"),
    output:
        handed_on("pair"),
    log:
        campaign_place("logs/pair_{part}.log"),
    benchmark:
        campaign_place("benchmarks/pair_{part}.tsv")
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=120,
    params:
        code=CAMPAIGN_STAGES["pair"].digest,
        folder=subpath(output[0], ancestor=3),
        parts=fit_parts,
    message:
        "campaign {wildcards.campaign}: fit pairs, part {wildcards.part}"
    shell:
        "jointgap pair {input.plan[0]:q} --folder {params.folder:q} --part {wildcards.part} --parts {params.parts} > {log:q} 2>&1"
