# What the terminal shows of a failed job: one line.
#
# The commands of the rules write what they show to a log. Where the disk is full, the log has no room for the reason:
# they write that to the terminal, which they find open under the number 3 (jointgap.app.cli).

from snakemake.logging import logger

from jointgap.app.failed_jobs import OneLineForAFailedJob

shell.prefix("set -euo pipefail; exec 3>&2; export JOINTGAP_TERMINAL=3; ")

# as a module of another workflow this one leaves the messages alone
if not workflow.modifier.skip_configfile and not workflow.output_settings.show_failed_logs:
    logger.addFilter(OneLineForAFailedJob())
