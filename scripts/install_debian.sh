#!/usr/bin/env bash
# As root, install the command `afterglow` on a bare Debian 12 from the tree around this script; the Dockerfile runs it.
set -euo pipefail
tree="$(realpath "$(dirname "$0")/..")"
export DEBIAN_FRONTEND=noninteractive
apt-get update
apt-get install -y --no-install-recommends python3 python3-venv libegl1 libgl1-mesa-dri
rm -rf /var/lib/apt/lists/*
python3 -m venv /opt/afterglow
/opt/afterglow/bin/pip install --no-cache-dir --constraint "$tree/constraints.txt" "$tree[assets,cluster,video,view]"
ln -sf /opt/afterglow/bin/afterglow /usr/local/bin/afterglow
afterglow doctor --size 256x192
