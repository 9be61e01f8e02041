#!/usr/bin/env bash
# Makes a virtual environment, or takes the one that is there, and installs requirements into it.
# Needs Python 3.11 or newer; PYTHON says which. Example: scripts/venv.sh .venv scripts/requirements.txt
set -euo pipefail
venv=$1 requirements=$2
python=${PYTHON:-python3}
if ! "$python" -m venv "$venv" 2>/dev/null; then
    # Debian splits venv from Python.
    if command -v apt-get >/dev/null && [ "$(id -u)" = 0 ]; then
        apt-get update -qq && apt-get install -y -qq python3-venv
    fi
    "$python" -m venv "$venv"
fi
"$venv/bin/python" -m pip install --quiet --disable-pip-version-check -r "$requirements"
