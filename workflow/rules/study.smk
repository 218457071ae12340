# Not part of `make run`: `make study` maps clearance, speed and friction for the first scenario with a loose joint.


rule studied:
    input:
        lambda wildcards: whole(path for name in LOOSE[:1] for path in made_of_study(name)),
    message:
        "clearance, speed and friction are mapped"


rule study_points:
    output:
        points="results/{scenario}/study/points/{part}.parquet",
    log:
        "results/{scenario}/logs/study_{part}.log",
    wildcard_constraints:
        part=r"part_\d+",
    conda:
        "../envs/jointgap.yaml"
    threads: 1
    resources:
        mem_mb=1500,
        runtime=20,
    params:
        options=lambda wildcards: options_file(wildcards.scenario, "study"),
        code=digest_of("study-points"),
        part=lambda wildcards: parts_of_study(wildcards.scenario)[wildcards.part],
    message:
        "{wildcards.scenario}: study, {wildcards.part}"
    shell:
        "jointgap study-points --options {params.options:q} --first {params.part[0]} --number {params.part[1]}"
        " --points {output.points:q} --workers {threads} > {log:q} 2>&1"


rule study:
    input:
        lambda wildcards: expand(
            rules.study_points.output.points, part=parts_of_study(wildcards.scenario), allow_missing=True
        ),
    output:
        points="results/{scenario}/study/points.parquet",
        text="results/{scenario}/study/summary.md",
        figures=expand(
            "results/{{scenario}}/study/{figure}.{ending}",
            figure=STUDY_FIGURES,
            ending=["png", "svg", "parquet"],
        ),
    log:
        "results/{scenario}/logs/study.log",
    conda:
        "../envs/jointgap.yaml"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        options=lambda wildcards: options_file(wildcards.scenario, "study"),
        code=digest_of("study"),
        parts=lambda wildcards, input: [text for part in input for text in ("--points", part)],
        folder=subpath(output.points, parent=True),
    message:
        "{wildcards.scenario}: maps of clearance, speed and friction"
    shell:
        "jointgap study --options {params.options:q} {params.parts:q} --folder {params.folder:q} > {log:q} 2>&1"
