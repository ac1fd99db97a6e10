# shellcheck shell=bash
# Sourced by run.sh and test.sh. `set_up run|test EXTRA…` makes .venv hold the pinned packages, or says what is missing.

ROOT="$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)"
VENV="$ROOT/.venv"

note() { echo "$*" >&2; }
die() { note "error: $1: $2 ($3)"; exit 2; }

find_python() {
    local name
    for name in python3 python3.14 python3.13 python3.12 python3.11; do
        if "$name" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            echo "$name"
            return
        fi
    done
}

has_package() { [[ "$(dpkg-query -W -f '${db:Status-Status}' "$1" 2>/dev/null)" == installed ]]; }
has_nvidia_egl() { compgen -G '/usr/share/glvnd/egl_vendor.d/*nvidia*.json' >/dev/null; }

# Names of the Debian packages that this machine lacks.
missing_packages() {
    local python
    if [[ ! -x "$VENV/bin/python" ]]; then
        python="$(find_python)"
        if ! command -v "${python:-python3}" >/dev/null; then
            echo python3 python3-venv
        elif [[ -n "$python" ]] && ! "$python" -c 'import ensurepip, venv' 2>/dev/null; then
            echo "$python-venv"
        fi
    fi
    if command -v dpkg-query >/dev/null; then
        has_package libegl1 || echo libegl1
        has_package libgl1-mesa-dri || has_nvidia_egl || echo libgl1-mesa-dri
    elif command -v ldconfig >/dev/null; then
        ldconfig -p | grep -q 'libEGL\.so\.1' || echo libegl1 libgl1-mesa-dri
    fi
}

install_packages() {
    note "installing $*"
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq >&2 && apt-get install -y -qq --no-install-recommends "$@" >&2 ||
        die "apt-get" "could not install $*; its messages are above" "expected a reachable Debian mirror"
}

check_system() {
    local missing
    read -r -a missing <<<"$(missing_packages | xargs)"
    ((${#missing[@]})) || return 0
    if [[ "$(id -u)" == 0 ]] && command -v apt-get >/dev/null; then
        install_packages "${missing[@]}"
    else
        die "system packages" "missing ${missing[*]}" \
            "expected them installed; on Debian: sudo apt-get install ${missing[*]}"
    fi
}

# Install what only some tests need: `install_for PACKAGE TESTS`. A machine without the package skips these tests.
install_for() {
    [[ "$(id -u)" == 0 ]] && command -v apt-get >/dev/null || return 0
    has_package "$1" && return 0
    note "installing $1"
    export DEBIAN_FRONTEND=noninteractive
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends "$1"; } >&2 ||
        note "no $1: $2 tests will be skipped"
}

install_python_packages() {
    local python
    if ! "$VENV/bin/python" -m pip --version >/dev/null 2>&1; then
        python="$(find_python)"
        [[ -n "$python" ]] || die "$(python3 --version)" "too old" "expected Python 3.11 or newer"
        note "making .venv"
        "$python" -m venv --clear "$VENV" >&2 ||
            die "$VENV" "could not create the virtual environment" "expected the package python3-venv and a writable folder"
    fi
    note "installing Python packages (once)"
    "$VENV/bin/python" "$ROOT/scripts/requirements.py" "$@" |
        "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check \
            --constraint "$ROOT/constraints.txt" --requirement /dev/stdin >&2 ||
        die "pip" "could not install the Python packages; its messages are above" "expected a reachable package index"
}

# The stamps are written last, so an interrupted set-up starts again. What test.sh installs is enough for run.sh.
set_up() {
    local mode="$1" hash
    shift
    check_system
    hash="$(cat "$ROOT/pyproject.toml" "$ROOT/constraints.txt" | sha256sum)"
    if [[ ! -x "$VENV/bin/python" || "$(cat "$VENV/.installed-$mode" 2>/dev/null)" != "$hash" ]]; then
        if [[ "$mode" != run ]]; then
            install_for libllvm19 "the path tracer's"
            install_for chromium "the viewer's"
            install_for glslang-tools "the reference compiler's"
        fi
        install_python_packages "$@"
        echo "$hash" | tee "$VENV/.installed-run" >"$VENV/.installed-$mode"
    fi
    export PYTHONPATH="$ROOT${PYTHONPATH:+:$PYTHONPATH}"
}
