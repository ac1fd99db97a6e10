#!/usr/bin/env bash
# Set up .venv with the test tools if needed, then lint, type-check and test; arguments go to pytest.
# Test files run side by side, a process for each core (at most four: each needs up to 2 GB); -n 0 runs them in one.
set -euo pipefail
source "$(dirname "${BASH_SOURCE[0]}")/scripts/setup.sh"
set_up test export test lint
cd "$ROOT"
"$VENV/bin/python" -m ruff check .
"$VENV/bin/python" -m mypy
exec "$VENV/bin/python" -m pytest -n auto --maxprocesses 4 --dist loadfile "$@"
