# A failed job is one line on the terminal.
#
# Commands write to a log. If the disk is full, they write the error to the terminal, which is open file 3 (jointgap.app.cli).

from snakemake.logging import logger

from jointgap.app.failed_jobs import OneLineForAFailedJob

shell.prefix("set -euo pipefail; exec 3>&2; export JOINTGAP_TERMINAL=3; ")

# not in a module of another workflow
if not workflow.modifier.skip_configfile and not workflow.output_settings.show_failed_logs:
    logger.addFilter(OneLineForAFailedJob())
