#!/usr/bin/env bash
# A Ray cluster for `credit train -m … hydra/launcher=ray hydra.launcher.ray.init.address=ADDRESS:6379`.
#
#     launch/ray.sh head 10.0.0.1      on the first machine, with its own address
#     launch/ray.sh join 10.0.0.1      on every other one
#     launch/ray.sh stop               on each, in the end
#
# More words go to `ray start`: --num-cpus=8, --num-gpus=1, --block. The port is RAY_PORT, or 6379.
# Whoever reaches the ports with the token runs code as you, and nodes listen on all their addresses: keep the cluster
# in a private network, and the token (~/.ray/auth_token, the same on every machine) secret.
set -euo pipefail
export RAY_AUTH_MODE=token
port=${RAY_PORT:-6379}

refuse() {
  echo "ray.sh: $1" >&2
  exit 2
}

has_token() {
  [[ -n ${RAY_AUTH_TOKEN:-} || -f ${RAY_AUTH_TOKEN_PATH:-$HOME/.ray/auth_token} ]]
}

what=${1:-}
case $what in
  head | join)
    [[ $# -ge 2 && $2 != -* ]] || refuse "'$what' needs the address of the first machine: ray.sh $what 10.0.0.1"
    address=$2
    shift 2
    ;;
  stop) exec ray stop ;;
  -h | --help)
    sed -n '2,10s/^# \{0,1\}//p' "$0"
    exit 0
    ;;
  *) refuse "'$what' is nothing that it does; head ADDRESS, join ADDRESS, stop, or --help" ;;
esac
if [[ $what == head ]]; then
  has_token || ray get-auth-token --generate >/dev/null
  exec ray start --head --node-ip-address="$address" --port="$port" --include-dashboard=false "$@"
fi
has_token || refuse "no token on this machine: copy ~/.ray/auth_token from the first one"
exec ray start --address="$address:$port" "$@"
