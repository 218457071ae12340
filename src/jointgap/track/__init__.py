"""Publishes finished tables to MLflow. Only `mlflow_store` talks to it; `sqlite_store` makes the default store.

`publish.publish` is the stage of a scenario; `sweep_runs` says what the run of a sweep holds; `store_lock` lets one
writer in at a time; `dashboard.addresses` finds what to compare, `network_files.load` brings a published network back.
"""

import os

# Read when mlflow is imported or first used, so they are set before. What the user has set stays.
os.environ.setdefault("MLFLOW_DISABLE_TELEMETRY", "true")  # no network but the tracking server's
os.environ.setdefault("MLFLOW_HTTP_REQUEST_MAX_RETRIES", "1")  # the default, 7, hides a wrong address for four minutes
os.environ.setdefault("MLFLOW_HTTP_REQUEST_TIMEOUT", "20")
os.environ.setdefault("MLFLOW_ENABLE_ARTIFACTS_PROGRESS_BAR", "false")
os.environ.setdefault("MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT", "true")
os.environ.setdefault("GIT_PYTHON_REFRESH", "quiet")  # mlflow looks for git; where there is none it would warn
