#!/usr/bin/env bash
# Set up .venv if needed, then render: ./run.sh [SCENE] [OPTIONS], as `python -m app` takes them.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/scripts/setup.sh"
set_up run assets video view
exec "$VENV/bin/python" -P -m app "$@"
