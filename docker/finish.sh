#!/bin/sh
# Makes a virtual environment fit for an image: finish.sh FOLDER
set -eu
site=$(echo "$1"/lib/python3.*/site-packages)

# What no program needs at run time.
find "$site" -type d -name tests -prune -exec rm -rf {} +
find "$site" \( -name '*.pyx' -o -name '*.pxd' -o -name '*.h' -o -name '*.a' \) -type f -delete

# Bytecode is taken for current by its source's time; layers keep no fractions of a second.
find "$1" -name '*.py' -exec touch --date=2020-01-01 {} +
"$1"/bin/python -m compileall -q "$site" >/dev/null || true # some packages come with templates of source
