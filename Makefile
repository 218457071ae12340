# What people type. Only relative paths in targets: the folder's own path may hold spaces.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help run variants smoke sweep paper campaign blind benchmark benchmark-files report test test-integration test-slow test-cluster test-wheel lint docs bench dashboard clean set-up

PROFILE ?= local
SET ?= v0_1_0rc2
CORES ?=
ARGS ?=
# Paths are taken as they are written: no $ in them means anything to make.
override CAMPAIGN := $(value CAMPAIGN)
override SET := $(value SET)
override CONFIG := $(value CONFIG)
export CAMPAIGN SET CONFIG
cluster = $(if $(filter slurm,$(PROFILE)),cluster)
snakemake_options = --workflow-profile workflow/profiles/$(PROFILE) $(if $(CORES),--cores $(CORES)) \
	$(if $(CONFIG),--configfile "$$CONFIG") $(ARGS)

# Tests call make too: without the variables of this call.
pytest = env -u MAKEFLAGS -u MFLAGS -u ARGS -u CORES scripts/in-venv python -m pytest

help: ## this list
	@grep -hE '^[a-z-]+:.*## ' $(firstword $(MAKEFILE_LIST)) | sed -E 's/:.*## /\t/' | expand -t 18
	@echo "variables: CORES=2 (default: all), CAMPAIGN=file, CONFIG=file, PROFILE=local|slurm|ci, ARGS='more options of the tool'"

set-up: ## install into .venv; other targets do this automatically
	@scripts/set-up $(cluster)

run: set-up ## the paper's scenario and both example campaigns, then results/report.html; CONFIG=mine.yaml: only yours
	@scripts/in-venv scripts/run-workflow results/report.html all $(snakemake_options)

variants: set-up ## twelve variants of the paper's scenario, then results/report.html
	@scripts/in-venv scripts/run-workflow results/report.html all --configfile config/variants.yaml $(snakemake_options)

smoke: set-up ## all stages with a small configuration (two minutes), then results/smoke-report.html
	@scripts/in-venv scripts/run-workflow results/smoke-report.html all \
		--configfile config/smoke.yaml $(snakemake_options)

sweep: set-up ## parameter sweep: config/sweep.yaml, or CONFIG=mine.yaml
	@scripts/in-venv scripts/run-workflow swept \
		$(if $(CONFIG),,--configfile config/sweep.yaml) $(snakemake_options)

paper: set-up ## infer the paper's unreported settings (ten minutes)
	@scripts/in-venv scripts/run-workflow swept \
		$(if $(CONFIG),,--configfile config/paper_unknowns.yaml) $(snakemake_options)

# $$CAMPAIGN and $$SET are read from the environment, where a quote in a path means itself; Snakemake reads YAML, where
# in quotes a backslash and a quote need a backslash.
campaign: set-up ## identify missing effects of CAMPAIGN=config/campaigns/mine.yaml, then results/campaign-report.html
	@campaign=$${CAMPAIGN//\\/\\\\}; scripts/in-venv scripts/run-workflow results/campaign-report.html campaigned \
		$(snakemake_options) $(if $(CAMPAIGN),--config "campaigns=[\"$${campaign//\"/\\\"}\"]")

blind: ## blind trials: campaigns with hidden effects, analysed and scored (hours); SET=small is quick
	@scripts/set-up peers $(cluster)
	@scripts/in-venv scripts/run-workflow results/blind-report.html blind --snakefile workflow/blind/Snakefile \
		--config "set=$$SET" $(snakemake_options)

benchmark: ## this package and its peers on 100 campaigns (validation/benchmark/README.md; hours), in results/benchmark
	@scripts/set-up peers
	@scripts/in-venv python -m validation benchmark run results/benchmark $(if $(CORES),--cores $(CORES)) $(ARGS)

benchmark-files: ## the campaigns of the benchmark for other methods, in results/benchmark
	@scripts/set-up peers
	@scripts/in-venv python -m validation benchmark draw results/benchmark $(if $(CORES),--cores $(CORES)) $(ARGS)

report: set-up ## rewrite results/report.html
	@rm -f results/report.html
	@$(MAKE) --no-print-directory run

test: ## fast tests
	@scripts/set-up test peers
	@scripts/get-browser
	@$(pytest) -n 2 --dist loadfile $(ARGS)

test-integration: ## chains of several stages
	@scripts/set-up test peers
	@scripts/get-browser
	@$(pytest) -m "integration and not slow and not cluster" -n 2 --dist loadfile $(ARGS)

test-slow: ## slow tests
	@scripts/set-up test peers
	@scripts/get-browser
	@$(pytest) -m slow $(ARGS)

test-cluster: ## tests with local SLURM and PostgreSQL; as root their packages are installed
	@scripts/set-up test peers cluster
	@scripts/get-services
	@$(pytest) -m cluster -n 0 $(ARGS)

test-wheel: ## build the wheel and test it, installed without extras
	@scripts/set-up test
	@scripts/test-wheel $(ARGS)

lint: ## style checks of Python code and workflow
	@scripts/set-up test
	@scripts/in-venv ruff check .
	@scripts/in-venv ruff format --check .
	@scripts/in-venv snakefmt --check Snakefile workflow
	@scripts/in-venv snakemake --lint

docs: ## build the documentation site docs/_build/html/index.html; warnings are errors
	@scripts/set-up docs
	@scripts/in-venv python -m sphinx --fail-on-warning --keep-going --nitpicky --quiet -c docs \
		-d docs/_build/doctrees . docs/_build/html
	@echo "site: docs/_build/html/index.html"

bench: ## benchmarks, compared with other codes
	@scripts/set-up peers
	@scripts/get-lsoda
	@scripts/in-venv python -m benchmarks $(ARGS)

dashboard: set-up ## MLflow runs in the browser
	@scripts/in-venv jointgap dashboard $(ARGS)

clean: ## remove all results, not .venv
	rm -rf results .snakemake
