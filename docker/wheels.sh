#!/bin/sh
# Fetches every wheel that the image needs into docker/wheels/, for builds that reach no package
# index; whatever Python runs this, they are for the CPython 3.11 on Linux of the image:
#
#   PYTHON=.venv/bin/python docker/wheels.sh
#
# When wheels are there the image is built from them and from nothing else.
set -eu
cd "$(dirname "$0")/.."
python=${PYTHON:-python3}
machine=$(uname -m)

"$python" docker/requirements.py pyproject.toml build |
    xargs "$python" -m pip download --quiet --dest docker/wheels --only-binary :all: \
        --python-version 3.11 --implementation cp --abi cp311 --abi abi3 --abi none \
        --platform "manylinux_2_28_$machine" --platform "manylinux_2_17_$machine" \
        --platform "manylinux2014_$machine"
