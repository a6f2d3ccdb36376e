#!/usr/bin/env bash
# The first machine of a Ray cluster: launch/ray_head.sh ADDRESS. Keep it in a private network: whoever has the token and
# reaches the ports runs code as you. Other machines: copy ~/.ray/auth_token, then RAY_AUTH_MODE=token ray start
# --address=ADDRESS:6379; then credit train -m … hydra/launcher=ray hydra.launcher.ray.init.address=ADDRESS:6379
set -euo pipefail
address=${1:?usage: launch/ray_head.sh ADDRESS (of this machine, in a private network)}
export RAY_AUTH_MODE=token
[ -f ~/.ray/auth_token ] || ray get-auth-token --generate
exec ray start --head --node-ip-address="$address" --port=6379
