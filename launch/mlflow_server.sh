#!/usr/bin/env bash
# One MLflow server on PostgreSQL for all machines, on 127.0.0.1; docs/server.md says how others reach it.
# launch/mlflow_server.sh postgresql+psycopg://credit:PASSWORD@127.0.0.1/mlflow /srv/credit/artifacts
set -euo pipefail
store=${1:?usage: launch/mlflow_server.sh STORE-URI ARTIFACT-FOLDER}
artifacts=${2:?usage: launch/mlflow_server.sh STORE-URI ARTIFACT-FOLDER}
export MLFLOW_SERVER_ENABLE_JOB_EXECUTION=false  # with it and one worker 0.5 GB of memory instead of 3
exec mlflow server --host 127.0.0.1 --port 5000 --workers 1 \
    --backend-store-uri "$store" --artifacts-destination "$artifacts"
