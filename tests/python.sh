#!/usr/bin/env bash
# Makes .venv with what requirements.txt asks for, in tests or in a folder of it, unless it is there already. It appears whole or
# not at all.
# Usage: tests/python.sh [FOLDER].
set -euo pipefail
cd "$(dirname "$0")/${1:-}"

if cmp -s requirements.txt .venv/requirements.txt; then
    exit 0
fi
partial=$(mktemp -d .venv.XXXXXX)
trap 'rm -rf "$partial"' EXIT
python3 -m venv "$partial"
"$partial/bin/python" -m pip install --quiet --disable-pip-version-check --requirement requirements.txt
cp requirements.txt "$partial/requirements.txt"
chmod go+rx "$partial"
rm -rf .venv
mv "$partial" .venv
