#!/bin/sh
# Puts the compiled kernels where they can be written to, since numba reads no others, and runs the command.
set -eu
mkdir -p "$NUMBA_CACHE_DIR"
cp -R /opt/gepf/kernels/. "$NUMBA_CACHE_DIR"
exec "$@"
