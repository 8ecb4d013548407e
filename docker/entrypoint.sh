#!/bin/sh
# Copies the compiled kernels to a writable folder, because numba reads only from one, and runs the command.
set -eu
mkdir -p "$NUMBA_CACHE_DIR"
cp -R /opt/gepf/kernels/. "$NUMBA_CACHE_DIR"
exec "$@"
