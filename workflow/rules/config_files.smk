# Snakemake's own reader takes 0600 for 384 and, of two equal keys, the last one without a word: files are read strictly too.

import os

from snakemake.exceptions import WorkflowError

from jointgap.config import read_yaml
from jointgap.core.errors import InputError


def check_config_files(*more):
    """The files of the command line, and those of `more` that are there; a workflow that has this one as a module has its own."""
    if workflow.modifier.skip_configfile:
        return
    try:
        for path in [*workflow.configfiles, *filter(os.path.exists, more)]:
            read_yaml(path)
    except InputError as error:
        raise WorkflowError(str(error)) from None
