#!/bin/sh
# Removes from a virtual environment what no program needs at run time: shrink.sh FOLDER
set -eu
site=$(echo "$1"/lib/python3.*/site-packages)
find "$site" -type d -name tests -prune -exec rm -rf {} +
find "$site" \( -name '*.pyi' -o -name '*.pyx' -o -name '*.pxd' -o -name '*.h' -o -name '*.a' \) -type f -delete
