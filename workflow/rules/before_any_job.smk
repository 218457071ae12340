# Before the first job: nobody else works in the folder, SLURM takes the jobs, and what is to be published will find its store.
# Dry runs and the processes of single jobs leave all of them alone. Snakemake obeys one onstart alone, so there is no other.

import os
import sys
from pathlib import Path


def check_mlflow_store():
    """End here where MLFLOW_TRACKING_URI names a store that does not answer, and a job is to publish to it."""
    if not os.environ.get("MLFLOW_TRACKING_URI"):
        return
    asked = [
        job.rule.resources["mlflow_store"]
        for job in workflow.dag.needrun_jobs()
        if "mlflow_store" in job.rule.resources
    ]
    if not any(resource.value for resource in asked):
        return
    from jointgap.core.errors import InputError
    from jointgap.core.publish import check_store, store_address

    try:
        check_store(store_address(Path("results")))
    except InputError as error:
        sys.exit(f"jointgap: error: {error}")


onstart:
    hold_run_lock()
    check_slurm()
    check_mlflow_store()
