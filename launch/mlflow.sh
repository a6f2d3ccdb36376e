#!/usr/bin/env bash
# An MLflow server on PostgreSQL, which keeps the runs of several machines.
#
#     launch/mlflow.sh database        once, as root: the role `credit` and its empty database
#     launch/mlflow.sh serve           the server, on 127.0.0.1; more words go to `mlflow server`
#     launch/mlflow.sh backup > FILE   as root: the database, compressed
#
# PGPASSWORD is the role's password (for `serve`, ~/.pgpass will do). What can be set beside it, and its default:
#     MLFLOW_BACKEND_STORE_URI         postgresql+psycopg://credit@127.0.0.1/mlflow
#     MLFLOW_ARTIFACTS_DESTINATION     /srv/credit/artifacts
#     MLFLOW_HOST, MLFLOW_PORT         127.0.0.1, 5000
# MLflow asks nobody for a password: do not open it to the world; `ssh -N -L 5000:127.0.0.1:5000 USER@SERVER` reaches it.
set -euo pipefail

refuse() {
  echo "mlflow.sh: $1" >&2
  exit 2
}

as_postgres() { # PostgreSQL knows root by no name
  cd /
  runuser -u postgres -- "$@"
}

case ${1:-} in
  database)
    [[ -n ${PGPASSWORD:-} ]] || refuse "set PGPASSWORD to the password that the role 'credit' shall have"
    [[ $PGPASSWORD != *"'"* ]] || refuse "PGPASSWORD: no ' in it, please"
    password=$PGPASSWORD
    unset PGPASSWORD
    # through the input: the words of a command can be read by everybody on the machine
    as_postgres psql -v ON_ERROR_STOP=1 -q <<<"CREATE ROLE credit LOGIN PASSWORD '$password'; CREATE DATABASE mlflow OWNER credit"
    ;;
  serve)
    shift
    export MLFLOW_BACKEND_STORE_URI=${MLFLOW_BACKEND_STORE_URI:-postgresql+psycopg://credit@127.0.0.1/mlflow}
    export MLFLOW_SERVER_ENABLE_JOB_EXECUTION=false # with it, 3 GB of memory instead of 0.5
    exec mlflow server --host "${MLFLOW_HOST:-127.0.0.1}" --port "${MLFLOW_PORT:-5000}" --workers 1 \
      --artifacts-destination "${MLFLOW_ARTIFACTS_DESTINATION:-/srv/credit/artifacts}" "$@"
    ;;
  backup)
    as_postgres pg_dump mlflow | gzip
    ;;
  -h | --help) sed -n '2,12s/^# \{0,1\}//p' "$0" ;;
  *) refuse "'${1:-}' is nothing that it does; database, serve, backup, or --help" ;;
esac
