#!/usr/bin/env bash
# Set up .venv with the test tools if needed, then lint, type-check and test; arguments go to pytest.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/scripts/setup.sh"
set_up test export test lint
cd "$ROOT"
"$VENV/bin/python" -m ruff check .
"$VENV/bin/python" -m mypy
exec "$VENV/bin/python" -m pytest "$@"
