#!/bin/sh
# Takes out of a virtual environment what nobody runs: tests, headers, static libraries, and what packages are built by.
# Usage: slim.sh FOLDER
set -eu
cd "$1"/lib/python3*/site-packages
find . -depth -type d -name tests -exec rm -r {} +
find . -name '*.a' -delete
rm -rf torch/test torch/include torch/bin/*Test torch/bin/test_* torch/bin/protoc*
rm -rf setuptools setuptools-*.dist-info pkg_resources _distutils_hack distutils-precedence.pth
